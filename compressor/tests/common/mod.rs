//! A small dataset with known light, written through the dataset crate.
#![allow(dead_code, reason = "each test file uses its part")]

use compressor::decode::Decoder;
use compressor::grid::Place;
use compressor::model::PAYLOAD;
use dataset::format::{Baked, Config, FORMAT, Frame, Group, Noise, Page, VERSION};
use dataset::image::{Image, Mask};
use dataset::store::Writer;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub mod court;

/// Frames around the switches of lamps that are on 18:00–06:00.
pub const HOURS: [f64; 6] = [0.0, 5.9, 6.0, 12.0, 18.0, 18.1];

/// One page of a scene to write.
pub struct Scene {
    pub width: usize,
    pub height: usize,
    pub hours: Vec<f64>,
    pub valid: fn(usize, usize) -> bool,
    /// Light at (x, y) and an hour, lamps given.
    pub light: fn(usize, usize, f64, bool) -> [f32; 3],
}

/// Lit 18:00–06:00, off at both ends.
pub fn lamp_is_on(hour: f64) -> bool {
    !(6.0..=18.0).contains(&hour)
}

/// 150 × 140 texels: a large island, one of 3 × 3, a single texel.
pub fn islands() -> Scene {
    Scene {
        width: 150,
        height: 140,
        hours: HOURS.to_vec(),
        valid: |x, y| {
            let large = (10..110).contains(&x) && (5..120).contains(&y) && (x + y) % 97 != 0;
            large || ((130..133).contains(&x) && (60..63).contains(&y)) || (x, y) == (149, 139)
        },
        light: |x, y, hour, lamp| {
            // A sun patch that moves with the hour, a sky by day, a reddish lamp at night.
            let day = (1.0 - ((hour - 12.0) / 6.5).powi(2)).max(0.0) as f32;
            let (x, y) = (x as f32 / 150.0, y as f32 / 140.0);
            let shadow = 1.0 / (1.0 + (-(x - 0.05 * hour as f32 + 0.2 * y) * 40.0).exp());
            let lamp = if lamp { 2.0 / (1.0 + 30.0 * ((x - 0.4).powi(2) + (y - 0.5).powi(2))) } else { 0.0 };
            [
                5.0 * day * shadow + day + lamp,
                4.0 * day * shadow + day + 0.6 * lamp,
                3.0 * day * shadow + 1.5 * day + 0.2 * lamp,
            ]
        },
    }
}

impl Scene {
    pub fn mask(&self) -> Mask {
        let valid =
            (0..self.width * self.height).map(|i| (self.valid)(i % self.width, i / self.width)).collect();
        Mask { width: self.width, height: self.height, valid }
    }

    pub fn image(&self, hour: f64, lamp: bool) -> Image {
        let texels = (0..self.width * self.height)
            .map(|i| (self.light)(i % self.width, i / self.width, hour, lamp))
            .collect();
        Image { width: self.width, height: self.height, texels }
    }

    /// Writes the dataset `isles` into `root`.
    pub fn write(&self, root: &Path) {
        let mut writer = Writer::create(root).unwrap();
        let mask = writer.add("mask", "png", &self.mask().to_png()).unwrap();
        let frames: Vec<Frame> = self
            .hours
            .iter()
            .map(|&hour| {
                let image = self.image(hour, lamp_is_on(hour));
                let file = writer.add(&format!("map-{hour}"), "exr", &image.to_exr()).unwrap();
                Frame { hour, groups_on: vec![lamp_is_on(hour)], relative_error: None, maps: vec![file] }
            })
            .collect();
        let tiles = self.width.div_ceil(128) * self.height.div_ceil(128);
        let noise = Noise { tile: 128, mse: vec![vec![vec![1e-6; tiles]]; frames.len()] };
        let noise = writer.add("noise", "json", &serde_json::to_vec(&noise).unwrap()).unwrap();
        let config = Config {
            format: FORMAT.to_owned(),
            version: VERSION,
            instances: Vec::new(),
            scene: "isles".to_owned(),
            generator: "test".to_owned(),
            unit: "arbitrary".to_owned(),
            seed: 1,
            inputs: "0".repeat(64),
            samples: 1,
            pages: vec![Page::atlas(self.width as u32, self.height as u32, mask)],
            sun: None,
            sky: None,
            groups: vec![Group { name: "lamp".to_owned(), on: vec![[18.0, 6.0]], baked: Baked::All }],
            layers: Vec::new(),
            frames,
            noise: Some(noise),
            geometry: None,
            settings: serde_json::json!({}),
            source: None,
            sun_path: None,
            visibility: None,
            transfer: None,
        };
        writer.commit(&config).unwrap();
    }
}

