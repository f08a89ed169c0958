//! The values of the cache: irradiance of all layers per entry.
//!
//! Kernel file (holds `unsafe`): reading and storing an entry.
//!
//! Values are half floats, scaled per layer and channel: 0.05 % of rounding, over a range of 10⁹. Two halves
//! hold independently sampled estimates, so that the cache's own noise shows in the difference of the halves
//! of a bake.

use crate::Rgb;
use crate::trace::memory_pages::prefer_large;
use half::f16;
use std::ops::Range;

/// Half floats per step of the inner loop: 8 of 3 channels.
const STEP: usize = 24;

/// The values of one half: entries of `layers` RGB irradiances.
pub struct CacheHalf {
    /// Half floats per entry, a multiple of 8.
    stride: usize,
    values: Vec<f16>,
    /// Per layer and channel, what a stored value is multiplied by; the same length as an entry.
    scale: Vec<f32>,
    layers: usize,
}

impl CacheHalf {
    /// All black, to hold values of up to `most` in each layer.
    pub fn new(entries: usize, most: &[f32]) -> Self {
        let layers = most.len();
        let stride = (3 * layers).next_multiple_of(8);
        let mut scale = vec![0.0; stride];
        for (layer, &most) in most.iter().enumerate() {
            // The greatest value becomes one of 2¹² … 2¹³; small ones keep their digits down to 2⁻¹⁴, there
            // is room above for what further bounces add.
            let exponent = if most > 0.0 { (most.log2().floor() as i32 - 12).clamp(-120, 110) } else { 0 };
            scale[3 * layer..3 * layer + 3].fill((exponent as f32).exp2());
        }
        // (Integers, for zeros of those are left to the system: memory that nobody touched yet.)
        let zeros = vec![0u16; entries * stride];
        prefer_large(&zeros);
        CacheHalf { stride, values: bytemuck::cast_vec(zeros), scale, layers }
    }

    /// Bytes per entry for so many layers.
    pub fn bytes_per_entry(layers: usize) -> usize {
        (3 * layers).next_multiple_of(8) * 2
    }

    /// The raw values, for storing them.
    pub fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.values)
    }

    /// The scales, for storing them.
    pub fn scales(&self) -> &[f32] {
        &self.scale
    }

    /// What [`CacheHalf::bytes`] and [`CacheHalf::scales`] gave; `None` where they do not fit each other.
    pub fn from_parts(layers: usize, scale: Vec<f32>, bytes: &[u8]) -> Option<Self> {
        let stride = (3 * layers).next_multiple_of(8);
        let fits = scale.len() == stride && bytes.len().is_multiple_of((stride * 2).max(1));
        fits.then(|| CacheHalf { stride, values: bytemuck::pod_collect_to_vec(bytes), scale, layers })
    }

    /// Stores the irradiance of all layers at all entries, in parallel: `value(entry, out)` fills it in.
    /// Gives the sums over the entries of what was to be stored, per layer and channel, in an order that does
    /// not depend on the threads. (Of what *is* stored they would be off by up to 0.02 % where entries are
    /// alike, for then all are rounded to the same side.)
    pub fn set_all(&mut self, value: impl Fn(u32, &mut [Rgb]) + Sync) -> Vec<f64> {
        use rayon::prelude::*;
        /// Entries summed at a time.
        const RUN: usize = 256;
        let (layers, scale, stride) = (self.layers, &self.scale, self.stride.max(1));
        let of_run = |(run, stored): (usize, &mut [f16])| {
            let (mut out, mut sums) = (vec![Rgb::ZERO; layers], vec![0.0; 3 * layers]);
            for (i, stored) in stored.chunks_mut(stride).enumerate() {
                out.fill(Rgb::ZERO);
                value((run * RUN + i) as u32, &mut out);
                encode(&out, scale, stored);
                let values: &[f32] = bytemuck::cast_slice(&out);
                sums.iter_mut().zip(values).for_each(|(s, v)| *s += f64::from(*v));
            }
            sums
        };
        let runs: Vec<Vec<f64>> = self.values.par_chunks_mut(stride * RUN).enumerate().map(of_run).collect();
        runs.iter().fold(vec![0.0; 3 * layers], |mut all, run| {
            all.iter_mut().zip(run).for_each(|(a, r)| *a += r);
            all
        })
    }

    /// The irradiance of all layers of an entry.
    pub fn read(&self, entry: u32, out: &mut [Rgb]) {
        out.fill(Rgb::ZERO);
        self.add(entry, Rgb::ONE, out);
    }

    /// Takes over the layers for which `which` holds from another half of the same shape.
    pub fn take(&mut self, from: &CacheHalf, which: &[bool]) {
        use rayon::prelude::*;
        if !which.contains(&true) {
            return;
        }
        let channels = || which.iter().enumerate().filter(|(_, w)| **w).flat_map(|(l, _)| 3 * l..3 * l + 3);
        channels().for_each(|c| self.scale[c] = from.scale[c]);
        let stride = self.stride.max(1);
        self.values
            .par_chunks_mut(stride)
            .zip(from.values.par_chunks(stride))
            .with_min_len(1024)
            .for_each(|(own, other)| channels().for_each(|c| own[c] = other[c]));
    }

    /// Multiplies all entries, per layer and channel.
    pub fn scale_by(&mut self, factors: &[f32]) {
        self.scale.iter_mut().zip(factors).for_each(|(s, f)| *s *= f);
    }

    /// The greatest value of each layer.
    pub fn most(&self) -> Vec<f32> {
        use rayon::prelude::*;
        // Bits of numbers that are not negative are ordered as the numbers are.
        let bits = self.values.par_chunks(self.stride.max(1) * 1024).map(|run| {
            let mut most = vec![0u16; self.stride];
            for entry in run.chunks(self.stride) {
                most.iter_mut().zip(entry).for_each(|(m, v)| *m = (*m).max(v.to_bits()));
            }
            most
        });
        let join = |mut a: Vec<u16>, b: Vec<u16>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a = (*a).max(b));
            a
        };
        let bits = bits.reduce(|| vec![0; self.stride], join);
        let values: Vec<f32> =
            bits.iter().zip(&self.scale).map(|(b, s)| f16::from_bits(*b).to_f32() * s).collect();
        values.chunks_exact(3).take(self.layers).map(|c| c[0].max(c[1]).max(c[2])).collect()
    }

    /// Fetches an entry that is soon to be read: the cache is larger than the processor's, and reading it is
    /// mostly waiting.
    #[inline]
    pub fn prefetch(&self, entry: u32) {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            /// Half floats of a line.
            const LINE: usize = 32;
            let first = entry as usize * self.stride;
            for at in (first..first + self.stride).step_by(LINE) {
                // SAFETY: a hint; nothing is read, whatever the address.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(self.values.as_ptr().wrapping_add(at).cast()) };
            }
        }
    }

    /// `out += weight · E` for all layers of an entry.
    #[inline]
    pub fn add(&self, entry: u32, weight: Rgb, out: &mut [Rgb]) {
        let from = entry as usize * self.stride;
        let stored = &self.values[from..from + self.stride];
        let out: &mut [f32] = bytemuck::cast_slice_mut(&mut out[..self.layers]);
        add(stored, &self.scale, weight, out);
    }

    /// As [`CacheHalf::add`], for some of the layers, the first of `out`.
    pub fn add_layers(&self, entry: u32, weight: Rgb, layers: Range<usize>, out: &mut [Rgb]) {
        let (first, values) = (3 * layers.start, 3 * layers.len());
        let from = entry as usize * self.stride + first;
        let out: &mut [f32] = bytemuck::cast_slice_mut(&mut out[..layers.len()]);
        add(&self.values[from..from + values], &self.scale[first..first + values], weight, out);
    }
}

