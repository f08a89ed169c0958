//! A lit room beside a closed dark one: walls 5 cm thick, texels of 20 cm.

use crate::common::mesh::Obj;
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

/// One floor and ceiling under both rooms, a wall of 5 cm on it, 20 cm above and below the slab's texel grid.
fn shared_slab() -> Stage {
    let slab = |obj: Obj, name: &str, y0: f64, y1: f64| {
        obj.mesh(name).block(dvec3(-3.17, y0, -1.7), dvec3(3.23, y1, 1.7))
    };
    let wall =
        |obj: Obj, x0: f64, x1: f64, z0: f64, z1: f64| obj.block(dvec3(x0, 0.0, z0), dvec3(x1, 2.5, z1));
    let obj = slab(slab(Obj::default(), "floor", -0.2, 0.0), "ceiling", 2.5, 2.7).mesh("walls");
    let obj = wall(obj, -0.025, 0.025, -1.5, 1.5);
    let obj = wall(wall(obj, -3.05, -3.0, -1.55, 1.55), 3.0, 3.05, -1.55, 1.55);
    let obj = wall(wall(obj, -3.0, 3.0, -1.55, -1.5), -3.0, 3.0, 1.5, 1.55);
    Stage::new(&[("a.obj", obj.text())])
}

/// Whether a texel's centre lies in a room: between −/+3 and the wall, on a surface that looks into it.
fn in_room(texel: &crate::common::texels::Texel, dark: bool) -> bool {
    let p = texel.centre();
    let x = if dark { p.x } else { -p.x };
    let within = x > 0.02 && x < 3.01 && p.z.abs() < 1.51 && p.y > -0.01 && p.y < 2.51;
    let middle = dvec3(if dark { 1.5 } else { -1.5 }, 1.25, 0.0);
    within && (middle - p).dot(texel.normal) > 0.0
}

#[test]
fn texels_wholly_inside_the_dark_room_of_a_shared_floor_get_nothing() {
    let baked = shared_slab().bake("12", 64, &format!("[[object]]\nfile = \"a.obj\"\n{LAMP}{TEXELS}"));
    let image = baked.group("lamp");
    let (mut dark, mut lit) = (0, 0);
    for texel in &baked.texels {
        let light = green(&image, texel);
        let p = texel.centre();
        // Farther from the wall than a texel's half diagonal.
        if in_room(texel, true) && p.x > 0.025 + 0.15 {
            assert!(!texel.valid, "{texel:?}: {light}");
            dark += 1;
        }
        if in_room(texel, false) && texel.whole && p.x < -0.2 && p.x > -2.8 && p.z.abs() < 1.3 {
            assert!(texel.valid && light > 0.0, "{texel:?}: {light}");
            lit += 1;
        }
    }
    assert!(dark > 200 && lit > 200, "{dark} {lit}");
}

#[test]
fn texels_across_the_wall_of_a_shared_floor_bring_no_light_into_the_dark_room() {
    for integrator in INTEGRATORS {
        let scene = format!("[[object]]\nfile = \"a.obj\"\n{LAMP}{TEXELS}");
        let baked = shared_slab().by(integrator).bake("12", 64, &scene);
        let image = baked.group("lamp");
        for texel in baked.texels.iter().filter(|t| in_room(t, true)) {
            let light = green(&image, texel);
            assert!(!texel.valid, "{integrator:?}: light in the dark room: {texel:?}: {light}");
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
