//! What a scene does not need costs nothing: rays by kind, and time, of five scenes.

use crate::common::mesh::Obj;
use crate::common::{Baked, INTEGRATORS, Stage};
use baker::bake::forecast::{LayoutEstimate, forecast};
use baker::bake::run::{Denoise, Integrator, Options, prepare};
use baker::light::times::schedule::parse_hours;
use baker::trace::counts::RayCounts;
use dataset::observe::Silent;
use glam::{DVec3, dvec3};

const PLACE: &str = "[place]\nlatitude = 48\nlongitude = 11\ndate = \"2026-03-21\"\nutc_offset = 1\n";
const SUN_AND_SKY: &str = "[sun]\n[sky]\nmodel = \"hosek-wilkie\"\nturbidity = 3\n";
const OBJECT: &str = "[[object]]\nfile = \"a.obj\"\n";
const LAMP: &str = "[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0.3, 1.5, 0.2]\nradius = 0.05\n\
                    radiance = [100, 100, 100]\n";

/// A floor with a block on it.
fn yard(integrator: Integrator) -> Stage {
    let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 6.0);
    let obj = obj.mesh("block").block(dvec3(-2.0, 0.0, -2.0), dvec3(-1.0, 2.0, -1.0));
    Stage::new(&[("a.obj", obj.text())]).by(integrator)
}

fn closed_room(integrator: Integrator) -> Stage {
    let obj = Obj::default().mesh("room").room(dvec3(-2.0, 0.0, -2.0), dvec3(2.0, 2.5, 2.0));
    Stage::new(&[("a.obj", obj.text())]).by(integrator)
}

/// Bakes and prints a row of the table in `NUMERICS.md`.
fn row(name: &str, stage: &Stage, hours: &str, scene: &str) -> (Baked, RayCounts) {
    let baked = stage.bake(hours, 16, &format!("{scene}[lightmap]\nsize = 64\n"));
    let rays = baked.outcome.rays;
    println!(
        "| {name}, {:?} | {} | {} | {} | {} | {} | {} | {:.2} |",
        baked.outcome.integrator,
        baked.outcome.texels,
        rays.path,
        rays.sun,
        rays.lamp,
        rays.sky,
        rays.inside,
        baked.outcome.seconds
    );
    (baked, rays)
}

#[test]
fn only_what_a_scene_holds_is_traced() {
    for integrator in INTEGRATORS {
        let yard = yard(integrator);
        let (_, night) = row("night", &yard, "0..4", &format!("{PLACE}{SUN_AND_SKY}{OBJECT}{LAMP}"));
        assert!(night.sun == 0 && night.lamp > 0, "{night:?}");

        let track = "[sun]\ntrack = [{ hour = 12, direction = [1, 2, 0.5], irradiance = [10, 10, 10] }]\n";
        let (_, sun) = row("sun only", &yard, "10..14", &format!("{track}{OBJECT}"));
        assert!(sun.lamp == 0 && sun.sky == 0 && sun.sun > 0, "{sun:?}");

        let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
        let scene = format!("{sky}{track}{OBJECT}{LAMP}");
        let (baked, room) = row("closed room", &closed_room(integrator), "12", &scene);
        // An even sky is met by paths alone. The sun is looked for by four trial samples and four of each
        // half.
        assert!(room.sky == 0 && room.lamp > 0, "{room:?}");
        if integrator == Integrator::Cached {
            let patches = room.path / 4;
            assert!(room.sun <= 12 * baked.outcome.texels as u64 + patches, "{room:?}");
        }

        let (_, no_lamps) = row("no lamps", &yard, "0..24", &format!("{PLACE}{SUN_AND_SKY}{OBJECT}"));
        assert!(no_lamps.lamp == 0 && no_lamps.sun > 0, "{no_lamps:?}");

        let (_, all) = row("everything", &yard, "0..24", &format!("{PLACE}{SUN_AND_SKY}{OBJECT}{LAMP}"));
        assert!(all.lamp > 0 && all.sun > 0, "{all:?}");
        // All light shares its paths; where they go depends on it, and so, by a little, how many they are.
        assert!((all.path as f64 / no_lamps.path as f64 - 1.0).abs() < 0.02, "{all:?}");
        // A group that is never lit is as none.
        let off = LAMP.replace("name = \"lamp\"\n", "name = \"lamp\"\non = [[\"20:00\", \"21:00\"]]\n");
        let (_, off) = row("lamp off", &yard, "10..14", &format!("{track}{OBJECT}{off}"));
        assert!(off.lamp == 0, "{off:?}");
        for counts in [night, sun, room, no_lamps, all] {
            assert_eq!(counts.endless, 0);
            assert!(integrator == Integrator::Cached || counts.cached == 0, "{counts:?}");
        }
    }
}

#[test]
fn without_light_only_points_are_traced() {
    for integrator in INTEGRATORS {
        let (_, none) = row("no light", &yard(integrator), "0..24", OBJECT);
        assert!(none.path + none.sun + none.lamp + none.sky == 0, "{none:?}");
    }
}

#[test]
fn a_plan_tells_what_the_bake_will_take_and_whether_the_scene_is_open() {
    for (stage, is_open) in [(yard(Integrator::Path), true), (closed_room(Integrator::Path), false)] {
        let scene = format!("{PLACE}{SUN_AND_SKY}{OBJECT}{LAMP}[lightmap]\nsize = 64\n");
        let baked = stage.bake("6,12,22", 4, &scene);
        let options = Options {
            integrator: Integrator::Path,
            denoise: Denoise::Off,
            ..Options::new(parse_hours("6,12,22").expect("hours"))
        };
        let prepared = prepare(&stage.path("case.toml"), &options, &Silent).expect("what was baked");
        let (atlas, looking) = prepared.atlas().expect("an atlas");
        let forecast = forecast(&prepared, &LayoutEstimate::exact(atlas, looking)).expect("a forecast");
        assert_eq!((forecast.size, forecast.pages), (baked.outcome.size, baked.outcome.pages));
        assert_eq!(forecast.escaping_rays.map(|n| n > 0), Some(is_open), "{forecast:?}");
        let bytes = |folder: &str, extension: &str| -> u64 {
            let files = std::fs::read_dir(stage.path("set-1").join(folder)).expect("a folder").flatten();
            let files = files.filter(|f| f.path().extension().is_some_and(|e| e == extension));
            files.map(|f| f.metadata().expect("metadata").len()).sum()
        };
        // (As traced: which layers have noise to be filtered is not known before.)
        let kept: u64 = ["layer", "direct", "texels"].iter().map(|kind| bytes(".layers", kind)).sum();
        assert_eq!(forecast.layers_bytes, kept, "{forecast:?}");
        // Headers of small files are not counted.
        let images = bytes("data", "exr");
        assert!(images > 0 && images <= forecast.dataset_bytes + (1 << 16), "{images} {forecast:?}");
    }
}
