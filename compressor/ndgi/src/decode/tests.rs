//! The fast path against the literal one, filtering across tiles, and extremes.

use super::*;
use crate::bundle;
use crate::grid::Grid;
use crate::half::F16;
use crate::lanes::Tier;
use crate::model::{Contents, Knot, PROFILES, Profile, Shape};
use crate::testing;
use crate::time::{Axis, Timeline};

/// Compares with a tolerance relative to the value or, near zero, to a hundredth of the mean.
fn assert_close(fast: [f32; 3], oracle: [f32; 3], mean: [f32; 3], what: &str) {
    for c in 0..3 {
        let scale = oracle[c].abs().max(0.01 * mean[c]).max(1e-20);
        assert!(
            (fast[c] - oracle[c]).abs() <= 1e-4 * scale,
            "{what}, channel {c}: {} and {}",
            fast[c],
            oracle[c]
        );
    }
}

/// Contents with and without each map, and all of them under the paper's coding.
fn kinds(profile: Profile, frames: usize) -> Vec<(Contents, Coding)> {
    let all = profile.contents(frames, 2);
    let none = Contents { hidden: all.hidden, ..Contents::NONE };
    let rows = all.rows.max(2);
    let standard = [
        all,
        none,
        Contents { uv: true, ..none },
        Contents { uvt: 16, slices: 1, gates: 1, ..none },
        Contents { ut: true, rows, gamma: true, ..none },
        Contents { vt: true, rows: 1, gates: 3, ..none },
        Contents { uv: false, vt: false, ..all },
    ];
    let mut kinds: Vec<_> = standard.into_iter().map(|contents| (contents, Coding::Standard)).collect();
    kinds.push((Contents { gates: 0, ..all }, Coding::Paper));
    kinds
}

#[test]
fn every_tier_gives_what_the_formulae_give() {
    let mut checked = 0;
    for (i, profile) in PROFILES.iter().enumerate() {
        for (width, height, frames) in [(128, 128, 26), (12, 100, 3), (4, 4, 1), (36, 8, 7)] {
            for (kind, coding) in kinds(*profile, frames) {
                let shape = Shape::new(&kind, width, height, frames, coding);
                let tile = testing::tile(shape, 100 + i as u64);
                let hours = (0..frames).map(|k| k as f64 * 24.0 / frames as f64).collect();
                let states = (0..frames).map(|k| vec![k % 3 == 0, k % 2 == 0, true]).collect();
                let timeline =
                    Timeline { hours, between: vec![], intervals: vec![vec![]; 3], states, coding };
                for hour in [0.0, 7.77, 23.9] {
                    let point = timeline.at(hour);
                    let means = means_at(&tile, &point);
                    let prepared = Prepared::new(&tile, &timeline, &point).unwrap().unwrap();
                    for at in (0..width * height).step_by(89) {
                        let (x, y) = (at % width, at / width);
                        let oracle = texel(&tile, &timeline, &point, x, y);
                        let what = format!("{kind}, {coding:?} prepared {hour} h, texel {at}");
                        assert_close(prepared.texel(x, y), oracle, means, &what);
                    }
                    for tier in Tier::available() {
                        let decoded =
                            TileDecoder::new(&tile, &timeline).unwrap().with_tier(tier).decode_tile(&point);
                        assert_eq!(decoded.len(), width * height);
                        for (at, fast) in decoded.iter().enumerate().step_by(if width > 100 { 97 } else { 1 })
                        {
                            let oracle = texel(&tile, &timeline, &point, at % width, at / width);
                            assert_close(
                                *fast,
                                oracle,
                                means,
                                &format!("{kind}, {coding:?} {tier:?} {hour} h, texel {at}"),
                            );
                            checked += 1;
                        }
                    }
                }
            }
        }
    }
    assert!(checked > 10_000);
}

