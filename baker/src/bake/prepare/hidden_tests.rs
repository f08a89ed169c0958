use super::*;
use crate::atlas;
use crate::trace::paths::{Sequence, SequenceKind};
use crate::{geometry, scene};
use glam::{DVec3, dvec3};
use std::fmt::Write;

/// A page on which no face is as long as what is looked through.
fn page() -> Lightmap {
    Lightmap { size: LightmapSize::Fixed { width: 96, height: 96 }, ..Lightmap::default() }
}

/// An OBJ being written.
#[derive(Default)]
struct Obj(String);

impl Obj {
    /// A parallelogram whose front is on the side of `u × v`: two triangles.
    fn quad(mut self, corner: DVec3, u: DVec3, v: DVec3) -> Self {
        for p in [corner, corner + u, corner + u + v, corner + v] {
            writeln!(self.0, "v {:?} {:?} {:?}\nvt 0.5 0.5", p.x, p.y, p.z).unwrap();
        }
        self.0 += "f -4/-4 -3/-3 -2/-2 -1/-1\n";
        self
    }

    /// The sides −x, +x, −y, +y, −z, +z of a box: twelve triangles, two a side.
    fn sides(mut self, low: DVec3, high: DVec3, inside: bool) -> Self {
        let size = high - low;
        for side in 0..6 {
            let (axis, upper) = (side / 2, side % 2 == 1);
            let edge = |a: usize| DVec3::AXES[a % 3] * size[a % 3];
            let corner = if upper { low + edge(axis) } else { low };
            let (u, v) = (edge(axis + 1), edge(axis + 2));
            self = if upper != inside { self.quad(corner, u, v) } else { self.quad(corner, v, u) };
        }
        self
    }

    fn block(self, low: [f64; 3], high: [f64; 3]) -> Self {
        self.sides(low.into(), high.into(), false)
    }

    fn room(self, low: [f64; 3], high: [f64; 3]) -> Self {
        self.sides(low.into(), high.into(), true)
    }

    /// A square of 10 × 10 m that looks up.
    fn floor(self) -> Self {
        self.quad(dvec3(-5.0, 0.0, 5.0), DVec3::X * 10.0, DVec3::NEG_Z * 10.0)
    }

    fn mesh(mut self, name: &str) -> Self {
        writeln!(self.0, "o {name}").unwrap();
        self
    }

    fn material(mut self, name: &str) -> Self {
        writeln!(self.0, "mtllib m.mtl\nusemtl {name}").unwrap();
        self
    }

    /// The geometry of a scene with this object; `keys` are those of the object.
    fn with(self, keys: &str) -> Geometry {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("m.mtl"), "newmtl cut\nmap_Kd a.png\nmap_d a.png\nnewmtl whole\nmap_Kd a.png\n")
            .unwrap();
        image::RgbaImage::from_pixel(1, 1, image::Rgba([200; 4])).save(at("a.png")).unwrap();
        std::fs::write(at("a.obj"), self.0).unwrap();
        std::fs::write(at("scene.toml"), format!("[[object]]\nfile = \"a.obj\"\n{keys}\n")).unwrap();
        geometry::load(&scene::load(&at("scene.toml")).unwrap().0).unwrap().0
    }

    fn hidden(self) -> Vec<u32> {
        find(&self.with(""), &page()).triangles
    }
}

/// No triangle.
const NONE: [u32; 0] = [];

const UNIT: [[f64; 3]; 2] = [[0.0; 3], [1.0; 3]];

#[test]
fn what_stands_on_a_floor_hides_its_underside_and_leaves_the_floor() {
    let on_floor = |height: f64| Obj::default().floor().block([0.0, height, 0.0], [1.0, height + 1.0, 1.0]);
    // On it, in it by rounding, and a tenth of a millimetre above it.
    for height in [0.0, -1e-8, 1e-4] {
        assert_eq!(on_floor(height).hidden(), [6, 7], "{height}");
    }
    // A gap one can look into; and sunk in a sheet, below which there may be anything.
    for height in [0.02, -0.02] {
        assert_eq!(on_floor(height).hidden(), NONE, "{height}");
    }
    // Sunk in the ground of a body.
    let ground = Obj::default().block([-5.0, -1.0, -5.0], [5.0, 0.0, 5.0]);
    assert_eq!(ground.block([0.0, -0.02, 0.0], UNIT[1]).hidden(), [16, 17]);
    // What covers the floor hides it.
    let covered = Obj::default().floor().block([-5.0, 0.0, -5.0], [5.0, 1.0, 5.0]);
    assert_eq!(covered.hidden(), [0, 1, 6, 7]);
}

