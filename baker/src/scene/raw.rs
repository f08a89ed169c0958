//! The scene file as typed: TOML values that know their line, read key by key with the type and range each
//! must have.

use dataset::{Error, Result};
use glam::DVec3;
use std::fmt::Display;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The text of a scene file and the name it has in messages.
pub(super) struct Source<'a> {
    /// Path as the user gave it.
    pub file: String,
    /// Its whole text.
    pub text: &'a str,
}

impl Source<'_> {
    /// `file:line` of a byte offset.
    fn source_line(&self, offset: usize) -> String {
        let upto = &self.text.as_bytes()[..offset.min(self.text.len())];
        format!("{}:{}", self.file, 1 + upto.iter().filter(|&&b| b == b'\n').count())
    }

    /// What stands at a span, on one line and not too long.
    fn excerpt(&self, span: std::ops::Range<usize>) -> String {
        let text = self.text.get(span).unwrap_or("…");
        let mut line = text.split_whitespace().collect::<Vec<_>>().join(" ");
        if line.chars().count() > 60 {
            line = line.chars().take(59).chain(['…']).collect();
        }
        line
    }
}

/// Parses the text and calls `read` with the root table, whose keys must be among `keys`.
pub(super) fn parse<T>(
    source: &Source,
    keys: &'static [&'static str],
    read: impl FnOnce(Table) -> Result<T>,
) -> Result<T> {
    let root = DeTable::parse(source.text).map_err(|e| {
        let source_line = source.source_line(e.span().map_or(0, |s| s.start));
        let quotes = ["date", "time", "float"].iter().any(|kind| e.message().contains(kind));
        let number = e.span().and_then(|span| number_hint(source.text, span.start));
        let quoted = if quotes { " (dates and times of day stand in quotes)" } else { "" };
        let date = e.span().and_then(|span| date_hint(source.text, span.start));
        let hint = date.or(number).unwrap_or_else(|| quoted.to_owned());
        Error::invalid(source_line, format!("not TOML: {}{hint}", e.message()))
    })?;
    read(Table::new(source, "the scene file", 0, root.get_ref(), keys)?)
}

/// How to write a date; `offset` is where reading failed.
fn date_hint(text: &str, offset: usize) -> Option<String> {
    let (key, _) = line_at(text, offset)?.split_once('=')?;
    (key.trim() == "date").then(|| " (a date is written YYYY-MM-DD: 2026-06-21)".to_owned())
}

/// The line of an offset.
fn line_at(text: &str, offset: usize) -> Option<&str> {
    let (before, after) = text.split_at_checked(offset)?;
    let line = before.rsplit('\n').next().unwrap_or("").len();
    Some(&text[offset - line..offset + after.find('\n').unwrap_or(after.len())])
}

/// What to write in place of a number that TOML does not take, such as `0,05` or `2700K`; `offset` is where
/// reading failed.
fn number_hint(text: &str, offset: usize) -> Option<String> {
    let line = line_at(text, offset)?.split('#').next()?;
    let value = line.split_once('=')?.1.trim();
    let number = value.trim_end_matches(|c: char| !c.is_ascii_digit());
    let point = number.replacen(',', ".", 1);
    if point.parse::<f64>().is_err() {
        return None;
    }
    let how = match (point == *number, number == value) {
        (true, true) => return None,
        (true, false) => "a number stands without its unit",
        (false, true) => "a number has a decimal point, not a comma",
        (false, false) => "a number has a decimal point, not a comma, and stands without its unit",
    };
    Some(format!(" ({how}: {point})"))
}

/// Where a key that is unknown here is meant to stand.
fn hint(key: &str) -> String {
    match key {
        "sphere" | "disc" | "point" | "spot" | "rectangle" => {
            format!(" (a lamp belongs to a group: [[group.{key}]])")
        }
        "part" => format!(" (of an object: [[object.{key}]])"),
        _ => String::new(),
    }
}

/// A table all of whose keys are known.
#[derive(Clone)]
pub(super) struct Table<'a> {
    source: &'a Source<'a>,
    name: String,
    offset: usize,
    table: &'a DeTable<'a>,
}

impl<'a> Table<'a> {
    fn new(
        source: &'a Source<'a>,
        name: impl Display,
        offset: usize,
        table: &'a DeTable<'a>,
        keys: &[&str],
    ) -> Result<Self> {
        for (key, value) in table {
            if !keys.contains(&key.get_ref().as_ref()) {
                let source_line = source.source_line(key.span().start);
                let shown = match value.get_ref() {
                    DeValue::Table(_) => String::new(),
                    _ => format!(" = {}", source.excerpt(value.span())),
                };
                return Err(Error::invalid(
                    source_line,
                    format!(
                        "{}{shown}: unknown key in {name}: expected one of {}{}",
                        key.get_ref(),
                        keys.join(", "),
                        hint(key.get_ref())
                    ),
                ));
            }
        }
        Ok(Self { source, name: name.to_string(), offset, table })
    }

    /// `file:line` of its heading.
    pub(super) fn source_line(&self) -> String {
        self.source.source_line(self.offset)
    }

    /// An error about the table as a whole.
    pub(super) fn error(&self, what: impl Display) -> Error {
        Error::invalid(self.source_line(), format!("{}: {what}", self.name))
    }

