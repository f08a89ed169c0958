//! Seamless procedural textures, authored in 8-bit sRGB.

use crate::model::Texture;
use crate::random::{cell, noise};

pub use models::textures::*;

/// Linear blend.
pub fn mix(a: Colour, b: Colour, t: f64) -> Colour {
    [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * t)
}

/// All components times a factor.
pub fn scaled(a: Colour, t: f64) -> Colour {
    a.map(|c| c * t)
}

/// Three octaves of noise in [0, 1), `cells` per texture in the coarsest.
pub fn fractal(x: f64, y: f64, cells: i64, seed: u64) -> f64 {
    let octave = |k: i64| noise(x * (cells * k) as f64, y * (cells * k) as f64, cells * k, seed + k as u64);
    (octave(1) * 4.0 + octave(2) * 2.0 + octave(4)) / 7.0
}

/// Running bond, four bricks by twelve courses to the tile.
pub fn brick() -> Texture {
    texture("brick", 256, |x, y| {
        let row = (y * 12.0).floor();
        let shifted = (x * 4.0 + 0.5 * (row % 2.0)).rem_euclid(4.0);
        let (inside_x, inside_y) = (shifted.fract(), (y * 12.0).fract());
        let tone = cell(shifted as i64, row as i64, 1);
        let grain = 0.86 + 0.28 * fractal(x, y, 32, 2);
        let face = mix([142.0, 74.0, 56.0], [178.0, 104.0, 78.0], tone);
        let joint = !(0.02..0.98).contains(&inside_x) || !(0.06..0.94).contains(&inside_y);
        (scaled(if joint { [176.0, 168.0, 156.0] } else { face }, grain), true)
    })
}

/// Warm lime plaster with faint blotches.
pub fn plaster() -> Texture {
    texture("plaster", 128, |x, y| {
        let blotch = 0.93 + 0.08 * fractal(x, y, 3, 11);
        let grain = 0.97 + 0.06 * fractal(x, y, 24, 12);
        (scaled([233.0, 220.0, 188.0], blotch * grain), true)
    })
}

/// Eight boards across the tile, grain along v; grey-white, tinted by materials.
pub fn planks() -> Texture {
    texture("planks", 256, |x, y| {
        let board = (x * 8.0).floor();
        let tone = 0.82 + 0.18 * cell(board as i64, 0, 21);
        let shift = cell(board as i64, 1, 22);
        let streak = noise(x * 64.0, (y + shift) * 4.0, 64, 23);
        let fine = noise(x * 128.0, (y + shift) * 16.0, 128, 24);
        let inside = (x * 8.0).fract();
        let seam = if !(0.03..0.97).contains(&inside) { 0.6 } else { 1.0 };
        (scaled([236.0, 226.0, 210.0], tone * seam * (0.80 + 0.14 * streak + 0.06 * fine)), true)
    })
}

/// Lawn: blades, patches, some clover.
pub fn grass() -> Texture {
    texture("grass", 256, |x, y| {
        let patch = fractal(x, y, 5, 31);
        let blade = noise(x * 96.0, y * 48.0, 96, 32) * 0.6 + noise(x * 48.0, y * 96.0, 96, 33) * 0.4;
        let base = mix([74.0, 104.0, 44.0], [122.0, 140.0, 66.0], patch);
        (scaled(base, 0.72 + 0.5 * blade), true)
    })
}

/// Four by four concrete slabs, each with its tone; joints are darker, and geometry.
pub fn paving() -> Texture {
    texture("paving", 256, |x, y| {
        let tone = cell((x * 4.0) as i64, (y * 4.0) as i64, 41);
        let warm = cell((x * 4.0) as i64, (y * 4.0) as i64, 42);
        let base = mix([148.0, 146.0, 142.0], [176.0, 164.0, 146.0], warm);
        let grain = 0.9 + 0.16 * fractal(x, y, 40, 43);
        let edge = |t: f64| !(0.03..0.97).contains(&(t * 4.0).fract());
        let joint = if edge(x) || edge(y) { 0.62 } else { 1.0 };
        (scaled(base, (0.86 + 0.2 * tone) * grain * joint), true)
    })
}

