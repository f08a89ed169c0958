//! Small bundles of every kind: those that lie in the repository, and random ones of many contents.

use compressor::bundle::{self, Header, PageKind, Payload};
use compressor::grid::Grid;
use compressor::model::{Contents, Knot, Shape, TileParams};
use compressor::time::{Axis, Coding, Timeline, is_on};
use ndgi::half::F16;
use std::path::Path;

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn byte(&mut self) -> u8 {
        self.next() as u8
    }

    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }
}

const GREY: [u8; 16] = [0x40, 0x20, 0x10, 8, 4, 2, 0x81, 0x40, 0, 0, 0, 0, 0, 0, 0, 0];

/// Blocks of both modes; with `sparse` most are grey.
fn blocks(random: &mut Random, n: usize, sparse: bool) -> Vec<[u8; 16]> {
    let mut block = |_| {
        let mut block = [0; 16].map(|_: u8| random.byte());
        block[0] = if random.byte() < 128 { block[0] & 0x80 | 0x40 } else { block[0] & 0xe0 | 0x10 };
        if sparse && random.byte() < 200 { GREY } else { block }
    };
    (0..n).map(&mut block).collect()
}

fn tile(shape: Shape, knots: usize, sparse: bool, seed: u64) -> TileParams {
    let random = &mut Random(seed);
    let [uv, uvt, ut, vt] = shape.counts();
    let (f_uv, f_uvt) = (blocks(random, uv, sparse), blocks(random, uvt, sparse));
    let mut plane = |n: usize| (0..n).map(|_| [random.byte(), random.byte()]).collect();
    let (f_ut, f_vt) = (plane(ut), plane(vt));
    // Outputs of order one, whatever the width.
    let gain = 4.0 / shape.hidden as f32;
    let mlp = (0..shape.mlp_len()).map(|_| F16::from_f32(gain * (random.unit() - 0.42))).collect();
    let mut mean = || (2048.0 * random.unit()).floor() / 2048.0;
    let mut knot = |k: usize| Knot {
        mean: [mean(), 8.0 * mean(), 0.0],
        peak: 8.0,
        share: if k < shape.sets { 0.0 } else { 0.2 },
    };
    let knots = (0..knots).map(&mut knot).collect();
    let places = (0..shape.sets).map(|k| 3 * (k as u16 / 2)).collect();
    let axis = Axis { length: 2 * shape.sets as u16, places };
    let gates = (0..shape.contents.gates as u16).collect();
    TileParams { shape, f_uv, f_uvt, f_ut, f_vt, mlp, knots, axis, gates }
}

/// A bundle of version 4 whose tiles have these contents, on a page with slivers, one tile black.
fn synthetic(of: &[Contents]) -> Vec<u8> {
    let hours = vec![0.0, 5.9, 6.0, 18.1];
    let intervals = vec![vec![[18.0, 6.0]], vec![[0.0, 24.0], [3.0, 4.0]]];
    let states = hours.iter().map(|&hour| intervals.iter().map(|on| is_on(on, hour)).collect()).collect();
    let header = Header {
        scene: "synthetic".to_owned(),
        info: "{}".to_owned(),
        pages: vec![
            Grid { width: 40, height: 131 },
            Grid { width: 9, height: 1 },
            Grid { width: 130, height: 5 },
        ],
        kinds: vec![PageKind::Atlas; 3],
        groups: vec!["porch".to_owned(), "garden".to_owned()],
        timeline: Timeline { hours, between: vec![20.0], intervals, states, coding: Coding::Standard },
        sun: None,
        shadows: false,
    };
    let payloads: Vec<_> = (0..)
        .zip(header.places())
        .map(|(i, place)| match i {
            2 => Payload::default(),
            _ => {
                let contents = of[i % of.len()];
                bundle::encode_payload(&tile(header.shape(place, &contents), 5, i % 2 == 1, i as u64))
                    .unwrap()
            }
        })
        .collect();
    bundle::encode(&header, &payloads).unwrap()
}

/// All bundles, by name.
pub fn all() -> Vec<(String, Vec<u8>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut bundles = Vec::new();
    for folder in ["fuzz/corpus/bundle", "../compressor/ndgi/tests/fixtures"] {
        for entry in std::fs::read_dir(root.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "ndgi") {
                bundles.push((
                    path.file_stem().unwrap().to_string_lossy().into_owned(),
                    std::fs::read(path).unwrap(),
                ));
            }
        }
    }
    bundles.sort();
    let full = Contents {
        uv: true,
        uvt: 16,
        slices: 3,
        ut: true,
        vt: true,
        rows: 4,
        gamma: true,
        gates: 2,
        hidden: 16,
    };
    let still = Contents { ut: false, vt: false, rows: 0, gamma: false, gates: 0, ..full };
    let thin = Contents { uv: false, uvt: 0, slices: 0, vt: false, gates: 1, ..full };
    for (name, of) in [
        ("all", vec![full, still, thin, Contents::NONE]),
        (
            "wide",
            vec![
                Contents { hidden: 32, ..full },
                Contents { hidden: 64, ..full },
                Contents { hidden: 64, ..still },
            ],
        ),
        ("deep", vec![Contents { uvt: 128, slices: 7, ..still }, Contents { uvt: 4, slices: 127, ..full }]),
    ] {
        bundles.push((name.to_owned(), synthetic(&of)));
    }
    assert!(bundles.len() >= 9, "{}", bundles.len());
    bundles
}
