//! The stiff cases of light and geometry, side by side: closed boxes in two rows on a slab, open things
//! before them, a vault below. Every case has a node of its name; `*_occluder` only blocks light.

#[cfg(test)]
mod tests;

use crate::mesh::Mesh;
use crate::model::{Material, Model};
use crate::relief::{full, plate, steps};
use crate::shapes::{ALL, BOTTOM, Faces, NORTH, SOUTH, block};
use crate::textures::texture;
use glam::{DVec2, DVec3};

/// Half the inner side of a box, and the height of its floor and ceiling.
const HALF: f64 = 1.0;
const FLOOR: f64 = 0.1;
const CEILING: f64 = 2.1;
/// The boxes' outer bottoms, below the slab.
const FOOT: f64 = -0.05;
/// Of the boxes' walls.
const THICK: f64 = 0.1;
/// Of the walls with keyholes.
const THIN: f64 = 0.02;
/// Side of a keyhole, and the height of its lower edge.
const KEYHOLE: f64 = 0.01;
const KEYHOLE_HEIGHT: f64 = 1.4;
/// Middles of the boxes, (x, z); the mirror's box is twice as long as the others.
pub const KEYHOLE_PORTAL: [f64; 2] = [-4.5, 1.5];
pub const KEYHOLE_BARE: [f64; 2] = [-1.5, 1.5];
pub const BRIGHT: [f64; 2] = [1.5, 1.5];
pub const DIM: [f64; 2] = [4.5, 1.5];
pub const MIRROR: [f64; 2] = [-3.5, -2.5];
pub const BLINK: [f64; 2] = [0.5, -2.5];
pub const TINY: [f64; 2] = [3.5, -2.5];
/// Side of the tiny emitter, which hangs in the middle of its box and shines down.
const EMITTER: f64 = 1e-4;
/// Half the side of the slab.
const SLAB: f64 = 7.0;
/// Half the side of the dark vault's floor, and its depth.
const VAULT: f64 = 6.0;
const DEPTH: [f64; 2] = [-2.0, -1.0];
/// Length of the slivers; their widths at the far end fall from the first to the last.
const SLIVER: f64 = 1.0;
const WIDTHS: [f64; 2] = [1e-2, 1e-5];
/// Side of the cube that has a texel a face, or less.
const ONE_TEXEL: f64 = 0.06;

/// The whole scene.
pub fn model() -> Model {
    let mut model = Model::default();
    materials(&mut model);
    let ground = steps(-SLAB, SLAB, 14);
    model.add("ground", "grey", full(&ground, &ground, |z, x| DVec3::new(x, 0.0, z)));
    keyhole_box(&mut model, "keyhole_portal", KEYHOLE_PORTAL);
    keyhole_box(&mut model, "keyhole_bare", KEYHOLE_BARE);
    closed_box(&mut model, "bright_box", BRIGHT, HALF);
    closed_box(&mut model, "dim_box", DIM, HALF);
    closed_box(&mut model, "blink_box", BLINK, HALF);
    closed_box(&mut model, "tiny_box", TINY, HALF);
    emitter(&mut model);
    mirror_box(&mut model);
    vault(&mut model);
    slivers(&mut model);
    let at = [-2.5, 4.5];
    let (low, high) = ([at[0], -0.01, at[1]], [at[0] + ONE_TEXEL, ONE_TEXEL, at[1] + ONE_TEXEL]);
    model.add("one_texel", "grey", block(low, high, ALL & !BOTTOM));
    alpha_stack(&mut model);
    model
}

fn materials(model: &mut Model) {
    // Round holes in an eight by eight grid, a little more hole than sheet.
    model.textures.push(texture("holes", 128, |x, y| {
        let (dx, dy) = ((x * 8.0).fract() - 0.5, (y * 8.0).fract() - 0.5);
        ([190.0, 190.0, 190.0], (dx * dx + dy * dy).sqrt() > 0.41)
    }));
    for (name, albedo) in [("grey", 0.5), ("pale", 0.7), ("mirror_bright", 0.97), ("black", 0.005)] {
        let (albedo, texture) = ([albedo; 3], None);
        model.materials.push(Material { name, albedo, texture, cutoff: None, double_sided: false });
    }
    model.materials.push(Material {
        name: "cut_out",
        albedo: [1.0; 3],
        texture: Some((0, 1.0)),
        cutoff: Some(0.5),
        double_sided: true,
    });
}

/// Some inner faces of a box, seen from inside; its length is twice `reach`.
fn inside([x, z]: [f64; 2], reach: f64, faces: Faces) -> Mesh {
    block([x - reach, FLOOR, z - HALF], [x + reach, CEILING, z + HALF], faces).flipped()
}

