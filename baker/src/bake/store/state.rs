//! The work done so far at one block of texels: sums of samples.

use super::columns;
use crate::Rgb;
use crate::receivers::ReceiverBlock;
use crate::surface::BLOCK;
use crate::trace::sources::Lights;
use bytemuck::{Pod, Zeroable};

/// Side of a cell: the texels that are given samples together.
pub const CELL: usize = 16;
/// Cells of a block.
pub(crate) const CELLS: usize = (BLOCK / CELL) * (BLOCK / CELL);
/// Points of a texel that tell which surface it stands for: some may lie inside a solid, or behind a wall.
pub(crate) const POINTS: u32 = 16;
/// The bits of all of them.
pub(crate) const ALL_POINTS: u16 = u16::MAX;

/// The cell of a texel (an index within the block, row by row).
pub(crate) fn cell_of(receivers: &ReceiverBlock, texel: usize) -> usize {
    (texel / receivers.width / CELL) * (BLOCK / CELL) + texel % receivers.width / CELL
}

/// Whether so many of a texel's points are its surface that it counts.
pub(crate) fn is_usable(points: u16) -> bool {
    is_enough(points.count_ones())
}

/// Whether so many of a texel's points are enough of it.
pub(crate) fn is_enough(points: u32) -> bool {
    points >= POINTS / 8
}

/// Sums of the direct samples of one light in one half of a texel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Direct {
    /// Sum of irradiances.
    pub sum: Rgb,
    /// Sum of the squares of the irradiances' channel sums.
    pub squares: f32,
    /// Samples drawn.
    pub drawn: u16,
    /// Those that had a point to start from: what the sum is divided by.
    pub taken: u16,
}

impl Direct {
    /// Adds a sample.
    pub fn add(&mut self, irradiance: Rgb) {
        self.sum += irradiance;
        self.squares += irradiance.element_sum().powi(2);
        self.drawn += 1;
        self.taken += 1;
    }

    /// Mean irradiance.
    pub fn mean(&self) -> Rgb {
        if self.taken == 0 { Rgb::ZERO } else { self.sum / f32::from(self.taken) }
    }

    /// Standard deviation of a sample, in the sum of its channels.
    pub fn deviation(&self) -> f32 {
        if self.taken == 0 {
            return 0.0;
        }
        let n = f32::from(self.taken);
        let mean = self.sum.element_sum() / n;
        (self.squares / n - mean * mean).max(0.0).sqrt()
    }

    /// Whether its samples differ by so much that more of them are worth their rays.
    pub fn varies(&self) -> bool {
        /// Standard deviation of a sample, relative to the mean, that is let be.
        const TOLERATED: f32 = 0.05;
        self.deviation() > TOLERATED * self.mean().element_sum()
    }

    /// Whether it differs so much from its neighbour that the edge of a shadow may run between them.
    pub fn differs_from(&self, neighbour: &Direct) -> bool {
        /// Of the greater of the two.
        const TOLERATED: f32 = 0.5;
        let (a, b) = (self.mean().element_sum(), neighbour.mean().element_sum());
        self.taken > 0 && neighbour.taken > 0 && (a - b).abs() > TOLERATED * a.max(b)
    }
}

