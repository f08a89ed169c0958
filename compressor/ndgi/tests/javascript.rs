//! The page's readers in JavaScript, run by node without a browser, against the crate. (What they do on a
//! GPU, `tests/tests/view` compares in Chromium.) Without node the tests say that they were skipped.

#![allow(clippy::unwrap_used, reason = "tests")]

use ndgi::Bundle;
use ndgi::decode::Decoder;
use ndgi::testing;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Frames; between frames; on both sides of a switch and at one; around midnight; by day and by night; on
/// other days.
const HOURS: [f64; 15] =
    [0.0, 12.0, 5.95, 5.9, 6.0, 12.3, 18.0, 18.05, 21.7, 23.9, 9.77, 4.9, 1.5, -3.0, 25.5];

fn here() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}

/// The page's scripts, then some of `tests`, in a folder.
fn script(folder: &Path, tests: &[&str]) -> PathBuf {
    let view = here().join("../view");
    let own = ["bundle.js", "tile.js", "planes.js", "sun.js"].map(|file| view.join(file));
    let files = own.into_iter().chain(tests.iter().map(|file| here().join(file)));
    let text: String = files.map(|file| std::fs::read_to_string(file).unwrap()).collect();
    let path = folder.join("script.js");
    std::fs::write(&path, text).unwrap();
    path
}

/// What node says; `None` where there is none.
fn node(script: &Path, arguments: &[String]) -> Option<Output> {
    match Command::new("node").arg(script).args(arguments).output() {
        Ok(output) => {
            print!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
            Some(output)
        }
        Err(_) => {
            eprintln!("skipped: there is no node");
            None
        }
    }
}

/// Writes a bundle and its light, page by page at every hour.
fn write(folder: &Path, name: &str, bytes: Vec<u8>) {
    std::fs::write(folder.join(format!("{name}.ndgi")), &bytes).unwrap();
    let decoder = Decoder::new(Bundle::from_bytes(bytes).unwrap());
    let mut light = Vec::new();
    for hour in HOURS {
        for page in 0..decoder.bundle().header.pages.len() {
            let image = decoder.decode_page(page, hour).unwrap();
            light.extend(image.texels.as_flattened().iter().flat_map(|e| e.to_le_bytes()));
        }
    }
    std::fs::write(folder.join(format!("{name}.ndgi.light")), light).unwrap();
}

#[test]
fn scripts_decode_as_the_crate_does() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    write(root, "pages", testing::bundle().2);
    write(root, "sunny", testing::sunny_bundle());
    write(root, "switching", testing::switching_bundle());
    write(root, "planes", testing::basis_bundle());
    for hidden in [16, 32, 64] {
        write(root, &format!("contents-{hidden}"), testing::all_contents(hidden));
    }
    std::fs::copy(here().join("src/sun/words.bin"), root.join("words.bin")).unwrap();
    let script = script(root, &["../../tests/tests/view/common.js", "tests/js/decode.js"]);
    let mut arguments = vec![root.display().to_string()];
    arguments.extend(HOURS.map(|hour| hour.to_string()));
    let Some(output) = node(&script, &arguments) else { return };
    assert!(output.status.success());
}

#[test]
fn an_older_bundle_is_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let (root, path) = (folder.path(), folder.path().join("x.ndgi"));
    let mut bytes = testing::bundle().2;
    bytes[8] = 4;
    std::fs::write(&path, bytes).unwrap();
    let script = script(root, &["tests/js/open.js"]);
    let Some(output) = node(&script, &[path.display().to_string()]) else { return };
    let told = String::from_utf8_lossy(&output.stderr);
    let expected = "bundle version 4; this page reads version 5: compress its dataset again";
    assert!(!output.status.success() && told.contains(expected), "{told}");
}

#[test]
fn changed_planes_are_refused_or_finite_light() {
    let folder = tempfile::tempdir().unwrap();
    let (root, path) = (folder.path(), folder.path().join("x.ndgi"));
    std::fs::write(&path, testing::basis_bundle()).unwrap();
    let script = script(root, &["tests/js/hostile.js"]);
    let Some(output) = node(&script, &[path.display().to_string(), "300".to_owned()]) else { return };
    assert!(output.status.success());
}
