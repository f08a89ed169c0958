//! The land: rolling, flat around the farmyard, in patches that each unwrap to one rectangle.
//!
//! Places are given as (u, v), metres east and south, before the track's bends shift them: lines of equal u
//! run along the track, and every boundary between patches is straight in (u, v). Heights are interpolated
//! from a lattice of 1 m, so that patches of any finer grid meet without gaps.

use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::noise;
use crate::relief::{sheet, steps};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Half the side of the land that has texels.
pub const HALF: f64 = 64.0;
/// Half the side of the farmyard's patch; fields begin there.
pub const YARD: f64 = 24.0;
/// Half the width of the track's patch.
pub const TRACK: f64 = 4.0;
/// Metres that the texture of the land around covers.
pub const FAR: f64 = 1024.0;
/// From furrow to furrow; they run north to south, so that the low sun of morning and evening crosses them.
const FURROW: f64 = 0.8;
/// From crop row to crop row; they run east to west.
pub const ROW: f64 = 1.0;
/// Height of the ridge that a crop stands on.
pub const RIDGE: f64 = 0.075;
/// The patches' relief fades out over this width along their boundaries.
const MARGIN: f64 = 1.4;

/// Footprints of buildings with floors of their own, [x0, z0, x1, z1]: no ground inside.
const FLOORED: [[f64; 4]; 2] = [super::barn::FOOTPRINT, super::house::FOOTPRINT];

/// From 0 to 1 with level ends.
pub fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Height of the land at a point, without its small bumps; defined everywhere.
pub fn hills(x: f64, z: f64) -> f64 {
    let swell = |metres: f64, seed| noise(x / metres + 40.0, z / metres + 40.0, 256, seed) - 0.5;
    let away = (x.powi(4) + z.powi(4)).powf(0.25);
    let rolling = 7.0 * swell(58.0, 201) + 2.4 * swell(23.0, 202);
    let north = 5.0 * smooth((-z - 24.0) / 50.0);
    let far = 16.0 * swell(240.0, 203) * smooth((away - 80.0) / 160.0);
    (rolling + north + far) * smooth((away - 20.0) / 24.0)
}

/// A lattice point, shifted by the track's bends, with bumps.
fn lattice(u: f64, v: f64) -> DVec3 {
    let bend =
        if (20.0..HALF).contains(&v) { 2.6 * (1.0 - (TAU * (v - 20.0) / (HALF - 20.0)).cos()) } else { 0.0 };
    let reach = (1.0 - (u / 44.0).powi(2)).max(0.0);
    let x = u + bend * reach * reach;
    let bump = |metres: f64, seed| noise(u / metres + 40.0, v / metres + 40.0, 256, seed) - 0.5;
    let calm = 0.5 + 0.5 * smooth((u.abs().max(v.abs()) - 16.0) / 10.0);
    DVec3::new(x, hills(x, v) + calm * (0.14 * bump(3.3, 204) + 0.06 * bump(2.2, 205)), v)
}

/// The ground at (u, v), without what fields and track add to it.
pub fn point(u: f64, v: f64) -> DVec3 {
    let (i, j) = (u.floor(), v.floor());
    let (s, t) = (u - i, v - j);
    let low = lattice(i, j).lerp(lattice(i + 1.0, j), s);
    let high = lattice(i, j + 1.0).lerp(lattice(i + 1.0, j + 1.0), s);
    low.lerp(high, t)
}

/// Relief of the ploughed field: slices turned over to one side, broken into clods.
fn furrows(u: f64, v: f64) -> f64 {
    let phase = TAU * u / FURROW;
    let clods = noise(u / 0.31 + 400.0, v / 1.3 + 400.0, 1024, 211) - 0.5;
    0.085 * phase.cos() + 0.025 * (2.0 * phase + 1.0).sin() + 0.07 * clods
}

/// Relief of the crop field.
fn ridges(u: f64, v: f64) -> f64 {
    let crumbs = noise(u / 2.3 + 400.0, v / 0.5 + 400.0, 1024, 212) - 0.5;
    RIDGE * (TAU * (v - YARD) / ROW).cos() + 0.02 * crumbs
}

/// Relief of the track: two ruts of wheels and a crown between them.
fn ruts(u: f64, v: f64) -> f64 {
    let bell = |distance: f64, width: f64| (-(distance / width).powi(2)).exp();
    let depth = 0.10 + 0.06 * (noise(0.0, v / 2.7 + 40.0, 256, 213) - 0.5);
    0.05 * bell(u, 0.5) - depth * bell(u.abs() - 0.85, 0.25)
}

/// A rectangle of land.
pub struct Patch {
    name: &'static str,
    material: &'static str,
    u: [f64; 2],
    v: [f64; 2],
    /// Grid step along u and v.
    step: [f64; 2],
    /// Height added to the ground inside.
    relief: fn(f64, f64) -> f64,
}

fn plain(_: f64, _: f64) -> f64 {
    0.0
}

