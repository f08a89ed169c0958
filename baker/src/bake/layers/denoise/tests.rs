//! Filters on floors whose light is known.

use super::neighbours::tests::floor;
use super::*;

/// Texels along the floor.
const SIDE: usize = 64;

/// Light by column and row of a floor.
type Light = Box<dyn Fn(usize, usize) -> f32>;

/// A repeatable number in [0, 1).
fn random(i: usize) -> f32 {
    let mut x = (i as u32 ^ 0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
    x = (x ^ x >> 16).wrapping_mul(0x27d4_eb2f);
    ((x ^ x >> 15) >> 8) as f32 / (1 << 24) as f32
}

/// What is traced of some light where each half has noise of its own.
fn traced(truth: impl Fn(usize, usize) -> f32, noise: impl Fn(usize, usize, usize) -> f32) -> Vec<Value> {
    let value = |i: usize| {
        let (x, z) = (i % SIDE, i / SIDE);
        let half = |half: usize| Rgb::splat(truth(x, z)) + Rgb::new(1.0, 0.9, 0.8) * noise(x, z, half);
        let (a, b) = (half(0), half(1));
        Value::traced((a + b) * 0.5, (a - b) * 0.5)
    };
    (0..SIDE * SIDE).map(value).collect()
}

/// Noise of mean 0 that is mostly a little too dark and now and then much too bright.
fn rare(deviation: f32, seed: usize) -> impl Fn(usize, usize, usize) -> f32 {
    move |x, z, half| deviation * (-1.0 - (1.0 - random(seed + 2 * (z * SIDE + x) + half)).ln())
}

/// The floor filtered in three blocks.
fn filtered(values: &[Value], walled: bool) -> Vec<Value> {
    in_blocks(values, walled, &[0..1000, 1000..2600, 2600..(SIDE * SIDE) as u32])
}

fn in_blocks(values: &[Value], walled: bool, blocks: &[Range<u32>]) -> Vec<Value> {
    let texels_in_space = floor(SIDE as i32, walled);
    let of_block = |range: &Range<u32>| {
        let block = Block::new(&texels_in_space, range.clone()).unwrap();
        let values: Vec<Value> = block.all.iter().map(|&i| values[i]).collect();
        block.filter(&[values]).remove(0)
    };
    let stored: Vec<Filtered> = blocks.iter().flat_map(of_block).collect();
    stored.iter().zip(values).map(|(stored, traced)| stored.value(traced)).collect()
}

/// Mean squared error: the true one, and the estimated one.
fn errors(values: &[Value], truth: impl Fn(usize, usize) -> f32) -> [f64; 2] {
    let is = |(i, v): (usize, &Value)| {
        (v.mean - Rgb::splat(truth(i % SIDE, i / SIDE))).as_dvec3().length_squared()
    };
    let n = values.len() as f64;
    let estimated = values.iter().map(|v| v.variance() + v.squared_bias()).sum::<f64>() / n;
    [values.iter().enumerate().map(is).sum::<f64>() / n, estimated]
}

#[test]
fn noise_falls_and_the_remaining_error_is_reported() {
    const SEEDS: usize = 24;
    // Even light; a slope; the soft edge of a shadow; and a hard one, of 1 to 30.
    let edge =
        |at: f32, width: f32| move |x: usize, _: usize| 1.0 + 30.0 / (1.0 + ((x as f32 - at) / width).exp());
    let lights: [(&str, Light, f64); 4] = [
        ("even", Box::new(|_, _| 4.0), 0.05),
        ("slope", Box::new(|x, z| 1.0 + (x + z) as f32 / 16.0), 0.07),
        ("soft", Box::new(edge(30.0, 6.0)), 0.1),
        ("hard", Box::new(edge(30.0, 0.05)), 0.25),
    ];
    for (name, truth, most) in &lights {
        let mut sums = [[0.0; 2]; 2];
        for seed in 0..SEEDS {
            let values = traced(truth, rare(0.9, 100_000 * seed));
            for (sums, values) in sums.iter_mut().zip([&values, &filtered(&values, false)]) {
                sums.iter_mut().zip(errors(values, truth)).for_each(|(sum, error)| *sum += error);
            }
        }
        let [[before, estimated_before], [after, estimated]] = sums;
        assert!(after < most * before, "{name}: {:.3} of the squared error is left", after / before);
        assert!((estimated_before / before - 1.0).abs() < 0.05, "{name}: {}", estimated_before / before);
        // The noise before limits how well the rest can be estimated: to 1/√texels of it, and about four
        // times that with rare paths.
        let chance = 4.0 * before / ((SIDE * SIDE * SEEDS) as f64).sqrt();
        assert!(
            (estimated - after).abs() < 0.1 * after + 3.0 * chance,
            "{name}: {:.4} of it left, {:.4} estimated",
            after / before,
            estimated / before
        );
    }
}

/// Light gained by a filter, as a part of all, and its standard error, over eight floors whose noise goes
/// with their light.
fn gain(truth: impl Fn(usize, usize) -> f32) -> [f64; 2] {
    let [mut all, mut shift, mut squared] = [0.0; 3];
    for seed in 0..8 {
        let noise = rare(0.25, 100_000 * seed);
        let values = traced(&truth, |x, z, half| truth(x, z) * noise(x, z, half));
        let sum = |of: &dyn Fn(&Value) -> f64| values.iter().map(of).sum::<f64>();
        all += sum(&|v| f64::from(v.mean.element_sum()));
        squared += sum(&|v| f64::from(v.noise.element_sum()).powi(2));
        shift += filtered(&values, false).iter().map(|v| f64::from(v.shift.element_sum())).sum::<f64>();
    }
    [shift / all, squared.sqrt() / all]
}

#[test]
fn light_is_neither_lost_nor_gained() {
    let [slope, error] = gain(|x, z| 1.0 + (x + z) as f32 / 16.0);
    println!("slope: {slope:+.4} ± {error:.4}");
    assert!(slope.abs() < 3.0 * error, "{slope} ± {error}");
    // Squares of eight texels, six times as bright as those beside them: hardly any.
    let [squares, error] = gain(|x, z| if (x / 8 + z / 8).is_multiple_of(2) { 6.0 } else { 1.0 });
    println!("squares: {squares:+.4} ± {error:.4}");
    assert!(squares.abs() < 0.02, "{squares} ± {error}");
}

#[test]
fn a_rare_path_is_spread_and_its_light_kept() {
    // One texel in the middle met light a thousand times as bright as that around, in one half.
    let at = SIDE / 2;
    let values = traced(
        |_, _| 1.0,
        |x, z, half| {
            if (x, z, half) == (at, at, 0) { 2000.0 } else { 0.2 * (random(2 * (z * SIDE + x) + half) - 0.5) }
        },
    );
    let after = filtered(&values, false);
    let middle = at * SIDE + at;
    assert!(after[middle].mean.x < 0.1 * values[middle].mean.x, "{} left", after[middle].mean.x);
    let light = |values: &[Value]| values.iter().map(|v| f64::from(v.mean.x)).sum::<f64>();
    assert!((light(&after) - light(&values)).abs() < 0.5 * 1000.0, "{} of {}", light(&after), light(&values));
}

#[test]
fn what_both_halves_agree_on_stays() {
    // A line of light a texel wide, a single texel and a step of eight orders, none of them with noise to
    // speak of.
    let truth = |x: usize, z: usize| match (x, z) {
        (20, _) => 50.0,
        (40, 40) => 200.0,
        (50.., _) => 1e8,
        _ => 1.0,
    };
    let values = traced(truth, |x, z, half| 0.01 * truth(x, z) * (random(2 * (z * SIDE + x) + half) - 0.5));
    for (i, value) in filtered(&values, false).iter().enumerate() {
        let is = truth(i % SIDE, i / SIDE);
        assert!((value.mean.x / is - 1.0).abs() < 0.02, "{} instead of {is} at {i}", value.mean.x);
        assert!(value.mean.is_finite() && value.mean.min_element() >= 0.0);
    }
}

#[test]
fn without_noise_every_bit_stays() {
    let truth = |x: usize, z: usize| (1.0 + x as f32 * 0.37).ln() * (1 + z % 3) as f32 * 1e-3;
    let values = traced(truth, |_, _, _| 0.0);
    assert_eq!(filtered(&values, false), values);
    // And where there is no light at all.
    let dark = vec![Value::default(); SIDE * SIDE];
    assert_eq!(filtered(&dark, false), dark);
}

#[test]
fn light_stays_on_its_side_of_a_wall() {
    // Beyond the wall it is dark, but for noise as strong as on the lit side, where a blind filter would have
    // reason to mix both.
    let wall = SIDE / 2;
    let values = traced(
        |x, _| if x > wall { 0.0 } else { 10.0 },
        |x, z, half| {
            if x > wall { 0.0 } else { 9.0 * (2.0 * random(2 * (z * SIDE + x) + half) - 1.0) }
        },
    );
    let after = filtered(&values, true);
    assert!(after.iter().enumerate().all(|(i, v)| i % SIDE <= wall || v.mean == Rgb::ZERO));
}

#[test]
fn blocks_do_not_matter() {
    let values = traced(|x, _| 1.0 + x as f32, rare(0.9, 7));
    let all = 0..(SIDE * SIDE) as u32;
    let whole = in_blocks(&values, false, std::slice::from_ref(&all));
    assert!(whole == filtered(&values, false));
}

#[test]
fn wider_vectors_give_the_same_bits() {
    let values = traced(|x, z| 1.0 + (x * z) as f32, rare(0.9, 7));
    let texels_in_space = floor(SIDE as i32, true);
    let block = Block::new(&texels_in_space, 0..(SIDE * SIDE) as u32).unwrap();
    let light = [values.iter().map(halves).collect()];
    let loaded = LoadedBlock { block: &block, values: &[values], light: &light };
    assert_eq!(loaded.filter_block(), loaded.filter_block_portable());
}

#[test]
fn fireflies_are_filtered() {
    // In 1 and 5 % of the halves, light a hundred and thirty times as bright: now and then in both halves of
    // a texel.
    for (chance, strength) in [(0.01, 100.0), (0.05, 30.0)] {
        let [mut before, mut after, mut estimated, mut gained] = [0.0; 4];
        for seed in 0..16 {
            let noise = |x: usize, z: usize, half: usize| {
                let hit = random(100_000 * seed + 2 * (z * SIDE + x) + half) < chance;
                strength * (f32::from(u8::from(hit)) - chance)
            };
            let values = traced(|_, _| 4.0, noise);
            let result = filtered(&values, false);
            before += errors(&values, |_, _| 4.0)[0];
            let [is, said] = errors(&result, |_, _| 4.0);
            (after, estimated) = (after + is, estimated + said);
            gained += result.iter().map(|v| f64::from(v.shift.x)).sum::<f64>() / (4.0 * values.len() as f64);
        }
        println!(
            "{chance}: {:.4} left, {:.4} estimated, light {:+.4}",
            after / before,
            estimated / before,
            gained / 16.0
        );
        assert!(after < 0.1 * before, "{chance}: {}", after / before);
        assert!(
            (estimated - after).abs() < 0.04 * before,
            "{chance}: {} of {} estimated",
            estimated / before,
            after / before
        );
        assert!((gained / 16.0).abs() < 0.05, "{chance}: {gained}");
    }
}

#[test]
fn dim_light_beside_bright_is_judged_by_its_own() {
    // A hard edge of 1 to 1000 and noise of 90 % on both sides: on the dim side errors fall, too.
    let truth = |x: usize, _: usize| if x < SIDE / 2 { 1.0 } else { 1000.0 };
    let [mut before, mut after] = [0.0; 2];
    for seed in 0..8 {
        let noise = rare(0.9, 100_000 * seed);
        let values = traced(truth, |x, z, half| truth(x, z) * noise(x, z, half));
        let dim = |values: &[Value]| {
            let dim = values.iter().enumerate().filter(|(i, _)| i % SIDE < SIDE / 2);
            dim.map(|(_, v)| (v.mean - Rgb::ONE).as_dvec3().length_squared()).sum::<f64>()
        };
        (before, after) = (before + dim(&values), after + dim(&filtered(&values, false)));
    }
    println!("{:.3} left", after / before);
    assert!(after < 0.5 * before, "{}", after / before);
}
