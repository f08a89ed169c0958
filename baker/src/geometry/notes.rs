//! Warnings about geometry files, gathered by kind: one line each, with a count and a few names.

/// Most names that a line lists.
const MOST_NAMED: usize = 5;

/// Warnings in the order in which each kind was first met.
#[derive(Default)]
pub(super) struct Notes {
    kinds: Vec<Kind>,
}

/// Warnings that differ in a name alone.
struct Kind {
    file: String,
    noun: &'static str,
    what: String,
    /// The first few; the rest is counted.
    names: Vec<String>,
    count: usize,
}

impl Notes {
    /// Notes something about a thing in a file: `noun` (singular) and `name` say which, `what` holds for one
    /// and for many.
    pub(super) fn add(
        &mut self,
        file: &str,
        noun: &'static str,
        name: impl Into<String>,
        what: impl AsRef<str> + Into<String>,
    ) {
        let same = |k: &&mut Kind| k.file == file && k.noun == noun && k.what == what.as_ref();
        // The kinds are few; the last one is the likeliest.
        if let Some(kind) = self.kinds.iter_mut().rev().find(same) {
            kind.count += 1;
            if kind.names.len() < MOST_NAMED {
                kind.names.push(name.into());
            }
            return;
        }
        let (file, names) = (file.to_owned(), vec![name.into()]);
        self.kinds.push(Kind { file, noun, what: what.into(), names, count: 1 });
    }

    /// Notes something about a file as a whole, in a line of its own.
    pub(super) fn add_line(&mut self, file: &str, what: String) {
        let (file, names) = (file.to_owned(), Vec::new());
        self.kinds.push(Kind { file, noun: "", what, names, count: 0 });
    }

    /// One line per kind; what holds for things in several files is one line, too.
    pub(super) fn lines(&self) -> impl Iterator<Item = String> + '_ {
        // (A file's own line is alike to none but itself.)
        let alike = |a: &Kind, b: &Kind| {
            std::ptr::eq(a, b) || a.count > 0 && b.count > 0 && a.noun == b.noun && a.what == b.what
        };
        let is_first = move |i: &usize| !self.kinds[..*i].iter().any(|before| alike(before, &self.kinds[*i]));
        (0..self.kinds.len()).filter(is_first).map(move |first| {
            let of_files = self.kinds[first..].iter().filter(|kind| alike(kind, &self.kinds[first]));
            line(&of_files.collect::<Vec<_>>())
        })
    }
}

/// The line about things in one file or more, which differ in file and name alone.
fn line(kinds: &[&Kind]) -> String {
    let [first, _, ..] = kinds else { return kinds.iter().map(|kind| kind.line()).collect() };
    let (all, files) = (kinds.iter().map(|kind| kind.count).sum(), kinds.len());
    // One name of each file, so that many files are named.
    let names: Vec<String> =
        kinds.iter().take(MOST_NAMED).map(|kind| format!("{}: {}", kind.file, kind.names[0])).collect();
    format!("{} in {files} files ({}): {}", plural(all, first.noun), list(&names, all), first.what)
}

impl Kind {
    fn line(&self) -> String {
        let Kind { file, noun, what, names, .. } = self;
        match self.count {
            0 => format!("{file}: {what}"),
            1 => format!("{file}: {noun} {}: {what}", names[0]),
            n => format!("{file}: {} ({}): {what}", plural(n, noun), list(names, n)),
        }
    }
}

/// A number of things: `2 meshes`.
pub(super) fn plural(n: usize, noun: &str) -> String {
    match (n, noun.strip_suffix('y')) {
        (1, _) => format!("1 {noun}"),
        (_, Some(stem)) => format!("{n} {stem}ies"),
        _ if noun.ends_with("sh") => format!("{n} {noun}es"),
        _ => format!("{n} {noun}s"),
    }
}

/// The first few of `all` names.
pub(super) fn list<T: AsRef<str>>(names: &[T], all: usize) -> String {
    let mut shown: Vec<&str> = names.iter().take(MOST_NAMED).map(AsRef::as_ref).collect();
    if all > shown.len() {
        shown.push("…");
    }
    shown.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_of_whole_files_is_a_line_each() {
        let mut notes = Notes::default();
        ["a.glb", "b.glb"].iter().for_each(|file| notes.add_line(file, "is large".to_owned()));
        assert_eq!(notes.lines().collect::<Vec<_>>(), ["a.glb: is large", "b.glb: is large"]);
    }

    #[test]
    fn five_hundred_of_a_kind_are_one_line() {
        let mut notes = Notes::default();
        for i in 0..500 {
            notes.add("a.glb", "material", format!("m{i}"), "is odd");
        }
        notes.add("a.glb", "material", "leaf", "is green");
        notes.add("b.glb", "material", "m0", "is odd");
        let lines: Vec<String> = notes.lines().collect();
        assert_eq!(
            lines,
            ["501 materials in 2 files (a.glb: m0, b.glb: m0, …): is odd", "a.glb: material leaf: is green",]
        );
    }

    #[test]
    fn things_of_one_file_are_named_and_counted() {
        let mut notes = Notes::default();
        for i in 0..500 {
            notes.add("a.glb", "material", format!("m{i}"), "is odd");
        }
        notes.add("b.glb", "mesh", "m0", "is odd");
        let lines: Vec<String> = notes.lines().collect();
        assert_eq!(lines, ["a.glb: 500 materials (m0, m1, m2, m3, m4, …): is odd", "b.glb: mesh m0: is odd"]);
    }
}
