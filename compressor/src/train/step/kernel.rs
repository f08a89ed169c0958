//! The loops over samples and parameters, compiled once per instruction set.

use super::gather::{FeatureGradient, Features, Samples, gather, scatter};
use super::network::{CHUNK, FEATURE_ROW, Network, NetworkGradient, Rows, Trace};
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, Avx512};
use crate::lanes::{Instructions, Lanes, Longest, Quad, Tier, TwoQuads, prefetch};
use crate::model::{FEATURES, Shape};
use crate::train::targets::features::{CENTRE_SLOPE, centred, corners, two_mut};
use crate::train::targets::{Problem, Texel};

/// Largest loss weight of a sample's channel, before that of its texel.
pub(crate) const WEIGHT_CAP: f32 = 20.0;

/// A loop that is generic over the instruction set.
pub(crate) trait Kernel {
    /// What it computes.
    type Output;
    /// Must be `#[inline(always)]`, so that it is compiled with the caller's instruction set.
    fn run<V: Longest>(self) -> Self::Output;
}

/// Runs a kernel with an instruction set.
pub(crate) fn run<K: Kernel>(tier: Tier, kernel: K) -> K::Output {
    match tier.instructions() {
        Instructions::Portable => kernel.run::<Quad>(),
        // SAFETY: only `Tier::available` makes this tier, after asking the processor.
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2 => unsafe { run_avx2(kernel) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx512 => unsafe { run_avx512(kernel) },
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx512>()
}

/// Which parameters a training step moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scope {
    /// Everything.
    All,
    /// F_ut, F_vt and the decoder network.
    Planes,
    /// The decoder network.
    Network,
}

/// Uniform noise of ±½/256 of a feature (centred), in rows of one sample's features, of those that the tile
/// has.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    rows: Vec<[f32; FEATURE_ROW]>,
}

impl Noise {
    const ROWS: usize = 1024;

    /// A table to take runs of rows from.
    pub(crate) fn new(shape: &Shape, random: &mut crate::train::targets::Random) -> Self {
        let half = 0.5 / 256.0 * CENTRE_SLOPE;
        let [uvt, uv, ut, vt, ..] = shape.columns().map(|columns| !columns.is_empty());
        let there: [bool; FEATURES] = [uvt, uvt, uvt, uvt, uv, uv, uv, uv, ut, ut, vt, vt];
        let mut row = || {
            std::array::from_fn(|i| match there.get(i) {
                Some(true) => random.uniform(-half, half),
                _ => 0.0,
            })
        };
        Noise { rows: (0..Self::ROWS + CHUNK).map(|_| row()).collect() }
    }

    #[inline(always)]
    fn run(&self, salt: u64) -> &[[f32; FEATURE_ROW]] {
        let start = (salt.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 54) as usize % Self::ROWS;
        &self.rows[start..start + CHUNK]
    }
}

/// Loss and gradient of a batch. The loss is Σ w (y − target)², the gradient that of half of it times
/// `scale`.
pub(crate) struct Batch<'a, const H: usize> {
    pub problem: &'a Problem,
    pub features: Features<'a>,
    pub network: &'a Network<H>,
    pub samples: &'a [Samples<'a>],
    /// Noise on the features, and what picks it.
    pub noise: Option<(&'a Noise, u64)>,
    /// The features' gradient is added here,
    pub of_features: FeatureGradient<'a>,
    /// and the network's.
    pub of_network: &'a mut NetworkGradient<H>,
    /// What has a gradient.
    pub scope: Scope,
    /// Factor of the gradient.
    pub scale: f32,
}

