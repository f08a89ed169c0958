//! The dependency rule: `baker → dataset ← compressor`, and the decoder never imports the trainer.

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

#[test]
fn bakers_library_never_names_the_compressor() {
    let (binary, library): (Vec<_>, Vec<_>) =
        all_sources("baker").into_iter().partition(|f| f.ends_with("src/main.rs"));
    assert!(library.len() > 10, "found only {} sources", library.len());
    assert_eq!(naming(&library, "compressor"), Vec::<String>::new());
    // The search can find what it looks for.
    assert!(!naming(&binary, "compressor").is_empty());
}

/// The modules of the compressor's decoding half.
const DECODING: [&str; 7] = ["lanes", "model", "bc7", "time", "grid", "bundle", "decode"];

/// The names directly under a crate's root that a source file names, by `crate::…` or by `super::` chains up to the root,
/// grouped imports included; `*` or `self` for the root itself. `depth` is the file's module path's length: 1 for
/// `src/time.rs`, 2 for `src/decode/tile.rs`.
fn names_from_root(source: &str, depth: usize) -> Vec<String> {
    let code: Vec<&str> = source.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
    let code = code
        .join(" ")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace(" ::", "::")
        .replace(":: ", "::");
    let in_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut found = Vec::new();
    let paths = code.match_indices("crate::").map(|(at, _)| (at, "crate::", true));
    let chains = code.match_indices("super::").map(|(at, _)| (at, "super::", false));
    for (at, start, absolute) in paths.chain(chains) {
        let before = &code[..at];
        if before.ends_with(in_word) || before.ends_with("super::") {
            continue;
        }
        let rest = code[at..].trim_start_matches(start);
        // One level of inline modules, such as tests, may stand between the file and the chain.
        let levels = (code.len() - at - rest.len()) / start.len();
        if !absolute && levels < depth {
            continue;
        }
        let names = match rest.strip_prefix('{') {
            Some(group) => first_names(group),
            None => vec![rest],
        };
        for name in names {
            let end = name.find(|c| !in_word(c)).unwrap_or(name.len());
            match &name[..end] {
                // `super::*` in an inline module is the file itself.
                "" if name.starts_with('*') && (absolute || levels > depth) => found.push("*".to_owned()),
                "" => {}
                name => found.push(name.to_owned()),
            }
        }
    }
    found
}

/// The entries of a grouped import, whose text starts behind its opening brace.
fn first_names(group: &str) -> Vec<&str> {
    let (mut nested, mut start, mut entries) = (0, 0, Vec::new());
    for (at, c) in group.char_indices() {
        match c {
            '{' => nested += 1,
            '}' if nested > 0 => nested -= 1,
            ',' if nested == 0 => {
                entries.push(group[start..at].trim());
                start = at + 1;
            }
            '}' => {
                entries.push(group[start..at].trim());
                break;
            }
            _ => {}
        }
    }
    entries
}

#[test]
fn imports_are_found_however_they_are_written() {
    let cases: [(&str, usize, &[&str]); 10] = [
        ("use crate::train::Trainer;", 1, &["train"]),
        ("use crate::{Error, model::{self, Shape}, train};", 1, &["Error", "model", "train"]),
        ("use crate::{\n    Error, // train\n    tile::{Tile, train},\n};", 2, &["Error", "tile"]),
        ("let x = crate::train::new(crate :: clock::now());", 1, &["train", "clock"]),
        ("use super::super::train;", 2, &["train"]),
        ("use super::train;", 1, &["train"]),
        ("use super::{tile, kernel};", 2, &[]),
        ("mod tests { use super::*; }", 1, &[]),
        ("use crate::*; use crate::{self as all};", 1, &["*", "self"]),
        ("// use crate::train;\nuse supercrate::train;", 1, &[]),
    ];
    for (source, depth, names) in cases {
        assert_eq!(names_from_root(source, depth), names, "{source}");
    }
}

#[test]
fn the_decoder_never_imports_the_trainer() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join("compressor").join("src");
    let library = fs::read_to_string(root.join("lib.rs")).unwrap();
    let module = |line: &str| {
        let line = line.trim().trim_start_matches("pub ");
        Some(line.strip_prefix("mod ")?.strip_suffix(';')?.to_owned())
    };
    let modules: Vec<String> = library.lines().filter_map(module).collect();
    assert!(DECODING.iter().all(|name| modules.iter().any(|module| module == name)), "{modules:?}");
    // `testing` exists in tests only; what is no module is a type, of the seam.
    let mut forbidden: Vec<String> =
        modules.into_iter().filter(|module| !DECODING.contains(&&**module) && module != "testing").collect();
    assert!(forbidden.iter().any(|module| module == "train"), "{forbidden:?}");
    forbidden.extend(["*".to_owned(), "self".to_owned()]);

    let mut seen = [false; DECODING.len()];
    for file in all_sources("compressor") {
        let path = file.strip_prefix(&root).unwrap().with_extension("");
        let mut parts: Vec<&str> = path.iter().filter_map(|part| part.to_str()).collect();
        parts.retain(|part| *part != "mod");
        let Some(module) = DECODING.iter().position(|name| parts[0] == *name) else { continue };
        seen[module] = true;
        for name in names_from_root(&fs::read_to_string(&file).unwrap(), parts.len()) {
            assert!(!forbidden.contains(&name), "{} names crate::{name}", file.display());
        }
    }
    assert_eq!(seen, [true; DECODING.len()], "{DECODING:?}");
}
