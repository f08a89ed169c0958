//! The sun at the horizon, and days without a rise or a set.

use crate::common::closed::disc_over_plane;
use crate::common::mesh::Obj;
use crate::common::{Baked, Stage, green, mean};
use baker::light::daylight::sun;
use dataset::format::Light;
use glam::{DVec3, dvec3};

/// A floor and, 100 m above it, a wall that looks towards +x.
fn floor_and_wall() -> Stage {
    let wall = Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).mesh("wall").quad(
        dvec3(0.0, 100.0, 0.5),
        DVec3::NEG_Z,
        DVec3::Y,
    );
    Stage::new(&[("a.obj", wall.text())])
}

/// A sun of irradiance 100 towards +x, at an elevation in degrees.
fn low_sun(elevation: f64, disc_angle: f64) -> String {
    let (sin, cos) = elevation.to_radians().sin_cos();
    format!(
        "[sun]\ndisc_angle = {disc_angle}\ntrack = [{{ hour = 12, direction = [{cos:?}, {sin:?}, 0], irradiance = \
         [100, 100, 100] }}]\n[[object]]\nfile = \"a.obj\"\nalbedo = 0\n[lightmap]\nsize = 16\n"
    )
}

#[test]
fn an_authored_sun_a_hundredth_of_a_degree_up_and_down() {
    for elevation in [0.01f64, -0.01] {
        let baked = floor_and_wall().bake("12", 16, &low_sun(elevation, 0.0));
        let image = baked.first();
        let (sin, cos) = elevation.to_radians().sin_cos();
        // An authored sun has no horizon: the wall has it from below too, the floor only from above.
        let wall = baked.on("wall");
        assert!((mean(&image, &wall) / (100.0 * cos) - 1.0).abs() < 1e-5);
        for texel in baked.covered("floor") {
            let light = green(&image, texel);
            if elevation > 0.0 {
                assert!(!texel.whole || (light / (100.0 * sin) - 1.0).abs() < 1e-4, "{texel:?}: {light}");
            } else {
                assert!(light == 0.0 || !texel.valid, "{texel:?}: {light}");
            }
        }
    }
}

#[test]
fn a_sun_that_straddles_the_plane_gives_the_part_above_it() {
    // A disc of 0.533° whose centre stands at, just above and just below the horizon of the floor.
    let delta = 0.533f64.to_radians() / 2.0;
    for elevation in [0.0, 0.01, -0.01, 0.2, -0.2] {
        let exact = 100.0 * disc_over_plane(f64::to_radians(elevation), delta);
        // At −0.2° a sliver of the disc is left: few points find it.
        let samples = if elevation < -0.1 { 256 } else { 64 };
        let read = |b: &Baked| {
            let image = b.first();
            let texels: Vec<_> = b.covered("floor").into_iter().filter(|t| t.whole).collect();
            mean(&image, &texels)
        };
        // Where a texel's first samples all miss the sliver, no more are drawn.
        let precision = if elevation < -0.1 { 0.15 } else { 0.02 };
        floor_and_wall().measure("12", samples, &low_sun(elevation, 0.533), read).expect(exact, precision);
    }
}

fn place(latitude: f64, date: &str) -> String {
    format!(
        "[place]\nlatitude = {latitude}\nlongitude = 15\nutc_offset = 1\ndate = {date}\n[sun]\n[sky]\n\
         model = \"hosek-wilkie\"\n[[object]]\nfile = \"a.obj\"\nalbedo = 0\n[lightmap]\nsize = 16\n"
    )
}

/// The elevation in degrees and the disc of a place's sun.
fn sun_at(stage: &Stage, scene: &str, hour: f64) -> Option<sun::SunDisc> {
    stage.write("place.toml", scene.as_bytes());
    let (scene, _) = baker::scene::load(&stage.path("place.toml")).unwrap();
    sun::at(scene.sun.as_ref().unwrap(), scene.location.as_ref(), hour)
}

