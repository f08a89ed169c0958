//! The reader in Python, `python/read_dataset.py`, against our own. It needs Python with numpy and OpenEXR:
//! that of `NDGI_PYTHON`, which must work, or else `python3`, without which the test says that it was
//! skipped.

mod common;

use common::{Random, python, write_set};
use dataset::digest::Digest;
use dataset::format::{Config, FileRef, Light, Part};
use dataset::image::{Image, Mask};
use dataset::release::release;
use dataset::store::Dataset;
use std::fs;
use std::path::Path;
use std::process::Command;

/// What prints an array's shape and the sum of its bytes times their places, both of which our side knows
/// too.
const TOLD: &str = "
import sys, numpy as np
def told(array):
    data = np.frombuffer(np.ascontiguousarray(array).tobytes(), np.uint8).astype(np.uint64)
    print(*array.shape, int((data * np.arange(1, len(data) + 1, dtype=np.uint64)).sum()))
sys.path.insert(0, sys.argv[1])
from read_dataset import Dataset
";

/// Prints what a dataset of three hours has on two pages.
const DIGEST: &str = "
s = Dataset(sys.argv[2])
assert s.hours == [0, 12, 21.5], s.hours
for page in (0, 1):
    told(s.mask(page))
    for hour in s.hours:
        told(s.light(hour, page))
        for layer in ('sun', 'sky', 'porch', 'garden'):
            told(s.layer(layer, hour, page))
";

fn reported(shape: &[usize], bytes: impl Iterator<Item = u8>) -> String {
    let sum: u64 = bytes.zip(1..).map(|(byte, place): (u8, u64)| u64::from(byte) * place).sum();
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    format!("{} {sum}\n", shape.join(" "))
}

fn told_image(image: Image) -> String {
    let texels = image.texels.into_iter().flatten().flat_map(f32::to_ne_bytes);
    reported(&[image.height, image.width, 3], texels)
}

/// Everything that the script prints.
fn expected(dataset: &Dataset) -> String {
    let mut text = String::new();
    for page in 0..2 {
        let mask = dataset.mask(page).unwrap();
        text += &reported(&[mask.height, mask.width], mask.valid.iter().map(|&valid| u8::from(valid)));
        for (number, frame) in dataset.config.frames.iter().enumerate() {
            let map = dataset.map(number, page).unwrap();
            let black = Image::black(map.width, map.height);
            text += &told_image(map);
            text += &told_image(dataset.light(Light::Sun, None, number, page).unwrap());
            text += &told_image(dataset.light(Light::Sky, None, number, page).unwrap());
            for (group, on) in (0..).zip(&frame.groups_on) {
                let light = dataset.light(Light::Group, Some(group), number, page).unwrap();
                text += &told_image(if *on { light } else { black.clone() });
            }
        }
    }
    text
}

/// Masks whose rows a writer filters in every way.
fn with_hard_masks(root: &Path) -> Config {
    let config = write_set(root, &[(70, 60), (9, 5)], 3).unwrap();
    let mut random = Random(5);
    let mut mask = Mask { width: 70, height: 60, valid: vec![false; 70 * 60] };
    for y in 0..60 {
        for x in 0..70 {
            mask.valid[y * 70 + x] = match y / 12 {
                0 => random.below(2) == 0,
                1 => x > y,
                2 => x % 7 < 3,
                3 => (x + y) % 9 < 4,
                _ => x > 20 && random.below(40) > 0,
            };
        }
    }
    let png = mask.to_png();
    let mut config = config;
    config.pages[0].mask.bytes = png.len() as u64;
    config.pages[0].mask.blake3 = Digest::of(&png);
    fs::write(root.join(&config.pages[0].mask.path), png).unwrap();
    fs::write(root.join("config.json"), serde_json::to_vec(&config).unwrap()).unwrap();
    config
}

#[test]
fn the_reader_in_python_reads_the_same_texels() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (set, out) = (folder.path().join("set"), folder.path().join("release"));
    with_hard_masks(&set);
    let dataset = Dataset::open(&set).unwrap();
    release(std::slice::from_ref(&set), &[], false, &out, &dataset::observe::Silent).unwrap();
    // As an unpacked release has it: the layers stand in a manifest beside that of the datasets.
    fs::copy(set.join("config.json"), set.join("layers.json")).unwrap();
    fs::write(set.join("config.json"), b"{}").unwrap();
    let run = |arguments: &[&Path]| {
        let mut command = Command::new(&python);
        command.env("PYTHONDONTWRITEBYTECODE", "1").args(arguments).output().unwrap()
    };
    let script = format!("{TOLD}{DIGEST}");
    let output = run(&[Path::new("-c"), Path::new(&script), &out, &set]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8(output.stdout).unwrap(), expected(&dataset));

    // As a program.
    let script = out.join("read_dataset.py");
    let npy = folder.path().join("x.npy");
    let arguments = |hour: &'static str| -> [&Path; 6] {
        [&script, &set, Path::new("--hour"), Path::new(hour), Path::new("--out"), &npy]
    };
    let output = run(&arguments("12"));
    assert!(output.status.success(), "{output:?}");
    let texels = dataset.map(1, 0).unwrap().texels;
    let bytes: Vec<u8> = texels.into_iter().flatten().flat_map(f32::to_ne_bytes).collect();
    assert!(fs::read(&npy).unwrap().ends_with(&bytes));
    let output = run(&arguments("13"));
    assert!(!output.status.success() && !String::from_utf8_lossy(&output.stderr).contains("Traceback"));
    // Other light of the same length, and a torn file.
    let map = set.join(&dataset.config.frames[1].maps[0].path);
    let mut other = fs::read(&map).unwrap();
    *other.last_mut().unwrap() ^= 1;
    for (bytes, what) in
        [(&other[..], "another checksum than config.json says"), (b"torn", "4 bytes; expected")]
    {
        fs::write(&map, bytes).unwrap();
        let output = run(&arguments("12"));
        assert!(
            !output.status.success() && String::from_utf8_lossy(&output.stderr).contains(what),
            "{output:?}"
        );
    }
}

