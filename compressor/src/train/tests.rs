//! Tests of the trainer as a whole: gradients against an oracle in f64, instruction sets, quality, and odd
//! tiles.

use super::oracle::Oracle;
use super::step::gather::Samples;
use super::step::kernel::Scope;
use super::step::network::CHUNK;
use super::step::optimise::{Step, Trainer};
use super::targets::light::Light;
use super::targets::problem::{EDGE_WEIGHT, Problem, Texel};
use super::targets::random::Random;
use super::*;
use crate::bc7;
use crate::lanes::Tier;
use crate::model::Profile;
use crate::tile::{Coverage, Gate};

const M: Profile = Profile::M;

fn means_of(tile: &TileParams) -> Vec<[f32; 3]> {
    tile.knots.iter().map(|knot| knot.mean).collect()
}

fn recipe(iterations: usize) -> Recipe {
    Recipe { iterations, passes: 2, paper: false, seed: 3, aim: Aim::MeanPsnr }
}

fn tile(
    width: usize,
    height: usize,
    frames: usize,
    light: impl Fn(usize, usize, usize) -> [f32; 3],
) -> TileSource {
    let at = |k: usize| (0..width * height).map(|i| light(k, i % width, i / width)).collect();
    TileSource {
        width,
        height,
        // Uneven, as around a switch.
        hours: (0..frames).map(|k| 24.0 * ((k as f64 + 0.25) / frames as f64).powf(1.1)).collect(),
        frames: (0..frames).map(at).collect(),
        coverage: vec![Coverage::Valid; width * height],
        gates: vec![],
        neighbours: [true; 4],
    }
}

/// A shadow edge that moves with the frame under a soft gradient, and a lamp that is on at the first and last
/// quarter.
fn moving_shadow(width: usize, height: usize, frames: usize) -> TileSource {
    tile(width, height, frames, |k, x, y| {
        let day = (std::f32::consts::PI * (k as f32 + 0.5) / frames as f32).sin();
        let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
        let edge = k as f32 / frames as f32 - 0.3 * v;
        let sun = day * ((u - edge) * 8.0).clamp(0.0, 1.0);
        let lamp = if 4 * k < frames || 4 * k >= 3 * frames {
            0.05 / ((u - 0.4).powi(2) + (v - 0.6).powi(2) + 0.1)
        } else {
            0.0
        };
        [0.1 * day + sun + lamp, 0.12 * day + 0.9 * sun + 0.8 * lamp, 0.2 * day + 0.8 * sun + 0.4 * lamp]
    })
}

fn trainer<const H: usize>(source: &TileSource, profile: &Profile, coding: Coding, tier: Tier) -> Trainer<H> {
    let light = Light::new(source, coding);
    let contents = profile.contents(light.distinct, light.gates.len());
    trainer_of(source, &contents, coding, tier)
}

fn trainer_of<const H: usize>(
    source: &TileSource,
    contents: &Contents,
    coding: Coding,
    tier: Tier,
) -> Trainer<H> {
    let shape = Shape::new(contents, source.width, source.height, source.frames.len(), coding);
    Trainer::new(Problem::new(source, &Light::new(source, coding), shape, coding), 5, true, tier)
}

/// Random texels for every frame.
fn random_texels(problem: &Problem) -> Vec<[Texel; CHUNK]> {
    let mut random = Random::new(11);
    let mut texel = || problem.texels[random.below(problem.texels.len())];
    (0..problem.frames).map(|_| std::array::from_fn(|_| texel())).collect()
}

/// A block of them at every frame, every other not full.
fn random_samples(texels: &[[Texel; CHUNK]]) -> Vec<Samples<'_>> {
    let block = |point: usize| Samples { point, texels: &texels[point][..CHUNK - 5 * (point % 2)] };
    (0..texels.len()).map(block).collect()
}

/// A moving shadow whose lamp is a gate, as is a second one.
fn switched(width: usize, height: usize, frames: usize) -> TileSource {
    let lamp = (0..frames).map(|k| 4 * k < frames || 4 * k >= 3 * frames).collect();
    let odd = (0..frames).map(|k| k % 2 == 1).collect();
    let gates = vec![Gate { group: 1, on: lamp }, Gate { group: 4, on: odd }];
    TileSource { gates, ..moving_shadow(width, height, frames) }
}

