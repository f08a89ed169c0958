//! The farm's textures, authored in 8-bit sRGB. All tile but the yard's, which is painted for its place.

use super::terrain::{YARD, smooth};
use crate::model::Texture;
use crate::random::{cell, noise};
use crate::textures::{Colour, fractal, mix, scaled, texture};
use glam::DVec2;

/// Metres that the land's textures cover.
pub const MEADOW: f64 = 4.0;
pub const SOIL: f64 = 3.2;
pub const STUBBLE: f64 = 3.2;
pub const TRACK: f64 = 8.0;

const EARTH: Colour = [150.0, 128.0, 104.0];
const DARK_EARTH: Colour = [112.0, 92.0, 76.0];

/// Grass at a place of its texture: patches and blades, so many to the tile.
fn turf(x: f64, y: f64, cells: i64, blades: i64) -> Colour {
    let patch = fractal(x, y, cells, 301);
    let (fine, long) = (blades as f64, blades as f64 / 2.0);
    let blade = noise(x * fine, y * long, blades, 302) * 0.6 + noise(x * long, y * fine, blades, 303) * 0.4;
    let dry = smooth((fractal(x, y, cells * 2, 304) - 0.55) * 5.0);
    let green = mix([92.0, 112.0, 66.0], [124.0, 136.0, 78.0], patch);
    scaled(mix(green, [158.0, 146.0, 98.0], 0.5 * dry), 0.78 + 0.34 * blade)
}

/// Steps of 4, which PNG packs better than noise in every bit.
fn coarse(colour: Colour) -> Colour {
    colour.map(|c| (c / 4.0).round() * 4.0)
}

pub fn meadow() -> Texture {
    texture("meadow", 256, |x, y| (turf(x, y, 3, 96), true))
}

/// Bare soil with clods and a few stones.
pub fn soil() -> Texture {
    texture("soil", 256, |x, y| {
        let clods = fractal(x, y, 20, 311);
        let damp = fractal(x, y, 3, 312);
        let stone = fractal(x, y, 40, 313) > 0.80;
        let base = mix([98.0, 80.0, 68.0], [138.0, 112.0, 90.0], 0.6 * clods + 0.4 * damp);
        (if stone { [166.0, 158.0, 146.0] } else { scaled(base, 0.8 + 0.4 * clods) }, true)
    })
}

/// Cut straw in drilled rows, 16 to the tile, over pale soil.
pub fn stubble() -> Texture {
    texture("stubble", 256, |x, y| {
        let row = (x * 16.0).fract();
        let stalks = cell((x * 256.0) as i64, (y * 96.0) as i64, 321);
        let thick = 0.55 + 0.3 * fractal(x, y, 4, 322);
        let straw = (row - 0.5).abs() < 0.26 && stalks < thick || stalks < 0.16;
        let base = mix([128.0, 108.0, 84.0], [148.0, 126.0, 94.0], fractal(x, y, 8, 323));
        let colour =
            if straw { mix([196.0, 170.0, 112.0], [222.0, 198.0, 138.0], stalks / thick) } else { base };
        (coarse(scaled(colour, 0.94 + 0.1 * fractal(x, y, 5, 324))), true)
    })
}

/// The track from verge to verge: grass, rut, grass, rut, grass; it runs along y.
pub fn track() -> Texture {
    texture("track", 512, |x, y| {
        let u = (x - 0.5).abs() * TRACK;
        let ragged = 0.5 * (fractal(x, y, 12, 331) - 0.5) + 0.35 * (fractal(x, y, 48, 332) - 0.5);
        let bare = smooth((1.75 - u + ragged * 1.6) / 0.5);
        let crown = smooth((0.42 - u + ragged * 1.3) / 0.3);
        (coarse(mix(turf(x, y, 6, 192), earth(x, y), bare * (1.0 - 0.85 * crown))), true)
    })
}

/// Trodden earth with gravel in it.
fn earth(x: f64, y: f64) -> Colour {
    let damp = smooth((fractal(x, y, 9, 333) - 0.5) * 4.0);
    let gravel = cell((x * 512.0) as i64, (y * 512.0) as i64, 334);
    let base = mix(EARTH, DARK_EARTH, 0.6 * damp);
    let stony = if gravel > 0.93 { 1.22 } else { 0.93 + 0.12 * fractal(x, y, 60, 335) };
    scaled(base, stony)
}

