//! A set of planes: one light source of one tile, as it is coded.

use super::coefficients::{BLOCK, Model, Wanted};
use super::range::{Coder, Context, Reader, Writer};

/// Most planes of a set.
pub const MOST_PLANES: usize = 64;
/// Most planes of all sets of a tile: they bound the memory that a few bytes can ask for.
pub const MOST_PLANES_OF_TILE: usize = 1024;

/// The planes of one light source of one tile as whole numbers, just as they are stored. A frame that the
/// source lights has three rows: luminance and two colour differences.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PlaneSet {
    /// 0 for daylight, or all light that is not apart; g + 1 for light group g.
    pub source: u16,
    /// True if planes hold light over its mean, not the square root.
    pub is_linear: bool,
    /// A coefficient's step is 2^(−step/8).
    pub step: u8,
    /// Colour differences are stored times this over 16; at least 1.
    pub chroma: u8,
    /// Per frame: its weight is 2^(weight/8); at most 0.
    pub weights: Vec<i32>,
    /// Per plane: its factors are in units of 2^(−scale/8).
    pub scales: Vec<u8>,
    /// Per plane and row: how much of the plane the row has.
    pub factors: Vec<i32>,
    /// Blocks of 8×8, row by row: whether any texel of it is used.
    pub covered: Vec<bool>,
    /// Per plane and block, row · 8 + column of frequencies.
    pub coefficients: Vec<[i16; BLOCK]>,
}

/// Contexts of all but coefficients.
#[derive(Debug)]
struct Side {
    weights: [Context; 24],
    /// Of the first frame, and of differences to the frame before.
    factors: [[Context; 24]; 2],
    covered: [Context; 4],
}

impl Default for Side {
    fn default() -> Self {
        let c = Context::default();
        Side { weights: [c; 24], factors: [[c; 24]; 2], covered: [c; 4] }
    }
}

impl PlaneSet {
    /// A set of `planes` planes and `frames` frames on `blocks` blocks, all zero.
    fn zeros(planes: usize, frames: usize, blocks: usize) -> Self {
        PlaneSet {
            weights: vec![0; frames],
            scales: vec![0; planes],
            factors: vec![0; planes * 3 * frames],
            covered: vec![false; blocks],
            coefficients: vec![[0; BLOCK]; planes * blocks],
            ..PlaneSet::default()
        }
    }

    /// Number of planes.
    pub fn planes(&self) -> usize {
        self.scales.len()
    }

    /// Its bytes; [`PlaneSet::source`], [`PlaneSet::is_linear`] and the number of planes are stored
    /// elsewhere.
    pub(super) fn encode(&self, columns: usize) -> Vec<u8> {
        let mut writer = Writer::default();
        let mut set = self.clone();
        for (i, block) in set.coefficients.iter_mut().enumerate() {
            // Neighbours see what is not covered as zeros.
            if !self.covered[i % self.covered.len()] {
                *block = [0; BLOCK];
            }
        }
        set.walk(&mut writer, columns, None);
        writer.finish()
    }

    /// Chooses its coefficients, by what they should be in steps and the error in squared steps that a bit is
    /// worth, and gives its bytes.
    pub(super) fn encode_towards(&mut self, exact: &[[f32; BLOCK]], lambda: f32, columns: usize) -> Vec<u8> {
        let mut writer = Writer::default();
        self.coefficients = vec![[0; BLOCK]; exact.len()];
        self.walk(&mut writer, columns, Some(Wanted { exact, lambda }));
        writer.finish()
    }

    /// A set from its bytes.
    ///
    /// # Errors
    /// A message for a number that the format forbids, or bytes that are left.
    pub(super) fn decode(
        bytes: &[u8],
        [planes, frames]: [usize; 2],
        [columns, rows]: [usize; 2],
    ) -> Result<Self, String> {
        let mut set = PlaneSet::zeros(planes, frames, columns * rows);
        let mut reader = Reader::new(bytes);
        set.walk(&mut reader, columns, None);
        if reader.read() < bytes.len() {
            return Err(format!("{} bytes behind the last coefficient", bytes.len() - reader.read()));
        }
        set.check()?;
        Ok(set)
    }

    /// The rules on values, the same for writing and reading.
    pub(super) fn check(&self) -> Result<(), String> {
        if self.chroma == 0 {
            return Err("colour differences times 0".to_owned());
        }
        if let Some(weight) = self.weights.iter().find(|weight| !(-255..=0).contains(*weight)) {
            return Err(format!("weight {weight}; expected −255 to 0"));
        }
        let limit = 1 << 24;
        if let Some(factor) = self.factors.iter().find(|factor| factor.unsigned_abs() > limit) {
            return Err(format!("factor {factor}; expected at most {limit}"));
        }
        Ok(())
    }

    /// Writes all numbers, or reads them.
    fn walk(&mut self, coder: &mut impl Coder, columns: usize, wanted: Option<Wanted>) {
        let mut side = Side::default();
        self.step = coder.raw(8, u32::from(self.step)) as u8;
        self.chroma = coder.raw(8, u32::from(self.chroma)) as u8;
        for scale in &mut self.scales {
            *scale = coder.raw(8, u32::from(*scale)) as u8;
        }
        let mut before = 0;
        for weight in &mut self.weights {
            *weight = difference(coder, &mut side.weights, before, *weight);
            before = *weight;
        }
        let frames = self.weights.len();
        for factors in self.factors.chunks_exact_mut(3 * frames.max(1)) {
            series(coder, &mut side.factors, factors, frames);
        }
        for i in 0..self.covered.len() {
            let left = !i.is_multiple_of(columns) && self.covered[i - 1];
            let above = i >= columns && self.covered[i - columns];
            let context = usize::from(left) + 2 * usize::from(above);
            self.covered[i] = coder.bit(&mut side.covered[context], self.covered[i]);
        }
        let mut model = Model::default();
        let (blocks, mut diagonals) = (self.covered.len(), Vec::new());
        for k in 0..self.scales.len() {
            let (before, plane) = self.coefficients.split_at_mut(k * blocks);
            let before = (k > 0).then(|| (&before[(k - 1) * blocks..], &diagonals[..]));
            let wanted =
                wanted.map(|wanted| Wanted { exact: &wanted.exact[k * blocks..][..blocks], ..wanted });
            diagonals = model.plane(coder, columns, &self.covered, before, &mut plane[..blocks], wanted);
        }
    }
}

fn difference(coder: &mut impl Coder, contexts: &mut [Context], before: i32, value: i32) -> i32 {
    before.wrapping_add(coder.signed(contexts, value.wrapping_sub(before)))
}

/// Numbers by frame and component, as differences along the frames.
fn series(coder: &mut impl Coder, contexts: &mut [[Context; 24]; 2], values: &mut [i32], frames: usize) {
    for component in 0..3 {
        let mut before = 0;
        for frame in 0..frames {
            let value = &mut values[3 * frame + component];
            *value = difference(coder, &mut contexts[usize::from(frame > 0)], before, *value);
            before = *value;
        }
    }
}