/// Sums over the samples of one block, for its covered texels only.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockState {
    /// Rounds completed.
    pub round: u32,
    /// Per texel, one bit per point, set where it is the texel's surface: outside solids, and on the side of
    /// a wall that the texel stands for ([`crate::bake::samples::Worker::surface_points`]). Empty before they
    /// were found.
    pub points: Vec<u16>,
    /// `[texel][half][sampled light]`.
    pub direct: Vec<Direct>,
    /// `[texel][sampled light]`: pilot samples, by which it is decided how many are drawn; empty before they
    /// are drawn and after the decision.
    pub pilot_samples: Vec<Direct>,
    /// `[texel][sampled light]`: how many direct samples are drawn, decided once (see
    /// [`crate::bake::samples::direct`]); empty before that.
    pub direct_budgets: Vec<u8>,
    /// Per texel, log₂ of how many times the mean number of samples (the page's, or towards a target its
    /// cell's) it gets of indirect light ([`crate::bake::samples::allocate`]); empty before that is decided.
    pub log2_shares: Vec<i8>,
    /// Per texel, the samples of indirect light drawn in each half.
    pub drawn: Vec<u32>,
    /// Per texel and half, those of them that had a point to start from: what the sums are divided by.
    pub taken: Vec<[u32; 2]>,
    /// `[texel][half][layer]`: sums of irradiance samples, without what comes straight from sampled lights.
    pub sums: Vec<Rgb>,
    /// `[texel][half][light that paths can meet]`: sums of what they met of it straight from their start
    /// ([`Lights::layers_of_hit_lights`]), which is no part of `sums`.
    pub hit_sums: Vec<Rgb>,
}

/// What a block holds sums of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SumKinds {
    /// Layers.
    pub layers: usize,
    /// Lights that are sampled from a point.
    pub sampled: usize,
    /// Lights that paths can meet, whose light is summed apart.
    pub hit_lights: usize,
}

impl SumKinds {
    /// Those of some lights.
    pub fn of(lights: &Lights) -> Self {
        SumKinds { layers: lights.layers(), sampled: lights.sampled(), hit_lights: lights.hit_lights() }
    }
}

impl BlockState {
    /// No samples yet.
    pub fn empty(texels: usize, kinds: SumKinds) -> Self {
        let SumKinds { layers, sampled, hit_lights } = kinds;
        BlockState {
            round: 0,
            points: Vec::new(),
            direct: vec![Direct::default(); texels * 2 * sampled],
            pilot_samples: Vec::new(),
            direct_budgets: Vec::new(),
            log2_shares: Vec::new(),
            drawn: vec![0; texels],
            taken: vec![[0; 2]; texels],
            sums: vec![Rgb::ZERO; texels * 2 * layers],
            hit_sums: vec![Rgb::ZERO; texels * 2 * hit_lights],
        }
    }

    /// Whether enough of a texel's points are its surface for it to count.
    pub fn is_usable(&self, texel: usize) -> bool {
        is_usable(self.points.get(texel).copied().unwrap_or(0))
    }

    /// Sums of the pilot samples' mean direct light of each light over the usable texels, and how many those
    /// are.
    pub fn pilot_sums(&self, lights: usize) -> (Vec<f64>, f64) {
        let mut sums = vec![0.0; lights];
        let pilot_samples =
            self.pilot_samples.chunks(lights.max(1)).enumerate().filter(|(texel, _)| self.is_usable(*texel));
        for (_, pilot_samples) in pilot_samples {
            sums.iter_mut().zip(pilot_samples).for_each(|(s, d)| *s += f64::from(d.mean().element_sum()));
        }
        let usable = (0..self.taken.len()).filter(|&t| self.is_usable(t)).count();
        (sums, usable as f64)
    }

    /// The estimate of what lightmaps hold of each layer at a texel, by one half.
    pub fn means(&self, texel: usize, half: usize, lights: &Lights, out: &mut [Rgb]) {
        self.indirect(texel, half, lights, out);
        self.add_direct(texel, half, lights, |layer| lights.holds_direct[layer], out);
    }

    /// The estimate of each layer at a texel by one half, but for what comes straight from sampled lights.
    pub fn indirect(&self, texel: usize, half: usize, lights: &Lights, out: &mut [Rgb]) {
        let layers = lights.layers();
        let from = (texel * 2 + half) * layers;
        let scale = 1.0 / (self.taken[texel][half].max(1) as f32);
        for (out, sum) in out.iter_mut().zip(&self.sums[from..from + layers]) {
            *out = *sum * scale;
        }
    }

