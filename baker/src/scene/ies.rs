//! Photometric files of luminaires, ANSI/IES LM-63 of 1986 to 2019 with type C goniometry: candela by
//! direction.

use crate::text;
use dataset::{Error, Result};
use serde::Serializer;
use std::path::Path;

/// Most angles of either kind: half a degree apart all round, and some to spare.
const MOST_ANGLES: f64 = 2048.0;
/// Largest file in bytes.
const MOST_BYTES: u64 = 16 << 20;

/// How a luminaire shines, by direction. Type C: vertical angles from its axis (0, the nadir of a ceiling
/// lamp), horizontal ones about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Degrees, ascending, at least two.
    vertical: Vec<f64>,
    /// Degrees, ascending; the values of others follow by symmetry. One: the same all round.
    horizontal: Vec<f64>,
    /// Intensity relative to the greatest, per horizontal angle, for each vertical one; all 0 where that
    /// is 0.
    relative: Vec<f64>,
    /// The greatest intensity in candela.
    pub peak: f64,
}

/// Writes a digest of the values: what decides the light.
pub(super) fn serialize<S: Serializer>(
    profile: &Profile,
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    let mut hash = blake3::Hasher::new();
    for values in [&profile.vertical, &profile.horizontal, &profile.relative] {
        hash.update(&(values.len() as u64).to_le_bytes());
        hash.update(bytemuck::cast_slice(values));
    }
    serializer.serialize_str(hash.finalize().to_hex().as_str())
}

