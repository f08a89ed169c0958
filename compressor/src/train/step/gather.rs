//! From the features of a tile to those of its samples, and the way back of the gradient.
//!
//! Samples read F_uv where it was learned, between the endpoints of its blocks: a step reads a quarter of its
//! texels, so a map of them would cost more than it saves. F_uvt, whose texels samples share, is read as a
//! map. Of F_ut and F_vt all samples of a chunk read the same time point: its rows are mixed once a chunk.

#[cfg(doc)]
use super::network::CHUNK;
use super::network::{FEATURE_ROW, Rows};
use crate::lanes::{Lanes, Longest, Quad, TwoQuads};
use crate::model::STORED;
use crate::train::targets::features::{CENTRE_SLOPE, Layout, centred, two, two_mut};
use crate::train::targets::{Pair, Problem, Texel};

/// A chunk of samples, of one time point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Samples<'a> {
    /// Index into the problem's time points.
    pub point: usize,
    /// At most [`CHUNK`] texels. Rows of the others are left as they are.
    pub texels: &'a [Texel],
}

/// F_uv as samples read it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Uv<'a> {
    /// Learned: endpoints and weights of its blocks.
    Blocks {
        /// e₀, e₁ of each block.
        endpoints: &'a [f32],
        /// 16 of each block.
        weights: &'a [f32],
    },
    /// Texels, centred, block by block.
    Texels(&'a [Quad]),
}

impl Uv<'_> {
    /// The centred texel at an offset, block by block.
    #[inline(always)]
    fn texel<V: Longest>(&self, at: usize) -> V::Four {
        match self {
            Uv::Blocks { endpoints, weights } => {
                let ends = V::Eight::load(&endpoints[at / 16 * 8..][..8]);
                let texel = ends.mul(V::Eight::ends(weights[at])).folded();
                texel.mul_add(V::Four::splat(CENTRE_SLOPE), V::Four::splat(-0.5 * CENTRE_SLOPE))
            }
            Uv::Texels(texels) => V::Four::load(&texels[at]),
        }
    }
}

/// The features of a tile as samples read them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Features<'a> {
    /// F_uv.
    pub uv: Uv<'a>,
    /// F_uvt, centred, slice by slice, row by row.
    pub uvt: &'a [Quad],
    /// F_ut as learned, row (τ) by row, 2 channels.
    pub ut: &'a [f32],
    /// F_vt likewise.
    pub vt: &'a [f32],
}

/// Where the gradient with respect to the features is added.
#[derive(Debug)]
pub(crate) struct FeatureGradient<'a> {
    /// With respect to the learned F_uv: of endpoints and weights of blocks, or of texels one by one, without
    /// weights.
    pub uv: [&'a mut [f32]; 2],
    /// With respect to the centred F_uvt.
    pub uvt: &'a mut [Quad],
    /// With respect to the learned F_ut.
    pub ut: &'a mut [f32],
    /// With respect to the learned F_vt.
    pub vt: &'a mut [f32],
}

impl<'a> FeatureGradient<'a> {
    /// In the order of the parameters, but for F_uvt.
    pub(crate) fn new(flat: &'a mut [f32], layout: &Layout, uvt: &'a mut [Quad]) -> Self {
        let (features, _) = flat.split_at_mut(layout.network.start);
        let (features, vt) = features.split_at_mut(layout.vt.start);
        let (features, ut) = features.split_at_mut(layout.ut.start);
        let (uv, _) = features.split_at_mut(layout.uv_weights.end);
        let (endpoints, weights) = uv.split_at_mut(layout.uv_weights.start);
        FeatureGradient { uv: [endpoints, weights], uvt, ut, vt }
    }
}

/// A row of F_ut or F_vt between two others: at most half as many texels as are stored, of 2 channels.
type Row = [f32; STORED];

/// The row of a plane at a time point, centred; zeros without the plane.
#[inline(always)]
fn mixed(plane: &[f32], across: usize, rows: &Pair) -> Row {
    let mut row = [0.0; STORED];
    let [a, b] = rows.at.map(|row| &plane[row * across * 2..][..across * 2]);
    for ((mixed, a), b) in row.iter_mut().zip(a).zip(b) {
        *mixed = centred(a + rows.f * (b - a));
    }
    row
}

/// The way back of [`mixed`].
#[inline(always)]
fn unmix(row: &Row, across: usize, rows: &Pair, plane: &mut [f32]) {
    for (at, weight) in rows.ends() {
        for (to, g) in plane[at * across * 2..][..across * 2].iter_mut().zip(row) {
            *to += CENTRE_SLOPE * weight * g;
        }
    }
}

/// Two quads between two others.
#[inline(always)]
fn mix<V: Longest>(a: &[f32], b: &[f32], f: f32) -> V::Eight {
    V::Eight::splat(f).mul_add(V::Eight::load(b), V::Eight::splat(1.0 - f).mul(V::Eight::load(a)))
}