impl<const H: usize> Kernel for Batch<'_, H> {
    type Output = f64;
    #[inline(always)]
    fn run<V: Longest>(mut self) -> f64 {
        let mut trace = Trace::new();
        let (mut x, mut dx) = (Rows::new(), Rows::new());
        let mut loss = 0.0;
        for (b, samples) in self.samples.iter().enumerate() {
            // The targets of all frames do not fit the near caches: they are requested one by one, for a
            // cache waits for few.
            let targets = self.problem.targets_at(samples.point);
            let ask = |texel: Texel| prefetch(&targets[texel.index()]);
            gather::<V>(&self.features, self.problem, samples, &mut x, ask);
            if let Some((noise, salt)) = self.noise {
                for (x, n) in x.iter_mut().zip(noise.run(salt.wrapping_add(b as u64))) {
                    for lane in (0..FEATURE_ROW).step_by(V::N) {
                        V::load(&x[lane..]).add(V::load(&n[lane..])).store(&mut x[lane..]);
                    }
                }
            }
            let mut y = self.network.forward::<V>(&x, samples.point, &mut trace);
            let point = &self.problem.points[samples.point];
            let mut sum = [0.0; 4];
            for (y, texel) in y.iter_mut().zip(samples.texels) {
                let (r, w) = residual(*y, targets[texel.index()], &point.base, &point.slope);
                let weighted = r.mul(w);
                sum = weighted.mul_add(r, sum);
                *y = weighted.mul(Quad::splat(self.scale));
            }
            y[samples.texels.len()..].fill([0.0; 4]);
            loss += f64::from(sum[0] + sum[1] + sum[2]);
            let wanted = (self.scope != Scope::Network).then_some(&mut dx);
            self.network.backward::<V>(&x, samples.point, &trace, &y, self.of_network, wanted);
            if self.scope != Scope::Network {
                let planes_alone = self.scope == Scope::Planes;
                scatter::<V>(&self.features, self.problem, samples, &dx, &mut self.of_features, planes_alone);
            }
        }
        loss
    }
}

/// Residual and weight of the three channels (fourth lane: weight 0). A negative y is as good as 0 where 0 is
/// requested; the residual of a y that is not a number stays not a number.
#[inline(always)]
pub(crate) fn residual(y: Quad, target: Quad, base: &Quad, slope: &Quad) -> (Quad, Quad) {
    // r = y − target, or max(y, 0) for a target of 0: the floor is 0 there and −∞, nearly, elsewhere (targets
    // are never negative).
    let floor = target.mul(Quad::splat(-f32::MAX)).min(Quad::splat(0.0));
    // In this order: `max` gives its argument where one of the two is not a number.
    let r = floor.max(std::array::from_fn(|c| y[c] - target[c]));
    let w = slope.mul_add(target, *base).min(Quad::splat(WEIGHT_CAP)).mul(Quad::splat(target[3]));
    (r, [w[0], w[1], w[2], 0.0])
}

/// Squared error in linear light, summed over texels and channels, per time point, of the given texels.
pub(crate) struct SquaredErrors<'a, const H: usize> {
    pub problem: &'a Problem,
    pub features: Features<'a>,
    pub network: &'a Network<H>,
    /// This many of the problem's time points.
    pub points: usize,
    /// On these texels.
    pub texels: &'a [Texel],
}

impl<const H: usize> Kernel for SquaredErrors<'_, H> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<V: Longest>(self) -> Vec<f64> {
        let mut trace = Trace::new();
        let mut x = Rows::new();
        let mut sums = Vec::with_capacity(self.points);
        let coding = self.problem.coding;
        for (a, point) in self.problem.points[..self.points].iter().enumerate() {
            let targets = self.problem.targets_at(a);
            let mut sum = 0.0;
            for texels in self.texels.chunks(CHUNK) {
                let samples = Samples { point: a, texels };
                gather::<V>(&self.features, self.problem, &samples, &mut x, |_| ());
                let y = self.network.forward::<V>(&x, samples.point, &mut trace);
                for (y, texel) in y.iter().zip(texels) {
                    let target = targets[texel.index()];
                    for c in 0..3 {
                        // Not `max`, which would show what is not a number as 0.
                        let shown = if y[c] < 0.0 { 0.0 } else { f64::from(y[c]) };
                        let wanted = f64::from(target[c]);
                        let error = f64::from(point.means[c]) * (coding.light(shown) - coding.light(wanted));
                        sum += error * error;
                    }
                }
            }
            sums.push(sum);
        }
        sums
    }
}

/// The loss Σ w r² over each 4×4 block of F_uv, texels by their weight in blocks.
pub(crate) struct BlockLosses<'a, const H: usize> {
    pub problem: &'a Problem,
    pub features: Features<'a>,
    pub network: &'a Network<H>,
    pub samples: &'a [Samples<'a>],
    pub blocks: usize,
}

