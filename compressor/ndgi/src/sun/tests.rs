//! Tiles of the sun there and back.

use super::*;
use crate::testing::Random;

/// Tables for some tiles.
fn tables(tiles: &[TileSun]) -> Tables {
    let mut tables = None;
    for _ in 0..2 {
        let coder = tables.as_ref().map(Coder::new);
        let mut counts = Counts::default();
        tiles.iter().for_each(|tile| tile.count(coder.as_ref(), &mut counts));
        tables = Some(counts.tables());
    }
    tables.unwrap()
}

fn tile(
    size: [usize; 2],
    times: usize,
    channels: usize,
    level: impl Fn(usize, usize, usize) -> u8,
) -> TileSun {
    let [width, height] = size;
    let levels = (0..channels * times)
        .flat_map(|plane| (0..width * height).map(move |i| (plane, i)))
        .map(|(plane, i)| level(plane, i % width, i / width))
        .collect();
    let normals = vec![[0.0, 1.0, 0.0]; width * height];
    TileSun { width, height, times, levels, normals, shadows: Shadows::default() }
}

/// A shadow's edge that moves, soft over some texels.
fn edge(plane: usize, x: usize, y: usize) -> u8 {
    (x as i32 + y as i32 / 3 - 9 * plane as i32).clamp(0, 7) as u8
}

#[test]
fn levels_come_back_as_they_were() {
    let random = |seed: u64| {
        let mut random = Random(seed);
        let noise: Vec<u8> = (0..4 * 128 * 128).map(|_| random.below(8) as u8).collect();
        move |plane: usize, x: usize, y: usize| noise[(plane * 128 + y) * 128 + x]
    };
    let tiles = [
        tile([128, 128], 4, 1, edge),
        tile([128, 128], 4, 1, random(1)),
        tile([4, 4], 4, 1, random(2)),
        tile([12, 100], 4, 1, edge),
        tile([36, 8], 4, 3, edge),
        // One texel of each state; never; always; lit but for one time.
        tile([16, 16], 4, 1, |_, x, y| if (x, y) == (5, 9) { 3 } else { 0 }),
        tile([16, 16], 4, 1, |_, x, y| if (x, y) == (5, 9) { 0 } else { 7 }),
        tile([16, 16], 4, 1, |_, _, _| 0),
        tile([16, 16], 4, 1, |_, _, _| 7),
        tile([16, 16], 4, 1, |plane, _, _| if plane == 2 { 0 } else { 7 }),
        // What does not matter, in part and all of it.
        tile([32, 32], 4, 1, |plane, x, y| if (x + y) % 3 == 0 { TileSun::ANY } else { edge(plane, x, y) }),
        tile([32, 32], 4, 1, |_, _, _| TileSun::ANY),
    ];
    let sun = Sun { tables: tables(&tiles), times: vec![1.0, 2.0, 3.0, 4.0], ..Sun::default() };
    let (coder, decoder) = (Coder::new(&sun.tables), SunDecoder::new(&sun));
    for (i, tile) in tiles.iter().enumerate() {
        let section = tile.encode(&coder);
        if [7, 11].contains(&i) {
            // Dark at all times: what may be lit between them has normals.
            let never = TileSun { normals: vec![[0.0; 3]; tile.normals.len()], ..tile.clone() };
            assert!(never.encode(&coder).bytes.is_empty() && !section.bytes.is_empty(), "{i}");
            continue;
        }
        let found = decoder.tile(&section.bytes, section.word, [tile.width, tile.height]).unwrap();
        for (wanted, level) in tile.levels.iter().zip(&found.levels) {
            assert!(*level <= TileSun::TOP && [*level, TileSun::ANY].contains(wanted), "{i}");
        }
        let is_up = |normal: &[f32; 3]| (normal[1] - 1.0).abs() < 1e-3 || *normal == [0.0; 3];
        assert!(found.normals.iter().all(is_up), "{i}");
        assert!(i != 8 || section.bytes.len() == 16, "all lit: {} bytes", section.bytes.len());
        for length in (0..section.bytes.len()).step_by(16) {
            let cut = &section.bytes[..length];
            assert!(decoder.tile(cut, section.word, [tile.width, tile.height]).is_err(), "{i}: {length}");
        }
    }
    // Noise takes its three bits a texel, or about: tables were made of it.
    let bits = 8.0 * tiles[1].encode(&coder).bytes.len() as f64 / (4.0 * 128.0 * 128.0);
    assert!((2.5..6.0).contains(&bits), "{bits}");
}

