//! Small bundles of every kind: those that lie in the repository, of all versions, and random ones of all
//! contents.

use ndgi::testing;
use std::path::Path;

/// All bundles, by name.
pub fn all() -> Vec<(String, Vec<u8>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut bundles = Vec::new();
    for entry in std::fs::read_dir(root.join("fuzz/corpus/bundle")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "ndgi") {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            bundles.push((name, std::fs::read(path).unwrap()));
        }
    }
    bundles.sort();
    assert!(bundles.len() >= 4, "{}", bundles.len());
    bundles.push(("pages".to_owned(), testing::bundle().2));
    bundles.push(("sunny".to_owned(), testing::sunny_bundle()));
    bundles.push(("switching".to_owned(), testing::switching_bundle()));
    bundles.extend([16, 32, 64].map(|hidden| (format!("contents-{hidden}"), testing::all_contents(hidden))));
    bundles
}