#[test]
fn a_block_in_a_block_is_hidden_and_one_in_a_room_is_not() {
    let (low, high) = ([-2.0; 3], [3.0; 3]);
    let inner: Vec<u32> = (12..24).collect();
    assert_eq!(Obj::default().block(low, high).block(UNIT[0], UNIT[1]).hidden(), inner);
    // A closed room, seen from inside; the block floats in it, or stands on its floor.
    assert_eq!(Obj::default().room(low, high).block(UNIT[0], UNIT[1]).hidden(), NONE);
    assert_eq!(Obj::default().room([-2.0, 0.0, -2.0], high).block(UNIT[0], UNIT[1]).hidden(), [16, 17]);
    // The room is in a house.
    let house = Obj::default().block([-3.0; 3], [4.0; 3]).room(low, high).block(UNIT[0], UNIT[1]);
    assert_eq!(house.hidden(), NONE);
    // Walls of which both sides are seen may be a room's, whichever way they are turned.
    let two_sided = Obj::default().block(low, high).block(UNIT[0], UNIT[1]).with("two_sided = true");
    assert_eq!(find(&two_sided, &page()).triangles, NONE);
    // A room by itself, turned either way.
    assert_eq!(Obj::default().room(low, high).hidden(), NONE);
    assert_eq!(Obj::default().block(low, high).hidden(), NONE);
}

#[test]
fn a_hole_of_a_texel_in_what_covers_a_wall_is_found_wherever_it_is() {
    let small = page();
    for k in 0..24 {
        // A wall of 2 × 2 m, its front 10 and 11, and a covering of four blocks about a hole of 4 cm; texels
        // are longer.
        let [x, y] = [0.37 * f64::from(k), 0.53 * f64::from(k)].map(|at| at % 1.9 - 0.95);
        let hole = 0.04;
        let wall = Obj::default().block([-1.0, -1.0, -0.1], [1.0, 1.0, 0.0]);
        let covered = wall
            .block([-1.0, -1.0, 0.0], [x, 1.0, 0.1])
            .block([x + hole, -1.0, 0.0], [1.0, 1.0, 0.1])
            .block([x, -1.0, 0.0], [x + hole, y, 0.1])
            .block([x, y + hole, 0.0], [x + hole, 1.0, 0.1]);
        let geometry = covered.with("");
        assert!(texel_length(&geometry, &small) > hole);
        let hidden = find(&geometry, &small).triangles;
        assert!(!(hidden.contains(&10) && hidden.contains(&11)), "({x}, {y}): {hidden:?}");
    }
    // Without a hole the front is hidden.
    let whole =
        Obj::default().block([-1.0, -1.0, -0.1], [1.0, 1.0, 0.0]).block([-1.0, -1.0, 0.0], [1.0, 1.0, 0.1]);
    let hidden = find(&whole.with(""), &small).triangles;
    assert!(hidden.contains(&10) && hidden.contains(&11), "{hidden:?}");
}

#[test]
fn blocks_pressed_together_hide_what_they_share() {
    let wall = |height: f64| Obj::default().block([-1.0, 0.0, 0.0], [0.0, height, 3.0]);
    let beside = |height: f64| wall(2.0).block([0.0; 3], [1.0, height, 3.0]);
    assert_eq!(beside(2.0).hidden(), [2, 3, 12, 13]);
    // Of the higher one, a strip is seen: all of its face keeps its texels.
    assert_eq!(beside(2.05).hidden(), [2, 3]);
    assert_eq!(beside(1.95).hidden(), [12, 13]);
}

#[test]
fn a_box_whose_sides_are_modelled_twice_is_seen() {
    // From outside and from inside, where each face lies in the plane of another that is turned round.
    let both = Obj::default().block([0.0; 3], [1.0; 3]).room([0.0; 3], [1.0; 3]);
    assert_eq!(both.hidden(), NONE);
    // On a floor, whose part below it stays hidden by the lower side.
    let both = Obj::default().floor().block([0.0; 3], [1.0; 3]).room([0.0; 3], [1.0; 3]);
    assert!(both.hidden().iter().all(|triangle| !(2..6).contains(triangle)), "its upright sides");
}

