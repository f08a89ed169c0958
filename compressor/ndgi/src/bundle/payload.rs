//! The section of a tile's features: BC7 blocks, time axis, gates, 8-bit planes, decoder weights.

use super::{ALIGN, resident};
use crate::bc7;
use crate::half::F16;
use crate::model::{Contents, Knot, Section, Shape, TileParams};
use crate::time::Axis;

/// A tile, encoded. The default is black at all times.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Payload {
    /// Its maps: features and decoder, or planes, by the bundle's coding.
    pub maps: Section,
    /// The sun's visibility and the normals.
    pub sun: Section,
    /// How shadows move.
    pub shadows: Section,
    /// Its line of the resident block; none without maps.
    pub resident: Vec<u8>,
}

impl Payload {
    /// All its bytes.
    pub fn bytes(&self) -> usize {
        [&self.maps, &self.sun, &self.shadows].iter().map(|section| section.bytes.len()).sum::<usize>()
            + self.resident.len()
    }
}

/// The block that a map may omit: [`bc7::GREY`].
const GREY: [u8; 16] = [0x40, 0x20, 0x10, 0x08, 0x04, 0x02, 0x81, 0x40, 0, 0, 0, 0, 0, 0, 0, 0];

/// The word's bit that says that F_uv (map 0) or F_uvt (map 1) omits its grey blocks.
fn sparse(map: usize) -> u32 {
    1 << (30 + map)
}

/// True if a map omits its grey blocks: when they take more bytes than the bit field.
fn pays(blocks: usize, there: usize) -> bool {
    16 * (blocks - there) > field_len(blocks)
}

/// Length of the bit field that says which of `blocks` blocks are there.
fn field_len(blocks: usize) -> usize {
    blocks.div_ceil(8).next_multiple_of(ALIGN)
}

/// Length of all but the blocks of the maps.
fn rest_len(shape: &Shape) -> usize {
    let [_, _, ut, vt] = shape.counts();
    let axis = if shape.axis { 2 + 2 * shape.frames } else { 0 };
    axis + 2 * shape.contents.gates + 2 * (ut + vt) + 2 * shape.mlp_len()
}

/// The least and the largest length in bytes that a payload of a shape can have, with the word's sparse maps.
pub(super) fn len_bounds(shape: &Shape, word: u32) -> [usize; 2] {
    let [uv, uvt, ..] = shape.counts();
    let (mut least, mut largest) = (rest_len(shape), rest_len(shape));
    for (map, blocks) in [uv, uvt].into_iter().enumerate() {
        if word & sparse(map) == 0 {
            least += 16 * blocks;
            largest += 16 * blocks;
        } else {
            least += field_len(blocks);
            largest += 16 * blocks;
        }
    }
    [least, largest].map(|length| length.next_multiple_of(ALIGN))
}

/// Length of a section in bytes of which no block is omitted, a multiple of 16.
pub fn full_len(shape: &Shape) -> usize {
    len_bounds(shape, 0)[1]
}

/// Length of a section in bytes with this many blocks of F_uv and F_uvt that are not grey.
pub fn blocks_len(shape: &Shape, blocks: [usize; 2]) -> usize {
    let [uv, uvt, ..] = shape.counts();
    let map = |(all, there): (usize, usize)| match pays(all, there) {
        true => 16 * there + field_len(all),
        false => 16 * all,
    };
    let maps: usize = [uv, uvt].into_iter().zip(blocks).map(map).sum();
    (maps + rest_len(shape)).next_multiple_of(ALIGN)
}

/// A tile without a sun as bytes. Grey blocks are omitted where that pays.
///
/// # Errors
/// A message for invalid parameters: lengths that differ from the shape's, or values that the format forbids.
pub fn encode_payload(tile: &TileParams) -> Result<Payload, String> {
    let shape = &tile.shape;
    tile.check_lengths()?;
    check(tile)?;
    let mut word = shape.contents.word().ok_or("contents without a word")?;
    let mut bytes = Vec::with_capacity(full_len(shape));
    for (map, blocks) in [&tile.f_uv, &tile.f_uvt].into_iter().enumerate() {
        let there = |block: &&[u8; 16]| **block != GREY;
        if !pays(blocks.len(), blocks.iter().filter(there).count()) {
            bytes.extend(blocks.iter().flatten());
            continue;
        }
        word |= sparse(map);
        let mut field = vec![0; field_len(blocks.len())];
        for i in (0..blocks.len()).filter(|&i| blocks[i] != GREY) {
            field[i / 8] |= 1 << (i % 8);
        }
        bytes.extend(field);
        bytes.extend(blocks.iter().filter(there).flatten());
    }
    let length = shape.axis.then_some(&tile.axis.length);
    let shorts = length.into_iter().chain(&tile.axis.places).chain(&tile.gates);
    bytes.extend(shorts.flat_map(|number| number.to_le_bytes()));
    bytes.extend(tile.f_ut.iter().chain(&tile.f_vt).flatten());
    bytes.extend(tile.mlp.iter().flat_map(|weight| weight.to_le_bytes()));
    bytes.resize(bytes.len().next_multiple_of(ALIGN), 0);
    let resident = resident::encode(&tile.knots)?;
    Ok(Payload { maps: Section { word, bytes }, resident, ..Payload::default() })
}

