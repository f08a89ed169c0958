//! The irradiance of all layers at surfaces, for walks to read where they land: one ray then carries all bounces of the whole
//! day.
//!
//! Kernel file (holds `unsafe`): reading an entry.
//!
//! Lightmapped surfaces have an entry per square of 1, 2 or 4 texels' side (charts start on 4-texel boundaries, so that a square
//! hardly ever mixes two; those of scaled shared layouts may). What has no texels (other triangles, and the backs of two-sided ones) is cut into patches about
//! 4 texels long. Values are half floats, scaled per layer and channel: 0.05 % of rounding, over a range of 10⁹. Two
//! halves hold independently sampled estimates, so that the cache's own noise shows in the difference of the halves of a bake.

use super::rays::Hit;
use super::walk::{RayCounts, Receiver, Transport};
use crate::Rgb;
use crate::atlas::Atlas;
use crate::geometry::Geometry;
use crate::surface::SurfacePoint;
use glam::{Vec2, Vec3};
use half::f16;
use std::ops::Range;

/// No entry, no face.
const NONE: u32 = u32::MAX;
/// Half floats per step of the inner loop: 8 of 3 channels.
const STEP: usize = 24;

/// Length of a patch in sides of an entry.
const PATCH: f64 = 4.0;
/// Most patches along a side of a triangle: larger ones are not cached, walks go on from them.
const MOST_ALONG: u32 = 16;

/// Where a point of a surface finds its entry.
pub struct CacheMap<'a> {
    atlas: &'a Atlas,
    /// Per triangle of the geometry, its face of the atlas.
    face_of: Vec<u32>,
    /// log₂ of the side of an entry in texels.
    shift: u32,
    columns: usize,
    /// Per square of the page, its entry.
    entry_of: Vec<u32>,
    /// Entries of lightmapped surfaces, the first of all.
    squares: usize,
    /// The sides of triangles that are cut into patches.
    pieces: Vec<Piece>,
    /// Per triangle, the piece of its front and of its back.
    piece_of: Vec<[u32; 2]>,
    entries: usize,
    /// Points of entries whose square reaches across a wall, on the side that the entry stands for.
    witnesses: Vec<Vec<Receiver>>,
    /// Per square, its place among the witnesses; empty while there are none.
    witnesses_of: Vec<u32>,
}

/// One side of a triangle, cut into patches: cells of a grid of `along`² in barycentric coordinates.
#[derive(Clone, Copy, Debug)]
struct Piece {
    triangle: u32,
    is_back: bool,
    along: u32,
    /// Its first entry.
    first: u32,
}

/// A patch: a cell (i, j) of a side of a triangle, i + j < along.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Its entry.
    pub entry: u32,
    /// The triangle.
    pub triangle: u32,
    /// Which side of it.
    pub is_back: bool,
    along: u32,
    cell: [u32; 2],
}

impl Patch {
    /// A point of it, uniformly distributed for `u` in [0, 1)².
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let at = |u: Vec2| (Vec2::new(self.cell[0] as f32, self.cell[1] as f32) + u) / self.along as f32;
        let mut b = at(u);
        // The far half of a cell on the edge lies outside: it is turned onto the near one.
        if b.x + b.y > 1.0 {
            b = at(Vec2::ONE - u);
        }
        Vec3::new((1.0 - b.x - b.y).max(0.0), b.x, b.y)
    }
}

impl<'a> CacheMap<'a> {
    /// A map of the squares with side 2^`shift` that hold one of the `covered` texels (page indices, in the order in which
    /// entries are to be numbered), and of patches where they are not too many.
    pub fn new(
        atlas: &'a Atlas,
        geometry: &Geometry,
        shift: u32,
        covered: impl Iterator<Item = usize>,
    ) -> Self {
        let triangles = geometry.triangles.len();
        let mut face_of = vec![NONE; triangles];
        for (i, face) in atlas.faces.iter().enumerate() {
            face_of[face.triangle as usize] = i as u32;
        }
        let columns = (atlas.width as usize).div_ceil(1 << shift);
        let rows = (atlas.height as usize).div_ceil(1 << shift);
        let entry_of = vec![NONE; columns * rows];
        let piece_of = vec![[NONE; 2]; triangles];
        let mut map = CacheMap {
            atlas,
            face_of,
            shift,
            columns,
            entry_of,
            squares: 0,
            pieces: Vec::new(),
            piece_of,
            entries: 0,
            witnesses: Vec::new(),
            witnesses_of: Vec::new(),
        };
        for texel in covered {
            let square = map.square(texel % atlas.width as usize, texel / atlas.width as usize);
            if map.entry_of[square] == NONE {
                map.entry_of[square] = map.squares as u32;
                map.squares += 1;
            }
        }
        map.entries = map.squares;
        map.cut(geometry);
        map
    }

