//! What a power failure can take away, by the journal of `faults.c`.
//!
//! The content of a file is durable once `fsync` was called on it after it was last written, whatever its
//! name is by then; an entry of a folder (created, renamed, removed) once `fsync` was called on that folder.
//! Of all else, nothing is promised: neither that it reached the disk nor that it did not, nor in which
//! order.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// What is lost at a power failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// Nothing: the process was killed.
    Nothing,
    /// All content that was not synced, under whatever name the file has; entries reached the disk.
    Contents,
    /// Half of each such file.
    Halves,
    /// Entries that were not synced.
    Entries,
    /// All content and all entries that were not synced but the last entry: what depends on others reached
    /// the disk before them.
    AllButLast,
}

impl Loss {
    /// All of them.
    pub const ALL: [Loss; 5] = [Loss::Nothing, Loss::Contents, Loss::Halves, Loss::Entries, Loss::AllButLast];
}

/// An entry of a folder that was not synced; paths are below the root.
#[derive(Clone, Debug)]
enum Entry {
    Made(PathBuf),
    Renamed { from: PathBuf, to: PathBuf, before: Before },
    Removed { path: PathBuf, before: Before },
}

/// What stood where something else or nothing is now.
#[derive(Clone, Debug)]
enum Before {
    Nothing,
    Folder,
    File { kept: PathBuf, is_synced: bool },
}

/// What was not synced at the end of a journal.
#[derive(Debug, Default)]
pub struct Damage {
    /// How many calls of each kind there were.
    pub calls: BTreeMap<String, usize>,
    entries: Vec<Entry>,
    /// Files, and how much of them was synced.
    contents: Vec<(PathBuf, u64)>,
}

impl Damage {
    /// Reads the journal of what was done below `root`; `keep` is where the library put what was replaced.
    pub fn read(journal: &Path, root: &Path, keep: &Path) -> Self {
        let text = fs::read_to_string(journal).unwrap_or_default();
        let mut damage = Damage::default();
        // By inode: length and time when it was synced last.
        let mut written: BTreeMap<u64, Option<(u64, i128)>> = BTreeMap::new();
        for line in text.lines() {
            let words: Vec<&str> = line.split('\t').collect();
            let below = |word: usize| {
                let path = Path::new(words[word]);
                path.strip_prefix(root).unwrap_or(path).to_owned()
            };
            let number = |word: usize| words[word].parse::<i128>().expect("a number");
            let before = |word: usize| match words[word] {
                "-" => Before::Nothing,
                "folder" => Before::Folder,
                name => Before::File { kept: keep.join(name), is_synced: true },
            };
            let mut kind = words[0];
            match words[0] {
                "create" => {
                    written.insert(number(2) as u64, None);
                    damage.entries.push(Entry::Made(below(1)));
                }
                "empty" => drop(written.insert(number(2) as u64, None)),
                "write" | "truncate" => _ = written.entry(number(2) as u64).or_default(),
                "mkdir" | "link" => damage.entries.push(Entry::Made(below(1))),
                "rename" => damage.rename(below(1), below(2), before(3)),
                "unlink" | "rmdir" => {
                    damage.entries.push(Entry::Removed { path: below(1), before: before(2) });
                }
                "fsync" if words[5] == "folder" => {
                    kind = "fsync of a folder";
                    let folder = below(1);
                    damage.entries.retain(|entry| !entry.is_in(&folder));
                }
                "fsync" => drop(written.insert(number(2) as u64, Some((number(3) as u64, number(4))))),
                _ => {}
            }
            *damage.calls.entry(kind.to_owned()).or_default() += 1;
        }
        let unsynced = |path: &Path| {
            let found = fs::symlink_metadata(path).ok().filter(fs::Metadata::is_file)?;
            let time = i128::from(found.mtime()) * 1_000_000_000 + i128::from(found.mtime_nsec());
            match written.get(&found.ino())? {
                Some(synced) if *synced == (found.len(), time) => None,
                synced => Some(synced.map_or(0, |(length, _)| length.min(found.len()))),
            }
        };
        for path in super::Tree::read(root).0.into_keys() {
            if let Some(length) = unsynced(&root.join(&path)) {
                damage.contents.push((path, length));
            }
        }
        for entry in &mut damage.entries {
            if let Entry::Renamed { before, .. } | Entry::Removed { before, .. } = entry
                && let Before::File { kept, is_synced } = before
            {
                *is_synced = unsynced(kept).is_none();
            }
        }
        damage
    }

    fn rename(&mut self, from: PathBuf, to: PathBuf, before: Before) {
        // Of a folder: what is in it has other paths from here on.
        self.entries.iter_mut().for_each(|entry| entry.moved(&from, &to));
        self.entries.push(Entry::Renamed { from, to, before });
    }

    /// Whether a loss takes more away than the one before it in [`Loss::ALL`].
    pub fn is_more(&self, loss: Loss) -> bool {
        match loss {
            Loss::Nothing => true,
            Loss::Contents | Loss::Halves => !self.contents.is_empty(),
            Loss::Entries => !self.entries.is_empty(),
            Loss::AllButLast => self.entries.len() > 1,
        }
    }

