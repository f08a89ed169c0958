//! Layouts in which other tools keep lightmaps as raw files: what a configuration speaks of, and what it is
//! to say.
//!
//! Each is a module with its [`Layout`], and has an entry in [`LAYOUTS`]. [`crate::exchange`] reads and
//! writes the files.

pub mod hprc1;
pub mod hprc2;
mod id;

pub use id::Id;

use crate::image::MAX_SIDE;
use crate::observe::count;
use crate::{Error, Result};
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeSet;
use std::fmt::{self, Debug};
use std::path::{Path, PathBuf};

/// All layouts.
pub const LAYOUTS: &[&dyn Layout] = &[&hprc1::Hprc1, &hprc2::Hprc2];

/// What manifests call one EXR file per time and page, which has no configuration.
pub const EXR: &str = "exr";

/// Bytes of a texel of light: three float32, little-endian.
pub(crate) const LIGHT_BYTES: usize = 12;

/// A layout of raw files with a configuration, `config.json`.
pub trait Layout: Debug + Sync {
    /// As in the manifest and on the command line.
    fn name(&self) -> &'static str;

    /// What it consists of, for the command line.
    fn about(&self) -> &'static str;

    /// The folders of the shares of sun, sky and lamps; none if it cannot store them.
    fn shares(&self) -> &'static [&'static str] {
        &[]
    }

    /// The hours that it stores, in words.
    fn hours(&self) -> &'static str;

    /// Whether it stores an hour.
    fn takes(&self, hour: f64) -> bool;

    /// Why it cannot store a dataset of these hours, if it needs others.
    fn refuses(&self, _hours: &[f64]) -> Option<String> {
        None
    }

    /// Why it cannot tell lightmaps apart, if it cannot.
    fn confuses(&self, _lightmaps: &[Lightmap]) -> Option<String> {
        None
    }

    /// When its lamps are on, if frames at these hours show their switches.
    fn lamps_on(&self, _hours: &[f64]) -> Option<[f64; 2]> {
        None
    }

    /// The lightmaps that a configuration speaks of, one after another; `place` names it in errors.
    ///
    /// # Errors
    /// For what is no configuration of this layout.
    fn parse<'a>(&self, place: &'a Path, config: &[u8]) -> Result<Lightmaps<'a>>;

    /// The configuration of lightmaps that are to be written at hours that the layout takes.
    fn compose(&self, scene: &str, lightmaps: &[Lightmap], hours: &[f64]) -> Vec<u8>;
}

/// Lightmaps with their files, or what is wrong with the next.
pub type Lightmaps<'a> = Box<dyn Iterator<Item = Result<Planned>> + 'a>;

/// A lightmap as a layout describes it. Id and level together are unique in the dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct Lightmap {
    /// What it is called in its level.
    pub id: Id,
    /// Its level, if the layout has it.
    pub level: Option<String>,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
}

impl fmt::Display for Lightmap {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match &self.level {
            None => write!(out, "lightmap {}", self.id),
            Some(level) => write!(out, "lightmap {} of {level}", self.id),
        }
    }
}

/// Files from the top of a lightmap on, of equal size, relative to the layout's folder.
pub type Parts = Vec<PathBuf>;

/// A lightmap with its files.
#[derive(Clone, Debug)]
pub struct Planned {
    /// The lightmap.
    pub lightmap: Lightmap,
    /// By ascending hour.
    pub frames: Vec<PlannedFrame>,
    /// At least one; all are to agree.
    pub masks: Vec<Parts>,
}

impl Planned {
    /// Its hours, ascending.
    pub fn hours(&self) -> Vec<f64> {
        self.frames.iter().map(|planned_frame| planned_frame.hour).collect()
    }
}

/// A lightmap's files of one time.
#[derive(Clone, Debug)]
pub struct PlannedFrame {
    /// The time, in hours.
    pub hour: f64,
    /// All of its light.
    pub whole: Parts,
    /// The shares of sun, sky and lamps, in layouts that have them.
    pub shares: Option<[Parts; 3]>,
}

