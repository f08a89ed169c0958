//! Which way is up in an OBJ, which does not say: Y, as in glTF, or Z, as in programs of architects.

use crate::geometry::{Bounds, Geometry};
use crate::preview::view::SMALLEST_ROOM;
use glam::DVec3;
use std::io::Read;
use std::path::Path;

/// What a model's geometry says of its upward axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// It is Y, or nothing speaks against that.
    Y,
    /// It may be Z.
    PerhapsZ,
    /// It is Z.
    Z,
}

/// Programs whose own upward axis is Z, and which write their name into the first lines of an OBJ.
const PROGRAMS: [&str; 6] = ["Blender", "3ds Max", "SketchUp", "Rhino", "FreeCAD", "Revit"];
/// Bytes that hold those lines.
const HEADER: u64 = 2048;

/// A flat model is at most this high, as a share of its shorter horizontal side; more if a program of
/// [`PROGRAMS`] wrote it.
const FLAT: [f64; 2] = [0.5, 0.75];
/// Flatter models than this may be billboards or facades, unless they are longer than `LONG` metres.
const THIN: f64 = 0.1;
const LONG: f64 = 50.0;
/// Cosine of an angle to the axis up to which a face is level, and above which it is upright.
const LEVEL: f64 = 0.95;
const UPRIGHT: f64 = 0.1;
/// So many times as much area is level as faces forwards and backwards.
const MORE_LEVEL: f64 = 1.3;
/// A scene stands on the ground: it starts within this share of its size of zero, along the upward axis.
const ON_GROUND: f64 = 0.15;

/// What can be told of some triangles of a model in this unit (metres); `program` wrote it.
pub(super) fn guess(
    geometry: &Geometry,
    triangles: impl Iterator<Item = usize> + Clone,
    metres: f64,
    program: Option<&str>,
) -> Up {
    let bounds = Bounds::of(triangles.clone().flat_map(|triangle| geometry.corners(triangle)));
    let (low, size) = (geometry.origin + bounds.low.as_dvec3(), bounds.size());
    let mut level = DVec3::ZERO;
    // Slanted faces that look along an axis, less those that look against it: roofs and hills.
    let mut slanted = DVec3::ZERO;
    for triangle in triangles {
        let (normal, area) = (geometry.normal(triangle).as_dvec3(), geometry.area_f64(triangle));
        let cosines = normal.abs();
        level += area * DVec3::select(cosines.cmpge(DVec3::splat(LEVEL)), DVec3::ONE, DVec3::ZERO);
        let is_slanted = cosines.cmplt(DVec3::splat(LEVEL)) & cosines.cmpge(DVec3::splat(UPRIGHT));
        slanted += area * DVec3::select(is_slanted, normal, DVec3::ZERO);
    }
    let across = size.x.min(size.y);
    let flat = FLAT[usize::from(program.is_some())];
    let is_flat = size.z <= flat * across && level.z >= MORE_LEVEL * level.y;
    let is_upright = slanted.y > slanted.z.max(0.0) + 0.1 * level.z;
    if !is_flat || is_upright || size.max_element() * metres < SMALLEST_ROOM {
        return Up::Y;
    }
    let stands_on = |axis: usize| low[axis].abs() <= ON_GROUND * size[axis];
    let is_thin = size.z < THIN * across && size.max_element() * metres < LONG;
    if stands_on(2) && !stands_on(1) && low.y < 0.0 && !is_thin { Up::Z } else { Up::PerhapsZ }
}

/// The program of [`PROGRAMS`] that a comment at the head of a file names.
pub(super) fn program(file: &Path) -> Option<&'static str> {
    let mut head = Vec::new();
    std::fs::File::open(file).ok()?.take(HEADER).read_to_end(&mut head).ok()?;
    let head = String::from_utf8_lossy(&head);
    let mut comments = head.lines().filter(|line| line.starts_with('#'));
    comments.find_map(|line| PROGRAMS.into_iter().find(|program| line.contains(program)))
}

