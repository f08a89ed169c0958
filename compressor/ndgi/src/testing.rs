//! Random tiles and bundles for tests.

#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use crate::bc7::{self, Block, Mode};
use crate::bundle::{self, Header, MapCoding, PageKind, Payload};
use crate::grid::{Grid, Place};
use crate::half::F16;
use crate::model::{Brightness, Contents, Knot, Profile, Section, Shape, TileParams};
use crate::planes::{self, PlaneSet};
use crate::sun::{self, Coder, Counts, Shadows, Sun, SunPath, TileSun, Word};
use crate::time::{Axis, Coding, Timeline, is_on};

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    pub fn draw(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn byte(&mut self) -> u8 {
        self.draw() as u8
    }

    /// Uniform in [0, n).
    pub fn below(&mut self, n: usize) -> usize {
        (self.draw() % n as u64) as usize
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.draw() >> 40) as f32 / (1 << 24) as f32
    }
}

/// A tile of random features, and a decoder whose outputs are of order one.
pub fn tile(shape: Shape, seed: u64) -> TileParams {
    let mut random = Random(seed);
    let mut blocks = |n: usize| -> Vec<[u8; 16]> {
        (0..n)
            .map(|_| {
                let endpoint = |random: &mut Random| {
                    let p = random.byte() & 1;
                    std::array::from_fn(|_| random.byte() & !1 | p)
                };
                let endpoints = [endpoint(&mut random), endpoint(&mut random)];
                let mode =
                    if random.byte() < 128 { Mode::Six } else { Mode::FOURS[usize::from(random.byte() & 7)] };
                let last = mode.values() as u8 - 1;
                bc7::encode(&Block {
                    mode,
                    endpoints,
                    indices: std::array::from_fn(|_| random.byte() & last),
                })
            })
            .collect()
    };
    let [uv, uvt, ut, vt] = shape.counts();
    let (f_uv, f_uvt) = (blocks(uv), blocks(uvt));
    let mut plane = |n: usize| (0..n).map(|_| [random.byte(), random.byte()]).collect();
    let (f_ut, f_vt) = (plane(ut), plane(vt));
    let mlp = (0..shape.mlp_len()).map(|_| F16::from_f32(random.unit() - 0.45)).collect();
    // In whole steps of what a resident block holds.
    let mut mean = || (2048.0 * random.unit()).floor() / 2048.0;
    let knot = |_| Knot { mean: [mean(), 8.0 * mean(), 0.0], ..Knot::default() };
    let knots = (0..shape.frames).map(knot).collect();
    // Frames in pairs on the axis, the last ones with the first.
    let place = |k: usize| (3 * (k / 2 % (shape.frames / 2).max(1))) as u16;
    let axis = match shape.axis {
        true => Axis { length: 2 * shape.frames as u16, places: (0..shape.frames).map(place).collect() },
        false => Axis::default(),
    };
    let gates = (0..shape.contents.gates as u16).collect();
    TileParams { shape, f_uv, f_uvt, f_ut, f_vt, mlp, knots, axis, gates }
}

/// A header with two small pages (2 + 1 tiles), 4 frames and two light groups.
pub fn header() -> Header {
    let hours = vec![0.0, 5.9, 6.0, 18.1];
    let intervals = vec![vec![[18.0, 6.0]], vec![[0.0, 24.0], [3.0, 4.0]]];
    let states = hours.iter().map(|&h| intervals.iter().map(|on| is_on(on, h)).collect()).collect();
    Header {
        scene: "yard".to_owned(),
        info: "{\"seed\":1}".to_owned(),
        pages: vec![Grid { width: 128, height: 5 }, Grid { width: 9, height: 1 }],
        kinds: vec![PageKind::Atlas, PageKind::Probes],
        groups: vec!["porch".to_owned(), "garden".to_owned()],
        apart: vec![false; 2],
        coding: MapCoding::Neural,
        timeline: Timeline { hours, between: vec![20.0], intervals, states, coding: Coding::Standard },
        sun: None,
        shadows: false,
    }
}

/// The tiles of [`bundle`]: all maps and a gate; black; some of F_uv and F_uvt omitted, no planes.
pub fn tile_of(header: &Header, i: usize, place: Place) -> Option<TileParams> {
    let all = Profile::M.contents(2, 1);
    let contents = match i {
        0 => all,
        1 => return None,
        _ => Contents { slices: 5, ut: false, vt: false, rows: 0, gamma: false, gates: 2, ..all },
    };
    let mut tile = tile(header.shape(place, &contents), i as u64);
    let dusk = dusk();
    tile.knots.push(dusk);
    if i > 1 {
        let grey = bc7::encode(&bc7::GREY);
        tile.f_uv[1..3].fill(grey);
        tile.f_uvt[..2].fill(grey);
    }
    Some(tile)
}

