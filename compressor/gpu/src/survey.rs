//! Bounds of tiles' sizes from a bundle's index, before any tile is read.

use crate::place::shelves;
use crate::shader;
use ndgi::Bundle;
use ndgi::bundle::Entry;
use ndgi::grid::Place;
use ndgi::model::{Contents, Shape};
use std::collections::BTreeSet;

/// What holds for all tiles of some bundles.
#[derive(Debug, Default)]
pub(crate) struct Survey {
    /// The most that a strip reads of F_uvt, in texels: [`shader::coarse`].
    pub coarse: usize,
    pub widths: BTreeSet<usize>,
    /// Whether any bundle has shadows that move.
    pub shadows: bool,
    /// Per tile, what it may take.
    pub tiles: Vec<Room>,
}

/// Room that a tile takes at most.
#[derive(Clone, Debug, Default)]
pub(crate) struct Room {
    /// The sizes of its maps of BC7 in texels, in the order of [`maps`].
    pub maps: Vec<[u32; 2]>,
    /// Words of the resident buffer.
    pub resident: u32,
    /// The same as is likely: not at most.
    pub likely: u32,
    /// Words of the interval's buffer.
    pub interval: u32,
}

/// Sizes of a tile's maps of BC7 in texels: F_uv, if there is one, and the slices of F_uvt.
pub(crate) fn maps(shape: &Shape) -> Vec<[u32; 2]> {
    let [width, height, slices] = shape.uvt;
    let uv = shape.contents.uv.then_some([shape.width as u32, shape.height as u32]);
    uv.into_iter().chain(vec![[width as u32, height as u32]; slices]).collect()
}

impl Survey {
    /// Of all tiles of bundles, in the order of their indices.
    pub(crate) fn of<'a>(bundles: impl IntoIterator<Item = &'a Bundle>) -> Self {
        let mut survey = Survey::default();
        for bundle in bundles {
            survey.shadows |= bundle.header.shadows;
            for (entry, place) in bundle.index.iter().zip(bundle.header.places()) {
                let contents = Contents::of_word(entry.maps.word).filter(|_| entry.maps.length > 0);
                let shape = contents.map(|contents| bundle.header.shape(place, &contents));
                if let Some(shape) = &shape {
                    let [width, height, _] = shape.uvt;
                    survey.coarse = survey.coarse.max(shader::coarse([width, height], shape.height));
                    survey.widths.insert(shape.hidden);
                }
                survey.tiles.push(room(bundle, place, entry, shape.as_ref()));
            }
        }
        survey
    }

    /// The largest width and height in texels of the tiles' maps, as [`shelves`] puts them together.
    pub(crate) fn rectangle(&self) -> [u32; 2] {
        let used = self.tiles.iter().map(|room| shelves(&room.maps).0);
        used.fold([0; 2], |most, used| [most[0].max(used[0]), most[1].max(used[1])])
    }

    /// Words that any `slots` of the tiles take together, each as `of` tells, and an eighth more for gaps
    /// between them; and what one takes at most.
    pub(crate) fn words(&self, slots: usize, of: impl Fn(&Room) -> u32) -> [u64; 2] {
        let mut words: Vec<u64> = self.tiles.iter().map(|room| of(room).into()).collect();
        words.sort_unstable_by_key(|words| std::cmp::Reverse(*words));
        let all: u64 = words.iter().take(slots).sum();
        [all + all / 8, words.first().copied().unwrap_or(0)]
    }
}

/// Words a byte of a section that tells normals unpacks to, at most: 13 for eight bytes, of a block that
/// tells two normals and has all four that lie from one to the other (12 words, and one of choices).
const OF_NORMALS: [usize; 2] = [13, 8];
/// Words of a block of 4×4 that tells each texel's normal: 48, and two of choices.
const OF_BLOCK: usize = 50;
/// Most of a section tells levels. A tile is taken to have this part of the words that it would have if all
/// told normals; the yard's have a fifth.
const LIKELY: usize = 4;
/// Bytes of moving shadows of a group of 32×32 texels, at most: its size, modes, counts, and three codewords
/// on each of its 64 blocks of 4×4.
const OF_GROUP: usize = 1 + 4 + 16 + 64 * 3 * 2;

