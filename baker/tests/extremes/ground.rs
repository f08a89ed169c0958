//! The ground below the horizon: what it reflects onto surfaces that look down on nothing, in closed form.

use crate::common::mesh::Obj;
use crate::common::texels::Texel;
use crate::common::{Baked, Stage, THREE_SIGMA};
use baker::bake::run::Denoise;
use baker::light::daylight::{sky, sun};
use glam::{DVec3, Vec3, dvec3};
use std::f64::consts::{PI, TAU};

/// The sky is tabulated in cells and the ground's light summed over 128 rings, beside the 1024 of [`open`]:
/// what these may differ by, relative to the light.
const GRIDS: f64 = 2e-3;

/// A sheet of 2 m that looks down over nothing, 1 m up, and one that looks up, 5 m beside it.
fn stage() -> Stage {
    let sheets = Obj::default().mesh("down").ceiling(dvec3(0.0, 1.0, 0.0), 2.0);
    let sheets = sheets.mesh("up").floor(dvec3(5.0, 2.0, 0.0), 2.0);
    Stage::new(&[("sheets.obj", sheets.text())])
}

/// The scene of the sheets at the equinox; `sun` stands before `[sky]`, `ground` in it, `object` in the
/// object.
fn scene(sun: &str, ground: &str, object: &str) -> String {
    format!(
        "[place]\nlatitude = 48\nlongitude = 15\nutc_offset = 1\ndate = 2026-03-21\n{sun}\
         [sky]\nmodel = \"hosek-wilkie\"\n{ground}\n\
         [[object]]\nfile = \"sheets.obj\"\nalbedo = 0\n{object}\n[lightmap]\nsize = 24\n"
    )
}

/// Irradiance of a level plane in the open at an hour, without the sun.
fn open(stage: &Stage, scene: &str, hour: f64) -> DVec3 {
    stage.write("open.toml", scene.as_bytes());
    let (scene, _) = baker::scene::load(&stage.path("open.toml")).unwrap();
    let sky = scene.sky.as_ref().unwrap();
    const RINGS: usize = 1024;
    let directions: Vec<Vec3> = (0..RINGS * RINGS)
        .map(|i| {
            let (y, phi) =
                (((i / RINGS) as f64 + 0.5) / RINGS as f64, TAU * ((i % RINGS) as f64 + 0.5) / RINGS as f64);
            let r = (1.0 - y * y).sqrt();
            dvec3(r * phi.cos(), y, r * phi.sin()).as_vec3()
        })
        .collect();
    let radiances = sky::radiances(sky, scene.location.as_ref(), hour, &directions);
    let sum: DVec3 = radiances.iter().zip(&directions).map(|(l, d)| l.as_dvec3() * f64::from(d.y)).sum();
    sum * TAU / (RINGS * RINGS) as f64
}

/// The mean light of a sheet; nothing where no texel got any.
fn light(baked: &Baked, sheet: &str, hour: f64) -> DVec3 {
    let map = baked.at(hour);
    let of = |t: &Texel| if t.valid { Vec3::from_array(map.texels[t.index]).as_dvec3() } else { DVec3::ZERO };
    let texels: Vec<DVec3> = baked.covered(sheet).into_iter().filter(|t| t.whole).map(of).collect();
    assert!(!texels.is_empty());
    texels.iter().sum::<DVec3>() / texels.len() as f64
}

#[track_caller]
fn expect(found: DVec3, expected: DVec3, what: &str) {
    let off = (found - expected).abs().max_element();
    assert!(
        found.is_finite() && off <= GRIDS * expected.max_element(),
        "{what}: {found}, expected {expected}"
    );
}

#[test]
fn a_ceiling_over_nothing_has_the_albedo_of_what_the_open_ground_has() {
    let stage = stage();
    // The ground's radiance is albedo · E / π, and what looks straight down on it has π times that.
    let dark = scene("", "ground = false", "");
    let expected = open(&stage, &dark, 12.0);
    for (ground, albedo) in [
        ("ground = 1", DVec3::ONE),
        ("ground = [1, 0.5, 0]", dvec3(1.0, 0.5, 0.0)),
        ("", DVec3::splat(0.2)),
        ("ground = 0", DVec3::ZERO),
        ("ground = false", DVec3::ZERO),
    ] {
        let baked = stage.bake("12", 4, &scene("", ground, ""));
        expect(light(&baked, "down", 12.0), albedo * expected, ground);
    }
    // The sky's own `ground_albedo` is the ground's, too.
    let grassy = scene("", "ground_albedo = 0.6", "");
    let baked = stage.bake("12", 4, &grassy);
    expect(light(&baked, "down", 12.0), 0.6 * open(&stage, &grassy, 12.0), "ground_albedo");
}

#[test]
fn a_wall_sees_half_of_the_ground() {
    let wall = Obj::default().mesh("wall").quad(DVec3::ZERO, DVec3::X, DVec3::Y).text();
    let stage = Stage::new(&[("sheets.obj", wall)]);
    let sky = open(&stage, &scene("", "", ""), 12.0);
    let of = |ground: &str| stage.measure("12", 64, &scene("", ground, ""), |b| light(b, "wall", 12.0).y);
    let (with, without) = (of("ground = 1"), of("ground = false"));
    let sigma = with.sigma.hypot(without.sigma) / (sky.y / 2.0);
    let ratio = (with.mean - without.mean) / (sky.y / 2.0);
    assert!(sigma < 5e-3 && (ratio - 1.0).abs() < GRIDS + THREE_SIGMA * sigma, "{ratio} ± {sigma}");
}

