//! The integrators and the backends against each other, texel by texel, over seeds; and the error they tell
//! against the error they have.

#[path = "shining.rs"]
mod shining;

use crate::scenes::{
    Case, coarse_corner, corner, furnace, glazed_room, house, instances, low_walls, outdoors, room, shed,
    slabs_on_a_floor, sunlit_floor, sunlit_room, wires,
};
use crate::statistics::{Bakes, bakes};
use baker::bake::run::{Integrator, Options, prepare};
use baker::light::times::schedule::parse_hours;
use baker::trace::rays::Backend;
use dataset::observe::Silent;
use std::f64::consts::PI;

/// Samples of the reference.
const REFERENCE: u32 = 64;

/// Bounds of (mean squared standard error told) ÷ (variance over seeds). Sixteen seeds, and a variance that
/// stands in few texels (shadow edges), leave some 10 % of chance; stitching, which the estimate does not
/// know of, evens out a little more.
pub const HONEST: std::ops::Range<f64> = 0.8..1.25;

fn path(case: &Case, first: u64, samples: u32) -> Bakes {
    bakes(case, first, samples, |o| o.integrator = Integrator::Path)
}

/// Bound of what the cache's texels are wrong by.
const OF_TEXELS: f64 = 0.02;

#[track_caller]
fn golden(case: &Case, name: &str) -> Bakes {
    golden_within(case, name, OF_TEXELS)
}

#[track_caller]
fn golden_within(case: &Case, name: &str, bound: f64) -> Bakes {
    let [_, cached] = golden_pair(case, name, bound);
    cached
}

/// Tests a case by both integrators and all backends; `bound` is what the cache's texels may be wrong by.
/// Gives the bakes by paths and by the cache.
#[track_caller]
fn golden_pair(case: &Case, name: &str, bound: f64) -> [Bakes; 2] {
    let reference = path(case, 1, REFERENCE);
    let precision = reference.relative_error_of_mean();
    assert!(precision < 0.005, "{name}: the reference is no test: {precision}");
    // Fewer samples have more variance and the same mean.
    let few = path(case, 101, REFERENCE / 4);
    few.expect_texels_of(&reference, name);
    few.expect_mean_of(&reference, name);
    // The cache is wrong by the size of its texels: by less than 1 % of the page's light.
    let cached = bakes(case, 301, REFERENCE / 4, |_| {});
    // The other backends that are built: the same light, with the same bias of the cache.
    for backend in Backend::built().filter(|b| *b != Backend::default()) {
        for (integrator, ours) in [(Integrator::Path, &reference), (Integrator::Cached, &cached)] {
            let theirs =
                bakes(case, 201, REFERENCE / 4, |o| (o.integrator, o.backend) = (integrator, backend));
            let what = format!("{name}, {integrator:?}, {backend}");
            theirs.expect_texels_of(ours, &what);
            theirs.expect_mean_of(ours, &what);
        }
    }
    let bias = cached.mean() / reference.mean() - 1.0;
    let of_texels = cached.bias_of_texels(&reference);
    println!("{name}: bias of the cache {:.3} %, of its texels {:.3} %", bias * 100.0, of_texels * 100.0);
    assert!(bias.abs() < 0.01, "{name}: the cache is wrong by {bias}");
    assert!(of_texels < bound, "{name}: the cache's texels are wrong by {of_texels}");
    for (bakes, what) in [(&reference, "reference"), (&few, "few samples"), (&cached, "cached")] {
        expect_honest(bakes, &format!("{name}, {what}"));
    }
    [reference, cached]
}

/// The error that bakes tell is the one they have.
#[track_caller]
fn expect_honest(bakes: &Bakes, what: &str) {
    let told = bakes.honesty();
    println!("{what}: told ÷ true variance {told:.3}");
    assert!(HONEST.contains(&told), "{what}: told ÷ true variance {told}");
}

#[test]
fn outdoors_with_sun_and_sky() {
    golden(&outdoors(), "outdoors");
}

#[test]
fn a_room_with_window_and_lamp() {
    golden(&room(), "room");
}

#[test]
fn a_room_with_a_patch_of_sun() {
    let cached = golden(&sunlit_room(), "sunlit room");
    // What the patch reflects is looked for there.
    assert!(cached.outcomes.iter().all(|outcome| outcome.rays.bright_surface > 1000));
}

#[test]
fn a_patch_of_sun_in_a_house_whose_outside_is_in_the_sun() {
    let cached = golden(&house(), "house");
    assert!(cached.outcomes.iter().all(|outcome| outcome.rays.bright_surface > 1000));
}

