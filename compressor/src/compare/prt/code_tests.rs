//! Tests of coded vectors: the bits to the bit, and light that must come back.

use super::super::super::method::squared_error;
use super::super::super::testing::tile_of;
use super::*;
use crate::train::targets::Random;

const SIDE: usize = 16;

/// Vectors that are sums of `rank` random ones plus a mean, under random weights of this many frames; and the
/// tile that they light.
fn case(sources: usize, frames: usize, rank: usize) -> (Tile, Vectors) {
    let mut random = Random::new(7);
    let mut some = |n: usize| -> Vec<f64> { (0..n).map(|_| f64::from(random.uniform(0.0, 1.0))).collect() };
    let n = 3 * sources;
    let parts: Vec<Vec<f64>> = (0..=rank).map(|_| some(n)).collect();
    let weights = some(3 * frames * sources);
    let mut rows = Vec::new();
    for _ in 0..SIDE * SIDE {
        let terms = some(rank);
        rows.extend((0..n).map(|i| parts[rank][i] + (0..rank).map(|r| terms[r] * parts[r][i]).sum::<f64>()));
    }
    lit(Vectors { sources, rows, weights, scales: 0 }, frames)
}

fn lit(vectors: Vectors, frames: usize) -> (Tile, Vectors) {
    let light: Vec<Vec<f64>> =
        vectors.rows.chunks_exact(vectors.numbers()).map(|row| vectors.light(row)).collect();
    let set = |k: usize| light.iter().map(|row| [0, 1, 2].map(|c| row[3 * k + c] as f32)).collect();
    (tile_of(SIDE, SIDE, (0..frames).map(set).collect()), vectors)
}

/// The worst frame's squared error relative to its peak.
fn error(tile: &Tile, decoded: &[Texels]) -> f64 {
    let values = (3 * SIDE * SIDE) as f64;
    let of = |k: usize| {
        squared_error(&decoded[k], &tile.source.frames[k], tile) / values / f64::from(tile.peaks[k]).powi(2)
    };
    (0..decoded.len()).map(of).fold(0.0, f64::max)
}

#[test]
fn light_of_a_channel_and_frame_is_the_sum_of_its_sources() {
    // Two sources, two frames; the second frame has the second source in blue alone.
    let weights = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let vectors = Vectors { sources: 2, rows: vec![], weights, scales: 0 };
    assert_eq!(vectors.light(&[1.0, 10.0, 2.0, 20.0, 3.0, 30.0]), [21.0, 86.0, 195.0, 0.0, 0.0, 30.0]);
}

#[test]
fn enough_components_give_the_light_back_but_for_rounding() {
    let (tile, vectors) = case(5, 4, 3);
    let of = |rank: usize| {
        let (stored, mean) = best(&tile, &vectors, 1, rank, ROUNDS);
        assert!(mean < 0.0);
        error(&tile, &decode(&tile, &vectors, &stored))
    };
    // Coordinates are rounded to 255 steps, of a sixth of the peak or so each; without the third component
    // much is missing.
    assert!(of(3) < 3e-6, "{}", of(3));
    assert!(of(2) > 100.0 * of(3), "{} {}", of(2), of(3));
    // Float16 alone rounds less.
    let plain = plain(&tile, &vectors).unwrap();
    assert!(error(&tile, &plain.decoded) < 3e-7);
    assert_eq!(plain.bits, (16 * 15 * SIDE * SIDE) as f64);
}

/// Two functions, one of which lights the left half alone: two clusters of one component each have what one
/// cluster needs two for.
#[test]
fn clusters_part_what_different_functions_light() {
    let mut random = Random::new(3);
    let mut rows = Vec::new();
    for i in 0..SIDE * SIDE {
        let is_left = i % SIDE < SIDE / 2;
        let x = f64::from(random.uniform(0.0, 1.0));
        rows.extend((0..3).flat_map(|_| if is_left { [x, 0.0] } else { [0.0, x] }));
    }
    let weights = vec![1.0, 0.2, 1.0, 0.2, 1.0, 0.2, 0.1, 1.0, 0.1, 1.0, 0.1, 1.0];
    let (tile, vectors) = lit(Vectors { sources: 2, rows, weights, scales: 0 }, 2);
    let of = |clusters: usize| {
        let (stored, _) = best(&tile, &vectors, clusters, 1, ROUNDS);
        (error(&tile, &decode(&tile, &vectors, &stored)), stored)
    };
    let ((one, _), (two, stored)) = (of(1), of(2));
    assert!(two < 1e-5 && one > 1e-3, "{one} {two}");
    let left = stored.of[0];
    assert!((0..SIDE * SIDE).all(|i| (stored.of[i] == left) == (i % SIDE < SIDE / 2)));
}