/// A tile from its section of features, the word of its index line, the shape that its contents give, the
/// number of light groups, and how bright it is at the knots.
///
/// # Errors
/// What the format forbids: another length, a block of another mode of BC7 than 6 and 4, grey blocks that are
/// there or not as the word does not say, a time axis that steps back, gates that are not ascending or are no
/// groups, a weight or mean that is not finite, a negative mean, padding that is not zero.
pub(super) fn decode_section(
    bytes: &[u8],
    word: u32,
    shape: Shape,
    groups: usize,
    knots: Vec<Knot>,
) -> Result<TileParams, String> {
    let mut rest = bytes;
    let mut take = |n: usize, what: &str| {
        let parts = rest.split_at_checked(n);
        let (part, tail) =
            parts.ok_or_else(|| format!("expected {n} bytes of {what}, but only {} remain", rest.len()))?;
        rest = tail;
        Ok::<_, String>(part)
    };
    let [uv, uvt, ut, vt] = shape.counts();
    let mut maps = [Vec::new(), Vec::new()];
    for (map, (blocks, count)) in maps.iter_mut().zip([uv, uvt]).enumerate() {
        let name = ["F_uv", "F_uvt"][map];
        if word & sparse(map) == 0 {
            *blocks = take(16 * count, name)?.as_chunks::<16>().0.to_vec();
            if pays(count, blocks.iter().filter(|block| **block != GREY).count()) {
                return Err(format!("{name} stores grey blocks that must be omitted"));
            }
            continue;
        }
        let field = take(field_len(count), name)?;
        let bit = |i: usize| field[i / 8] >> (i % 8) & 1 == 1;
        let there = (0..count).filter(|&i| bit(i)).count();
        if !pays(count, there) || (count..8 * field.len()).any(bit) {
            return Err(format!("{name} omits too few blocks, or one that it does not have"));
        }
        for i in 0..count {
            let mut block = GREY;
            if bit(i) {
                block.copy_from_slice(take(16, name)?);
                if block == GREY {
                    return Err(format!("block {i} of {name} is grey and must be omitted"));
                }
            }
            blocks.push(block);
        }
    }
    let [f_uv, f_uvt] = maps;
    let shorts = |part: &[u8]| -> Vec<u16> {
        part.as_chunks::<2>().0.iter().map(|&b| u16::from_le_bytes(b)).collect()
    };
    let mut axis = Axis::default();
    if shape.axis {
        axis.length = shorts(take(2, "time axis")?)[0];
        axis.places = shorts(take(2 * shape.frames, "time axis")?);
    }
    let gates = shorts(take(2 * shape.contents.gates, "gates")?);
    let texels = |part: &[u8]| part.as_chunks::<2>().0.to_vec();
    let (f_ut, f_vt) = (texels(take(2 * ut, "F_ut")?), texels(take(2 * vt, "F_vt")?));
    let mlp = take(2 * shape.mlp_len(), "decoder")?;
    let mlp = mlp.as_chunks::<2>().0.iter().map(|&b| F16::from_le_bytes(b)).collect();
    if rest.len() >= ALIGN || rest.iter().any(|&byte| byte != 0) {
        return Err(format!("only zeros up to the next multiple of {ALIGN} may follow the decoder"));
    }
    let tile = TileParams { shape, f_uv, f_uvt, f_ut, f_vt, mlp, knots, axis, gates };
    check(&tile)?;
    if let Some(group) = tile.gates.iter().find(|&&group| usize::from(group) >= groups) {
        return Err(format!("a gate of light group {group}; there are {groups}"));
    }
    Ok(tile)
}

/// The rules on values, the same for writing and reading.
fn check(tile: &TileParams) -> Result<(), String> {
    for (map, blocks) in [("F_uv", &tile.f_uv), ("F_uvt", &tile.f_uvt)] {
        if let Some(i) = blocks.iter().position(|block| bc7::check(block).is_err()) {
            return Err(format!("block {i} of {map} is neither BC7 mode 6 nor mode 4"));
        }
    }
    if let Some((i, w)) = tile.mlp.iter().enumerate().find(|(_, w)| !w.is_finite()) {
        return Err(format!("decoder weight {i} is {w}; expected a finite number"));
    }
    for (i, knot) in tile.knots.iter().enumerate() {
        if let Some(m) = knot.mean.iter().find(|m| !(m.is_finite() && **m >= 0.0)) {
            return Err(format!("mean {i} is {m}; expected a finite number ≥ 0"));
        }
    }
    tile.axis.check()?;
    if !tile.gates.is_sorted_by(|a, b| a < b) {
        return Err("gates that are not ascending".to_owned());
    }
    Ok(())
}

/// The contents that a word stands for, where they are those of a bundle with this many groups.
pub(super) fn contents(word: u32, groups: usize) -> Option<Contents> {
    let contents = Contents::of_word(word)?;
    let sparse_without_map =
        (word & sparse(0) != 0 && !contents.uv) || (word & sparse(1) != 0 && contents.uvt == 0);
    (contents.gates <= groups && !sparse_without_map).then_some(contents)
}
