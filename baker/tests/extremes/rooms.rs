//! Closed boxes: light that stays in, light that stays out, and the series that sums it.

use crate::common::closed::ball;
use crate::common::mesh::Obj;
use crate::common::{Baked, INTEGRATORS, Stage, green, mean};
use glam::{DVec3, dvec3};
use std::f64::consts::PI;

/// A box of side 1, of which only the floor has texels, all of it emitting.
pub fn furnace(albedo: f64, emission: f64, bounces: &str) -> (Stage, String) {
    let (low, high) = (DVec3::ZERO, DVec3::ONE);
    let room = Obj::default().mesh("floor").sides(low, high, true, &[2]);
    let room = room.mesh("walls").sides(low, high, true, &[0, 1, 3, 4, 5]);
    let scene = format!(
        "[[object]]\nfile = \"a.obj\"\nalbedo = {albedo}\nemission = [{emission}, {emission}, {emission}]\ngroup = \"all\"\n\
         [[object.part]]\nname = \"walls\"\nlightmap = false\n[[group]]\nname = \"all\"\n[lightmap]\nsize = 4\n\
         [bake]\nbounces = {bounces}\n"
    );
    (Stage::new(&[("a.obj", room.text())]), scene)
}

/// A number of bounces that ends paths by chance.
pub const UNLIMITED: &str = "\"unlimited\"";

fn floor(baked: &Baked) -> f64 {
    mean(&baked.first(), &baked.texels.iter().filter(|t| t.valid).collect::<Vec<_>>())
}

#[test]
fn black_walls_leave_the_lamps_own_light() {
    let lamp = dvec3(0.4, 0.6, 0.45);
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("room").room(DVec3::ZERO, DVec3::ONE).text())]);
    let scene = "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n[[group]]\nname = \"lamp\"\n[[group.sphere]]\n\
                 centre = [0.4, 0.6, 0.45]\nradius = 0.05\nradiance = [9, 9, 9]\n[lightmap]\nsize = 32\n";
    let read = |b: &Baked| {
        let expected = |p: DVec3, n: DVec3| 9.0 * ball(lamp, 0.05, p, n);
        b.ratio(&b.first(), &b.on("room"), |t| t.average(|p| expected(p, t.normal)))
    };
    stage.measure("12", 16, scene, read).expect(1.0, 2e-3);
}

#[test]
fn a_black_furnace_shows_its_emission_alone() {
    for integrator in INTEGRATORS {
        let (stage, scene) = furnace(0.0, 0.7, UNLIMITED);
        stage.by(integrator).measure("12", 64, &scene, floor).expect(0.7 * PI, 0.005);
    }
}

#[test]
fn albedo_0_999_reaches_its_series_bounce_by_bounce() {
    // E = π Le (1 − ρⁿ⁺¹)/(1 − ρ): what n bounces miss is ρⁿ⁺¹ of the whole, 99 % at 10 bounces, 90 % at 100,
    // 37 % at 1000.
    let series = |n: i32| PI * (1.0 - 0.999f64.powi(n + 1));
    for bounces in [0, 10, 100] {
        let (stage, scene) = furnace(0.999, 0.001, &bounces.to_string());
        stage.measure("12", 16, &scene, floor).expect(series(bounces), 0.02);
    }
}

#[test]
fn albedo_0_999_without_a_limit_reaches_the_closed_form() {
    // L = Le/(1 − ρ) is a thousand times the emission.
    for (integrator, precision) in INTEGRATORS.into_iter().zip([0.03, 0.15]) {
        let (stage, scene) = furnace(0.999, 0.001, UNLIMITED);
        stage.by(integrator).measure("12", 8, &scene, floor).expect(PI, precision);
    }
}