    /// Cuts what has no texels into patches [`PATCH`] entries long, or 4 times as long, the first of which there are no more
    /// than squares or, with those, a million; else into none.
    fn cut(&mut self, geometry: &Geometry) {
        let most = (2 * self.squares).max(1 << 20);
        let mut length = PATCH * self.entry_length();
        for _ in 0..2 {
            let (pieces, entries) = self.pieces_of(geometry, length);
            if entries <= most {
                for (i, piece) in pieces.iter().enumerate() {
                    self.piece_of[piece.triangle as usize][usize::from(piece.is_back)] = i as u32;
                }
                (self.pieces, self.entries) = (pieces, entries);
                return;
            }
            length *= 4.0;
        }
    }

    /// The sides without texels, cut into patches no longer than `length`, and the number of entries there would be.
    fn pieces_of(&self, geometry: &Geometry, length: f64) -> (Vec<Piece>, usize) {
        let (mut pieces, mut entries) = (Vec::new(), self.squares);
        for triangle in 0..geometry.triangles.len() {
            let material = &geometry.materials[geometry.material_of[triangle] as usize];
            let [a, b, c] = geometry.corners(triangle).map(|p| p.as_dvec3());
            let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
            let along = (longest / length).ceil().max(1.0);
            if along > f64::from(MOST_ALONG) {
                continue;
            }
            let along = along as u32;
            for is_back in [false, true] {
                let has_texels = !is_back && self.face_of[triangle] != NONE;
                if !has_texels && (!is_back || material.two_sided) {
                    pieces.push(Piece { triangle: triangle as u32, is_back, along, first: entries as u32 });
                    entries += (along * (along + 1) / 2) as usize;
                }
            }
        }
        (pieces, entries)
    }

    fn square(&self, x: usize, y: usize) -> usize {
        (y >> self.shift) * self.columns + (x >> self.shift)
    }

    /// Says that a texel reaches across a wall, and gives a few points of the side it stands for. Only what they see is that side:
    /// see [`CacheMap::entry`]. An entry of several texels is taken out: walks that land there go on.
    pub fn split(&mut self, texel: usize, witnesses: Vec<Receiver>) {
        let width = self.atlas.width as usize;
        let square = self.square(texel % width, texel / width);
        if self.shift == 0 && !witnesses.is_empty() {
            self.witnesses_of.resize(self.squares, NONE);
            self.witnesses_of[self.entry_of[square] as usize] = self.witnesses.len() as u32;
            self.witnesses.push(witnesses);
        } else {
            self.entry_of[square] = NONE;
        }
    }

    /// The entry of a point on the front or the back of a surface, on this side of any wall; `None` where there is none.
    pub fn entry(
        &self,
        transport: &Transport,
        hit: &Hit,
        is_back: bool,
        counts: &mut RayCounts,
    ) -> Option<u32> {
        let entry = self.of_hit(hit, is_back)?;
        let place = self.witnesses_of.get(entry as usize).copied().unwrap_or(NONE);
        let Some(witnesses) = self.witnesses.get(place as usize) else { return Some(entry) };
        let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
        let at = transport.flat_receiver(&point, is_back)?;
        witnesses.iter().any(|witness| transport.sees(witness, &at, counts)).then_some(entry)
    }

    /// Length of the side of an entry in metres.
    pub fn entry_length(&self) -> f64 {
        f64::from(1u32 << self.shift) / self.atlas.texels_per_metre
    }

    /// Whether a side of a triangle has entries.
    pub fn holds(&self, triangle: u32, is_back: bool) -> bool {
        let triangle = triangle as usize;
        self.piece_of[triangle][usize::from(is_back)] != NONE || (!is_back && self.face_of[triangle] != NONE)
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.entries
    }

    /// Number of entries that are patches.
    pub fn patches(&self) -> usize {
        self.entries - self.squares
    }

    /// All patches, by ascending entry.
    pub fn all_patches(&self) -> Vec<Patch> {
        let of_piece = |p: &Piece| {
            let (piece, cells) =
                (*p, (0..p.along).flat_map(|i| (0..p.along - i).map(move |j| [i, j])).collect::<Vec<_>>());
            cells.into_iter().enumerate().map(move |(k, cell)| Patch {
                entry: piece.first + k as u32,
                triangle: piece.triangle,
                is_back: piece.is_back,
                along: piece.along,
                cell,
            })
        };
        self.pieces.iter().flat_map(of_piece).collect()
    }

    /// The entry of a texel of the page.
    pub fn of_texel(&self, texel: usize) -> Option<u32> {
        let width = self.atlas.width as usize;
        let entry = self.entry_of[self.square(texel % width, texel / width)];
        (entry != NONE).then_some(entry)
    }

