//! A case: a page of given light through `compress`, and back from its bundle. Whatever the case, the bundle
//! is whole and any time of the day decodes to finite light.

use compressor::bundle::MapCoding;
use compressor::compress::{Options, Outcome, compress};
use compressor::decode::Decoder;
use compressor::evaluate::{Evaluation, Measures, evaluate};
use compressor::time::is_on;
use dataset::format::{Baked, Config, FORMAT, Frame, Group, Page, VERSION};
use dataset::image::{Image, Mask};
use dataset::observe::Silent;
use dataset::store::{Dataset, Writer};
use std::path::Path;

/// Light of frame k at (x, y).
type Light<'a> = Box<dyn Fn(usize, usize, usize) -> [f32; 3] + 'a>;

/// One page over a day.
pub struct Case<'a> {
    pub width: usize,
    pub height: usize,
    pub hours: Vec<f64>,
    /// On-intervals of the only light group.
    pub lamp: Vec<[f64; 2]>,
    pub valid: Box<dyn Fn(usize, usize) -> bool + 'a>,
    pub light: Light<'a>,
    pub iterations: usize,
    pub seed: u64,
    pub coding: MapCoding,
}

/// What came of it.
pub struct Result {
    pub outcome: Outcome,
    pub decoder: Decoder,
    pub evaluation: Evaluation,
    pub mask: Mask,
    /// Per frame.
    pub references: Vec<Image>,
    /// Per frame, at its hour.
    pub decoded: Vec<compressor::decode::Image>,
}

impl<'a> Case<'a> {
    /// `frames` even hours, everything valid, no lamp.
    pub fn new(
        width: usize,
        height: usize,
        frames: usize,
        light: impl Fn(usize, usize, usize) -> [f32; 3] + 'a,
    ) -> Self {
        Case {
            width,
            height,
            hours: (0..frames).map(|k| 24.0 * k as f64 / frames as f64).collect(),
            lamp: Vec::new(),
            valid: Box::new(|_, _| true),
            light: Box::new(light),
            iterations: 400,
            seed: Options::default().seed,
            coding: MapCoding::Neural,
        }
    }

    /// The frames, and when the lamp is on.
    pub fn hours(self, hours: &[f64], lamp: &[[f64; 2]]) -> Self {
        Case { hours: hours.to_vec(), lamp: lamp.to_vec(), ..self }
    }

    /// The texels that lie on a surface.
    pub fn valid(self, valid: impl Fn(usize, usize) -> bool + 'a) -> Self {
        Case { valid: Box::new(valid), ..self }
    }

    fn image(&self, k: usize) -> Image {
        let texels =
            (0..self.width * self.height).map(|i| (self.light)(k, i % self.width, i / self.width)).collect();
        Image { width: self.width, height: self.height, texels }
    }

    fn mask(&self) -> Mask {
        let valid =
            (0..self.width * self.height).map(|i| (self.valid)(i % self.width, i / self.width)).collect();
        Mask { width: self.width, height: self.height, valid }
    }

    /// Writes the dataset `case`.
    pub fn write(&self, root: &Path) {
        let mut writer = Writer::create(root).unwrap();
        let mask = writer.add("mask", "png", &self.mask().to_png()).unwrap();
        let frame = |(k, &hour): (usize, &f64)| Frame {
            hour,
            groups_on: vec![is_on(&self.lamp, hour)],
            relative_error: None,
            maps: vec![writer.add(&format!("map-{k}"), "exr", &self.image(k).to_exr()).unwrap()],
        };
        let frames = self.hours.iter().enumerate().map(frame).collect();
        let config = Config {
            format: FORMAT.to_owned(),
            version: VERSION,
            instances: Vec::new(),
            scene: "case".to_owned(),
            generator: "test".to_owned(),
            unit: "arbitrary".to_owned(),
            seed: 1,
            inputs: "0".repeat(64),
            samples: 1,
            pages: vec![Page::atlas(self.width as u32, self.height as u32, mask)],
            sun: None,
            sky: None,
            groups: vec![Group { name: "lamp".to_owned(), on: self.lamp.clone(), baked: Baked::All }],
            layers: Vec::new(),
            frames,
            noise: None,
            geometry: None,
            settings: serde_json::json!({}),
            source: None,
            sun_path: None,
            visibility: None,
            transfer: None,
        };
        writer.commit(&config).unwrap();
    }