    /// Takes away from a copy of the root what is lost.
    pub fn apply(&self, loss: Loss, root: &Path) {
        if matches!(loss, Loss::Contents | Loss::Halves | Loss::AllButLast) {
            for (path, synced) in &self.contents {
                let file = fs::File::options().write(true).open(root.join(path)).expect("writable");
                let length = file.metadata().expect("readable").len();
                let left = if loss == Loss::Halves { synced.midpoint(length) } else { *synced };
                file.set_len(left).expect("writable");
            }
        }
        if matches!(loss, Loss::Entries | Loss::AllButLast) {
            let mut entries = self.entries.clone();
            if loss == Loss::AllButLast {
                entries.pop();
            }
            while let Some(entry) = entries.pop() {
                entry.undo(root);
                if let Entry::Renamed { from, to, .. } = &entry {
                    entries.iter_mut().for_each(|earlier| earlier.moved(to, from));
                }
            }
        }
    }
}

impl Entry {
    fn is_in(&self, folder: &Path) -> bool {
        match self {
            Entry::Made(path) | Entry::Removed { path, .. } => path.parent() == Some(folder),
            Entry::Renamed { from, to, .. } => from.parent() == Some(folder) || to.parent() == Some(folder),
        }
    }

    /// Gives it other paths where it lies in a folder that was renamed.
    fn moved(&mut self, old: &Path, new: &Path) {
        let moved = |path: &mut PathBuf| {
            if let Ok(rest) = path.strip_prefix(old)
                && !rest.as_os_str().is_empty()
            {
                *path = new.join(rest);
            }
        };
        match self {
            Entry::Made(path) | Entry::Removed { path, .. } => moved(path),
            Entry::Renamed { from, to, .. } => {
                moved(from);
                moved(to);
            }
        }
    }

    fn undo(&self, root: &Path) {
        // (Something that other losses took with them is not there.)
        let fine = |path: &Path, done: std::io::Result<()>| match done {
            Err(e) if !matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                panic!("{}: {e}", path.display())
            }
            _ => {}
        };
        let restore = |path: &Path, before: &Before| match before {
            Before::Nothing => {}
            Before::Folder => fine(path, fs::create_dir(path)),
            Before::File { kept, is_synced: true } => fine(path, fs::copy(kept, path).map(drop)),
            Before::File { .. } => fine(path, fs::write(path, b"")),
        };
        match self {
            Entry::Made(path) => {
                let path = root.join(path);
                fine(&path, if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) });
            }
            Entry::Renamed { from, to, before } => {
                fine(&root.join(to), fs::rename(root.join(to), root.join(from)));
                restore(&root.join(to), before);
            }
            Entry::Removed { path, before } => restore(&root.join(path), before),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_synced_stays_and_the_rest_can_go() {
        let dir = tempfile::tempdir().unwrap();
        let (root, keep, journal) =
            (dir.path().join("root"), dir.path().join("keep"), dir.path().join("journal"));
        fs::create_dir_all(root.join("new")).unwrap();
        fs::create_dir(&keep).unwrap();
        // `a` was written, synced and renamed over an older file; `b` was written alone; `new` was a folder
        // of another name.
        fs::write(root.join("a"), b"new content").unwrap();
        fs::write(root.join("b"), b"12345678").unwrap();
        fs::write(root.join("new/c"), b"c").unwrap();
        fs::write(keep.join("1"), b"old").unwrap();
        let of = |name: &str| fs::metadata(root.join(name)).unwrap();
        let time = of("a").mtime() * 1_000_000_000 + of("a").mtime_nsec();
        let place = |name: &str| root.join(name).display().to_string();
        let lines = |is_synced: bool| {
            let mut lines = vec![
                format!("create\t{}\t{}", place(".a.tmp"), of("a").ino()),
                format!("fsync\t{}\t{}\t11\t{time}\tfile", place(".a.tmp"), of("a").ino()),
                format!("rename\t{}\t{}\t1", place(".a.tmp"), place("a")),
                format!("mkdir\t{}", place("old")),
                format!("create\t{}\t{}", place("old/c"), of("new/c").ino()),
                format!("rename\t{}\t{}\t-", place("old"), place("new")),
                format!("create\t{}\t{}", place("b"), of("b").ino()),
            ];
            if is_synced {
                lines.push(format!("fsync\t{}\t1\t0\t0\tfolder", root.display()));
            }
            fs::write(&journal, lines.join("\n")).unwrap();
            Damage::read(&journal, &root, &keep)
        };
        let after = |damage: &Damage, loss: Loss| {
            let copy = dir.path().join("copy");
            let _ = fs::remove_dir_all(&copy);
            super::super::copy(&root, &copy);
            damage.apply(loss, &copy);
            let files = super::super::Tree::read(&copy).0.into_iter();
            let files =
                files.filter_map(|(path, content)| Some((path, String::from_utf8(content?).unwrap())));
            files.map(|(path, content)| format!("{} {content}", path.display())).collect::<Vec<_>>()
        };
        let damage = lines(false);
        assert_eq!(damage.calls["create"], 3);
        assert_eq!(after(&damage, Loss::Nothing), ["a new content", "b 12345678", "new/c c"]);
        assert_eq!(after(&damage, Loss::Contents), ["a new content", "b ", "new/c "]);
        assert_eq!(after(&damage, Loss::Halves), ["a new content", "b 1234", "new/c "]);
        assert_eq!(after(&damage, Loss::Entries), ["a old"]);
        assert_eq!(after(&damage, Loss::AllButLast), ["a old", "b "]);
        let synced = lines(true);
        assert_eq!(after(&synced, Loss::Entries), ["a new content", "b 12345678"]);
        assert!(!synced.is_more(Loss::AllButLast) && synced.is_more(Loss::Contents));
    }
}
