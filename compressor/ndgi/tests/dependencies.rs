//! What an engine links that decodes and does nothing else: few packages, and none of this repository.

use std::collections::BTreeSet;
use std::process::Command;

#[test]
fn ten_packages_at_most() {
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--no-default-features", "--edges", "normal,build", "--prefix", "none"])
        .args(["--format", "{p}"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
    let text = String::from_utf8(tree.stdout).unwrap();
    let packages: BTreeSet<&str> = text.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(packages.contains("ndgi") && packages.contains("blake3"), "{packages:?}");
    assert!(["baker", "compressor", "dataset"].iter().all(|ours| !packages.contains(ours)), "{packages:?}");
    assert!(packages.len() <= 10, "{} packages: {packages:?}", packages.len());
}