#[test]
fn bits_are_counted_to_the_bit() {
    let (_, vectors) = case(5, 4, 3);
    let vectors = Vectors { scales: 2, ..vectors };
    // 100 texels of 3 bytes and a cluster of 5 (3 bits), 5 means and 15 components of 15 numbers, 2 scales, 2
    // bytes.
    assert_eq!(bits(100, &vectors, 5, 3), 100 * 27 + 16 * 20 * 15 + 64 + 16);
    assert_eq!(bits(100, &vectors, 1, 1), 100 * 8 + 16 * 2 * 15 + 64 + 16);
    let (tile, vectors) = case(5, 4, 12);
    let coded = clustered(&tile, &vectors, 9000.0).unwrap();
    // What was chosen is one of the sizes that are near.
    let near = sizes(SIDE * SIDE, &vectors, 9000.0);
    assert!(near.iter().any(|&(clusters, rank)| bits(256, &vectors, clusters, rank) as f64 == coded.bits));
}

#[test]
fn sizes_are_near_the_bits_that_are_wanted_and_no_fewer() {
    let (_, vectors) = case(17, 4, 1);
    for (texels, wanted) in [(10_000, 450_000.0), (4000, 100_000.0), (16_384, 442_368.0)] {
        let sizes = sizes(texels, &vectors, wanted);
        assert!(sizes.len() > 1);
        for &(clusters, rank) in &sizes {
            let share = bits(texels, &vectors, clusters, rank) as f64 / wanted;
            assert!((0.95..=1.05).contains(&share), "{clusters} {rank}: {share}");
        }
    }
    // Few texels: the mean and one component are too much already. Too many bits: the largest.
    assert_eq!(sizes(20, &vectors, 500.0), [(1, 1)]);
    assert_eq!(sizes(1000, &vectors, 1e9), [(64, 16)]);
}

#[test]
fn black_frames_and_equal_texels_are_handled() {
    let vectors =
        Vectors { sources: 2, rows: [1.0, 2.0].repeat(3 * SIDE * SIDE), weights: vec![0.0; 12], scales: 0 };
    let (tile, vectors) = lit(vectors, 2);
    let coded = clustered(&tile, &vectors, 5000.0).unwrap();
    assert!(coded.decoded.iter().flatten().flatten().all(|x| *x == 0.0));
    let mut weights = vectors.weights.clone();
    weights[..6].fill(1.0);
    let (tile, vectors) = lit(Vectors { weights, ..vectors }, 2);
    let coded = clustered(&tile, &vectors, 5000.0).unwrap();
    assert!(error(&tile, &coded.decoded[..1]) < 1e-6);
}

#[test]
fn rounds_raise_the_mean_psnr() {
    // One frame is of one function, the others of three that are noise.
    let mut random = Random::new(11);
    let rows = (0..12 * SIDE * SIDE).map(|_| f64::from(random.uniform(0.0, 1.0))).collect();
    let mut weights = vec![0.0; 4 * 12];
    for c in 0..3 {
        weights[4 * c] = 1.0;
        (1..4).for_each(|k| {
            (0..4).for_each(|s| weights[12 * k + 4 * c + s] = f64::from(random.uniform(0.0, 1.0)))
        });
    }
    let (tile, vectors) = lit(Vectors { sources: 4, rows, weights, scales: 0 }, 4);
    let [plain, weighted] = [1, ROUNDS].map(|rounds| best(&tile, &vectors, 2, 3, rounds).1);
    assert!(weighted < plain - 0.1, "{weighted} {plain}");
}
