//! Repairs a bundle that is up to date but for damaged tiles: only these are trained again.

use super::job::Job;
use super::part::Part;
use crate::bundle::{Bundle, Header, MapCoding, Section, checksum};
use crate::grid::Place;
use crate::model::Contents;
use crate::{Error, Result, of_bundle};
use dataset::host::files::write_atomically;
use dataset::observe::{Observer, count};
use std::fs;

/// Trains the damaged tiles of the bundle of a job again and puts them in their places. False if what comes
/// out differs from what the bundle's index says, as on another processor: then nothing is written.
pub(super) fn repair(
    job: &Job,
    header: &Header,
    part: &Part,
    places: &[Place],
    console: &dyn Observer,
) -> Result<bool> {
    let bundle = Bundle::open(&job.out).map_err(of_bundle)?;
    let mut bytes = fs::read(&job.out).map_err(Error::io(&job.out))?;
    if bytes.len() as u64 != bundle.bytes {
        return Ok(false);
    }
    console.warn(format!(
        "{}: {} damaged; repairing",
        job.out.display(),
        match places.len() {
            1 => "a tile is".to_owned(),
            n => format!("{} are", count(n, "tile")),
        }
    ));
    let mut is_same = true;
    let mut put = |index: &crate::bundle::Part, section: &Section| {
        let expected = (u64::from(index.length), index.word, index.checksum);
        let found = (section.bytes.len() as u64, section.word, checksum(&[&section.bytes]));
        match usize::try_from(index.offset) {
            Ok(start) if found == expected => {
                bytes[start..start + section.bytes.len()].copy_from_slice(&section.bytes);
            }
            _ => is_same = false,
        }
    };
    let entry = |place: &Place| bundle.header.position(*place).map(|position| bundle.index[position]);

    let mut tiles = job.tiles(header, part);
    tiles.is_verified = true;
    let features: Vec<Place> =
        places.iter().filter(|place| bundle.verify_maps(**place).is_err()).copied().collect();
    if header.coding == MapCoding::Basis {
        // (The step that a target chose.)
        tiles.chosen(console)?;
    }
    let contents = |place: &Place| entry(place).and_then(|entry| Contents::of_word(entry.maps.word));
    for (place, payload) in features.iter().zip(tiles.again(&features, contents, console)?) {
        if let Some(entry) = entry(place) {
            put(&entry.maps, &payload.maps);
        }
    }
    let of_sun = |place: &&Place| bundle.sun_sections(**place).is_err();
    if let Some((sunlight, sun)) = job.sunlight.as_ref().zip(header.sun.as_ref())
        && places.iter().any(|place| of_sun(&place))
    {
        let sections = sunlight.sections(sun, &job.masks, console)?;
        for place in places.iter().filter(of_sun) {
            let Some(position) = bundle.header.position(*place) else { continue };
            let (entry, [sun, shadows]) = (bundle.index[position], &sections[position]);
            for (index, section) in [(entry.sun, sun), (entry.shadows, shadows)] {
                if index.length > 0 {
                    put(&index, section);
                }
            }
        }
    }
    if is_same {
        write_atomically(&job.out, &bytes)?;
    }
    Ok(is_same)
}