/// Clay roof tiles, eight by eight to the tile, darker at their seams and in the shade of the row above.
pub fn roof_tiles() -> Texture {
    texture("roof_tiles", 128, |x, y| {
        let tone = cell((x * 8.0) as i64, (y * 8.0) as i64, 51);
        let moss = fractal(x, y, 4, 52);
        let clay = mix([132.0, 66.0, 50.0], [166.0, 90.0, 64.0], tone);
        let (across, down) = ((x * 8.0).fract(), (y * 8.0).fract());
        let shade = if !(0.06..0.94).contains(&across) || down < 0.14 { 0.72 } else { 1.0 };
        let worn = mix(clay, [104.0, 92.0, 64.0], (moss - 0.5).max(0.0));
        (scaled(worn, shade * (0.9 + 0.2 * fractal(x, y, 16, 53))), true)
    })
}

/// Bark: ridges along v.
pub fn bark() -> Texture {
    texture("bark", 128, |x, y| {
        let ridge = noise(x * 16.0 + fractal(x, y, 4, 61), y * 4.0, 16, 62);
        let fine = fractal(x, y, 16, 63);
        (scaled(mix([82.0, 68.0, 54.0], [136.0, 118.0, 96.0], ridge), 0.8 + 0.3 * fine), true)
    })
}

/// A spray of nine leaves on a twig that grows from the bottom edge's middle; the rest is cut out.
pub fn leaf_spray() -> Texture {
    // Leaf base along the twig, side, length: pairs from low to high, then the tip.
    let leaves: Vec<([f64; 2], [f64; 2])> = (0..9)
        .map(|k| {
            let along = 0.12 + 0.17 * (k / 2) as f64;
            let side = if k == 8 { 0.0 } else { [-1.0, 1.0][k % 2] };
            let base = [0.5, 1.0 - along - if k == 8 { -0.06 } else { 0.0 }];
            let reach = if k == 8 { 0.30 } else { 0.36 - 0.02 * (k / 2) as f64 };
            let lean = if side == 0.0 { [0.0, -1.0] } else { [side * 0.86, -0.51] };
            (base, [lean[0] * reach, lean[1] * reach])
        })
        .collect();
    texture("leaf_spray", 128, |x, y| {
        let mut hit = None;
        for (k, (base, axis)) in leaves.iter().enumerate() {
            let length = (axis[0] * axis[0] + axis[1] * axis[1]).sqrt();
            let (dx, dy) = (x - base[0], y - base[1]);
            let s = (dx * axis[0] + dy * axis[1]) / (length * length);
            let t = (dx * axis[1] - dy * axis[0]) / length;
            // A leaf's half width along its length: full in the first third, pointed at the end.
            let width = 0.085 * (4.0 * s * (1.0 - s)).max(0.0).sqrt() * (1.25 - 0.5 * s);
            if (0.0..1.0).contains(&s) && t.abs() < width {
                hit = Some((k, t.abs() / width));
            }
        }
        let twig = (x - 0.5).abs() < 0.012 && y > 0.2;
        let green = |k: usize| mix([70.0, 112.0, 38.0], [118.0, 146.0, 58.0], cell(k as i64, 0, 71));
        match hit {
            Some((_, across)) if across < 0.08 => ([150.0, 168.0, 96.0], true),
            Some((k, across)) => (scaled(green(k), 1.0 - 0.12 * across), true),
            // Cut-out texels carry leaf colour too, so that filtering does not darken the rim.
            None => (if twig { [98.0, 82.0, 54.0] } else { [94.0, 129.0, 48.0] }, twig),
        }
    })
}