/// Ways that are walked and driven, by radius: from, to.
const WAYS: [([f64; 2], [f64; 2], f64); 7] = [
    ([0.0, 25.0], [0.0, 16.0], 1.9),
    ([0.0, 16.0], [-3.0, 6.0], 2.4),
    ([-3.0, 6.0], [-14.0, -1.5], 3.0),
    ([-3.0, 2.0], [14.0, 6.0], 2.6),
    ([2.0, -3.0], [12.9, -11.5], 0.9),
    ([-6.0, -2.0], [-3.5, -15.0], 1.3),
    ([10.0, 5.0], [24.0, 12.0], 1.2),
];

/// The farmyard's ground, painted as a whole: earth where wheels and feet go, grass elsewhere, straw before
/// the barn.
pub fn yard_ground() -> Texture {
    texture("yard_ground", 1024, |x, y| {
        let p = DVec2::new(x - 0.5, y - 0.5) * (2.0 * YARD);
        let to_way = |(a, b, radius): ([f64; 2], [f64; 2], f64)| {
            let (a, b) = (DVec2::from(a), DVec2::from(b));
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            p.distance(a.lerp(b, t)) - radius
        };
        let blob = (((p - DVec2::new(-2.0, 0.5)) / DVec2::new(12.0, 7.5)).length() - 1.0) * 7.5;
        let distance = WAYS.into_iter().map(to_way).fold(blob, f64::min);
        let ragged = 2.6 * (fractal(x, y, 16, 341) - 0.5) + 1.4 * (fractal(x, y, 80, 342) - 0.5);
        let bare = smooth((0.5 - distance + ragged) / 1.1);
        // Wheels press two lines into the ways.
        let wheels = WAYS[..4].iter().map(|&w| (to_way(w) + w.2 - 0.85).abs()).fold(9.0, f64::min);
        let pressed = smooth((0.34 - wheels + 0.3 * (fractal(x, y, 40, 343) - 0.5)) / 0.25);
        let ground = mix(earth(x, y), DARK_EARTH, 0.45 * pressed);
        let door = p.distance(DVec2::new(-14.0, -1.0));
        let straw = cell((x * 512.0) as i64, (y * 1024.0) as i64, 344) > 0.72 + 0.05 * door;
        let colour = mix(turf(x, y, 36, 512), ground, bare);
        (coarse(if straw { mix(colour, [214.0, 188.0, 124.0], 0.8) } else { colour }), true)
    })
}

/// The fields around, a patchwork with hedges between.
pub fn far_fields() -> Texture {
    const CELLS: i64 = 12;
    const CROPS: [Colour; 5] = [
        [108.0, 122.0, 72.0],
        [186.0, 166.0, 112.0],
        [122.0, 102.0, 84.0],
        [124.0, 136.0, 78.0],
        [150.0, 146.0, 92.0],
    ];
    texture("far_fields", 512, |x, y| {
        let warp = |seed| 0.05 * (fractal(x, y, 5, seed) - 0.5);
        let (fx, fy) = ((x + warp(351)) * CELLS as f64, (y + warp(352)) * CELLS as f64);
        // The nearest two of jittered cell points.
        let mut near = [(9.0f64, 0.0f64), (9.0, 0.0)];
        for (i, j) in (0..9).map(|k| (fx.floor() as i64 + k % 3 - 1, fy.floor() as i64 + k / 3 - 1)) {
            let (a, b) = (i.rem_euclid(CELLS), j.rem_euclid(CELLS));
            let (dx, dy) = (i as f64 + cell(a, b, 353) - fx, j as f64 + cell(a, b, 354) - fy);
            // Fields have straight sides.
            let d = dx.abs() + dy.abs();
            if d < near[0].0 {
                near = [(d, cell(a, b, 355)), near[0]];
            } else if d < near[1].0 {
                near[1] = (d, 0.0);
            }
        }
        let home = smooth((0.078 - (x - 0.5).abs().max((y - 0.5).abs())) / 0.01);
        let hedge = near[1].0 - near[0].0 < 0.05;
        let crop = CROPS[(near[0].1 * 5.0) as usize % 5];
        let field = if hedge { [76.0, 88.0, 64.0] } else { scaled(crop, 0.9 + 0.2 * fractal(x, y, 40, 356)) };
        (coarse(mix(field, [112.0, 126.0, 74.0], home)), true)
    })
}

