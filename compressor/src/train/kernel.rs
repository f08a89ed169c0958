//! The loops over samples and parameters, compiled once per instruction set.

use super::features::{Layout, Maps};
use super::network::{BLOCK, FEATURE_ROW, Network, NetworkGradient, Rows, Trace};
use super::problem::Problem;
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, Avx512};
use crate::lanes::{Instructions, Lanes, Quad, Tier, prefetch};
use crate::model::{FEATURES, Shape};

/// Largest loss weight of a sample's channel, before that of its texel.
pub const WEIGHT_CAP: f32 = 20.0;

/// A loop that is generic over the instruction set.
pub trait Kernel {
    /// What it computes.
    type Output;
    /// Must be `#[inline(always)]`, so that it is compiled with the caller's instruction set.
    fn run<V: Lanes>(self) -> Self::Output;
}

/// Runs a kernel with an instruction set.
pub fn run<K: Kernel>(tier: Tier, kernel: K) -> K::Output {
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

/// Samples of one moment: indices into the problem's texels.
#[derive(Clone, Copy, Debug)]
pub struct Samples {
    /// Index into the problem's moments.
    pub moment: usize,
    /// Texels; the last is repeated to fill a block.
    pub texels: [u32; BLOCK],
    /// How many count.
    pub count: usize,
}

impl Samples {
    /// Up to a block of texels at one moment.
    pub fn new(moment: usize, texels: &[u32]) -> Self {
        let last = texels.len() - 1;
        Samples {
            moment,
            texels: std::array::from_fn(|s| texels[s.min(last)]),
            count: texels.len().min(BLOCK),
        }
    }
}

/// Which parameters a training step moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Everything.
    All,
    /// F_ut, F_vt and the decoder.
    Planes,
    /// The decoder.
    Decoder,
}

/// Gradients of a batch.
#[derive(Debug)]
pub struct Gradient<const H: usize> {
    /// With respect to the centred maps.
    pub maps: Maps,
    /// With respect to the decoder's weights.
    pub network: NetworkGradient<H>,
}

/// Uniform noise of ±½/256 of a feature (centred), in rows of one sample's features, of those that the tile has.
#[derive(Clone, Debug)]
pub struct Noise {
    rows: Vec<[f32; FEATURE_ROW]>,
}

impl Noise {
    const ROWS: usize = 1024;

    /// A table to take runs of rows from.
    pub fn new(shape: &Shape, random: &mut super::random::Random) -> Self {
        let half = 0.5 / 256.0 * super::features::CENTRE_SLOPE;
        let [uvt, uv, ut, vt, ..] = shape.columns().map(|columns| !columns.is_empty());
        let there: [bool; FEATURES] = [uvt, uvt, uvt, uvt, uv, uv, uv, uv, ut, ut, vt, vt];
        let mut row = || {
            std::array::from_fn(|i| match there.get(i) {
                Some(true) => random.uniform(-half, half),
                _ => 0.0,
            })
        };
        Noise { rows: (0..Self::ROWS + BLOCK).map(|_| row()).collect() }
    }

    #[inline(always)]
    fn run(&self, salt: u64) -> &[[f32; FEATURE_ROW]] {
        let start = (salt.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 54) as usize % Self::ROWS;
        &self.rows[start..start + BLOCK]
    }
}

/// Loss and gradient of a batch. The loss is Σ w (y − target)², the gradient that of half of it times `scale`.
pub struct Batch<'a, const H: usize> {
    /// The tile.
    pub problem: &'a Problem,
    /// Its features.
    pub maps: &'a Maps,
    /// Its decoder.
    pub network: &'a Network<H>,
    /// The samples.
    pub samples: &'a [Samples],
    /// Noise on the features, and what picks it.
    pub noise: Option<(&'a Noise, u64)>,
    /// Gradients are added here.
    pub gradient: &'a mut Gradient<H>,
    /// What has a gradient.
    pub scope: Scope,
    /// Factor of the gradient.
    pub scale: f32,
}

