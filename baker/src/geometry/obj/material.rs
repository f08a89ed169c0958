//! A material as its library states it.

use super::statements::{quoted, words};
use dataset::Error;
use glam::Vec3;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A material as its library defines it.
pub(super) struct Material {
    pub name: String,
    pub path: Arc<Path>,
    pub statements: BTreeMap<&'static str, Statement>,
}

/// A statement about a material.
pub(super) struct Statement {
    pub keyword: &'static str,
    /// What follows the keyword.
    pub text: String,
    pub file: Arc<str>,
    pub line: usize,
}

impl Material {
    /// The last statement with a keyword of `mtl::KEYWORDS`.
    pub(super) fn get(&self, keyword: &str) -> Option<&Statement> {
        self.statements.get(keyword)
    }

    /// The folder that its paths start from.
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }
}

impl Statement {
    /// The numbers that follow the keyword, if nothing else does.
    pub(super) fn numbers(&self) -> Option<Vec<f32>> {
        words(&self.text).map(|word| word.parse().ok()).collect()
    }

    /// Three numbers, or one that stands for three.
    pub(super) fn triple(&self) -> Option<Vec3> {
        match self.numbers()?[..] {
            [grey] => Some(Vec3::splat(grey)),
            [r, g, b] => Some(Vec3::new(r, g, b)),
            _ => None,
        }
    }

    /// An error that quotes it.
    pub(super) fn error(&self, expected: &str) -> Error {
        Error::invalid(self.place(), format!("{}: expected {expected}", quoted(self.keyword, &self.text)))
    }

    /// An error about an option that cannot be read.
    pub(super) fn unsupported(&self, option: &str) -> Error {
        let what = format!(
            "{}: the option {option} changes the texture and is not read: apply it to the picture itself, and remove it here",
            quoted(self.keyword, &self.text)
        );
        Error::unsupported(self.place(), what)
    }

    /// `file:line`.
    pub(super) fn place(&self) -> String {
        format!("{}:{}", self.file, self.line)
    }
}
