//! Light through a hole of 1 cm into a closed black box: all that passes the hole must land inside.

use crate::common::mesh::Obj;
use crate::common::{Baked, Stage, green};
use baker::bake::run::Integrator;
use glam::{DVec3, dvec3};
use std::f64::consts::PI;

/// A black box of side 1 m around (0, ½, 0) whose ceiling has a square hole of side `hole` in its middle;
/// both faces of its walls block. Only the floor, or every wall, has texels.
pub fn box_with_hole(hole: f64) -> Obj {
    let (low, high) = (dvec3(-0.5, 0.0, -0.5), dvec3(0.5, 1.0, 0.5));
    let mut obj = Obj::default().mesh("floor").sides(low, high, true, &[2]);
    obj = obj.mesh("walls").sides(low, high, true, &[0, 1, 4, 5]).mesh("ceiling");
    let h = hole / 2.0;
    // Four strips around the hole; the room sees their front, the sky their back, which blocks as well.
    let strip = |obj: Obj, x0: f64, x1: f64, z0: f64, z1: f64| {
        obj.quad(dvec3(x0, 1.0, z0), dvec3(x1 - x0, 0.0, 0.0), dvec3(0.0, 0.0, z1 - z0))
    };
    obj = strip(obj, -0.5, -h, -0.5, 0.5);
    obj = strip(obj, h, 0.5, -0.5, 0.5);
    obj = strip(obj, -h, h, -0.5, -h);
    strip(obj, -h, h, h, 0.5)
}

fn scene(light: &str, without_texels: &[&str], size: u32) -> String {
    let parts: Vec<String> = without_texels
        .iter()
        .map(|name| format!("[[object.part]]\nname = \"{name}\"\nlightmap = false\n"))
        .collect();
    // The sun and the sky stand before the object, a group after it.
    let (before, after) = light.split_once("---").unwrap_or((light, ""));
    format!(
        "{before}\n[[object]]\nfile = \"a.obj\"\nalbedo = 0\n{}{after}\n[lightmap]\nsize = {size}\n",
        parts.concat()
    )
}

/// What all texels of some surfaces receive together: irradiance × area.
fn received(baked: &Baked, name: &str) -> f64 {
    let image = baked.first();
    baked.covered(name).iter().map(|t| green(&image, t) * t.area()).sum()
}

#[test]
fn the_suns_beam_arrives_whole() {
    // The sun straight above: E times the hole's area lands on the floor, in a spot of 1 cm.
    let sun = "[sun]\ndisc_angle = 0\ntrack = [{ hour = 12, direction = [0, 1, 0], irradiance = [100, 100, 100] }]\n";
    let stage = Stage::new(&[("a.obj", box_with_hole(0.01).text())]);
    let scene = scene(sun, &["walls", "ceiling"], 32);
    stage.measure("12", 256, &scene, |b| received(b, "floor")).expect(100.0 * 1e-4, 0.25);
    // Nothing lands elsewhere: the spot is 1 cm, its texels and their neighbours hold it all.
    let baked = stage.bake("12", 256, &scene);
    let image = baked.first();
    for texel in baked.covered("floor") {
        let away = texel.centre().abs();
        if away.x.max(away.z) > 0.005 + texel.size() {
            assert_eq!(green(&image, texel), 0.0, "{texel:?}");
        }
    }
}

#[test]
fn a_lamps_beam_arrives_whole() {
    // A ball of radius 5 cm, 1 m above the hole: E at the hole, 2·π (0.05)², times its area.
    let lamp = "---[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0, 2, 0]\nradius = 0.05\nradiance = [2, 2, 2]\n";
    let stage = Stage::new(&[("a.obj", box_with_hole(0.01).text())]);
    let through = 2.0 * PI * 0.05f64.powi(2) * 1e-4;
    let scene = scene(lamp, &["walls", "ceiling"], 32);
    stage.measure("12", 256, &scene, |b| received(b, "floor")).expect(through, 0.25);
}

#[test]
fn the_skys_light_through_a_keyhole_is_met_by_chance_but_not_lost() {
    // π L times the hole's area, spread over all five sides below it. Paths meet the hole once in 60,000: the
    // estimate's own error says so (10 % here), and it has no bias.
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1000, 1000, 1000]\n";
    let stage = Stage::new(&[("a.obj", box_with_hole(0.01).text())]);
    let scene = scene(sky, &["ceiling"], 64);
    let read = |b: &Baked| received(b, "floor") + received(b, "walls");
    stage.measure("12", 64, &scene, read).expect(PI * 1000.0 * 1e-4, 0.25);
}