/// Compares the gradient with finite differences; `change` chooses from all that the profile has.
fn gradients_match<const H: usize>(profile: &Profile, coding: Coding, change: fn(&mut Contents)) {
    let mut source = switched(20, 12, 7);
    for i in 200..240 {
        source.coverage[i] = Coverage::Gutter;
    }
    let light = Light::new(&source, coding);
    let mut contents = profile.contents(light.distinct, light.gates.len());
    assert_eq!(contents.gates, if coding == Coding::Standard { 2 } else { 0 });
    change(&mut contents);
    let mut trainer = trainer_of::<H>(&source, &contents, coding, Tier::detect());
    for _ in 0..30 {
        trainer
            .step(&Step { scope: Scope::All, rate: 0.02, network_rate: 0.02, noise: true, beta2: 0.95 })
            .unwrap();
    }
    trainer.align_weights(Aim::MeanPsnr);
    let texels = random_texels(&trainer.problem);
    let samples = random_samples(&texels);
    trainer.differentiate(&samples, false, Scope::All);
    let loss = |params: &[f64]| {
        let problem = &trainer.problem;
        let oracle = Oracle::of_params(&problem.shape, &source, coding, &trainer.layout, params);
        let mut sum = 0.0;
        for block in &samples {
            let point = &problem.points[block.point];
            for texel in block.texels {
                let target = problem.targets_at(block.point)[texel.index()];
                let y = oracle.y(point.index, texel.x(), texel.y());
                for c in 0..3 {
                    let weight = f64::from(point.base[c]) + f64::from(point.slope[c]) * f64::from(target[c]);
                    let wanted = f64::from(target[c]);
                    let r = if wanted > 0.0 { y[c] - wanted } else { y[c].max(0.0) };
                    sum += weight.min(20.0) * f64::from(target[3]) * r * r;
                }
            }
        }
        sum
    };
    let params: Vec<f64> = trainer.params.iter().map(|p| f64::from(*p)).collect();
    let l = &trainer.layout;
    let scale = (samples.len() * CHUNK) as f64 * 2.0 / 64.0;
    for range in [&l.uv_endpoints, &l.uv_weights, &l.uvt_endpoints, &l.uvt_weights, &l.ut, &l.vt, &l.network]
    {
        let ours: Vec<f64> =
            trainer.gradient()[range.clone()].iter().map(|g| scale * f64::from(*g)).collect();
        if ours.is_empty() {
            continue;
        }
        let size = ours.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        assert!(size > 0.0);
        for i in range.clone().step_by(range.len().div_ceil(23)) {
            let (h, mut moved) = (1e-5, params.clone());
            moved[i] = params[i] + h;
            let up = loss(&moved);
            moved[i] = params[i] - h;
            let slope = (up - loss(&moved)) / (2.0 * h);
            let error = (slope - ours[i - range.start]).abs();
            assert!(error < 1e-4 * size, "parameter {i}: {slope} and {}", ours[i - range.start]);
        }
    }
}

#[test]
fn gradients_are_those_of_finite_differences() {
    gradients_match::<16>(&M, Coding::Standard, |_| {});
    gradients_match::<16>(&M, Coding::Paper, |_| {});
    gradients_match::<64>(&Profile::M_64, Coding::Standard, |_| {});
    gradients_match::<32>(&Profile::M_32, Coding::Standard, |_| {});
    gradients_match::<16>(&Profile::S, Coding::Standard, |_| {});
}

#[test]
fn gradients_are_right_whatever_is_omitted() {
    gradients_match::<16>(&M, Coding::Standard, |c| (c.uvt, c.slices, c.gamma) = (0, 0, false));
    gradients_match::<16>(&M, Coding::Standard, |c| (c.uv, c.vt, c.gates) = (false, false, 0));
    gradients_match::<16>(&M, Coding::Standard, |c| (c.ut, c.vt, c.rows, c.slices) = (false, false, 0, 1));
}

