//! What is in a folder, and how it differs from what should be.

use std::collections::BTreeMap;
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

/// The files of a folder by their paths in it; folders have no content.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tree(pub BTreeMap<PathBuf, Option<Vec<u8>>>);

impl Tree {
    /// Reads a folder; one that is not there is empty.
    pub fn read(root: &Path) -> Self {
        let mut tree = Tree::default();
        tree.add(root, Path::new(""));
        tree
    }

    fn add(&mut self, root: &Path, below: &Path) {
        for entry in fs::read_dir(root.join(below)).into_iter().flatten() {
            let entry = entry.expect("readable");
            let path = below.join(entry.file_name());
            if entry.file_type().expect("readable").is_dir() {
                self.0.insert(path.clone(), None);
                self.add(root, &path);
            } else {
                self.0.insert(path.clone(), Some(fs::read(entry.path()).expect("readable")));
            }
        }
    }

    /// A number by which equal states are found: those that differ in the writers of temporaries alone are
    /// equal, and of files whose content `is_same` does not promise, only how they end counts.
    pub fn key(&self, is_same: fn(&Path) -> bool) -> u64 {
        let mut lines: Vec<(String, Option<Vec<u8>>)> = Vec::new();
        for (path, content) in &self.0 {
            let plain: PathBuf =
                path.components().map(|part| plain(&part.as_os_str().to_string_lossy())).collect();
            let content = content.as_ref().map(|content| match is_same(&plain) {
                true => content.clone(),
                false => content.last().copied().into_iter().collect(),
            });
            let anyones = |part: std::path::Component| {
                part.as_os_str().to_string_lossy().split(".tmp-").next().unwrap_or_default().to_owned() + "/"
            };
            lines.push((path.components().map(anyones).collect(), content));
        }
        lines.sort();
        let mut hasher = DefaultHasher::new();
        lines.hash(&mut hasher);
        hasher.finish()
    }
}

/// The name of the file that a temporary is to be.
fn plain(name: &str) -> String {
    let temporary = name.strip_prefix('.').and_then(|name| name.split_once(".tmp-"));
    temporary.map_or(name, |(name, _)| name).to_owned()
}

/// How a folder differs from what is expected, a line each. The content of files for which `is_told_apart`
/// does not hold is not compared.
pub fn differences(found: &Tree, expected: &Tree, is_told_apart: impl Fn(&Path) -> bool) -> Vec<String> {
    // (Of a folder that is missing, its own path tells enough.)
    let is_there = |path: &Path| path.as_os_str().is_empty() || found.0.contains_key(path);
    let missing = expected.0.keys().filter(|path| !is_there(path) && path.parent().is_none_or(is_there));
    let missing = missing.map(|path| format!("{} is missing", path.display()));
    let other = found.0.iter().filter_map(|(path, content)| match expected.0.get(path) {
        None => Some(format!("{} should not be there", path.display())),
        Some(expected) if expected != content && is_told_apart(path) => {
            let length = |of: &Option<Vec<u8>>| of.as_ref().map_or(0, Vec::len);
            Some(format!(
                "{}: other content, {} bytes, not {}",
                path.display(),
                length(content),
                length(expected)
            ))
        }
        Some(_) => None,
    });
    missing.chain(other).collect()
}

/// Copies a folder to a new one.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("writable");
    for entry in fs::read_dir(from).expect("readable") {
        let entry = entry.expect("readable");
        match entry.file_type().expect("readable").is_dir() {
            true => copy(&entry.path(), &to.join(entry.file_name())),
            false => drop(fs::copy(entry.path(), to.join(entry.file_name())).expect("writable")),
        }
    }
}
