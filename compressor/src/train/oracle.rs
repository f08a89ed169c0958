//! The oracle of the trainer's tests: the representation in double precision, one sample at a time.

use super::targets::features;
use super::targets::light::Light;
use crate::bc7;
use crate::model::{GELU_BOUND, GELU_COEFFICIENTS, Shape, TileParams};
use crate::tile::{Coverage, TileSource};
use crate::time::{Axis, Coding};

/// The representation as `model` documents it, in f64 and one sample at a time.
pub(super) struct Oracle<'a> {
    shape: &'a Shape,
    hours: &'a [f64],
    coding: Coding,
    axis: Axis,
    /// Per frame: the states of the light groups that are gates.
    gates: Vec<Vec<bool>>,
    uv: Vec<[f64; 4]>,
    uvt: Vec<[f64; 4]>,
    ut: Vec<f64>,
    vt: Vec<f64>,
    mlp: Vec<f64>,
}

impl<'a> Oracle<'a> {
    /// From parameters in training: endpoints and weights of blocks in raster order of blocks.
    pub(super) fn of_params(
        shape: &'a Shape,
        source: &'a TileSource,
        coding: Coding,
        layout: &features::Layout,
        p: &[f64],
    ) -> Self {
        let map = |endpoints: &std::ops::Range<usize>,
                   weights: &std::ops::Range<usize>,
                   across: usize,
                   down: usize| {
            let count = (endpoints.len() / 8 * 16).checked_div(across * down).unwrap_or(0);
            let mut out = vec![[0.0; 4]; across * down * count];
            for (i, texel) in out.iter_mut().enumerate() {
                let (slice, y, x) = (i / (across * down), i / across % down, i % across);
                let block = (slice * (down / 4) + y / 4) * (across / 4) + x / 4;
                let w = p[weights.start + block * 16 + y % 4 * 4 + x % 4];
                let e = &p[endpoints.start + block * 8..][..8];
                *texel = std::array::from_fn(|c| (1.0 - w) * e[c] + w * e[4 + c]);
            }
            out
        };
        let light = Light::new(source, coding);
        Oracle {
            shape,
            hours: &source.hours,
            coding,
            gates: states(source, &light.gates),
            axis: light.axis,
            uv: map(&layout.uv_endpoints, &layout.uv_weights, shape.width, shape.height),
            uvt: map(&layout.uvt_endpoints, &layout.uvt_weights, shape.uvt[0], shape.uvt[1]),
            ut: p[layout.ut.clone()].to_vec(),
            vt: p[layout.vt.clone()].to_vec(),
            mlp: p[layout.network.clone()].to_vec(),
        }
    }

    /// From a stored tile.
    pub(super) fn of_stored(tile: &'a TileParams, source: &'a TileSource, coding: Coding) -> Self {
        let shape = &tile.shape;
        let map = |blocks: &[[u8; 16]], across: usize, down: usize| {
            let texels: Vec<_> = blocks.iter().map(|b| bc7::decode(b).unwrap()).collect();
            let at = |i: usize| {
                let (slice, y, x) = (i / (across * down), i / across % down, i % across);
                let block = (slice * (down / 4) + y / 4) * (across / 4) + x / 4;
                texels[block][y % 4 * 4 + x % 4].map(|b| f64::from(b) / 255.0)
            };
            (0..blocks.len() * 16).map(at).collect()
        };
        let plane = |p: &[[u8; 2]]| p.as_flattened().iter().map(|b| f64::from(*b) / 255.0).collect();
        Oracle {
            shape,
            hours: &source.hours,
            coding,
            gates: states(source, &tile.gates),
            axis: match tile.axis.length {
                0 => Axis {
                    length: source.hours.len() as u16,
                    places: (0..source.hours.len() as u16).collect(),
                },
                _ => tile.axis.clone(),
            },
            uv: map(&tile.f_uv, shape.width, shape.height),
            uvt: map(&tile.f_uvt, shape.uvt[0], shape.uvt[1]),
            ut: plane(&tile.f_ut),
            vt: plane(&tile.f_vt),
            mlp: tile.mlp.iter().map(|v| f64::from(v.to_f32())).collect(),
        }
    }