impl<const H: usize> Kernel for Batch<'_, H> {
    type Output = f64;
    #[inline(always)]
    fn run<V: Lanes>(self) -> f64 {
        let mut trace = Trace::new();
        let (mut x, mut dx) = (Rows::new(), Rows::new());
        let mut loss = 0.0;
        for (b, samples) in self.samples.iter().enumerate() {
            gather(self.problem, self.maps, samples, &mut x);
            if let Some((noise, salt)) = self.noise {
                for (x, n) in x.iter_mut().zip(noise.run(salt.wrapping_add(b as u64))) {
                    for lane in (0..FEATURE_ROW).step_by(V::N) {
                        V::load(&x[lane..]).add(V::load(&n[lane..])).store(&mut x[lane..]);
                    }
                }
            }
            let mut y = self.network.forward::<V>(&x, samples.moment, &mut trace);
            // The targets of all sets do not fit the near caches: ask for those of the next block now.
            if let Some(next) = self.samples.get(b + 1) {
                let targets = &self.problem.targets[next.moment * self.problem.texels.len()..];
                next.texels.iter().for_each(|&t| prefetch(&targets[t as usize]));
            }
            let moment = &self.problem.moments[samples.moment];
            let targets = &self.problem.targets[samples.moment * self.problem.texels.len()..];
            let mut sum = [0.0; 4];
            for s in 0..BLOCK {
                let target = targets[samples.texels[s] as usize];
                let (r, w) = residual(y[s], target, &moment.base, &moment.slope);
                let w = if s < samples.count { w } else { [0.0; 4] };
                let weighted = r.mul(w);
                sum = weighted.mul_add(r, sum);
                y[s] = weighted.mul(Quad::splat(self.scale));
            }
            loss += f64::from(sum[0] + sum[1] + sum[2]);
            let wanted = (self.scope != Scope::Decoder).then_some(&mut dx);
            self.network.backward::<V>(&x, samples.moment, &trace, &y, &mut self.gradient.network, wanted);
            if self.scope != Scope::Decoder {
                scatter(self.problem, samples, &dx, &mut self.gradient.maps, self.scope);
            }
        }
        loss
    }
}

/// Residual and weight of the three channels (fourth lane: weight 0). A negative y is as good as 0 where 0 is asked for; the
/// residual of a y that is not a number is none either.
#[inline(always)]
pub fn residual(y: Quad, target: Quad, base: &Quad, slope: &Quad) -> (Quad, Quad) {
    // Below the target's sign: r = y − target, or max(y, 0) for a target of 0 (targets are never negative).
    let floor = target.mul(Quad::splat(-f32::MAX)).min(Quad::splat(0.0));
    // In this order: `max` gives its argument where one of the two is not a number.
    let r = floor.max(std::array::from_fn(|c| y[c] - target[c]));
    let w = slope.mul_add(target, *base).min(Quad::splat(WEIGHT_CAP)).mul(Quad::splat(target[3]));
    (r, [w[0], w[1], w[2], 0.0])
}

/// The features of a block of samples (paper, fig. 2): V_uvt, V_uv, V_ut, V_vt, of those that the tile has; the rest stays.
#[inline(always)]
fn gather(problem: &Problem, maps: &Maps, samples: &Samples, x: &mut Rows<FEATURE_ROW>) {
    let moment = &problem.moments[samples.moment];
    let has = &problem.shape.contents;
    let line = |plane: &[[f32; 2]], side: usize| samples.moment * side.min(plane.len());
    let ut = &maps.ut[line(&maps.ut, problem.columns.len())..];
    let vt = &maps.vt[line(&maps.vt, problem.rows.len())..];
    let slices = moment.slices.at.map(|at| &maps.uvt[at..]);
    for (x, &t) in x.iter_mut().zip(&samples.texels) {
        let texel = problem.texels[t as usize];
        let (column, row) = (&problem.columns[usize::from(texel.x)], &problem.rows[usize::from(texel.y)]);
        if has.uvt > 0 {
            let mix =
                |a: Quad, b: Quad, f: f32| Quad::splat(f).mul(std::array::from_fn(|c| b[c] - a[c])).add(a);
            let line = |slice: &[Quad], y: usize| {
                mix(slice[column.uvt.at[0] + y], slice[column.uvt.at[1] + y], column.uvt.f)
            };
            let image =
                |slice: &[Quad]| mix(line(slice, row.uvt.at[0]), line(slice, row.uvt.at[1]), row.uvt.f);
            x[..4].copy_from_slice(&mix(image(slices[0]), image(slices[1]), moment.slices.f));
        }
        if has.uv {
            x[4..8].copy_from_slice(&maps.uv[column.uv + row.uv]);
        }
        if has.ut {
            x[8..10].copy_from_slice(&ut[usize::from(texel.x)]);
        }
        if has.vt {
            x[10..12].copy_from_slice(&vt[usize::from(texel.y)]);
        }
    }
}

