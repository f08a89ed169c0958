//! A small dataset with known light, written through the dataset crate.
#![allow(dead_code, reason = "each test file uses its part")]

use dataset::config::{Baked, Config, FORMAT, Frame, Group, Noise, Page, VERSION};
use dataset::image::{Image, Mask};
use dataset::store::Writer;
use std::path::Path;

/// Sets around the switches of lamps that are on 18:00–06:00.
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
