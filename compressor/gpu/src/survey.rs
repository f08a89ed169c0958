//! What the index of a bundle tells of its tiles' sizes, before any is read.

use crate::place::shelves;
use crate::shader;
use ndgi::Bundle;
use ndgi::bundle::Entry;
use ndgi::grid::Place;
use ndgi::model::{Contents, Shape};

/// What holds for all tiles of some bundles.
#[derive(Debug, Default)]
pub(crate) struct Survey {
    /// The most that a strip reads of F_uvt, in texels: [`shader::coarse`].
    pub coarse: usize,
    /// The narrowest hidden layers; 16 where there are none.
    pub least: usize,
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
    pub fn of<'a>(bundles: impl IntoIterator<Item = &'a Bundle>) -> Self {
        let (mut survey, mut least) = (Survey::default(), None);
        for bundle in bundles {
            survey.shadows |= bundle.header.shadows;
            for (entry, place) in bundle.index.iter().zip(bundle.header.places()) {
                let contents = Contents::of_word(entry.ndgi.word).filter(|_| entry.ndgi.length > 0);
                let shape = contents.map(|contents| bundle.header.shape(place, &contents));
                if let Some(shape) = &shape {
                    let [width, height, _] = shape.uvt;
                    survey.coarse = survey.coarse.max(shader::coarse([width, height], shape.height));
                    least = Some(shape.hidden.min(least.unwrap_or(shape.hidden)));
                }
                survey.tiles.push(room(bundle, place, entry, shape.as_ref()));
            }
        }
        survey.least = least.unwrap_or(16);
        survey
    }

    /// The largest width and height in texels of the tiles' maps, as [`shelves`] puts them together.
    pub fn rectangle(&self) -> [u32; 2] {
        let used = self.tiles.iter().map(|room| shelves(&room.maps).0);
        used.fold([0; 2], |most, used| [most[0].max(used[0]), most[1].max(used[1])])
    }

    /// Words that any `slots` of the tiles take at most together, in the resident buffer and the interval's, and an eighth more for gaps between
    /// them; and what one takes.
    pub fn words(&self, slots: usize) -> [[u64; 2]; 2] {
        let of = |room: &dyn Fn(&Room) -> u32| {
            let mut words: Vec<u64> = self.tiles.iter().map(|tile| room(tile).into()).collect();
            words.sort_unstable_by_key(|words| std::cmp::Reverse(*words));
            let all: u64 = words.iter().take(slots).sum();
            [all + all / 8, words.first().copied().unwrap_or(0)]
        };
        [of(&|room| room.resident), of(&|room| room.interval)]
    }
}

/// Words a byte of a section that tells normals unpacks to, at most: 13 for eight bytes, of a block that tells two normals and has all four that lie from
/// one to the other (12 words, and one of choices).
const OF_NORMALS: [usize; 2] = [13, 8];
/// Words of a block of 4×4 that tells each texel's normal: 48, and two of choices.
const OF_BLOCK: usize = 50;
/// Bytes of moving shadows of a group of 32×32 texels, at most: its size, modes, counts, and three codewords on each of its 64 blocks of 4×4.
const OF_GROUP: usize = 1 + 4 + 16 + 64 * 3 * 2;

/// What a tile takes at most, by its line of the index.
fn room(bundle: &Bundle, place: Place, entry: &Entry, shape: Option<&Shape>) -> Room {
    let mut room = Room::default();
    if let Some(shape) = shape {
        let [_, _, ut, vt] = shape.counts();
        room.maps = maps(shape);
        room.resident = (shader::words(shape.hidden) + ut.div_ceil(2) + vt.div_ceil(2)) as u32;
    }
    if entry.sun.length > 0 {
        let (width, height) = bundle.header.pages[place.page].stored(place.column, place.row);
        let (texels, channels) = (width * height, (entry.sun.word & 3).max(1) as usize);
        // Of the section, all might be normals. Without any, one stands for all texels.
        let [words, bytes] = OF_NORMALS;
        let told = (words * entry.sun.length as usize).div_ceil(bytes) + 3;
        room.resident += (texels / 8 + told.min(OF_BLOCK * texels / 16)) as u32;
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