/// Some outer faces of a box.
fn shell([x, z]: [f64; 2], reach: f64, faces: Faces) -> Mesh {
    let out = HALF + THICK;
    block([x - reach - THICK, FOOT, z - out], [x + reach + THICK, CEILING + THICK, z + out], faces)
}

fn closed_box(model: &mut Model, name: &str, at: [f64; 2], reach: f64) {
    model.add(name, "pale", inside(at, reach, ALL));
    model.add(&format!("{name}_occluder"), "grey", shell(at, reach, ALL));
}

/// A box whose southern wall is thin and has a hole: an inner and an outer sheet, and the hole's sides
/// between them.
fn keyhole_box(model: &mut Model, name: &str, at: [f64; 2]) {
    model.add(name, "pale", inside(at, HALF, ALL & !SOUTH));
    let [x, z] = at;
    let out = HALF + THICK;
    let south = z + HALF + THIN;
    let outer = block([x - out, FOOT, z - out], [x + out, CEILING + THICK, south], ALL & !SOUTH);
    model.add(&format!("{name}_occluder"), "grey", outer);
    let holed = |reach: f64, low: f64, high: f64| {
        let xs = [-reach, -KEYHOLE / 2.0, KEYHOLE / 2.0, reach];
        let ys = [low, KEYHOLE_HEIGHT, KEYHOLE_HEIGHT + KEYHOLE, high];
        let sheets = plate(&xs, &ys, THIN, |i, j| (i, j) != (1, 1), DVec2::new);
        let put = |mesh: Mesh| mesh.translated(x, 0.0, south - THIN / 2.0);
        (put(sheets.front), put(sheets.back), put(sheets.edges))
    };
    let (_, back, sides) = holed(HALF, FLOOR, CEILING);
    model.add(&format!("{name}_wall"), "pale", back);
    let (front, ..) = holed(out, FOOT, CEILING + THICK);
    model.add(&format!("{name}_occluder"), "grey", front.with(sides));
}

/// A square that its group makes shine.
fn emitter(model: &mut Model) {
    let (y, h) = ((FLOOR + CEILING) / 2.0, EMITTER / 2.0);
    let square = block([TINY[0] - h, y, TINY[1] - h], [TINY[0] + h, y + h, TINY[1] + h], BOTTOM);
    model.add("tiny_emitter", "grey", square);
}

/// Two walls as bright and as black as walls get, 2 m apart; the lamp hangs between them.
fn mirror_box(model: &mut Model) {
    let reach = 2.0 * HALF;
    model.add("mirror_box", "grey", inside(MIRROR, reach, ALL & !NORTH & !SOUTH));
    model.add("mirror_wall", "mirror_bright", inside(MIRROR, reach, NORTH));
    model.add("black_wall", "black", inside(MIRROR, reach, SOUTH));
    model.add("mirror_box_occluder", "grey", shell(MIRROR, reach, ALL));
}

/// A closed vault under the slab, which no light ever enters; only its floor has texels.
fn vault(model: &mut Model) {
    let inner = |faces| block([-VAULT, DEPTH[0], -VAULT], [VAULT, DEPTH[1], VAULT], faces).flipped();
    let outer = block([-SLAB, DEPTH[0] - THICK, -SLAB], [SLAB, FOOT - THICK, SLAB], ALL);
    model.add("dark_floor", "pale", inner(BOTTOM));
    model.add("dark_vault_occluder", "pale", inner(ALL & !BOTTOM).with(outer));
}

/// Needles that rise from the slab in a row, each as wide at its top as a step of a geometric series says.
fn slivers(model: &mut Model) {
    let count = 24;
    let mut mesh = Mesh::default();
    for k in 0..count {
        let t = k as f64 / (count - 1) as f64;
        let half = WIDTHS[0].powf(1.0 - t) * WIDTHS[1].powf(t) / 2.0;
        let (x, z) = (-6.0 + 0.12 * k as f64, 5.5);
        let corners = [
            DVec3::new(x, 0.01, z),
            DVec3::new(x + half, 0.01 + SLIVER, z),
            DVec3::new(x - half, 0.01 + SLIVER, z),
        ];
        mesh.polygon(&corners.map(|c| (c, DVec2::new(c.x, -c.y))));
    }
    model.add("slivers", "pale", mesh);
}

/// Seven sheets with holes, one above the other and each turned a little, on the slab.
fn alpha_stack(model: &mut Model) {
    for k in 0..7 {
        let (half, y) = (0.6, 0.05 + 0.06 * k as f64);
        let sheet = full(&[-half, half], &[-half, half], |z, x| DVec3::new(x, 0.0, z)).turned(7.0 * k as f64);
        model.add("alpha_stack", "cut_out", sheet.translated(2.5, y, 5.0));
    }
}