/// The layout of a name.
pub fn named(name: &str) -> Option<&'static dyn Layout> {
    LAYOUTS.iter().copied().find(|layout| layout.name() == name)
}

/// Reads the name of a layout or of EXR files in a manifest.
pub(crate) fn read_name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    let known: Vec<&str> = LAYOUTS.iter().map(|layout| layout.name()).chain([EXR]).collect();
    match known.contains(&&*name) {
        true => Ok(name),
        false => {
            let expected = known.join("`, `");
            Err(D::Error::custom(format!("unknown variant `{name}`, expected one of `{expected}`")))
        }
    }
}

/// The lightmaps of a layout as [`Layout::parse`] gives them, checked. What a configuration claims may be far
/// more than exists, so `each` must check the files before the next lightmap is planned.
pub(crate) fn plan(
    layout: &dyn Layout,
    place: &Path,
    config: &[u8],
    mut each: impl FnMut(Planned) -> Result<()>,
) -> Result<()> {
    let wrong = |what: String| Err(Error::invalid(place.display(), what));
    let mut known = BTreeSet::new();
    let mut first: Option<(Lightmap, Vec<f64>)> = None;
    for planned in layout.parse(place, config)? {
        let planned = planned?;
        let this = &planned.lightmap;
        if !known.insert((this.level.clone(), this.id.to_string())) {
            let what = if this.level.is_some() { "pairs of level and id" } else { "ids" };
            return wrong(format!("{this} occurs twice; expected distinct {what}"));
        }
        let side = 1..=MAX_SIDE as u32;
        let Lightmap { width, height, .. } = *this;
        if !side.contains(&width) || !side.contains(&height) {
            return wrong(format!("{this}: resolution {width}×{height}; expected 1 to {MAX_SIDE}"));
        }
        let (first, hours) = first.get_or_insert_with(|| (this.clone(), planned.hours()));
        let own = planned.hours();
        let lacks = |a: &[f64], b: &[f64]| b.iter().copied().find(|hour| !a.contains(hour));
        if let Some(hour) = lacks(&own, hours) {
            return wrong(format!("{this} lacks {hour} h, which {first} has"));
        }
        if let Some(hour) = lacks(hours, &own) {
            return wrong(format!("{first} lacks {hour} h, which {this} has"));
        }
        each(planned)?;
    }
    Ok(())
}

/// Hours as they stand in messages.
pub(crate) fn list(hours: &[f64]) -> String {
    hours.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

/// A configuration as layouts write it; an entry describes a lightmap.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Config<Entry> {
    lightmap_count: u64,
    lightmap_list: Vec<Entry>,
}

impl<Entry> Config<Entry> {
    /// The entries of a configuration: as many as it says, and not none.
    fn read(place: &Path, bytes: &[u8]) -> Result<Vec<Entry>>
    where
        Entry: DeserializeOwned,
    {
        let Config::<Entry> { lightmap_count, lightmap_list } =
            serde_json::from_slice(bytes).map_err(Error::json(place))?;
        if lightmap_count == lightmap_list.len() as u64 && lightmap_count > 0 {
            return Ok(lightmap_list);
        }
        let found = count(lightmap_list.len(), "lightmap");
        let what = format!(
            "lightmap_count is {lightmap_count}, but lightmap_list has {found} entries; expected equal numbers ≥ 1"
        );
        Err(Error::invalid(place.display(), what))
    }

    /// The configuration of these entries.
    fn write(lightmap_list: Vec<Entry>) -> Vec<u8>
    where
        Entry: Serialize,
    {
        let config = Config { lightmap_count: lightmap_list.len() as u64, lightmap_list };
        let mut json = serde_json::to_vec_pretty(&config).expect("plain values are JSON");
        json.push(b'\n');
        json
    }
}

/// A size as layouts write it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Resolution {
    width: u32,
    height: u32,
}

impl Resolution {
    fn of(lightmap: &Lightmap) -> Self {
        Resolution { width: lightmap.width, height: lightmap.height }
    }
}