#[test]
fn light_that_few_paths_find_is_not_lost_towards_a_target() {
    // A hole of 3 cm: most cells of 256 texels have met none of it after the first round. Were each to end by
    // what it met itself, most of the light would be missing.
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1000, 1000, 1000]\n";
    let scene = scene(sky, &["ceiling"], 64);
    let stage = || Stage::new(&[("a.obj", box_with_hole(0.03).text())]).by(Integrator::Path);
    let read = |b: &Baked| received(b, "floor") + received(b, "walls");
    let [fixed, towards] = [stage(), stage().towards(0.2)].map(|s| s.measure("12", 256, &scene, read));
    towards.agree(fixed, 0.08);
}

#[test]
fn what_a_dim_room_gets_is_not_lost_towards_a_target_beside_a_lit_one() {
    // A hole of 5 cm, of which the first round meets some ten paths, beside a closed box of the same size
    // that a lamp fills with ten times the light: what is known of that must not end the cells of the other.
    let (low, high) = (dvec3(4.5, 0.0, -0.5), dvec3(5.5, 1.0, 0.5));
    let obj = box_with_hole(0.05).mesh("lit").sides(low, high, true, &[0, 1, 2, 3, 4, 5]).text();
    let light = "[sky]\nmodel = \"constant\"\nradiance = [360, 360, 360]\n---\n[[group]]\nname = \"lamp\"\n\
                 [[group.sphere]]\ncentre = [5, 0.5, 0]\nradius = 0.1\nradiance = [80, 80, 80]\n";
    let scene = scene(light, &["ceiling"], 64);
    let stage = || Stage::new(&[("a.obj", obj.clone())]).by(Integrator::Path);
    let dim = |b: &Baked| received(b, "floor") + received(b, "walls");
    let baked = stage().bake("12", 256, &scene);
    let ratio = received(&baked, "lit") / dim(&baked);
    assert!((5.0..20.0).contains(&ratio), "{ratio}");
    let [fixed, towards] = [stage(), stage().towards(0.2)].map(|s| s.measure("12", 256, &scene, dim));
    towards.agree(fixed, 0.08);
}

#[test]
fn the_skys_light_through_a_window_is_not_lost() {
    // The same with a hole of 20 cm.
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
    let stage = Stage::new(&[("a.obj", box_with_hole(0.2).text())]);
    let read = |b: &Baked| received(b, "floor") + received(b, "walls");
    let exact = PI * 0.04;
    let measured = stage.measure("12", 64, &scene(sky, &["ceiling"], 64), read);
    // Texels at the charts' borders hold a little more or less surface than their centres say.
    assert!(
        (measured.mean / exact - 1.0).abs() < 0.02 + 3.59 * measured.sigma / exact,
        "{measured:?} {exact}"
    );
}

#[test]
fn light_that_no_sample_found_is_not_called_exact() {
    // A hole of 0.1 mm: four paths a texel do not meet it.
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1000, 1000, 1000]\n";
    let stage = Stage::new(&[("a.obj", box_with_hole(1e-4).text())]);
    let outcome = stage.bake("12", 4, &scene(sky, &["ceiling"], 64)).outcome;
    assert_eq!(outcome.relative_error, 1.0);
    assert_eq!(outcome.rounds.last().map(|round| round.worst_error), Some(1.0));
    let told = "no light was found at 12:00, though something shines then";
    assert!(outcome.facts.iter().any(|fact| fact.starts_with(told)), "{:?}", outcome.facts);
}

#[test]
fn no_hole_no_light() {
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1000, 1000, 1000]\n[sun]\ndisc_angle = 0\n\
               track = [{ hour = 12, direction = [0, 1, 0], irradiance = [100, 100, 100] }]\n";
    let obj = box_with_hole(0.0).mesh("open").floor(DVec3::X * 5.0, 0.5);
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let baked = stage.bake("12", 64, &scene(sky, &[], 32));
    assert!(received(&baked, "floor") == 0.0 && received(&baked, "open") > 20.0);
}
