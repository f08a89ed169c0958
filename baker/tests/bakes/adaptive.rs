//! Bakes towards a target error: the rule that hands out samples must not show in the light.

use crate::golden::HONEST;
use crate::scenes::{Case, outdoors, room};
use crate::statistics::bakes;
use baker::bake::run::{Denoise, Integrator, Options, prepare};
use baker::light::times::schedule::parse_hours;
use dataset::observe::Silent;

const TARGET: f64 = 0.06;

#[track_caller]
fn adaptive(case: &Case, name: &str) {
    let reference = bakes(case, 1, 64, |o| o.integrator = Integrator::Path);
    let adaptive = bakes(case, 401, 64, |o| {
        o.integrator = Integrator::Path;
        o.target_error = Some(TARGET);
    });
    adaptive.expect_texels_of(&reference, name);
    adaptive.expect_mean_of(&reference, name);
    // Samples went where they were wanted, and the target is met at 95 % of the texels. (What is kept of
    // errors is rounded.)
    for outcome in &adaptive.outcomes {
        let last = outcome.rounds.last().expect("a round");
        assert!(!last.is_missed, "{name}: {} cells", last.unconverged_cells);
        for local in [last.local, outcome.local.all].map(|local| local.expect("light")) {
            assert!(local.p95 <= 1.02 * TARGET, "{name}: {local:?}");
        }
        assert!(!outcome.out_of_time);
    }
    let spread = |o: &&baker::bake::run::Outcome| o.mean_samples < f64::from(o.samples);
    assert!(adaptive.outcomes.iter().any(|o| spread(&o)), "{name}: every cell got all samples");
    // Who stops at low estimates tells too low an error.
    let told = adaptive.honesty();
    println!("{name}: told ÷ true variance {told:.3}, samples {}", adaptive.outcomes[0].mean_samples);
    assert!(HONEST.contains(&told), "{name}: told ÷ true variance {told}");
}

#[test]
fn outdoors_towards_a_target() {
    adaptive(&outdoors(), "outdoors");
}

#[test]
fn a_room_towards_a_target() {
    adaptive(&room(), "room");
}

/// It is met by the light that is stored, with fewer samples, and by its true error.
#[test]
fn a_target_is_judged_by_denoised_light() {
    const FINE: f64 = 0.02;
    let case = room();
    let towards =
        |denoise: Denoise| bakes(&case, 501, 1024, |o| (o.target_error, o.denoise) = (Some(FINE), denoise));
    let reference = bakes(&case, 1, 64, |_| {});
    let (traced, denoised) = (towards(Denoise::Off), towards(Denoise::Own));
    for outcome in &denoised.outcomes {
        let last = outcome.rounds.last().expect("a round");
        assert!(!last.is_missed && last.denoised.is_some(), "{last:?}");
        let local = outcome.local.all.expect("light");
        assert!(local.p95 <= 1.02 * FINE, "{local:?}");
        // What the last round's filters made is counted, and kept.
        assert!(outcome.denoised.as_ref().is_some_and(|d| d.new_layers == d.layers));
    }
    let samples = [&traced, &denoised].map(|bakes| bakes.outcomes[0].mean_samples);
    let ratio = denoised.reported_squared_error() / denoised.squared_error(&reference);
    println!("samples {samples:?}, estimated ÷ true squared error {ratio:.3}");
    assert!(samples[1] < 0.7 * samples[0], "{samples:?}");
    assert!(HONEST.contains(&ratio), "estimated ÷ true squared error {ratio}");
}

/// A round knows by which light it missed its target: no other light may go on with it.
#[test]
fn work_towards_a_target_is_told_apart_by_the_light_that_is_judged() {
    let case = room();
    case.stage.write("case.toml", case.text.as_bytes());
    let work = |edit: &dyn Fn(&mut Options)| {
        let mut options = Options::new(parse_hours("12").expect("hours"));
        edit(&mut options);
        let prepared = prepare(&case.stage.path("case.toml"), &options, &Silent).expect("a scene");
        let all: Vec<usize> = (0..prepared.digests.len()).collect();
        prepared.work(&all)
    };
    let [raw, own] = [Denoise::Off, Denoise::Own].map(|denoise| {
        [None, Some(0.1)]
            .map(|target| work(&|o: &mut Options| (o.denoise, o.target_error) = (denoise, target)))
    });
    assert_eq!(raw[0], own[0], "without a target denoising comes after the work");
    assert_ne!(raw[1], own[1]);
    assert_ne!(raw[0], raw[1]);
}