#[test]
fn a_switch_is_a_gate_and_gains() {
    // A lamp that blinks every second frame: time alone, with fewer rows than frames, hardly tells when it is
    // on.
    let mut source = switched(48, 48, 40);
    for (k, frame) in source.frames.iter_mut().enumerate().filter(|(k, _)| k % 2 == 1) {
        for (i, texel) in frame.iter_mut().enumerate() {
            let (x, y) = ((i % 48) as f32 / 48.0, (i / 48) as f32 / 48.0);
            let lamp = (0.2 + 0.01 * k as f32) / ((x - 0.7).powi(2) + (y - 0.3).powi(2) + 0.05);
            *texel = [texel[0] + lamp, texel[1] + 0.7 * lamp, texel[2] + 0.3 * lamp];
        }
    }
    let psnr = |gates: Vec<Gate>| {
        let trained = train(&TileSource { gates, ..source.clone() }, &M, &recipe(400)).unwrap();
        let stored = trained.params.unwrap();
        (stored.gates, trained.psnr_db.unwrap())
    };
    let (gates, with) = psnr(source.gates.clone());
    let (none, without) = psnr(vec![]);
    assert_eq!((gates, none), (vec![1, 4], vec![]));
    assert!(with > without + 1.0, "{with} dB with gates, {without} dB without");
}

#[test]
fn frames_that_look_alike_share_a_place_and_equal_switches_a_gate() {
    let look = |k: usize| [0, 0, 1, 2, 2, 3, 0, 0][k];
    let mut source = tile(16, 16, 8, |k, x, _| [(1 + k) as f32 * (1.0 + (look(k) * x) as f32); 3]);
    source.frames[4] = source.frames[4].iter().map(|_| [0.0; 3]).collect();
    let lamp: Vec<bool> = (0..8).map(|k| k < 3).collect();
    // Its own, its inverse, the same but where it is black, always on where there is light, another.
    let mut black = lamp.clone();
    black[4] = true;
    let patterns = [
        lamp.clone(),
        lamp.iter().map(|on| !on).collect(),
        black,
        (0..8).map(|k| k != 4).collect(),
        (0..8).map(|k| k == 5).collect(),
    ];
    source.gates = (2..).zip(patterns).map(|(group, on)| Gate { group, on }).collect();
    let light = Light::new(&source, Coding::Standard);
    assert_eq!(light.distinct, 4);
    let p = &light.axis.places;
    assert!([p[1], p[6], p[7]] == [0; 3] && p[4] == p[3] && 0 < p[2] && p[2] < p[3] && p[4] < p[5], "{p:?}");
    assert!(p[5] < light.axis.length);
    // What differs more stands farther.
    assert!(p[2] - p[1] > 2 * (p[5] - p[4]), "{p:?}");
    assert_eq!(light.gates, [2, 6]);
    assert_eq!(light.gate_inputs[5], [-1.0, 1.0]);
    // The paper has neither.
    let light = Light::new(&source, Coding::Paper);
    assert!(light.axis.places.is_empty() && light.gates.is_empty() && light.distinct == 8);
}

#[test]
fn a_tile_that_never_changes_is_one_map() {
    let source = switched(64, 64, 26);
    let still = |k: usize, x: usize, y: usize| {
        let [r, g, b] = source.frames[3][y * 64 + x];
        let day = 0.1 + k as f32;
        [day * r, day * g, 2.0 * day * b]
    };
    let still = TileSource { gates: source.gates.clone(), ..tile(64, 64, 26, still) };
    let trained = train(&still, &M, &recipe(1500)).unwrap();
    assert_eq!(trained.omitted, ["the same at every hour except for its mean: F_uv alone"]);
    let stored = trained.params.unwrap();
    assert_eq!((stored.f_uvt.len(), stored.f_ut.len(), stored.f_vt.len(), stored.gates.len()), (0, 0, 0, 0));
    assert_eq!((stored.axis.length, &stored.axis.places[..]), (1, &[0; 26][..]));
    let psnr = Oracle::of_stored(&stored, &still, Coding::Standard).psnr(&still, &means_of(&stored));
    assert!((48.0..70.0).contains(&psnr), "{psnr}");
    // A full tile of 26 frames.
    let shape = Shape::new(&stored.shape.contents, 128, 128, 26, Coding::Standard);
    let bpp = crate::bundle::full_len(&shape) as f64 * 8.0 / (128.0 * 128.0 * 26.0);
    assert!(bpp < 0.33, "{bpp}");
}

