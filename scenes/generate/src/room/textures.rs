//! Seamless textures of the room, authored in 8-bit sRGB, and its pictures.

use crate::model::Texture;
use crate::random::{cell, noise};
use crate::textures::{Colour, fractal, mix, scaled, texture};

/// Metres that the parquet covers.
pub const PARQUET: f64 = 1.2;

/// Strips of oak in an English bond, twelve rows of three to the tile.
pub fn parquet() -> Texture {
    texture("parquet", 512, |x, y| {
        let row = (y * 12.0).floor();
        let along = (x * 3.0 + cell(row as i64, 7, 100)).rem_euclid(3.0);
        let strip = along.floor() as i64;
        let tone = cell(strip, row as i64, 101);
        let shift = cell(strip, row as i64, 102);
        let streak = noise(x * 8.0 + shift * 8.0, y * 96.0, 96, 103);
        let fine = noise(x * 32.0, y * 256.0, 256, 104);
        let (across, end) = ((y * 12.0).fract(), along.fract());
        let joint =
            if !(0.025..0.975).contains(&across) || !(0.008..0.992).contains(&end) { 0.55 } else { 1.0 };
        let base = mix([152.0, 104.0, 62.0], [190.0, 142.0, 92.0], tone);
        (scaled(base, joint * (0.82 + 0.16 * streak + 0.08 * fine)), true)
    })
}

/// Pale stripes and a small leaf between them.
pub fn wallpaper() -> Texture {
    texture("wallpaper", 256, |x, y| {
        let stripe = if (x * 8.0).fract() < 0.5 { 1.0 } else { 0.965 };
        // Half-drop repeat.
        let column = (x * 8.0).floor();
        let (cx, cy) = ((x * 8.0).fract() - 0.5, (y * 6.0 + 0.5 * (column % 2.0)).fract() - 0.5);
        let (u, v) = (cx + cy * 0.5, cy - cx * 0.5);
        let leaf = (u / 0.10).powi(2) + (v / 0.26).powi(2) < 1.0 - 0.7 * v;
        let base: Colour = if leaf { [190.0, 200.0, 178.0] } else { [232.0, 228.0, 212.0] };
        (scaled(base, stripe * (0.97 + 0.05 * fractal(x, y, 24, 111))), true)
    })
}

/// A plain weave of sixteen threads each way, nearly white, to be dyed.
pub fn weave() -> Texture {
    texture("weave", 128, |x, y| {
        let (i, j) = ((x * 16.0).floor(), (y * 16.0).floor());
        let over = (i + j) as i64 % 2 == 0;
        let (s, t) = ((x * 16.0).fract() - 0.5, (y * 16.0).fract() - 0.5);
        let round = if over { 1.0 - 1.2 * t * t } else { 1.0 - 1.2 * s * s };
        let gap = if over { 1.0 - 0.6 * s * s } else { 1.0 - 0.6 * t * t };
        let tone = 0.92 + 0.16 * cell(i as i64, j as i64, 121);
        (
            scaled(
                [238.0, 236.0, 232.0],
                (round * gap * tone * (0.92 + 0.1 * fractal(x, y, 8, 122))).min(1.06),
            ),
            true,
        )
    })
}

/// Diamonds in bands, of wool.
pub fn rug() -> Texture {
    texture("rug", 256, |x, y| {
        let band = (y * 4.0).floor() as i64;
        let (u, v) = ((x * 4.0).fract() - 0.5, (y * 4.0).fract() - 0.5);
        let diamond = u.abs() + v.abs();
        let ground: Colour = if band % 2 == 0 { [134.0, 58.0, 48.0] } else { [54.0, 70.0, 92.0] };
        let colour = match diamond {
            d if d < 0.16 => [206.0, 168.0, 104.0],
            d if d < 0.26 => [70.0, 44.0, 40.0],
            d if d < 0.38 => [214.0, 198.0, 168.0],
            _ => ground,
        };
        let edge = v.abs() > 0.46;
        let pile = 0.8 + 0.3 * noise(x * 128.0, y * 128.0, 128, 131);
        (scaled(if edge { [210.0, 190.0, 158.0] } else { colour }, pile), true)
    })
}

/// A picture: hills under an evening sky.
pub fn landscape() -> Texture {
    texture("landscape", 256, |x, y| {
        let sun = ((x - 0.68).powi(2) + (y - 0.42).powi(2)).sqrt();
        let sky = mix([82.0, 112.0, 160.0], [232.0, 176.0, 120.0], (y / 0.6).min(1.0));
        let mut colour = if sun < 0.07 { [250.0, 226.0, 170.0] } else { sky };
        for (k, tone) in
            [[128.0, 112.0, 134.0], [92.0, 98.0, 92.0], [58.0, 76.0, 50.0]].into_iter().enumerate()
        {
            let k = k as f64;
            let ridge = 0.5 + 0.14 * k + 0.16 * (fractal(x, 0.37 * k, 3, 141 + k as u64) - 0.5);
            if y > ridge {
                colour = scaled(tone, 0.85 + 0.3 * fractal(x, y, 16, 145));
            }
        }
        (colour, true)
    })
}

/// A picture: blocks of colour between dark bars.
pub fn blocks() -> Texture {
    texture("blocks", 128, |x, y| {
        let (xs, ys) = ([0.0, 0.22, 0.58, 0.8, 1.0], [0.0, 0.3, 0.48, 0.86, 1.0]);
        let find = |t: f64, lines: [f64; 5]| (0..4).find(|&k| t < lines[k + 1]).unwrap_or(3);
        let (i, j) = (find(x, xs), find(y, ys));
        let near = |t: f64, lines: [f64; 5]| lines[1..4].iter().any(|l| (t - l).abs() < 0.012);
        let colours: [Colour; 5] = [
            [222.0, 214.0, 196.0],
            [186.0, 60.0, 44.0],
            [48.0, 74.0, 126.0],
            [226.0, 178.0, 62.0],
            [222.0, 214.0, 196.0],
        ];
        let pick = (cell(i as i64, j as i64, 154) * 5.0) as usize;
        let colour = if near(x, xs) || near(y, ys) { [52.0, 48.0, 46.0] } else { colours[pick.min(4)] };
        (scaled(colour, 0.94 + 0.1 * fractal(x, y, 16, 152)), true)
    })
}