fn encode(layers: &[Rgb], scale: &[f32], stored: &mut [f16]) {
    let values: &[f32] = bytemuck::cast_slice(layers);
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("f16c") {
        // SAFETY: the processor has both.
        return unsafe { encode_f16c(values, scale, stored) };
    }
    encode_portable(values, scale, stored);
}

fn encode_portable(values: &[f32], scale: &[f32], stored: &mut [f16]) {
    for ((stored, &value), &scale) in stored.iter_mut().zip(values).zip(scale) {
        *stored = f16::from_f32((value / scale).min(f16::MAX.to_f32()));
    }
}

/// [`encode_portable`], the same to the bit.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,f16c")]
fn encode_f16c(values: &[f32], scale: &[f32], stored: &mut [f16]) {
    use std::arch::x86_64::*;
    let most = _mm256_set1_ps(f16::MAX.to_f32());
    let (values, rest) = values.as_chunks::<8>();
    for ((stored, value), scale) in
        stored.as_chunks_mut::<8>().0.iter_mut().zip(values).zip(scale.as_chunks::<8>().0)
    {
        // SAFETY: each of the three holds 8 values.
        unsafe {
            let value = _mm256_div_ps(_mm256_loadu_ps(value.as_ptr()), _mm256_loadu_ps(scale.as_ptr()));
            let half = _mm256_cvtps_ph::<_MM_FROUND_TO_NEAREST_INT>(_mm256_min_ps(value, most));
            _mm_storeu_si128(stored.as_mut_ptr().cast(), half);
        }
    }
    let done = 8 * values.len();
    encode_portable(rest, &scale[done..], &mut stored[done..]);
}

fn add(stored: &[f16], scale: &[f32], weight: Rgb, out: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("f16c") {
        // SAFETY: the processor has both.
        return unsafe { add_f16c(stored, scale, weight, out) };
    }
    add_portable(stored, scale, weight, out);
}

fn add_portable(stored: &[f16], scale: &[f32], weight: Rgb, out: &mut [f32]) {
    let weight = weight.to_array();
    for (i, (out, (stored, scale))) in out.iter_mut().zip(stored.iter().zip(scale)).enumerate() {
        *out += (stored.to_f32() * scale) * weight[i % 3];
    }
}

