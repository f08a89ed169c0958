//! Who may use whom. Between packages Cargo's manifests say it, inside the baker the order of its folders.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The packages that one links, by its manifest alone.
fn links(manifest: &str) -> Vec<String> {
    let text = fs::read_to_string(root().join(manifest).join("Cargo.toml")).unwrap();
    let (_, dependencies) = text.split_once("[dependencies]\n").unwrap_or_default();
    let dependencies = dependencies.split("\n[").next().unwrap();
    let lines = dependencies.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines.map(|line| line.split(['.', ' ']).next().unwrap().to_owned()).collect()
}

#[test]
fn packages_link_only_what_they_may() {
    // `baker → dataset ← compressor`; the decoder, `ndgi`, serves all. Terminal, typed arguments and reports
    // are the commands'. (The dataset verifies the bundles of releases with `ndgi`.)
    let terminal = ["clap", "indicatif", "plotters", "reports"];
    let cases: [(&str, &[&str]); 5] = [
        ("baker", &["compressor", "commands", "reports", "indicatif", "plotters"]),
        ("compressor", &["baker", "commands", "clap", "indicatif", "plotters"]),
        ("dataset", &[&["baker", "compressor", "commands"], &terminal[..]].concat()),
        ("dataset/commands/reports", &["baker", "compressor", "commands", "clap", "indicatif"]),
        ("compressor/ndgi", &["baker", "compressor", "dataset", "commands"]),
    ];
    for (package, forbidden) in cases {
        let links = links(package);
        let found: Vec<&String> = links.iter().filter(|name| forbidden.contains(&name.as_str())).collect();
        assert!(found.is_empty(), "{package} links {found:?}");
    }
    // The search can find what it looks for.
    for (package, name) in [
        ("baker/command", "compressor"),
        ("compressor/command", "commands"),
        ("compressor", "reports"),
        ("dataset/commands", "indicatif"),
        ("dataset/commands/reports", "plotters"),
        ("baker", "dataset"),
    ] {
        assert!(links(package).iter().any(|link| link == name), "{package}: {name}");
    }
}

/// The modules that a `mod.rs` declares, in its order.
fn declared(door: &str) -> Vec<String> {
    let lines = door.lines().filter_map(|line| {
        let line = line.strip_prefix("pub(super) ").or(line.strip_prefix("pub(crate) ")).unwrap_or(line);
        line.strip_prefix("pub ").unwrap_or(line).strip_prefix("mod ")?.strip_suffix(';')
    });
    lines.map(str::to_owned).filter(|name| name != "tests").collect()
}

/// Every file below a folder, with its code: comments and tests left out.
fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && !path.ends_with("tests") {
            found.extend(sources(&path));
        } else if path.to_str().is_some_and(|p| p.ends_with(".rs") && !p.ends_with("tests.rs")) {
            let text = fs::read_to_string(&path).unwrap();
            // (Tests of a file stand at its end, and use what they like.)
            let text = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
            let code = text.lines().map(|line| line.split("//").next().unwrap_or_default());
            found.push((path, code.collect::<Vec<_>>().join("\n")));
        }
    }
    found
}

/// The words that follow a prefix in code.
fn after<'a>(code: &'a str, prefix: &str) -> Vec<&'a str> {
    let ends = |rest: &str| rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
    code.match_indices(prefix)
        .map(|(at, _)| &code[at + prefix.len()..][..ends(&code[at + prefix.len()..])])
        .collect()
}

/// Of each module in `folder` the others it uses: by `use`s of `path` from anywhere in it, and by `super::`
/// where that is the folder.
fn uses(folder: &Path, path: &str, modules: &[String]) -> BTreeMap<String, BTreeSet<String>> {
    let mut uses: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (file, code) in sources(folder) {
        let below = file.strip_prefix(folder).unwrap();
        let first = below.components().next().unwrap().as_os_str().to_str().unwrap();
        let owner = first.trim_end_matches(".rs");
        let depth = below.components().count();
        let Some(owner) = modules.iter().filter(|m| owner.starts_with(m.as_str())).max_by_key(|m| m.len())
        else {
            continue;
        };
        // (Groups of modules would hide from the search.)
        assert!(path == "crate::" || !code.contains(&format!("{path}{{")), "{}: {path}{{", file.display());
        let mut words = after(&code, path);
        if depth == 1 && first != "mod.rs" || depth == 2 && below.ends_with("mod.rs") {
            words.extend(after(&code, "use super::"));
        }
        let words = words.into_iter().filter(|word| modules.iter().any(|m| m == word) && word != owner);
        uses.entry(owner.clone()).or_default().extend(words.map(str::to_owned));
    }
    uses
}

/// The length of the longest chain of uses; a use of what is declared below is an error.
#[track_caller]
fn levels(folder: &Path, door: &str, path: &str) -> usize {
    let modules = declared(&fs::read_to_string(folder.join(door)).unwrap());
    assert!(!modules.is_empty(), "{}", folder.display());
    let uses = uses(folder, path, &modules);
    let mut levels: BTreeMap<&str, usize> = BTreeMap::new();
    for module in &modules {
        let used = uses.get(module).into_iter().flatten();
        let below: Vec<&String> = used.clone().filter(|name| !levels.contains_key(name.as_str())).collect();
        assert!(below.is_empty(), "{}: {module} uses {below:?}, declared below it", folder.display());
        let level = 1 + used.map(|name| levels[name.as_str()]).max().unwrap_or(0);
        levels.insert(module, level);
    }
    levels.into_values().max().unwrap()
}

#[test]
fn rooms_use_only_the_rooms_above_them() {
    for (folder, door, path) in [
        ("baker/src", "lib.rs", "crate::"),
        ("baker/src/light", "mod.rs", "crate::light::"),
        ("baker/src/trace", "mod.rs", "crate::trace::"),
        ("baker/src/bake", "mod.rs", "crate::bake::"),
        ("compressor/src/train", "mod.rs", "crate::train::"),
        ("dataset/src", "lib.rs", "crate::"),
    ] {
        let folder = root().join(folder);
        let found = levels(&folder, door, path);
        // A bake needs nine levels of rooms. (Seventeen were those of one flat folder.) That the search sees
        // the chains that there are, it shows, too: as a whole it stands on all that it stores.
        if path == "crate::bake::" {
            assert!((5..=9).contains(&found), "{found} levels");
        }
        for room in declared(&fs::read_to_string(folder.join(door)).unwrap()) {
            // (Folders of older rooms without an order of their own: `store` of datasets and the like.)
            let has_door = folder.join(&room).join("mod.rs").exists();
            if has_door && path != "crate::" || ["host", "format", "pictures"].contains(&room.as_str()) {
                levels(&folder.join(&room), "mod.rs", &format!("{path}{room}::"));
            }
        }
    }
}

#[test]
fn a_use_against_the_order_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let levels = || levels(folder.path(), "mod.rs", "crate::hall::");
    write("mod.rs", "mod first;\npub(super) mod second;\n");
    write("first.rs", "// use crate::hall::second::Thing;\n");
    write("second.rs", "use super::first::Thing;\n");
    assert_eq!(levels(), 2);
    for against in ["use crate::hall::second::Thing;\n", "use super::second::Thing;\n"] {
        write("first.rs", against);
        assert!(std::panic::catch_unwind(levels).is_err(), "{against}");
    }
}
