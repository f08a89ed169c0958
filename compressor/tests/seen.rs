//! What is seen of a bundle's errors: right values are known, because the true light is made from the
//! decoded.

mod common;

use common::{Scene, islands};
use compressor::compress::{Options, compress};
use compressor::decode::Decoder;
use compressor::evaluate::{Evaluation, Measures, evaluate};
use compressor::seen::Quantiles;
use dataset::image::Image;
use dataset::observe::Silent;
use dataset::store::{Dataset, Writer};
use std::path::Path;
use tempfile::TempDir;

const HOURS: [f64; 3] = [0.0, 9.0, 12.0];

/// Two tiles of grey light, dark at 0 h.
fn grey() -> Scene {
    Scene {
        width: 256,
        height: 64,
        hours: HOURS.to_vec(),
        valid: |_, _| true,
        light: |_, _, hour, _| [if hour == 0.0 { 5e-5 } else { hour as f32 }; 3],
    }
}

/// A scene, compressed.
struct Compressed {
    folder: TempDir,
    decoder: Decoder,
}

impl Compressed {
    fn new(scene: &Scene) -> Self {
        let folder = tempfile::tempdir().unwrap();
        scene.write(&folder.path().join("isles"));
        let options = Options { iterations: 100, ..Options::default() };
        let outcome = compress(&folder.path().join("isles"), &options, &Silent).unwrap();
        Compressed { decoder: Decoder::open(&outcome.bundle).unwrap(), folder }
    }

    /// A dataset in this unit whose light is what the bundle decodes to, changed by `change` (x, hour,
    /// light).
    fn dataset(&self, name: &str, unit: &str, change: impl Fn(usize, f64, [f32; 3]) -> [f32; 3]) -> Dataset {
        let mut config = Dataset::open(&self.folder.path().join("isles")).unwrap().config;
        let root = self.folder.path().join(name);
        let mut writer = Writer::create(&root).unwrap();
        for frame in &mut config.frames {
            let decoded = self.decoder.decode_page(0, frame.hour).unwrap();
            let texels = decoded.texels.iter().enumerate();
            let texels = texels.map(|(i, &light)| change(i % decoded.width, frame.hour, light)).collect();
            let image = Image { width: decoded.width, height: decoded.height, texels };
            frame.maps = vec![writer.add(&format!("map-{}", frame.hour), "exr", &image.to_exr()).unwrap()];
        }
        let mask = std::fs::read(self.folder.path().join("isles").join(&config.pages[0].mask.path)).unwrap();
        config.pages[0].mask = writer.add("mask", "png", &mask).unwrap();
        config.noise = None;
        config.unit = unit.to_owned();
        writer.commit(&config).unwrap();
        Dataset::open(&root).unwrap()
    }

    fn evaluate(&self, dataset: &Dataset) -> Evaluation {
        evaluate(dataset, &self.decoder, Measures::default(), &Silent).unwrap()
    }

    fn against(&self, dataset: &Dataset, reference: &Dataset) -> compressor::Result<Evaluation> {
        let measures = Measures { reference: Some(reference), ..Measures::default() };
        evaluate(dataset, &self.decoder, measures, &Silent)
    }
}

#[track_caller]
fn expect(found: Option<Quantiles>, expected: f64) {
    let Quantiles { median, p95, p99 } = found.unwrap();
    for found in [median, p95, p99] {
        assert!((found - expected).abs() <= 0.02 * expected + 2e-4, "{found}, expected {expected}");
    }
}

#[test]
fn light_decoded_a_tenth_too_bright_is_off_by_a_tenth_and_keeps_its_colour() {
    let compressed = Compressed::new(&grey());
    let dataset = compressed.dataset("dimmer", "kilolux", |_, _, light| light.map(|v| v / 1.1));
    let evaluation = compressed.evaluate(&dataset);
    for (_, quality) in &evaluation.by_hour {
        expect(quality.seen.local, 0.1);
        assert!(quality.seen.chroma.unwrap().p99 < 2e-3 && quality.seen.colour.unwrap().p99 < 1e-6);
    }
    expect(evaluation.all.seen.local, 0.1);
    // Every tile tells it too, and the command's texts.
    assert!(evaluation.samples.iter().all(|sample| (sample.seen.local.unwrap().p95 - 0.1).abs() < 2e-3));
    let sentence = evaluation.seen_sentence();
    assert!(sentence.contains("one texel in twenty is off by 10 % or more"), "{sentence}");
    assert!(evaluation.lines().contains(&sentence));
    let json = evaluation.json();
    assert!((json["hours"][1]["local_error_p95"].as_f64().unwrap() - 0.1).abs() < 2e-3);
    let csv = evaluation.csv();
    let columns = |line: &str| line.split(',').count();
    assert!(csv.lines().all(|line| columns(line) == columns(csv.lines().next().unwrap())));
}