/// The features of a chunk of samples (paper, fig. 2): V_uvt, V_uv, V_ut, V_vt, of those that the tile has;
/// the rest stays. `meanwhile` is called with each texel on the way.
#[inline(always)]
pub(crate) fn gather<V: Longest>(
    features: &Features,
    problem: &Problem,
    samples: &Samples,
    x: &mut Rows<FEATURE_ROW>,
    meanwhile: impl Fn(Texel),
) {
    let point = &problem.points[samples.point];
    let has = &problem.shape.contents;
    let ut = mixed(features.ut, problem.shape.ut, &point.rows);
    let vt = mixed(features.vt, problem.shape.vt, &point.rows);
    let between = |row: &Row, pair: &Pair| -> [f32; 2] {
        let [a, b, c, d] = Quad::load(&row[2 * pair.at[0]..]);
        [a + pair.f * (c - a), b + pair.f * (d - b)]
    };
    let slices = point.slices.at.map(|at| &features.uvt[at..]);
    for (x, &texel) in x.iter_mut().zip(samples.texels) {
        meanwhile(texel);
        let (column, row) = problem.sites(texel);
        if has.uvt > 0 {
            let (at, [above, below], f) = (column.uvt.at[0], row.uvt.at, row.uvt.f);
            let before = mix::<V>(two(slices[0], at + above), two(slices[0], at + below), f);
            let after = mix::<V>(two(slices[1], at + above), two(slices[1], at + below), f);
            let pair = V::Eight::splat(point.slices.f)
                .mul_add(after, V::Eight::splat(1.0 - point.slices.f).mul(before));
            pair.mul(V::Eight::ends(column.uvt.f)).folded().store(&mut x[..4]);
        }
        if has.uv {
            features.uv.texel::<V>(column.uv + row.uv).store(&mut x[4..8]);
        }
        if has.ut {
            x[8..10].copy_from_slice(&between(&ut, &column.plane));
        }
        if has.vt {
            x[10..12].copy_from_slice(&between(&vt, &row.plane));
        }
    }
}

/// The way back of [`gather`]: of the planes alone, or of all maps.
#[inline(always)]
pub(crate) fn scatter<V: Longest>(
    features: &Features,
    problem: &Problem,
    samples: &Samples,
    dx: &Rows<FEATURE_ROW>,
    gradient: &mut FeatureGradient,
    planes_alone: bool,
) {
    let point = &problem.points[samples.point];
    let has = &problem.shape.contents;
    let (mut ut, mut vt): (Row, Row) = ([0.0; STORED], [0.0; STORED]);
    let part = |row: &mut Row, pair: &Pair, d: [f32; 2]| {
        let to = &mut row[2 * pair.at[0]..][..4];
        let weights = [1.0 - pair.f, 1.0 - pair.f, pair.f, pair.f];
        weights.mul_add([d[0], d[1], d[0], d[1]], Quad::load(to)).store(to);
    };
    for (d, &texel) in dx.iter().zip(samples.texels) {
        let (column, row) = problem.sites(texel);
        if has.ut {
            part(&mut ut, &column.plane, [d[8], d[9]]);
        }
        if has.vt {
            part(&mut vt, &row.plane, [d[10], d[11]]);
        }
        if planes_alone {
            continue;
        }
        if has.uv {
            scatter_uv::<V>(&features.uv, column.uv + row.uv, V::Four::load(&d[4..8]), &mut gradient.uv);
        }
        if has.uvt == 0 {
            continue;
        }
        let d = V::Eight::twice(V::Four::load(&d[..4])).mul(V::Eight::ends(column.uvt.f));
        for (slice, fs) in point.slices.ends() {
            let slice = &mut gradient.uvt[slice..];
            for (y, fy) in row.uvt.ends() {
                let to = two_mut(slice, column.uvt.at[0] + y);
                V::Eight::splat(fs * fy).mul_add(d, V::Eight::load(to)).store(to);
            }
        }
    }
    unmix(&ut, problem.shape.ut, &point.rows, gradient.ut);
    unmix(&vt, problem.shape.vt, &point.rows, gradient.vt);
}

/// ∂e₁ = w g, ∂e₀ = (1 − w) g, ∂w = g · (e₁ − e₀), with g that of the texel before it is centred.
#[inline(always)]
fn scatter_uv<V: Longest>(uv: &Uv, at: usize, d: V::Four, gradient: &mut [&mut [f32]; 2]) {
    let g = d.mul(V::Four::splat(CENTRE_SLOPE));
    let [to, weights] = gradient;
    match uv {
        Uv::Blocks { endpoints, weights: w } => {
            let (e, to) = (&endpoints[at / 16 * 8..][..8], &mut to[at / 16 * 8..][..8]);
            let mut p = [0.0; 4];
            let line = V::Four::load(&e[..4]).mul_add(V::Four::splat(-1.0), V::Four::load(&e[4..]));
            g.mul(line).store(&mut p);
            weights[at] += (p[0] + p[1]) + (p[2] + p[3]);
            V::Eight::ends(w[at]).mul_add(V::Eight::twice(g), V::Eight::load(to)).store(to);
        }
        Uv::Texels(_) => {
            let to = &mut to[4 * at..][..4];
            g.add(V::Four::load(to)).store(to);
        }
    }
}
