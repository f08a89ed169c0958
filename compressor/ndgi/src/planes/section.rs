//! A tile's section of planes: a directory of its light sources, then the bytes of each.

use super::set::{MOST_PLANES, MOST_PLANES_OF_TILE, PlaneSet};
use crate::model::Section;

/// Bytes of a line of the directory.
const LINE: usize = 8;
/// Sections end at multiples of this.
const ALIGN: usize = 16;
/// The bit of a line's flags for planes that hold light over its mean.
const LINEAR: u8 = 1;

/// A tile's section from its sets, each with its bytes ([`super::encode`]); their sources ascend strictly.
///
/// # Errors
/// A message for sets that the format cannot hold.
pub fn encode_section(sets: &[(PlaneSet, Vec<u8>)]) -> Result<Section, String> {
    if !sets.is_sorted_by(|a, b| a.0.source < b.0.source) {
        return Err("light sources that do not ascend".to_owned());
    }
    let mut out = (sets.len() as u32).to_le_bytes().to_vec();
    for (set, bytes) in sets {
        set.check()?;
        if set.planes() > MOST_PLANES {
            return Err(format!("{} planes; expected at most {MOST_PLANES}", set.planes()));
        }
        out.extend(set.source.to_le_bytes());
        out.push(set.planes() as u8);
        out.push(if set.is_linear { LINEAR } else { 0 });
        out.extend((bytes.len() as u32).to_le_bytes());
    }
    out.extend(sets.iter().flat_map(|(_, bytes)| bytes));
    out.resize(out.len().next_multiple_of(ALIGN), 0);
    let planes: usize = sets.iter().map(|(set, _)| set.planes()).sum();
    if planes > MOST_PLANES_OF_TILE {
        let lamps = sets.len() - 1;
        return Err(format!(
            "{planes} planes of daylight and {lamps} light groups; a tile has at most {MOST_PLANES_OF_TILE}: join groups"
        ));
    }
    Ok(Section { word: planes as u32, bytes: out })
}

/// The sets of a section on a tile of stored width and height. `frames`: of each source, how many frames it
/// lights; `None` for a source that the bundle does not have.
///
/// # Errors
/// A message for what the format forbids.
pub(crate) fn decode_section(
    bytes: &[u8],
    word: u32,
    [width, height]: [usize; 2],
    frames: impl Fn(u16) -> Option<usize>,
) -> Result<Vec<PlaneSet>, String> {
    let short = || "a directory that is cut short".to_owned();
    let (count, rest) = bytes.split_first_chunk::<4>().ok_or_else(short)?;
    let count = u32::from_le_bytes(*count) as usize;
    let length = count.checked_mul(LINE).ok_or_else(short)?;
    let (directory, mut rest) = rest.split_at_checked(length).ok_or_else(short)?;
    let mut sets: Vec<PlaneSet> = Vec::with_capacity(count);
    let blocks = [width.div_ceil(8), height.div_ceil(8)];
    let mut sum = 0;
    for [a, b, planes, flags, length @ ..] in directory.as_chunks::<LINE>().0 {
        let source = u16::from_le_bytes([*a, *b]);
        let wrong = |what: String| format!("light source {source}: {what}");
        if sets.last().is_some_and(|before| before.source >= source) {
            return Err(wrong("expected ascending ones".to_owned()));
        }
        let planes = usize::from(*planes);
        if planes > MOST_PLANES || *flags > LINEAR {
            return Err(wrong(format!("{planes} planes, flags {flags}")));
        }
        sum += planes;
        if sum > MOST_PLANES_OF_TILE {
            return Err(format!("more than {MOST_PLANES_OF_TILE} planes"));
        }
        let frames = frames(source).ok_or_else(|| wrong("the bundle has none on this tile".to_owned()))?;
        let length = u32::from_le_bytes(*length) as usize;
        let (own, tail) = rest
            .split_at_checked(length)
            .ok_or_else(|| wrong(format!("{length} bytes, but only {} remain", rest.len())))?;
        rest = tail;
        let set = PlaneSet::decode(own, [planes, frames], blocks).map_err(wrong)?;
        sets.push(PlaneSet { source, is_linear: *flags == LINEAR, ..set });
    }
    if word as usize != sum {
        return Err(format!("{sum} planes, but the index says {word}"));
    }
    if rest.len() >= ALIGN || rest.iter().any(|byte| *byte != 0) {
        return Err(format!("only zeros up to the next multiple of {ALIGN} may follow the last set"));
    }
    Ok(sets)
}