#[test]
fn a_closed_box_of_albedo_1_that_emits_is_refused() {
    // Energy enters and none leaves: no irradiance solves it.
    for integrator in INTEGRATORS {
        let (stage, scene) = furnace(1.0, 1.0, UNLIMITED);
        let message = stage.by(integrator).refusal("12", &scene);
        for word in ["albedo 1", ".obj: ", "set `albedo`", "albedo_max"] {
            assert!(message.contains(word), "{integrator:?}: {message}");
        }
    }
}

#[test]
fn albedo_1_with_a_limit_of_bounces_is_a_finite_sum() {
    // n + 1 terms of 1: a meaningful number, so it is not refused.
    let (stage, scene) = furnace(1.0, 0.1, "9");
    stage.measure("12", 16, &scene, floor).expect(PI, 0.02);
    // The cache, which holds all bounces, is of no use: the dataset says what was used.
    assert_eq!(stage.bake("12", 2, &scene).dataset.config.settings["baked_with"]["integrator"], "path");
}

#[test]
fn albedo_1_under_the_open_sky_is_no_error() {
    // A white floor in the open: light leaves after the first bounce.
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())]);
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\nalbedo = 1\n\
                 [lightmap]\nsize = 8\n";
    let baked = stage.bake("12", 16, scene);
    assert!((mean(&baked.first(), &baked.on("floor")) / PI - 1.0).abs() < 1e-5);
}

#[test]
fn light_without_end_in_a_small_closed_box_is_told_before_the_rounds() {
    // A white box of 2 cm around a lamp, beside a white floor of 400 m² in the open: of paths that start by
    // area none begins in the box.
    let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 20.0);
    let text = obj.mesh("pocket").room(dvec3(0.0, 1.0, 0.0), dvec3(0.02, 1.02, 0.02)).text();
    let stage = || Stage::new(&[("a.obj", text.clone())]);
    let scene = |limit: &str| {
        format!(
            "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\nalbedo = 1\n[[group]]\nname = \"lamp\"\n\
             [[group.sphere]]\ncentre = [0.01, 1.01, 0.01]\nradius = 0.001\nradiance = [1, 1, 1]\n[lightmap]\nsize = 64\n{limit}"
        )
    };
    for integrator in INTEGRATORS {
        let stage = stage().by(integrator);
        let message = stage.refusal("12", &scene(""));
        assert!(message.contains("light grows without end") && message.contains("pocket"), "{message}");
        assert!(!message.contains("floor"), "{message}");
        assert_eq!(std::fs::read_dir(stage.path("set-1/.bake")).expect("a folder").count(), 0, "{message}");
    }
    // With an end to the bounces there is none to the light.
    stage().bake("12", 2, &scene("[bake]\nbounces = 9\n"));
}

#[test]
fn a_dark_closed_box_that_absorbs_nothing_is_a_warning() {
    let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 10.0);
    let text = obj.mesh("cavity").room(dvec3(0.0, 1.0, 0.0), dvec3(1.0, 2.0, 1.0)).text();
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\nalbedo = 1\n[lightmap]\nsize = 32\n";
    for integrator in INTEGRATORS {
        let baked = Stage::new(&[("a.obj", text.clone())]).by(integrator).bake("12", 2, scene);
        let told = baked.outcome.warnings.iter().find(|warning| warning.contains("dark closed spaces"));
        let told = told.expect("a warning");
        assert!(told.contains("cavity") && !told.contains("floor"), "{told}");
        let on_the_floor = mean(&baked.first(), &baked.on("floor"));
        assert!((on_the_floor / PI - 1.0).abs() < 0.2, "{on_the_floor}");
    }
}