/// Eight upright boards to the tile, silvered by weather, each with knots and a dark joint.
pub fn boards() -> Texture {
    texture("boards", 256, |x, y| {
        let board = (x * 8.0).floor() as i64;
        let inside = (x * 8.0).fract();
        let (tone, shift) = (cell(board, 0, 361), cell(board, 1, 362));
        let streak = noise(x * 80.0, (y + shift) * 3.0, 80, 363);
        let fine = noise(x * 160.0, (y + shift) * 24.0, 160, 364);
        let base = mix([150.0, 128.0, 106.0], [182.0, 166.0, 146.0], 0.7 * tone + 0.3 * streak);
        let joint = if !(0.04..0.96).contains(&inside) { 0.5 } else { 1.0 };
        (scaled(base, joint * (0.80 + 0.2 * streak + 0.08 * fine)), true)
    })
}

/// Zinc sheet, weathered, with rust running down from its laps.
pub fn metal_sheet() -> Texture {
    texture("metal_sheet", 256, |x, y| {
        let sheet = (x * 3.0).floor() as i64;
        let tone = 0.92 + 0.12 * cell(sheet, (y * 2.0) as i64, 371);
        let run = noise(x * 48.0, y * 3.0, 48, 372) * (1.0 - (y * 2.0).fract());
        let rust = smooth((run * 0.7 + 0.5 * fractal(x, y, 6, 373) - 0.62) * 4.0);
        let lap = (y * 2.0).fract() < 0.012 || (x * 3.0).fract() < 0.01;
        let zinc = scaled([172.0, 176.0, 178.0], tone * (0.94 + 0.1 * fractal(x, y, 24, 374)));
        (scaled(mix(zinc, [138.0, 98.0, 76.0], 0.7 * rust), if lap { 0.7 } else { 1.0 }), true)
    })
}

/// Straw, lying every way.
pub fn straw() -> Texture {
    texture("straw", 256, |x, y| {
        let lying = noise(x * 24.0, y * 150.0, 150, 381) * 0.5 + noise(x * 150.0, y * 32.0, 150, 382) * 0.5;
        let matted = fractal(x, y, 8, 383);
        (scaled(mix([168.0, 140.0, 88.0], [226.0, 204.0, 142.0], lying), 0.78 + 0.3 * matted), true)
    })
}

/// Field stones of a wall, fitted dry.
pub fn rubble() -> Texture {
    const CELLS: i64 = 9;
    texture("rubble", 256, |x, y| {
        let warp = 0.12 * (fractal(x, y, 6, 391) - 0.5);
        let (fx, fy) = ((x + warp) * CELLS as f64, (y - warp) * CELLS as f64 * 1.4);
        let rows = (CELLS as f64 * 1.4).round() as i64;
        let fy = fy * rows as f64 / (CELLS as f64 * 1.4);
        let mut near = [(9.0f64, 0.0f64), (9.0, 0.0)];
        for (i, j) in (0..9).map(|k| (fx.floor() as i64 + k % 3 - 1, fy.floor() as i64 + k / 3 - 1)) {
            let (a, b) = (i.rem_euclid(CELLS), j.rem_euclid(rows));
            let dx = i as f64 + 0.5 + 0.7 * (cell(a, b, 392) - 0.5) - fx;
            let dy = j as f64 + 0.5 + 0.5 * (cell(a, b, 393) - 0.5) - fy;
            let d = (dx * dx + dy * dy).sqrt();
            if d < near[0].0 {
                near = [(d, cell(a, b, 394)), near[0]];
            } else if d < near[1].0 {
                near[1] = (d, 0.0);
            }
        }
        let stone = mix([138.0, 132.0, 124.0], [184.0, 176.0, 160.0], near[0].1);
        let joint = smooth((near[1].0 - near[0].0) / 0.16);
        let moss = smooth((fractal(x, y, 5, 395) - 0.6) * 6.0);
        let face = mix(stone, [126.0, 130.0, 92.0], 0.6 * moss);
        (scaled(face, (0.45 + 0.55 * joint) * (0.86 + 0.24 * fractal(x, y, 32, 396))), true)
    })
}

/// Slates in courses, twelve by twelve to the tile.
pub fn slate() -> Texture {
    texture("slate", 256, |x, y| {
        let row = (y * 12.0).floor();
        let along = (x * 12.0 + 0.5 * (row % 2.0)).rem_euclid(12.0);
        let tone = cell(along as i64, row as i64, 401);
        let edge = !(0.05..0.95).contains(&along.fract()) || (y * 12.0).fract() > 0.9;
        let base = mix([100.0, 106.0, 116.0], [140.0, 142.0, 146.0], tone);
        (scaled(base, (if edge { 0.7 } else { 1.0 }) * (0.9 + 0.18 * fractal(x, y, 24, 402))), true)
    })
}