    /// Adds the estimate of what comes straight from sampled lights, for layers that are `wanted`.
    pub fn add_direct(
        &self,
        texel: usize,
        half: usize,
        lights: &Lights,
        wanted: impl Fn(usize) -> bool,
        out: &mut [Rgb],
    ) {
        let from = (texel * 2 + half) * lights.sampled();
        for (light, direct) in self.direct[from..from + lights.sampled()].iter().enumerate() {
            let layer = lights.layer_of_sampled(light);
            if wanted(layer) {
                out[layer] += direct.mean();
            }
        }
        let from = (texel * 2 + half) * lights.hit_lights();
        let scale = 1.0 / (self.taken[texel][half].max(1) as f32);
        for (layer, place) in lights.layers_of_hit_lights().filter(|(layer, _)| wanted(*layer)) {
            out[layer] += self.hit_sums[from + place] * scale;
        }
    }
}

const MAGIC: &[u8; 8] = b"TLMBLK09";
/// Magic, round, texels, layers, sampled lights, lights that paths can meet, and which arrays follow:
/// [`KNOWN_POINTS`] and so on.
const HEADER: usize = 8 + 6 * 4;
/// Whether the points of texels were found.
const KNOWN_POINTS: u32 = 1;
/// Whether there are pilot samples.
const PILOT: u32 = 2;
/// Whether it is decided how many direct samples there are.
const DECIDED: u32 = 4;
/// Whether it is decided how the samples of indirect light are shared.
const SHARED: u32 = 8;
/// Whether samples of indirect light were drawn: else all that is counted of them is zero, and takes no
/// bytes.
const DRAWN: u32 = 16;

impl BlockState {
    /// What [`BlockState::to_bytes`] gave for a block of so many texels and these kinds of sums; `None` where
    /// the bytes are of another.
    pub fn from_bytes(bytes: &[u8], texels: usize, kinds: SumKinds) -> Option<BlockState> {
        let SumKinds { layers, sampled, hit_lights } = kinds;
        let mut state = BlockState::empty(texels, kinds);
        let (header, packed) = bytes.split_at_checked(HEADER)?;
        let word = |i: usize| {
            let at = 8 + 4 * i;
            Some(u32::from_le_bytes(header.get(at..at + 4)?.try_into().ok()?))
        };
        let fits = header.starts_with(MAGIC)
            && [word(1)?, word(2)?, word(3)?, word(4)?]
                == [texels, layers, sampled, hit_lights].map(|n| n as u32);
        let (known, records) = (word(5)?, texels * sampled);
        let held = |bit: u32, n: usize| if known & bit == bit { n } else { 0 };
        state.points = vec![0; held(KNOWN_POINTS, texels)];
        state.pilot_samples = vec![Direct::default(); held(PILOT, records)];
        state.direct_budgets = vec![0; held(DECIDED, records)];
        state.log2_shares = vec![0; held(SHARED, texels)];
        state.round = word(0)?;
        if !fits {
            return None;
        }
        let mut arrays = state.arrays_mut(known);
        arrays.retain(|array| !array.is_empty());
        columns::unpack(packed, texels, &mut arrays)?;
        Some(state)
    }

    /// For keeping it, in the byte order of the machine: work in progress does not travel.
    pub fn to_bytes(&self, kinds: SumKinds) -> Vec<u8> {
        let SumKinds { layers, sampled, hit_lights } = kinds;
        let known = [
            (KNOWN_POINTS, !self.points.is_empty()),
            (PILOT, !self.pilot_samples.is_empty()),
            (DECIDED, !self.direct_budgets.is_empty()),
            (SHARED, !self.log2_shares.is_empty()),
            (DRAWN, self.drawn.iter().any(|&drawn| drawn > 0)),
        ];
        let known = known.into_iter().filter(|(_, is_there)| *is_there).fold(0, |bits, (bit, _)| bits | bit);
        let texels = self.taken.len();
        let mut bytes = Vec::from(MAGIC);
        for word in [self.round, texels as u32, layers as u32, sampled as u32, hit_lights as u32, known] {
            bytes.extend_from_slice(&word.to_le_bytes());
        }
        columns::pack(&self.arrays(known), texels, &mut bytes);
        bytes
    }

