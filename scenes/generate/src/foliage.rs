//! Leaf cards, and what is made of them alone.

use crate::mesh::Mesh;
use crate::random::Random;
use glam::{DVec2, DVec3};
use std::ops::Range;

/// Adds a leaf card that grows from `root` along `axis`, turned about it at random.
pub fn card(mesh: &mut Mesh, root: DVec3, axis: DVec3, size: f64, random: &mut Random) {
    let side = axis.cross(random.direction()).normalize_or(axis.any_orthonormal_vector()) * (size / 2.0);
    let high = root + axis * size;
    mesh.polygon(&[
        (root - side, DVec2::new(0.0, 1.0)),
        (root + side, DVec2::new(1.0, 1.0)),
        (high + side, DVec2::new(1.0, 0.0)),
        (high - side, DVec2::new(0.0, 0.0)),
    ]);
}

/// A shrub: cards that leave the ellipsoid (`centre`, `radii`) to all sides above its middle.
pub fn shrub(centre: DVec3, radii: DVec3, cards: usize, sizes: Range<f64>, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut leaves = Mesh::default();
    for _ in 0..cards {
        let mut out = random.direction();
        out.y = out.y.abs() * 1.2 - 0.2;
        let root = centre + out * radii * random.range(0.2, 0.75);
        let axis = (out + DVec3::Y * 0.5 + random.direction() * 0.4).normalize();
        let size = random.range(sizes.start, sizes.end);
        card(&mut leaves, root, axis, size, &mut random);
    }
    leaves
}
