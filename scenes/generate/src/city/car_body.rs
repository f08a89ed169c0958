//! Bodies of cars: a painted skin lofted over stations along the length, cut by the wheel arches, and a cabin
//! on it.

use crate::mesh::Mesh;
use crate::relief::{full, sheet, sorted, steps};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Half the width of a body.
pub const HALF: f64 = 0.88;
/// Radius of the wheels.
pub const WHEEL: f64 = 0.31;
/// Height of the sills above the road.
const SILL: f64 = 0.24;

/// A body's side view; x runs from the nose (negative) to the tail.
pub struct Shape {
    /// Unique.
    pub name: &'static str,
    /// Nose and tail.
    pub ends: [f64; 2],
    /// Axles.
    pub axles: [f64; 2],
    /// Top of the body without the cabin: (x, height).
    deck: &'static [[f64; 2]],
    /// Foot of the windscreen, top of it, top of the rear window, foot of it: (x, height).
    pub cabin: [[f64; 2]; 4],
    /// Where doors' pillars stand.
    pub pillars: &'static [f64],
}

/// Short, with a steep tail.
pub const HATCHBACK: Shape = Shape {
    name: "hatchback",
    ends: [-1.95, 1.95],
    axles: [-1.2, 1.25],
    deck: &[
        [-1.95, 0.55],
        [-1.88, 0.68],
        [-1.7, 0.76],
        [-0.85, 0.93],
        [0.5, 0.96],
        [1.6, 0.98],
        [1.9, 0.93],
        [1.95, 0.75],
    ],
    cabin: [[-0.95, 0.90], [-0.2, 1.42], [1.35, 1.40], [1.86, 0.93]],
    pillars: &[0.35, 1.2],
};

/// Long, with a third side window.
pub const ESTATE: Shape = Shape {
    name: "estate",
    ends: [-2.2, 2.3],
    axles: [-1.38, 1.35],
    deck: &[
        [-2.2, 0.54],
        [-2.12, 0.66],
        [-1.95, 0.74],
        [-0.95, 0.9],
        [0.6, 0.94],
        [1.9, 0.97],
        [2.24, 0.94],
        [2.3, 0.72],
    ],
    cabin: [[-1.1, 0.87], [-0.25, 1.4], [1.85, 1.42], [2.2, 0.95]],
    pillars: &[0.3, 1.25],
};

/// Linear between the points of a line.
fn along(line: &[[f64; 2]], x: f64) -> f64 {
    let k = line.iter().position(|p| p[0] >= x).unwrap_or(line.len() - 1).max(1);
    let ([x0, y0], [x1, y1]) = (line[k - 1], line[k]);
    y0 + (y1 - y0) * ((x - x0) / (x1 - x0)).clamp(0.0, 1.0)
}

impl Shape {
    /// Lower edge of the side: the sill, cut by the wheel arches.
    fn foot(&self, x: f64) -> f64 {
        let arch = |axle: f64| {
            let r = WHEEL + 0.06;
            let d = x - axle;
            if d.abs() < r { WHEEL + (r * r - d * d).sqrt() } else { 0.0 }
        };
        // The chin and the tail rise a little.
        let rise = 0.08 * ((x.abs() - self.ends[1] + 0.3) / 0.3).clamp(0.0, 1.0);
        self.axles.iter().fold(SILL + rise, |y, &a| y.max(arch(a)))
    }

    /// Half width of the body at a station: rounded at nose and tail.
    fn half(&self, x: f64) -> f64 {
        let from_end = (x - self.ends[0]).min(self.ends[1] - x);
        let t = (1.0 - from_end / 0.45).clamp(0.0, 1.0);
        HALF - 0.2 * t * t
    }

    /// Stations along the body, close together over the wheel arches.
    fn stations(&self) -> Vec<f64> {
        let r = WHEEL + 0.06;
        let mut xs: Vec<f64> = self.deck.iter().map(|p| p[0]).collect();
        xs.extend(steps(self.ends[0], self.ends[1], 26));
        for axle in self.axles {
            xs.extend(steps(0.0, PI, 12).into_iter().map(|a| axle - r * a.cos()));
        }
        let mut xs = sorted(xs);
        // Without slivers.
        xs.dedup_by(|a, b| (*a - *b).abs() < 0.02 && (*a - self.ends[1]).abs() > 1e-9);
        xs
    }

