//! Seamless textures of the city, authored in 8-bit sRGB.

use crate::model::Texture;
use crate::random::{cell, noise};
use crate::textures::{Colour, fractal, mix, scaled, texture};

/// Bare asphalt of a few shades at a point of a texture that covers `metres`.
fn bitumen(x: f64, y: f64, metres: f64, seed: u64) -> Colour {
    let cells = (metres * 12.0) as i64;
    let grain = noise(x * (cells * 2) as f64, y * (cells * 2) as f64, cells * 2, seed);
    let patch = fractal(x, y, (metres * 0.7) as i64 + 1, seed + 5);
    scaled([104.0, 103.0, 102.0], 0.82 + 0.2 * patch + 0.18 * (grain - 0.5))
}

/// A roadway across the whole texture: gutters, worn wheel tracks, repairs, a dashed line in the middle.
pub fn road() -> Texture {
    texture("road", 512, |x, y| {
        let across = (x - 0.5).abs() * 2.0;
        let track = [0.14, 0.42].map(|t: f64| (-((across - t) / 0.06).powi(2)).exp()).iter().sum::<f64>();
        let mut colour = scaled(bitumen(x, y, 11.0, 201), 1.0 - 0.10 * track);
        // Two repaired trenches, darker and with a seam.
        for [x0, y0, x1, y1] in [[0.58, 0.12, 0.74, 0.36], [0.2, 0.6, 0.27, 0.97]] {
            let inside = (x - x0).min(x1 - x).min(y - y0).min(y1 - y);
            if inside > 0.0 {
                colour = scaled(colour, if inside < 0.004 { 0.55 } else { 0.78 });
            }
        }
        let worn = fractal(x, y, 24, 207);
        let dash = across < 0.013 && !(0.2..0.62).contains(&y);
        let parking = (across - 0.60).abs() < 0.010 && (y * 2.0).fract() < 0.5;
        if (dash || parking) && worn > 0.28 {
            colour = mix(colour, [212.0, 210.0, 204.0], 0.85);
        }
        // Setts along the gutters.
        if across > 0.94 {
            let stone = cell((y * 40.0) as i64, (across > 0.97) as i64, 208);
            let joint = !(0.06..0.94).contains(&(y * 40.0).fract());
            colour = scaled([128.0, 124.0, 118.0], if joint { 0.6 } else { 0.85 + 0.25 * stone });
        }
        (colour, true)
    })
}

/// Asphalt without markings.
pub fn asphalt() -> Texture {
    texture("asphalt", 256, |x, y| (bitumen(x, y, 4.0, 221), true))
}

/// Half white, half asphalt, bars along v.
pub fn zebra() -> Texture {
    texture("zebra", 128, |x, y| {
        let base = bitumen(x, y, 2.0, 231);
        let worn = fractal(x, y, 12, 232);
        let white = (0.25..0.75).contains(&x) && worn > 0.2;
        (if white { mix(base, [216.0, 214.0, 208.0], 0.9) } else { base }, true)
    })
}

/// Slabs of 40 × 60 cm in a bond, each with its tone.
pub fn pavement() -> Texture {
    texture("pavement", 256, |x, y| {
        let row = (y * 6.0).floor();
        let along = (x * 4.0 + 0.5 * (row % 2.0)).rem_euclid(4.0);
        let tone = cell(along as i64, row as i64, 241);
        let warm = cell(along as i64, row as i64, 242);
        let base = mix([150.0, 148.0, 145.0], [172.0, 163.0, 150.0], warm);
        let joint = !(0.012..0.988).contains(&along.fract()) || !(0.018..0.982).contains(&(y * 6.0).fract());
        let grain = 0.93 + 0.12 * fractal(x, y, 40, 243);
        (scaled(base, (0.88 + 0.16 * tone) * grain * if joint { 0.62 } else { 1.0 }), true)
    })
}

/// Dressed stone in courses of 40 cm, a bond of four by eight.
pub fn ashlar() -> Texture {
    texture("ashlar", 256, |x, y| {
        let row = (y * 8.0).floor();
        let along = (x * 4.0 + 0.5 * (row % 2.0)).rem_euclid(4.0);
        let tone = cell(along as i64, row as i64, 251);
        let stain = fractal(x, y, 3, 252);
        let base = mix([200.0, 182.0, 148.0], [222.0, 206.0, 172.0], tone);
        let joint = !(0.018..0.982).contains(&along.fract()) || !(0.035..0.965).contains(&(y * 8.0).fract());
        let grain = 0.93 + 0.09 * fractal(x, y, 32, 253);
        (scaled(base, (0.9 + 0.12 * stain) * grain * if joint { 0.72 } else { 1.0 }), true)
    })
}

/// Slates, ten to the tile in twelve rows.
pub fn slate() -> Texture {
    texture("slate", 256, |x, y| {
        let row = (y * 12.0).floor();
        let along = (x * 10.0 + 0.5 * (row % 2.0)).rem_euclid(10.0);
        let tone = cell(along as i64, row as i64, 261);
        let blue = mix([92.0, 98.0, 108.0], [122.0, 124.0, 130.0], tone);
        let (inside, down) = (along.fract(), (y * 12.0).fract());
        let shade = if !(0.05..0.95).contains(&inside) || down < 0.12 { 0.66 } else { 1.0 };
        (scaled(blue, shade * (0.9 + 0.18 * fractal(x, y, 16, 262))), true)
    })
}

/// Plaster fronts with rows of windows, as seen from afar: four storeys of six windows.
pub fn distant_windows() -> Texture {
    texture("distant_windows", 256, |x, y| {
        let (u, v) = ((x * 6.0).fract(), (y * 4.0).fract());
        let base = scaled([206.0, 192.0, 166.0], 0.92 + 0.12 * fractal(x, y, 6, 271));
        let (across, up) = ((u - 0.5).abs(), (v - 0.5).abs());
        let colour = if across < 0.2 && up < 0.27 {
            let bar = across < 0.02 || (v - 0.4).abs() < 0.02 || across > 0.17 || up > 0.245;
            let curtain = cell((x * 6.0) as i64, (y * 4.0) as i64, 272);
            if bar { [214.0, 210.0, 200.0] } else { scaled([74.0, 80.0, 86.0], 0.8 + 0.5 * curtain) }
        } else if across < 0.25 && up < 0.31 {
            scaled(base, 1.08)
        } else if v > 0.95 {
            scaled(base, 0.86)
        } else {
            base
        };
        (colour, true)
    })
}