#[test]
fn an_error_of_colour_alone_is_all_chroma() {
    let compressed = Compressed::new(&grey());
    // Decoded: as much more red as less blue.
    let dataset = compressed.dataset("coloured", "kilolux", |_, _, [r, g, b]| [0.8 * r, g, 1.2 * b]);
    let seen = compressed.evaluate(&dataset).all.seen;
    expect(seen.local, 0.2 * (2.0f64 / 3.0).sqrt());
    expect(seen.chroma, 0.2 * (2.0f64 / 3.0).sqrt());
    assert!(seen.colour.unwrap().median > 0.01);
}

#[test]
fn a_night_too_dark_to_see_is_never_named_the_worst() {
    let compressed = Compressed::new(&grey());
    // 0.05 lux at 0 h, off by half; on the right the noon is worse than the morning.
    let change = |x: usize, hour: f64, light: [f32; 3]| {
        let factor = match hour {
            0.0 => 1.5,
            12.0 if x >= 128 => 1.3,
            _ => 1.05,
        };
        light.map(|v| v / factor)
    };
    let evaluation = compressed.evaluate(&compressed.dataset("klx", "irradiance in kilolux", change));
    expect(evaluation.by_hour[0].1.seen.local, 0.5);
    assert_eq!(evaluation.worst_hour, Some(2));
    assert!(evaluation.seen_sentence().starts_with("At 12:00 one texel in twenty is off by 30 %"));
    let worst = evaluation.worst_tile.unwrap();
    assert_eq!((worst.frame, worst.page, worst.rect.x0, worst.rect.x1), (2, 0, 128, 256));
    assert!((worst.local_p95 - 0.3).abs() < 6e-3);
    // In a unit that says nothing of lux, any light counts.
    let unknown = compressed.evaluate(&compressed.dataset("unknown", "arbitrary", change));
    assert_eq!((unknown.worst_hour, unknown.json()["worst_hour"].as_f64()), (Some(0), Some(0.0)));
    // Nor does lux ten thousand times less: what is below the least floor is relative to it.
    let dark = compressed.evaluate(
        &compressed.dataset("dark", "kilolux", |x, hour, light| change(x, hour, light).map(|v| v * 1e-9)),
    );
    assert_eq!((dark.worst_hour, dark.worst_tile), (None, None));
    assert!(dark.seen_sentence().contains("No hour has light"));
}

#[test]
fn black_hours_have_no_figures_and_nothing_is_no_number() {
    let compressed = Compressed::new(&grey());
    let black = |only: Option<f64>| {
        move |_: usize, hour: f64, light: [f32; 3]| {
            if only.is_none_or(|only| only == hour) { [0.0; 3] } else { light.map(|v| v / 1.1) }
        }
    };
    let evaluation = compressed.evaluate(&compressed.dataset("one", "kilolux", black(Some(9.0))));
    assert_eq!(evaluation.by_hour[1].1.seen, compressor::seen::Figures::default());
    expect(evaluation.all.seen.local, 0.1);
    let json = evaluation.json();
    assert!(json["hours"][1]["local_error_p95"].is_null() && json["hours"][1]["mean_light"] == 0.0);
    let evaluation = compressed.evaluate(&compressed.dataset("all", "kilolux", black(None)));
    assert!(evaluation.worst_hour.is_none() && evaluation.json()["worst_tile"].is_null());
    let (lines, csv) = (evaluation.lines().join("\n"), evaluation.csv());
    assert!(!lines.contains("NaN") && !lines.contains("inf") && !csv.contains("NaN"), "{lines}{csv}");
    assert!(csv.lines().skip(1).all(|line| line.ends_with(",,,,,,,,,")), "{csv}");
}

