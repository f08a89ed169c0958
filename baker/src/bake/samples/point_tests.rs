//! Which points of a texel are its surface: solids, walls and bulges on small scenes laid out by hand.

use super::*;
use crate::atlas;
use crate::bake::store::SumKinds;
use crate::geometry::{Geometry, Instance, Material, Solids};
use crate::receivers::SurfaceTexels;
use crate::scene::{Lightmap, LightmapSize};
use crate::trace::paths::Transport;
use crate::trace::rays::RayTracer;
use crate::trace::solids::Space;
use crate::trace::sources::Lights;
use glam::{DAffine3, Vec2, Vec3, vec3};

fn material(two_sided: bool) -> Material {
    Material {
        albedo: Vec3::ONE,
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided,
        emission: None,
    }
}

/// Triangles, those of the first `lightmapped` with texels.
#[derive(Default)]
struct Builder {
    geometry: Geometry,
}

impl Builder {
    fn mesh(mut self, positions: &[Vec3], triangles: &[[u32; 3]], lightmap: bool, two_sided: bool) -> Self {
        let g = &mut self.geometry;
        let (first, from) = (g.positions.len(), g.triangles.len());
        g.positions.extend(positions);
        g.normals.extend(positions.iter().map(|_| Vec3::ZERO));
        g.uvs.extend(positions.iter().map(|_| Vec2::ZERO));
        g.lightmap_uvs.extend(positions.iter().map(|_| Vec2::ZERO));
        g.triangles.extend(triangles.iter().map(|t| t.map(|v| v + first as u32)));
        g.material_of.extend(triangles.iter().map(|_| g.materials.len() as u32));
        g.materials.push(material(two_sided));
        g.instances.push(Instance {
            name: String::new(),
            mesh: g.instances.len() as u32,
            world_from_mesh: DAffine3::IDENTITY,
            triangles: from..g.triangles.len(),
            vertices: first..g.positions.len(),
            lightmap,
            has_lightmap_uvs: false,
            lightmap_place: Default::default(),
            density: 1.0,
        });
        self
    }

    /// A parallelogram whose front is on the side of `u × v`.
    fn quad(self, corner: Vec3, u: Vec3, v: Vec3, lightmap: bool, two_sided: bool) -> Self {
        let corners = [corner, corner + u, corner + u + v, corner + v];
        self.mesh(&corners, &[[0, 1, 2], [0, 2, 3]], lightmap, two_sided)
    }

    /// A closed box without texels, seen from outside, or from inside where `low` lies above `high`.
    fn block(self, low: Vec3, high: Vec3) -> Self {
        let corner = |i: u32| Vec3::select(glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), high, low);
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        self.mesh(&(0..8).map(corner).collect::<Vec<_>>(), &triangles, false, false)
    }

    /// Per texel: those of its 16 points that are its surface, whether it is split, and the centre of those
    /// points.
    fn points(self, texels_per_metre: f64) -> Vec<(u16, bool, Vec3)> {
        self.points_by(texels_per_metre, 1)
    }

    /// The same with a seed.
    fn points_by(self, texels_per_metre: f64, seed: u64) -> Vec<(u16, bool, Vec3)> {
        let geometry = self.geometry;
        let lightmap =
            Lightmap { size: LightmapSize::TexelsPerMetre(texels_per_metre), ..Lightmap::default() };
        let atlas = atlas::build(&geometry, &lightmap).expect("an atlas");
        let texels = SurfaceTexels::new(&atlas);
        let (rays, lights) = (RayTracer::new(&geometry), Lights::none());
        let space = Space::new(&geometry, &rays).with_solids(Solids::new(&geometry));
        let transport = Transport::new(space, &lights, None);
        let worker = Worker { transport, receivers: &texels, seed, guaranteed_samples: 64 };
        let mut found = Vec::new();
        for block in worker.blocks() {
            let receivers = worker.block(block);
            // What squares tell is what every texel tells whose points are all asked.
            let mut state = BlockState::empty(0, SumKinds { layers: 0, sampled: 0, hit_lights: 0 });
            worker.find_points(&receivers, &mut state);
            for (k, texel) in receivers.covered().enumerate() {
                let mut counts = RayCounts::default();
                let groups = worker.groups(worker.points(&receivers, texel), &mut counts);
                assert_eq!(state.points[k], worker.bits_of_groups(groups, &mut counts));
                let bits = worker.surface_points(&receivers, texel, &mut counts);
                let is_split = bits != ALL_POINTS && worker.is_split(&receivers, texel, bits, &mut counts);
                let points = (0..POINTS)
                    .filter(|i| bits >> i & 1 == 1)
                    .map(|i| worker.point(&receivers, texel, i).expect("a point").origin());
                let sum: Vec3 = points.sum();
                found.push((bits, is_split, sum / bits.count_ones().max(1) as f32));
            }
        }
        assert!(found.len() > 20, "{}", found.len());
        found
    }
}

