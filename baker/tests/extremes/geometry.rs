//! Coordinates, sizes and triangles that strain arithmetic.

use crate::common::closed::ball;
use crate::common::mesh::Obj;
use crate::common::{Baked, Measured, Stage, green, mean};
use glam::{DVec3, dvec3};
use std::f64::consts::PI;

const SKY: &str = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";

/// A floor with a block on it, of `unit` metres, around `centre`.
fn block_on_floor(unit: f64, centre: DVec3) -> Obj {
    let at = |x: f64, y: f64, z: f64| centre + dvec3(x, y, z) * unit;
    Obj::default()
        .mesh("floor")
        .floor(centre, 4.0 * unit)
        .mesh("block")
        .block(at(-0.5, 0.0, -0.5), at(0.5, 1.0, 0.5))
}

/// Sky, a low sun and a ball lamp over the block on the floor.
fn lit(unit: f64, centre: DVec3) -> String {
    let lamp = centre + dvec3(1.25, 1.5, 0.5) * unit;
    format!(
        "{SKY}[sun]\ntrack = [{{ hour = 12, direction = [1, 1, 0.5], irradiance = [10, 10, 10] }}]\n\
         [[object]]\nfile = \"a.obj\"\n[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [{:?}, {:?}, {:?}]\n\
         radius = {:?}\nradiance = [3, 3, 3]\n[lightmap]\nsize = 32\n",
        lamp.x,
        lamp.y,
        lamp.z,
        0.125 * unit
    )
}

#[test]
fn a_million_metres_from_the_origin_nothing_changes() {
    // Eighths of a metre are exact at 10⁶ m in f64, and positions are held about the scene's centre: the same
    // bits.
    let far = dvec3(1e6, -1e6, 1e6);
    let bake = |centre: DVec3| {
        let stage = Stage::new(&[("a.obj", block_on_floor(1.0, centre).text())]);
        stage.bake("12", 16, &lit(1.0, centre)).first()
    };
    assert!(bake(DVec3::ZERO) == bake(far), "the light at 10⁶ m differs");
    // By translation as well.
    let stage = Stage::new(&[("a.obj", block_on_floor(1.0, DVec3::ZERO).text())]);
    let moved = "file = \"a.obj\"\ntranslate = [1e6, -1e6, 1e6]";
    let scene = lit(1.0, far).replace("file = \"a.obj\"", moved);
    assert!(stage.bake("12", 16, &scene).first() == bake(far));
}

#[test]
fn off_the_grid_far_away_the_light_is_right() {
    // Coordinates that f64 holds to 10⁻¹⁰ m only: the sphere's closed form on the floor's texels.
    let centre = dvec3(1e6 + 0.3, 1e6 / 7.0, -1e6 / 3.0);
    let lamp = centre + dvec3(0.3, 1.2, 0.1);
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(centre, 1.0).text())]);
    let scene = format!(
        "[[object]]\nfile = \"a.obj\"\n[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [{:?}, {:?}, {:?}]\n\
         radius = 0.2\nradiance = [3, 3, 3]\n[lightmap]\nsize = 16\n",
        lamp.x, lamp.y, lamp.z
    );
    let read = |b: &Baked| {
        let expected = |p: DVec3| 3.0 * ball(lamp - centre, 0.2, p, DVec3::Y);
        b.ratio(&b.first(), &b.on("floor"), |t| t.average(|p| expected(p - centre)))
    };
    stage.measure("12", 64, &scene, read).expect(1.0, 2e-3);
}

#[test]
fn a_millimetre_and_a_hundred_kilometres_have_the_light_of_a_metre() {
    // Radiance knows no size: floor and block have the same light at every scale, sky, sun and lamp together.
    let measure = |unit: f64| {
        let stage = Stage::new(&[("a.obj", block_on_floor(unit, DVec3::ZERO).text())]);
        stage.measure("12", 64, &lit(unit, DVec3::ZERO), |b| mean(&b.first(), &b.on("floor")))
    };
    let metre = measure(1.0);
    // 2.5·10⁻⁴ and 2.5·10⁴: 1 mm and 100 km across.
    for unit in [2.5e-4, 2.5e4] {
        measure(unit).agree(metre, 5e-3);
    }
}

/// A square floor of side 1 around (0.5, 0, 0.5) cut into slivers of 10⁻⁶ m between two halves.
fn floor_with_slivers() -> Obj {
    let mut obj = Obj::default().mesh("floor");
    let strip = |obj: Obj, x0: f64, x1: f64| {
        obj.polygon(&[dvec3(x0, 0.0, 1.0), dvec3(x1, 0.0, 1.0), dvec3(x1, 0.0, 0.0)]).polygon(&[
            dvec3(x0, 0.0, 1.0),
            dvec3(x1, 0.0, 0.0),
            dvec3(x0, 0.0, 0.0),
        ])
    };
    obj = strip(obj, 0.0, 0.5);
    for i in 0..10 {
        obj = strip(obj, 0.5 + f64::from(i) * 1e-6, 0.5 + f64::from(i + 1) * 1e-6);
    }
    strip(obj, 0.5 + 1e-5, 1.0)
}