/// A Python that has numpy.
pub fn python() -> Option<String> {
    let named = std::env::var("NDGI_PYTHON").ok();
    let python = named.clone().unwrap_or("python3".to_owned());
    let works = Command::new(&python).args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success());
    assert!(works || named.is_none(), "NDGI_PYTHON={python} does not run, or lacks numpy");
    if !works {
        eprintln!("skipped: there is no python3 with numpy");
    }
    works.then_some(python)
}

/// The second reader.
pub fn script() -> PathBuf {
    // (The tests of the command have their own folder.)
    let mut folders =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|f| f.join("python/read_ndgi.py"));
    folders.find(|script| script.exists()).unwrap()
}

pub fn read(python: &str, bundle: &Path, arguments: &[&str]) -> (Output, PathBuf) {
    let (out, script) = (bundle.with_extension("npy"), script());
    let mut command = Command::new(python);
    command
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(script)
        .arg(bundle)
        .args(arguments)
        .arg("--out")
        .arg(&out);
    (command.output().unwrap(), out)
}

/// An array of height × width × 3 float32.
pub fn image(path: &Path) -> Image {
    let bytes = fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..start]).into_owned();
    assert!(header.contains("'<f4'") && header.contains("'fortran_order': False"), "{header}");
    let shape = header.split(['(', ')']).nth(1).unwrap();
    let shape: Vec<usize> = shape.split(',').map(|n| n.trim().parse().unwrap()).collect();
    let values: Vec<f32> =
        bytes[start..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let texels = values.as_chunks::<3>().0.to_vec();
    assert_eq!((shape[2], texels.len()), (3, shape[0] * shape[1]));
    Image { width: shape[1], height: shape[0], texels }
}

/// Largest difference of a page in units of FORMAT.md's max(E, mean / 100); lamps that are apart are not in
/// the mean.
pub fn difference(decoder: &Decoder, page: usize, hour: f64, found: &Image) -> f64 {
    let expected = decoder.decode_page(page, hour).unwrap();
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let point = decoder.bundle().maps_timeline().at(hour);
    let mut worst = 0.0f64;
    for row in 0..expected.height.div_ceil(PAYLOAD) {
        for column in 0..expected.width.div_ceil(PAYLOAD) {
            let knots = &decoder.bundle().brightness(Place { page, column, row }).unwrap().knots;
            let mean = |c: usize| {
                let share = point.fraction as f32;
                let [a, b] = point.knots.map(|knot| knots.get(knot).map_or(0.0, |knot| knot.mean[c]));
                (1.0 - share) * a + share * b
            };
            for y in row * PAYLOAD..((row + 1) * PAYLOAD).min(expected.height) {
                for x in column * PAYLOAD..((column + 1) * PAYLOAD).min(expected.width) {
                    let i = y * expected.width + x;
                    for c in 0..3 {
                        let (a, b) = (f64::from(expected.texels[i][c]), f64::from(found.texels[i][c]));
                        if a != b {
                            worst = worst.max((a - b).abs() / a.max(f64::from(mean(c)) / 100.0));
                        }
                    }
                }
            }
        }
    }
    worst
}
