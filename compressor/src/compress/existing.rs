//! What lies where a bundle is to be written.

use super::info;
use super::outcome::{self, Outcome};
use crate::bundle::{self, Bundle, Header};
use crate::grid::Place;
use crate::printable;
use std::path::Path;

/// The state of the output path.
pub(super) enum Existing {
    /// An up-to-date bundle (except for bytes that depend on the instruction set) with its training record.
    Same(Box<Outcome>),
    /// The same, but these tiles are damaged.
    Damaged(Box<Outcome>, Vec<Place>),
    /// A file that only `--force` replaces, with the reason: not a bundle, one of another version or scene,
    /// or one of the same light that was trained for more steps.
    Protected(String),
    /// A bundle that is replaced, with the reason: another bake, other settings, or damage.
    Other(String),
    /// No file.
    None,
}

/// Whether a bundle was made from the same inputs with the same options, as far as its header says.
pub(super) fn is_alike(out: &Path, header: &Header) -> bool {
    Bundle::open(out).is_ok_and(|there| there.header.info == header.info)
}

/// Compares the file at `out` with the requested bundle. With a time limit no bundle is up to date.
pub(super) fn existing_bundle(out: &Path, header: &Header) -> Existing {
    if !out.exists() {
        return Existing::None;
    }
    let there = match Bundle::open(out) {
        Ok(there) => there,
        Err(_) if !bundle::begins_like_one(out) => return Existing::Protected("is not a bundle".to_owned()),
        // Of what light it is, and how long it was trained, cannot be told.
        Err(ndgi::Error::Unsupported { what, .. }) => {
            return Existing::Protected(format!("is a bundle that this program cannot read ({what})"));
        }
        Err(damage) => return Existing::Other(damage.to_string()),
    };
    if there.header.scene != header.scene {
        return Existing::Protected(format!(
            "is a bundle of scene {}, not of {}",
            printable(&there.header.scene),
            header.scene
        ));
    }
    let (old, new) = (info(&there.header), info(header));
    let is_limited = !new["time_limit_secs"].is_null();
    // (Whether there are moving shadows is known only after searching for them, at the times in the header.)
    let header = &Header { shadows: header.shadows && there.header.shadows, ..header.clone() };
    let is_same = there.header == *header && !is_limited;
    let kept = outcome::read(out).filter(|outcome| is_same && outcome.bytes == there.bytes);
    if let Some(outcome) = kept {
        let is_damaged = |place: &Place| there.verify_tile(*place).is_err();
        let damaged: Vec<Place> = there.header.places().filter(is_damaged).collect();
        return match there.verify() {
            Err(_) if !damaged.is_empty() => Existing::Damaged(Box::new(outcome), damaged),
            Err(damage) => Existing::Other(damage.to_string()),
            Ok(()) => Existing::Same(Box::new(outcome)),
        };
    }
    let differs = |key: &str| old[key] != new[key];
    // (With a time limit they are an upper bound.)
    let steps = old["iterations"].as_u64().filter(|_| old["time_limit_secs"].is_null());
    if let Some(steps) = steps.filter(|&steps| !differs("inputs") && new["iterations"].as_u64() < Some(steps))
    {
        let what = match new["iterations"].as_u64() {
            Some(requested) => format!(
                "is a bundle of the same light trained for {steps} steps, more than the {requested} requested"
            ),
            None => format!("is a bundle of the same light with neural maps, trained for {steps} steps"),
        };
        return Existing::Protected(what);
    }
    let what = match () {
        () if is_same => "its training record (.run.json) is missing or belongs to another bundle".to_owned(),
        () if differs("inputs") => "it was compressed from a different bake".to_owned(),
        () if differs("coding") => "its maps are coded in another way".to_owned(),
        () if differs("trained_on") => "it was trained on different layers".to_owned(),
        () if differs("iterations") => {
            format!("it was trained for {} steps", printable(&old["iterations"].to_string()))
        }
        () if there.header == *header => "it is of an earlier run with a time limit".to_owned(),
        () => "it was made with other settings".to_owned(),
    };
    Existing::Other(what)
}
