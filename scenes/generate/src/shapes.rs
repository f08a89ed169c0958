//! Solids: blocks, plain and bevelled, prisms, tubes along a path and bodies of revolution. Sharp edges split
//! vertices.

use crate::mesh::Mesh;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

pub use models::shapes::*;

/// A closed block with every edge cut at 45°, `bevel` metres from it.
pub fn bevelled(min: [f64; 3], max: [f64; 3], bevel: f64) -> Mesh {
    let (lo, hi) = (DVec3::from(min), DVec3::from(max));
    let mut mesh = Mesh::default();
    let at = |sign: [f64; 3], axis: usize| {
        // The corner's vertex that lies in the face across `axis`.
        let mut p = DVec3::ZERO;
        for k in 0..3 {
            let inset = if k == axis { 0.0 } else { bevel };
            p[k] = if sign[k] > 0.0 { hi[k] - inset } else { lo[k] + inset };
        }
        p
    };
    let uv = |p: DVec3, axis: usize| match axis {
        0 => DVec2::new(p.z, -p.y),
        1 => DVec2::new(p.x, p.z),
        _ => DVec2::new(p.x, -p.y),
    };
    let mut add = |mut corners: Vec<DVec3>, axis: usize| {
        let centre = (lo + hi) / 2.0;
        let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if n.dot(corners[0] - centre) < 0.0 {
            corners.reverse();
        }
        mesh.polygon(&corners.iter().map(|&c| (c, uv(c, axis))).collect::<Vec<_>>());
    };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let sign = |s: f64, su: f64, sv: f64| {
            let mut out = [0.0; 3];
            (out[axis], out[u], out[v]) = (s, su, sv);
            out
        };
        for s in [-1.0, 1.0] {
            // The face, then the two cut edges it shares with the next axis.
            let ring = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            add(ring.map(|(a, b)| at(sign(s, a, b), axis)).to_vec(), axis);
            for t in [-1.0, 1.0] {
                let edge = [at(sign(s, t, -1.0), axis), at(sign(s, t, 1.0), axis)];
                let other = [at(sign(s, t, 1.0), u), at(sign(s, t, -1.0), u)];
                add(vec![edge[0], edge[1], other[0], other[1]], axis);
            }
        }
    }
    for corner in 0..8 {
        let sign = [0, 1, 2].map(|k| if corner >> k & 1 == 1 { 1.0 } else { -1.0 });
        add((0..3).map(|axis| at(sign, axis)).collect(), 1);
    }
    mesh
}

/// A closed prism: a convex polygon in the (z, y) plane, swept along x. Returns the sides, one per polygon
/// edge, and the two ends.
pub fn prism(zy: &[[f64; 2]], x0: f64, x1: f64) -> (Vec<Mesh>, Mesh) {
    let mut area = 0.0;
    for i in 0..zy.len() {
        let (a, b) = (zy[i], zy[(i + 1) % zy.len()]);
        area += a[0] * b[1] - a[1] * b[0];
    }
    // Seen from −X, (z, y) is a right-handed frame: counter-clockwise there looks to −X.
    let mut ring: Vec<[f64; 2]> = zy.to_vec();
    if area < 0.0 {
        ring.reverse();
    }
    let at = |x: f64, p: [f64; 2]| DVec3::new(x, p[1], p[0]);
    let mut sides = Vec::new();
    for i in 0..ring.len() {
        let (a, b) = (ring[i], ring[(i + 1) % ring.len()]);
        let mut side = Mesh::default();
        side.quad(at(x0, a), at(x1, a), at(x1, b), at(x0, b));
        sides.push(side);
    }
    let mut ends = Mesh::default();
    let uv = |p: [f64; 2]| DVec2::new(p[0], -p[1]);
    ends.polygon(&ring.iter().map(|&p| (at(x0, p), uv(p))).collect::<Vec<_>>());
    ends.polygon(&ring.iter().rev().map(|&p| (at(x1, p), uv(p))).collect::<Vec<_>>());
    if area < 0.0 {
        sides.reverse();
        sides.rotate_left(1);
    }
    (sides, ends)
}

/// A round tube along `path` of (centre, radius), smooth around and along, closed by flat caps.
pub fn tube(path: &[(DVec3, f64)], sides: usize) -> Mesh {
    let mut mesh = tube_side(path, sides);
    let last = path.len() - 1;
    let ring = |mesh: &Mesh, k: usize| -> Vec<DVec3> {
        (0..sides).map(|s| mesh.positions[k * (sides + 1) + s]).collect()
    };
    for (k, flip) in [(0, true), (last, false)] {
        let mut cap = ring(&mesh, k);
        if flip {
            cap.reverse();
        }
        let corners: Vec<_> = cap.iter().map(|&p| (p, DVec2::new(p.x, p.z))).collect();
        mesh.polygon(&corners);
    }
    mesh
}

