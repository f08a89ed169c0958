//! The C header: its example is compiled, linked and run, on a good bundle, a broken one and none.

use ndgi::Bundle;
use ndgi::grid::Place;
use std::path::Path;
use std::process::{Command, Output};

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn the_example_in_c_decodes_what_rust_decodes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("capi");
    run(Command::new(env!("CARGO"))
        .args(["rustc", "--offline", "--lib", "--features", "capi", "--crate-type", "cdylib"])
        .current_dir(root)
        .env("CARGO_TARGET_DIR", &target));
    let program = folder.path().join("decode");
    let library = target.join("debug");
    run(Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(root.join("include"))
        .arg(root.join("examples/decode.c"))
        .arg("-L")
        .arg(&library)
        .args(["-lndgi", "-o"])
        .arg(&program));
    let decode = |arguments: &[&str]| {
        Command::new(&program).args(arguments).env("LD_LIBRARY_PATH", &library).output().unwrap()
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