/// The way back of [`gather`].
#[inline(always)]
fn scatter(problem: &Problem, samples: &Samples, dx: &Rows<FEATURE_ROW>, maps: &mut Maps, scope: Scope) {
    let moment = &problem.moments[samples.moment];
    let has = &problem.shape.contents;
    let (first_ut, first_vt) = (
        samples.moment * problem.columns.len().min(maps.ut.len()),
        samples.moment * problem.rows.len().min(maps.vt.len()),
    );
    let (ut, vt) = (&mut maps.ut[first_ut..], &mut maps.vt[first_vt..]);
    for (d, &t) in dx.iter().zip(&samples.texels) {
        let texel = problem.texels[t as usize];
        if has.ut {
            let to = &mut ut[usize::from(texel.x)];
            *to = [to[0] + d[8], to[1] + d[9]];
        }
        if has.vt {
            let to = &mut vt[usize::from(texel.y)];
            *to = [to[0] + d[10], to[1] + d[11]];
        }
        if scope != Scope::All {
            continue;
        }
        let (column, row) = (&problem.columns[usize::from(texel.x)], &problem.rows[usize::from(texel.y)]);
        if has.uv {
            let uv = &mut maps.uv[column.uv + row.uv];
            *uv = uv.add([d[4], d[5], d[6], d[7]]);
        }
        if has.uvt == 0 {
            continue;
        }
        let d = [d[0], d[1], d[2], d[3]];
        for (slice, fs) in moment.slices.at.into_iter().zip([1.0 - moment.slices.f, moment.slices.f]) {
            let slice = &mut maps.uvt[slice..];
            for (y, fy) in row.uvt.at.into_iter().zip([fs * (1.0 - row.uvt.f), fs * row.uvt.f]) {
                for (x, f) in column.uvt.at.into_iter().zip([fy * (1.0 - column.uvt.f), fy * column.uvt.f]) {
                    slice[x + y] = Quad::splat(f).mul_add(d, slice[x + y]);
                }
            }
        }
    }
}

/// Squared error in linear light, summed over texels and channels, per moment, of the given texels.
pub struct SquaredErrors<'a, const H: usize> {
    /// The tile.
    pub problem: &'a Problem,
    /// Its features.
    pub maps: &'a Maps,
    /// Its decoder.
    pub network: &'a Network<H>,
    /// So many of the problem's moments.
    pub moments: usize,
    /// Indices into the problem's texels.
    pub texels: &'a [u32],
}

impl<const H: usize> Kernel for SquaredErrors<'_, H> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<V: Lanes>(self) -> Vec<f64> {
        let mut trace = Trace::new();
        let mut x = Rows::new();
        let mut sums = Vec::with_capacity(self.moments);
        let coding = self.problem.coding;
        for (a, moment) in self.problem.moments[..self.moments].iter().enumerate() {
            let targets = &self.problem.targets[a * self.problem.texels.len()..];
            let mut sum = 0.0;
            for texels in self.texels.chunks(BLOCK) {
                let samples = Samples::new(a, texels);
                gather(self.problem, self.maps, &samples, &mut x);
                let y = self.network.forward::<V>(&x, samples.moment, &mut trace);
                for (y, &t) in y.iter().zip(texels) {
                    let target = targets[t as usize];
                    for c in 0..3 {
                        // Not `max`, which would show what is not a number as 0.
                        let shown = if y[c] < 0.0 { 0.0 } else { f64::from(y[c]) };
                        let wanted = f64::from(target[c]);
                        let error = f64::from(moment.means[c]) * (coding.light(shown) - coding.light(wanted));
                        sum += error * error;
                    }
                }
            }
            sums.push(sum);
        }
        sums
    }
}

/// The loss Σ w r² over each 4×4 block of F_uv.
pub struct BlockLosses<'a, const H: usize> {
    /// The tile.
    pub problem: &'a Problem,
    /// Its features.
    pub maps: &'a Maps,
    /// Its decoder.
    pub network: &'a Network<H>,
    /// The samples.
    pub samples: &'a [Samples],
}