/// A bundle of [`header`] with random tiles.
pub fn bundle() -> (Header, Vec<Payload>, Vec<u8>) {
    let header = header();
    let payload = |(i, place)| match tile_of(&header, i, place) {
        None => Payload::default(),
        Some(tile) => bundle::encode_payload(&tile).unwrap(),
    };
    let payloads: Vec<_> = header.places().enumerate().map(payload).collect();
    let bytes = bundle::encode(&header, &payloads).unwrap();
    (header, payloads, bytes)
}

/// What a tile sees of the sun at some times: levels as noise or as an edge that moves, normals of all kinds,
/// and shadows that move.
pub fn sun_tile(size: [usize; 2], times: usize, channels: usize, seed: u64) -> TileSun {
    let [width, height] = size;
    let mut random = Random(seed);
    let edge =
        |plane: usize, x: usize, y: usize| (x as i32 + y as i32 / 3 - 9 * plane as i32).clamp(0, 7) as u8;
    let is_noise = seed.is_multiple_of(2);
    let levels = (0..channels * times).flat_map(|plane| (0..width * height).map(move |i| (plane, i)));
    let levels = levels.map(|(plane, i)| match is_noise {
        true => random.below(8) as u8,
        false => edge(plane, i % width, i / width),
    });
    let levels = levels.collect();
    // Blocks of one normal, of some, and of as many as texels.
    let normal = |i: usize| {
        let (x, y) = (i % width, i / width);
        let kinds = [1, 2, 3, 7, 16][(x / 4 + 3 * (y / 4)) % 5];
        let kind = (x * 5 + y * 3) % kinds + x / 16;
        let (a, b) = (0.4 * kind as f32, 0.3 + 0.05 * kind as f32);
        [a.sin() * b.sin(), b.cos(), a.cos() * b.sin()]
    };
    let normals = (0..width * height).map(normal).collect();
    let blocks = width.div_ceil(8) * height.div_ceil(8);
    let word = |random: &mut Random| Word(random.draw() as u16);
    let block = |random: &mut Random| match random.below(4) {
        0 => sun::Block::Nothing,
        1 => sun::Block::Doubled(word(random)),
        most => sun::Block::Words([(); 4].map(|()| {
            let count = random.below(if most == 2 { 2 } else { sun::MOST + 1 });
            (0..count).map(|_| word(random)).collect()
        })),
    };
    let planes: Vec<Vec<sun::Block>> =
        (0..channels * (times - 1)).map(|_| (0..blocks).map(|_| block(&mut random)).collect()).collect();
    let section = sun::encode_shadows(&planes, size);
    let shadows = Shadows::decode((0, &section.bytes), size, channels, times - 1, None).unwrap();
    TileSun { width, height, times, levels, normals, shadows }
}

/// A bundle of one page under a sun that moves: its tiles have features or none, one channel or three.
pub fn sunny_bundle() -> Vec<u8> {
    let (header, payloads) = sunny();
    bundle::encode(&header, &payloads).unwrap()
}

/// What [`sunny_bundle`] is made of.
pub fn sunny() -> (Header, Vec<Payload>) {
    sunny_pages(vec![Grid { width: 300, height: 140 }])
}