/// Prints the digests of the first bytes of a file, as numpy computes them without the package.
const DIGESTS: &str = "
import sys
sys.path.insert(0, sys.argv[1])
import blake3_numpy
blake3_numpy.BATCH = 4
data = open(sys.argv[2], 'rb').read()
for length in map(int, sys.argv[3:]):
    print(blake3_numpy.numpy_digest(data[:length]).hex())
";

#[test]
fn numpy_gives_the_digests_of_blake3() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bytes");
    let mut random = Random(9);
    let bytes: Vec<u8> = (0..13_000).map(|_| random.bits() as u8).collect();
    fs::write(&path, &bytes).unwrap();
    // Blocks of 64 bytes, chunks of 1024, batches of four chunks.
    let lengths = [0, 1, 63, 64, 65, 1023, 1024, 1025, 2048, 3073, 4096, 4097, 8192, 12_288, 13_000];
    let mut command = Command::new(&python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").args(["-c", DIGESTS]);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("python")).arg(&path);
    let output = command.args(lengths.map(|length| length.to_string())).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let expected = lengths.map(|length| format!("{:?}\n", Digest::of(&bytes[..length]))).concat();
    assert_eq!(String::from_utf8(output.stdout).unwrap(), expected);
}

/// Prints all that the reader gives of a dataset.
const EVERYTHING: &str = "
s = Dataset(sys.argv[2])
print(s.config['version'], *s.hours)
groups = [group['name'] for group in s.config['groups']]
for page in range(len(s.config['pages'])):
    told(s.mask(page))
    for hour in s.hours:
        told(s.light(hour, page))
        for layer in ['sun', 'sky', 'local'] + groups:
            for part in (None, 'all', 'direct', 'indirect'):
                told(s.layer(layer, hour, page, part))
";

/// All that [`EVERYTHING`] prints.
fn everything(dataset: &Dataset) -> String {
    let config = &dataset.config;
    let hours: Vec<String> = config.frames.iter().map(|frame| format!("{:?}", frame.hour)).collect();
    let mut text = format!("{} {}\n", dataset.config.version, hours.join(" "));
    let groups = (0..config.groups.len() as u32).map(|group| (Light::Group, Some(group)));
    let lights: Vec<_> =
        [(Light::Sun, None), (Light::Sky, None), (Light::Lamps, None)].into_iter().chain(groups).collect();
    for page in 0..config.pages.len() {
        let mask = dataset.mask(page).unwrap();
        let (width, height) = (mask.width, mask.height);
        text += &reported(&[height, width], mask.valid.iter().map(|&valid| u8::from(valid)));
        for (number, frame) in config.frames.iter().enumerate() {
            text += &told_image(dataset.map(number, page).unwrap());
            for &(light, group) in &lights {
                let is_on = group.is_none_or(|group| frame.groups_on[group as usize]);
                for part in [None, Some(Part::All), Some(Part::Direct), Some(Part::Indirect)] {
                    let layers = config.layers_of(light, group);
                    let layers = layers.filter(|layer| is_on && part.is_none_or(|part| part == layer.part));
                    let files: Vec<&FileRef> = layers.filter_map(|l| l.file(number, page)).collect();
                    let texels = dataset.sum_rows(&files, page, 0, height).unwrap();
                    text += &told_image(Image { width, height, texels });
                }
            }
        }
    }
    text
}

#[test]
fn the_reader_in_python_reads_datasets_as_rust_does() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_set(folder.path(), &[(12, 9), (5, 7)], 11).unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let fixture = |name: &str| root.join("tests/fixtures").join(name);
    let script = format!("{TOLD}{EVERYTHING}");
    for set in [fixture("baked"), fixture("imported"), folder.path().to_owned()] {
        let dataset = Dataset::open(&set).unwrap();
        let mut command = Command::new(&python);
        command.env("PYTHONDONTWRITEBYTECODE", "1").args(["-c", &script]).arg(root.join("python")).arg(&set);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let (found, expected) = (String::from_utf8(output.stdout).unwrap(), everything(&dataset));
        // The first line that differs says more than thousands do.
        let differs = found.lines().zip(expected.lines()).position(|(found, expected)| found != expected);
        assert!(found == expected, "{}: line {differs:?}", set.display());
    }
}
