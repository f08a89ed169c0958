//! Random tiles and bundles for unit tests.

use crate::bc7::{self, Mode6};
use crate::bundle::{self, Header};
use crate::grid::Grid;
use crate::model::{PROFILES, Shape, TileParams};
use crate::time::{Coding, Timeline, is_on};
use half::f16;

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn byte(&mut self) -> u8 {
        self.next() as u8
    }

    /// Uniform in [0, n).
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
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
                bc7::encode(&Mode6 { endpoints, indices: std::array::from_fn(|_| random.byte() & 15) })
            })
            .collect()
    };
    let f_uv = blocks(shape.width * shape.height / 16);
    let f_uvt = blocks(shape.uvt[0] * shape.uvt[1] / 16 * shape.uvt[2]);
    let mut plane = |n: usize| (0..n).map(|_| [random.byte(), random.byte()]).collect();
    let (f_ut, f_vt) = (plane(shape.rows * shape.ut), plane(shape.rows * shape.vt));
    let mlp = (0..shape.mlp_len()).map(|_| f16::from_f32(random.unit() - 0.45)).collect();
    let means = (0..shape.sets).map(|_| [random.unit(), 10.0 * random.unit(), 0.0]).collect();
    TileParams { shape, f_uv, f_uvt, f_ut, f_vt, mlp, means }
}

/// A header with two small pages (2 + 1 tiles), 4 sets and two light groups.
pub fn header() -> Header {
    let hours = vec![0.0, 5.9, 6.0, 18.1];
    let intervals = vec![vec![[18.0, 6.0]], vec![[0.0, 24.0], [3.0, 4.0]]];
    let states = hours.iter().map(|&h| intervals.iter().map(|on| is_on(on, h)).collect()).collect();
    Header {
        scene: "yard".to_owned(),
        info: "{\"seed\":1}".to_owned(),
        profile: PROFILES[1],
        pages: vec![Grid { width: 128, height: 5 }, Grid { width: 9, height: 1 }],
        groups: vec!["porch".to_owned(), "garden".to_owned()],
        timeline: Timeline { hours, intervals, states, coding: Coding::Standard },
    }
}

/// A bundle of [`header`] with random tiles, of which the second is black.
pub fn bundle() -> (Header, Vec<Vec<u8>>, Vec<u8>) {
    let header = header();
    let payload = |(i, place)| match i {
        1 => Vec::new(),
        _ => bundle::encode_payload(&tile(header.shape(place), i as u64)).unwrap(),
    };
    let payloads: Vec<_> = header.places().enumerate().map(payload).collect();
    let bytes = bundle::encode(&header, &payloads).unwrap();
    (header, payloads, bytes)
}
