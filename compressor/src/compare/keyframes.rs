//! Common practice in games: a few whole frames (keyframes), light linear in time between them. Where light
//! groups differ between two of them, a frame with the light groups of one of the two is that one.
//!
//! Which frames are kept is found by dynamic programming over the day: the choice of least squared error
//! relative to the peaks, over all tiles, if the kept frames were exact.

use super::method::{CodedTile, CodedTiles, ImageCodec, each_tile, together};
use super::tiles::{Texels, Tile, TileSet};
use crate::Result;
use crate::clock::Clock;
use crate::time::Timeline;

/// Frames that are kept, of a day's 24 and more.
pub(super) const KEPT: usize = 8;

/// Compresses the kept frames with a codec; returns which they are, too.
pub(super) fn code(set: &TileSet, codec: &dyn ImageCodec) -> Result<(CodedTiles, Vec<usize>)> {
    let kept = choose(&costs(set), KEPT);
    let frames = set.timeline.hours.len();
    let coded = each_tile(set, |tile| {
        let images = kept.iter().map(|&k| codec.code(&tile.filled[k], tile)).collect::<Result<Vec<_>>>()?;
        let keys = together(images);
        let clock = Clock::start();
        let decoded = (0..frames).map(|k| between(k, &kept, &set.timeline, &keys.decoded)).collect();
        let decode_seconds = keys.decode_seconds + clock.seconds();
        Ok(CodedTile { decoded, decode_seconds, ..keys })
    })?;
    Ok((coded, kept))
}

/// Frame k from the kept frames around it.
fn between(k: usize, kept: &[usize], timeline: &Timeline, keys: &[Texels]) -> Texels {
    let n = kept.len();
    let at = kept.partition_point(|&kept| kept <= k);
    // Before the first is after the last.
    let (a, b) = ((at + n - 1) % n, at % n);
    let share = way(k, kept[a], kept[b], timeline) as f32;
    let mix = |a: f32, b: f32| (1.0 - share) * a + share * b;
    keys[a].iter().zip(&keys[b]).map(|(a, b)| [0, 1, 2].map(|c| mix(a[c], b[c]))).collect()
}

/// How far frame k is on the way from frame a to frame b, in hours around the clock; where a switch lies
/// between those two, at the one whose light groups it has.
fn way(k: usize, a: usize, b: usize, timeline: &Timeline) -> f64 {
    let (hours, lamps) = (&timeline.hours, |set: usize| &timeline.states[set]);
    match (lamps(k) == lamps(a), lamps(k) == lamps(b)) {
        (true, false) => return 0.0,
        (false, true) => return 1.0,
        _ => {}
    }
    let after = |x: usize| (hours[x] - hours[a]).rem_euclid(24.0);
    if k == a {
        return 0.0;
    }
    let length = if a == b { 24.0 } else { after(b) };
    after(k) / length
}

/// `[a][b]`: the squared error of the frames after a and before b, if these two are kept; with b = a, of all
/// the others.
fn costs(set: &TileSet) -> Vec<Vec<f64>> {
    let n = set.timeline.hours.len();
    let mut costs = vec![vec![0.0; n]; n];
    for tile in &set.tiles {
        let products = products(tile);
        for (a, row) in costs.iter_mut().enumerate() {
            for (b, cost) in row.iter_mut().enumerate() {
                let length = if a == b { n } else { (b + n - a) % n };
                for k in (1..length).map(|i| (a + i) % n).filter(|&k| tile.peaks[k] > 0.0) {
                    let (u, v) = (1.0 - way(k, a, b, &set.timeline), way(k, a, b, &set.timeline));
                    let g = |i: usize, j: usize| products[i][j];
                    let squared =
                        g(k, k) + u * u * g(a, a) + v * v * g(b, b) - 2.0 * u * g(k, a) - 2.0 * v * g(k, b)
                            + 2.0 * u * v * g(a, b);
                    *cost += squared.max(0.0) / f64::from(tile.peaks[k]).powi(2);
                }
            }
        }
    }
    costs
}

/// The products of every two frames over the valid texels.
fn products(tile: &Tile) -> Vec<Vec<f64>> {
    let valid: Vec<usize> = tile.valid().collect();
    let frames: Vec<Vec<f32>> =
        tile.source.frames.iter().map(|set| valid.iter().flat_map(|&i| set[i]).collect()).collect();
    let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| f64::from(*x) * f64::from(*y)).sum();
    frames.iter().map(|a| frames.iter().map(|b| product(a, b)).collect()).collect()
}