#[test]
fn every_instruction_set_gives_the_same_gradient() {
    let source = moving_shadow(24, 20, 5);
    let gradient = |tier| {
        let mut trainer = trainer::<16>(&source, &M, Coding::Standard, tier);
        let texels = random_texels(&trainer.problem);
        let samples = random_samples(&texels);
        let loss = trainer.differentiate(&samples, true, Scope::All);
        (loss, trainer.gradient().to_vec())
    };
    let (loss, reference) = gradient(Tier::portable());
    let norm = reference.iter().fold(0.0f32, |a, b| a.max(b.abs()));
    for tier in Tier::available() {
        let (other, gradient) = gradient(tier);
        assert!((loss - other).abs() < 1e-5 * loss, "{tier:?}: {loss} {other}");
        for (a, b) in reference.iter().zip(&gradient) {
            assert!((a - b).abs() < 1e-5 * norm, "{tier:?}: {a} {b}");
        }
    }
}

#[test]
fn training_reaches_the_quality_it_should_and_says_so() {
    let source = moving_shadow(64, 64, 12);
    let trained = train(&source, &M, &recipe(600)).unwrap();
    let stored = trained.params.unwrap();
    let (float, quantised) = (trained.psnr_unquantised_db.unwrap(), trained.psnr_db.unwrap());
    assert!((40.0..60.0).contains(&quantised), "{quantised}");
    assert!(float - quantised < 2.0 && quantised - float < 2.0, "{float} {quantised}");
    // What is said is what an independent decoder of the stored tile finds.
    let found = Oracle::of_stored(&stored, &source, Coding::Standard).psnr(&source, &means_of(&stored));
    assert!((found - quantised).abs() < 0.01, "{found} {quantised}");
    // The curve rises from its first point, in order of time.
    assert!(trained.curve.len() > 8 && trained.curve[0].psnr_db + 3.0 < quantised);
    assert!(
        trained.curve.windows(2).all(|w| w[0].seconds <= w[1].seconds && w[0].iteration <= w[1].iteration)
    );
}

#[test]
fn the_papers_recipe_trains_slower_and_stores_what_it_says() {
    let source = moving_shadow(32, 32, 8);
    let trained = train(&source, &M, &Recipe { paper: true, ..recipe(400) }).unwrap();
    let paper = trained.psnr_db.unwrap();
    let ours = train(&source, &M, &recipe(400)).unwrap().psnr_db.unwrap();
    assert!(paper > 15.0 && ours > paper + 3.0, "{paper} {ours}");
    let stored = trained.params.unwrap();
    let found = |coding| Oracle::of_stored(&stored, &source, coding).psnr(&source, &means_of(&stored));
    assert!((found(Coding::Paper) - paper).abs() < 0.01, "{} {paper}", found(Coding::Paper));
    // It is another coding, not another name for ours.
    assert!(found(Coding::Standard) < paper - 1.0, "{} {paper}", found(Coding::Standard));
}

#[test]
fn a_tile_is_the_same_bytes_every_time() {
    let source = moving_shadow(32, 16, 6);
    let [a, b] = [0, 1].map(|_| train(&source, &M, &recipe(120)).unwrap().params.unwrap());
    assert_eq!(a, b);
}

/// Trains a tile and looks at what is stored with the oracle.
fn stored_psnr(source: &TileSource, profile: &Profile, iterations: usize) -> f64 {
    let trained = train(source, profile, &recipe(iterations)).unwrap();
    let stored = trained.params.unwrap();
    assert!(stored.mlp.iter().all(|v| v.is_finite()));
    assert!(means_of(&stored).as_flattened().iter().all(|m| m.is_finite() && *m >= 0.0));
    let psnr = Oracle::of_stored(&stored, source, Coding::Standard).psnr(source, &means_of(&stored));
    assert!(
        psnr.is_finite() && (psnr - trained.psnr_db.unwrap()).abs() < 0.05,
        "{psnr} {:?}",
        trained.psnr_db
    );
    psnr
}

