//! The second reader, `python/read_ndgi.py`, against the decoder. It needs Python with numpy: that of
//! `NDGI_PYTHON`, which must work, or else `python3`, without which the tests say that they were skipped.

mod common;

use common::{Scene, difference, image, islands, python, read};
use compressor::compress::{Options, Rate, compress};
use compressor::decode::Decoder;
use compressor::model::{BORDER, PROFILES};
use dataset::observe::Silent;
use std::fs;

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
