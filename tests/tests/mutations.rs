//! Every reader on the fuzz corpus and on some thousand changes of it: no panic, and no more memory than the
//! bytes account for. The functions are those of the fuzz targets (`tests/fuzz`); the changes are the same in
//! every run.

#[path = "../fuzz/src/readers.rs"]
mod readers;

use readers::TARGETS;
use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Bytes that are allocated now, and the most since it was last asked.
static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

struct Counting;

/// SAFETY: every call goes on to the system's allocator as it came; counting touches no memory of it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(live, Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(live, Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Memory that any input may take: blocks of rows on their way, the windows of decompressors.
const BASE_BYTES: usize = 64 << 20;
/// Texels may be compressed by about a thousand, and be held as light and as a mask.
const BYTES_PER_BYTE: usize = 4 * 1100;

/// Changes per target: so many that each takes some seconds at most.
fn changes(target: &str) -> usize {
    match target {
        "config" | "mask" | "bundle" | "scene" | "ies" | "sun" | "curve" => 20_000,
        _ => 4_000,
    }
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.bits() % n.max(1) as u64) as usize
    }

    /// One to four changes of one file, some with parts of another.
    fn change(&mut self, seeds: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = seeds[self.below(seeds.len())].clone();
        for _ in 0..=self.below(4) {
            let (at, other) = (self.below(bytes.len()), self.below(bytes.len()));
            let (start, end) = (at.min(other), at.max(other).min(at.min(other) + 64));
            match self.below(8) {
                0 | 1 if !bytes.is_empty() => bytes[at] ^= 1 << self.below(8),
                2 if !bytes.is_empty() => bytes[at] = [0, 1, 127, 128, 255][self.below(5)],
                // A number as headers have them.
                3 if bytes.len() >= 8 => {
                    let number = [0, 1, 255, 65536, u32::MAX / 2, u32::MAX][self.below(6)];
                    let at = self.below(bytes.len() - 4);
                    bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
                }
                // A number as text has them.
                4 => {
                    let digits = |byte: &u8| byte.is_ascii_digit();
                    if let Some(from) = bytes[at.min(bytes.len())..].iter().position(digits).map(|i| at + i) {
                        let length = bytes[from..].iter().take_while(|byte| digits(byte)).count();
                        let numbers =
                            ["0", "-1", "1e999", "4294967296", "18446744073709551615", "0.1", "null", "2400"];
                        let number = numbers[self.below(numbers.len())].bytes();
                        bytes.splice(from..from + length, number);
                    }
                }
                5 => bytes.truncate(at),
                6 => drop(bytes.drain(start..end)),
                _ => {
                    let from = &seeds[self.below(seeds.len())];
                    let first = self.below(from.len());
                    let last = (first + 1 + self.below(64)).min(from.len());
                    bytes.splice(start..end, from[first.min(last)..last].iter().copied());
                }
            }
        }
        bytes
    }
}

#[test]
fn no_reader_panics_or_takes_more_memory_than_its_input_accounts_for() {
    // Datasets are synced to the disk file by file; in memory that costs nothing.
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let scratch = tempfile::tempdir_in(folder).unwrap();
    // What readers catch themselves need not be told thousands of times.
    let told = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let mut failures = Vec::new();
    for (name, target) in TARGETS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name);
        let mut paths: Vec<_> = fs::read_dir(&folder).unwrap().flatten().map(|entry| entry.path()).collect();
        paths.sort();
        let seeds: Vec<Vec<u8>> = paths.iter().map(|path| fs::read(path).unwrap()).collect();
        assert!(!seeds.is_empty(), "{name} has no corpus");
        let (start, mut accepted) = (Instant::now(), 0);
        let mut random = Random(name.bytes().map(u64::from).sum());
        for number in 0..seeds.len() + changes(name) {
            let bytes = seeds.get(number).cloned().unwrap_or_else(|| random.change(&seeds));
            let before = LIVE.load(Ordering::Relaxed);
            PEAK.store(before, Ordering::Relaxed);
            let result = panic::catch_unwind(AssertUnwindSafe(|| target(scratch.path(), &bytes)));
            let taken = PEAK.load(Ordering::Relaxed).saturating_sub(before);
            let what = match result {
                Err(panic) => {
                    let text = panic.downcast_ref::<String>().map(String::as_str);
                    let text = text.or(panic.downcast_ref::<&str>().copied());
                    format!("panic: {}", text.unwrap_or("of another kind"))
                }
                Ok(_) if taken > BASE_BYTES + BYTES_PER_BYTE * bytes.len() => {
                    format!("{taken} bytes of memory for {} of input", bytes.len())
                }
                // The corpus itself is good, or tests nothing.
                Ok(false) if number < seeds.len() => "refused, though it is of the corpus".to_owned(),
                Ok(good) => {
                    accepted += usize::from(good);
                    continue;
                }
            };
            let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{number}"));
            fs::write(&file, &bytes).unwrap();
            failures.push(format!("{name}, input {number} (see {}): {what}", file.display()));
            let _ = fs::remove_dir_all(scratch.path().join("out"));
        }
        let inputs = seeds.len() + changes(name);
        println!("{name}: {inputs} inputs, {accepted} accepted, {:.1} s", start.elapsed().as_secs_f64());
    }
    panic::set_hook(told);
    assert!(failures.is_empty(), "{} failures:\n{}", failures.len(), failures.join("\n"));
}