#[test]
fn odd_tiles_train() {
    let one_texel = {
        let mut source = moving_shadow(4, 4, 26);
        source.coverage.fill(Coverage::Outside);
        source.coverage[5] = Coverage::Valid;
        source
    };
    let few_among_gutter = {
        let mut source = moving_shadow(16, 12, 9);
        source.coverage[..150].fill(Coverage::Gutter);
        source
    };
    let spike = tile(16, 16, 4, |k, x, y| if (k, x, y) == (2, 3, 3) { [1e6; 3] } else { [1.0; 3] });
    for (name, source, at_least) in [
        ("edge", moving_shadow(16, 12, 10), 30.0),
        ("one frame", moving_shadow(32, 32, 1), 35.0),
        ("two frames", moving_shadow(32, 32, 2), 35.0),
        ("many frames", moving_shadow(16, 16, 240), 25.0),
        ("one texel", one_texel, 25.0),
        ("few valid texels", few_among_gutter, 30.0),
        (
            "constant in time",
            tile(32, 32, 8, |_, x, y| [1.0 + (x as f32 * 0.3).sin(), 1.0, 0.1 * y as f32]),
            33.0,
        ),
        ("constant", tile(32, 32, 8, |_, _, _| [0.7, 0.7, 0.7]), 45.0),
        ("red only", tile(32, 32, 4, |k, x, _| [0.1 * (x + k) as f32, 0.0, 0.0]), 35.0),
        ("denormal", tile(16, 16, 4, |_, x, _| [1e-40 * x as f32; 3]), 20.0),
        ("huge", tile(16, 16, 4, |_, x, _| [1e30 * x as f32; 3]), 30.0),
        ("spike", spike, 20.0),
    ] {
        let psnr = stored_psnr(&source, &M, 300);
        assert!(psnr > at_least, "{name}: {psnr} dB");
    }
}

#[test]
fn other_profiles_train() {
    for profile in [Profile::L, Profile::M_64, Profile::H] {
        let psnr = stored_psnr(&moving_shadow(32, 20, 6), &profile, 150);
        assert!(psnr > 28.0, "{}: {psnr}", profile.name);
    }
}

#[test]
fn black_frames_and_tiles_are_omitted() {
    let half = tile(16, 16, 6, |k, x, _| if k < 2 { [0.0; 3] } else { [0.1 + x as f32; 3] });
    let trained = train(&half, &M, &recipe(50)).unwrap();
    let same = "the same at every hour except for its mean: F_uv alone";
    assert_eq!(trained.omitted, ["black in 2 of 6 frames", same]);
    assert_eq!(means_of(&trained.params.unwrap())[..2], [[0.0; 3]; 2]);
    let black = tile(16, 16, 3, |_, _, _| [0.0; 3]);
    let mut outside = tile(16, 16, 3, |_, _, _| [1.0; 3]);
    outside.coverage.fill(Coverage::Gutter);
    for (source, why) in [(black, "black in every frame"), (outside, "no valid texel")] {
        let trained = train(&source, &M, &recipe(50)).unwrap();
        assert!(trained.params.is_none() && trained.psnr_db.is_none());
        assert_eq!(trained.omitted, [why]);
    }
}

#[test]
fn a_few_texels_store_only_the_blocks_that_they_read() {
    let mut source = moving_shadow(128, 128, 9);
    source.coverage.fill(Coverage::Outside);
    for i in 0..64 {
        source.coverage[(40 + i / 8) * 128 + 20 + i % 8] = Coverage::Valid;
    }
    let stored = train(&source, &M, &recipe(60)).unwrap().params.unwrap();
    let grey = bc7::encode(&bc7::GREY);
    let there = |blocks: &[[u8; 16]]| blocks.iter().filter(|block| **block != grey).count();
    // Four blocks of F_uv; 2 × 2 texels of F_uvt and their neighbours in each slice.
    assert_eq!(there(&stored.f_uv), 4);
    assert!((1..=20).contains(&there(&stored.f_uvt)), "{}", there(&stored.f_uvt));
    let bytes = crate::bundle::encode_payload(&stored).unwrap().maps.bytes.len();
    let read = [there(&stored.f_uv), there(&stored.f_uvt)];
    assert_eq!(bytes, crate::bundle::blocks_len(&stored.shape, read));
    assert!(bytes < crate::bundle::full_len(&stored.shape) / 3, "{bytes}");
}

