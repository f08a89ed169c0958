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
    TileSun { width, height, times, levels, normals: vec![[0.0, 1.0, 0.0]; width * height] }
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
            assert!(section.bytes.is_empty(), "{i}");
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