    /// The value of an optional key.
    pub(super) fn get(&self, key: &str) -> Option<Value<'a>> {
        let value = self.table.get(key)?;
        Some(Value { source: self.source, key: key.to_owned(), value })
    }

    /// The value of a key that must be there.
    pub(super) fn require(&self, key: &str, expected: &str) -> Result<Value<'a>> {
        self.get(key).ok_or_else(|| self.error(format!("`{key}` is missing: expected {expected}")))
    }

    /// A table under a key, or `None`.
    pub(super) fn table(&self, key: &str, keys: &[&str]) -> Result<Option<Table<'a>>> {
        self.get(key).map(|v| v.table(format!("[{key}]"), keys)).transpose()
    }

    /// The tables `[[key]]`, none if the key is absent.
    pub(super) fn tables(&self, key: &str, keys: &[&str]) -> Result<Vec<Table<'a>>> {
        let Some(value) = self.get(key) else { return Ok(Vec::new()) };
        let heading = match self.name.strip_prefix("[[").and_then(|name| name.strip_suffix("]]")) {
            Some(outer) => format!("[[{outer}.{key}]]"),
            None => format!("[[{key}]]"),
        };
        value
            .array(&format!("a list of tables, each under a heading {heading}"))?
            .into_iter()
            .map(|v| v.table(heading.clone(), keys))
            .collect()
    }
}

/// A value with its key and line.
#[derive(Clone)]
pub(super) struct Value<'a> {
    source: &'a Source<'a>,
    key: String,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Value<'a> {
    /// `file:line`.
    pub(super) fn source_line(&self) -> String {
        self.source.source_line(self.value.span().start)
    }

    /// `key = value`, as typed.
    pub(super) fn shown(&self) -> String {
        format!("{} = {}", self.key, self.source.excerpt(self.value.span()))
    }

    /// `file:line: key = value: what`.
    pub(super) fn error(&self, what: impl Display) -> Error {
        Error::invalid(self.source_line(), format!("{}: {what}", self.shown()))
    }

    fn expected(&self, expected: &str) -> Error {
        self.error(format!("expected {expected}"))
    }

    /// A finite number that passes `test`.
    pub(super) fn number(&self, expected: &str, test: impl Fn(f64) -> bool) -> Result<f64> {
        let number = match self.value.get_ref() {
            DeValue::Float(f) => f.as_str().parse::<f64>().ok(),
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
            _ => None,
        };
        number.filter(|x| x.is_finite() && test(*x)).ok_or_else(|| self.expected(expected))
    }

    /// An integer that passes `test`.
    pub(super) fn integer(&self, expected: &str, test: impl Fn(i64) -> bool) -> Result<i64> {
        let integer = match self.value.get_ref() {
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok(),
            _ => None,
        };
        integer.filter(|&i| test(i)).ok_or_else(|| self.expected(expected))
    }

    /// `true` or `false`.
    pub(super) fn boolean(&self) -> Result<bool> {
        self.value.get_ref().as_bool().ok_or_else(|| self.expected("true or false"))
    }

    /// A string; a TOML date or time gives its text.
    pub(super) fn text(&self, expected: &str) -> Result<&'a str> {
        match self.value.get_ref() {
            DeValue::String(s) => Ok(s.as_ref()),
            DeValue::Datetime(_) => Ok(self.source.text.get(self.value.span()).unwrap_or("")),
            _ => Err(self.expected(expected)),
        }
    }

    /// The elements of an array, named `key[i]`.
    pub(super) fn array(&self, expected: &str) -> Result<Vec<Value<'a>>> {
        let array = self.value.get_ref().as_array().ok_or_else(|| self.expected(expected))?;
        let element = |(i, value)| Value { source: self.source, key: format!("{}[{i}]", self.key), value };
        Ok(array.iter().enumerate().map(element).collect())
    }

    /// Three finite numbers each of which passes `test`.
    pub(super) fn vector(&self, expected: &str, test: impl Fn(f64) -> bool) -> Result<DVec3> {
        let elements = self.array(expected)?;
        let [x, y, z] = &elements[..] else { return Err(self.expected(expected)) };
        // The whole vector stands in the message, not the element.
        let component = |v: &Value| v.number(expected, &test).map_err(|_| self.expected(expected));
        Ok(DVec3::new(component(x)?, component(y)?, component(z)?))
    }

    /// Three finite numbers, or one that stands for all three; each passes `test`.
    pub(super) fn vector_or_number(&self, expected: &str, test: impl Fn(f64) -> bool) -> Result<DVec3> {
        match self.value.get_ref() {
            DeValue::Array(_) => self.vector(expected, test),
            _ => Ok(DVec3::splat(self.number(expected, test)?)),
        }
    }

    /// Whether it is an array.
    pub(super) fn is_array(&self) -> bool {
        self.value.get_ref().is_array()
    }

    /// Whether it is a string.
    pub(super) fn is_text(&self) -> bool {
        self.value.get_ref().is_str()
    }

    /// A table called `name` in messages.
    pub(super) fn table(&self, name: String, keys: &[&str]) -> Result<Table<'a>> {
        let table = self.value.get_ref().as_table().ok_or_else(|| self.expected("a table"))?;
        Table::new(self.source, name, self.value.span().start, table, keys)
    }
}