#[test]
fn a_tile_of_the_wrong_size_is_refused() {
    let contents = Profile::M.contents(2, 1);
    let good = testing::tile(Shape::new(&contents, 16, 8, 2, Coding::Standard), 3);
    let timeline = Timeline {
        between: vec![],
        hours: vec![0.0, 12.0],
        intervals: vec![vec![]],
        states: vec![vec![true], vec![false]],
        coding: Coding::Standard,
    };
    assert!(TileDecoder::new(&good, &timeline).is_ok());
    type Edit = fn(&mut TileParams);
    let edits: [(&str, Edit); 15] = [
        ("F_uv", |t| t.f_uv.truncate(1)),
        ("F_uvt", |t| t.f_uvt.push([0x40; 16])),
        ("F_ut", |t| t.f_ut.truncate(1)),
        ("F_vt", |t| t.f_vt.clear()),
        ("weights", |t| t.mlp.truncate(1)),
        ("knots", |t| t.knots.truncate(1)),
        ("time axis", |t| t.axis.places.truncate(1)),
        ("gates", |t| t.gates.clear()),
        ("uvt: 33", |t| t.shape.contents.uvt = 33),
        ("hidden: 17", |t| t.shape.hidden = 17),
        ("width: 0", |t| t.shape.width = 0),
        ("height: 6", |t| t.shape.height = 6),
        ("frames: 0", |t| t.shape.frames = 0),
        ("width: 18446744073709551615", |t| t.shape.width = usize::MAX),
        ("rows: 0", |t| t.shape.rows = 0),
    ];
    for (what, edit) in edits {
        let mut tile = good.clone();
        edit(&mut tile);
        let message = TileDecoder::new(&tile, &timeline).unwrap_err().to_string();
        assert!(message.contains(what) && message.contains("expected"), "{what}: {message}");
    }
}

#[test]
fn axes_clamp_and_wrap() {
    assert_eq!(clamped(0.0, 4), (0, 1, 0.0));
    assert_eq!(clamped(0.5, 4), (1, 2, 0.5));
    assert_eq!(clamped(1.0, 4), (3, 3, 0.0));
    assert_eq!(periodic(0.0, 4), (3, 0, 0.5));
    assert_eq!(periodic(1.0, 4), (3, 0, 0.5));
    assert_eq!(periodic(0.375, 4), (1, 2, 0.0));
    // Of a time close to a slice's own the share is as exact as of others.
    let (_, _, share) = periodic(20.5 / 24.0 + 1e-7, 24);
    assert!((share - 2.4e-6).abs() < 1e-9, "{share}");
    assert_eq!(periodic(0.7, 1).0, 0);
    assert_eq!(periodic(0.7, 1).1, 0);
}

#[test]
fn extreme_weights_and_means_stay_finite() {
    for profile in &PROFILES {
        let contents = profile.contents(2, 0);
        let mut tile = testing::tile(Shape::new(&contents, 16, 8, 2, Coding::Standard), 3);
        for (i, w) in tile.mlp.iter_mut().enumerate() {
            *w = if i % 7 == 3 { F16::MIN } else { F16::MAX };
        }
        tile.knots = [[f32::MAX, 0.0, f32::MIN_POSITIVE], [f32::MAX, 0.0, 1e-40]]
            .map(|mean| Knot { mean, ..Knot::default() })
            .to_vec();
        for coding in [Coding::Standard, Coding::Paper] {
            tile.shape.axis = coding == Coding::Standard;
            tile.axis =
                if tile.shape.axis { Axis { length: 2, places: vec![0, 1] } } else { Axis::default() };
            let timeline = Timeline {
                hours: vec![0.0, 12.0],
                between: vec![],
                intervals: vec![],
                states: vec![vec![]; 2],
                coding,
            };
            for hour in [0.0, 3.0] {
                let point = timeline.at(hour);
                let oracle: Vec<_> =
                    (0..128).map(|i| texel(&tile, &timeline, &point, i % 16, i / 16)).collect();
                let fast = TileDecoder::new(&tile, &timeline).unwrap().decode_tile(&point);
                for value in oracle.iter().chain(&fast).flatten() {
                    assert!(value.is_finite() && *value >= 0.0, "{value}");
                }
                assert!(fast.iter().all(|texel| texel[1] == 0.0), "a zero mean decodes to zero");
            }
        }
    }
}