    /// What is kept of it, array by array.
    fn arrays(&self, known: u32) -> Vec<&[u8]> {
        let mut arrays = vec![
            bytemuck::cast_slice(&self.points),
            bytemuck::cast_slice(&self.direct),
            bytemuck::cast_slice(&self.pilot_samples),
            &self.direct_budgets[..],
            bytemuck::cast_slice(&self.log2_shares),
        ];
        if known & DRAWN == DRAWN {
            arrays.extend([
                bytemuck::cast_slice(&self.drawn),
                bytemuck::cast_slice(&self.taken),
                bytemuck::cast_slice(&self.sums),
                bytemuck::cast_slice(&self.hit_sums),
            ]);
        }
        arrays
    }

    /// The same, to be filled.
    fn arrays_mut(&mut self, known: u32) -> Vec<&mut [u8]> {
        let mut arrays = vec![
            bytemuck::cast_slice_mut(&mut self.points),
            bytemuck::cast_slice_mut(&mut self.direct),
            bytemuck::cast_slice_mut(&mut self.pilot_samples),
            &mut self.direct_budgets[..],
            bytemuck::cast_slice_mut(&mut self.log2_shares),
        ];
        if known & DRAWN == DRAWN {
            arrays.extend([
                bytemuck::cast_slice_mut(&mut self.drawn),
                bytemuck::cast_slice_mut(&mut self.taken),
                bytemuck::cast_slice_mut(&mut self.sums),
                bytemuck::cast_slice_mut(&mut self.hit_sums),
            ]);
        }
        arrays
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: SumKinds = SumKinds { layers: 3, sampled: 2, hit_lights: 1 };

    #[test]
    fn a_block_reads_back_whole() {
        let mut state = BlockState::empty(4, KINDS);
        state.round = 2;
        state.log2_shares = vec![-1, 0, 1, 3];
        state.drawn = vec![1, 2, 4, 16];
        state.points = vec![1, 2, 3, 16];
        state.pilot_samples = vec![Direct { drawn: 3, ..Direct::default() }; 8];
        state.direct_budgets = vec![1; 8];
        state.taken = vec![[1, 2], [3, 4], [5, 6], [7, 8]];
        state.direct[7].add(Rgb::new(1.0, 2.0, 3.0));
        state.hit_sums[5] = Rgb::new(0.5, 0.25, 2.0);
        for (i, s) in state.sums.iter_mut().enumerate() {
            *s = Rgb::new(i as f32, 0.5 * i as f32, -1.0);
        }
        let bytes = state.to_bytes(KINDS);
        assert_eq!(BlockState::from_bytes(&bytes, 4, KINDS), Some(state));
        // One of another size, or cut short, is not taken for it.
        let others = [
            (3, KINDS),
            (4, SumKinds { layers: 2, ..KINDS }),
            (4, SumKinds { sampled: 1, ..KINDS }),
            (4, SumKinds { hit_lights: 2, ..KINDS }),
        ];
        for (texels, kinds) in others {
            assert_eq!(BlockState::from_bytes(&bytes, texels, kinds), None);
        }
        assert!((0..bytes.len()).all(|end| BlockState::from_bytes(&bytes[..end], 4, KINDS).is_none()));
        // Before the first round sums take no bytes.
        let empty = BlockState::empty(4, KINDS);
        assert!(
            empty.arrays(0).iter().map(|array| array.len()).sum::<usize>()
                == empty.direct.len() * size_of::<Direct>()
        );
        assert_eq!(BlockState::from_bytes(&empty.to_bytes(KINDS), 4, KINDS), Some(empty));
    }

    #[test]
    fn only_what_varies_is_worth_more_samples() {
        let mut d = Direct::default();
        assert!(!d.varies());
        (0..4).for_each(|_| d.add(Rgb::splat(2.0)));
        assert!(!d.varies());
        d.add(Rgb::ZERO);
        assert!(d.varies());
        let mut dark = Direct::default();
        (0..4).for_each(|_| dark.add(Rgb::ZERO));
        assert!(!dark.varies());
    }
}
