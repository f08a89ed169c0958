//! Who may use whom: between packages as Cargo knows it, inside them by the order of modules.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// What each package of the workspace links, tests apart.
fn links() -> BTreeMap<String, Vec<String>> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["metadata", "--no-deps", "--offline", "--format-version", "1"]).current_dir(root());
    let output = cargo.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    let links = |package: &serde_json::Value| {
        let dependencies = package["dependencies"].as_array().unwrap().iter();
        let linked = dependencies.filter(|dependency| dependency["kind"] != "dev").map(|d| text(&d["name"]));
        (text(&package["name"]), linked.collect())
    };
    metadata["packages"].as_array().unwrap().iter().map(links).collect()
}

#[test]
fn packages_link_only_what_they_may() {
    let links = links();
    // Of the workspace, all that each package may link; the decoder, `ndgi`, serves all.
    let allowed: [(&str, &[&str]); 10] = [
        ("ndgi", &[]),
        ("ndgi-gpu", &["ndgi"]),
        ("ndgi-stream", &["ndgi", "ndgi-gpu"]),
        ("dataset", &["ndgi"]),
        ("reports", &["dataset"]),
        ("commands", &["dataset"]),
        ("baker", &["dataset", "ndgi"]),
        ("compressor", &["dataset", "ndgi", "reports"]),
        ("bake", &["baker", "commands", "compressor", "dataset", "reports"]),
        ("compress", &["commands", "compressor", "dataset", "reports"]),
    ];
    for (package, allowed) in allowed {
        let own: Vec<&String> = links[package].iter().filter(|name| links.contains_key(*name)).collect();
        assert_eq!(own, allowed, "{package}");
    }
    // The terminal is the commands', plots are the reports'. (The baker has its options' texts from clap.)
    for (library, users) in [
        ("indicatif", &["commands"][..]),
        ("plotters", &["reports"]),
        ("clap", &["bake", "baker", "commands", "compress"]),
    ] {
        let found = links.iter().filter(|(_, linked)| linked.iter().any(|name| name == library));
        assert_eq!(found.map(|(package, _)| package).collect::<Vec<_>>(), users, "{library}");
    }
}

/// A file of a crate that is no test.
struct Source {
    file: PathBuf,
    /// Its module, from the crate's root: `["bake", "store"]`.
    module: Vec<String>,
    /// Comments and tests left out.
    code: String,
}

/// The files of a crate, `folder` being that of `lib.rs`.
fn sources(folder: &Path) -> Vec<Source> {
    let mut found = Vec::new();
    let mut left = vec![folder.to_owned()];
    while let Some(path) = left.pop() {
        if path.is_dir() {
            left.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
            continue;
        }
        let below = path.strip_prefix(folder).unwrap().with_extension("");
        let mut module: Vec<String> = below.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
        let is_code = path.extension().is_some_and(|e| e == "rs") && module[0] != "bin";
        if !is_code || module.iter().any(|part| part.ends_with("tests") || part == "testing") {
            continue;
        }
        module.retain(|part| part != "mod" && part != "lib");
        let text = fs::read_to_string(&path).unwrap();
        // (Tests within a file stand at its end.)
        let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
        found.push(Source { code: lines.collect::<Vec<_>>().join("\n"), module, file: path.clone() });
    }
    found
}

/// The modules that a file declares, in its order.
fn declared(code: &str) -> Vec<String> {
    let lines = code.lines().filter_map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        let name = match words[..] {
            ["mod", name] | [_, "mod", name] => name,
            _ => return None,
        };
        let is_top = line.starts_with("mod ") || line.starts_with("pub");
        name.strip_suffix(';').filter(|_| is_top).map(str::to_owned)
    });
    lines.filter(|name| !name.ends_with("tests")).collect()
}

/// Reads a tree of paths such as `a::{b, c::d}` from the beginning of a text; all its paths, each behind
/// `before`. What is no path ends it.
fn paths(text: &str, before: &[String], found: &mut Vec<Vec<String>>) -> usize {
    let mut path = before.to_vec();
    let mut at = 0;
    loop {
        let rest = &text[at..];
        if let Some(group) = rest.strip_prefix('{') {
            let mut inside = at + 1;
            let mut left = group;
            loop {
                let blank = left.len() - left.trim_start_matches([' ', '\n', ',']).len();
                (left, inside) = (&left[blank..], inside + blank);
                if left.is_empty() || left.starts_with('}') {
                    return inside + 1;
                }
                let read = paths(left, &path, found);
                // (Past `as` and a name, too.)
                let next = left[read..].find([',', '}']).map_or(left.len(), |next| read + next);
                (left, inside) = (&left[next..], inside + next);
            }
        }
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        if end == 0 {
            break;
        }
        match &rest[..end] {
            "super" if path.last().is_none_or(|last| last == "super") => path.push("super".to_owned()),
            "self" => {}
            name => path.push(name.to_owned()),
        }
        at += end;
        match text[at..].strip_prefix("::") {
            Some(_) => at += 2,
            None => break,
        }
    }
    found.push(path);
    at
}

