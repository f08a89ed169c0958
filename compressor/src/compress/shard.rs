//! Writes a shard's notes, and says what all shards have done. They write into the same work folder, where
//! the merge finds every tile.

use super::note::{Note, Shard, Stage, notes};
use super::part::Part;
use crate::clock::seconds_since_1970;
use crate::grid::Place;
use crate::lanes::Tier;
use crate::{Error, Result, printable};
use dataset::host::files::write_unsynced_with;
use dataset::observe::count;
use serde::Serialize;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

/// Seconds between two notes of a shard.
const NOTE_INTERVAL: f64 = 2.0;
/// Tiles or shards that a message names; of more it says how many.
const NAMED: usize = 4;

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
        let path = self.part.folder().join(state.note.shard.name());
        let text = serde_json::to_vec(&state.note).map_err(|error| Error::invalid(path.display(), error))?;
        self.part.written(write_unsynced_with(&path, |file| file.write_all(&text)))
    }
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
    use dataset::host::Process;
    use std::fs;

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