/// The same with other pages. The kinds of tiles come round after six.
pub fn sunny_pages(pages: Vec<Grid>) -> (Header, Vec<Payload>) {
    let mut header = header();
    header.kinds = vec![PageKind::Atlas; pages.len()];
    header.pages = pages;
    let times = vec![6.0, 7.5, 9.0, 13.0];
    let path = SunPath {
        hours: vec![5.5, 10.0, 14.0],
        direction: vec![[0.9, 0.1, 0.3], [0.2, 0.9, 0.3], [-0.8, 0.2, 0.5]],
        irradiance: vec![[0.0; 3], [90.0, 80.0, 70.0], [10.0, 4.0, 1.0]],
    };
    let places: Vec<Place> = header.places().collect();
    let tiles: Vec<Option<TileSun>> = places
        .iter()
        .enumerate()
        .map(|(i, place)| {
            let (width, height) = header.pages[place.page].stored(place.column, place.row);
            (i % 6 != 2)
                .then(|| sun_tile([width, height], times.len(), if i % 3 == 1 { 3 } else { 1 }, i as u64))
        })
        .collect();
    let mut tables = None;
    for _ in 0..2 {
        let coder = tables.as_ref().map(Coder::new);
        let mut counts = Counts::default();
        tiles.iter().flatten().for_each(|tile| tile.count(coder.as_ref(), &mut counts));
        tables = Some(counts.tables());
    }
    let tables = tables.unwrap();
    let coder = Coder::new(&tables);
    let payloads: Vec<Payload> = places
        .iter()
        .enumerate()
        .map(|(i, place)| {
            let mut payload = match i % 6 {
                0 | 4 => Payload::default(),
                of => {
                    let contents = (if of == 1 { Profile::S } else { Profile::M }).contents(4, 1);
                    let mut tile = tile(header.shape(*place, &contents), i as u64);
                    tile.knots.push(dusk());
                    bundle::encode_payload(&tile).unwrap()
                }
            };
            if let Some(tile) = &tiles[i] {
                payload.sun = tile.encode(&coder);
                // Stream 2 is as it is stored.
                payload.shadows = shadows_of(tile);
            }
            payload
        })
        .collect();
    header.sun = Some(Sun { path, times, tables: tables.clone() });
    header.shadows = true;
    (header, payloads)
}

/// The section of a tile's moving shadows.
fn shadows_of(tile: &TileSun) -> bundle::Section {
    let (channels, size) = (tile.channels(), [tile.width, tile.height]);
    let blocks = tile.width.div_ceil(8) * tile.height.div_ceil(8);
    let plane = |channel: usize, interval: usize| {
        let mut plane = vec![sun::Block::Nothing; blocks];
        let found = tile.shadows.blocks((channels, channel, interval), size);
        found.into_iter().for_each(|(i, block)| plane[i] = block);
        plane
    };
    let intervals = tile.times - 1;
    let planes: Vec<_> =
        (0..channels).flat_map(|c| (0..intervals).map(move |i| (c, i))).map(|(c, i)| plane(c, i)).collect();
    sun::encode_shadows(&planes, size)
}

/// The knot between frames of [`header`].
pub fn dusk() -> Knot {
    Knot { mean: [0.25, 1.5, 0.0], peak: 4.0, share: 51.0 / 255.0 }
}

/// A bundle whose light groups switch at the hour of a frame, and blink: at noon, when the neighbouring
/// frames lack what two others as near show, and at 9.77, 21 and 23.9 h, which no frame shows. Around 1.5 h
/// the second tile is black.
pub fn switching_bundle() -> Vec<u8> {
    let mut header = Header { pages: vec![Grid { width: 140, height: 10 }], ..header() };
    header.kinds.truncate(1);
    header.groups = ["porch", "blink", "spark"].map(str::to_owned).to_vec();
    header.apart = vec![false; 3];
    let hours = vec![0.0, 4.8, 4.9, 6.5, 11.5, 12.5, 17.5, 20.0];
    let intervals = vec![
        vec![[19.0, 4.9]],
        vec![[6.4, 6.6], [11.9, 12.1], [17.4, 17.6]],
        vec![[9.5, 10.0], [20.9, 21.1], [23.8, 23.95]],
    ];
    let states = hours.iter().map(|&h| intervals.iter().map(|on| is_on(on, h)).collect()).collect();
    header.timeline = Timeline { hours, between: vec![2.0], intervals, states, coding: Coding::Standard };
    let payload = |(i, place): (usize, Place)| {
        let mut tile = tile(header.shape(place, &Profile::M.contents(8, 2)), i as u64);
        tile.knots.insert(1, dusk());
        if i > 0 {
            tile.knots[..2].iter_mut().for_each(|knot| knot.mean = [0.0; 3]);
        }
        bundle::encode_payload(&tile).unwrap()
    };
    let payloads: Vec<Payload> = header.places().enumerate().map(payload).collect();
    bundle::encode(&header, &payloads).unwrap()
}