#[test]
fn hostile_sections_are_refused_or_harmless() {
    let tiles = [tile([48, 40], 3, 1, edge), tile([48, 40], 3, 3, edge)];
    let sun = Sun { tables: tables(&tiles), times: vec![1.0, 2.0, 3.0], ..Sun::default() };
    let (coder, decoder) = (Coder::new(&sun.tables), SunDecoder::new(&sun));
    let mut random = Random(9);
    let mut refused = 0;
    for tile in &tiles {
        let section = tile.encode(&coder);
        for _ in 0..20_000 {
            let mut bad = section.clone();
            for _ in 0..1 + random.below(3) {
                let at = random.below(bad.bytes.len());
                bad.bytes[at] = random.byte();
            }
            if random.below(4) == 0 {
                bad.word ^= 1 << random.below(32);
            }
            match decoder.tile(&bad.bytes, bad.word, [48, 40]) {
                Ok(found) => assert!(found.levels.iter().all(|level| *level <= TileSun::TOP)),
                Err(_) => refused += 1,
            }
        }
    }
    assert!(refused > 30_000, "{refused}");
}

#[test]
fn light_is_seen_times_faced_times_bright_and_linear_between_times() {
    let tile = tile([4, 4], 2, 1, |plane, x, _| if plane == 0 { 7 } else { 2 * x as u8 });
    let path = SunPath {
        hours: vec![6.0, 18.0],
        direction: vec![[0.0, 0.5, 0.0], [0.0, 1.0, 0.0]],
        irradiance: vec![[10.0, 20.0, 0.0]; 2],
    };
    let sun = Sun { path, times: vec![8.0, 16.0], tables: Tables::default() };
    sun.check().unwrap();
    let at = |hour: f64| {
        let mut light = vec![[1.0; 3]; 16];
        tile.add_light(&sun, hour, &mut light);
        assert_eq!(tile.texel(&sun, hour, 3).map(|e| e + 1.0), light[3]);
        light[3]
    };
    // Before the first time what is seen then; before the path nothing.
    assert_eq!(at(7.0), [1.0 + 10.0 * (0.5 + 0.5 / 12.0), 1.0 + 20.0 * (0.5 + 0.5 / 12.0), 1.0]);
    assert_eq!((at(5.9), at(18.1)), ([1.0; 3], [1.0; 3]));
    let seen = 0.5 * (1.0 + 6.0 / 7.0);
    assert!((at(12.0)[0] - 1.0 - 10.0 * 0.75 * seen).abs() < 1e-5);
    assert!((at(17.0)[0] - 1.0 - 10.0 * (1.0 - 0.5 / 12.0) * 6.0 / 7.0).abs() < 1e-5);
}

/// A random block: nothing, a doubled word, at most one word on each 4×4, or up to three.
fn block(random: &mut Random) -> Block {
    let word = |random: &mut Random| Word(random.draw() as u16);
    match random.below(4) {
        0 => Block::Nothing,
        1 => Block::Doubled(word(random)),
        most => Block::Words([(); 4].map(|()| {
            let count = random.below(if most == 2 { 2 } else { MOST + 1 });
            (0..count).map(|_| word(random)).collect()
        })),
    }
}

