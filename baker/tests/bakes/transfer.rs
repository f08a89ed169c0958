//! Transfer: what a plane has of each function in closed form, and daylight put together from its functions
//! beside the bake of it.

use crate::scenes::{Obj, outdoors};
use crate::{Stage, assert_same};
use baker::bake::run::{Options, prepare};
use baker::light::daylight::harmonics::harmonics;
use baker::light::times::schedule::{Hours, parse_hours};
use dataset::format::Transfer;
use dataset::image::Image;
use dataset::observe::Silent;
use dataset::store::Dataset;
use glam::Vec3;
use std::f64::consts::{PI, TAU};
use std::path::Path;

const SAMPLES: &str = "[bake]\nseed = 1\nsamples = 64\n";

fn bake_transfer(stage: &Stage, text: &str) -> (Dataset, Transfer) {
    let (outcome, dataset) =
        stage.bake(&format!("{text}{SAMPLES}"), "transfer", "0..24", |o| o.transfer = true);
    assert_eq!(outcome.scene, "case-transfer");
    let transfer = dataset.config.transfer.clone().expect("a transfer");
    assert_eq!(transfer.scene, "case");
    assert!(dataset.verify(|| ()).faults.is_empty());
    (dataset, transfer)
}

/// Per function, per valid texel: the light under it.
fn functions(dataset: &Dataset, transfer: &Transfer) -> Vec<Vec<Vec3>> {
    let mask = dataset.mask(0).expect("a mask");
    let mut sums = vec![vec![Vec3::ZERO; mask.count()]; transfer.light[0].coefficients.len()];
    for (set, part) in transfer.parts.iter().enumerate() {
        let sign = if part.negative { -1.0 } else { 1.0 };
        let sum = &mut sums[part.function as usize];
        sum.iter_mut().zip(valid(dataset, set)).for_each(|(sum, light)| *sum += sign * light);
    }
    sums
}

fn valid(dataset: &Dataset, set: usize) -> Vec<Vec3> {
    let (mask, image) = (dataset.mask(0).expect("a mask"), dataset.map(set, 0).expect("a map"));
    image
        .texels
        .iter()
        .zip(&mask.valid)
        .filter(|(_, valid)| **valid)
        .map(|(rgb, _)| Vec3::from_array(*rgb))
        .collect()
}

/// Σ c T at an hour.
fn together(functions: &[Vec<Vec3>], transfer: &Transfer, hour: f64) -> Vec<Vec3> {
    let light = transfer.light.iter().find(|light| light.hour == hour).expect("the hour");
    let mut sums = vec![Vec3::ZERO; functions[0].len()];
    for (function, c) in functions.iter().zip(&light.coefficients) {
        let c = Vec3::from_array(c.map(|c| c as f32));
        sums.iter_mut().zip(function).for_each(|(sum, light)| *sum += c * *light);
    }
    sums
}

/// RMS of the difference ÷ RMS of the second.
fn relative(a: &[Vec3], b: &[Vec3]) -> f64 {
    let difference: f64 = a.iter().zip(b).map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
    (difference / b.iter().map(|b| f64::from(b.length_squared())).sum::<f64>()).sqrt()
}

const CONSTANT: &str = "[sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n";

/// A black plane with this normal.
fn plane(normal: Vec3) -> (Stage, String) {
    let (u, v) = normal.any_orthonormal_pair();
    let (u, v) = if u.cross(v).dot(normal) > 0.0 { (u, v) } else { (v, u) };
    let quad =
        Obj::default().mesh("plane").quad([0.0; 3], u.to_array().map(f64::from), v.to_array().map(f64::from));
    let text =
        format!("{CONSTANT}[[object]]\nfile = \"a.obj\"\nalbedo = 0\n[lightmap]\nsize = 40\npadding = 2\n");
    (Stage::new(&[("a.obj", quad.bytes())]), text)
}

#[test]
fn a_plane_under_a_constant_sky_has_pi_times_its_radiance() {
    let (stage, text) = plane(Vec3::Y);
    let (dataset, transfer) = bake_transfer(&stage, &text);
    assert_eq!((transfer.light.len(), transfer.parts.len()), (24, 31));
    let light = together(&functions(&dataset, &transfer), &transfer, 12.0);
    let mean = light.iter().sum::<Vec3>() / light.len() as f32;
    let expected = Vec3::new(3.0, 4.0, 5.0) * PI as f32;
    // The paths' directions go with the cosine: a constant sky has no noise.
    assert!((mean - expected).length() < 1e-3 * expected.length(), "{mean}");
    // It goes with the day's bake by the same settings, and with no other.
    let inputs = |hours: &str, samples: u32| {
        let bake = |o: &mut baker::bake::run::Options| o.samples = Some(samples);
        stage.bake(&format!("{text}{SAMPLES}"), &format!("set-{samples}"), hours, bake).1.config.inputs
    };
    assert_eq!(inputs("0..24", 64), transfer.inputs);
    assert_ne!(inputs("0..24", 16), transfer.inputs);
}