/// [`add_portable`], the same to the bit: products and sums are rounded one by one.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,f16c")]
fn add_f16c(stored: &[f16], scale: &[f32], weight: Rgb, out: &mut [f32]) {
    use std::arch::x86_64::*;
    let [r, g, b] = weight.to_array();
    let weights = [
        _mm256_setr_ps(r, g, b, r, g, b, r, g),
        _mm256_setr_ps(b, r, g, b, r, g, b, r),
        _mm256_setr_ps(g, b, r, g, b, r, g, b),
    ];
    let whole = out.len() / STEP * STEP;
    let one = |i: usize, weight: __m256, out: &mut [f32]| {
        let (stored, scale, out) = (&stored[i..i + 8], &scale[i..i + 8], &mut out[i..i + 8]);
        // SAFETY: each of the three slices holds 8 values.
        unsafe {
            let value = _mm256_cvtph_ps(_mm_loadu_si128(stored.as_ptr().cast()));
            let value = _mm256_mul_ps(value, _mm256_loadu_ps(scale.as_ptr()));
            let sum = _mm256_add_ps(_mm256_loadu_ps(out.as_ptr()), _mm256_mul_ps(value, weight));
            _mm256_storeu_ps(out.as_mut_ptr(), sum);
        }
    };
    for i in (0..whole).step_by(STEP) {
        one(i, weights[0], out);
        one(i + 8, weights[1], out);
        one(i + 16, weights[2], out);
    }
    let mut i = whole;
    while i + 8 <= out.len() {
        one(i, weights[(i - whole) / 8], out);
        i += 8;
    }
    let (done, from) = (i, out.len().saturating_sub(8));
    if done < out.len() && from > 0 {
        // The last eight once more, of which only those not yet done are kept.
        let phase = [weights[0], weights[2], weights[1]][from % 3];
        let (stored, scale, out) =
            (&stored[from..from + 8], &scale[from..from + 8], &mut out[from..from + 8]);
        // SAFETY: each of the three slices holds 8 values.
        unsafe {
            let lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let fresh = _mm256_cmpgt_epi32(lane, _mm256_set1_epi32((done - from) as i32 - 1));
            let value = _mm256_cvtph_ps(_mm_loadu_si128(stored.as_ptr().cast()));
            let value = _mm256_mul_ps(value, _mm256_loadu_ps(scale.as_ptr()));
            let old = _mm256_loadu_ps(out.as_ptr());
            let sum = _mm256_add_ps(old, _mm256_mul_ps(value, phase));
            _mm256_storeu_ps(out.as_mut_ptr(), _mm256_blendv_ps(old, sum, _mm256_castsi256_ps(fresh)));
        }
        return;
    }
    for (k, out) in out.iter_mut().enumerate().skip(done) {
        *out += (stored[k].to_f32() * scale[k]) * [r, g, b][k % 3];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_stored_is_read_back_within_half_precision() {
        for layers in [1, 2, 3, 7, 8, 37, 40] {
            let most: Vec<f32> = (0..layers).map(|l| 10f32.powi(l as i32 % 9 - 4)).collect();
            let mut half = CacheHalf::new(3, &most);
            let value = |entry: u32, l: usize| most[l] * Rgb::new(1.0, 0.3, 1e-6) / (1.0 + entry as f32);
            let sums =
                half.set_all(|entry, out| out.iter_mut().enumerate().for_each(|(l, o)| *o = value(entry, l)));
            let sum = |l: usize| (0..3).map(|entry| f64::from(value(entry, l).y)).sum::<f64>();
            (0..layers).for_each(|l| assert_eq!(sums[3 * l + 1], sum(l)));
            let entry: Vec<Rgb> = (0..layers).map(|l| value(2, l)).collect();
            let mut plain = vec![f16::ZERO; half.stride];
            encode_portable(bytemuck::cast_slice(&entry), &half.scale, &mut plain);
            assert_eq!(plain, half.values[2 * half.stride..]);
            let weight = Rgb::new(0.5, 2.0, 3.0);
            let (mut fast, mut oracle) = (vec![Rgb::ONE; layers], vec![Rgb::ONE; layers]);
            half.add(2, weight, &mut fast);
            let from = 2 * half.stride;
            let stored = &half.values[from..from + half.stride];
            add_portable(stored, &half.scale, weight, bytemuck::cast_slice_mut(&mut oracle));
            assert_eq!(fast, oracle);
            for (l, sum) in fast.iter().enumerate() {
                let error = (*sum - Rgb::ONE - weight * value(2, l)).abs();
                assert!(error.max_element() <= 1e-3 * most[l] + 2e-7, "{layers} {l} {error}");
            }
            for first in 0..layers {
                let (mut fast, mut oracle) = (vec![Rgb::ONE; layers - first], vec![Rgb::ONE; layers - first]);
                half.add_layers(2, weight, first..layers, &mut fast);
                let (stored, scale) = (&stored[3 * first..3 * layers], &half.scale[3 * first..3 * layers]);
                add_portable(stored, scale, weight, bytemuck::cast_slice_mut(&mut oracle));
                assert_eq!(fast, oracle, "{first} of {layers}");
            }
            let again = CacheHalf::from_parts(layers, half.scales().to_vec(), half.bytes()).unwrap();
            assert!(again.values == half.values && again.scale == half.scale);
        }
    }
}
