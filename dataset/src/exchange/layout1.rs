//! The layout `hprc1`: folders by light type, times 1 to 24.
//!
//! `config.json` holds `lightmap_count` and `lightmap_list` of `id`, `resolution` {`width`, `height`} and
//! `parts`. The light is in `Original/` and, where it is stored separately, in `DirectionalOnly/`,
//! `SkyLightOnly/` and `LocalOnly/`, the masks in `Mask/`. Time t is t o'clock; 24 is midnight, the hour 0 of
//! a dataset. Lightmaps are cut by height into `parts` equal files.

use super::plan::{Lightmap, Parts, Planned, PlannedFrame, Resolution, expect_count, to_json};
use crate::store::json_error;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The folder of whole lightmaps.
const WHOLE: &str = "Original";
/// The folders of sun, sky and lamps.
pub(super) const SHARES: [&str; 3] = ["DirectionalOnly", "SkyLightOnly", "LocalOnly"];
/// The folder of masks.
const MASK: &str = "Mask";
/// Most files that a lightmap is cut into.
const MAX_PARTS: u32 = 256;
/// Largest file that is written, in bytes, where the height can be divided.
const MAX_PART_BYTES: u64 = 1 << 30;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    lightmap_count: u64,
    lightmap_list: Vec<Entry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    id: i64,
    resolution: Resolution,
    parts: u32,
}

/// The hours that the layout holds, ascending.
pub(super) fn hours() -> impl Iterator<Item = f64> {
    (0..24).map(f64::from)
}

/// The time of an hour of [`hours`]: 1 to 24.
fn time(hour: f64) -> u32 {
    if hour == 0.0 { 24 } else { hour as u32 }
}

/// The files that a configuration speaks of, lightmap by lightmap.
pub(super) fn parse(place: &Path, bytes: &[u8]) -> Result<impl Iterator<Item = Result<Planned>>> {
    let config: Config = serde_json::from_slice(bytes).map_err(|error| json_error(place, &error))?;
    expect_count(place, config.lightmap_count, config.lightmap_list.len())?;
    Ok(config.lightmap_list.into_iter().map(move |entry| planned(place, &entry)))
}

fn planned(place: &Path, entry: &Entry) -> Result<Planned> {
    let Entry { id, resolution: Resolution { width, height }, parts } = *entry;
    if !(1..=MAX_PARTS).contains(&parts) || !height.is_multiple_of(parts) {
        let expected = format!("expected a divisor of the height, {height}, from 1 to {MAX_PARTS}");
        let what = format!("lightmap {id}: {parts} parts; {expected}");
        return Err(Error::invalid(place.display(), what));
    }
    let files = |folder: &str, kind: &str, time: u32| -> Parts {
        let name = |part: u32| {
            format!("{kind}_Dilate_VirtualTexture0_{id}_HQ_{width}_{height}_{time}.00.bin_{part}")
        };
        (0..parts).map(|part| PathBuf::from(folder).join(name(part))).collect()
    };
    let light = |folder: &str, hour: f64| files(folder, "lightmapRawData", time(hour));
    let frames = hours().map(|hour| PlannedFrame {
        hour,
        whole: light(WHOLE, hour),
        shares: Some(SHARES.map(|folder| light(folder, hour))),
    });
    Ok(Planned {
        lightmap: Lightmap { id, level: None, width, height },
        frames: frames.collect(),
        masks: vec![files(MASK, "lightmapCoverage", 1)],
    })
}

/// The configuration of lightmaps that are to be written.
pub(super) fn compose(lightmaps: &[Lightmap]) -> Vec<u8> {
    let entry = |l: &Lightmap| Entry {
        id: l.id,
        resolution: Resolution { width: l.width, height: l.height },
        parts: parts(l, MAX_PART_BYTES),
    };
    let lightmap_list: Vec<Entry> = lightmaps.iter().map(entry).collect();
    to_json(&Config { lightmap_count: lightmap_list.len() as u64, lightmap_list })
}

/// The fewest equal parts of at most this many bytes; one where no number will do.
fn parts(lightmap: &Lightmap, most: u64) -> u32 {
    let bytes = u64::from(lightmap.width) * u64::from(lightmap.height) * super::raw::LIGHT_BYTES as u64;
    let divides = |parts: &u32| lightmap.height.is_multiple_of(*parts);
    let fit = (1..=MAX_PARTS).filter(divides).find(|&parts| bytes / u64::from(parts) <= most);
    fit.unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_equal_and_as_few_as_fit() {
        let map = |width, height| Lightmap { id: 0, level: None, width, height };
        assert_eq!(parts(&map(8192, 8192), MAX_PART_BYTES), 1);
        // 3 GiB of a lightmap in three parts would not be equal.
        assert_eq!(parts(&map(16384, 16384), MAX_PART_BYTES), 4);
        assert_eq!(parts(&map(10, 9), 12 * 10 * 4), 3);
        // A prime height has no other parts.
        assert_eq!(parts(&map(10, 7), 12 * 10 * 3), 7);
        assert_eq!(parts(&map(10, 7), 1), 1);
    }

    #[test]
    fn midnight_is_24() {
        assert_eq!([0.0, 1.0, 23.0].map(time), [24, 1, 23]);
    }
}
