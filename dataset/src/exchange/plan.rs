//! The files of a layout by its configuration, for import and export.

use crate::observe::count;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A lightmap as a layout describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Lightmap {
    /// Its number, unique in the dataset.
    pub id: i64,
    /// Its level, if the layout has it.
    pub level: Option<String>,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
}

/// Files from the top of a lightmap on, of equal size, relative to the layout's folder.
pub(super) type Parts = Vec<PathBuf>;

/// A lightmap with its files.
#[derive(Clone, Debug)]
pub(super) struct Planned {
    pub lightmap: Lightmap,
    /// By ascending hour.
    pub frames: Vec<PlannedFrame>,
    /// At least one; all are to agree.
    pub masks: Vec<Parts>,
}

impl Planned {
    pub fn hours(&self) -> Vec<f64> {
        self.frames.iter().map(|planned_frame| planned_frame.hour).collect()
    }
}

/// A lightmap's files of one time.
#[derive(Clone, Debug)]
pub(super) struct PlannedFrame {
    pub hour: f64,
    pub whole: Parts,
    /// The shares of sun, sky and lamps, in layouts that have them.
    pub shares: Option<[Parts; 3]>,
}

/// A size as layouts write it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Resolution {
    pub width: u32,
    pub height: u32,
}

/// An error unless the list is as long as it says, and not empty.
pub(super) fn expect_count(place: &Path, lightmap_count: u64, listed: usize) -> Result<()> {
    if listed as u64 == lightmap_count && listed > 0 {
        return Ok(());
    }
    let found = count(listed, "lightmap");
    let what = format!(
        "lightmap_count is {lightmap_count}, but lightmap_list has {found} entries; expected equal numbers ≥ 1"
    );
    Err(Error::invalid(place.display(), what))
}

/// A configuration as it is written.
pub(super) fn to_json(config: &impl Serialize) -> Vec<u8> {
    let mut json = serde_json::to_vec_pretty(config).expect("plain values are JSON");
    json.push(b'\n');
    json
}