    pub(super) fn y(&self, k: usize, x: usize, y: usize) -> [f64; 3] {
        let s = self.shape;
        let (tau, cycle) = match self.coding {
            Coding::Standard => {
                let (place, length) = (self.axis.places[k], self.axis.length);
                ((f64::from(place) + 0.5) / f64::from(length), std::f64::consts::TAU)
            }
            Coding::Paper => (self.hours[k] / 24.0, std::f64::consts::PI),
        };
        let (u, v) = ((x as f64 + 0.5) / s.width as f64, (y as f64 + 0.5) / s.height as f64);
        let taps = |coordinate: f64, size: usize, wraps: bool| {
            let p = coordinate * size as f64 - 0.5;
            [p.floor(), p.floor() + 1.0].map(|i| {
                let at = if wraps {
                    (i as i64).rem_euclid(size as i64)
                } else {
                    (i as i64).clamp(0, size as i64 - 1)
                };
                (at as usize, 1.0 - (p - i).abs())
            })
        };
        let mut input = Vec::new();
        for c in 0..if s.contents.uvt > 0 { 4 } else { 0 } {
            let mut sum = 0.0;
            for (t, ft) in taps(tau, s.uvt[2], true) {
                for (j, fj) in taps(v, s.uvt[1], false) {
                    for (i, fi) in taps(u, s.uvt[0], false) {
                        sum += ft * fj * fi * self.uvt[(t * s.uvt[1] + j) * s.uvt[0] + i][c];
                    }
                }
            }
            input.push(sum);
        }
        if s.contents.uv {
            input.extend(self.uv[y * s.width + x]);
        }
        for (map, size, at) in [(&self.ut, s.ut, u), (&self.vt, s.vt, v)] {
            for c in 0..if size > 0 { 2 } else { 0 } {
                let mut sum = 0.0;
                for (t, ft) in taps(tau, s.rows, true) {
                    for (i, fi) in taps(at, size, false) {
                        sum += ft * fi * map[(t * size + i) * 2 + c];
                    }
                }
                input.push(sum);
            }
        }
        input.iter_mut().for_each(|f| *f = 3.0 * (*f - 0.5));
        let angle = cycle * tau;
        if s.contents.gamma {
            input.extend([angle.sin(), angle.cos(), (2.0 * angle).sin(), (2.0 * angle).cos()]);
        }
        input.extend(self.gates[k].iter().take(s.contents.gates).map(|on| if *on { 1.0 } else { -1.0 }));
        let gelu = |x: f64| {
            let bound = f64::from(GELU_BOUND);
            let y = x.clamp(-bound, bound);
            let p = GELU_COEFFICIENTS.iter().rev().fold(0.0, |p, c| p * y * y + f64::from(*c));
            x * (0.5 + y * p)
        };
        let mut rest = &self.mlp[..];
        for (layer, outputs) in [s.hidden, s.hidden, 3].into_iter().enumerate() {
            let (w, tail) = rest.split_at(outputs * input.len());
            let (b, tail) = tail.split_at(outputs);
            let row = |j: usize| {
                w[j * input.len()..][..input.len()].iter().zip(&input).map(|(w, x)| w * x).sum::<f64>()
            };
            let out: Vec<f64> = (0..outputs).map(|j| row(j) + b[j]).collect();
            input = if layer < 2 { out.into_iter().map(gelu).collect() } else { out };
            rest = tail;
        }
        [input[0], input[1], input[2]]
    }

    /// Mean PSNR over the frames that have a peak, valid texels only.
    pub(super) fn psnr(&self, source: &TileSource, means: &[[f32; 3]]) -> f64 {
        let (mut total, mut count) = (0.0, 0.0);
        for (k, frame) in source.frames.iter().enumerate() {
            let valid: Vec<_> = (0..frame.len()).filter(|&i| source.coverage[i] == Coverage::Valid).collect();
            let peak = valid.iter().flat_map(|&i| frame[i]).fold(0.0f32, f32::max);
            if peak == 0.0 {
                assert_eq!(means[k], [0.0; 3]);
                continue;
            }
            let mut sum = 0.0;
            for &i in &valid {
                let y = self.y(k, i % source.width, i / source.width);
                for c in 0..3 {
                    let power = if self.coding == Coding::Paper { 2.2 } else { 2.0 };
                    sum +=
                        (f64::from(means[k][c]) * y[c].max(0.0).powf(power) - f64::from(frame[i][c])).powi(2);
                }
            }
            let mse = sum / (3 * valid.len()) as f64;
            total += (10.0 * (f64::from(peak).powi(2) / mse).log10()).min(100.0);
            count += 1.0;
        }
        total / count
    }
}

/// Per frame: the states of some light groups.
fn states(source: &TileSource, groups: &[u16]) -> Vec<Vec<bool>> {
    let of = |group: &u16| source.gates.iter().find(|gate| gate.group == *group).unwrap();
    (0..source.frames.len()).map(|k| groups.iter().map(|g| of(g).on[k]).collect()).collect()
}