#[test]
fn moving_shadows_come_back_texel_by_texel() {
    let mut random = Random(4);
    for (size, channels) in [([128, 128], 1), ([4, 4], 1), ([44, 68], 3), ([12, 128], 1)] {
        let [width, height]: [usize; 2] = size;
        let intervals = 3;
        let count = width.div_ceil(8) * height.div_ceil(8);
        let mut planes: Vec<Vec<Block>> =
            (0..channels * intervals).map(|_| (0..count).map(|_| block(&mut random)).collect()).collect();
        // One where nothing moves.
        planes[1] = vec![Block::Nothing; count];
        let section = encode_shadows(&planes, size);
        let mut tile = tile(size, intervals + 1, channels, |plane, x, y| ((3 * plane + x + y / 2) % 8) as u8);
        let path = SunPath {
            hours: vec![0.0, 24.0],
            direction: vec![[0.0, 1.0, 0.0]; 2],
            irradiance: vec![[1.0; 3]; 2],
        };
        let times = vec![6.0, 7.0, 9.0, 10.0];
        let sun = Sun { path, times: times.clone(), tables: Tables::default() };
        let decode = |only| Shadows::decode((0, &section.bytes), size, channels, intervals, only).unwrap();
        let linear = tile.clone();
        tile.shadows = decode(None);
        let mut moves = 0.0f32;
        for (interval, share) in [(0, 0.0), (0, 0.3), (1, 0.5), (2, 0.041), (2, 11.5 / 12.0)] {
            let hour = times[interval] + share * (times[interval + 1] - times[interval]);
            let seen = tile.visibility(&sun, hour);
            let mut light = vec![[0.0; 3]; width * height];
            tile.add_light(&sun, hour, &mut light);
            // By the format's words, one texel at a time.
            let step = (share as f32 * 12.0) as usize;
            let part = share as f32 * 12.0 - step as f32;
            for (i, light) in light.iter().enumerate() {
                let (x, y) = (i % width, i / width);
                for c in 0..3 {
                    let plane = c.min(channels - 1) * intervals + interval;
                    let ends = [interval, interval + 1].map(|time| {
                        let plane = c.min(channels - 1) * (intervals + 1) + time;
                        f32::from(tile.levels[plane * width * height + i]) / 7.0
                    });
                    let block = &planes[plane][y / 8 * width.div_ceil(8) + x / 8];
                    let at = |step: usize| {
                        let mut v = ends[0] + (ends[1] - ends[0]) * step as f32 / 12.0;
                        let (words, i) = match block {
                            Block::Nothing => (vec![], 0),
                            Block::Doubled(word) => (vec![*word], y % 8 / 2 * 4 + x % 8 / 2),
                            Block::Words(of) => (of[y % 8 / 4 * 2 + x % 8 / 4].clone(), y % 4 * 4 + x % 4),
                        };
                        words.iter().for_each(|word| {
                            v = (v + f32::from(word.values(step)[i]) / 7.0).clamp(0.0, 1.0);
                        });
                        v
                    };
                    let wanted = at(step) * (1.0 - part) + at(step + 1) * part;
                    let found = [seen[i][c], light[c], tile.texel(&sun, hour, i)[c]];
                    assert!(found.iter().all(|v| (v - wanted).abs() < 1e-5), "{found:?} {wanted}");
                }
            }
            let still = linear.visibility(&sun, hour);
            let most = still.iter().zip(&seen).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0, f32::max);
            match (interval, share) {
                (1, _) | (_, 0.0) => assert!(most < 1e-6, "{most}"),
                _ => moves = moves.max(most),
            }
            // Of one interval alone the same.
            let levels = (0..channels).flat_map(|c| {
                let of = (c * (intervals + 1) + interval) * width * height;
                tile.levels[of..of + 2 * width * height].to_vec()
            });
            let near = TileSun {
                levels: levels.collect(),
                times: 2,
                shadows: decode(Some(interval)),
                ..tile.clone()
            };
            let sun = Sun { times: times[interval..interval + 2].to_vec(), ..sun.clone() };
            assert_eq!(near.visibility(&sun, hour), seen);
        }
        assert!(moves > 0.2, "{moves}");
    }
    let still = encode_shadows(&vec![vec![Block::default(); 4]; 2], [16, 16]);
    assert!(still.bytes.is_empty());
}