/// A page of tiles that differ in contents, one of them black and some mostly grey, under two lamps.
pub fn all_contents(hidden: usize) -> Vec<u8> {
    let mut header = Header { pages: vec![Grid { width: 1800, height: 14 }], ..header() };
    header.kinds.truncate(1);
    let sides = [0, 4, 8, 16, 32, 64, 128];
    let payload = |(i, place): (usize, Place)| {
        if i == 9 {
            return Payload::default();
        }
        let uvt = sides[i % sides.len()];
        let (ut, vt) = (i & 1 > 0, i & 2 > 0);
        let slices = match uvt {
            0 => 0,
            4 => 127,
            _ => 1 + i % 5,
        };
        let rows = if ut || vt { 1 + i % 7 } else { 0 };
        let (uv, gamma, gates) = (i % 3 != 1, i % 4 < 2, i % 3);
        let contents = Contents { uv, uvt, slices, ut, vt, rows, gamma, gates, hidden };
        let mut tile = tile(header.shape(place, &contents), i as u64);
        // As training leaves weights: outputs of order one.
        tile.mlp.iter_mut().for_each(|w| *w = F16::from_f32(w.to_f32() * 2.0 / (hidden as f32).sqrt()));
        if i % 4 == 2 {
            let grey = bc7::encode(&bc7::GREY);
            tile.f_uv.iter_mut().chain(&mut tile.f_uvt).step_by(2).for_each(|block| *block = grey);
        }
        tile.knots.push(dusk());
        bundle::encode_payload(&tile).unwrap()
    };
    let payloads: Vec<Payload> = header.places().enumerate().map(payload).collect();
    bundle::encode(&header, &payloads).unwrap()
}

/// A set of random planes.
pub fn plane_set(
    source: u16,
    [width, height]: [usize; 2],
    planes: usize,
    frames: usize,
    seed: u64,
) -> PlaneSet {
    let mut random = Random(seed);
    let blocks = width.div_ceil(8) * height.div_ceil(8);
    let mut around = |n: usize| random.below(2 * n + 1) as i32 - n as i32;
    // Light of about its mean in the first plane, with a few coefficients a block.
    let factor = |i: usize, noise: i32| if i < 3 * frames && i.is_multiple_of(3) { 64 } else { 0 } + noise;
    let factors = (0..3 * frames * planes).map(|i| factor(i, around(40))).collect();
    let covered: Vec<bool> = (0..blocks).map(|_| around(4) < 4).collect();
    let coefficient = |i: usize, size: i32| match size {
        _ if i > 20 => 0,
        size => (size / (1 + i as i32 / 3)) as i16,
    };
    let coefficients = (0..planes * blocks)
        .map(|i| {
            let size = if covered[i % blocks] && around(3) < 2 { 40 } else { 0 };
            let mut block = std::array::from_fn(|i| coefficient(i, around(size)));
            if size > 0 && i < blocks {
                block[0] += 220;
            }
            block
        })
        .collect();
    PlaneSet {
        source,
        is_linear: seed.is_multiple_of(5),
        step: 32,
        chroma: 24,
        weights: (0..frames).map(|frame| -(frame as i32 % 3)).collect(),
        scales: vec![48; planes],
        factors,
        covered,
        coefficients,
    }
}

/// A bundle of planes: [`header`]'s times, pages of whole tiles and of slivers, a black tile. One
/// light group is apart, the other is not.
pub fn basis_bundle() -> Vec<u8> {
    let (header, payloads) = basis_parts();
    bundle::encode(&header, &payloads).unwrap()
}

/// The parts of [`basis_bundle`].
pub fn basis_parts() -> (Header, Vec<Payload>) {
    let mut header = Header { apart: vec![true, false], coding: MapCoding::Basis, ..header() };
    header.timeline.between = vec![3.0, 20.0];
    header.pages = vec![Grid { width: 140, height: 9 }, Grid { width: 20, height: 13 }];
    let payload = |(i, place): (usize, Place)| {
        if i == 1 {
            return Payload::default();
        }
        let (width, height) = header.pages[place.page].stored(place.column, place.row);
        let mut random = Random(i as u64 + 3);
        let mut knot = |share: f32| {
            let mut mean = || (0.1 + random.unit()) * 0.5;
            Knot { mean: [mean(), mean(), mean()], peak: 3.0, share }
        };
        let mut knots: Vec<Knot> = [0.0, 0.2, 0.0, 0.0, 0.0, 0.6].map(&mut knot).to_vec();
        // The second frame is black.
        knots[2].mean = [0.0; 3];
        let brightness = Brightness { knots, lamps: vec![knot(0.0)] };
        let sets = [(0, 5, 3), (1, 2, 1)].map(|(source, planes, frames)| {
            let set = plane_set(source, [width, height], planes, frames, 10 * i as u64 + u64::from(source));
            let bytes = planes::encode(&set, width);
            (set, bytes)
        });
        let maps: Section = planes::encode_section(&sets).unwrap();
        Payload { maps, resident: bundle::encode_brightness(&brightness).unwrap(), ..Payload::default() }
    };
    let payloads = header.places().enumerate().map(payload).collect();
    (header, payloads)
}