#[test]
fn pages_and_samples_agree_at_texel_centres_and_across_tiles() {
    let (header, _, bytes) = testing::bundle();
    let decoder = Decoder::new(bundle::Bundle::from_bytes(bytes).unwrap());
    for hour in [0.0, 3.1, 5.95, 18.05, 23.0] {
        for (page, grid) in header.pages.iter().enumerate() {
            let image = decoder.decode_page(page, hour).unwrap();
            assert_eq!((image.width, image.height), (grid.width, grid.height));
            for (i, texel) in image.texels.iter().enumerate() {
                let (x, y) = (i % grid.width, i / grid.width);
                let (u, v) = ((x as f64 + 0.5) / grid.width as f64, (y as f64 + 0.5) / grid.height as f64);
                let sample = decoder.sample(page, u, v, hour).unwrap();
                for c in 0..3 {
                    // u and v are rounded, so a little of a neighbour comes in.
                    assert!(
                        (sample[c] - texel[c]).abs() <= 1e-3 * texel[c].max(0.1),
                        "{page} {x} {y}: {sample:?} {texel:?}"
                    );
                }
            }
            for corner in [(0.0, 0.0), (1.0, 1.0), (-3.0, 2.0), (f64::INFINITY, 0.5)] {
                assert!(
                    decoder.sample(page, corner.0, corner.1, hour).unwrap().iter().all(|e| e.is_finite())
                );
            }
        }
    }
    for missing in [decoder.sample(2, 0.5, 0.5, 0.0).err(), decoder.decode_page(2, 0.0).err()] {
        assert_eq!(missing.unwrap().to_string(), "bundle, page 2: the bundle has 2 pages, counted from 0");
    }
}

#[test]
fn hours_and_coordinates_that_are_not_numbers_are_errors() {
    let decoder = Decoder::new(bundle::Bundle::from_bytes(testing::bundle().2).unwrap());
    for (u, v, hour, expected) in [
        (0.5, 0.5, f64::NAN, "hour: NaN; expected a finite number"),
        (0.5, 0.5, f64::NEG_INFINITY, "hour: -inf; expected a finite number"),
        (f64::NAN, 0.5, 12.0, "u: NaN; expected a number"),
        (0.5, f64::NAN, 12.0, "v: NaN; expected a number"),
    ] {
        assert_eq!(decoder.sample(0, u, v, hour).unwrap_err().to_string(), expected);
    }
    for hour in [-1.0, 25.0, 1e300] {
        assert!(decoder.sample(0, 0.5, 0.5, hour).is_ok(), "{hour}");
    }
}

#[test]
fn filtering_stays_inside_one_tile_and_is_linear_between_its_texels() {
    let (header, _, bytes) = testing::bundle();
    let decoder = Decoder::new(bundle::Bundle::from_bytes(bytes).unwrap());
    let Grid { width, height } = header.pages[0];
    // Between the last texel of the first tile and the first of the second, the first tile's own border is
    // read.
    let tile = decoder.tile(Place { page: 0, column: 0, row: 0 }).unwrap().unwrap();
    let point = header.timeline.at(0.0);
    let stored = |x, y| texel(&tile, &header.timeline, &point, x, y);
    let (a, b) = (stored(BORDER + PAYLOAD - 1, BORDER), stored(BORDER + PAYLOAD, BORDER));
    let sample = decoder
        .sample(0, (PAYLOAD as f64 + 0.25 - 0.5 + 0.5) / width as f64, 0.5 / height as f64, 0.0)
        .unwrap();
    for c in 0..3 {
        let expected = 0.25 * a[c] + 0.75 * b[c];
        assert!((sample[c] - expected).abs() <= 1e-3 * expected.max(0.1), "{sample:?} {a:?} {b:?}");
    }
    // At the page's edge the border is read, half and half.
    let (a, b) = (stored(0, BORDER), stored(1, BORDER));
    let sample = decoder.sample(0, 0.0, 0.5 / height as f64, 0.0).unwrap();
    for c in 0..3 {
        assert!((sample[c] - 0.5 * (a[c] + b[c])).abs() <= 1e-3 * a[c].max(b[c]).max(0.1));
    }
}

#[test]
fn a_page_that_no_memory_holds_is_an_error() {
    let (_, _, bytes) = testing::bundle();
    let mut bundle = bundle::Bundle::from_bytes(bytes).unwrap();
    // More than the address space of a processor has.
    bundle.header.pages[0] = Grid { width: 1 << 27, height: 1 << 26 };
    let message = Decoder::new(bundle).decode_page(0, 12.0).unwrap_err().to_string();
    assert!(message.contains("page 0") && message.contains("134217728 × 67108864"), "{message}");
}