/// The turn that makes a Z of a model its Y, in degrees about X, Y and Z.
pub(super) const TURN: DVec3 = DVec3::new(-90.0, 0.0, 0.0);

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// The faces of a box, as quads that look outwards.
    fn block(geometry: &mut Geometry, low: Vec3, high: Vec3) {
        let corner = |i: usize| {
            Vec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] }))
        };
        for side in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            quad(geometry, side.map(corner));
        }
    }

    fn quad(geometry: &mut Geometry, corners: [Vec3; 4]) {
        let first = geometry.positions.len() as u32;
        geometry.positions.extend(corners);
        geometry.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }

    /// A house of 10 × 8 × 3 m with a gable roof on a plot of 20 × 16 m, Y up.
    fn house() -> Geometry {
        let mut geometry = Geometry::default();
        block(&mut geometry, Vec3::new(-10.0, -0.2, -8.0), Vec3::new(10.0, 0.0, 8.0));
        block(&mut geometry, Vec3::new(-5.0, 0.0, -4.0), Vec3::new(5.0, 3.0, 4.0));
        let eaves = |x: f32, z: f32| Vec3::new(x, 3.0, z);
        let ridge = |x: f32| Vec3::new(x, 5.0, 0.0);
        quad(&mut geometry, [eaves(-5.0, 4.0), eaves(5.0, 4.0), ridge(5.0), ridge(-5.0)]);
        quad(&mut geometry, [eaves(5.0, -4.0), eaves(-5.0, -4.0), ridge(-5.0), ridge(5.0)]);
        geometry
    }

    /// The same with Z up, as a program writes it that turns nothing.
    fn turned(mut geometry: Geometry) -> Geometry {
        geometry.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x, -p.z, p.y));
        geometry
    }

    fn up(geometry: &Geometry, metres: f64, program: Option<&str>) -> Up {
        guess(geometry, 0..geometry.triangles.len(), metres, program)
    }

    #[test]
    fn a_house_that_lies_on_its_side_is_told_from_one_that_stands() {
        assert_eq!(up(&house(), 1.0, None), Up::Y);
        assert_eq!(up(&house(), 1.0, Some("Blender")), Up::Y);
        assert_eq!(up(&turned(house()), 1.0, None), Up::Z);
        // In millimetres a house is a prop.
        assert_eq!(up(&turned(house()), 0.001, None), Up::Y);
    }

    #[test]
    fn a_facade_or_a_billboard_is_not_turned() {
        // Both are flat along Z; one stands on the ground, the other hangs around zero.
        for (low, high) in [([-5.0, 0.0, -0.5], [5.0, 8.0, 0.5]), ([-5.0, -4.0, 0.0], [5.0, 4.0, 0.2])] {
            let mut geometry = Geometry::default();
            block(&mut geometry, Vec3::from(low), Vec3::from(high));
            assert_ne!(up(&geometry, 1.0, None), Up::Z, "{low:?}");
        }
    }

    #[test]
    fn hills_are_level_though_they_are_thin() {
        let mut geometry = Geometry::default();
        for i in 0..100 {
            let at = |i: i32, j: i32| {
                let (x, y) = (i as f32 * 20.0 - 100.0, j as f32 * 20.0 - 100.0);
                Vec3::new(x, y, 4.0 + 4.0 * (0.05 * x).sin() * (0.04 * y).cos())
            };
            let (x, y) = (i % 10, i / 10);
            quad(&mut geometry, [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
        assert_eq!(up(&geometry, 1.0, None), Up::Z);
    }

    #[test]
    fn a_comment_names_the_program() {
        let dir = tempfile::tempdir().unwrap();
        for (text, expected) in [
            ("# Rhino\n\nv 0 0 0\n", Some("Rhino")),
            ("# Exported by 3ds Max\n", Some("3ds Max")),
            ("v 0 0 0\no Blender\n", None),
            ("", None),
        ] {
            let file = dir.path().join("a.obj");
            std::fs::write(&file, text).unwrap();
            assert_eq!(program(&file), expected, "{text}");
        }
    }
}
