//! SHA-256 of files, and the list of them.

use crate::host::files::is_component;
use crate::host::signals::stop_if_interrupted;
use crate::observe::Meter;
use crate::{Error, Result};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// A reader that keeps the SHA-256 of what went through it.
pub(super) struct Summed<'a, R> {
    pub inner: R,
    hasher: Sha256,
    progress: &'a dyn Meter,
}

impl<'a, R: Read> Summed<'a, R> {
    pub(super) fn new(inner: R, progress: &'a dyn Meter) -> Self {
        Summed { inner, hasher: Sha256::new(), progress }
    }

    /// Reads what is left, and gives the sum of all.
    pub(super) fn finish(mut self) -> io::Result<String> {
        io::copy(&mut self, &mut io::sink())?;
        Ok(self.hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

impl<R: Read> Read for Summed<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        stop_if_interrupted().map_err(io::Error::other)?;
        let read = self.inner.read(buffer)?;
        self.hasher.update(&buffer[..read]);
        self.progress.advance(read as u64);
        Ok(read)
    }
}

/// The SHA-256 of a file, in hexadecimal.
pub(super) fn sha256(path: &Path, progress: &dyn Meter) -> Result<String> {
    let file = File::open(path).map_err(Error::io(path))?;
    let sum = Summed::new(file, progress).finish();
    stop_if_interrupted()?;
    sum.map_err(Error::io(path))
}

/// The list, by name.
pub(super) fn format(sums: &BTreeMap<String, String>) -> String {
    sums.iter().map(|(name, sum)| format!("{sum}  {name}\n")).collect()
}

/// Reads a list: plain names, each once.
pub(super) fn parse(place: &Path, text: &str) -> Result<BTreeMap<String, String>> {
    let mut sums = BTreeMap::new();
    for (number, line) in text.lines().enumerate() {
        let place = || format!("{}:{}", place.display(), number + 1);
        // A star marks files that were read as binary ones.
        let parts = line.split_once(' ').and_then(|(sum, rest)| Some((sum, rest.strip_prefix([' ', '*'])?)));
        let (sum, name) = parts
            .filter(|(sum, _)| sum.len() == 64 && sum.bytes().all(|digit| digit.is_ascii_hexdigit()))
            .ok_or_else(|| Error::invalid(place(), "expected 64 hexadecimal digits, two spaces, a name"))?;
        if !is_component(name) {
            return Err(Error::invalid(
                place(),
                format!("{name:?}; expected the name of a file in the same folder"),
            ));
        }
        if sums.insert(name.to_owned(), sum.to_ascii_lowercase()).is_some() {
            return Err(Error::invalid(place(), format!("{name:?} occurs twice")));
        }
    }
    Ok(sums)
}
