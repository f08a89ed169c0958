//! Soft and moulded shapes: cushions, slabs of cloth, mouldings along an edge.

use crate::mesh::Mesh;
use crate::relief::{full, steps};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_4;

/// A closed box about the origin with half extents `half`, its edges rounded by `radius` in `2 · arc` steps,
/// its faces divided `cells` times per axis and swollen by `puff` metres in their middles. Smooth all over.
pub fn cushion(half: DVec3, radius: f64, arc: usize, cells: usize, puff: DVec3) -> Mesh {
    // Coordinates along an axis: the rounded ends at equal angles, the flat middle in equal steps.
    let lines = |axis: usize| {
        let flat = half[axis] - radius;
        let ends = |sign: f64| {
            (1..=arc).map(move |k| sign * (flat + radius * (FRAC_PI_4 * k as f64 / arc as f64).tan()))
        };
        let mut lines: Vec<f64> = ends(-1.0).collect();
        lines.reverse();
        lines.extend(steps(-flat, flat, cells));
        lines.extend(ends(1.0));
        lines
    };
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
            if sign < 0.0 {
                (u, v) = (v, u);
            }
            let place = |s: f64, t: f64| {
                let mut cube = DVec3::ZERO;
                (cube[axis], cube[u], cube[v]) = (sign * half[axis], s, t);
                let core = cube.clamp(DVec3::splat(radius) - half, half - DVec3::splat(radius));
                let mut p = core + (cube - core).normalize() * radius;
                let q = p / half;
                let bulge = DVec3::ONE - q * q;
                for k in 0..3 {
                    p[k] += puff[k] * q[k] * bulge[(k + 1) % 3].max(0.0) * bulge[(k + 2) % 3].max(0.0);
                }
                p
            };
            mesh.append(full(&lines(u), &lines(v), place));
        }
    }
    welded_normals(mesh)
}

/// Normals as if vertices in one place (to 1 µm) were one.
fn welded_normals(mut mesh: Mesh) -> Mesh {
    let key = |p: DVec3| (p * 1e6).round().as_i64vec3().to_array();
    let mut sums: BTreeMap<[i64; 3], DVec3> = BTreeMap::new();
    for [a, b, c] in mesh.corners() {
        let n = (b - a).cross(c - a);
        for p in [a, b, c] {
            *sums.entry(key(p)).or_default() += n;
        }
    }
    for (p, n) in mesh.positions.iter().zip(&mut mesh.normals) {
        *n = sums[&key(*p)].normalize();
    }
    mesh
}

/// The parts of a bent slab.
pub struct Slab {
    /// The side that looks along du × dv.
    pub front: Mesh,
    /// The other one.
    pub back: Mesh,
    /// The cut edges.
    pub edges: Mesh,
}

/// A closed slab over the grid `us` × `vs` whose vertices are `place(u, v, s)`, s = 1 on the front and 0 on
/// the back.
pub fn slab(us: &[f64], vs: &[f64], place: impl Fn(f64, f64, f64) -> DVec3) -> Slab {
    let front = full(us, vs, |u, v| place(u, v, 1.0));
    let mut back = full(us, vs, |u, v| place(u, v, 0.0));
    back.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let back = back.smoothed();
    // Along the rim counter-clockwise, as seen from the front.
    let (nu, nv) = (us.len() - 1, vs.len() - 1);
    let mut rim: Vec<(f64, f64)> = (0..nu).map(|i| (us[i], vs[0])).collect();
    rim.extend((0..nv).map(|j| (us[nu], vs[j])));
    rim.extend((1..=nu).rev().map(|i| (us[i], vs[nv])));
    rim.extend((1..=nv).rev().map(|j| (us[0], vs[j])));
    let mut edges = Mesh::default();
    for (k, &(u, v)) in rim.iter().enumerate() {
        let (u2, v2) = rim[(k + 1) % rim.len()];
        edges.quad(place(u, v, 0.0), place(u2, v2, 0.0), place(u2, v2, 1.0), place(u, v, 1.0));
    }
    Slab { front, back, edges }
}

