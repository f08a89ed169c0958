//! Error against run time where sampling is hard: the estimated error beside the true one. Run by hand; the
//! table stands in `NUMERICS.md`.

use crate::common::closed::ball;
use crate::common::mesh::Obj;
use crate::common::texels::Texel;
use crate::common::{INTEGRATORS, Stage, green};
use glam::{DVec3, dvec3};
use std::f64::consts::PI;

/// Bakes with more and more samples and prints, of the page's whole texels, valid or not: seconds of tracing,
/// estimated and true relative root mean square error, and the error of all light together.
fn rows(name: &str, stage: &Stage, scene: &str, samples: &[u32], expected: impl Fn(&Texel) -> f64) {
    for &n in samples {
        let baked = stage.bake("12", n, scene);
        let image = baked.first();
        let texels: Vec<_> = baked.texels.iter().filter(|t| t.whole).collect();
        let (mut light, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for texel in &texels {
            let (value, expected) = (green(&image, texel), expected(texel));
            light += expected;
            sum += value - expected;
            squares += (value - expected).powi(2);
        }
        let mean = light / texels.len() as f64;
        let last = baked.outcome.rounds.last().expect("a round");
        println!(
            "| {name}, {:?} | {n} | {:.2} | {:.2} % | {:.2} % | {:+.2} % |",
            baked.outcome.integrator,
            last.seconds,
            100.0 * last.frame_errors[0].unwrap_or(last.median_error),
            100.0 * (squares / texels.len() as f64).sqrt() / mean,
            100.0 * sum / light,
        );
    }
}

#[test]
#[ignore = "minutes: prints a table"]
fn error_against_time() {
    println!("| scene | samples | s | estimated | true | all light |\n|---|---|---|---|---|---|");
    keyhole();
    for integrator in INTEGRATORS {
        let (stage, scene) = crate::rooms::furnace(0.999, 0.001, crate::rooms::UNLIMITED);
        rows("albedo 0.999", &stage.by(integrator), &scene, &[16, 64, 256], |_| PI);
    }
    tiny_emitter();
    five_hundred_lamps();
}

/// A sky of radiance 1000 through a hole of 1 cm, onto the floor and walls of a black box.
fn keyhole() {
    let stage = Stage::new(&[("a.obj", crate::keyhole::box_with_hole(0.01).text())]);
    let expected = |t: &Texel| {
        t.average(|p| {
            let to = dvec3(0.0, 1.0, 0.0) - p;
            // L A cos cos ÷ d².
            1000.0 * 1e-4 * to.y * to.dot(t.normal).max(0.0) / to.length().powi(4)
        })
    };
    let object =
        "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n[[object.part]]\nname = \"ceiling\"\nlightmap = false\n";
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1000, 1000, 1000]\n";
    let end = "[lightmap]\nsize = 32\n";
    rows("keyhole", &stage, &format!("{sky}{object}{end}"), &[64, 1024, 16384], expected);
    let portal = "[[portal]]\ncorner = [-0.005, 1, -0.005]\nedge_u = [0.01, 0, 0]\nedge_v = [0, 0, 0.01]\n";
    rows("keyhole with a portal", &stage, &format!("{sky}{portal}{object}{end}"), &[16, 64, 256], expected);
}

/// A glowing square of 10⁻⁴ m, half a metre above a black floor.
fn tiny_emitter() {
    let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0);
    let glow = dvec3(0.0, 0.5, 0.0);
    let stage = Stage::new(&[("a.obj", obj.mesh("glow").ceiling(glow, 1e-4).text())]);
    let scene = "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n[[object.part]]\nname = \"glow\"\nlightmap = false\n\
                 emission = [1e8, 1e8, 1e8]\ngroup = \"lamp\"\n[[group]]\nname = \"lamp\"\n[lightmap]\nsize = 32\n";
    rows("emitter of 0.1 mm", &stage, scene, &[16, 64, 256], |t| {
        t.average(|p| {
            let to = glow - p;
            to.y * to.y / to.length().powi(4)
        })
    });
}

fn five_hundred_lamps() {
    let (lamps, groups) = crate::emitters::lamps();
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())]);
    let scene = format!("[[object]]\nfile = \"a.obj\"\nalbedo = 0\n{groups}[lightmap]\nsize = 16\n");
    rows("500 lamps", &stage, &scene, &[16, 64, 256, 1024], |t| {
        t.average(|p| lamps.iter().map(|&(c, l)| l * ball(c, 0.02, p, DVec3::Y)).sum())
    });
}