impl Profile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the line, [`Error::Unsupported`] for goniometry of types A and B,
    /// [`Error::Io`].
    pub fn read(path: &Path) -> Result<Self> {
        let length = std::fs::metadata(path).map_err(Error::io(path))?.len();
        if length > MOST_BYTES {
            let what = format!("{length} bytes: expected an IES file (LM-63) of at most {MOST_BYTES}");
            return Err(Error::invalid(path.display(), what));
        }
        Self::parse(&std::fs::read(path).map_err(Error::io(path))?, &path.display().to_string())
    }

    /// Parses a file's bytes; `file` is for messages.
    ///
    /// # Errors
    /// As [`Profile::read`].
    pub fn parse(bytes: &[u8], file: &str) -> Result<Self> {
        let text = text::decode(bytes);
        let has_lamp_factor = has_lamp_factor(text::lines(&text).next().unwrap_or(""));
        let mut numbers = Numbers::after_tilt(&text, file)?;
        let [_lamps, _lumens, multiplier] =
            numbers.take(["number of lamps", "lumens per lamp", "candela multiplier"])?;
        let count = |numbers: &mut Numbers, what: &'static str| {
            let n = numbers.one(what)?;
            match n.fract() == 0.0 && (1.0..=MOST_ANGLES).contains(&n) {
                true => Ok(n as usize),
                false => {
                    Err(numbers.error(format!("{n} {what}: expected an integer from 1 to {MOST_ANGLES}")))
                }
            }
        };
        let verticals = count(&mut numbers, "vertical angles")?;
        let horizontals = count(&mut numbers, "horizontal angles")?;
        let kind = numbers.one("photometric type")?;
        if kind == 2.0 || kind == 3.0 {
            let letter = if kind == 2.0 { "B" } else { "A" };
            let what = format!(
                "goniometry of type {letter} is not read: convert the file to type C (as an IES viewer or the maker's tool can)"
            );
            return Err(Error::unsupported(numbers.source_line(), what));
        }
        if kind != 1.0 {
            return Err(numbers.error(format!("photometric type {kind}: expected 1 (C)")));
        }
        numbers.take(["units", "width", "length", "height"])?;
        let [ballast, lamp, _watts] =
            numbers.take(["ballast factor", "ballast-lamp factor", "input watts"])?;
        let photometric = if has_lamp_factor { lamp } else { 1.0 };
        let factor = multiplier * ballast * photometric;
        if !(factor.is_finite() && factor >= 0.0) {
            let what = format!(
                "candela multiplier × ballast factor × ballast-lamp factor = {factor}: expected 0 or more"
            );
            return Err(numbers.error(what));
        }
        let vertical = numbers.angles(verticals, "vertical angle")?;
        if verticals < 2 || vertical[0] < 0.0 || vertical[verticals - 1] > 180.0 {
            return Err(numbers.error("expected two vertical angles or more, from 0 to 180 degrees"));
        }
        let mut horizontal = numbers.angles(horizontals, "horizontal angle")?;
        let mut candela = Vec::with_capacity(horizontals);
        for _ in 0..verticals * horizontals {
            let value = numbers.one("candela value")? * factor;
            if !(value.is_finite() && value >= 0.0) {
                return Err(numbers.error("a candela value: expected finite numbers, 0 or more"));
            }
            candela.push(value);
        }
        let (first, last) = (horizontal[0], horizontal[horizontals - 1]);
        let known = [(0.0, 90.0), (0.0, 180.0), (90.0, 270.0), (0.0, 360.0)];
        if first == 0.0 && last > 180.0 && last < 360.0 {
            // The last step, back to where it began, is left out by some.
            horizontal.push(360.0);
            candela.extend_from_within(..verticals);
        } else if horizontals > 1 && !known.contains(&(first, last)) {
            let what = format!(
                "horizontal angles from {first} to {last}: expected 0 alone, 0 to 90, 0 to 180, 90 to 270 or 0 to 360 degrees"
            );
            return Err(numbers.error(what));
        }
        let peak = candela.iter().copied().fold(0.0, f64::max);
        let relative = candela.iter().map(|c| if peak > 0.0 { c / peak } else { 0.0 }).collect();
        Ok(Self { vertical, horizontal, relative, peak })
    }

    /// Whether it shines the same all round its axis.
    pub fn is_round(&self) -> bool {
        self.horizontal.len() == 1
    }

    /// The greatest vertical angle in radians beyond which it gives no light.
    pub fn reach(&self) -> f64 {
        let n = self.vertical.len();
        let lit = |v: &usize| self.relative.iter().skip(*v).step_by(n).any(|value| *value > 0.0);
        // Between the last lit angle and the next it fades.
        let last = (0..n).rev().find(lit).map_or(0, |v| (v + 1).min(n - 1));
        self.vertical[last].to_radians()
    }

    /// Intensity relative to the greatest at a vertical and a horizontal angle in radians, linear in both.
    pub fn at(&self, vertical: f64, horizontal: f64) -> f64 {
        let Some((v, fv)) = cell(&self.vertical, vertical.to_degrees()) else { return 0.0 };
        let n = self.vertical.len();
        let column = |h: usize| {
            let low = self.relative[h * n + v];
            low + (self.relative[h * n + (v + 1).min(n - 1)] - low) * fv
        };
        if self.is_round() {
            return column(0);
        }
        let turn = horizontal.to_degrees().rem_euclid(360.0);
        let folded = match (self.horizontal[0], self.horizontal[self.horizontal.len() - 1]) {
            (90.0, _) if turn < 90.0 => 180.0 - turn,
            (90.0, _) if turn > 270.0 => 540.0 - turn,
            (90.0, _) => turn,
            (_, 90.0) => 90.0 - (turn.rem_euclid(180.0) - 90.0).abs(),
            (_, 180.0) => 180.0 - (turn - 180.0).abs(),
            _ => turn,
        };
        let Some((h, fh)) = cell(&self.horizontal, folded) else { return 0.0 };
        let low = column(h);
        low + (column((h + 1).min(self.horizontal.len() - 1)) - low) * fh
    }

    /// ∫ `at` × `falloff` of the vertical angle's cosine over all directions: lumens per candela of the
    /// greatest intensity.
    pub fn flux(&self, falloff: impl Fn(f64) -> f64) -> f64 {
        const RINGS: usize = 1440;
        let sectors = if self.is_round() { 1 } else { 360 };
        let step = std::f64::consts::PI / RINGS as f64;
        let turn = std::f64::consts::TAU / sectors as f64;
        let ring = |i: usize| {
            let theta = (i as f64 + 0.5) * step;
            let sum: f64 = (0..sectors).map(|j| self.at(theta, (j as f64 + 0.5) * turn)).sum();
            // The ring's exact solid angle.
            sum * turn * ((i as f64 * step).cos() - ((i + 1) as f64 * step).cos()) * falloff(theta.cos())
        };
        (0..RINGS).map(ring).sum()
    }
}

/// Whether the number after the ballast factor is the ballast-lamp photometric factor, by the first line: in
/// files of 1986, which have no tag, and of 1991 (`IESNA91`). In 1995 and 2002 it is of no use and should be
/// 1; in 2019 it tells how the file was made, as in 1.1: by an accredited laboratory.
fn has_lamp_factor(first_line: &str) -> bool {
    let tag = first_line.trim_start().to_ascii_uppercase();
    let year = tag.strip_prefix("IES").and_then(|tag| tag.split_once("LM-63-")).map(|(_, year)| year);
    year.is_none_or(|year| year.starts_with("1986") || year.starts_with("1991"))
}

/// What a line says about tilt, if it is one that may; labels may begin with the word, too.
fn tilt(line: &str) -> Option<&str> {
    let (word, rest) = line.trim().split_at_checked(4)?;
    let rest = rest.trim_start();
    let value = rest.strip_prefix('=').map(str::trim);
    let value = value.or_else(|| ["NONE", "INCLUDE"].into_iter().find(|v| rest.eq_ignore_ascii_case(v)));
    value.filter(|_| word.eq_ignore_ascii_case("TILT"))
}

