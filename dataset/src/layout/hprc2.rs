//! The layout `hprc2`: `config.json`, which names every file, and `Data/`.
//!
//! `config.json` holds `lightmap_count` and `lightmap_list` of `id` (a number or a text), `level`, which
//! together identify a lightmap, `resolution` {`width`, `height`}, and `lightmaps` and `masks`, from time
//! keys to names in `Data/`. A time key is the hour × 100: `"0"` to `"2300"`, and `"590"` and `"1810"` on the
//! lit side of a switch at 6 and 18 h.

use super::{Config, Id, Layout, Lightmap, Lightmaps, Planned, PlannedFrame, Resolution};
use crate::host::files::is_component;
use crate::{Error, Result};
use serde::de::{MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The folder of all files but the configuration.
const DATA: &str = "Data";
/// Time keys of the frames next to the switches.
const EXTRAS: [u32; 2] = [590, 1810];

/// This layout.
#[derive(Debug)]
pub struct Hprc2;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    id: Id,
    level: String,
    resolution: Resolution,
    lightmaps: Names,
    masks: Names,
}

/// Time keys and file names, in the file's order; a repeated key is an error.
struct Names(Vec<(String, String)>);

impl Serialize for Names {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        self.0.iter().try_for_each(|(key, name)| map.serialize_entry(key, name))?;
        map.end()
    }
}

impl<'de> Deserialize<'de> for Names {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = Names;
            fn expecting(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
                out.write_str("an object from time keys to file names")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Names, A::Error> {
                let mut names: Vec<(String, String)> = Vec::new();
                let mut known = BTreeSet::new();
                while let Some((key, name)) = map.next_entry::<String, String>()? {
                    if !known.insert(key.clone()) {
                        return Err(serde::de::Error::custom(format!("time key {key:?} occurs twice")));
                    }
                    names.push((key, name));
                }
                Ok(Names(names))
            }
        }
        deserializer.deserialize_map(Reader)
    }
}

impl Layout for Hprc2 {
    fn name(&self) -> &'static str {
        "hprc2"
    }

    fn about(&self) -> &'static str {
        "config.json, which names every file, and Data/"
    }

    fn hours(&self) -> &'static str {
        "only whole hours, 5.9 and 18.1"
    }

    fn takes(&self, hour: f64) -> bool {
        key(hour).is_some()
    }

    fn lamps_on(&self, hours: &[f64]) -> Option<[f64; 2]> {
        let has = |extra: &u32| hours.iter().any(|&hour| key(hour) == Some(*extra));
        EXTRAS.iter().all(has).then_some([18.0, 6.0])
    }

    fn parse<'a>(&self, place: &'a Path, config: &[u8]) -> Result<Lightmaps<'a>> {
        let entries = Config::<Entry>::read(place, config)?;
        Ok(Box::new(entries.into_iter().map(move |entry| planned(place, entry))))
    }

    fn compose(&self, scene: &str, lightmaps: &[Lightmap], hours: &[f64]) -> Vec<u8> {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let stem: String = scene.chars().map(plain).collect();
        let keys: Vec<u32> = hours.iter().filter_map(|&hour| key(hour)).collect();
        let entry = |l: &Lightmap| {
            let (id, size) = (&l.id, format!("{}_{}", l.width, l.height));
            let names = |name: &dyn Fn(u32) -> String| {
                Names(keys.iter().map(|&key| (key.to_string(), name(key))).collect())
            };
            Entry {
                id: id.clone(),
                level: l.level.clone().unwrap_or_else(|| scene.to_owned()),
                resolution: Resolution::of(l),
                lightmaps: names(&|key| format!("lightmapRawData_{stem}_{id}_{size}_{key}.bin_0")),
                // A mask does not depend on the hour: one file serves all.
                masks: names(&|_| format!("lightmapCoverage_{stem}_{id}_{size}.bin_0")),
            }
        };
        Config::write(lightmaps.iter().map(entry).collect())
    }
}

/// The hour of a time key.
fn hour(key: &str) -> Option<f64> {
    // As it is written: no sign, no leading zero.
    let hundredths: u32 = key.parse().ok().filter(|n: &u32| n.to_string() == key && *n < 2400)?;
    Some(f64::from(hundredths) / 100.0)
}

/// The time key of an hour, for those that readers of the layout look for.
fn key(hour: f64) -> Option<u32> {
    let hundredths = (100.0 * hour).round();
    let key = hundredths as u32;
    let exact = (100.0 * hour - hundredths).abs() < 1e-6;
    (exact && key < 2400 && (key.is_multiple_of(100) || EXTRAS.contains(&key))).then_some(key)
}

fn planned(place: &Path, entry: Entry) -> Result<Planned> {
    let Entry { id, level, resolution: Resolution { width, height }, lightmaps, masks } = entry;
    let lightmap = Lightmap { id, level: Some(level), width, height };
    let wrong = |what: String| Error::invalid(format!("{}, {lightmap}", place.display()), what);
    let read = |kind: &str, names: &Names| -> Result<Vec<(f64, PathBuf)>> {
        let mut files = Vec::with_capacity(names.0.len());
        for (key, name) in &names.0 {
            let Some(hour) = hour(key) else {
                let expected = "expected the hour × 100, \"0\" to \"2399\"";
                return Err(wrong(format!("{kind}: time key {key:?}; {expected}")));
            };
            if !is_component(name) {
                let expected = format!("expected the name of a file in {DATA}/");
                return Err(wrong(format!("{kind}, time key {key}: {name:?}; {expected}")));
            }
            files.push((hour, PathBuf::from(DATA).join(name)));
        }
        files.sort_by(|a, b| a.0.total_cmp(&b.0));
        match files.is_empty() {
            true => Err(wrong(format!("{kind} is empty; expected at least one time key"))),
            false => Ok(files),
        }
    };
    let light = read("lightmaps", &lightmaps)?;
    let masks = read("masks", &masks)?;
    if let Some((hour, _)) = masks.iter().find(|(hour, _)| light.iter().all(|(lit, _)| lit != hour)) {
        return Err(wrong(format!("masks has {hour} h, which lightmaps lacks; expected the same hours")));
    }
    // One file often serves all times.
    let mut masks: Vec<PathBuf> = masks.into_iter().map(|(_, path)| path).collect();
    masks.sort();
    masks.dedup();
    let planned_frame = |(hour, path)| PlannedFrame { hour, whole: vec![path], shares: None };
    Ok(Planned {
        lightmap,
        frames: light.into_iter().map(planned_frame).collect(),
        masks: masks.into_iter().map(|path| vec![path]).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_hours_in_hundredths() {
        assert_eq!(["0", "590", "1810", "2300"].map(hour), [0.0, 5.9, 18.1, 23.0].map(Some));
        for wrong in ["", "-100", "+100", "0100", "00", "2400", "5.9", "1e2", "99999999999", " 0"] {
            assert_eq!(hour(wrong), None, "{wrong:?}");
        }
        assert_eq!([0.0, 5.9, 18.1, 23.0].map(key), [0, 590, 1810, 2300].map(Some));
        assert_eq!([20.4, 5.95, 12.0001, 24.0].map(key), [None; 4]);
        assert_eq!(
            [&[5.9, 6.0, 18.1][..], &[6.0, 18.1]].map(|h| Hprc2.lamps_on(h)),
            [Some([18.0, 6.0]), None]
        );
    }
}