#[test]
fn moving_shadows_have_one_coding() {
    // One group of a tile of 32², one word on one 4×4, one nibble of four that are there.
    let mut blocks = vec![Block::Nothing; 16];
    blocks[3] = Block::Words([vec![Word::new(5, 0)], vec![], vec![], vec![]]);
    let section = encode_shadows(&[blocks], [32, 32]);
    let decode = |bytes: &[u8]| Shadows::decode((0, bytes), [32, 32], 1, 1, None);
    decode(&section.bytes).unwrap();
    // The end of the part, the group's length, a zero, modes, nibbles, the word.
    for (at, bits) in [(5, 1), (10, 0x10), (11, 1), (11, 0x80)] {
        let mut bytes = section.bytes.clone();
        bytes[at] ^= bits;
        assert!(decode(&bytes).unwrap_err().contains("padded"), "{at}");
    }
    let mut bytes = section.bytes.clone();
    bytes[6..10].fill(0);
    assert!(decode(&bytes).is_err());
}

#[test]
fn hostile_moving_shadows_are_refused_or_harmless() {
    let (mut random, size) = (Random(11), [72, 40]);
    let planes: Vec<Vec<Block>> = (0..4).map(|_| (0..45).map(|_| block(&mut random)).collect()).collect();
    let section = encode_shadows(&planes, size);
    let decode = |bytes: &[u8], word| Shadows::decode((word, bytes), size, 1, 4, None);
    assert!(decode(&section.bytes, 0).is_ok() && decode(&section.bytes, 1).is_err());
    for length in (0..section.bytes.len()).step_by(16) {
        assert!(decode(&section.bytes[..length], 0).is_err(), "{length}");
    }
    let mut tile = tile(size, 5, 1, edge);
    let sun = Sun { times: vec![1.0, 2.0, 3.0, 4.0, 5.0], ..Sun::default() };
    let mut refused = 0;
    for _ in 0..5_000 {
        let mut bad = section.bytes.clone();
        for _ in 0..1 + random.below(3) {
            let near = if random.below(2) == 0 { 60 } else { bad.len() };
            let at = random.below(near);
            bad[at] = random.byte();
        }
        match decode(&bad, 0) {
            Ok(shadows) => {
                tile.shadows = shadows;
                let seen = tile.visibility(&sun, 1.0 + 4.0 * f64::from(random.unit()));
                assert!(seen.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
            }
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 2_000, "{refused}");
}

#[test]
fn words_add_whole_sevenths_of_what_is_seen() {
    let table = include_bytes!("words.bin");
    let digest = blake3::hash(table).to_hex();
    assert!(include_str!("../../../FORMAT.md").contains(digest.as_str()), "{digest}");
    for entry in 0..ENTRIES {
        for step in 1..STEPS {
            assert!(Word::entry(entry, step).iter().all(|value| (-7..=7).contains(value)));
        }
    }
    // A turning moves values about and may negate them; each of the 32 is another.
    let all = |turning: usize| {
        let word = Word::new(5, turning);
        (1..STEPS).flat_map(|step| word.values(step)).collect::<Vec<i8>>()
    };
    let sorted = |mut values: Vec<i8>| {
        values.iter_mut().for_each(|value| *value = value.abs());
        values.sort_unstable();
        values
    };
    let distinct: std::collections::BTreeSet<Vec<i8>> = (0..32).map(all).collect();
    assert!(distinct.len() == 32 && distinct.iter().all(|values| sorted(values.clone()) == sorted(all(0))));
}