/// A moulding from `a` to `b`: each point [d, h] of the profile lies d along (b − a) × `up` and h along `up`,
/// and the front is where (b − a) × the profile's direction points. An end with mitre 1 is cut at 45° for an
/// inner corner, one with 0 square. A smooth profile shares its vertices, a sharp one has a flat face per
/// step.
pub fn moulding(a: DVec3, b: DVec3, mitre: [f64; 2], up: DVec3, profile: &[[f64; 2]], smooth: bool) -> Mesh {
    let along = (b - a).normalize();
    let out = along.cross(up);
    let at = |end: usize, [d, h]: [f64; 2]| {
        let (corner, along) = if end == 0 { (a, along) } else { (b, -along) };
        corner + out * d + up * h + along * (d * mitre[end])
    };
    let mut mesh = Mesh::default();
    let mut run = 0.0;
    for pair in profile.windows(2) {
        let step = (DVec2::from(pair[1]) - DVec2::from(pair[0])).length();
        let corners = [at(0, pair[0]), at(1, pair[0]), at(1, pair[1]), at(0, pair[1])];
        let heights = [run, run, run + step, run + step];
        let uv = |k: usize| DVec2::new((corners[k] - a).dot(along), -heights[k]);
        mesh.polygon(&[0, 1, 2, 3].map(|k| (corners[k], uv(k))));
        run += step;
    }
    if smooth { welded_normals(mesh) } else { mesh }
}

/// A moulding around a rectangle on a plane that looks along `normal`, mitred at its corners; profile points
/// are [inwards from the outer edge, out of the plane], listed from the inner edge to the outer.
pub fn frame(centre: DVec3, right: DVec3, high: DVec3, normal: DVec3, profile: &[[f64; 2]]) -> Mesh {
    debug_assert!(right.cross(high).dot(normal) > 0.0, "right × high is the normal");
    let corners =
        [centre + right - high, centre - right - high, centre - right + high, centre + right + high];
    (0..4)
        .map(|k| moulding(corners[k], corners[(k + 1) % 4], [1.0, 1.0], normal, profile, false))
        .fold(Mesh::default(), Mesh::with)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cushion_is_closed_and_lies_in_its_box() {
        let half = DVec3::new(0.4, 0.1, 0.3);
        let flat = cushion(half, 0.05, 4, 3, DVec3::ZERO);
        assert!(flat.is_closed());
        assert!(flat.positions.iter().all(|p| (p.abs() - half).max_element() < 1e-9));
        // Minkowski sum of the core box a × b × c and a ball, which the mesh approaches from inside.
        let (a, b, c, r) = (0.7, 0.1, 0.5, 0.05);
        let whole = a * b * c
            + 2.0 * r * (a * b + b * c + c * a)
            + std::f64::consts::PI * r * r * (a + b + c + 4.0 / 3.0 * r);
        assert!((0.98 * whole..whole).contains(&flat.volume()), "{} of {whole}", flat.volume());
        assert!(cushion(half, 0.05, 4, 3, DVec3::splat(0.02)).volume() > whole);
    }

    #[test]
    fn a_slab_is_a_closed_solid() {
        let (us, vs) = (steps(0.0, 2.0, 4), steps(0.0, 1.0, 2));
        let slab = slab(&us, &vs, |u, v, s| DVec3::new(u, v, 0.1 * s));
        let solid = slab.front.with(slab.back).with(slab.edges);
        assert!(solid.is_closed());
        assert!((solid.volume() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_frame_closes_over_its_corners() {
        // A profile that begins and ends on the plane, and the two faces it leaves open there.
        let mesh = frame(
            DVec3::ZERO,
            DVec3::X * 2.0,
            DVec3::Y,
            DVec3::Z,
            &[[0.5, 0.0], [0.5, 0.5], [0.0, 0.5], [0.0, 0.0], [0.5, 0.0]],
        );
        assert!(mesh.is_closed());
        assert!((mesh.volume() - 0.5 * (4.0 * 2.0 - 3.0 * 1.0)).abs() < 1e-12);
    }
}
