//! Sets as bytes and back, light by vectors and by formulae, hostile bytes.

use super::light::{Source, decode};
use super::*;
use crate::bundle::{self, Bundle};
use crate::decode::Decoder;
use crate::lanes::Tier;
use crate::testing::{Random, basis_bundle, basis_parts, plane_set};
use std::sync::Arc;

const FRAMES: usize = 4;

fn section(size: [usize; 2], seed: u64) -> (Vec<PlaneSet>, crate::model::Section) {
    let sets = [(0, 9, FRAMES), (2, 1, 1), (7, 0, 1)].map(|(source, planes, frames)| {
        let set = plane_set(source, size, planes, frames, seed + u64::from(source));
        let bytes = encode(&set, size[0]);
        (set, bytes)
    });
    let section = encode_section(&sets).unwrap();
    (sets.map(|(set, _)| set).to_vec(), section)
}

fn frames(source: u16) -> Option<usize> {
    Some(if source == 0 { FRAMES } else { 1 })
}

#[test]
fn what_is_written_is_read() {
    for (i, size) in [[128, 128], [4, 4], [128, 12], [60, 128], [8, 8]].into_iter().enumerate() {
        let (sets, section) = section(size, 20 * i as u64);
        let found = decode_section(&section.bytes, section.word, size, frames).unwrap();
        assert!(found == sets, "{size:?}");
        assert_eq!(section.word, 10);
    }
    // The least and the largest of everything.
    let extreme = PlaneSet {
        source: 0,
        step: 255,
        chroma: 255,
        weights: vec![-255, 0],
        scales: vec![0, 255],
        factors: (0..12).map(|i| (3 << (2 * i)).min(1 << 24) * if i % 2 == 0 { 1 } else { -1 }).collect(),
        covered: vec![true, false, true],
        coefficients: [i16::MAX, -i16::MAX, 1, 0, 15, -16].map(|value| [value; 64]).to_vec(),
        is_linear: true,
    };
    let mut expected = extreme.clone();
    // Blocks that are not covered are not stored.
    (expected.coefficients[1], expected.coefficients[4]) = ([0; 64], [0; 64]);
    let stored = encode_section(&[(extreme.clone(), encode(&extreme, 24))]).unwrap();
    assert_eq!(decode_section(&stored.bytes, stored.word, [24, 8], |_| Some(2)).unwrap(), [expected]);
}

/// Light by the formulae, from what is stored, in double precision.
fn oracle(set: &PlaneSet, width: usize, frame: usize, means: [f64; 3], [x, y]: [usize; 2]) -> [f64; 3] {
    let step = 2f64.powf(-f64::from(set.step) / 8.0);
    let (columns, blocks) = (width.div_ceil(8), set.covered.len());
    let block = (y / 8) * columns + x / 8;
    let plane = |k: usize| {
        let coefficients = &set.coefficients[k * blocks + block];
        let cosine = |k: usize, n: usize| {
            let scale = if k == 0 { 0.125f64.sqrt() } else { 0.5 };
            scale * (std::f64::consts::PI * ((2 * n + 1) * k) as f64 / 16.0).cos()
        };
        (0..64).map(|i| f64::from(coefficients[i]) * cosine(i / 8, y % 8) * cosine(i % 8, x % 8)).sum::<f64>()
    };
    let planes: Vec<f64> = (0..set.planes()).map(plane).collect();
    let row = |j: usize| {
        let at = 3 * frame + j;
        let mut sum = 0.0;
        for (k, plane) in planes.iter().enumerate() {
            let unit = 2f64.powf(-f64::from(set.scales[k]) / 8.0);
            sum += f64::from(set.factors[k * 3 * set.weights.len() + at]) * unit * plane * step;
        }
        sum * 2f64.powf(-f64::from(set.weights[frame]) / 8.0)
    };
    let chroma = f64::from(set.chroma) / 16.0;
    let [l, u, v] = [row(0), row(1) / chroma, row(2) / chroma];
    let (third, half, sixth) = (1.0 / 3f64.sqrt(), 0.5f64.sqrt(), 1.0 / 6f64.sqrt());
    let rgb =
        [third * l + half * u - sixth * v, third * l + 2.0 * sixth * v, third * l - half * u - sixth * v];
    std::array::from_fn(|c| {
        let y = rgb[c].max(0.0);
        means[c] * if set.is_linear { y } else { y * y }
    })
}