#[test]
fn texels_next_to_another_tile_count_more() {
    let mut source = moving_shadow(128, 128, 2);
    // No valid texel above the left half.
    source.coverage[..64].fill(Coverage::Gutter);
    let edges = |neighbours: [bool; 4], coding: Coding| {
        let source = TileSource { neighbours, ..source.clone() };
        let light = Light::new(&source, coding);
        let shape = Shape::new(&M.contents(light.distinct, 0), 128, 128, 2, coding);
        let problem = Problem::new(&source, &light, shape, coding);
        for (edge, target) in problem.edges[..problem.valid].iter().zip(&problem.targets) {
            assert_eq!(target[3], if *edge { EDGE_WEIGHT } else { 1.0 });
        }
        let edges = problem.texels.iter().filter(|texel| problem.edges[texel.index()]);
        edges.map(|texel| (texel.x(), texel.y())).collect::<Vec<_>>()
    };
    // Of the tile's own texels, which are 1 to 126, and the copies that are read.
    let of = |is: &dyn Fn(usize, usize) -> bool| -> Vec<(usize, usize)> {
        let all = (1..128).flat_map(|y| (1..128).map(move |x| (x, y)));
        all.filter(|&(x, y)| is(x, y)).collect()
    };
    assert_eq!(edges([true, false, false, false], Coding::Standard), of(&|x, _| x == 1));
    assert_eq!(edges([false, true, false, false], Coding::Standard), of(&|x, _| x >= 126));
    assert_eq!(edges([false, false, true, false], Coding::Standard), of(&|x, y| y == 1 && x > 63));
    assert_eq!(edges([false, false, false, true], Coding::Standard), of(&|_, y| y >= 126));
    assert!(edges([false; 4], Coding::Standard).is_empty() && edges([true; 4], Coding::Paper).is_empty());
}

#[test]
fn bad_light_is_refused_by_place() {
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let source =
            tile(16, 16, 3, |k, x, y| if (k, x, y) == (1, 5, 7) { [1.0, bad, 1.0] } else { [1.0; 3] });
        let message = train(&source, &M, &recipe(10)).unwrap_err().to_string();
        assert!(message.contains("frame 1") && message.contains("(5, 7)"), "{message}");
    }
}

#[test]
fn training_that_diverges_is_noticed() {
    let mut trainer = trainer::<16>(&moving_shadow(16, 16, 3), &M, Coding::Standard, Tier::detect());
    let step = Step { scope: Scope::All, rate: 0.02, network_rate: 1e30, noise: true, beta2: 0.95 };
    let losses: Vec<f64> = (0..20).map(|_| trainer.step(&step).unwrap()).collect();
    assert!(losses.iter().any(|l| !l.is_finite()));
}

#[test]
fn training_that_diverges_is_restarted_at_a_smaller_rate_and_says_so() {
    // Attempts that diverge above a quarter of the rate.
    let (mut said, mut rates) = (Vec::new(), Vec::new());
    let attempt = |rate: f32, last: bool| {
        rates.push(rate);
        Ok((rate <= 0.25 && !last).then_some(rate))
    };
    assert_eq!(restarting(attempt, &mut said).unwrap(), 0.25);
    assert_eq!(rates, [1.0, 0.5, 0.25]);
    let of = |n: u32| format!("training diverged; restarted at 1/{n} of the learning rate");
    assert_eq!(said, [of(2), of(4)]);
    // None that ends, and the tile's own error.
    let mut said = Vec::new();
    let mut attempts = 0;
    let never = |_, last| {
        attempts += 1;
        assert_eq!(last, attempts == 7);
        Ok(None::<()>)
    };
    let message = restarting(never, &mut said).unwrap_err().to_string();
    assert!(message.contains("diverges even at 1/64 of the learning rate"), "{message}");
    assert_eq!(said, [of(2), of(4), of(8), of(16), of(32), of(64)]);
    assert!(matches!(
        restarting(|_, _| Err::<Option<()>, _>(Error::Interrupted), &mut said),
        Err(Error::Interrupted)
    ));

    // A tile at rates that are far too high: overflow; and numbers that stay finite but lose what was
    // reached.
    let source = moving_shadow(32, 32, 8);
    let light = Light::new(&source, Coding::Standard);
    let shape = Shape::new(&M.contents(light.distinct, light.gates.len()), 32, 32, 8, Coding::Standard);
    let problem = Problem::new(&source, &light, shape, Coding::Standard);
    let reported = |rate| train_width::<16>(&problem, &recipe(300), rate, vec!["before".to_owned()]);
    assert!(reported(1e10).unwrap_err().to_string().contains("diverges"));
    let poor = reported(1e4).unwrap();
    assert!(
        poor.omitted.len() > 1 && poor.omitted[..2] == ["before".to_owned(), of(2)],
        "{:?}",
        poor.omitted
    );
    assert!(poor.psnr_db.unwrap().is_finite() && poor.params.unwrap().mlp.iter().all(|w| w.is_finite()));
    assert_eq!(reported(1.0).unwrap().omitted, ["before"]);
}