/// What a tile takes at most, by its line of the index.
fn room(bundle: &Bundle, place: Place, entry: &Entry, shape: Option<&Shape>) -> Room {
    let mut room = Room::default();
    if let Some(shape) = shape {
        let [_, _, ut, vt] = shape.counts();
        room.maps = maps(shape);
        room.resident = (shader::words(shape.hidden) + ut.div_ceil(2) + vt.div_ceil(2)) as u32;
        room.likely = room.resident;
    }
    if entry.sun.length > 0 {
        let (width, height) = bundle.header.pages[place.page].stored(place.column, place.row);
        let (texels, channels) = (width * height, (entry.sun.word & 3).max(1) as usize);
        // Of the section, all might be normals. Without any, one stands for all texels.
        let [words, bytes] = OF_NORMALS;
        let reported = (words * entry.sun.length as usize).div_ceil(bytes) + 3;
        let reported = reported.min(OF_BLOCK * texels / 16);
        room.likely = room.resident + (texels / 8 + reported / LIKELY) as u32;
        room.resident += (texels / 8 + reported) as u32;
        let cover = |side: usize| width.div_ceil(side) * height.div_ceil(side);
        let moving = match entry.shadows.length as usize {
            0 => 0,
            // A plane may have one byte more than its groups.
            length => channels * cover(8) + length.min(channels * (1 + OF_GROUP * cover(32))).div_ceil(4),
        };
        room.interval = (channels * (texels / 4) + moving) as u32;
    }
    room
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Features, Options};
    use ndgi::bundle::{self, Payload, encode_payload};
    use ndgi::sun::{Coder, Shadows, TileSun};
    use ndgi::testing;

    /// [`testing::sunny`] with the sun alone, seen everywhere, and other normals.
    fn with_normals(normal: impl Fn(usize, usize) -> [f32; 3]) -> Bundle {
        let (header, mut payloads) = testing::sunny();
        let sun = header.sun.as_ref().unwrap();
        let coder = Coder::new(&sun.tables);
        let places: Vec<Place> = header.places().collect();
        for (payload, place) in payloads.iter_mut().zip(places) {
            let (width, height) = header.pages[0].stored(place.column, place.row);
            let normals = (0..width * height).map(|i| normal(i % width, i / width)).collect();
            let levels = vec![TileSun::TOP; sun.times.len() * width * height];
            let (times, shadows) = (sun.times.len(), Shadows::default());
            let tile = TileSun { width, height, times, levels, normals, shadows };
            *payload = Payload { sun: tile.encode(&coder), ..Payload::default() };
        }
        Bundle::from_bytes(bundle::encode(&header, &payloads).unwrap()).unwrap()
    }

    /// A direction that turns from the vertical.
    fn tilted(by: f32) -> [f32; 3] {
        [by.sin(), by.cos(), 0.0]
    }

    #[test]
    fn no_tile_takes_more_than_the_index_tells() {
        let opened = |bytes: Vec<u8>| Bundle::from_bytes(bytes).unwrap();
        let mut random = testing::Random(3);
        let noise: Vec<[f32; 3]> = (0..1 << 14).map(|_| tilted(1.5 * random.unit())).collect();
        let bundles = [
            ("sunny", opened(testing::sunny_bundle()), 0.1),
            ("16", opened(testing::all_contents(16)), 1.0),
            ("64", opened(testing::all_contents(64)), 1.0),
            ("switching", opened(testing::switching_bundle()), 1.0),
            ("one normal", with_normals(|_, _| tilted(0.3)), 0.9),
            ("none", with_normals(|_, _| [0.0; 3]), 0.9),
            // Four between two, of which each tells as many words a byte as there can be; many blocks are
            // alike.
            ("four", with_normals(|x, y| tilted((x + y / 4) as f32 * 0.05)), 0.3),
            ("noise", with_normals(|x, y| noise[(128 * y + x) % noise.len()]), 0.9),
        ];
        for (name, bundle, least) in &bundles {
            let survey = Survey::of([bundle]);
            let (mut found, mut bound) = (0, 0);
            for (place, room) in bundle.header.places().zip(&survey.tiles) {
                let features = Features::read(bundle, place, &Options::default()).unwrap();
                let words = features.data.words.len() as u32;
                let interval = features.known.interval_words();
                let fits = words <= room.resident && interval <= room.interval;
                assert!(fits, "{name}, {place:?}: {words}, {interval}; {room:?}");
                assert_eq!(features.data.picture.size, shelves(&room.maps).0);
                found += words;
                bound += room.resident;
            }
            let share = f64::from(found) / f64::from(bound.max(1));
            assert!(share >= *least || bound == 0, "{name}: {share:.2} of the bound");
        }
    }

    #[test]
    fn a_pool_s_room_is_that_of_the_largest_tiles() {
        let header = testing::header();
        let tile = |i, place| testing::tile_of(&header, i, place).map(|tile| encode_payload(&tile).unwrap());
        let payloads: Vec<Payload> =
            header.places().enumerate().map(|(i, place)| tile(i, place).unwrap_or_default()).collect();
        let bundle = Bundle::from_bytes(bundle::encode(&header, &payloads).unwrap()).unwrap();
        let survey = Survey::of([&bundle, &bundle]);
        let of = |i: usize| u64::from(survey.tiles[i].resident);
        assert!(survey.tiles.len() == 6 && of(0) > of(2) && of(2) > 0 && of(1) == 0);
        let sum = 2 * of(0) + of(2);
        assert_eq!(survey.words(3, |room| room.resident), [sum + sum / 8, of(0)]);
        assert_eq!(survey.words(3, |room| room.likely), [sum + sum / 8, of(0)]);
        assert_eq!(survey.words(3, |room| room.interval), [0, 0]);
    }
}