#[test]
fn sheets_are_hidden_by_what_they_face_and_not_by_what_they_turn_their_backs_on() {
    let sheet = |obj: Obj, y: f64, up: bool| {
        let (u, v) = (DVec3::X, DVec3::NEG_Z);
        let corner = dvec3(0.0, y, 0.0);
        if up { obj.quad(corner, u, v) } else { obj.quad(corner, v, u) }
    };
    let pair = |first: (f64, bool), second: (f64, bool)| {
        sheet(sheet(Obj::default(), first.0, first.1), second.0, second.1).hidden()
    };
    assert_eq!(sheet(Obj::default(), 0.0, true).hidden(), NONE);
    // The two sides of a leaf, with and without thickness.
    assert_eq!(pair((0.0, true), (0.0, false)), NONE);
    assert_eq!(pair((1e-5, true), (0.0, false)), NONE);
    // Face to face; and with a gap.
    assert_eq!(pair((0.0, true), (5e-5, false)), [0, 1, 2, 3]);
    assert_eq!(pair((0.0, true), (0.05, false)), NONE);
    // One close over the other, both looking up, as a poster on a wall; and with a gap.
    assert_eq!(pair((0.0, true), (1e-5, true)), [0, 1]);
    assert_eq!(pair((0.0, true), (0.05, true)), NONE);
    // Duplicates.
    assert_eq!(pair((0.0, true), (0.0, true)), NONE);
    // A thin plate of two one-sided sides and a rim.
    assert_eq!(Obj::default().block([0.0; 3], [1.0, 1e-5, 1.0]).hidden(), NONE);
}

#[test]
fn cut_outs_hide_nothing() {
    let nested = |material: &str| {
        let outer = Obj::default().mesh("outer").material(material).block([-2.0; 3], [3.0; 3]);
        outer.mesh("inner").material("whole").block(UNIT[0], UNIT[1]).hidden()
    };
    assert_eq!(nested("whole").len(), 12);
    assert_eq!(nested("cut"), NONE);
    let covered = |material: &str| {
        let floor = Obj::default().mesh("floor").material(material).floor();
        floor.mesh("box").material("whole").block(UNIT[0], UNIT[1]).hidden()
    };
    assert_eq!(covered("whole"), [6, 7]);
    assert_eq!(covered("cut"), NONE);
}

#[test]
fn a_face_has_texels_if_one_instance_that_shares_them_shows_it() {
    let block = || Obj::default().block(UNIT[0], UNIT[1]);
    let at =
        |places: &str| format!("instances = [{places}]\n[[object]]\nfile = \"ground.obj\"\nlightmap = false");
    let load = |places: &str| {
        let folder = tempfile::tempdir().unwrap();
        let ground = Obj::default().block([-50.0, -9.0, -50.0], [50.0, 0.0, 50.0]);
        std::fs::write(folder.path().join("ground.obj"), ground.0).unwrap();
        std::fs::write(folder.path().join("a.obj"), block().0).unwrap();
        let text = format!("[[object]]\nfile = \"a.obj\"\n{}\n", at(places));
        std::fs::write(folder.path().join("scene.toml"), text).unwrap();
        geometry::load(&scene::load(&folder.path().join("scene.toml")).unwrap().0).unwrap().0
    };
    let skipped = |places: &str| {
        let geometry = load(places);
        let hidden = find(&geometry, &page());
        let atlas = atlas::build_without(&geometry, &page(), &hidden.triangles).unwrap();
        assert_eq!(atlas.skipped.of, 24);
        assert_eq!(atlas.faces.len() + atlas.skipped.triangles, 24);
        assert_eq!(atlas.degenerate, 0);
        assert!(atlas.faces.iter().all(|f| !hidden.triangles.contains(&f.triangle)));
        assert_eq!(atlas.skipped.triangles, hidden.triangles.len());
        (atlas.skipped.triangles, atlas.skipped.area)
    };
    // Both stand on the ground; one floats; one is under it.
    assert_eq!(skipped("{}, { translate = [5, 0, 0] }"), (4, 1.0 / 6.0));
    assert_eq!(skipped("{}, { translate = [5, 1, 0] }"), (0, 0.0));
    assert_eq!(skipped("{}, { translate = [5, -4, 0] }"), (4, 1.0 / 6.0));
}