/// Two black closed boxes 20 m apart, with balls of radiance 10⁴ and 10⁻⁴ in their middles.
fn bright_and_dim(one_group: bool) -> (Stage, String) {
    let size = DVec3::splat(0.5);
    let room = |obj: Obj, name: &str, x: f64| {
        obj.mesh(name).room(dvec3(x, 0.0, 0.0) - size, dvec3(x, 0.0, 0.0) + size)
    };
    let obj = room(room(Obj::default(), "bright", -10.0), "dim", 10.0);
    let second = if one_group { "" } else { "[[group]]\nname = \"second\"\n" };
    let scene = format!(
        "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n[[group]]\nname = \"first\"\n[[group.sphere]]\ncentre = [-10, 0, 0]\n\
         radius = 0.05\nradiance = [1e4, 1e4, 1e4]\n{second}[[group.sphere]]\ncentre = [10, 0, 0]\nradius = 0.05\n\
         radiance = [1e-4, 1e-4, 1e-4]\n[lightmap]\nsize = 32\n"
    );
    (Stage::new(&[("a.obj", obj.text())]), scene)
}

fn expect_bright_and_dim(one_group: bool, precision: f64) {
    let (stage, scene) = bright_and_dim(one_group);
    for (name, x, radiance) in [("bright", -10.0, 1e4), ("dim", 10.0, 1e-4)] {
        let read = |b: &Baked| {
            let expected = |p: DVec3, n: DVec3| radiance * ball(dvec3(x, 0.0, 0.0), 0.05, p, n);
            // All texels of the box: one that saw no light and was marked invalid is light lost too.
            let texels: Vec<_> = b.covered(name).into_iter().filter(|t| t.whole).collect();
            b.ratio(&b.first(), &texels, |t| t.average(|p| expected(p, t.normal)))
        };
        stage.measure("12", 64, &scene, read).expect(1.0, precision);
    }
}

#[test]
fn a_hundred_million_to_one_in_two_groups() {
    expect_bright_and_dim(false, 0.02);
}

#[test]
fn a_hundred_million_to_one_in_one_group() {
    // The bright lamp, though hidden, is drawn 127 times in 128: no bias, much noise.
    expect_bright_and_dim(true, 0.4);
}

/// Two closed boxes, a lamp in each, in one group: the light of the dim one, a ten-thousandth of the other's,
/// bounces as often.
#[test]
fn a_dim_room_beside_a_bright_one_keeps_its_bounces() {
    let room = |x: f64| {
        Obj::default().mesh("room").room(dvec3(x - 1.0, -1.0, -1.0), dvec3(x + 1.0, 1.0, 1.0)).text()
    };
    let stage = || Stage::new(&[("a.obj", room(0.0)), ("b.obj", room(10.0))]);
    let lamp = |x: f64, radiance: f64| {
        format!(
            "[[group.sphere]]\ncentre = [{x}, 0, 0]\nradius = 0.1\nradiance = [{radiance}, {radiance}, {radiance}]\n"
        )
    };
    let scene = format!(
        "[[object]]\nfile = \"a.obj\"\nalbedo = [0.1, 0.1, 0.1]\n[[object]]\nfile = \"b.obj\"\nalbedo = [0.9, 0.9, 0.9]\n\
         [[group]]\nname = \"both\"\n{}{}[lightmap]\nsize = 64\n",
        lamp(0.0, 100.0),
        lamp(10.0, 0.01)
    );
    for integrator in INTEGRATORS {
        let baked = stage().by(integrator).bake("12", 64, &scene);
        let image = baked.first();
        // (The dim lamp is drawn once in 128 samples: noise of about a tenth in the mean.) Texels of the dim
        // room: power ÷ area ÷ (1 − ρ), on average 0.01 π · 4π 0.1² ÷ 24 ÷ 0.1.
        let dim: Vec<f64> =
            image.texels.iter().map(|t| f64::from(t[1])).filter(|&v| v > 0.0 && v < 0.05).collect();
        let mean = dim.iter().sum::<f64>() / dim.len() as f64;
        let closed_form = 0.01 * PI * 4.0 * PI * 0.01 / 24.0 / 0.1;
        assert!(
            dim.len() > 500 && (mean / closed_form - 1.0).abs() < 0.25,
            "{integrator:?}: {mean} {closed_form}"
        );
    }
}

