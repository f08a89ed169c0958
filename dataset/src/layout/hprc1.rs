//! The layout `hprc1`: folders by light type, times 1 to 24.
//!
//! `config.json` holds `lightmap_count` and `lightmap_list` of `id` (a number or a text), `resolution`
//! {`width`, `height`} and `parts`. The light is in `Original/` and, where it is stored separately, in
//! `DirectionalOnly/`, `SkyLightOnly/` and `LocalOnly/`, the masks in `Mask/`. Time t is t o'clock; 24 is
//! midnight, the hour 0 of a dataset. Lightmaps are cut by height into `parts` equal files.

use super::{
    Config, Id, LIGHT_BYTES, Layout, Lightmap, Lightmaps, Parts, Planned, PlannedFrame, Resolution, list,
};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The folder of whole lightmaps.
const WHOLE: &str = "Original";
/// The folders of sun, sky and lamps.
const SHARES: [&str; 3] = ["DirectionalOnly", "SkyLightOnly", "LocalOnly"];
/// The folder of masks.
const MASK: &str = "Mask";
/// Most files that a lightmap is cut into.
const MAX_PARTS: u32 = 256;
/// Largest file that is written, in bytes, where the height can be divided.
const MAX_PART_BYTES: u64 = 1 << 30;

/// This layout.
#[derive(Debug)]
pub struct Hprc1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    id: Id,
    resolution: Resolution,
    parts: u32,
}

impl Layout for Hprc1 {
    fn name(&self) -> &'static str {
        "hprc1"
    }

    fn about(&self) -> &'static str {
        "Folders by light type (Original, DirectionalOnly, SkyLightOnly, LocalOnly, Mask), times 1 to 24"
    }

    fn shares(&self) -> &'static [&'static str] {
        &SHARES
    }

    fn hours(&self) -> &'static str {
        "only whole hours"
    }

    fn takes(&self, hour: f64) -> bool {
        hours().any(|whole| whole == hour)
    }

    fn refuses(&self, all: &[f64]) -> Option<String> {
        let missing: Vec<f64> = hours().filter(|hour| !all.contains(hour)).collect();
        (!missing.is_empty()).then(|| {
            format!(
                "no frame at {} h; the layout needs all 24 whole hours: export to hprc2, or bake with --hours 0..24",
                list(&missing)
            )
        })
    }

    fn confuses(&self, lightmaps: &[Lightmap]) -> Option<String> {
        let mut known = BTreeMap::new();
        lightmaps.iter().find_map(|l| {
            let other = known.insert(l.id.to_string(), l)?;
            Some(format!("{other} and {l} have the same id, and the layout has no levels: export to hprc2"))
        })
    }

    fn parse<'a>(&self, place: &'a Path, config: &[u8]) -> Result<Lightmaps<'a>> {
        let entries = Config::<Entry>::read(place, config)?;
        Ok(Box::new(entries.into_iter().map(move |entry| planned(place, entry))))
    }

    fn compose(&self, _: &str, lightmaps: &[Lightmap], _: &[f64]) -> Vec<u8> {
        let entry = |l: &Lightmap| {
            let parts = parts(l, MAX_PART_BYTES);
            Entry { id: l.id.clone(), resolution: Resolution::of(l), parts }
        };
        Config::write(lightmaps.iter().map(entry).collect())
    }
}

/// The hours that the layout holds, ascending.
fn hours() -> impl Iterator<Item = f64> {
    (0..24).map(f64::from)
}

/// The time of an hour of [`hours`]: 1 to 24.
fn time(hour: f64) -> u32 {
    if hour == 0.0 { 24 } else { hour as u32 }
}

fn planned(place: &Path, entry: Entry) -> Result<Planned> {
    let Entry { id, resolution: Resolution { width, height }, parts } = entry;
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
    let (frames, masks) = (frames.collect(), vec![files(MASK, "lightmapCoverage", 1)]);
    Ok(Planned { lightmap: Lightmap { id, level: None, width, height }, frames, masks })
}

/// The fewest equal parts of at most this many bytes; one where no number will do.
fn parts(lightmap: &Lightmap, most: u64) -> u32 {
    let bytes = u64::from(lightmap.width) * u64::from(lightmap.height) * LIGHT_BYTES as u64;
    let divides = |parts: &u32| lightmap.height.is_multiple_of(*parts);
    let fit = (1..=MAX_PARTS).filter(divides).find(|&parts| bytes / u64::from(parts) <= most);
    fit.unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_equal_and_as_few_as_fit() {
        let map = |width, height| Lightmap { id: Id::Number(0), level: None, width, height };
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