/// The side of `tube` without its caps.
pub fn tube_side(path: &[(DVec3, f64)], sides: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let direction = |k: usize| {
        let (a, b) = (path[k.saturating_sub(1)].0, path[(k + 1).min(path.len() - 1)].0);
        (b - a).normalize()
    };
    // A frame carried along the path without twist.
    let mut side = direction(0).any_orthonormal_vector();
    let mut along = 0.0;
    for (k, &(centre, radius)) in path.iter().enumerate() {
        let d = direction(k);
        side = (side - d * side.dot(d)).normalize();
        let up = d.cross(side);
        if k > 0 {
            along += (centre - path[k - 1].0).length();
        }
        for s in 0..=sides {
            let (sin, cos) = ((s % sides) as f64 * TAU / sides as f64).sin_cos();
            let uv = DVec2::new(s as f64 / sides as f64 * TAU * path[0].1, -along);
            let i = mesh.vertex(centre + (up * cos - side * sin) * radius, uv);
            mesh.normals[i as usize] = up * cos - side * sin;
        }
    }
    let stride = sides as u32 + 1;
    for k in 0..path.len() as u32 - 1 {
        for s in 0..sides as u32 {
            let (a, b) = (k * stride + s, k * stride + s + 1);
            mesh.triangles.push([a, b, b + stride]);
            mesh.triangles.push([a, b + stride, a + stride]);
        }
    }
    mesh
}

/// A body of revolution about +Y: each run is a smooth profile of (radius, y), sharp where runs meet. The
/// front lies to the right of the profile's direction, so a profile that climbs on the outside looks
/// outwards.
pub fn lathe(runs: &[&[(f64, f64)]], sides: usize) -> Mesh {
    let mut mesh = Mesh::default();
    for run in runs {
        let mut part = Mesh::default();
        let mut along = 0.0;
        for (k, &(r, y)) in run.iter().enumerate() {
            if k > 0 {
                along += (DVec2::new(r, y) - DVec2::from(run[k - 1])).length();
            }
            let tangent =
                DVec2::from(run[(k + 1).min(run.len() - 1)]) - DVec2::from(run[k.saturating_sub(1)]);
            let (nr, ny) = (tangent.y / tangent.length(), -tangent.x / tangent.length());
            for s in 0..=sides {
                let (sin, cos) = ((s % sides) as f64 * TAU / sides as f64).sin_cos();
                let uv =
                    DVec2::new(-(s as f64) / sides as f64 * TAU * run[0].0.max(run[run.len() - 1].0), -along);
                let i = part.vertex(DVec3::new(r * cos, y, r * sin), uv);
                part.normals[i as usize] = DVec3::new(nr * cos, ny, nr * sin);
            }
        }
        let stride = sides as u32 + 1;
        for k in 0..run.len() as u32 - 1 {
            for s in 0..sides as u32 {
                let (a, b) = (k * stride + s, k * stride + s + 1);
                // A ring of radius 0 is the axis: one triangle per side.
                if run[k as usize].0 > 0.0 {
                    part.triangles.push([a, b + stride, b]);
                }
                if run[k as usize + 1].0 > 0.0 {
                    part.triangles.push([a, a + stride, b + stride]);
                }
            }
        }
        mesh.append(part);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_solid(name: &str, mesh: &Mesh, volume: f64) {
        assert!(mesh.is_closed(), "{name} is open");
        assert!((mesh.volume() - volume).abs() < 1e-9 + volume * 1e-9, "{name}: {} m³", mesh.volume());
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let n = (b - a).cross(c - a);
            assert!(n.length() > 0.0, "{name} has a degenerate triangle");
            t.iter().for_each(|&i| assert!(n.dot(mesh.normals[i as usize]) > 0.0, "{name}: normal"));
        }
    }

    #[test]
    fn solids_are_closed_and_look_outwards() {
        let (lo, hi) = ([1.0, 2.0, 3.0], [2.0, 4.0, 6.0]);
        assert_solid("block", &block(lo, hi, ALL), 6.0);
        // Along each axis four wedges b²/2 × (length − 2b), and eight corners that lose b³ − b³/6 each.
        let b = 0.1;
        let cut = 4.0 * b * b / 2.0 * (6.0 - 6.0 * b) + 8.0 * (b * b * b * 5.0 / 6.0);
        assert_solid("bevelled", &bevelled(lo, hi, b), 6.0 - cut);
        for zy in [vec![[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]], vec![[0.0, 0.0], [0.0, 1.0], [2.0, 0.0]]] {
            let (sides, ends) = prism(&zy, -1.0, 2.0);
            let mesh = sides.into_iter().fold(ends, Mesh::with);
            assert_solid("prism", &mesh, 3.0);
        }
        // A regular n-gon of radius r has the area n r² sin(2π/n) / 2.
        let gon = |n: usize| n as f64 * (TAU / n as f64).sin() / 2.0;
        let path = [(DVec3::ZERO, 1.0), (DVec3::new(1.0, 2.0, 2.0), 1.0)];
        assert_solid("tube", &tube(&path, 9), gon(9) * 3.0);
        let cylinder =
            lathe(&[&[(0.0, 0.0), (2.0, 0.0)], &[(2.0, 0.0), (2.0, 1.5)], &[(2.0, 1.5), (0.0, 1.5)]], 12);
        assert_solid("lathe", &cylinder, gon(12) * 4.0 * 1.5);
    }

    #[test]
    fn prism_sides_follow_the_polygon_edges() {
        let (sides, _) = prism(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]], 0.0, 1.0);
        let normals: Vec<DVec3> = sides.iter().map(|s| s.normals[0]).collect();
        assert_eq!(normals, [DVec3::NEG_Y, DVec3::Z, DVec3::Y, DVec3::NEG_Z]);
    }
}