impl<const H: usize> Kernel for BlockLosses<'_, H> {
    type Output = Vec<f32>;
    #[inline(always)]
    fn run<V: Longest>(self) -> Vec<f32> {
        let mut trace = Trace::new();
        let mut x = Rows::new();
        let mut losses = vec![0.0; self.blocks];
        for samples in self.samples {
            gather::<V>(&self.features, self.problem, samples, &mut x, |_| ());
            let y = self.network.forward::<V>(&x, samples.point, &mut trace);
            let point = &self.problem.points[samples.point];
            let targets = self.problem.targets_at(samples.point);
            for (y, &texel) in y.iter().zip(samples.texels) {
                let (r, w) = residual(*y, targets[texel.index()], &point.base, &point.slope);
                let loss = r.mul(r).mul(w);
                let (column, row) = self.problem.sites(texel);
                losses[(column.uv + row.uv) / 16] +=
                    self.problem.weight_in_blocks(texel) * (loss[0] + loss[1] + loss[2]);
            }
        }
        losses
    }
}

/// y and its derivatives with respect to the features for one chunk.
#[derive(Debug)]
pub(crate) struct Linearised {
    /// Three channels and a zero.
    pub y: Rows<4>,
    /// ∂y_c/∂x
    pub jacobian: [Rows<FEATURE_ROW>; 3],
}

/// Linearises the decoder network on chunks of samples and hands each to a function.
pub(crate) struct Linearise<'a, const H: usize, F> {
    pub problem: &'a Problem,
    pub features: Features<'a>,
    pub network: &'a Network<H>,
    /// The time point and the texels.
    pub samples: &'a [Samples<'a>],
    /// Called for each chunk in turn.
    pub each: F,
}

impl<const H: usize, F: FnMut(&Samples, &Linearised)> Kernel for Linearise<'_, H, F> {
    type Output = ();
    #[inline(always)]
    fn run<V: Longest>(mut self) {
        let mut trace = Trace::new();
        let mut x = Rows::new();
        let mut out = Linearised { y: Rows::new(), jacobian: [Rows::new(); 3] };
        for samples in self.samples {
            gather::<V>(&self.features, self.problem, samples, &mut x, |_| ());
            out.y = self.network.forward::<V>(&x, samples.point, &mut trace);
            self.network.jacobian::<V>(&trace, &mut out.jacobian);
            (self.each)(samples, &out);
        }
    }
}

/// Makes a centred map of its endpoints and weights.
pub(crate) struct InterpolateBlocks<'a> {
    pub endpoints: &'a [f32],
    pub weights: &'a [f32],
    /// Texels of a row; 4 block by block.
    pub across: usize,
    /// What to overwrite.
    pub map: &'a mut [Quad],
}

impl Kernel for InterpolateBlocks<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Longest>(self) {
        let InterpolateBlocks { endpoints, weights, across, map } = self;
        if weights.is_empty() {
            // Texel by texel, or no map.
            let (texels, _) = endpoints.as_chunks::<64>();
            for (texels, corner) in texels.iter().zip(corners(across)) {
                let (texels, _) = texels.as_chunks::<4>();
                for (i, f) in texels.iter().enumerate() {
                    map[corner + i / 4 * across + i % 4] = f.map(centred);
                }
            }
            return;
        }
        let (endpoints, _) = endpoints.as_chunks::<8>();
        let (weights, _) = weights.as_chunks::<16>();
        for ((e, w), corner) in endpoints.iter().zip(weights).zip(corners(across)) {
            let e0: Quad = std::array::from_fn(|c| centred(e[c]));
            let d: Quad = std::array::from_fn(|c| CENTRE_SLOPE * (e[4 + c] - e[c]));
            let (e0, d) = (V::Eight::twice(V::Four::load(&e0)), V::Eight::twice(V::Four::load(&d)));
            let (pairs, _) = w.as_chunks::<2>();
            for (i, pair) in pairs.iter().enumerate() {
                let texels = V::Eight::spread(*pair).mul_add(d, e0);
                texels.store(two_mut(map, corner + i / 2 * across + i % 2 * 2));
            }
        }
    }
}

/// Brings the gradient from a centred map to its endpoints and weights, and zeroes the former.
pub(crate) struct BackpropagateBlocks<'a> {
    pub endpoints: &'a [f32],
    pub weights: &'a [f32],
    /// Texels of a row; 4 block by block.
    pub across: usize,
    /// Gradient with respect to the map.
    pub map: &'a mut [Quad],
    /// Gradient with respect to endpoints and then weights: overwritten.
    pub gradient: &'a mut [f32],
}