    /// Compresses, opens, decodes and evaluates it.
    pub fn run(&self) -> Result {
        let folder = tempfile::tempdir().unwrap();
        self.write(folder.path());
        let (iterations, seed, coding) = (self.iterations, self.seed, self.coding);
        let options = Options { iterations, seed, coding, ..Options::default() };
        let outcome = compress(folder.path(), &options, &Silent).unwrap();
        let decoder = Decoder::open(&outcome.bundle).unwrap();
        let dataset = Dataset::open(folder.path()).unwrap();
        let evaluation = evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap();
        for place in decoder.bundle().header.places().filter(|_| self.coding == MapCoding::Neural) {
            if let Some(tile) = decoder.tile(place).unwrap() {
                assert!(tile.knots.iter().flat_map(|knot| knot.mean).all(|m| m.is_finite() && m >= 0.0));
                assert!(tile.mlp.iter().all(|w| w.is_finite()));
            }
        }
        let at = |hour| {
            let image = decoder.decode_page(0, hour).unwrap();
            let worst = image.texels.as_flattened().iter().find(|v| !v.is_finite() || **v < 0.0);
            assert_eq!(worst, None, "at {hour} h");
            image
        };
        (0..48).for_each(|i| drop(at(f64::from(i) / 2.0 + 0.01)));
        let decoded = self.hours.iter().map(|&hour| at(hour)).collect();
        let references = (0..self.hours.len()).map(|k| self.image(k)).collect();
        Result { outcome, evaluation, mask: self.mask(), references, decoded, decoder }
    }
}

impl Result {
    /// Decoded and reference of the valid texels of a frame that `wanted` names.
    fn pairs(&self, k: usize, wanted: impl Fn(usize, usize) -> bool) -> Vec<([f32; 3], [f32; 3])> {
        let width = self.mask.width;
        let of = |i: &usize| self.mask.valid[*i] && wanted(i % width, i / width);
        let pairs = (0..self.mask.valid.len())
            .filter(of)
            .map(|i| (self.decoded[k].texels[i], self.references[k].texels[i]));
        pairs.collect()
    }

    /// Root of the mean squared error over the mean, of the named valid texels of a frame.
    pub fn relative_error(&self, k: usize, wanted: impl Fn(usize, usize) -> bool) -> f64 {
        let (mut squares, mut sum) = (0.0, 0.0);
        let pairs = self.pairs(k, wanted);
        for (a, b) in &pairs {
            for c in 0..3 {
                squares += (f64::from(a[c]) - f64::from(b[c])).powi(2);
                sum += f64::from(b[c]);
            }
        }
        (squares / (3 * pairs.len()) as f64).sqrt() / (sum / (3 * pairs.len()) as f64)
    }

    /// The largest of all frames.
    pub fn worst_relative_error(&self) -> f64 {
        (0..self.decoded.len()).map(|k| self.relative_error(k, |_, _| true)).fold(0.0, f64::max)
    }

    /// Smallest PSNR of a frame, over all valid texels.
    pub fn least_psnr_db(&self) -> f64 {
        let psnr = |k: usize| {
            let pairs = self.pairs(k, |_, _| true);
            let peak = pairs.iter().flat_map(|(_, b)| b).fold(0.0f32, |a, &b| a.max(b));
            let error = |(a, b): &([f32; 3], [f32; 3])| {
                (0..3).map(|c| (f64::from(a[c]) - f64::from(b[c])).powi(2)).sum::<f64>()
            };
            let mse = pairs.iter().map(error).sum::<f64>() / (3 * pairs.len()) as f64;
            dataset::pictures::metrics::psnr_db(peak.into(), mse)
        };
        (0..self.decoded.len()).map(psnr).fold(f64::INFINITY, f64::min)
    }

    /// What training omitted, without the numbers of tiles.
    pub fn omitted(&self) -> Vec<&str> {
        self.outcome.omitted.iter().map(|(what, _)| what.as_str()).collect()
    }
}