impl<const H: usize> Kernel for BlockLosses<'_, H> {
    type Output = Vec<f32>;
    #[inline(always)]
    fn run<V: Lanes>(self) -> Vec<f32> {
        let mut trace = Trace::new();
        let mut x = Rows::new();
        let mut losses = vec![0.0; self.maps.uv.len() / 16];
        for samples in self.samples {
            gather(self.problem, self.maps, samples, &mut x);
            let y = self.network.forward::<V>(&x, samples.moment, &mut trace);
            let moment = &self.problem.moments[samples.moment];
            let targets = &self.problem.targets[samples.moment * self.problem.texels.len()..];
            for (y, &t) in y.iter().zip(&samples.texels[..samples.count]) {
                let (r, w) = residual(*y, targets[t as usize], &moment.base, &moment.slope);
                let loss = r.mul(r).mul(w);
                let texel = self.problem.texels[t as usize];
                let offset = self.problem.columns[usize::from(texel.x)].uv
                    + self.problem.rows[usize::from(texel.y)].uv;
                losses[offset / 16] += self.problem.share(t as usize) * (loss[0] + loss[1] + loss[2]);
            }
        }
        losses
    }
}

/// y and its derivatives with respect to the features for one block.
#[derive(Debug)]
pub struct Linearised {
    /// Three channels and a zero.
    pub y: Rows<4>,
    /// ∂y_c/∂x
    pub jacobian: [Rows<FEATURE_ROW>; 3],
}

/// Linearises the decoder on blocks of samples and hands each to a function.
pub struct Linearise<'a, const H: usize, F> {
    /// The tile.
    pub problem: &'a Problem,
    /// Its features.
    pub maps: &'a Maps,
    /// Its decoder.
    pub network: &'a Network<H>,
    /// The moment and the texels.
    pub samples: &'a [Samples],
    /// Called for each block in turn.
    pub each: F,
}

impl<const H: usize, F: FnMut(&Samples, &Linearised)> Kernel for Linearise<'_, H, F> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes>(mut self) {
        let mut trace = Trace::new();
        let mut x = Rows::new();
        let mut out = Linearised { y: Rows::new(), jacobian: [Rows::new(); 3] };
        for samples in self.samples {
            gather(self.problem, self.maps, samples, &mut x);
            out.y = self.network.forward::<V>(&x, samples.moment, &mut trace);
            self.network.jacobian::<V>(&trace, &mut out.jacobian);
            (self.each)(samples, &out);
        }
    }
}

/// Makes the maps of the parameters.
pub struct FillMaps<'a> {
    /// The tile.
    pub problem: &'a Problem,
    /// Order of the parameters.
    pub layout: &'a Layout,
    /// The parameters.
    pub params: &'a [f32],
    /// What to overwrite.
    pub maps: &'a mut Maps,
    /// Also F_uv and F_uvt.
    pub blocks: bool,
}

impl Kernel for FillMaps<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes>(self) {
        self.maps.fill(self.problem, self.layout, self.params, self.blocks);
    }
}

/// Brings the gradient from the maps to the parameters and zeroes the former.
pub struct Contract<'a> {
    /// The tile.
    pub problem: &'a Problem,
    /// Order of the parameters.
    pub layout: &'a Layout,
    /// The parameters.
    pub params: &'a [f32],
    /// Gradient with respect to the maps.
    pub maps: &'a mut Maps,
    /// Gradient with respect to the parameters.
    pub gradient: &'a mut [f32],
    /// Also F_uv and F_uvt.
    pub blocks: bool,
}

impl Kernel for Contract<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes>(self) {
        self.maps.contract(self.problem, self.layout, self.params, self.gradient, self.blocks);
    }
}

/// 1/√x to 5e-6 for positive x: the exponent's half as a first guess and two of Newton's steps, which takes a third of the
/// time of a square root and a division and is the same on every machine.
#[inline(always)]
fn inverse_root(x: f32) -> f32 {
    let guess = f32::from_bits(0x5f37_59dfu32.wrapping_sub(x.to_bits() >> 1));
    let better = guess * (1.5 - 0.5 * x * guess * guess);
    better * (1.5 - 0.5 * x * better * better)
}

/// One step of Adam (Kingma and Ba 2014, algorithm 1, ε = 10⁻⁸ inside the root) on a range of parameters.
pub struct Adam<'a> {
    /// θ
    pub params: &'a mut [f32],
    /// g
    pub gradient: &'a [f32],
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
    fn run<V: Lanes>(self) {
        let [b1, b2] = self.beta;
        let [rate, correction] = self.corrected;
        let [low, high] = self.bounds;
        let moments = self.mean.iter_mut().zip(self.square);
        for ((p, &g), (m, v)) in self.params.iter_mut().zip(self.gradient).zip(moments) {
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