/// Funk and Hecke: what a plane of normal n that nothing hides has of function Y of band l is A Y(n), with
/// A = π, 2π/3, π/4 and 0.
#[test]
fn each_band_is_faded_as_the_cosine_has_it() {
    let normal = Vec3::new(0.48, 0.6, 0.64);
    let (stage, text) = plane(normal);
    let (dataset, transfer) = bake_transfer(&stage, &text);
    for (i, (texels, y)) in functions(&dataset, &transfer).iter().zip(harmonics(normal)).enumerate() {
        let band = i.isqrt();
        let expected = [PI, TAU / 3.0, PI / 4.0, 0.0][band] * f64::from(y);
        let n = texels.len() as f64;
        let mean = texels.iter().map(|t| f64::from(t.x)).sum::<f64>() / n;
        let variance = texels.iter().map(|t| (f64::from(t.x) - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let error = (variance / n).sqrt();
        assert!(error < 2e-3, "{i}: {error}");
        assert!((mean - expected).abs() < 4.0 * error + 1e-4, "{i}: {mean} ± {error}, expected {expected}");
    }
}

/// A picture of the sky that is a sum of the functions, lat-long; no direction is below 0.
fn smooth_picture(path: &Path) {
    let (width, height) = (128, 64);
    let b = [9.0, 1.0, 1.5, -0.8, 0.6, -0.5, 0.7, 0.4, -0.6, 0.3, 0.2, -0.4, 0.3, 0.5, -0.2, 0.3];
    let texel = |i: usize| {
        // The middle column looks along −Z, columns run clockwise seen from above.
        let azimuth = ((i % width) as f64 + 0.5) / width as f64 * TAU - PI;
        let (sin, cos) = (((i / width) as f64 + 0.5) / height as f64 * PI).sin_cos();
        let d = Vec3::new((sin * azimuth.sin()) as f32, cos as f32, (-sin * azimuth.cos()) as f32);
        let light: f32 = harmonics(d).iter().zip(b).map(|(y, b)| y * b).sum();
        assert!(light > 0.0, "{d}");
        [light, 0.9 * light, 0.5 * light]
    };
    let image = Image { width, height, texels: (0..width * height).map(texel).collect() };
    std::fs::write(path, image.to_exr()).expect("written");
}

#[test]
fn a_smooth_sky_is_the_sum_of_its_functions_with_shadows_and_bounces() {
    let case = outdoors();
    smooth_picture(&case.stage.path("sky.exr"));
    let [_, objects] = case.text.split("[[object]]").collect::<Vec<_>>()[..] else { panic!("one object") };
    let text = format!("[sky]\nmodel = \"image\"\nfile = \"sky.exr\"\n[[object]]{objects}");
    let (dataset, transfer) = bake_transfer(&case.stage, &text);
    let (_, daylight) = case.stage.bake(&format!("{text}{SAMPLES}"), "set", "12", |_| {});
    let light = together(&functions(&dataset, &transfer), &transfer, 12.0);
    let error = relative(&light, &valid(&daylight, 0));
    println!("picture: {error:.4}");
    assert!(error < SMOOTH, "{error}");
}

/// The noise of two bakes of 64 samples.
const SMOOTH: f64 = 0.03;

/// The model's sky is no such sum: around the sun it is brighter than the functions can be.
#[test]
fn a_clear_sky_without_its_sun_is_met_nearly() {
    let case = outdoors();
    let text = case.text.replace("[sun]\n", "");
    let (dataset, transfer) = bake_transfer(&case.stage, &text);
    assert_eq!(transfer.parts.len(), 30);
    let (_, daylight) = case.stage.bake(&format!("{text}{SAMPLES}"), "set", case.hours, |_| {});
    let functions = functions(&dataset, &transfer);
    for (set, hour) in [8.0, 12.0].into_iter().enumerate() {
        let error = relative(&together(&functions, &transfer, hour), &valid(&daylight, set));
        println!("clear sky at {hour}: {error:.4}");
        assert!(error < SMOOTH, "{hour}: {error}");
    }
}

#[test]
fn another_sun_is_another_transfer_of_the_same_layers() {
    let case = outdoors();
    let (first, _) = bake_transfer(&case.stage, &case.text);
    let text = case.text.replace("2026-06-21", "2026-03-21");
    let again =
        |text: &str| case.stage.bake(&format!("{text}{SAMPLES}"), "transfer", "0..24", |o| o.transfer = true);
    assert!(again(&case.text).0.up_to_date);
    let (outcome, second) = again(&text);
    assert_eq!((outcome.up_to_date, outcome.layers.traced, outcome.layers.reused), (false, 0, 30));
    let light = |dataset: &Dataset| dataset.config.transfer.clone().expect("a transfer").light;
    assert!(light(&first) != light(&second));
    // The day of a bake with lamps has the times beside their switches.
    let lamp = "[[group]]\nname = \"lamp\"\non = [[\"18:00\", \"06:00\"]]\n[[group.sphere]]\ncentre = [1, 1, 1]\nradius = 0.1\n\
        radiance = [1, 1, 1]\n[lightmap]";
    let (outcome, third) = again(&text.replace("[lightmap]", lamp));
    assert_eq!(outcome.layers.traced, 0);
    let hours: Vec<f64> = light(&third).iter().map(|light| light.hour).collect();
    assert!([5.9, 18.1].iter().all(|hour| hours.contains(hour)));
    // And the extra times, those of the day's bake.
    let day = Options::new(Hours::day());
    let day = prepare(&case.stage.path("case.toml"), &day, &Silent).expect("a plan").plan;
    assert!(!day.extra_times.added.is_empty());
    assert_eq!(hours, day.times.iter().map(|time| time.hour).collect::<Vec<_>>());
    assert!(third.config.groups.is_empty());
    // The lamp put aside, it is the same light, byte for byte.
    let (_, fourth) = again(&text);
    let back = case.stage.bake(&format!("{text}{SAMPLES}"), "fresh", "0..24", |o| o.transfer = true).1;
    assert_same(&fourth, &back);
}

#[test]
fn surfaces_that_shine_do_so_for_lamps_alone_and_a_scene_of_lamps_has_no_transfer() {
    let (stage, text) = plane(Vec3::Y);
    let shine = "albedo = 0\nemission = [9, 9, 9]\ngroup = \"panel\"\n[[group]]\nname = \"panel\"\n";
    let shining = text.replace("albedo = 0\n", shine);
    let (dark, _) = bake_transfer(&stage, &text);
    let dark: Vec<Vec<Vec3>> = (0..31).map(|set| valid(&dark, set)).collect();
    let (lit, _) = bake_transfer(&stage, &shining);
    assert!((0..31).all(|set| valid(&lit, set) == dark[set]));
    stage.write("case.toml", shining.replace(CONSTANT, "").as_bytes());
    let options = baker::bake::run::Options {
        transfer: true,
        out: Some(stage.path("none")),
        ..baker::bake::run::Options::new(baker::light::times::schedule::parse_hours("0..24").expect("hours"))
    };
    let error = baker::bake::run::bake(&stage.path("case.toml"), &options, &dataset::observe::Silent);
    let error = error.expect_err("refused").to_string();
    assert!(error.contains("case.toml: has neither sun nor sky"), "{error}");
}

#[test]
fn a_ground_that_is_there_by_default_is_left_out_and_told() {
    let case = outdoors();
    let bake = |ground: &str| {
        let text = case.text.replace("\"hosek-wilkie\"\n", &format!("\"hosek-wilkie\"\n{ground}"));
        let text = format!("{text}[bake]\nseed = 1\nsamples = 2\n");
        case.stage.bake(&text, "transfer", "12", |o| (o.transfer, o.force) = (true, true))
    };
    let told = |warnings: &[String]| warnings.iter().filter(|w| w.contains("leaves out the ground")).count();
    let (by_default, dataset) = bake("");
    assert_eq!(told(&by_default.warnings), 1, "{:?}", by_default.warnings);
    let light = dataset.map(0, 0).expect("a map");
    let (without, dataset) = bake("ground = false\n");
    assert_eq!(told(&without.warnings), 0, "{:?}", without.warnings);
    assert!(light == dataset.map(0, 0).expect("a map"), "the same light");
    // One that is written is refused.
    let mut options = Options { transfer: true, ..Options::new(parse_hours("12").expect("hours")) };
    options.out = Some(case.stage.path("refused"));
    let text = case.text.replace("\"hosek-wilkie\"\n", "\"hosek-wilkie\"\nground = 0.2\n");
    case.stage.write("written.toml", text.as_bytes());
    let error = baker::bake::run::bake(&case.stage.path("written.toml"), &options, &Silent);
    let error = error.expect_err("a ground is not known").to_string();
    assert!(error.contains("expected `ground = false`"), "{error}");
}