#[test]
fn any_number_of_threads_finds_the_same() {
    let compressed = Compressed::new(&Scene { hours: vec![0.0, 12.0], ..islands() });
    let dataset = Dataset::open(&compressed.folder.path().join("isles")).unwrap();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let evaluation = pool.install(|| compressed.evaluate(&dataset));
        (evaluation.json(), evaluation.csv())
    };
    let one = with(1);
    assert!(one.0["local_error_p95"].as_f64().is_some_and(|error| error > 0.0));
    assert_eq!(one, with(4));
}

#[test]
fn a_reference_tells_the_datasets_own_noise() {
    let compressed = Compressed::new(&grey());
    let scaled = |factor: f32| move |_: usize, _: f64, light: [f32; 3]| light.map(|v| v / factor);
    // Decoded light is 10 % above the dataset's and 20 % above the reference's.
    let dataset = compressed.dataset("noisy", "kilolux", scaled(1.1));
    let reference = compressed.dataset("converged", "kilolux", scaled(1.2));
    let evaluation = compressed.against(&dataset, &reference).unwrap();
    let converged = evaluation.converged.as_ref().unwrap();
    expect(evaluation.all.seen.local, 0.1);
    expect(converged.bundle.all.seen.local, 0.2);
    expect(converged.dataset.all.seen.local, 1.2 / 1.1 - 1.0);
    let json = evaluation.json();
    assert_eq!(json["reference"]["bundle"]["hours"].as_array().unwrap().len(), HOURS.len());
    // The dataset is off by an eleventh of the peak.
    let db = json["reference"]["dataset"]["psnr_db"].as_f64().unwrap();
    assert!((db - 20.0 * 11f64.log10()).abs() < 0.3, "{db}");
    let lines = evaluation.lines().join("\n");
    for row in ["bundle, dataset", "bundle, reference", "dataset, reference"] {
        assert!(lines.contains(row), "{lines}");
    }
    // The dataset itself is exact, also where the reference has more hours.
    let itself = compressed.against(&dataset, &dataset).unwrap().converged.unwrap();
    expect(itself.dataset.all.seen.local, 0.0);
    assert_eq!(itself.bundle.all.seen, evaluation.all.seen);
}

#[test]
fn a_reference_of_another_layout_or_other_hours_is_refused() {
    let compressed = Compressed::new(&grey());
    let dataset = Dataset::open(&compressed.folder.path().join("isles")).unwrap();
    let other = |name: &str, scene: Scene| {
        let root = compressed.folder.path().join(name);
        scene.write(&root);
        root
    };
    let refused = |root: &Path, expected: &[&str]| {
        let message = compressed.against(&dataset, &Dataset::open(root).unwrap()).unwrap_err().to_string();
        let name = root.file_name().unwrap().to_str().unwrap();
        assert!(expected.iter().chain([&name]).all(|part| message.contains(part)), "{message}");
    };
    refused(&other("smaller", Scene { width: 255, ..grey() }), &["255 × 64", "256 × 64"]);
    refused(&other("fewer", Scene { hours: vec![0.0, 12.0], ..grey() }), &["no frame", "at 9 h"]);
    let more = other("more", Scene { hours: vec![0.0, 6.0, 9.0, 10.5, 12.0], ..grey() });
    let evaluation = compressed.against(&dataset, &Dataset::open(&more).unwrap()).unwrap();
    assert_eq!(evaluation.converged.unwrap().dataset.by_hour.len(), HOURS.len());
    // Of another light at night, and of charts that lie elsewhere.
    let mut config = Dataset::open(&more).unwrap().config;
    config.frames[0].groups_on = vec![false];
    let commit = |root: &Path, config: &dataset::format::Config| {
        Writer::create(root).unwrap().commit(config).unwrap();
    };
    commit(&more, &config);
    refused(&more, &["light groups", "at 0 h"]);
    let with_geometry = |root: &Path, bytes: &[u8]| {
        let mut writer = Writer::create(root).unwrap();
        let mut config = Dataset::open(root).unwrap().config;
        config.geometry = Some(writer.add("scene", "glb", bytes).unwrap());
        writer.commit(&config).unwrap();
    };
    let same = other("same", grey());
    with_geometry(&dataset.root, b"one");
    with_geometry(&same, b"another");
    let dataset = Dataset::open(&dataset.root).unwrap();
    let message = compressed.against(&dataset, &Dataset::open(&same).unwrap()).unwrap_err().to_string();
    assert!(message.contains("geometry file differs"), "{message}");
}
