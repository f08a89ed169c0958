//! The dependency rule: `baker → dataset ← compressor`; the decoder, `ndgi`, depends on none of them and
//! serves all. Terminal, typed arguments and reports are the commands'.

use std::fs;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

fn all_sources(crate_name: &str) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(crate_name).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    files.sort();
    files
}

/// Lines of code (comments aside) that contain a word.
fn naming(files: &[PathBuf], word: &str) -> Vec<String> {
    let mut found = Vec::new();
    for file in files {
        for (i, line) in fs::read_to_string(file).unwrap().lines().enumerate() {
            if line.split("//").next().is_some_and(|code| code.contains(word)) {
                found.push(format!("{}:{}: {}", file.display(), i + 1, line.trim()));
            }
        }
    }
    found
}

/// The sources of a crate's command, and those of its library.
fn command_and_library(crate_name: &str) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let of_command = |f: &PathBuf| {
        f.components().any(|part| part.as_os_str() == "bin")
            || ["baker/src/main.rs", "baker/src/report.rs"].iter().any(|own| f.ends_with(own))
    };
    let (command, library): (Vec<_>, Vec<_>) = all_sources(crate_name).into_iter().partition(of_command);
    assert!(library.len() > 10, "found only {} sources", library.len());
    (command, library)
}

#[test]
fn bakers_library_never_names_the_compressor() {
    let (command, library) = command_and_library("baker");
    assert_eq!(naming(&library, "compressor"), Vec::<String>::new());
    // The search can find what it looks for.
    assert!(!naming(&command, "compressor").is_empty());
}

#[test]
fn only_commands_use_the_terminal_and_what_commands_share() {
    for (name, word, except) in [
        ("dataset", "commands::", ""),
        ("baker", "commands::", ""),
        // `bake --compress` and `compress` write the same sections.
        ("compressor", "commands::", "commands::report"),
        ("dataset", "console::", ""),
        ("baker", "console::", ""),
        // What both commands do to compress, print and judge.
        ("compressor", "console::", "src/run.rs"),
    ] {
        let (_, library) = command_and_library(name);
        let mut found = naming(&library, word);
        found.retain(|line| except.is_empty() || !line.contains(except));
        assert_eq!(found, Vec::<String>::new(), "{name}");
    }
    // The search can find what it looks for.
    for (name, word) in [
        ("dataset", "console::"),
        ("baker", "commands::"),
        ("compressor", "commands::"),
        ("baker", "console::"),
    ] {
        assert!(!naming(&command_and_library(name).0, word).is_empty(), "{name}: {word}");
    }
}

#[test]
fn what_both_sides_share_names_neither() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let of = |manifest: &str, name: &str| {
        let text = fs::read_to_string(root.join(manifest)).unwrap();
        let (_, dependencies) = text.split_once("[dependencies]").unwrap();
        let dependencies = dependencies.split("\n[").next().unwrap();
        dependencies
            .lines()
            .any(|line| line.starts_with(&format!("{name}.")) || line.starts_with(&format!("{name} ")))
    };
    // (It verifies the bundles of releases with `ndgi`.)
    for name in ["baker", "commands", "compressor"] {
        assert!(!of("dataset/Cargo.toml", name), "dataset depends on {name}");
    }
    for name in ["baker", "compressor", "ndgi"] {
        assert!(!of("dataset/commands/Cargo.toml", name), "commands depends on {name}");
    }
    for name in ["baker", "commands", "compressor", "dataset"] {
        assert!(!of("compressor/ndgi/Cargo.toml", name), "ndgi depends on {name}");
    }
    // The search can find what it looks for.
    for (manifest, name) in
        [("baker", "ndgi"), ("baker", "dataset"), ("compressor", "dataset"), ("compressor", "ndgi")]
    {
        assert!(of(&format!("{manifest}/Cargo.toml"), name), "{manifest}: {name}");
    }
}
