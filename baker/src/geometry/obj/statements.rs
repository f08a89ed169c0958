//! The statements of an OBJ or MTL file: lines, joined where `\` ends them.

use crate::text::lines;
use dataset::{Error, Result};
use std::path::{Path, PathBuf};

/// Characters of a statement that an error quotes.
const MOST_QUOTED: usize = 80;

/// A keyword and what follows it.
#[derive(Clone, Copy)]
pub(super) struct Statement<'a> {
    /// Where it begins, from 1 on.
    pub line: usize,
    /// The first word; empty on a blank line.
    pub keyword: &'a str,
    /// What follows, with a comment where there is one.
    pub rest: &'a str,
}

impl Statement<'_> {
    /// Its words up to a comment.
    pub(super) fn words(&self) -> impl Iterator<Item = &str> {
        words(self.rest)
    }

    /// An error that quotes it.
    pub(super) fn error(&self, file: &str, expected: impl std::fmt::Display) -> Error {
        Error::invalid(
            format!("{file}:{}", self.line),
            format!("{}: expected {expected}", quoted(self.keyword, self.rest)),
        )
    }
}

/// Reads a text statement by statement.
pub(super) fn read(text: &str, mut read: impl FnMut(Statement) -> Result<()>) -> Result<()> {
    let mut one = |line: usize, text: &str| {
        let text = text.trim();
        let (keyword, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        read(Statement { line, keyword, rest: rest.trim() })
    };
    // The lines so far of a statement that goes on, and the first one's number.
    let mut begun: Option<(usize, String)> = None;
    for (line, text) in (1..).zip(lines(text)) {
        let text = text.trim();
        // (A comment that ends so, as with a folder of Windows, does not go on.)
        let part = text.strip_suffix('\\').filter(|_| begun.is_some() || !text.starts_with('#'));
        match (part, &mut begun) {
            (Some(part), Some((_, so_far))) => *so_far = std::mem::take(so_far) + part + " ",
            (Some(part), None) => begun = Some((line, format!("{part} "))),
            (None, Some((first, so_far))) => {
                so_far.push_str(text);
                one(*first, so_far)?;
                begun = None;
            }
            (None, None) => one(line, text)?,
        }
    }
    begun.map_or(Ok(()), |(first, so_far)| one(first, &so_far))
}

/// A statement as an error quotes it.
pub(super) fn quoted(keyword: &str, rest: &str) -> String {
    let short: String = rest.chars().take(MOST_QUOTED).collect();
    format!("`{}`", format!("{keyword} {short}").trim_end())
}

/// The words of a text up to a comment.
pub(super) fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split_whitespace().take_while(|word| !word.starts_with('#'))
}

/// A name, which may hold blanks, without quotes and comment. A digit after `#` makes it a part of the name:
/// 3ds Max calls materials `Material #25`.
pub(super) fn name(text: &str) -> &str {
    let is_comment = |(at, _): &(usize, &str)| {
        let before = text[..*at].chars().next_back();
        let after = text[at + 1..].chars().next();
        before.is_none_or(char::is_whitespace) && !after.is_some_and(|c| c.is_ascii_digit())
    };
    let end = text.match_indices('#').find(is_comment).map_or(text.len(), |(at, _)| at);
    let name = text[..end].trim();
    name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name)
}

/// A path as it is written, with either kind of slash; some write a blank as `\ `.
pub(super) fn path_of(name: &str) -> PathBuf {
    name.replace("\\ ", " ").replace('\\', "/").into()
}

/// Where a file lies that an OBJ or MTL names: by that path in one of the folders,
/// or by its name alone, since exporters write paths of the machine they ran on.
pub(super) fn find(folders: &[&Path], name: &str) -> PathBuf {
    let path = path_of(name);
    let alone = path.file_name().map(PathBuf::from);
    let places = std::iter::once(&path).chain(&alone);
    let mut places = places.flat_map(|path| folders.iter().map(move |folder| folder.join(path)));
    places.find(|place| place.is_file()).unwrap_or_else(|| folders[0].join(&path))
}

/// The bytes of a file; a device or pipe, which might never end, is none.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>> {
    let metadata = std::fs::metadata(path).map_err(Error::io(path))?;
    if !metadata.is_file() {
        let none = std::io::Error::new(std::io::ErrorKind::InvalidInput, "not a file");
        return Err(Error::io(path)(none));
    }
    std::fs::read(path).map_err(Error::io(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_end_in_a_backslash_go_on() {
        let mut seen = Vec::new();
        let text = "# C:\\maps\\\n f 1 \\\n  2\\\r\n 3 # three\n\nusemtl a b\n#\ng \\";
        read(text, |s| {
            let words = s.words().collect::<Vec<_>>().join(",");
            seen.push(format!("{} {} {words}", s.line, s.keyword));
            Ok(())
        })
        .unwrap();
        assert_eq!(seen, ["1 # C:\\maps\\", "2 f 1,2,3", "5  ", "6 usemtl a,b", "7 # ", "8 g "]);
    }

    #[test]
    fn names_end_at_comments() {
        for (text, expected) in [
            ("my bark", "my bark"),
            ("wall # plaster", "wall"),
            ("wall #plaster", "wall"),
            ("# none", ""),
            ("Material #25", "Material #25"),
            ("oak#2", "oak#2"),
            ("\"a b.png\" # c", "a b.png"),
        ] {
            assert_eq!(name(text), expected);
        }
    }
}