#[test]
fn a_scene_that_nobody_can_see_is_told() {
    let lightmap = page();
    let obj = Obj::default().mesh("shell").block([-2.0; 3], [3.0; 3]).mesh("inner").block(UNIT[0], UNIT[1]);
    // More of it than not; then all of it.
    let mut large = Obj::default();
    for i in 0..9 {
        let low = -2.0 + 0.1 * f64::from(i);
        large = large.block([low; 3], [-low + 1.0; 3]);
    }
    let large = large.with("");
    let atlas = atlas::build_without(&large, &lightmap, &find(&large, &lightmap).triangles).unwrap();
    assert!(atlas.skipped.triangles == 96 && atlas.skipped.area > 0.5, "{:?}", atlas.skipped);
    assert!(atlas.warnings.iter().any(|w| w.contains("nobody can see it") && w.contains("inside out")));
    let all = obj.with("[[object.part]]\nname = \"shell\"\nlightmap = false");
    let error =
        atlas::build_without(&all, &lightmap, &find(&all, &lightmap).triangles).unwrap_err().to_string();
    assert!(
        error.contains("nothing to bake")
            && error.contains("12 cannot")
            && error.contains("hidden = \"keep\""),
        "{error}"
    );
}

#[test]
fn what_is_asked_to_be_kept_is() {
    let geometry = Obj::default().floor().block(UNIT[0], UNIT[1]).with("");
    for lightmap in [
        Lightmap { hidden: HiddenFaces::Keep, ..Lightmap::default() },
        Lightmap { uv: UvSource::Keep, ..Lightmap::default() },
    ] {
        let hidden = find(&geometry, &lightmap);
        assert!(hidden.triangles.is_empty() && hidden.rays == RayCounts::default());
    }
}

#[test]
fn the_number_of_threads_is_no_matter() {
    let geometry = random(7).1.with("");
    let of_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let hidden = pool.install(|| find(&geometry, &page()));
        (hidden.triangles, hidden.rays)
    };
    let one = of_threads(1);
    assert!(!one.0.is_empty() && one.1.inside > 1000, "{one:?}");
    assert!(one == of_threads(3));
}

/// A box of whole metres: its lower and its upper corner.
type Cells = ([i32; 3], [i32; 3]);

/// Boxes of one to four metres at whole metres, which overlap and touch.
fn random(seed: u64) -> (Vec<Cells>, Obj) {
    const SIDE: i32 = 8;
    let number = |i: u32, n: i32| {
        let u = Sequence::new(seed, SequenceKind::Texel, i, 0).sample(0).number(0);
        ((u * n as f32) as i32).min(n - 1)
    };
    let cells = |i: u32| {
        let low = [0, 1, 2].map(|a| number(6 * i + a, SIDE - 4));
        let high = [0, 1, 2].map(|a| low[a as usize] + 1 + number(6 * i + 3 + a, 4));
        (low, high)
    };
    let boxes: Vec<Cells> = (0..9).map(cells).collect();
    let obj = boxes
        .iter()
        .fold(Obj::default(), |obj, (low, high)| obj.block(low.map(f64::from), high.map(f64::from)));
    (boxes, obj)
}

/// Whether some box holds the cell.
fn is_filled(boxes: &[Cells], cell: [i32; 3]) -> bool {
    boxes.iter().any(|(low, high)| (0..3).all(|a| low[a] <= cell[a] && cell[a] < high[a]))
}

/// No face is hidden of which a square metre, or half of one, can be seen; nearly all others are.
#[test]
fn faces_of_random_boxes_are_hidden_where_others_fill_what_they_look_into() {
    let (mut found, mut wanted) = (0, 0);
    for seed in 0..60 {
        let (boxes, obj) = random(seed);
        let geometry = obj.with("");
        let size = LightmapSize::Fixed { width: 128, height: 128 };
        let hidden = find(&geometry, &Lightmap { size, ..Lightmap::default() }).triangles;
        for triangle in 0..geometry.triangles.len() {
            let normal = geometry.normal(triangle).as_dvec3();
            let [a, b, c] = geometry.corners(triangle).map(|p| p.as_dvec3() + geometry.origin);
            // Points in every part of the triangle that lies in another square metre, and the cell before
            // each.
            let n = 24;
            let points = (0..n).flat_map(|i| (0..n - i).map(move |j| (i, j)));
            let is_hidden = points.into_iter().all(|(i, j)| {
                let (u, v) =
                    ((f64::from(i) + 1.0 / 3.0) / f64::from(n), (f64::from(j) + 1.0 / 3.0) / f64::from(n));
                let p = a + (b - a) * u + (c - a) * v + normal * 0.5;
                is_filled(&boxes, p.floor().as_ivec3().to_array())
            });
            let is_found = hidden.contains(&(triangle as u32));
            assert!(is_hidden || !is_found, "seed {seed}: triangle {triangle} of {boxes:?} can be seen");
            wanted += usize::from(is_hidden);
            found += usize::from(is_found);
        }
    }
    assert!(wanted > 1000 && found as f64 > 0.98 * wanted as f64, "{found} of {wanted}");
}
