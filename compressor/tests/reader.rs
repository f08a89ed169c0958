//! The second reader, `python/read_ndgi.py`, against the decoder. It needs Python with numpy: that of `NDGI_PYTHON`, which must
//! work, or else `python3`, without which the tests say that they were skipped.

mod common;

use common::{Scene, islands};
use compressor::compress::{Options, Rate, compress};
use compressor::decode::Decoder;
use compressor::grid::Place;
use compressor::model::{BORDER, PAYLOAD, PROFILES};
use dataset::console::Console;
use dataset::image::Image;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A Python that has numpy.
fn python() -> Option<String> {
    let named = std::env::var("NDGI_PYTHON").ok();
    let python = named.clone().unwrap_or("python3".to_owned());
    let works = Command::new(&python).args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success());
    assert!(works || named.is_none(), "NDGI_PYTHON={python} does not run, or lacks numpy");
    if !works {
        eprintln!("skipped: there is no python3 with numpy");
    }
    works.then_some(python)
}

fn read(python: &str, bundle: &Path, arguments: &[&str]) -> (Output, PathBuf) {
    let out = bundle.with_extension("npy");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/read_ndgi.py");
    let mut command = Command::new(python);
    command
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(script)
        .arg(bundle)
        .args(arguments)
        .arg("--out")
        .arg(&out);
    (command.output().unwrap(), out)
}

/// An array of height × width × 3 float32.
fn image(path: &Path) -> Image {
    let bytes = fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..start]).into_owned();
    assert!(header.contains("'<f4'") && header.contains("'fortran_order': False"), "{header}");
    let shape = header.split(['(', ')']).nth(1).unwrap();
    let shape: Vec<usize> = shape.split(',').map(|n| n.trim().parse().unwrap()).collect();
    let values: Vec<f32> =
        bytes[start..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let texels = values.as_chunks::<3>().0.to_vec();
    assert_eq!((shape[2], texels.len()), (3, shape[0] * shape[1]));
    Image { width: shape[1], height: shape[0], texels }
}

/// Largest difference of two pages in units of FORMAT.md's max(E, mean / 100).
fn difference(decoder: &Decoder, hour: f64, found: &Image) -> f64 {
    let expected = decoder.decode_page(0, hour).unwrap();
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let moment = decoder.bundle().header.timeline.at(hour);
    let mut worst = 0.0f64;
    for row in 0..expected.height.div_ceil(PAYLOAD) {
        for column in 0..expected.width.div_ceil(PAYLOAD) {
            let tile = decoder.tile(Place { page: 0, column, row }).unwrap();
            let mean = |c: usize| {
                let share = moment.fraction as f32;
                let [a, b] = moment.knots;
                tile.as_ref().map_or(0.0, |t| (1.0 - share) * t.knots[a].mean[c] + share * t.knots[b].mean[c])
            };
            for y in row * PAYLOAD..((row + 1) * PAYLOAD).min(expected.height) {
                for x in column * PAYLOAD..((column + 1) * PAYLOAD).min(expected.width) {
                    let i = y * expected.width + x;
                    for c in 0..3 {
                        let (a, b) = (f64::from(expected.texels[i][c]), f64::from(found.texels[i][c]));
                        if a != b {
                            worst = worst.max((a - b).abs() / a.max(f64::from(mean(c)) / 100.0));
                        }
                    }
                }
            }
        }
    }
    worst
}

#[test]
fn a_reader_written_from_the_document_agrees_with_the_decoder() {
    let Some(python) = python() else { return };
    let (mut worst, mut compared) = (0.0f64, 0);
    let rates = PROFILES.into_iter().map(Rate::Profile).chain([Rate::Bpp(0.3)]);
    for (i, rate) in rates.enumerate() {
        // All hours and several tiles once; of the other profiles, and where tiles have what they need, less.
        let scene = if i == 1 { islands() } else { Scene { width: 45, height: 131, ..islands() } };
        let folder = tempfile::tempdir().unwrap();
        scene.write(folder.path());
        let bundle = folder.path().join("isles.ndgi");
        let options = Options { rate, iterations: 60, out: Some(bundle.clone()), ..Options::default() };
        compress(folder.path(), &options, &Console::silent()).unwrap();
        let decoder = Decoder::open(&bundle).unwrap();
        // Sets; between sets; on both sides of both switches and close to them; around midnight; another day.
        let all =
            [0.0, 6.0, 12.0, 18.1, 3.0, 9.25, 15.3, 5.95, 18.05, 5.9001, 18.001, 21.0, 23.99, 30.5, -0.5];
        let hours = if i == 1 { &all[..] } else { &all[5..9] };
        for &hour in hours {
            let (output, npy) = read(&python, &bundle, &[&format!("--hour={hour}")]);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let error = difference(&decoder, hour, &image(&npy));
            assert!(error <= 1e-4, "{rate:?} at {hour} h: {error}");
            (worst, compared) = (worst.max(error), compared + 1);
        }
        // A tile with its border.
        let (output, npy) = read(&python, &bundle, &["--hour", "12", "--tile", "0,0"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let (tile, page) = (image(&npy), decoder.decode_page(0, 12.0).unwrap());
        assert_eq!((tile.width, tile.height), (if i == 1 { 128 } else { 48 }, 128));
        let (own, of_page) =
            (tile.texels[(BORDER + 61) * tile.width + BORDER + 30], page.texels[61 * page.width + 30]);
        let near = |c: usize| (own[c] - of_page[c]).abs() <= 1e-4 * of_page[c].max(0.01);
        assert!((0..3).all(near), "{own:?} {of_page:?}");
    }
    println!("largest difference in {compared} pages: {worst:.1e}");
}

#[test]
fn the_reader_refuses_what_is_damaged() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    let bundle = folder.path().join("isles.ndgi");
    let options = Options { iterations: 20, out: Some(bundle.clone()), ..Options::default() };
    compress(folder.path(), &options, &Console::silent()).unwrap();
    let whole = fs::read(&bundle).unwrap();
    let header = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
    let flipped = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        bytes
    };
    let damages = [
        ("version", flipped(8)),
        ("header damaged", flipped(100)),
        ("header damaged", flipped(header - 40)),
        ("is damaged", flipped(header + 5)),
        ("truncated", whole[..whole.len() - 16].to_vec()),
        ("", whole[..20].to_vec()),
        ("", Vec::new()),
    ];
    for (what, bytes) in damages {
        fs::write(&bundle, bytes).unwrap();
        let (output, npy) = read(&python, &bundle, &["--hour", "12"]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(what), "{what}: {message}");
        assert!(message.contains("isles.ndgi") && !message.contains("Traceback"), "{message}");
        assert!(!npy.exists());
    }
    fs::write(&bundle, whole).unwrap();
    assert!(read(&python, &bundle, &["--hour", "12"]).0.status.success());
}
