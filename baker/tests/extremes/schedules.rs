//! Lamps on hours that are hard to meet.

use crate::common::mesh::Obj;
use crate::common::{Baked, Stage, mean};
use glam::DVec3;
use std::fmt::Write;

fn floor() -> Stage {
    Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())])
}

/// A floor with one lamp per schedule, the lamp of group `g<i>` a little brighter than that of the one
/// before.
fn scene(schedules: &[String]) -> String {
    let mut text = "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n".to_owned();
    for (i, on) in schedules.iter().enumerate() {
        let radiance = 1.0 + i as f64;
        write!(
            text,
            "[[group]]\nname = \"g{i}\"\non = {on}\n[[group.sphere]]\ncentre = [0, 1, 0]\nradius = 0.1\n\
             radiance = [{radiance}, {radiance}, {radiance}]\n"
        )
        .unwrap();
    }
    text + "[lightmap]\nsize = 8\n"
}

/// Bakes the day with these schedules. Every set's light must be the sum of the layers of the groups that
/// `lit` says are on.
fn bake_day(schedules: &[&str], lit: impl Fn(usize, f64) -> bool) -> Baked {
    let schedules: Vec<String> = schedules.iter().map(|s| (*s).to_owned()).collect();
    let baked = floor().bake("0..24", 4, &scene(&schedules));
    check(&baked, lit);
    baked
}

fn check(baked: &Baked, lit: impl Fn(usize, f64) -> bool) {
    let texels = baked.on("floor");
    let groups = &baked.dataset.config.groups;
    let layers: Vec<f64> = groups.iter().map(|g| mean(&baked.group(&g.name), &texels)).collect();
    for (i, set) in baked.dataset.config.frames.iter().enumerate() {
        let expected: Vec<bool> = (0..groups.len()).map(|g| lit(g, set.hour)).collect();
        assert_eq!(set.groups_on, expected, "at {}", set.hour);
        let sum: f64 = layers.iter().zip(&expected).filter(|(_, on)| **on).map(|(l, _)| l).sum();
        let light = mean(&baked.dataset.map(i, 0).unwrap(), &texels);
        assert!((light - sum).abs() <= 1e-5 * sum, "at {}: {light}, groups {sum}", set.hour);
    }
}

/// Hours of the extras: sets besides the 24 full hours.
fn extras(baked: &Baked) -> Vec<f64> {
    let hours = baked.dataset.config.frames.iter().map(|s| s.hour);
    hours.filter(|h| h.fract() != 0.0).collect()
}

#[test]
fn always_on_has_no_extras() {
    let baked = bake_day(&["\"always\"", "[[0, 24]]", "[[\"06:00\", \"18:00\"], [18, 6]]"], |_, _| true);
    assert_eq!(extras(&baked), [] as [f64; 0]);
    assert!(baked.dataset.config.frames.iter().all(|s| s.relative_error.is_some_and(|e| e < 0.5)));
}

#[test]
fn never_on_is_refused_or_dark() {
    // An empty schedule says nothing: name, line and value.
    let stage = floor();
    let message = stage.refusal("12", &scene(&["[]".to_owned()]));
    assert!(message.contains("case.toml:6: on = []: expected at least one interval"), "{message}");
    let message = stage.refusal("12", &scene(&["[[7, 7]]".to_owned()]));
    assert!(message.contains("case.toml:6") && message.contains("two different hours"), "{message}");
    // A group that is off at every time baked is not traced, and its light is none.
    let baked = stage.bake("12", 4, &scene(&["[[13, 14]]".to_owned()]));
    assert!(baked.first().texels.iter().all(|t| *t == [0.0; 3]));
    let told = |f: &String| f.contains("\"g0\"") && f.contains("off at every time");
    assert!(baked.outcome.skipped.iter().any(told), "{:?}", baked.outcome.skipped);
}

