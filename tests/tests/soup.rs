//! Some hundred scenes of the fuzz target `soup`, baked from end to end: the same ones in every run.

#[path = "../fuzz/src/soup.rs"]
mod soup;

use std::fs;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::time::Instant;

/// Scenes of an ordinary run.
const SCENES: u64 = 400;

/// `SOUP=1000..5000` bakes those scenes instead.
fn numbers() -> std::ops::Range<u64> {
    let parsed = std::env::var("SOUP").ok().and_then(|text| {
        let (first, end) = text.split_once("..")?;
        Some(first.parse().ok()?..end.parse().ok()?)
    });
    parsed.unwrap_or(0..SCENES)
}

#[test]
fn every_soup_of_triangles_is_baked_or_refused_with_a_reason() {
    // Datasets are synced to the disk file by file; in memory that costs nothing.
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let scratch = tempfile::tempdir_in(folder).unwrap();
    let (mut failures, mut accepted, mut slowest) = (Vec::new(), 0, (0.0, 0));
    for number in numbers() {
        let start = Instant::now();
        let bytes = (number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).to_le_bytes();
        match panic::catch_unwind(AssertUnwindSafe(|| soup::soup(scratch.path(), &bytes))) {
            Ok(good) => accepted += u64::from(good),
            Err(panic) => {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let text = text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("of another kind");
                let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("soup-{number}"));
                drop(fs::remove_dir_all(&kept));
                fs::create_dir_all(&kept).unwrap();
                for file in fs::read_dir(scratch.path().join("soup")).unwrap().flatten() {
                    drop(fs::copy(file.path(), kept.join(file.file_name())));
                }
                failures.push(format!("scene {number} (see {}): panic: {text}", kept.display()));
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        if seconds > slowest.0 {
            slowest = (seconds, number);
        }
    }
    println!(
        "{accepted} of {} accepted; the slowest is {} with {:.1} s",
        numbers().count(),
        slowest.1,
        slowest.0
    );
    assert!(failures.is_empty(), "{} failures:\n{}", failures.len(), failures.join("\n"));
    // Scenes that are nearly all refused would test little.
    assert!(3 * accepted > numbers().count() as u64, "{accepted} accepted");
}