    /// A point of the body's skin: around from the left foot (0) over the deck's middle (0.5) to the right
    /// foot (1).
    fn skin(&self, x: f64, around: f64) -> DVec3 {
        let side = if around < 0.5 { -1.0 } else { 1.0 };
        let t = 1.0 - (around - 0.5).abs() * 2.0;
        let (foot, top, half) = (self.foot(x), along(self.deck, x), self.half(x));
        // Up the side to the shoulder, round it, across.
        const SHOULDER: f64 = 0.55;
        let round = 0.1;
        let (y, z) = if t <= SHOULDER {
            let s = t / SHOULDER;
            let y = foot + (top - round - foot) * s;
            // Doors bulge a little below the belt.
            let h = ((y - SILL) / (0.9 - SILL)).clamp(0.0, 1.0);
            (y, half - 0.05 * (1.0 - (PI * (0.15 + 0.7 * h)).sin()))
        } else {
            let s = (t - SHOULDER) / (1.0 - SHOULDER);
            let belt = half - 0.05 * (1.0 - (PI * 0.85f64).sin());
            if s < 0.4 {
                let a = FRAC_PI_2 * s / 0.4;
                (top - round + round * a.sin(), belt - round * (1.0 - a.cos()))
            } else {
                let u = (s - 0.4) / 0.6;
                (top + 0.035 * (1.0 - (1.0 - u).powi(2)), (belt - round) * (1.0 - u))
            }
        };
        DVec3::new(x, y, side * z)
    }

    /// Painted skin with closed ends.
    pub fn body(&self) -> Mesh {
        let xs = self.stations();
        let mut arounds = steps(0.0, 0.275, 5);
        arounds.extend(steps(0.275, 0.385, 4));
        arounds.extend(steps(0.385, 0.5, 3));
        let mirrored: Vec<f64> = arounds.iter().map(|a| 1.0 - a).collect();
        arounds.extend(mirrored);
        let arounds = sorted(arounds);
        let mut mesh = full(&arounds, &xs, |a, x| self.skin(x, a));
        for (end, front) in [(self.ends[0], true), (self.ends[1], false)] {
            let mut rim: Vec<(DVec3, DVec2)> =
                arounds.iter().map(|&a| self.skin(end, a)).map(|p| (p, DVec2::new(p.z, -p.y))).collect();
            if front {
                rim.reverse();
            }
            mesh.polygon(&rim);
        }
        mesh
    }

    /// The cabin's skin: glass where `glass` is asked for, painted pillars and roof elsewhere.
    pub fn cabin(&self, glass: bool) -> Mesh {
        let [w0, w1, r1, r0] = self.cabin;
        // Stations by which the outline climbs, crosses and falls.
        let line = [w0, w1, r1, r0];
        let mut xs = vec![w0[0], w1[0], r1[0], r0[0]];
        xs.extend([w0[0] + 0.05, w1[0] - 0.05, r1[0] + 0.04, r0[0] - 0.06, w1[0] + 0.12]);
        xs.extend(steps(w1[0], r1[0], 8));
        for &p in self.pillars {
            xs.extend([p - 0.05, p + 0.05]);
        }
        let mut xs = sorted(xs);
        xs.dedup_by(|a, b| (*a - *b).abs() < 0.015);
        let mut arounds: Vec<f64> = [0.0, 0.03, 0.27, 0.3, 0.33, 0.36, 0.4, 0.45, 0.5].into();
        let mirrored: Vec<f64> = arounds.iter().rev().skip(1).map(|a| 1.0 - a).collect();
        arounds.extend(mirrored);
        let place = |x: f64, around: f64| {
            let side = if around < 0.5 { -1.0 } else { 1.0 };
            let t = 1.0 - (around - 0.5).abs() * 2.0;
            let top = along(&line, x);
            let foot = along(self.deck, x).min(top) - 0.02;
            let wide = self.half(x).min(HALF) - 0.09;
            let rise = top - foot;
            let narrow = wide - 0.24 * rise / 0.5;
            let (y, z) = if t < 0.6 {
                let s = t / 0.6;
                (foot + (rise - 0.05 * rise) * s, wide + (narrow - wide) * s)
            } else {
                let s = (t - 0.6) / 0.4;
                let edge = (1.0 - s).powi(4);
                (top - 0.05 * rise * edge + 0.025 * s * (rise / 0.5), narrow * (1.0 - s.powf(1.15)))
            };
            DVec3::new(x, y, side * z)
        };
        let is_glass = |i: usize, j: usize| {
            let (a, x) = ((arounds[i] + arounds[i + 1]) / 2.0, (xs[j] + xs[j + 1]) / 2.0);
            let t = 1.0 - (a - 0.5).abs() * 2.0;
            let on_side = (0.06..0.54).contains(&t);
            let screen = (x > w0[0] + 0.05 && x < w1[0] - 0.05) || (x > r1[0] + 0.04 && x < r0[0] - 0.06);
            let door =
                x > w1[0] - 0.05 && x < r1[0] - 0.02 && !self.pillars.iter().any(|p| (x - p).abs() < 0.05);
            (t > 0.66 && screen) || (on_side && door)
        };
        sheet(&arounds, &xs, |i, j| is_glass(i, j) == glass, |a, x| place(x, a))
    }
}
