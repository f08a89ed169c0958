//! One machine's share of a bundle's tiles, for schedulers that run the same command on many machines: its
//! tiles, and a note of its progress for others. Shards write into the same work folder, where the merge
//! finds every tile.

use super::part::Part;
use crate::clock::seconds_since_1970;
use crate::grid::Place;
use crate::lanes::Tier;
use crate::{Error, Result, printable};
use dataset::files::write_unsynced_with;
use dataset::observe::count;
use dataset::process::Process;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Mutex;
use std::time::Instant;

/// Seconds of silence after which a shard may be dead: a tile of the longest training takes less.
const SILENT: u64 = 300;
/// Seconds between two notes of a shard.
const NOTE_INTERVAL: f64 = 2.0;
const MOST: u32 = 100_000;
/// The most tiles: 64 pages of 16384².
const MOST_TILES: usize = 64 * 131 * 131;
const LONGEST: u64 = 1 << 16;
/// Tiles or shards that a message names; of more it says how many.
const NAMED: usize = 4;

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
    fn name(self) -> String {
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
    fn new(shard: Shard, recipe: &str) -> Self {
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

    fn write(&self, part: &Part) -> Result<()> {
        let path = part.folder().join(self.shard.name());
        let text = serde_json::to_vec(self).map_err(|error| Error::invalid(path.display(), error))?;
        part.written(write_unsynced_with(&path, |file| file.write_all(&text)))
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
    fn host(&self) -> String {
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

/// Writes a shard's note as tiles are finished.
pub(super) struct Notes<'a> {
    part: &'a Part,
    start: Instant,
    state: Mutex<State>,
}

struct State {
    note: Note,
    /// Seconds at the last note.
    last: f64,
}

impl<'a> Notes<'a> {
    /// Writes the first note, before anything is read: it replaces that of an earlier attempt.
    pub(super) fn start(part: &'a Part, shard: Shard, recipe: &str) -> Result<Self> {
        let note = Note::new(shard, recipe);
        let state = Mutex::new(State { note, last: f64::NEG_INFINITY });
        let notes = Notes { part, start: Instant::now(), state };
        notes.write(|_| ())?;
        Ok(notes)
    }

    /// The work is known: its stage, its tiles and all, and how many of its own are finished already.
    pub(super) fn begin(&self, stage: Stage, [tiles, of_tiles]: [usize; 2], resumed: usize) -> Result<()> {
        self.write(|state| {
            let note = state.note.clone();
            state.note = Note { stage, done: resumed, tiles, of_tiles, resumed, ..note };
            state.last = f64::NEG_INFINITY;
        })
    }

    /// Counts a finished tile of `texels` texels, with its PSNR if it was trained.
    pub(super) fn finished(&self, texels: usize, psnr_db: Option<f64>) -> Result<()> {
        self.write(|state| {
            let note = &mut state.note;
            note.done += 1;
            if let Some(db) = psnr_db {
                let before = note.psnr_db.unwrap_or(0.0) * note.texels as f64;
                note.texels += texels;
                note.psnr_db = Some((before + texels as f64 * db) / note.texels.max(1) as f64);
            }
        })
    }

    /// Notes why the shard ended, where that is no use to try again: the merge says it then.
    pub(super) fn failed(&self, error: &Error) {
        if error.exit_code() == 1 {
            // (What cannot be noted is in the shard's own output.)
            let _ = self.write(|state| {
                state.note.error = Some(error.to_string());
                state.last = f64::NEG_INFINITY;
            });
        }
    }

    /// The last note.
    pub(super) fn last(self) -> Note {
        self.state.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()).note
    }

    /// The note, if the last is long enough ago or this one is the last.
    fn write(&self, change: impl FnOnce(&mut State)) -> Result<()> {
        let mut state = self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        change(&mut state);
        let seconds = self.start.elapsed().as_secs_f64();
        if !state.note.is_finished() && seconds - state.last < NOTE_INTERVAL {
            return Ok(());
        }
        state.last = seconds;
        (state.note.seconds, state.note.at) = (seconds, seconds_since_1970());
        state.note.write(self.part)
    }
}

/// The notes of the shards in a folder, by number: of the same recipe and number of shards as the latest
/// note, or as the latest of a recipe.
fn notes(folder: &Path, recipe: Option<&str>) -> Vec<Note> {
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

/// What a merge needs of every tile: first, towards a target, and last.
pub(super) const TRIED: &str = "trial fits";
pub(super) const TRAINED: &str = "trained tiles";

/// The error that names missing tiles and says what to do.
pub(super) fn missing(folder: &Path, recipe: &str, what: &str, missing: &[Place], tiles: usize) -> Error {
    let mut names: Vec<String> = missing
        .iter()
        .take(NAMED)
        .map(|Place { page, column, row }| format!("page {page} ({column}, {row})"))
        .collect();
    if missing.len() > NAMED {
        names.push(format!("{} more", missing.len() - NAMED));
    }
    let mut text =
        format!("{what} of {} of {} are missing: {}", missing.len(), count(tiles, "tile"), names.join(", "));
    let are_others = || !notes(folder, None).is_empty();
    let notes = notes(folder, Some(recipe));
    // (Another build may succeed.)
    let failed = notes.iter().filter(|note| note.program == super::program());
    if let Some((note, error)) = failed.into_iter().find_map(|note| Some((note, note.error.as_ref()?))) {
        let what = format!("shard {} on {} failed: {}", note.shard, note.host(), printable(error));
        return Error::invalid(folder.display(), format!("{what}; run it again once that is fixed"));
    }
    let unlike = notes.iter().find(|note| {
        note.program != super::program() || note.instructions != format!("{:?}", Tier::detect())
    });
    if let Some(note) = unlike {
        let what = match note.program == super::program() {
            true => format!(
                "uses {} instructions, but this process {:?}; give all of them the same --instructions",
                printable(&note.instructions),
                Tier::detect()
            ),
            false => "is of another build of this program; run the same build everywhere".to_owned(),
        };
        text += &format!("; shard {} (on {}) {what}", note.shard, note.host());
    } else {
        let is_done =
            |stage| !notes.is_empty() && notes.iter().all(|note| note.stage == stage && note.is_finished());
        text += match what {
            _ if notes.is_empty() && are_others() => {
                "; the shards that have started had other options, another seed or another dataset"
            }
            _ if notes.is_empty() => "; no shard has started: look at the tasks' own output",
            TRAINED if is_done(Stage::Trials) => {
                "; what each tile stores is chosen now: run the shards again"
            }
            _ => "; run the shards again with the same options, then this command",
        };
    }
    let ill = ill(&notes, seconds_since_1970());
    if !ill.is_empty() {
        text += &format!(" (unfinished: {})", ill.join(", "));
    }
    Error::unready(folder.display(), text)
}

/// Unfinished shards, and those that have not started, as text.
fn ill(notes: &[Note], now: u64) -> Vec<String> {
    let of = notes.first().map_or(0, |note| note.shard.of);
    let reported = |number: u32| match notes.iter().find(|note| note.shard.number == number) {
        None => format!("{number}/{of} not started"),
        Some(note) => match (&note.error, note.silent_for(now)) {
            (Some(error), _) => format!("{} on {} failed: {}", note.shard, note.host(), printable(error)),
            (None, Some(silence)) => {
                format!("{} on {} not heard from for {}", note.shard, note.host(), minutes(silence))
            }
            (None, None) if note.stage == Stage::Reading => {
                format!("{} on {} reading", note.shard, note.host())
            }
            (None, None) => format!("{} on {} at {} of {}", note.shard, note.host(), note.done, note.tiles),
        },
    };
    let finished: BTreeSet<u32> =
        notes.iter().filter(|note| note.is_finished()).map(|note| note.shard.number).collect();
    let mut named: Vec<String> =
        (1..=of).filter(|number| !finished.contains(number)).take(NAMED).map(reported).collect();
    let more = (of as usize - finished.len()).saturating_sub(NAMED);
    if more > 0 {
        named.push(format!("{more} more"));
    }
    named
}

/// A time in seconds, as text.
pub(super) fn minutes(seconds: u64) -> String {
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{} min", seconds / 60),
        _ => format!("{} h", seconds / 3600),
    }
}

/// Progress of all shards.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Status {
    /// Their stage: trial fits until all shards have finished them.
    pub stage: Stage,
    /// Tiles that are finished at that stage, and all.
    pub done: usize,
    /// All tiles.
    pub tiles: usize,
    /// Mean PSNR so far.
    pub psnr_db: Option<f64>,
    /// Seconds until the slowest shard finishes at the present pace.
    pub seconds_left: Option<f64>,
    /// Every shard that has reported.
    pub shards: Vec<Note>,
    /// The number of shards.
    pub of: u32,
}

/// Progress of the shards of the bundle at `out`; `None` if there are none.
pub fn status(out: &Path) -> Option<Status> {
    let shards = notes(&super::beside(out, ".part"), None);
    let of = shards.first()?.shard.of;
    let is_any = |stage: &Stage| shards.iter().any(|note| note.stage == *stage);
    let stages = [Stage::Trials, Stage::Training];
    let stage = stages.into_iter().find(is_any).unwrap_or(Stage::Reading);
    // (A shard that trains has finished its trial fits.)
    let done = |note: &Note| if note.stage == stage { note.done } else { note.tiles };
    let left = shards
        .iter()
        .filter(|note| !note.is_finished() && note.done > note.resumed)
        .map(|note| note.seconds * (note.tiles - note.done) as f64 / (note.done - note.resumed) as f64);
    let db = || shards.iter().filter_map(|note| Some((note.psnr_db?, note.texels)));
    Some(Status {
        stage,
        done: shards.iter().map(done).sum(),
        tiles: shards.iter().map(|note| note.of_tiles).max().unwrap_or(0),
        psnr_db: crate::mean::weighted_mean(db()),
        seconds_left: left.max_by(f64::total_cmp),
        of,
        shards,
    })
}

impl Status {
    /// The progress in one line.
    pub fn line(&self) -> String {
        let stage = match self.stage {
            Stage::Reading => "reading",
            Stage::Trials => "trial fits",
            Stage::Training => "training",
        };
        let finished = self.shards.iter().filter(|note| note.is_finished()).count();
        let of_none = if finished == self.of as usize { 100 } else { 0 };
        let percent = (100 * self.done).checked_div(self.tiles).unwrap_or(of_none);
        let mut line = format!(
            "{stage}: {} of {} ({percent} %); {finished} of {} finished",
            self.done,
            count(self.tiles, "tile"),
            count(self.of as usize, "shard")
        );
        let ill = ill(&self.shards, seconds_since_1970());
        if !ill.is_empty() {
            line += &format!(" ({})", ill.join(", "));
        }
        self.psnr_db.iter().for_each(|db| line += &format!("; {db:.1} dB"));
        self.seconds_left
            .iter()
            .for_each(|left| line += &format!("; about {} remaining", minutes(*left as u64)));
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(number: u32, done: usize, at: u64) -> Note {
        Note {
            done,
            tiles: 10,
            of_tiles: 30,
            psnr_db: Some(30.0),
            seconds: 20.0,
            process: Process {
                host: "node".to_owned(),
                machine: "other".to_owned(),
                ..Process::this().clone()
            },
            error: None,
            at,
            texels: 100,
            stage: Stage::Training,
            ..Note::new(Shard { number, of: 3 }, "this")
        }
    }

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

    #[test]
    fn a_status_names_the_silent_and_the_late() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a.ndgi");
        assert_eq!(status(&out), None);
        let part = super::super::beside(&out, ".part");
        fs::create_dir(&part).unwrap();
        let now = seconds_since_1970();
        // The third did not start; a note of an earlier run with fewer shards does not count.
        let old = Note { shard: Shard { number: 2, of: 2 }, ..note(2, 0, now - 9000) };
        for note in [note(1, 10, now - 5000), note(2, 5, now - 900), old] {
            fs::write(part.join(note.shard.name()), serde_json::to_vec(&note).unwrap()).unwrap();
        }
        fs::write(part.join("shard-3-of-3.json"), b"torn").unwrap();
        // Nor does one of other options, nor one whose numbers do not agree.
        for (name, wrong) in [
            ("4-of-3", Note { shard: Shard { number: 4, of: 3 }, ..note(3, 5, now) }),
            ("3-of-9", Note { recipe: "other".to_owned(), ..note(3, 5, now - 8000) }),
            ("a", Note { done: 11, at: now + 9, ..note(3, 11, now) }),
            ("1-of-3-copy", note(1, 10, now + 5)),
            ("3-of-3", Note { of_tiles: usize::MAX, tiles: usize::MAX, at: now + 9, ..note(3, 5, now) }),
            ("b", Note { shard: Shard { number: 1, of: u32::MAX }, ..note(3, 5, now) }),
        ] {
            fs::write(part.join(format!("shard-{name}.json")), serde_json::to_vec(&wrong).unwrap()).unwrap();
        }
        let status = status(&out).unwrap();
        let line = status.line();
        assert_eq!((status.done, status.tiles, status.shards.len(), status.of), (15, 30, 2, 3));
        assert!(line.starts_with("training: 15 of 30 tiles (50 %); 1 of 3 shards finished ("), "{line}");
        assert!(line.contains("2/3 on node not heard from for 15 min, 3/3 not started"), "{line}");
        assert!(line.ends_with("; 30.0 dB; about 20 s remaining"), "{line}");
    }
}