#[test]
fn a_place_at_sunset_fades_without_a_jump() {
    let stage = floor_and_wall();
    let scene = place(48.0, "2026-03-20");
    // Where the centre stands at ±0.01°, by bisection (a disc below the horizon gives none: its last light is
    // at −0.27°).
    let elevation = |hour: f64| {
        sun_at(&stage, &scene, hour).map_or(-1.0, |disc| f64::from(disc.direction.y).asin().to_degrees())
    };
    let find = |target: f64| {
        let (mut low, mut high) = (17.0, 19.5);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if elevation(middle) > target { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    };
    let (above, below, last) = (find(0.01), find(-0.01), find(-0.26));
    let hours = format!("{above:.6},{below:.6},{last:.6},{:.6}", last + 0.1);
    let baked = stage.bake(&hours, 64, &scene);
    let sets = &baked.dataset.config.frames;
    assert_eq!(sets.len(), 4);
    let sun = |frame: usize| {
        let light = baked.dataset.light(Light::Sun, None, frame, 0).unwrap();
        mean(&light, &baked.on("floor"))
    };
    let light: Vec<f64> = (0..4).map(sun).collect();
    // The disc's part above the horizon: at ±0.01° about half of it, and nothing once all of it has set.
    assert!(
        light[0] > light[1] && light[1] > 0.5 * light[0] && light[2] < light[1] && light[3] == 0.0,
        "{light:?}"
    );
    let exact = |hour: f64| {
        let disc = sun_at(&stage, &scene, hour).unwrap();
        let (delta, elevation) = (f64::from(disc.half_angle), f64::from(disc.direction.y).asin());
        // `irradiance` is that of the visible part: over its share of the disc.
        let share = visible_share(elevation, delta);
        f64::from(disc.irradiance.y) / share * disc_over_plane(elevation, delta)
    };
    for (set, hour) in [(0, above), (1, below)] {
        let expected = exact((hour * 1e6).round() / 1e6);
        assert!((light[set] / expected - 1.0).abs() < 0.03, "{} at {hour}, expected {expected}", light[set]);
    }
}

/// The part of a small disc above the horizon.
fn visible_share(elevation: f64, delta: f64) -> f64 {
    let x = (elevation / delta).clamp(-1.0, 1.0);
    (std::f64::consts::FRAC_PI_2 + x.asin() + x * (1.0 - x * x).sqrt()) / std::f64::consts::PI
}

#[test]
fn polar_night_has_no_sun_and_a_finite_sky() {
    for latitude in [80.0, 90.0, -90.0] {
        let date = if latitude > 0.0 { "2026-12-21" } else { "2026-06-21" };
        let baked = floor_and_wall().bake("0..24", 4, &place(latitude, date));
        assert_eq!(baked.dataset.config.frames.len(), 24);
        for (i, frame) in baked.dataset.config.frames.iter().enumerate() {
            let files = baked.dataset.config.files_of(Light::Sun, None, i, 0);
            assert!(files.is_empty(), "{latitude}°: a sun at {}", frame.hour);
        }
        let told = |f: &String| f.contains("no sun rays at 24 of 24 times");
        assert!(baked.outcome.skipped.iter().any(told), "{:?}", baked.outcome.skipped);
        // Deep twilight or night, never a daylit sky, never darker than the night's floor.
        let light = mean(&baked.at(12.0), &baked.on("floor"));
        assert!(light > 0.0 && light < 0.1, "{latitude}°: {light}");
    }
}

#[test]
fn midnight_sun_shines_at_every_hour() {
    for (latitude, date) in [(80.0, "2026-06-21"), (90.0, "2026-06-21"), (-90.0, "2026-12-21")] {
        let baked = floor_and_wall().bake("0..24", 4, &place(latitude, date));
        for (i, set) in baked.dataset.config.frames.iter().enumerate() {
            let files = baked.dataset.config.files_of(Light::Sun, None, i, 0);
            assert!(!files.is_empty(), "{latitude}°: no sun at {}", set.hour);
            let light = mean(&baked.dataset.map(i, 0).unwrap(), &baked.on("floor"));
            assert!(light > 5.0 && light < 150.0, "{latitude}° at {}: {light}", set.hour);
        }
    }
}

#[test]
fn a_sun_below_everything_leaves_texels_that_other_light_reaches() {
    // Straight down: only what looks down has it.
    let obj =
        Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).mesh("ceiling").ceiling(DVec3::Y * 3.0, 1.0);
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let scene = "[sun]\ndisc_angle = 0\ntrack = [{ hour = 0, direction = [0.0, -1, 0.5], irradiance = [8, 8, 8] }]\n\
                 [[object]]\nfile = \"a.obj\"\nalbedo = 0\n[lightmap]\nsize = 32\n";
    let baked = stage.bake("12", 16, scene);
    let image = baked.first();
    let expected = 8.0 / 1.25f64.sqrt();
    assert!(baked.on("ceiling").iter().all(|t| green(&image, t) <= expected * 1.0001));
    assert!(baked.covered("floor").iter().all(|t| !t.valid));
}
