//! The second reader, `python/read_ndgi.py`, against the decoder. It needs Python with numpy: that of
//! `NDGI_PYTHON`, which must work, or else `python3`, without which the tests say that they were skipped.

mod common;

use common::{Scene, difference, image, islands, python, read, script};
use compressor::compress::{Options, Rate, compress};
use compressor::decode::Decoder;
use compressor::model::{BORDER, PROFILES};
use dataset::observe::Silent;
use ndgi::testing::{Random, basis_bundle, basis_parts};
use ndgi::{Bundle, bundle};
use std::fs;
use std::process::Command;

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
        compress(folder.path(), &options, &Silent).unwrap();
        let decoder = Decoder::open(&bundle).unwrap();
        // Frames; between frames; on both sides of both switches and close to them; around midnight; another
        // day.
        let all =
            [0.0, 6.0, 12.0, 18.1, 3.0, 9.25, 15.3, 5.95, 18.05, 5.9001, 18.001, 21.0, 23.99, 30.5, -0.5];
        let hours = if i == 1 { &all[..] } else { &all[5..9] };
        for &hour in hours {
            let (output, npy) = read(&python, &bundle, &[&format!("--hour={hour}")]);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let error = difference(&decoder, 0, hour, &image(&npy));
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
    compress(folder.path(), &options, &Silent).unwrap();
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
        ("resident block damaged", flipped(header + 5)),
        ("is damaged", flipped(whole.len() - 20)),
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

#[test]
fn planes_are_read_as_the_decoder_reads_them() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("yard.ndgi");
    fs::write(&file, basis_bundle()).unwrap();
    let decoder = Decoder::open(&file).unwrap();
    let mut worst = 0.0f64;
    // Frames, the second of which is black; between them and at intermediate hours; both sides of a switch,
    // of the lamp that is apart and of the one that is not; around midnight; another day.
    let hours = [
        0.0, 5.9, 6.0, 18.1, 1.5, 3.0, 3.001, 5.95, 5.9999, 12.0, 17.999, 18.0, 18.001, 20.0, 21.7, 23.9999,
        -0.5, 42.05,
    ];
    for hour in hours {
        for page in 0..2 {
            let (output, npy) = read(&python, &file, &[&format!("--hour={hour}"), &format!("--page={page}")]);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let error = difference(&decoder, page, hour, &image(&npy));
            assert!(error <= 3e-4, "page {page} at {hour} h: {error}");
            worst = worst.max(error);
        }
    }
    println!("largest difference in {} pages: {worst:.1e}", 2 * hours.len());
}

/// Reads all tiles of the bundles named, one after another: what is refused, and what is finite.
const READ_ALL: &str = "
import sys, numpy
sys.path.insert(0, sys.argv[1])
from read_ndgi import Bundle
for name in sys.argv[2:]:
    try:
        bundle = Bundle(name)
        tiles = [bundle.tile(*place, 18.05) for place in bundle.index]
        assert all(numpy.isfinite(tile).all() for tile in tiles), name
        print('finite')
    except ValueError as problem:
        print('refused:', problem)
";

#[test]
fn hostile_planes_are_refused_or_finite_in_both_readers() {
    const ROUNDS: usize = 300;
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (whole, (header, parts)) = (basis_bundle(), basis_parts());
    let end = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
    let mut random = Random(11);
    let mut mutate = |bytes: &mut [u8], from: usize| {
        for _ in 0..1 + random.below(3) {
            let at = from + random.below(bytes.len() - from);
            match random.below(3) {
                0 => bytes[at] ^= 1 << random.below(8),
                1 => bytes[at] = random.byte(),
                _ => bytes[at..].iter_mut().take(4).for_each(|byte| *byte = 0xff),
            }
        }
    };
    let (mut files, mut expected) = (Vec::new(), Vec::new());
    for round in 0..ROUNDS {
        let mut bytes = whole.clone();
        // Of checksums, none is right, that of the header, or all.
        match round % 6 {
            0 => mutate(&mut bytes, 0),
            1 | 2 => {
                mutate(&mut bytes[..end], 32);
                let digest = blake3::hash(&[&bytes[..24], &bytes[32..end]].concat());
                bytes[24..32].copy_from_slice(&digest.as_bytes()[..8]);
            }
            _ => {
                let mut parts = parts.clone();
                let part = &mut parts[if round % 12 < 6 { 0 } else { 2 }];
                match round % 6 {
                    3 => mutate(&mut part.maps.bytes[..40], 0),
                    4 => mutate(&mut part.maps.bytes, 0),
                    _ => mutate(&mut part.resident, 0),
                }
                bytes = bundle::encode(&header, &parts).unwrap();
            }
        }
        let file = folder.path().join(format!("{round}.ndgi"));
        fs::write(&file, &bytes).unwrap();
        files.push(file);
        let decoded = Bundle::from_bytes(bytes).and_then(|bundle| {
            let decoder = Decoder::new(bundle);
            (0..decoder.bundle().header.pages.len()).map(|page| decoder.decode_page(page, 18.05)).collect()
        });
        let is_finite = |pages: Vec<compressor::decode::Image>| {
            pages.iter().flat_map(|page| page.texels.as_flattened()).all(|light| light.is_finite())
        };
        expected.push(decoded.map(|pages| assert!(is_finite(pages), "{round}")).is_ok());
    }
    let mut command = Command::new(&python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").args(["-c", READ_ALL]);
    let output = command.arg(script().parent().unwrap()).args(&files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    let found: Vec<&str> = printed.lines().collect();
    assert_eq!(found.len(), ROUNDS);
    for (round, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(*found == "finite", *expected, "{round}: {found}");
    }
    let accepted = expected.iter().filter(|is_read| **is_read).count();
    assert!((20..250).contains(&accepted), "{accepted}");
}
