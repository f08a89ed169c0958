//! The network: two hidden layers of 64, on the same blocks of samples and matrix products as NDGI's trainer.

use super::{Preset, SETS};
use crate::lanes::Lanes;
use crate::train::step::network::{Rows, To, column_sums, outer, product};
use crate::train::targets::Random;
use bytemuck::{Pod, Zeroable};

/// Inputs, with room to spare.
pub(super) const INPUTS: usize = 96;
pub(super) const HIDDEN: usize = 64;
/// Outputs: RGB of each frame, and a spare one.
pub(super) const OUTPUTS: usize = 16;

/// W₁ b₁ W₂ b₂ W₃ b₃, a row of each matrix per input.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Weights {
    w1: [[f32; HIDDEN]; INPUTS],
    b1: [f32; HIDDEN],
    w2: [[f32; HIDDEN]; HIDDEN],
    b2: [f32; HIDDEN],
    w3: [[f32; OUTPUTS]; HIDDEN],
    b3: [f32; OUTPUTS],
}

impl Weights {
    /// Zeros.
    pub(super) fn zeros() -> Box<Self> {
        bytemuck::zeroed_box()
    }

    /// Uniform in ±√(6 ÷ inputs of the layer) (He et al. 2015), biases 0, outputs at one half.
    pub(super) fn initial(inputs: usize, random: &mut Random) -> Box<Self> {
        let mut weights = Self::zeros();
        let mut fill = |rows: &mut [f32], inputs: usize| {
            let bound = (6.0 / inputs as f32).sqrt();
            rows.iter_mut().for_each(|w| *w = random.uniform(-bound, bound));
        };
        fill(weights.w1[..inputs].as_flattened_mut(), inputs);
        fill(weights.w2.as_flattened_mut(), HIDDEN);
        fill(weights.w3.as_flattened_mut(), 6 * HIDDEN);
        weights.b3 = [0.5; OUTPUTS];
        weights
    }

    /// How many a preset's decoder stores.
    pub(super) fn stored(preset: &Preset) -> usize {
        let inputs = preset.inputs();
        (inputs + 1) * HIDDEN + (HIDDEN + 1) * HIDDEN + (HIDDEN + 1) * 3 * SETS
    }

    pub(super) fn flat(&self) -> &[f32] {
        bytemuck::cast_slice(std::slice::from_ref(self))
    }

    pub(super) fn flat_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(std::slice::from_mut(self))
    }
}

impl Preset {
    /// Inputs of the network: four cells, the low-resolution grid, the position.
    pub(crate) fn inputs(&self) -> usize {
        4 * self.features[0] + self.features[1] + 12
    }
}

/// The matrices the other way round, for gradients.
pub(super) struct Transposed {
    w1: Box<[[f32; INPUTS]; HIDDEN]>,
    w2: Box<[[f32; HIDDEN]; HIDDEN]>,
    w3: Box<[[f32; HIDDEN]; OUTPUTS]>,
}

impl Transposed {
    pub(super) fn new(weights: &Weights) -> Self {
        Transposed { w1: transposed(&weights.w1), w2: transposed(&weights.w2), w3: transposed(&weights.w3) }
    }
}

fn transposed<const I: usize, const O: usize>(matrix: &[[f32; O]; I]) -> Box<[[f32; I]; O]> {
    let mut columns = Box::new([[0.0; I]; O]);
    for (i, row) in matrix.iter().enumerate() {
        row.iter().zip(columns.iter_mut()).for_each(|(w, column)| column[i] = *w);
    }
    columns
}

/// Hidden values of a block, and slopes of their activations.
pub(super) struct Trace {
    h1: Rows<HIDDEN>,
    slope1: Rows<HIDDEN>,
    h2: Rows<HIDDEN>,
    slope2: Rows<HIDDEN>,
}

impl Trace {
    pub(super) fn new() -> Self {
        Trace { h1: Rows::new(), slope1: Rows::new(), h2: Rows::new(), slope2: Rows::new() }
    }
}

impl Weights {
    /// The outputs of a block of inputs.
    #[inline(always)]
    pub(super) fn forward<V: Lanes>(&self, x: &Rows<INPUTS>, trace: &mut Trace) -> Rows<OUTPUTS> {
        let Trace { h1, slope1, h2, slope2 } = trace;
        product::<V, INPUTS, HIDDEN>(x, &self.w1, Some(&self.b1), To::Gelu(h1, slope1));
        product::<V, HIDDEN, HIDDEN>(h1, &self.w2, Some(&self.b2), To::Gelu(h2, slope2));
        let mut y = Rows::new();
        product::<V, HIDDEN, OUTPUTS>(h2, &self.w3, Some(&self.b3), To::Rows(&mut y));
        y
    }
}

/// From ∂L/∂y: adds to the weights' gradient, and gives ∂L/∂x where it is wanted.
#[inline(always)]
pub(super) fn backward<V: Lanes>(
    transposed: &Transposed,
    x: &Rows<INPUTS>,
    trace: &Trace,
    dy: &Rows<OUTPUTS>,
    gradient: &mut Weights,
    dx: Option<&mut Rows<INPUTS>>,
) {
    let (mut d2, mut d1) = (Rows::new(), Rows::new());
    outer::<V, 8, HIDDEN, OUTPUTS>(&trace.h2, dy, &mut gradient.w3);
    column_sums::<V, OUTPUTS>(dy, &mut gradient.b3);
    product::<V, OUTPUTS, HIDDEN>(dy, &transposed.w3, None, To::Scaled(&mut d2, &trace.slope2));
    outer::<V, 8, HIDDEN, HIDDEN>(&trace.h1, &d2, &mut gradient.w2);
    column_sums::<V, HIDDEN>(&d2, &mut gradient.b2);
    product::<V, HIDDEN, HIDDEN>(&d2, &transposed.w2, None, To::Scaled(&mut d1, &trace.slope1));
    outer::<V, 8, INPUTS, HIDDEN>(x, &d1, &mut gradient.w1);
    column_sums::<V, HIDDEN>(&d1, &mut gradient.b1);
    if let Some(dx) = dx {
        product::<V, HIDDEN, INPUTS>(&d1, &transposed.w1, None, To::Rows(dx));
    }
}