impl Kernel for BackpropagateBlocks<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Longest>(self) {
        let BackpropagateBlocks { endpoints, weights, across, map, gradient } = self;
        let (d_endpoints, d_weights) = gradient.split_at_mut(endpoints.len());
        if weights.is_empty() {
            let (d_texels, _) = d_endpoints.as_chunks_mut::<64>();
            for (d_texels, corner) in d_texels.iter_mut().zip(corners(across)) {
                let (d_texels, _) = d_texels.as_chunks_mut::<4>();
                for (i, d) in d_texels.iter_mut().enumerate() {
                    let g = std::mem::take(&mut map[corner + i / 4 * across + i % 4]);
                    *d = g.map(|g| CENTRE_SLOPE * g);
                }
            }
            return;
        }
        let (endpoints, _) = endpoints.as_chunks::<8>();
        let (weights, _) = weights.as_chunks::<16>();
        let (d_endpoints, _) = d_endpoints.as_chunks_mut::<8>();
        let (d_weights, _) = d_weights.as_chunks_mut::<16>();
        let zero = V::Eight::splat(0.0);
        for ((((e, w), de), dw), corner) in
            endpoints.iter().zip(weights).zip(d_endpoints).zip(d_weights).zip(corners(across))
        {
            let d: Quad = std::array::from_fn(|c| CENTRE_SLOPE * (e[4 + c] - e[c]));
            let d = V::Eight::twice(V::Four::load(&d));
            // ∂e₁ = Σ w g, ∂e₀ = Σ g − ∂e₁, ∂w = g · (e₁ − e₀)
            let (mut all, mut second) = (zero, zero);
            let (pairs, _) = w.as_chunks::<2>();
            for (half, dw) in dw.chunks_exact_mut(8).enumerate() {
                let mut products = [zero; 4];
                for (k, product) in products.iter_mut().enumerate() {
                    let i = 4 * half + k;
                    let texels = two_mut(map, corner + i / 2 * across + i % 2 * 2);
                    let g = V::Eight::load(texels);
                    zero.store(texels);
                    all = all.add(g);
                    second = V::Eight::spread(pairs[i]).mul_add(g, second);
                    *product = g.mul(d);
                }
                V::Eight::sums(products).store(dw);
            }
            let slope = V::Four::splat(CENTRE_SLOPE);
            let second = second.folded().mul(slope);
            second.store(&mut de[4..]);
            second.mul_add(V::Four::splat(-1.0), all.folded().mul(slope)).store(&mut de[..4]);
        }
    }
}

/// 1/√x to 5e-6 for positive x: the exponent's half as a first guess and two of Newton's steps, which takes a
/// third of the time of a square root and a division and is the same on every machine.
#[inline(always)]
fn inverse_root(x: f32) -> f32 {
    let guess = f32::from_bits(0x5f37_59dfu32.wrapping_sub(x.to_bits() >> 1));
    let better = guess * (1.5 - 0.5 * x * guess * guess);
    better * (1.5 - 0.5 * x * better * better)
}

/// One step of Adam (Kingma and Ba 2014, algorithm 1, ε = 10⁻⁸ inside the root) on a range of parameters.
pub(crate) struct Adam<'a> {
    /// θ
    pub params: &'a mut [f32],
    /// g, zeroed on the way.
    pub gradient: &'a mut [f32],
    /// m
    pub mean: &'a mut [f32],
    /// v
    pub square: &'a mut [f32],
    /// β₁, β₂
    pub beta: [f32; 2],
    /// Learning rate over 1 − β₁ᵗ, and 1 over 1 − β₂ᵗ.
    pub corrected: [f32; 2],
    /// Bounds of θ after the step.
    pub bounds: [f32; 2],
}

impl Kernel for Adam<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Longest>(self) {
        let [b1, b2] = self.beta;
        let [rate, correction] = self.corrected;
        let [low, high] = self.bounds;
        let points = self.mean.iter_mut().zip(self.square);
        for ((p, g), (m, v)) in self.params.iter_mut().zip(self.gradient).zip(points) {
            let g = std::mem::take(g);
            *m = b1 * *m + (1.0 - b1) * g;
            *v = b2 * *v + (1.0 - b2) * g * g;
            let step = rate * *m * inverse_root(*v * correction + 1e-16);
            // Written so that a step that is not a number stays one and is noticed.
            let moved = *p - step;
            *p = if moved < low {
                low
            } else if moved > high {
                high
            } else {
                moved
            };
        }
    }
}