#[test]
fn a_floor_below_hides_the_ground() {
    // A black floor of 2 m, 1 m below a ceiling as large.
    let sheets = Obj::default().mesh("down").ceiling(dvec3(0.0, 1.0, 0.0), 2.0);
    let sheets = sheets.mesh("floor").floor(DVec3::ZERO, 2.0).text();
    let stage = Stage::new(&[("sheets.obj", sheets)]);
    let scene = scene("", "ground = 1", "");
    let sky = open(&stage, &scene, 12.0);
    let hidden = |p: DVec3| {
        // ∫ cos² / (π d²) over the floor.
        const N: usize = 40;
        let cell = 2.0 / N as f64;
        let at = |i: usize| (i as f64 + 0.5) * cell - 1.0;
        let cells = (0..N * N).map(|i| (p - dvec3(at(i % N), 0.0, at(i / N))).length_squared());
        cells.map(|d2| p.y * p.y / (PI * d2 * d2)).sum::<f64>() * cell * cell
    };
    let read = |b: &Baked| b.ratio(&b.first(), &b.on("down"), |t| sky.y * (1.0 - t.average(hidden)));
    let found = stage.measure("12", 64, &scene, read);
    assert!(found.sigma < 5e-3 && (found.mean - 1.0).abs() < GRIDS + THREE_SIGMA * found.sigma, "{found:?}");
    // Denoised it is as right, to 2 %: at the edges of so small a sheet filters even out a little.
    let denoised = stage.measure_with("12", 64, &scene, Denoise::Own, read);
    assert!((denoised.mean - 1.0).abs() < 0.02, "{denoised:?}");
}

#[test]
fn a_ground_lies_as_far_below_a_scene_that_stands_a_million_metres_off() {
    let stage = stage();
    let bake = |object: &str| {
        let baked = stage.bake("12", 4, &scene("[sun]\n", "ground = 1", object));
        light(&baked, "down", 12.0)
    };
    let near = bake("");
    for far in ["translate = [1e6, 0, -1e6]", "translate = [0, -1e6, 0]", "translate = [0, 1e6, 0]"] {
        let off = bake(far);
        assert!(near.min_element() > 1.0 && off.distance(near) < 1e-5 * near.length(), "{far}: {off} {near}");
    }
}

#[test]
fn from_day_through_dusk_to_night_it_has_what_the_hour_has() {
    let stage = stage();
    let dark = scene("[sun]\n", "ground = false", "");
    stage.write("dusk.toml", dark.as_bytes());
    let (place, _) = baker::scene::load(&stage.path("dusk.toml")).unwrap();
    let sun = |hour: f64| sun::at(place.sun.as_ref().unwrap(), place.location.as_ref(), hour);
    // The minute at which the disc is on the horizon: some of its light arrives, and hardly any of that on a
    // level plane.
    let dusk = (1000..1200).map(|minute| f64::from(minute) / 60.0);
    let dusk = dusk.rev().find(|&hour| sun(hour).is_some()).unwrap();
    assert!(dusk > 17.0 && dusk < 19.0 && sun(dusk).unwrap().direction.y < 0.01);
    let hours = [0.0, 9.0, dusk, 19.0, 23.0];
    let list = hours.map(|hour| hour.to_string()).join(",");
    let baked = stage.bake(&list, 16, &scene("[sun]\n", "ground = 0.5", ""));
    for hour in hours {
        let level = sun(hour).map_or(DVec3::ZERO, |disc| {
            // The mean height of what of the disc is above the horizon.
            const SIDE: usize = 64;
            let at = |i: usize| (i as f32 + 0.5) / SIDE as f32;
            let points = (0..SIDE * SIDE).map(|i| disc.sample(glam::vec2(at(i % SIDE), at(i / SIDE))).y);
            let height = points.map(|y| f64::from(y.max(0.0))).sum::<f64>() / (SIDE * SIDE) as f64;
            disc.irradiance.as_dvec3() * height
        });
        let expected = 0.5 * (open(&stage, &dark, hour) + level);
        expect(light(&baked, "down", hour), expected, &format!("{hour}"));
        assert!(expected.min_element() > 0.0, "the night sky has a floor");
    }
}

#[test]
fn a_sun_on_the_horizon_or_below_gives_the_ground_nothing() {
    let stage = stage();
    let with = |direction: &str, ground: &str| {
        let track = format!(
            "[sun]\ndisc_angle = 0\ntrack = [{{ hour = 0, direction = {direction}, irradiance = [8, 8, 8] }}]\n"
        );
        light(&stage.bake("12", 4, &scene(&track, ground, "")), "down", 12.0)
    };
    let without = light(&stage.bake("12", 4, &scene("", "ground = 1", "")), "down", 12.0);
    expect(with("[1, 0, 0]", "ground = 1"), without, "on the horizon");
    // From below it shines on the ceiling itself, at 60° to its normal, whether or not there is a ground.
    let below = "[0.8660254, -0.5, 0]";
    expect(with(below, "ground = false"), DVec3::splat(4.0), "below");
    expect(with(below, "ground = 1"), without + 4.0, "below, with a ground");
}

#[test]
fn skies_that_show_something_there_have_no_ground() {
    let stage = stage();
    let constant = "[sky]\nmodel = \"constant\"\nradiance = [1, 2, 3]\n\
                    [[object]]\nfile = \"sheets.obj\"\nalbedo = 0\n[lightmap]\nsize = 24\n";
    let baked = stage.bake("12", 4, constant);
    expect(light(&baked, "down", 12.0), dvec3(1.0, 2.0, 3.0) * PI, "constant");
}