#[test]
fn slivers_receive_what_their_neighbours_do() {
    // Twenty triangles of aspect 10⁻⁶ in an open floor under an even sky: π everywhere, slivers or not.
    let stage = Stage::new(&[("a.obj", floor_with_slivers().text())]);
    let baked = stage.bake("12", 16, &format!("{SKY}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 64\n"));
    let image = baked.first();
    for texel in baked.texels.iter().filter(|t| t.valid) {
        assert!((green(&image, texel) / PI - 1.0).abs() < 1e-5, "{texel:?}: {}", green(&image, texel));
    }
    assert!(baked.on("floor").len() > 500);
}

#[test]
fn a_room_closed_by_slivers_lets_no_light_in() {
    // The room's ceiling is a fan whose middle point lies 10⁻⁶ m from one edge: the sky finds no way past the
    // sliver.
    let (low, high) = (DVec3::ZERO, DVec3::ONE);
    let mut room = Obj::default().mesh("room").sides(low, high, true, &[0, 1, 2, 4, 5]);
    let corners = [dvec3(0.0, 1.0, 0.0), dvec3(1.0, 1.0, 0.0), dvec3(1.0, 1.0, 1.0), dvec3(0.0, 1.0, 1.0)];
    for i in 0..4 {
        room = room.polygon(&[corners[i], corners[(i + 1) % 4], dvec3(0.4, 1.0, 1e-6)]);
    }
    let room = room.mesh("outside").floor(dvec3(5.0, 0.0, 5.0), 1.0);
    let stage = Stage::new(&[("a.obj", room.text())]);
    let baked = stage.bake("12", 64, &format!("{SKY}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 64\n"));
    let image = baked.first();
    assert!(mean(&image, &baked.on("outside")) > 3.0);
    for texel in baked.covered("room") {
        assert!(!texel.valid || green(&image, texel) == 0.0, "{texel:?}: {}", green(&image, texel));
    }
}

#[test]
fn triangles_without_area_change_nothing() {
    // A needle, a point and a fold among the floor's triangles: said in the report, no texels, no light less.
    let p = dvec3(0.25, 0.5, 0.25);
    let flat = Obj::default()
        .mesh("floor")
        .floor(DVec3::ZERO, 2.0)
        .polygon(&[p, p + DVec3::X, p + DVec3::X * 0.5])
        .polygon(&[p, p, p + DVec3::Z])
        .polygon(&[p, p, p]);
    let stage = Stage::new(&[("a.obj", flat.text())]);
    let baked = stage.bake("12", 16, &format!("{SKY}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 16\n"));
    let image = baked.first();
    for texel in baked.on("floor") {
        assert!((green(&image, texel) / PI - 1.0).abs() < 1e-5);
    }
    let told = |f: &String| f.contains("1 triangle without area got no texels");
    assert!(baked.outcome.facts.iter().any(told), "{:?}", baked.outcome.facts);
    let told = |w: &String| w.contains("(2 triangles): faces with two corners at one point");
    assert!(baked.outcome.warnings.iter().any(told), "{:?}", baked.outcome.warnings);
}

#[test]
fn duplicate_and_overlapping_coplanar_triangles_do_not_shadow_each_other() {
    // The same square twice, and one turned by 30° in the same plane: all of them have the open sky.
    let turned = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let corner = |x: f64, z: f64| dvec3(x * cos - z * sin, 0.3, x * sin + z * cos);
        [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]
    };
    let squares = Obj::default().mesh("first").polygon(&turned(0.0)).mesh("second").polygon(&turned(0.0));
    let stage = Stage::new(&[("a.obj", squares.mesh("third").polygon(&turned(30.0)).text())]);
    let sun =
        "[sun]\ntrack = [{ hour = 12, direction = [2, 1, 0], irradiance = [10, 10, 10] }]\ndisc_angle = 0\n";
    let scene = format!("{SKY}{sun}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 64\n");
    let baked = stage.bake("12", 16, &scene);
    let image = baked.first();
    let expected = PI + 10.0 / 5.0f64.sqrt();
    for name in ["first", "second", "third"] {
        for texel in baked.on(name) {
            assert!(
                (green(&image, texel) / expected - 1.0).abs() < 1e-5,
                "{texel:?} {}",
                green(&image, texel)
            );
        }
    }
}