/// The `number` frames around the clock, ascending, whose gaps cost least.
fn choose(costs: &[Vec<f64>], number: usize) -> Vec<usize> {
    let n = costs.len();
    let number = number.min(n);
    let best = (0..n).filter_map(|first| from(costs, first, number)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or_else(Vec::new, |(_, kept)| kept)
}

/// The best choice whose least is `first`, with its cost; none where too few frames follow it.
fn from(costs: &[Vec<f64>], first: usize, number: usize) -> Option<(f64, Vec<usize>)> {
    let n = costs.len();
    // Per last frame: the least cost up to it with this many kept, and the one before it, count by count.
    let mut least = vec![f64::INFINITY; n];
    least[first] = 0.0;
    let mut before: Vec<Vec<usize>> = Vec::new();
    for _ in 1..number {
        let mut next = vec![(f64::INFINITY, first); n];
        for last in first..n {
            for (to, best) in next.iter_mut().enumerate().skip(last + 1) {
                let cost = least[last] + costs[last][to];
                if cost < best.0 {
                    *best = (cost, last);
                }
            }
        }
        least = next.iter().map(|(cost, _)| *cost).collect();
        before.push(next.into_iter().map(|(_, last)| last).collect());
    }
    let closed = |last: usize| least[last] + costs[last][first];
    let last = (first..n).min_by(|&a, &b| closed(a).total_cmp(&closed(b)))?;
    let cost = Some(closed(last)).filter(|cost| cost.is_finite())?;
    let mut kept = vec![last];
    for steps in before.iter().rev() {
        kept.push(steps[kept[kept.len() - 1]]);
    }
    kept.reverse();
    Some((cost, kept))
}

/// Float16, as it is: no block codec, so that what remains is the error of interpolation alone.
pub(super) struct Float16;

impl ImageCodec for Float16 {
    fn code(&self, texels: &Texels, _: &Tile) -> Result<super::method::Coded<Texels>> {
        let scale = super::curve::scale(texels);
        let encode = || {
            let half = |v: f32| half::f16::from_f32(v / scale);
            let stored: Vec<[half::f16; 3]> = texels.iter().map(|texel| texel.map(half)).collect();
            let bits = 48 * stored.len() + 32;
            Ok((stored, bits as f64, Vec::new()))
        };
        super::method::timed(encode, |stored| {
            Ok(stored.iter().map(|texel| texel.map(|v| v.to_f32() * scale)).collect())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{set_of, tile_of};
    use super::*;

    #[test]
    fn kept_frames_are_exact_and_others_linear_between_them() {
        // Light goes 0 1 2 … 5 and back to 0 over six frames at uneven hours; two are kept.
        let hours = [1.0, 2.0, 3.0, 5.0, 11.0, 17.0];
        let light = [4.0, 5.0, 6.0, 8.0, 14.0, 9.0];
        let tile = tile_of(4, 4, light.iter().map(|&v| vec![[v; 3]; 16]).collect());
        let set = set_of(vec![tile], &hours);
        let kept = choose(&costs(&set), 2);
        // Straight from 1 h to 11 h; what is left is how 17 h lies between 14 and 4.
        assert_eq!(kept, [0, 4]);
        let keys: Vec<Texels> = kept.iter().map(|&k| set.tiles[0].filled[k].clone()).collect();
        for (k, &light) in light.iter().enumerate() {
            let found = between(k, &kept, &set.timeline, &keys)[3][1];
            let expected = if k == 5 { 14.0 - 10.0 * 6.0 / 14.0 } else { light };
            assert!((found - expected).abs() < 1e-5, "{k}: {found}");
        }
        let all = choose(&costs(&set), 99);
        assert_eq!(all, [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn lamps_do_not_fade() {
        let timeline = Timeline {
            hours: vec![0.0, 6.0, 12.0, 13.0, 18.0],
            between: vec![],
            intervals: vec![vec![[12.5, 24.0]]],
            states: [false, false, false, true, true].map(|on| vec![on]).to_vec(),
            coding: crate::time::Coding::Standard,
        };
        // Under the lamps of one of the two it is that one, under those of both it lies between.
        assert_eq!(way(2, 1, 3, &timeline), 0.0);
        assert_eq!(way(3, 2, 4, &timeline), 1.0);
        assert_eq!(way(1, 0, 2, &timeline), 0.5);
    }

    #[test]
    fn float16_keys_are_met() {
        let hours: Vec<f64> = (0..12).map(|k| 2.0 * f64::from(k)).collect();
        let tiles = vec![super::super::testing::tile(8, 8, 12, 7)];
        let set = set_of(tiles, &hours);
        let (coded, kept) = code(&set, &Float16).unwrap();
        assert_eq!((kept.len(), coded.bits), (KEPT, KEPT as f64 * (48.0 * 64.0 + 32.0)));
        for k in kept {
            for (found, wanted) in
                coded.decoded[0][k].iter().flatten().zip(set.tiles[0].filled[k].iter().flatten())
            {
                assert!((found - wanted).abs() <= 1e-3 * wanted, "{k}");
            }
        }
    }
}
