//! Textures with holes: sprays of leaves, blades of grass, a leaf of a crop. Cut-out texels have the leaves'
//! colour too, so that filtering does not darken the rims.

use crate::model::Texture;
use crate::random::cell;
use crate::textures::{Colour, mix, scaled, texture};
use glam::DVec2;

/// A leaf: from its base along its axis, half width at its widest.
struct Leaf {
    base: DVec2,
    axis: DVec2,
    half: f64,
}

impl Leaf {
    /// How far across the leaf a point lies, 0 on the midrib and 1 on the rim; `None` outside.
    fn across(&self, p: DVec2) -> Option<f64> {
        let along = (p - self.base).dot(self.axis) / self.axis.length_squared();
        let aside = (p - self.base).perp_dot(self.axis).abs() / self.axis.length();
        let half = self.half * (4.0 * along * (1.0 - along)).max(0.0).sqrt() * (1.25 - 0.5 * along);
        ((0.0..1.0).contains(&along) && aside < half).then(|| aside / half)
    }
}

/// A twig with side twigs, five leaves at each and more at the tip: pale, to be tinted by materials.
pub fn spray() -> Texture {
    let mut leaves = Vec::new();
    let mut twigs = vec![(DVec2::new(0.5, 1.0), DVec2::new(0.5, 0.25))];
    for k in 0..7 {
        let side = if k % 2 == 0 { -1.0 } else { 1.0 };
        let start = DVec2::new(0.5, 0.9 - 0.1 * k as f64);
        let lean = DVec2::new(side * 0.82, -0.57) * (0.40 - 0.025 * k as f64);
        twigs.push((start, start + lean * 0.7));
        for j in 0..5 {
            let base = start + lean * (0.3 + 0.16 * j as f64);
            let turn = [0.9, -0.9, 0.7, -0.7, 0.0][j] + 0.4 * (cell(k, j as i64, 411) - 0.5);
            let axis =
                DVec2::from_angle(turn).rotate(lean.normalize()) * (0.125 + 0.03 * cell(k, j as i64, 412));
            leaves.push(Leaf { base, axis, half: 0.038 });
        }
    }
    for turn in [-0.7, 0.0, 0.7] {
        let axis = DVec2::from_angle(turn).rotate(DVec2::NEG_Y) * 0.16;
        leaves.push(Leaf { base: DVec2::new(0.5, 0.27), axis, half: 0.04 });
    }
    texture("spray", 256, |x, y| {
        let p = DVec2::new(x, y);
        let hit = leaves.iter().enumerate().find_map(|(k, leaf)| Some((k, leaf.across(p)?)));
        let twig = twigs.iter().any(|&(a, b)| {
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            p.distance(a.lerp(b, t)) < 0.008
        });
        let tone = |k: usize| mix([176.0, 184.0, 160.0], [232.0, 232.0, 208.0], cell(k as i64, 0, 413));
        match hit {
            Some((k, across)) => {
                (scaled(tone(k), if across < 0.1 { 1.08 } else { 1.0 - 0.12 * across }), true)
            }
            None => (if twig { [150.0, 140.0, 120.0] } else { [204.0, 208.0, 184.0] }, twig),
        }
    })
}

/// Blades that bend away from a root at the bottom edge's middle.
pub fn blades() -> Texture {
    const PALE: Colour = [198.0, 190.0, 140.0];
    const GREEN: Colour = [126.0, 142.0, 86.0];
    texture("blades", 128, |x, y| {
        let up = 1.0 - y;
        let hit = (0..22).find(|&k| {
            let (foot, lean) = (0.5 + 0.5 * (cell(k, 0, 421) - 0.5), 0.9 * (cell(k, 1, 421) - 0.5));
            let high = 0.5 + 0.48 * cell(k, 2, 421);
            let t = up / high;
            t < 1.0 && (x - foot - lean * t * t * high).abs() < 0.017 * (1.15 - t)
        });
        match hit {
            Some(k) => (mix(GREEN, PALE, cell(k, 3, 421) * (0.4 + 0.6 * up)), true),
            None => (mix(GREEN, PALE, 0.4), false),
        }
    })
}

/// One broad leaf with a pale rib.
pub fn crop_leaf() -> Texture {
    let leaf = Leaf { base: DVec2::new(0.5, 1.0), axis: DVec2::new(0.0, -0.98), half: 0.24 };
    texture("crop_leaf", 128, |x, y| {
        let waved = DVec2::new(x + 0.02 * (y * 40.0).sin() * (x - 0.5).signum(), y);
        let green: Colour = [104.0, 136.0, 76.0];
        match leaf.across(waved) {
            Some(across) if across < 0.09 => ([176.0, 190.0, 140.0], true),
            Some(across) => {
                let vein = ((y * 14.0 + (x - 0.5).abs() * 9.0).fract() - 0.5).abs() < 0.08;
                (scaled(green, if vein { 1.15 } else { 1.0 - 0.15 * across }), true)
            }
            None => (green, false),
        }
    })
}
