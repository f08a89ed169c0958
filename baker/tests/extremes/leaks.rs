//! A lit room beside a closed dark one; texels of 20 cm.

use crate::common::mesh::Obj;
use crate::common::texels::Texel;
use crate::common::{Baked, INTEGRATORS, Stage, green};
use glam::dvec3;

const TEXELS: &str = "[lightmap]\ntexels_per_metre = 5\n";
const LAMP: &str = "[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [-1.5, 1.5, 0]\nradius = 0.1\n\
                    radiance = [100, 100, 100]\n";

/// Light in the texels of the dark room, which must be none; a valid one that is black is a fault too.
fn expect_dark(baked: &Baked, name: &str) {
    let image = baked.group("lamp");
    for texel in baked.covered(name) {
        let light = green(&image, texel);
        assert!(!texel.valid || light > 0.0, "black but valid: {texel:?}");
        assert!(!texel.valid, "light in the dark room: {texel:?}: {light}");
    }
}

fn expect_lit(baked: &Baked, name: &str) {
    let image = baked.group("lamp");
    let texels = baked.covered(name);
    let lit = texels.iter().filter(|t| t.valid).count();
    assert!(lit * 10 > texels.len() * 9, "{lit} of {} texels of the lit room", texels.len());
    for texel in texels.iter().filter(|t| t.valid) {
        assert!(green(&image, texel) > 0.0, "black but valid: {texel:?}");
    }
}

#[test]
fn rooms_of_their_own_walls_share_no_light() {
    // Each room is a box of its own; the wall between them is 5 cm of solid.
    let obj = Obj::default()
        .mesh("lit")
        .room(dvec3(-3.0, 0.0, -1.5), dvec3(-0.025, 2.5, 1.5))
        .mesh("dark")
        .room(dvec3(0.025, 0.0, -1.5), dvec3(3.0, 2.5, 1.5));
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let baked = stage.bake("12", 64, &format!("[[object]]\nfile = \"a.obj\"\n{LAMP}{TEXELS}"));
    expect_lit(&baked, "lit");
    expect_dark(&baked, "dark");
}

/// What divides the rooms.
struct Divider {
    name: &'static str,
    /// Half of its thickness.
    half: f64,
    /// How far it reaches into floor, ceiling and walls.
    into: f64,
    two_sided: bool,
}

const DIVIDERS: [Divider; 7] = [
    Divider { name: "ends on the surfaces", half: 0.025, into: 0.0, two_sided: false },
    Divider { name: "reaches into them", half: 0.025, into: 0.01, two_sided: false },
    Divider { name: "thick, reaches into them", half: 0.25, into: 0.01, two_sided: false },
    Divider { name: "thinner than points of a texel are apart", half: 0.003, into: 0.01, two_sided: false },
    Divider { name: "thin, ends on the surfaces", half: 0.003, into: 0.0, two_sided: false },
    Divider { name: "one-sided sheet", half: 0.0, into: 0.01, two_sided: false },
    Divider { name: "two-sided sheet", half: 0.0, into: 0.01, two_sided: true },
];

/// One floor and ceiling under both rooms, 20 cm above and below the slab's texel grid, and what divides
/// them.
fn shared_slab(divider: &Divider) -> (Stage, String) {
    let slab = |obj: Obj, name: &str, y0: f64, y1: f64| {
        obj.mesh(name).block(dvec3(-3.17, y0, -1.7), dvec3(3.23, y1, 1.7))
    };
    let wall =
        |obj: Obj, x0: f64, x1: f64, z0: f64, z1: f64| obj.block(dvec3(x0, 0.0, z0), dvec3(x1, 2.5, z1));
    let obj = slab(slab(Obj::default(), "floor", -0.2, 0.0), "ceiling", 2.5, 2.7).mesh("walls");
    let obj = wall(wall(obj, -3.05, -3.0, -1.55, 1.55), 3.0, 3.05, -1.55, 1.55);
    let obj = wall(wall(obj, -3.0, 3.0, -1.55, -1.5), -3.0, 3.0, 1.5, 1.55);
    let &Divider { half, into, two_sided, .. } = divider;
    let (low, high) = (dvec3(-half, -into, -1.5 - into), dvec3(half, 2.5 + into, 1.5 + into));
    let middle = Obj::default().mesh("divider");
    let middle = if half > 0.0 { middle.block(low, high) } else { middle.sides(low, high, false, &[0]) };
    let stage = Stage::new(&[("a.obj", obj.text()), ("b.obj", middle.text())]);
    let objects =
        format!("[[object]]\nfile = \"a.obj\"\n[[object]]\nfile = \"b.obj\"\ntwo_sided = {two_sided}\n");
    (stage, format!("{objects}{LAMP}{TEXELS}"))
}

/// Whether a texel's centre lies in a room, at least `margin` from its walls, on a surface that looks into
/// it.
fn in_room(texel: &Texel, dark: bool, half: f64, margin: f64) -> bool {
    let p = texel.centre();
    let x = if dark { p.x } else { -p.x };
    let within = x > half - 1e-6 + margin && x < 3.01 - margin && p.z.abs() < 1.51 - margin;
    let middle = dvec3(if dark { 1.5 } else { -1.5 }, 1.25, 0.0);
    within && p.y > -0.005 && p.y < 2.505 && (middle - p).dot(texel.normal) > 0.0
}

#[test]
fn walls_of_all_kinds_keep_light_out_of_the_dark_room_of_a_shared_floor() {
    for divider in &DIVIDERS {
        for integrator in INTEGRATORS {
            let (stage, scene) = shared_slab(divider);
            let baked = stage.by(integrator).bake("12", 64, &scene);
            let image = baked.group("lamp");
            let what = format!("{}, {integrator:?}", divider.name);
            let (mut dark, mut lit, mut covered) = (0, 0, 0);
            for texel in &baked.texels {
                let light = green(&image, texel);
                // (A texel that a sheet halves may keep to either side.)
                if in_room(texel, true, divider.half.max(0.02), 0.0) {
                    assert!(!texel.valid, "{what}: light in the dark room: {texel:?}: {light}");
                    dark += 1;
                }
                if in_room(texel, false, divider.half, 0.15) && texel.whole {
                    assert!(texel.valid && light > 0.0, "{what}: {texel:?}: {light}");
                    lit += 1;
                }
                // On floor or ceiling, wholly below the wall.
                if texel.normal.y.abs() > 0.9 && texel.centre().x.abs() < divider.half - 0.11 {
                    assert!(!texel.valid, "{what}: below the wall: {texel:?}: {light}");
                    covered += 1;
                }
            }
            assert!(dark > 400 && lit > 250, "{what}: {dark} {lit}");
            assert!(covered > 20 || divider.half < 0.2, "{what}: {covered}");
        }
    }
}

#[test]
fn a_lamp_in_the_dark_rooms_ceiling_void_stays_there() {
    // Rooms above each other, the lamp 1 cm above the upper side of the slab between them.
    let obj = Obj::default()
        .mesh("upper")
        .room(dvec3(-1.5, 0.05, -1.5), dvec3(1.5, 2.0, 1.5))
        .mesh("dark")
        .room(dvec3(-1.5, -2.0, -1.5), dvec3(1.5, 0.0, 1.5));
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let lamp = LAMP.replace("[-1.5, 1.5, 0]", "[0, 0.06, 0]").replace("0.1", "0.005");
    let baked = stage.bake("12", 64, &format!("[[object]]\nfile = \"a.obj\"\n{lamp}{TEXELS}"));
    expect_lit(&baked, "upper");
    expect_dark(&baked, "dark");
}