    /// The entry of a point on the front or the back of a surface, whatever stands on it; `None` where there is none.
    pub fn of_hit(&self, hit: &Hit, is_back: bool) -> Option<u32> {
        let piece = self.piece_of[hit.triangle as usize][usize::from(is_back)];
        if piece != NONE {
            let piece = &self.pieces[piece as usize];
            let n = piece.along;
            let i = ((hit.barycentric.y * n as f32) as u32).min(n - 1);
            let j = ((hit.barycentric.z * n as f32) as u32).min(n - 1 - i);
            // Rows before i hold n, n − 1, … cells.
            return Some(piece.first + i * n - i * i.saturating_sub(1) / 2 + j);
        }
        let face = self.face_of[hit.triangle as usize];
        if face == NONE || is_back {
            return None;
        }
        let [a, b, c] = self.atlas.faces[face as usize].corners;
        let at: Vec2 = a * hit.barycentric.x + b * hit.barycentric.y + c * hit.barycentric.z;
        let x = (at.x.max(0.0) as usize).min(self.atlas.width as usize - 1);
        let y = (at.y.max(0.0) as usize).min(self.atlas.height as usize - 1);
        let entry = self.entry_of[self.square(x, y)];
        (entry != NONE).then_some(entry)
    }
}

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
            // The greatest value becomes one of 2¹² … 2¹³; small ones keep their digits down to 2⁻¹⁴, there is room above for
            // what further bounces add.
            let exponent = if most > 0.0 { (most.log2().floor() as i32 - 12).clamp(-120, 110) } else { 0 };
            scale[3 * layer..3 * layer + 3].fill((exponent as f32).exp2());
        }
        CacheHalf { stride, values: vec![f16::ZERO; entries * stride], scale, layers }
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
    pub fn set_all(&mut self, value: impl Fn(u32, &mut [Rgb]) + Sync) {
        use rayon::prelude::*;
        let (layers, scale) = (self.layers, &self.scale);
        self.values.par_chunks_mut(self.stride.max(1)).enumerate().with_min_len(64).for_each_init(
            || vec![Rgb::ZERO; layers],
            |out, (entry, stored)| {
                out.fill(Rgb::ZERO);
                value(entry as u32, out);
                encode(out, scale, stored);
            },
        );
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
    for ((stored, &value), &scale) in stored.iter_mut().zip(values).zip(scale) {
        *stored = f16::from_f32((value / scale).min(f16::MAX.to_f32()));
    }
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
    for (k, out) in out.iter_mut().enumerate().skip(i) {
        *out += (stored[k].to_f32() * scale[k]) * [r, g, b][k % 3];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_of_a_patch_is_found_there() {
        for along in [1u32, 2, 5, 16] {
            let piece = Piece { triangle: 0, is_back: true, along, first: 7 };
            let atlas = Atlas::for_tests(1, 1, Vec::new());
            let map = CacheMap {
                atlas: &atlas,
                face_of: vec![NONE],
                shift: 0,
                columns: 1,
                entry_of: vec![NONE],
                squares: 7,
                pieces: vec![piece],
                piece_of: vec![[NONE, 0]],
                entries: 7 + (along * (along + 1) / 2) as usize,
                witnesses: Vec::new(),
                witnesses_of: Vec::new(),
            };
            let patches = map.all_patches();
            assert_eq!(patches.len(), map.patches());
            for patch in patches {
                for u in [Vec2::new(0.25, 0.3), Vec2::new(0.9, 0.8), Vec2::new(0.1, 0.95)] {
                    let barycentric = patch.sample(u);
                    assert!(barycentric.min_element() >= 0.0);
                    let hit = Hit { triangle: 0, barycentric, t: 1.0 };
                    assert_eq!(map.of_hit(&hit, true), Some(patch.entry));
                    assert_eq!(map.of_hit(&hit, false), None);
                }
            }
        }
    }

    #[test]
    fn what_is_stored_is_read_back_within_half_precision() {
        for layers in [1, 2, 3, 7, 8, 37, 40] {
            let most: Vec<f32> = (0..layers).map(|l| 10f32.powi(l as i32 % 9 - 4)).collect();
            let mut half = CacheHalf::new(3, &most);
            let value = |entry: u32, l: usize| most[l] * Rgb::new(1.0, 0.3, 1e-6) / (1.0 + entry as f32);
            half.set_all(|entry, out| out.iter_mut().enumerate().for_each(|(l, o)| *o = value(entry, l)));
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
            let again = CacheHalf::from_parts(layers, half.scales().to_vec(), half.bytes()).unwrap();
            assert!(again.values == half.values && again.scale == half.scale);
        }
    }
}