/// What a file uses of its own crate, as paths from the crate's root.
fn uses(source: &Source) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let code = &source.code;
    let mut matches: Vec<(usize, &str)> =
        ["crate::", "super::"].iter().flat_map(|prefix| code.match_indices(prefix)).collect();
    matches.sort_unstable();
    let mut read = 0;
    for (at, prefix) in matches {
        let before = code[..at].chars().next_back();
        if at < read || before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        let mut these = Vec::new();
        let start = at + prefix.len();
        read = start + paths(&code[start..], &[], &mut these);
        for path in these {
            let supers = path.iter().take_while(|part| *part == "super").count();
            let depth = source.module.len().saturating_sub(1 + supers);
            let above = if prefix == "crate::" { &[][..] } else { &source.module[..depth] };
            found.push(above.iter().chain(&path[supers..]).cloned().collect());
        }
    }
    found
}

/// A use of what is declared below: which file, and what.
struct Against {
    file: PathBuf,
    path: String,
}

/// Every use against the order of modules, in a crate; and of every file with modules the length of its
/// longest chain of them, by the module's path.
fn order(folder: &Path) -> (Vec<Against>, BTreeMap<String, usize>) {
    let sources = sources(folder);
    assert!(!sources.is_empty(), "{}", folder.display());
    let of_files: Vec<(&Source, Vec<Vec<String>>)> = sources.iter().map(|s| (s, uses(s))).collect();
    let (mut against, mut chains) = (Vec::new(), BTreeMap::new());
    for parent in &sources {
        let modules = declared(&parent.code);
        let below = parent.module.len();
        let place = |path: &[String]| {
            let name = path.get(below).filter(|_| path.starts_with(&parent.module))?;
            modules.iter().position(|module| module == name)
        };
        let mut used = vec![Vec::new(); modules.len()];
        for (source, uses) in &of_files {
            let Some(own) = place(&source.module) else { continue };
            for path in uses {
                match place(path) {
                    Some(other) if other > own => {
                        against.push(Against { file: source.file.clone(), path: path.join("::") });
                    }
                    Some(other) if other < own => used[own].push(other),
                    _ => {}
                }
            }
        }
        let mut levels: Vec<usize> = Vec::new();
        for used in &used {
            levels.push(1 + used.iter().map(|&other| levels[other]).max().unwrap_or(0));
        }
        chains.insert(parent.module.join("::"), levels.into_iter().max().unwrap_or(0));
    }
    (against, chains)
}

#[test]
fn modules_use_only_those_declared_above_them() {
    for package in [
        "baker",
        "compressor",
        "compressor/ndgi",
        "compressor/gpu",
        "compressor/stream",
        "dataset",
        "dataset/commands",
        "dataset/commands/reports",
    ] {
        let (against, chains) = order(&root().join(package).join("src"));
        let told = against.iter().map(|use_| format!("{}: {}", use_.file.display(), use_.path));
        let told: Vec<String> = told.collect();
        assert!(told.is_empty(), "{package}: {told:#?}");
        // A bake needs nine levels of folders. (Seventeen were those of one flat folder.) That the search
        // sees the chains that there are, it shows, too: as a whole it stands on all that it stores.
        if package == "baker" {
            assert!((5..=9).contains(&chains["bake"]), "{} levels", chains["bake"]);
        }
    }
}

#[test]
fn a_use_against_the_order_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        fs::create_dir_all(folder.path().join("hall")).unwrap();
        fs::write(folder.path().join(name), text).unwrap();
    };
    write("lib.rs", "mod hall;\npub mod yard;\n");
    write("yard.rs", "use crate::{hall::{first::Thing as Other, second}, Error};\n");
    write("hall/mod.rs", "#[cfg(test)]\nmod tests;\n\nmod first;\npub(super) mod second;\n\nfn own() {}\n");
    write("hall/first.rs", "// use crate::hall::second::Thing;\n");
    write("hall/second.rs", "use super::first::Thing;\n");
    let (against, chains) = order(folder.path());
    assert!(against.is_empty(), "{}", against[0].path);
    assert_eq!((chains[""], chains["hall"]), (2, 2));
    for (file, text) in [
        ("hall/first.rs", "use crate::hall::second::Thing;\n"),
        ("hall/first.rs", "use super::second::Thing;\n"),
        ("hall/first.rs", "pub use super::{super::Error, second::{A, B}};\n"),
        ("hall/first.rs", "use crate::{Error, hall::second};\n"),
        ("hall/first.rs", "fn own() {\n    super::second::go();\n}\n"),
        ("hall/first.rs", "use super::super::yard::Thing;\n"),
        (
            "hall/mod.rs",
            "#[cfg(test)]\nmod tests;\nmod first;\nmod second;\nfn own() { crate::yard::go() }\n",
        ),
        ("hall/first.rs", "use crate::{\n    Error,\n    yard::Thing,\n};\n"),
    ] {
        let before = fs::read_to_string(folder.path().join(file)).unwrap();
        write(file, text);
        assert!(!order(folder.path()).0.is_empty(), "{text}");
        write(file, &before);
    }
}