/// A floor of 4 × 4 m, which looks up, from `x` on.
fn floor_from(x: f32) -> Builder {
    Builder::default().quad(vec3(x, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, true, false)
}

/// A floor about the origin.
fn floor() -> Builder {
    floor_from(-2.03)
}

/// A ball, or a pipe along y where `is_pipe`, of radius 1, with texels.
fn bulging(is_pipe: bool) -> Builder {
    const N: u32 = 48;
    let at = |i: u32, j: u32| {
        let (phi, v) = (i as f32 / N as f32 * std::f32::consts::TAU, j as f32 / (N / 2) as f32);
        let (y, r) = if is_pipe {
            (4.0 * v - 2.0, 1.0)
        } else {
            let (sin, cos) = (v * std::f32::consts::PI).sin_cos();
            (-cos, sin.max(0.0))
        };
        vec3(r * phi.cos(), y, -r * phi.sin())
    };
    let vertex = |i: u32, j: u32| j * N + i % N;
    let positions: Vec<Vec3> = (0..=N / 2).flat_map(|j| (0..N).map(move |i| at(i, j))).collect();
    let cells = (0..N / 2).flat_map(|j| (0..N).map(move |i| (i, j)));
    let triangles: Vec<[u32; 3]> = cells
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Builder::default().mesh(&positions, &triangles, true, false)
}

#[test]
fn bulging_surfaces_keep_all_points_of_long_texels() {
    for is_pipe in [false, true] {
        for (bits, _, at) in bulging(is_pipe).points(3.0) {
            assert_eq!(bits, ALL_POINTS, "{at} {is_pipe}");
        }
    }
}

#[test]
fn a_ball_that_rests_on_the_floor_keeps_all_points() {
    // Nothing but the ball is between the points about its lowest one, but there is hardly room for a way
    // around it.
    let floor = bulging(false).quad(vec3(-3.0, -1.0001, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, false, false);
    for (bits, _, at) in floor.points(3.0) {
        assert_eq!(bits, ALL_POINTS, "{at}");
    }
}

#[test]
fn a_bulging_surface_above_another_keeps_all_points() {
    // What is a millimetre below lies between the points of a texel, and stands on none.
    let inner = |b: Builder| {
        let mut inner = bulging(true).geometry;
        inner.positions.iter_mut().for_each(|p| *p *= vec3(0.999, 1.0, 0.999));
        inner.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        b.mesh(&inner.positions, &inner.triangles, false, false)
    };
    for (bits, _, at) in inner(bulging(true)).points(3.0) {
        assert_eq!(bits, ALL_POINTS, "{at}");
    }
}

#[test]
fn fins_divide_a_pipe() {
    let fins = bulging(true).quad(vec3(-2.0, -3.0, 0.0), Vec3::X * 4.0, Vec3::Y * 6.0, false, true);
    let found = fins.points(3.0);
    assert!(found.iter().any(|f| f.1));
    for (bits, is_split, at) in found {
        // Points on both sides have a centre near the fin; a texel is 33 cm long.
        assert!(is_split || bits != ALL_POINTS || at.z.abs() > 0.05, "{at}");
    }
}

#[test]
fn walls_of_all_kinds_divide_a_floor_and_leave_nothing_below_them() {
    for x in [-2.03, -2.004, -2.104] {
        // (One of the last leaves a fiftieth of a texel beyond the wall's middle: charts may start half a
        // texel in.)
        expect_divided(x);
    }
}

fn expect_divided(x: f32) {
    let (low, high) = (vec3(-2.5, -0.01, -2.5), vec3(2.5, 2.51, 2.5));
    let floor = || floor_from(x);
    let ceiling = |b: Builder| b.block(vec3(-3.0, 2.5, -3.0), vec3(3.0, 2.7, 3.0));
    let wall = |half: f32| ceiling(floor()).block(vec3(-half, low.y, low.z), vec3(half, high.y, high.z));
    let sheet = |two_sided| {
        ceiling(floor()).quad(vec3(0.0, low.y, 2.5), Vec3::Y * 2.52, Vec3::NEG_Z * 5.0, false, two_sided)
    };
    let walls =
        [("thick", wall(0.225)), ("thin", wall(0.025)), ("thinner", wall(0.003)), ("hair", wall(1e-4))];
    let sheets = [("one-sided", sheet(false)), ("two-sided", sheet(true))];
    for (name, scene) in walls.into_iter().chain(sheets) {
        let half = match name {
            "thick" => 0.225,
            "thin" => 0.025,
            _ => 0.0,
        };
        let mut divided = 0;
        for (bits, is_split, at) in scene.points(5.0) {
            divided += u32::from(bits != ALL_POINTS);
            // (Texels of 20 cm; those within half of that of the wall reach across it. One point given up
            // moves the centre by 7 mm.)
            let is_across = at.x.abs() < half + 0.112;
            match bits {
                ALL_POINTS => assert!(at.x.abs() > half + 0.09, "{name}: {at}"),
                0 => assert_eq!(name, "thick"),
                // (Points in the wall itself do not make it split.)
                _ => {
                    let told = is_split || !name.contains("sided");
                    assert!(is_across && (told || half > 0.0), "{name}: {at} {bits:b} {is_split}");
                }
            }
            let below = (0.0 < half) && at.x.abs() < half && bits != 0;
            assert!(!below, "{name}: {at} lies in the wall");
        }
        assert!(divided >= 20, "{name}: {divided}");
    }
}

#[test]
fn a_wall_along_a_row_of_texels_leaves_all_the_same_side_whatever_the_seed() {
    let scene = |x: f32| {
        let wall = floor().block(vec3(-0.003, -0.01, -2.5), vec3(0.003, 2.5, 2.5));
        let mut geometry = wall.geometry;
        geometry.positions.iter_mut().skip(4).for_each(|p| p.x += x);
        Builder { geometry }
    };
    // (Texels of 20 cm, from the wall in a texel's first quarter to its last.)
    for x in [0.0, 0.04, 0.08, 0.12, 0.16] {
        let divided = |seed| -> Vec<(u16, f32)> {
            let found = scene(x).points_by(5.0, seed).into_iter();
            found.filter(|f| f.1 && f.2.z.abs() < 1.8).map(|f| (f.0, f.2.x)).collect()
        };
        let [rows, again] = [1, 2].map(divided);
        // (Up to three texels lie on the floor's diagonal, whose two triangles share the points in their own
        // way.)
        let alike = rows.iter().filter(|row| row.0 == rows[0].0).count();
        assert!(alike >= 15 && alike + 3 >= rows.len(), "{x}: {rows:?}");
        assert_eq!(rows, again, "{x}");
    }
}

#[test]
fn a_texel_keeps_to_the_greater_side_of_a_roof() {
    // A wall of texels of 20 cm, and a roof of one sheet that looks up, above a floor.
    for y in [0.03, 0.07, 0.13, 0.17] {
        let wall = Builder::default().quad(vec3(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, true, false);
        let wall = wall.quad(vec3(-9.0, -2.0, 9.0), Vec3::X * 18.0, Vec3::NEG_Z * 18.0, false, false);
        let roof = wall.quad(vec3(-5.0, y, 5.0), Vec3::X * 10.0, Vec3::NEG_Z * 10.0, false, false);
        let mut divided = 0;
        for (bits, is_split, at) in roof.points(5.0).into_iter().filter(|(_, is_split, _)| *is_split) {
            assert!(bits.count_ones() >= 8 && (at.y - y).abs() < 0.11, "{y}: {at} {bits:b} {is_split}");
            divided += 1;
        }
        assert!(divided >= 20, "{y}: {divided}");
    }
}

#[test]
fn what_lies_under_open_ground_is_not_a_walls_surface_though_it_is_more_of_it() {
    // A wall of texels of 20 cm, and ground that leaves 3 to 17 cm of some above it.
    let mut above = 0;
    for y in [0.03, 0.07, 0.13, 0.17] {
        let wall = Builder::default().quad(vec3(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, true, false);
        let ground = wall.quad(vec3(-5.0, y, 5.0), Vec3::X * 10.0, Vec3::NEG_Z * 10.0, false, false);
        let mut below = 0;
        for (bits, is_split, at) in ground.points(5.0) {
            // (Of a texel with a corner above the ground at most, all is under it.)
            if is_split && (2..15).contains(&bits.count_ones()) {
                assert!(at.y > y, "{y}: {at} {bits:b}");
                above += 1;
            }
            below += u32::from(at.y < y - 0.2);
        }
        assert!(below > 100, "{y}: {below}");
    }
    assert!(above >= 20, "{above}");
}

#[test]
fn ground_between_fine_things_is_ground() {
    // A lattice of sheets 6 cm apart on texels of 40 cm.
    let mut scene = floor();
    for i in 0..60 {
        let at = -1.8 + 0.06 * i as f32;
        scene = scene.quad(vec3(at, 0.0, 1.8), Vec3::NEG_Z * 3.6, Vec3::Y * 0.03, false, true);
        scene = scene.quad(vec3(-1.8, 0.0, at), Vec3::X * 3.6, Vec3::Y * 0.03, false, true);
    }
    for (bits, _, at) in scene.points(2.5) {
        assert!(bits.count_ones() >= 8, "{at}: {bits:b}");
    }
}

#[test]
fn air_is_outside_whatever_stands_about() {
    // A room's shell within a house's, which are not connected; a roof of one sheet; sheets of two one-sided
    // faces; a block wound inside out; a block that stands on nothing but one texel.
    let sheets = |b: Builder| {
        let up = b.quad(vec3(-1.0, 0.5, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, false, false);
        up.quad(vec3(-1.0, 0.5, 1.0), Vec3::NEG_Z * 2.0, Vec3::X * 2.0, false, false)
    };
    let roof = |b: Builder| b.quad(vec3(-3.0, 3.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, false, false);
    let house =
        |b: Builder| b.block(Vec3::splat(-4.0), Vec3::splat(4.0)).block(Vec3::splat(3.5), Vec3::splat(-3.5));
    let inside_out = |b: Builder| b.block(vec3(1.0, 1.5, 1.0), vec3(0.5, 1.0, 0.5));
    // A pyramid on a sheet of two one-sided faces: a solid with a hem of no thickness.
    let hem = |b: Builder, top_first: bool| {
        let square = |half: f32| {
            [vec3(-half, 1.0, half), vec3(half, 1.0, half), vec3(half, 1.0, -half), vec3(-half, 1.0, -half)]
        };
        let positions = [&square(1.5)[..], &square(0.1), &[vec3(0.0, 1.2, 0.0)]].concat();
        let ring = (0..4u32).flat_map(|i| {
            let next = (i + 1) % 4;
            [[i, next, 4 + next], [i, 4 + next, 4 + i], [4 + i, 4 + next, 8]]
        });
        let (top, below) = (ring.collect::<Vec<_>>(), vec![[0, 2, 1], [0, 3, 2]]);
        let triangles = if top_first { [top, below].concat() } else { [below, top].concat() };
        b.mesh(&positions, &triangles, false, false)
    };
    for (name, scene) in [
        ("a house", house(floor())),
        ("a roof", roof(floor())),
        ("sheets", sheets(floor())),
        ("a house with a roof and sheets", sheets(roof(house(floor())))),
        ("a block wound inside out", inside_out(floor())),
        ("a hem", hem(floor(), true)),
        ("a hem the other way round", hem(floor(), false)),
        ("a block", floor().block(vec3(0.5, 1.0, 0.5), vec3(1.0, 1.5, 1.0))),
    ] {
        for (bits, _, at) in scene.points(5.0) {
            assert_eq!(bits, ALL_POINTS, "{name}: {at}");
        }
    }
}