#[test]
fn a_portal_in_the_scene_file_tells_of_its_room_as_a_found_one_does() {
    let case = house();
    let prepared = |text: &str| {
        case.stage.write("case.toml", text.as_bytes());
        let options = Options::new(parse_hours(case.hours).unwrap());
        prepare(&case.stage.path("case.toml"), &options, &Silent).unwrap().scene
    };
    let found = prepared(&case.text);
    let [portal] = &found.portals[..] else { panic!("{:?}", found.portals) };
    let [corner, u, v] = [portal.corner, portal.edge_u, portal.edge_v].map(|p| p.to_array());
    let text = format!("[[portal]]\ncorner = {corner:?}\nedge_u = {u:?}\nedge_v = {v:?}\n{}", case.text);
    let written = prepared(&text);
    assert!(written.portals[0].room.is_none());
    let ([a], [b]) = (&found.rooms[..], &written.rooms[..]) else {
        panic!("{:?}, {:?}", found.rooms, written.rooms)
    };
    // Found ones are rounded to centimetres.
    assert!((0..2).all(|corner| (a[corner] - b[corner]).abs().max_element() < 0.02), "{a:?}, {b:?}");
}

#[test]
fn a_room_behind_tinted_glass() {
    golden(&glazed_room(), "glazed room");
}

#[test]
fn a_sunlit_floor_without_texels_settles() {
    let case = sunlit_floor();
    let text = format!("{}[bake]\nseed = 1\nsamples = 16\n", case.text);
    let (outcome, _) = case.stage.bake(&text, "floor", case.hours, |_| {});
    // Where few patches exchange light with many texels, one factor for all swings between too much and too
    // little; had the cache not settled all the same, paths would have been followed to their end.
    assert_eq!(outcome.integrator, Integrator::Cached, "{:?}", outcome.facts);
}

#[test]
fn shadows_of_wires_are_told_honestly() {
    // Most texels they cross show them in one sample of eight, and to few samples not at all.
    expect_honest(&path(&wires(), 1, REFERENCE), "wires");
}

#[test]
fn the_feet_of_walls_are_lit_or_shaded_whatever_the_seed() {
    // The side a texel keeps is no matter of chance, so the difference between seeds is noise and is told.
    expect_honest(&path(&low_walls(), 1, REFERENCE), "low walls");
}

#[test]
fn a_lamp_in_a_corner() {
    // Most of what a texel there gets by reflection comes from texels beside it, whose mean is not what it
    // sees. (Of texels this near to the lamp the error hangs on where they lie: 2.0 to 2.5 % for 11.6 to 12.5
    // texels per metre.)
    golden_within(&corner(), "corner", 0.03);
}

#[test]
fn a_lamp_in_a_corner_of_coarse_walls() {
    // What is near is told by the entries that a path meets there: with those of the floor's texels for a
    // measure, the walls' would be read where they tell least (8 and 14 %).
    golden_within(&coarse_corner("lightmap = false", 24), "walls without texels", 0.04);
    golden_within(&coarse_corner("density = 0.25", 32), "walls of large texels", 0.07);
}

#[test]
fn what_lies_under_a_slab_does_not_darken_a_floor_without_texels() {
    same_mean(&slabs_on_a_floor(), "slabs", REFERENCE);
}

#[test]
fn a_floor_without_texels_in_an_open_shed_is_as_bright_as_it_is() {
    same_mean(&shed(), "shed", 4 * REFERENCE);
}

/// The cache gives the mean light that paths do; its texels may differ.
#[track_caller]
fn same_mean(case: &Case, name: &str, samples: u32) {
    let (reference, cached) = (path(case, 1, samples), bakes(case, 301, 4 * samples, |_| {}));
    for (bakes, what) in [(&reference, "reference"), (&cached, "cached")] {
        let error = bakes.relative_error_of_mean();
        assert!(error < 0.03, "{name}, {what}: {error}");
    }
    cached.expect_mean_of(&reference, name);
}

#[test]
fn instances_and_cut_outs() {
    golden(&instances(), "instances");
}

#[test]
fn where_all_texels_are_alike_the_cache_has_no_bias() {
    let case = furnace();
    for backend in Backend::built() {
        let by = |integrator, first| {
            bakes(&case, first, 16, |o| (o.integrator, o.backend) = (integrator, backend))
        };
        let (path, cached) = (by(Integrator::Path, 1), by(Integrator::Cached, 301));
        for (bakes, what) in [(&path, "path"), (&cached, "cached")] {
            bakes.expect_everywhere(PI, &format!("{what}, {backend}"));
        }
        cached.expect_texels_of(&path, &format!("cached, {backend}"));
        cached.expect_mean_of(&path, &format!("cached, {backend}"));
    }
}