/// All the land between ±`HALF`.
pub const PATCHES: [Patch; 10] = {
    const fn patch(
        name: &'static str,
        material: &'static str,
        u: [f64; 2],
        v: [f64; 2],
        step: [f64; 2],
        relief: fn(f64, f64) -> f64,
    ) -> Patch {
        Patch { name, material, u, v, step, relief }
    }
    let (west, east, south, north) = ([-HALF, -YARD], [YARD, HALF], [YARD, HALF], [-HALF, -YARD]);
    let middle = [-YARD, YARD];
    [
        patch("yard_ground", "yard_ground", middle, middle, [0.5, 0.5], plain),
        patch("track", "track", [-TRACK, TRACK], south, [0.2, 1.0], ruts),
        patch("ploughed_west", "soil", [-HALF, -34.0], south, [FURROW / 5.0, 0.8], furrows),
        patch("ploughed_east", "soil", [-34.0, -TRACK], south, [FURROW / 5.0, 0.8], furrows),
        patch("crop_soil", "crop_soil", [TRACK, HALF], south, [1.0, ROW / 5.0], ridges),
        patch("stubble", "stubble", west, middle, [1.0, 1.0], plain),
        patch("pasture", "grass", east, middle, [1.0, 1.0], plain),
        patch("meadow_west", "grass", west, north, [1.0, 1.0], plain),
        patch("meadow_middle", "grass", middle, north, [1.0, 1.0], plain),
        patch("meadow_east", "grass", east, north, [1.0, 1.0], plain),
    ]
};

impl Patch {
    /// Height added to the ground, none along the patch's boundary.
    fn lift(&self, u: f64, v: f64) -> f64 {
        // The two halves of the ploughed field are one.
        let west = if self.name == "ploughed_east" { -HALF } else { self.u[0] };
        let east = if self.name == "ploughed_west" { -TRACK } else { self.u[1] };
        let inside = (u - west).min(east - u).min(v - self.v[0]).min(self.v[1] - v);
        (self.relief)(u, v) * smooth(inside / MARGIN)
    }

    /// The unit normal at (u, v): that of the ground over half a metre, tilted by the relief's own slope.
    fn normal(&self, u: f64, v: f64) -> DVec3 {
        let difference = |du: f64, dv: f64| point(u + du, v + dv) - point(u - du, v - dv);
        let (broad, fine) = (0.5, 0.04);
        let east = difference(broad, 0.0) / (2.0 * broad);
        let south = difference(0.0, broad) / (2.0 * broad);
        let slope = |du: f64, dv: f64| (self.lift(u + du, v + dv) - self.lift(u - du, v - dv)) / (2.0 * fine);
        let (east, south) = (east + DVec3::Y * slope(fine, 0.0), south + DVec3::Y * slope(0.0, fine));
        south.cross(east).normalize()
    }

    fn mesh(&self) -> Mesh {
        let lines =
            |[low, high]: [f64; 2], step: f64| steps(low, high, ((high - low) / step).round() as usize);
        let (us, vs) = (lines(self.u, self.step[0]), lines(self.v, self.step[1]));
        let grown = |j: usize, i: usize| {
            let hidden =
                |[x0, z0, x1, z1]: [f64; 4]| us[i] > x0 && us[i + 1] < x1 && vs[j] > z0 && vs[j + 1] < z1;
            self.name != "yard_ground" || !FLOORED.iter().any(|&f| hidden(f))
        };
        // South × east looks up.
        let mut mesh = sheet(&vs, &us, grown, |v, u| point(u, v) + DVec3::Y * self.lift(u, v));
        for (uv, normal) in mesh.uvs.iter_mut().zip(&mut mesh.normals) {
            let (u, v) = (-uv.y, uv.x);
            *normal = self.normal(u, v);
            // Textures begin at a patch's corner; furrows and rows are counted from zero.
            *uv = DVec2::new(u - self.u[0], v - self.v[0]);
        }
        mesh
    }
}

pub fn build(model: &mut Model) {
    for patch in &PATCHES {
        model.add(patch.name, patch.material, patch.mesh());
    }
    surroundings(model);
}

/// Hills beyond, to the horizon: rings around the square, the first one on its rim.
fn surroundings(model: &mut Model) {
    const RINGS: [f64; 12] = [1.0, 1.04, 1.1, 1.2, 1.35, 1.6, 2.0, 2.6, 3.4, 4.6, 6.2, 8.0];
    let side = 2 * HALF as usize;
    // Around the rim by the metre: east, then north, west, south.
    let rim = |k: usize| {
        let t = (k % side) as f64 - HALF;
        match k / side % 4 {
            0 => (HALF, -t),
            1 => (-t, -HALF),
            2 => (-HALF, t),
            _ => (t, HALF),
        }
    };
    let ks: Vec<f64> = steps(0.0, 4.0 * side as f64, 4 * side);
    let place = |k: f64, ring: f64| {
        let (u, v) = rim(k as usize);
        let near = point(u, v);
        if ring == 1.0 {
            return near;
        }
        let (x, z) = (near.x * ring, near.z * ring);
        DVec3::new(x, hills(x, z), z)
    };
    let mut mesh = sheet(&RINGS, &ks, |_, _| true, |ring, k| place(k, ring));
    for ((p, uv), normal) in mesh.positions.iter().zip(&mut mesh.uvs).zip(&mut mesh.normals) {
        let d = 1.0;
        let slope = |dx: f64, dz: f64| (hills(p.x + dx, p.z + dz) - hills(p.x - dx, p.z - dz)) / (2.0 * d);
        *normal = DVec3::new(-slope(d, 0.0), 1.0, -slope(0.0, d)).normalize();
        *uv = DVec2::new(p.x, p.z) + DVec2::splat(FAR / 2.0);
    }
    model.add("surroundings_occluder", "far_fields", mesh);
}