#[test]
fn on_for_one_second() {
    // One set inside the second, half a second from both ends, and one on each side.
    let second = 1.0 / 3600.0;
    let within = |hour: f64| hour > 15.5 && hour < 15.5 + second;
    let baked = bake_day(&["[[\"15:30:00\", \"15:30:01\"]]"], |_, hour| within(hour));
    let extras = extras(&baked);
    assert_eq!(extras.len(), 3, "{extras:?}");
    assert!(extras[0] < 15.5 && within(extras[1]) && extras[2] > 15.5 + second, "{extras:?}");
    assert!(extras[2] - extras[0] < 0.3);
}

#[test]
fn a_switch_exactly_on_an_hour() {
    // The set of the hour itself shows the side on which the group is off; the other side gets an extra.
    let baked = bake_day(&["[[8, 20]]"], |_, hour| hour > 8.0 && hour < 20.0);
    assert_eq!(extras(&baked), [8.1, 19.9]);
}

#[test]
fn midnight_is_one_instant_whatever_it_is_called() {
    // 24:00 is 0:00: on until midnight, on from midnight, and across it.
    let lit = |group: usize, hour: f64| match group {
        0 => hour > 22.0,
        1 => hour > 0.0 && hour < 2.0,
        _ => !(2.0..=22.0).contains(&hour),
    };
    let schedules = ["[[\"22:00\", \"24:00\"]]", "[[\"00:00\", 2]]", "[[22, 2]]"];
    let baked = bake_day(&schedules, lit);
    // Midnight itself shows groups 0 and 1 off; both sides of it lack one of them.
    assert_eq!(extras(&baked), [0.1, 1.9, 22.1, 23.9]);
    // And joined they are always on: no switch at midnight.
    let joined = bake_day(&["[[0, 12], [12, 24]]", "[[12, \"24:00\"], [\"00:00\", 12]]"], |_, _| true);
    assert_eq!(extras(&joined), [] as [f64; 0]);
}

#[test]
fn two_switches_within_a_minute() {
    // Off at 21:00:10, another on at 21:00:40: between them a set with both off, and one on each outer side.
    let (off, on) = (21.0 + 10.0 / 3600.0, 21.0 + 40.0 / 3600.0);
    let lit = |group: usize, hour: f64| {
        if group == 0 { hour > 19.5 && hour < off } else { hour > on && hour < 23.5 }
    };
    let baked = bake_day(&["[[19.5, \"21:00:10\"]]", "[[\"21:00:40\", 23.5]]"], lit);
    let sets = &baked.dataset.config.frames;
    let near: Vec<_> = sets.iter().filter(|s| s.hour > 20.8 && s.hour < 21.2).collect();
    let shown = |g: [bool; 2]| near.iter().any(|s| s.groups_on == g);
    assert!(shown([true, false]) && shown([false, false]) && shown([false, true]), "{near:?}");
    // Two groups that switch at the same instant share their extras.
    let both = bake_day(&["[[8.5, 9.5]]", "[[9.5, 10.5]]"], |g, hour| {
        let from = 8.5 + g as f64;
        hour > from && hour < from + 1.0
    });
    assert_eq!(extras(&both), [8.4, 8.6, 9.4, 9.6, 10.4, 10.6]);
}

#[test]
fn two_hundred_schedules() {
    // Each group on for a stretch of its own, three minutes further along the day than the one before.
    let from = |g: usize| (g as f64 * 0.05 + 0.025) % 24.0;
    let to = |g: usize| (from(g) + 7.0) % 24.0;
    let schedules: Vec<String> = (0..200).map(|g| format!("[[{:.6}, {:.6}]]", from(g), to(g))).collect();
    let stage = floor();
    let baked = stage.bake("0..24", 2, &scene(&schedules));
    assert_eq!(baked.dataset.config.groups.len(), 200);
    assert!(baked.dataset.config.frames.len() > 200);
    check(&baked, |g, hour| {
        let (from, to) = (from(g), to(g));
        if from < to { hour > from && hour < to } else { hour > from || hour < to }
    });
}