#[test]
fn coplanar_triangles_in_a_tilted_plane_do_not_shadow_each_other() {
    // No coordinate is exact here: rounding puts one square's points below the other by an ulp.
    let normal = dvec3(0.31, 0.83, -0.17).normalize();
    let (u, v) = normal.any_orthonormal_pair();
    let turned = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (a, b) = (u * cos + v * sin, v * cos - u * sin);
        let (a, b) = if a.cross(b).dot(normal) > 0.0 { (a, b) } else { (b, a) };
        let centre = dvec3(3.1, 1.7, -2.3);
        [centre - a - b, centre + a - b, centre + a + b, centre - a + b]
    };
    let squares = Obj::default().mesh("first").polygon(&turned(0.0)).mesh("second").polygon(&turned(37.0));
    let stage = Stage::new(&[("a.obj", squares.text())]);
    let sun = format!(
        "[sun]\ntrack = [{{ hour = 12, direction = [{}, {}, {}], irradiance = [10, 10, 10] }}]\ndisc_angle = 0\n",
        normal.x, normal.y, normal.z
    );
    let scene = format!("{sun}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 64\n");
    let baked = stage.bake("12", 64, &scene);
    let image = baked.first();
    for texel in baked.texels.iter().filter(|t| t.valid) {
        assert!((green(&image, texel) / 10.0 - 1.0).abs() < 1e-5, "{texel:?}: {}", green(&image, texel));
    }
    assert!(baked.on("first").len() + baked.on("second").len() > 1000);
}

#[test]
fn vertex_normals_against_the_winding_are_turned_round() {
    let quad = |normal: &str| {
        format!("o floor\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvn {normal}\nf 1//1 2//1 3//1 4//1\n")
    };
    let scene = format!("{SKY}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 16\n");
    let bake = |normal| Stage::new(&[("a.obj", quad(normal))]).bake("12", 16, &scene).first();
    assert!(bake("0 1 0") == bake("0 -1 0"));
    // One of length zero, and one within the plane.
    assert!(bake("0 1 0") == bake("0 0 0"));
    let along = bake("1 0 0");
    assert!(along.texels.iter().any(|t| t[1] > 3.0));
}

#[test]
fn a_block_wound_inside_out_shadows_and_stays_dark() {
    // Its fronts look inwards, where no light is; its backs block what comes from outside.
    let obj = Obj::default()
        .mesh("floor")
        .floor(DVec3::ZERO, 4.0)
        .mesh("block")
        .room(dvec3(-0.5, 0.5, -0.5), dvec3(0.5, 1.5, 0.5));
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let sun =
        "[sun]\ntrack = [{ hour = 12, direction = [0, 1, 0], irradiance = [10, 10, 10] }]\ndisc_angle = 0\n";
    let baked =
        stage.bake("12", 16, &format!("{SKY}{sun}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 64\n"));
    let image = baked.first();
    for texel in baked.on("floor") {
        let p = texel.centre().abs();
        let (far, size) = (p.x.max(p.z), texel.size());
        let light = green(&image, texel);
        if far < 0.5 - size {
            assert!(light < PI, "{texel:?}: {light} in the block's shadow");
        } else if far > 0.5 + size {
            assert!(light > 10.0 && light < 10.0 + PI + 1e-4, "{texel:?}: {light} in the sun");
        }
    }
    for texel in baked.covered("block") {
        assert!(!texel.valid || green(&image, texel) == 0.0, "{texel:?}: {}", green(&image, texel));
    }
}

#[test]
fn a_floor_of_a_hundred_kilometres_and_a_block_of_two_metres() {
    // 5·10⁴ to 1 in one scene: the floor has the open sky and the sun, as if the block were not there.
    let obj = Obj::default()
        .mesh("floor")
        .floor(DVec3::ZERO, 1e5)
        .mesh("block")
        .block(dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 2.0, 1.0));
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let scene = format!(
        "{SKY}[sun]\ntrack = [{{ hour = 12, direction = [0, 1, 0], irradiance = [10, 10, 10] }}]\ndisc_angle = 0\n\
         [[object]]\nfile = \"a.obj\"\n[[object.part]]\nname = \"block\"\ndensity = 20000\n[lightmap]\nsize = 128\n"
    );
    let baked = stage.bake("12", 64, &scene);
    let image = baked.first();
    let floor = baked.on("floor");
    assert!((mean(&image, &floor) / (10.0 + PI) - 1.0).abs() < 1e-5, "{}", mean(&image, &floor));
    // Its sides see half the sky, and the floor for the rest: albedo ½ of 10 + π, a little less beside the
    // block.
    let sides: Vec<_> = baked.on("block").into_iter().filter(|t| t.normal.y.abs() < 0.1).collect();
    let values: Vec<f64> = sides.iter().map(|t| green(&image, t)).collect();
    let open = PI / 2.0 + 0.25 * (10.0 + PI);
    let mean = Measured::of(&values).mean;
    assert!(mean < open && mean > 0.98 * open, "{mean} {open}");
}