#[test]
fn light_is_that_of_the_formulae_by_every_tier() {
    for (i, [width, height]) in [[128, 20], [4, 4], [36, 12], [100, 128]].into_iter().enumerate() {
        let sets = [(0, 7, FRAMES), (1, 2, 1), (3, 0, 1)]
            .map(|(source, planes, frames)| {
                plane_set(source, [width, height], planes, frames, 40 + 3 * i as u64 + u64::from(source))
            })
            .to_vec();
        let unpacked: Vec<Arc<Unpacked>> =
            sets.iter().map(|set| Arc::new(Unpacked::new(set, [width, height]))).collect();
        for frame in 0..FRAMES {
            let source = |unpacked: &Arc<Unpacked>| {
                let frame = frame.min(unpacked.frames - 1);
                let means = [1.0, 0.3, 2.0 + f32::from(unpacked.source)];
                Source { unpacked: Arc::clone(unpacked), factors: unpacked.factors(frame, frame, 0.0), means }
            };
            let sources: Vec<Source> = unpacked.iter().map(source).collect();
            for tier in Tier::available() {
                let mut out = vec![[7.0; 3]; width * height];
                decode(tier, &sources, width, &mut out);
                let at = PlanesAt::of(tier, width, sources.clone());
                for (i, found) in out.iter().enumerate() {
                    let (x, y) = (i % width, i / width);
                    let expected = sets.iter().zip(&sources).fold([0.0; 3], |sum, (set, source)| {
                        let frame = frame.min(set.weights.len() - 1);
                        let light = oracle(set, width, frame, source.means.map(f64::from), [x, y]);
                        [0, 1, 2].map(|c| sum[c] + light[c])
                    });
                    let texel = at.texel(x, y);
                    for c in 0..3 {
                        // (Planes are rounded to a sixteenth of a step, whose factors are up to 1.)
                        let error = f64::from(found[c]) - expected[c];
                        assert!(
                            error.abs() < 0.03 * expected[c].max(0.2),
                            "{tier:?} {x} {y}: {found:?} {expected:?}"
                        );
                        assert!(
                            (found[c] - texel[c]).abs() <= 1e-5 * texel[c].max(0.1),
                            "{found:?} {texel:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn factors_are_mixed_between_frames() {
    let unpacked = Unpacked::new(&plane_set(0, [16, 16], 3, FRAMES, 1), [16, 16]);
    let (a, b) = (unpacked.factors(0, 0, 0.0), unpacked.factors(2, 2, 0.0));
    let mixed = unpacked.factors(0, 2, 0.25);
    for i in 0..a.len() {
        assert!((mixed[i] - (0.75 * a[i] + 0.25 * b[i])).abs() < 1e-6);
    }
}

#[test]
fn hostile_sections_are_errors_or_finite_light() {
    let size = [36, 20];
    let (_, good) = section(size, 5);
    let mut random = Random(9);
    let (mut accepted, mut refused) = (0, 0);
    for round in 0..2000 {
        let (mut bytes, mut word) = (good.bytes.clone(), good.word);
        for _ in 0..1 + random.below(4) {
            // The directory as often as all else.
            let at = if round % 2 == 0 { random.below(28) } else { random.below(bytes.len()) };
            match random.below(4) {
                0 => bytes[at] ^= 1 << random.below(8),
                1 => bytes[at] = random.byte(),
                2 => bytes[at..].iter_mut().take(4).for_each(|byte| *byte = 0xff),
                _ => word = random.draw() as u32 >> random.below(32),
            }
        }
        if random.below(8) == 0 {
            bytes.truncate(random.below(bytes.len()));
        }
        let Ok(sets) = decode_section(&bytes, word, size, frames) else {
            refused += 1;
            continue;
        };
        accepted += 1;
        let source = |set: &PlaneSet| {
            let unpacked = Arc::new(Unpacked::new(set, size));
            Source { factors: unpacked.factors(0, 0, 0.0), unpacked, means: [f32::MAX, 1.0, 0.0] }
        };
        let sources: Vec<Source> = sets.iter().map(source).collect();
        for tier in Tier::available() {
            let mut out = vec![[0.0; 3]; size[0] * size[1]];
            decode(tier, &sources, size[0], &mut out);
            let at = PlanesAt::of(tier, size[0], sources.clone());
            assert!(out.iter().flatten().all(|light| light.is_finite() && *light >= 0.0));
            assert!(at.texel(3, 5).iter().all(|light| light.is_finite() && *light >= 0.0));
        }
    }
    assert!(accepted > 100 && refused > 100, "{accepted} {refused}");
}

#[test]
fn a_bundle_of_planes_is_decoded_at_any_time() {
    let decoder = Decoder::new(Bundle::from_bytes(basis_bundle()).unwrap());
    let bundle = decoder.bundle();
    bundle.verify().unwrap();
    let (header, payloads) = basis_parts();
    assert_eq!(bundle.header, header);
    assert_eq!(bundle::encode(&header, &payloads).unwrap(), basis_bundle());
    let mut lit = 0;
    for hour in [0.0, 1.5, 4.0, 5.9, 5.95, 6.0, 12.0, 18.0, 18.05, 18.1, 19.0, 21.7, 23.9] {
        for page in 0..2 {
            let image = decoder.decode_page(page, hour).unwrap();
            assert!(image.texels.iter().flatten().all(|light| light.is_finite() && *light >= 0.0));
            lit += image.texels.iter().filter(|texel| **texel != [0.0; 3]).count();
            let mut at = bundle.at(hour).unwrap().page(page).unwrap();
            for (x, y) in [(0, 0), (image.width - 1, image.height - 1), (image.width / 2, 3)] {
                let (found, expected) = (at.texel(x, y).unwrap(), image.texels[y * image.width + x]);
                for c in 0..3 {
                    assert!(
                        (found[c] - expected[c]).abs() <= 1e-5 * expected[c].max(0.1),
                        "{found:?} {expected:?}"
                    );
                }
            }
        }
    }
    assert!(lit > 1000, "{lit}");
}

#[test]
fn lamps_that_are_apart_switch_and_daylight_goes_on() {
    let bundle = Bundle::from_bytes(basis_bundle()).unwrap();
    let place = crate::grid::Place { page: 0, column: 0, row: 0 };
    let planes = bundle.planes(place).unwrap().unwrap();
    assert_eq!(planes.sources.iter().map(|source| source.source).collect::<Vec<_>>(), [0, 1]);
    // The porch is on from 18 to 6; at a frame's hour, as in the frame.
    let mean = |hour: f64| {
        let tile = bundle.at(hour).unwrap().tile(place).unwrap();
        let mut texels = vec![[0.0; 3]; tile.width() * tile.height()];
        tile.decode_into(&mut texels);
        texels.iter().flatten().map(|light| f64::from(*light)).sum::<f64>() / texels.len() as f64
    };
    let [before, after] = [17.999, 18.001].map(mean);
    let lamp = {
        let at = planes.at(&bundle.maps_timeline().at(6.0), |_| Some(0), |_| 1.0);
        let dark = planes.at(&bundle.maps_timeline().at(6.0), |_| Some(0), |_| 0.0);
        (at.sources.len(), dark.sources.len())
    };
    assert_eq!(lamp, (1 + dark_frame(&bundle, place, 2), dark_frame(&bundle, place, 2)));
    assert!(after > before * 1.05, "{before} {after}");
    // Daylight is not held at the switch.
    let drift = (mean(18.02) - mean(18.001)).abs();
    assert!(drift > 1e-7, "{drift}");
    // Brightness counts the lamp when it is on, and planes that were unpacked are kept.
    let knots = bundle.knots(place).unwrap();
    let brightness = bundle.brightness(place).unwrap();
    for (i, hour) in bundle.header.timeline.knots().iter().enumerate() {
        let is_on = bundle.header.timeline.is_on(0, *hour);
        let sum = brightness.knots[i].mean[0] + if is_on { brightness.lamps[0].mean[0] } else { 0.0 };
        assert!((knots[i].mean[0] - sum).abs() < 1e-6);
    }
    assert!(Arc::ptr_eq(&planes, &bundle.planes(place).unwrap().unwrap()));
}

/// 1 if daylight lights a frame, else 0.
fn dark_frame(bundle: &Bundle, place: crate::grid::Place, frame: usize) -> usize {
    let knot = bundle.brightness(place).unwrap().knots[bundle.header.timeline.knot_of(frame)];
    usize::from(knot.mean != [0.0; 3])
}