/// The interval an angle lies in, and how far along; `None` outside.
fn cell(angles: &[f64], at: f64) -> Option<(usize, f64)> {
    // What rounding moves past an end is at the end.
    const SLACK: f64 = 1e-9;
    let (first, last) = (angles[0], angles[angles.len() - 1]);
    if !(first - SLACK..=last + SLACK).contains(&at) {
        return None;
    }
    let above = angles.partition_point(|angle| *angle <= at);
    let low = above.clamp(1, angles.len() - 1) - 1;
    Some((low, ((at - angles[low]) / (angles[low + 1] - angles[low])).clamp(0.0, 1.0)))
}

/// The numbers of a file after its TILT line, with their lines.
struct Numbers<'a> {
    file: &'a str,
    /// Words left, each with its line.
    words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    line: usize,
}

impl<'a> Numbers<'a> {
    /// Skips label and keywords, the TILT line and what it includes: luminaires hang as they were measured.
    fn after_tilt(text: &'a str, file: &'a str) -> Result<Self> {
        let separators = |c: char| c.is_whitespace() || c == ',';
        let words = move |line: &'a str| line.split(separators).filter(|word| !word.is_empty());
        let lines: Vec<(usize, &str)> =
            (1..).zip(text::lines(text)).filter(|(_, line)| !line.trim().is_empty()).collect();
        // Numbers follow the line; a label that begins as it does is followed by others.
        let is_followed = |at: &usize| {
            lines.get(at + 1).is_some_and(|(_, line)| words(line).all(|w| w.parse::<f64>().is_ok()))
        };
        let is_tilt = |at: &usize| tilt(lines[*at].1).is_some();
        let mut candidates = (0..lines.len()).filter(is_tilt);
        let first = candidates.clone().next();
        let at = candidates.find(is_followed).or(first);
        let Some((at, value)) = at.and_then(|at| Some((at, tilt(lines[at].1)?))) else {
            let what = "no line TILT=: expected an IES file (LM-63)";
            let is_eulumdat = Path::new(file).extension().is_some_and(|e| e.eq_ignore_ascii_case("ldt"));
            let hint = if is_eulumdat {
                "; EULUMDAT is not read: ask the maker for the .ies, or convert it"
            } else {
                ""
            };
            return Err(Error::invalid(file, format!("{what}{hint}")));
        };
        let line = lines[at].0;
        let all = lines.into_iter().skip(at + 1);
        let words = all.flat_map(move |(line, text)| words(text).map(move |word| (line, word)));
        let mut numbers = Numbers { file, words: Box::new(words), line };
        if value.eq_ignore_ascii_case("INCLUDE") {
            let [_geometry, pairs] = numbers.take(["lamp-to-luminaire geometry", "number of tilt angles"])?;
            if !(pairs.fract() == 0.0 && (0.0..=MOST_ANGLES).contains(&pairs)) {
                return Err(numbers
                    .error(format!("{pairs} tilt angles: expected an integer from 0 to {MOST_ANGLES}")));
            }
            for _ in 0..2 * pairs as usize {
                numbers.one("tilt angle or multiplier")?;
            }
        }
        Ok(numbers)
    }

    fn source_line(&self) -> String {
        format!("{}:{}", self.file, self.line)
    }

    fn error(&self, what: impl std::fmt::Display) -> Error {
        Error::invalid(self.source_line(), what)
    }

    fn one(&mut self, what: &'static str) -> Result<f64> {
        let Some((line, word)) = self.words.next() else {
            return Err(self.error(format!("the file ends here: expected a number ({what})")));
        };
        self.line = line;
        let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| {
            let short: String = word.chars().take(40).collect();
            self.error(format!("`{short}`: expected a finite number ({what})"))
        })
    }

    fn take<const N: usize>(&mut self, what: [&'static str; N]) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for (number, what) in numbers.iter_mut().zip(what) {
            *number = self.one(what)?;
        }
        Ok(numbers)
    }

    /// Angles in degrees, each greater than the one before.
    fn angles(&mut self, count: usize, what: &'static str) -> Result<Vec<f64>> {
        let mut angles: Vec<f64> = Vec::new();
        for _ in 0..count {
            let angle = self.one(what)?;
            if let Some(before) = angles.last().filter(|before| **before >= angle) {
                return Err(self.error(format!("{what} {angle} after {before}: expected ascending angles")));
            }
            angles.push(angle);
        }
        Ok(angles)
    }
}

#[cfg(test)]
#[path = "ies_tests.rs"]
mod tests;
