//! The C header: its example is compiled, linked and run, on a good bundle, a broken one and none.

use ndgi::Bundle;
use ndgi::bundle::{self, Payload};
use ndgi::grid::Place;
use ndgi::half::F16;
use ndgi::testing::{self, Random};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// The library that C links, built once.
fn library() -> PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    let built = BUILT.get_or_init(|| {
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("capi");
        // Optimised a little: 2000 bundles are decoded by it.
        run(Command::new(env!("CARGO"))
            .args(["rustc", "--offline", "--lib", "--features", "capi", "--crate-type", "cdylib"])
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env("CARGO_PROFILE_DEV_OPT_LEVEL", "1")
            .env("CARGO_TARGET_DIR", &target));
        target.join("debug")
    });
    built.clone()
}

/// Compiles and links a program; `compiler` has its arguments behind it.
fn program(compiler: &[&str], source: &Path, to: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(compiler[0]);
    command.args(&compiler[1..]).args(["-Wall", "-Wextra", "-Werror", "-I"]).arg(root.join("include"));
    run(command.arg(source).arg("-L").arg(library()).args(["-lndgi", "-o"]).arg(to));
}

#[test]
fn the_example_in_c_decodes_what_rust_decodes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let (decoder, library) = (folder.path().join("decode"), library());
    program(&["cc", "-std=c99"], &root.join("examples/decode.c"), &decoder);
    let decode = |arguments: &[&str]| {
        Command::new(&decoder).args(arguments).env("LD_LIBRARY_PATH", &library).output().unwrap()
    };

    let path = root.join("../../tests/fuzz/corpus/bundle/shadows.ndgi");
    let bundle = Bundle::open(&path).unwrap();
    for hour in [3.0, 12.1, 18.05] {
        let output = decode(&[path.to_str().unwrap(), &hour.to_string()]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        let found: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap()).collect();
        let tile = bundle.at(hour).unwrap().tile(Place { page: 0, column: 0, row: 0 }).unwrap();
        let (width, height) = (tile.width(), tile.height());
        let middle = tile.sample(width as f32 / 2.0, height as f32 / 2.0);
        let mut texels = vec![[0.0; 3]; width * height];
        tile.decode_into(&mut texels);
        let mean =
            |c: usize| texels.iter().map(|texel| f64::from(texel[c])).sum::<f64>() / texels.len() as f64;
        let expected =
            [width as f64, height as f64].into_iter().chain(middle.map(f64::from)).chain([0, 1, 2].map(mean));
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() <= 1e-5 * expected.abs(), "{hour} h: {text}");
        }
        assert_eq!(found.len(), 8);
    }

    let broken = folder.path().join("broken.ndgi");
    std::fs::write(&broken, &std::fs::read(&path).unwrap()[..5000]).unwrap();
    for (arguments, expected) in [
        ([broken.to_str().unwrap(), "12"], "its header says"),
        (["nowhere.ndgi", "12"], "No such file"),
        ([path.to_str().unwrap(), "nan"], "expected a finite number"),
    ] {
        let output = decode(&arguments);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && error.contains(expected), "{arguments:?}: {error}");
    }
}

#[test]
fn the_page_decoder_of_the_integration_guide_is_that_of_rust() {
    let folder = tempfile::tempdir().unwrap();
    let guide = Path::new(env!("CARGO_MANIFEST_DIR")).join("../INTEGRATION.md");
    let guide = std::fs::read_to_string(guide).unwrap();
    let (_, code) = guide.split_once("```cpp\n").unwrap();
    let (code, _) = code.split_once("```").unwrap();
    let source = folder.path().join("page.cpp");
    let main = "\n#include <cstdio>\nint main(int, char **arguments)\n{\n\
        ndgi_bundle *bundle = ndgi_open(arguments[1]);\n\
        Page page = decode_page(bundle, 0, 10.0, EXPOSURE);\n\
        fwrite(page.rgba.data(), 2, page.rgba.size(), stdout);\n\
        ndgi_close(bundle);\n}\n";
    std::fs::write(&source, format!("{code}{main}")).unwrap();
    let decoder = folder.path().join("page");
    program(&["c++", "-std=c++11"], &source, &decoder);
    let path = folder.path().join("sunny.ndgi");
    std::fs::write(&path, testing::sunny_bundle()).unwrap();
    let output = run(Command::new(&decoder).arg(&path).env("LD_LIBRARY_PATH", library()));
    let bundle = Bundle::open(&path).unwrap();
    let grid = bundle.header.pages[0];
    let found: Vec<u16> =
        output.stdout.as_chunks::<2>().0.iter().map(|two| u16::from_le_bytes(*two)).collect();
    assert_eq!(found.len(), 4 * grid.width * grid.height);
    // The sun has 90 kilolux then.
    let at = bundle.at(10.0).unwrap();
    let mut largest = 0.0f32;
    for place in grid.places(0) {
        let tile = at.tile(place).unwrap();
        let mut texels = vec![[0; 4]; tile.width() * tile.height()];
        tile.decode_rgba16f(256.0, &mut texels);
        for (i, texel) in texels.iter().enumerate() {
            let (x, y) = (place.column * 126 + i % tile.width(), place.row * 126 + i / tile.width());
            assert_eq!(&found[4 * (y * grid.width + x)..][..4], texel, "{place:?} {i}");
            texel[..3].iter().for_each(|e| largest = largest.max(F16::from_bits(*e).to_f32()));
        }
    }
    // Nothing of it is cut, which as lux it would be.
    assert!((65.504 * 256.0..65504.0).contains(&largest), "{largest}");
}

#[test]
fn changed_bundles_are_errors_or_light_in_c_too() {
    let folder = tempfile::tempdir().unwrap();
    let reader = folder.path().join("mutations");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/c/mutations.c");
    program(&["cc", "-std=c99"], &source, &reader);
    let mut random = Random(31);
    let (header, payloads, bytes) = testing::bundle();
    let (sunny_header, sunny) = testing::sunny();
    let mut stream = Vec::new();
    for round in 0..2000 {
        let changed = if round % 4 == 0 {
            // The file as it is: most end at a checksum, those of the first bytes before.
            let mut changed = bytes.clone();
            let near = if round % 8 == 0 { 80 } else { changed.len() };
            changed[random.below(near)] = random.byte();
            changed
        } else {
            // Its sections, with checksums that are right.
            let (header, payloads) =
                if round % 16 == 1 { (&sunny_header, &sunny) } else { (&header, &payloads) };
            let mut payloads = payloads.clone();
            for _ in 0..1 + random.below(3) {
                let at = random.below(payloads.len());
                let Payload { maps, sun, shadows, .. } = &mut payloads[at];
                let section = [maps, sun, shadows].into_iter().nth(random.below(3)).unwrap();
                if !section.bytes.is_empty() {
                    let near =
                        if random.below(2) == 0 { section.bytes.len().min(60) } else { section.bytes.len() };
                    section.bytes[random.below(near)] = random.byte();
                }
            }
            bundle::encode(header, &payloads).unwrap()
        };
        stream.extend((changed.len() as u32).to_le_bytes());
        stream.extend(changed);
    }
    let mut child = Command::new(&reader)
        .env("LD_LIBRARY_PATH", library())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(&stream).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{:?}", output.status);
    let counts: Vec<usize> =
        String::from_utf8(output.stdout).unwrap().split_whitespace().map(|n| n.parse().unwrap()).collect();
    // Some are refused as a whole, some tile by tile, and most are light.
    assert!(counts[0] > 1400 && counts[1] > 4000 && counts[2] > 300, "{counts:?}");
}
