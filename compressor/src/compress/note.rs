//! One machine's share of a bundle's tiles, for schedulers that run the same command on many machines, and
//! the note of its progress for others.

use crate::clock::seconds_since_1970;
use crate::lanes::Tier;
use crate::printable;
use dataset::host::Process;
use serde::{Deserialize, Serialize};
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Seconds of silence after which a shard may be dead: a tile of the longest training takes less.
const SILENT: u64 = 300;
const MOST: u32 = 100_000;
/// The most tiles: 64 pages of 16384².
const MOST_TILES: usize = 64 * 131 * 131;
const LONGEST: u64 = 1 << 16;

/// One of several equal shares of the work: `2/7`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    /// Which, from 1.
    pub number: u32,
    /// Of how many.
    pub of: u32,
}

impl Shard {
    /// Its share of a number of things in order: neighbours, so that it reads few rows of the pages.
    pub fn share(self, things: usize) -> Range<usize> {
        let end = |shards: u32| (things as u64 * u64::from(shards) / u64::from(self.of)) as usize;
        end(self.number - 1)..end(self.number)
    }

    /// The file of its note.
    pub(super) fn name(self) -> String {
        format!("shard-{}-of-{}.json", self.number, self.of)
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((_, of)) if of > MOST => Err(format!("expected at most {MOST} shards")),
            Some((number, of)) if (1..=of).contains(&number) => Ok(Shard { number, of }),
            Some((0, of)) if of > 0 => {
                Err(format!("shards are numbered from 1; expected 1/{of} to {of}/{of}"))
            }
            _ => Err("expected a shard's number and the number of shards, such as 2/7".to_owned()),
        }
    }
}

/// The stage of a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Reading the dataset: what there is to do is not known yet.
    Reading,
    /// Trial fits, by which bits are allocated towards a target.
    Trials,
    /// Training.
    Training,
}

/// A shard's progress, a file in the work folder. For people only: no tile depends on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Note {
    /// Which.
    pub shard: Shard,
    /// Digest of its light and options: shards of others make other tiles.
    pub recipe: String,
    /// Its stage.
    pub stage: Stage,
    /// Tiles of all shards.
    pub of_tiles: usize,
    /// Tiles of its share that are finished.
    pub done: usize,
    /// Tiles of its share that have something to train.
    pub tiles: usize,
    /// Of these, finished by an earlier run.
    pub resumed: usize,
    /// Mean PSNR of those that this run trained, by their texels.
    pub psnr_db: Option<f64>,
    /// Their texels.
    pub texels: usize,
    /// Seconds that this run has taken.
    pub seconds: f64,
    /// Its process.
    pub process: Process,
    /// Its vector instructions: others train different bytes.
    pub instructions: String,
    /// Digest of its program: tiles of another build are retrained.
    pub program: String,
    /// Why it ended, if no retry helps.
    pub error: Option<String>,
    /// Time of the note, in seconds since 1970 by its machine's clock.
    pub at: u64,
}

impl Note {
    /// Of this process.
    pub(super) fn new(shard: Shard, recipe: &str) -> Self {
        Note {
            shard,
            recipe: recipe.to_owned(),
            stage: Stage::Reading,
            of_tiles: 0,
            done: 0,
            tiles: 0,
            resumed: 0,
            psnr_db: None,
            texels: 0,
            seconds: 0.0,
            process: Process::this().clone(),
            instructions: format!("{:?}", Tier::detect()),
            program: super::program().to_owned(),
            error: None,
            at: seconds_since_1970(),
        }
    }

    /// The note in a file, if its numbers agree.
    fn read(path: &Path) -> Option<Self> {
        // (A pipe would be waited for.)
        let metadata = fs::metadata(path).ok()?;
        if !metadata.is_file() || metadata.len() > LONGEST {
            return None;
        }
        let note: Note = serde_json::from_slice(&fs::read(path).ok()?).ok()?;
        let Note { shard: Shard { number, of }, resumed, done, tiles, of_tiles, .. } = note;
        let is_named = path.file_name().is_some_and(|name| name == note.shard.name().as_str());
        let agrees = number >= 1 && number <= of && of <= MOST && resumed <= done && done <= tiles;
        (is_named && agrees && tiles <= of_tiles && of_tiles <= MOST_TILES && note.seconds >= 0.0)
            .then_some(note)
    }

    /// Its machine's name.
    pub(super) fn host(&self) -> String {
        printable(&self.process.host)
    }

    /// True if its stage is finished.
    pub fn is_finished(&self) -> bool {
        self.stage != Stage::Reading && self.done == self.tiles && self.error.is_none()
    }

    /// Seconds since its last note, if it is not finished and they are too many.
    pub fn silent_for(&self, now: u64) -> Option<u64> {
        let silence = now.saturating_sub(self.at);
        (!self.is_finished() && (silence > SILENT || self.process.is_gone())).then_some(silence)
    }
}

/// The notes of the shards in a folder, by number: of the same recipe and number of shards as the latest
/// note, or as the latest of a recipe.
pub(super) fn notes(folder: &Path, recipe: Option<&str>) -> Vec<Note> {
    let mut notes: Vec<Note> = files(folder).filter_map(|path| Note::read(&path)).collect();
    notes.retain(|note| recipe.is_none_or(|recipe| note.recipe == recipe));
    let Some(latest) = notes.iter().max_by_key(|note| note.at).cloned() else { return notes };
    notes.retain(|note| note.shard.of == latest.shard.of && note.recipe == latest.recipe);
    notes.sort_by_key(|note| note.shard.number);
    notes
}

/// Whether a file is the note of a shard with this recipe, or none that can be read.
pub(super) fn is_of(path: &Path, recipe: &str) -> bool {
    Note::read(path).is_none_or(|note| note.recipe == recipe)
}

/// The files of all notes in a folder.
pub(super) fn files(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.filter(|path| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.starts_with("shard-") && name.ends_with(".json")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_neighbours_and_together_all() {
        for things in [0, 1, 5, 64, 1000] {
            for of in [1, 3, 7, 100] {
                let shares: Vec<_> = (1..=of).map(|number| Shard { number, of }.share(things)).collect();
                let all: Vec<usize> = shares.iter().cloned().flatten().collect();
                assert_eq!(all, (0..things).collect::<Vec<_>>());
                let lengths = || shares.iter().map(|share| share.len());
                assert!(lengths().max().unwrap() - lengths().min().unwrap() <= 1);
            }
        }
    }

    #[test]
    fn shards_are_numbered_from_one() {
        assert_eq!("2/7".parse(), Ok(Shard { number: 2, of: 7 }));
        assert!("0/7".parse::<Shard>().unwrap_err().contains("from 1"));
        assert!("1/100001".parse::<Shard>().unwrap_err().contains("100000"));
        for wrong in ["8/7", "2", "2/", "/7", "-1/7", "a/b", "0/0", "1/0", "2 / 7", "1/2/3"] {
            assert!(wrong.parse::<Shard>().unwrap_err().contains("expected"), "{wrong}");
        }
    }
}