#[test]
fn no_light_at_all_is_black_and_valid() {
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())]);
    let baked = stage.bake("0..24", 4, "[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 8\n");
    assert_eq!(baked.dataset.config.frames.len(), 24);
    assert!(baked.on("floor").len() >= 9);
    for hour in 0..24 {
        assert!(baked.at(f64::from(hour)).texels.iter().all(|t| *t == [0.0; 3]));
    }
}

#[test]
fn light_of_radiance_zero_is_no_light() {
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())]);
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [0, 0, 0]\n[sun]\n\
                 track = [{ hour = 0, direction = [0, 1, 0], irradiance = [0, 0, 0] }]\n[[object]]\nfile = \"a.obj\"\n\
                 [[group]]\nname = \"off\"\n[[group.sphere]]\ncentre = [0, 1, 0]\nradius = 0.1\nradiance = [0, 0, 0]\n\
                 [[group]]\nname = \"empty\"\n[lightmap]\nsize = 8\n";
    let baked = stage.bake("12", 4, scene);
    assert!(!baked.on("floor").is_empty());
    assert!(baked.first().texels.iter().all(|t| *t == [0.0; 3]));
}

#[test]
fn a_closed_room_under_a_sky_is_exactly_dark() {
    // Sun and sky outside, nothing inside; walls of 5 cm.
    let obj = Obj::default()
        .mesh("room")
        .room(dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 2.0, 1.0))
        .mesh("shell")
        .block(dvec3(-1.05, -0.05, -1.05), dvec3(1.05, 2.05, 1.05));
    let stage = || Stage::new(&[("a.obj", obj.clone().text())]);
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[sun]\ntrack = [{ hour = 0, direction = [1, 2, 0.5], \
                 irradiance = [100, 100, 100] }]\n[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 64\n";
    for integrator in INTEGRATORS {
        let baked = stage().by(integrator).bake("12", 64, scene);
        let image = baked.first();
        for texel in baked.covered("room") {
            assert!(green(&image, texel) == 0.0, "{texel:?}: {}", green(&image, texel));
        }
        assert!(mean(&image, &baked.on("shell")) > 1.0);
    }
}

#[test]
fn a_room_of_sheets_lets_less_than_a_hundred_thousandth_in() {
    // Walls without thickness: a path that meets one within rounding of an edge may start beyond the next.
    let obj = Obj::default()
        .mesh("room")
        .room(dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 2.0, 1.0))
        .mesh("outside")
        .floor(dvec3(10.0, 0.0, 0.0), 1.0);
    let stage = || Stage::new(&[("a.obj", obj.clone().text())]);
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\nalbedo = 0.8\n\
                 [lightmap]\nsize = 64\n";
    for integrator in INTEGRATORS {
        let baked = stage().by(integrator).bake("12", 256, scene);
        let image = baked.first();
        let room = baked.covered("room");
        assert!(room.len() > 500);
        assert!(mean(&image, &room) < 1e-5 * PI, "{}", mean(&image, &room));
    }
}

#[test]
fn roulette_at_a_thousandth_ends_one_path_in_a_thousand() {
    // What a room of albedo 0.999 holds rests on it: numbers of 0.999 and more, over dimensions and
    // sequences; 4 σ.
    use baker::trace::paths::{Sequence, SequenceKind};
    let (mut ends, mut all) = (0u32, 0u32);
    for index in 0..64 {
        let sequence = Sequence::new(1, SequenceKind::Texel, index, 0);
        for i in 0..128 {
            let sample = sequence.sample(i);
            for vertex in 2..502 {
                ends += u32::from(sample.number(4 * vertex + 4) >= 0.999);
                all += 1;
            }
        }
    }
    let expected = f64::from(all) * 1e-3;
    assert!(
        (f64::from(ends) - expected).abs() < 4.0 * expected.sqrt(),
        "{ends} of {all}, expected {expected}"
    );
}
