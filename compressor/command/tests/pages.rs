//! Several pages of one size through everything: the set, the bundle, decoding, quality, the reports, the
//! command line.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{HOURS, islands, lamp_is_on};
use compressor::bundle::Bundle;
use compressor::compress::Options;
use compressor::decode::Decoder;
use compressor::run::compress_and_judge;
use dataset::format::{
    Baked, Config, Daylight, FORMAT, Frame, Group, Instance, Layer, Light, Noise, Page, Part, VERSION,
};
use dataset::image::{Image, Mask};
use dataset::observe::Silent;
use dataset::store::{Dataset, Writer};
use reports::preview;
use std::path::Path;
use std::process::Command;

/// The light of a page from that of the islands.
type Look = fn(&Image) -> Image;

/// Pages of 150 × 140 texels: the islands, the islands mirrored and of another colour, and one without a
/// valid texel, as where all charts of a page lie inside solids.
fn pages() -> Vec<(Mask, Look)> {
    let mask = islands().mask();
    let mirrored = Mask { valid: mask.valid.iter().rev().copied().collect(), ..mask };
    let none = Mask { valid: vec![false; 150 * 140], ..mask };
    let turn = |image: &Image| {
        let texels = image.texels.iter().rev().map(|&[r, g, b]| [0.1 * b, 3.0 * r, g]).collect();
        Image { texels, ..*image }
    };
    vec![(mask, Image::clone), (mirrored, turn), (none, |image| Image::black(image.width, image.height))]
}

/// Writes the pages as one dataset with all layers: the sky by day, the lamp at night.
fn write(root: &Path) {
    let (mut writer, scene) = (Writer::create(root).unwrap(), islands());
    let (lamp, black) = (scene.image(0.0, true), Image::black(150, 140));
    let (mut of_lamp, mut of_sky) = (vec![Vec::new()], vec![Vec::new(); HOURS.len()]);
    let mut all = Vec::new();
    let mut frames: Vec<Frame> = HOURS
        .map(|hour| Frame {
            hour,
            groups_on: vec![lamp_is_on(hour)],
            relative_error: Some(0.01),
            maps: vec![],
        })
        .into();
    for (page, (mask, look)) in pages().into_iter().enumerate() {
        let mask = writer.add(&format!("mask{page}"), "png", &mask.to_png()).unwrap();
        all.push(Page::atlas(150, 140, mask));
        let lamp = look(&lamp);
        of_lamp[0].push(Some(writer.add(&format!("lamp-{page}"), "exr", &lamp.to_exr()).unwrap()));
        for (frame, of_sky) in frames.iter_mut().zip(&mut of_sky) {
            let sky = look(&scene.image(frame.hour, false));
            let local = if frame.groups_on[0] { &lamp } else { &black };
            let texels = sky.texels.iter().zip(&local.texels);
            let texels = texels.map(|(a, b)| std::array::from_fn(|c| a[c] + b[c])).collect();
            let mut add = |stem: &str, image: &Image| {
                writer.add(&format!("{stem}-{}-{page}", frame.hour), "exr", &image.to_exr()).unwrap()
            };
            frame.maps.push(add("frame", &Image { texels, ..sky }));
            of_sky.push(Some(add("sky", &sky)));
        }
    }
    // Tiles of the pages have errors of their own.
    let mse = (0..3).map(|page| vec![1e-6 * f64::from(page + 1); 4]).collect();
    let noise = Noise { tile: 128, mse: vec![mse; frames.len()] };
    let noise = writer.add("noise", "json", &serde_json::to_vec(&noise).unwrap()).unwrap();
    let instance = |page| Instance { name: format!("isle {page}"), page, scale: [1.0; 2], offset: [0.0; 2] };
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        instances: (0..3).map(instance).collect(),
        scene: "isles".to_owned(),
        generator: "test".to_owned(),
        unit: "arbitrary".to_owned(),
        seed: 1,
        inputs: "0".repeat(64),
        samples: 1,
        pages: all,
        sun: None,
        sky: Some(Daylight { baked: Baked::All }),
        groups: vec![Group { name: "lamp".to_owned(), on: vec![[18.0, 6.0]], baked: Baked::All }],
        layers: vec![
            Layer { light: Light::Sky, group: None, part: Part::All, files: of_sky, curve: None },
            Layer { light: Light::Group, group: Some(0), part: Part::All, files: of_lamp, curve: None },
        ],
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

#[test]
fn every_page_comes_back_as_itself() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("isles");
    write(&root);
    let dataset = Dataset::open(&root).unwrap();
    let faults = dataset.verify(|| {}).faults;
    assert!(faults.is_empty(), "{faults:?}");
    // The masks, and every frame of every page.
    preview::section(&dataset).unwrap();

    let options = Options { iterations: 400, ..Options::default() };
    let judged = compress_and_judge(&root, &options, &Silent).unwrap();
    // Per page 2 × 2 tiles; a tile of the first page and all of the last have no valid texel.
    let empty: usize =
        judged.outcome.omitted.iter().filter(|(why, _)| why == "no valid texel").map(|(_, n)| n).sum();
    assert_eq!((judged.outcome.tiles, empty), (12, 5), "{:?}", judged.outcome.omitted);
    assert_eq!(judged.sections.len(), 5);

    // Every valid texel of a page is near its own light, and far from that of the other page.
    let decoder = Decoder::open(&judged.outcome.bundle).unwrap();
    for (page, (mask, _)) in pages().into_iter().enumerate() {
        assert_eq!(dataset.mask(page).unwrap(), mask);
        for (k, &hour) in HOURS.iter().enumerate() {
            let decoded = decoder.decode_page(page, hour).unwrap();
            let error = |other: usize| {
                let reference = dataset.map(k, other).unwrap();
                let texels = decoded.texels.iter().zip(&reference.texels).zip(&mask.valid);
                let valid = texels.filter(|(_, valid)| **valid).flat_map(|((a, b), _)| a.iter().zip(b));
                valid.map(|(a, b)| f64::from((a - b).powi(2))).sum::<f64>().sqrt()
            };
            let size: f64 =
                decoded.texels.iter().flatten().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
            if page < 2 {
                assert!(error(page) < 0.1 * size, "page {page}, {hour} h: {} of {size}", error(page));
                assert!(error(1 - page) > 0.4 * size, "page {page}, {hour} h: {}", error(1 - page));
            } else {
                assert_eq!(size, 0.0);
            }
        }
    }

    // Quality counts every tile with a valid texel once per frame, on its page, against that page's noise.
    let evaluation = &judged.evaluation;
    let of_page = |page: usize| evaluation.samples.iter().filter(move |s| s.page == page);
    assert_eq!([0, 1, 2].map(|page| of_page(page).count()), [3 * 6, 4 * 6, 0]);
    let bits = std::fs::metadata(&judged.outcome.bundle).unwrap().len() as f64 * 8.0;
    assert!((evaluation.bpp - bits / (3.0 * 150.0 * 140.0 * 6.0)).abs() < 1e-9);
    let valid = |page: usize| of_page(page).filter(|s| s.frame == 3).map(|s| s.quality.texels).sum::<usize>();
    assert_eq!([0, 1].map(valid), [islands().mask().count(); 2]);

    // Any place of any page, and no page beyond the last.
    let header = &decoder.bundle().header;
    assert_eq!(header.pages.iter().map(|p| (p.width, p.height)).collect::<Vec<_>>(), [(150, 140); 3]);
    for page in 0..3 {
        let image = decoder.decode_page(page, 12.0).unwrap();
        let (x, y) = (75, 70);
        let sample = decoder.sample(page, (x as f64 + 0.5) / 150.0, (y as f64 + 0.5) / 140.0, 12.0).unwrap();
        let texel = image.texels[y * 150 + x];
        assert!((0..3).all(|c| (sample[c] - texel[c]).abs() <= 1e-3 * texel[c]), "{sample:?} {texel:?}");
    }
    assert!(decoder.decode_page(3, 12.0).unwrap_err().to_string().contains("the bundle has 3 pages"));
    let bytes = std::fs::read(&judged.outcome.bundle).unwrap();
    assert_eq!(Bundle::from_bytes(bytes).unwrap().header, *header);

    // A bundle of other pages is refused.
    let mut config = dataset.config.clone();
    config.pages.pop();
    config.instances.pop();
    config.frames.iter_mut().for_each(|frame| drop(frame.maps.pop()));
    let rows = config.layers.iter_mut().flat_map(|layer| &mut layer.files);
    rows.for_each(|row| drop(row.pop()));
    config.noise = None;
    std::fs::write(root.join("config.json"), serde_json::to_vec(&config).unwrap()).unwrap();
    let fewer = Dataset::open(&root).unwrap();
    let message =
        compressor::evaluate::evaluate(&fewer, &decoder, compressor::evaluate::Measures::default(), &Silent)
            .unwrap_err()
            .to_string();
    assert!(message.contains("pages"), "{message}");
}

#[test]
fn the_command_line_reaches_every_page() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("isles"));
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_compress"));
        command.args(arguments).current_dir(folder.path()).output().unwrap()
    };
    assert!(run(&["isles", "--iterations", "60"]).status.success());
    let report = std::fs::read_to_string(folder.path().join("isles/isles.html")).unwrap();
    for text in ["Page 0", "Page 2", "12 h · page 1", "page 1, 12 h, reference", "page 2, 12 h, reference"] {
        assert!(report.contains(text), "{text}");
    }
    let decoder = Decoder::open(&folder.path().join("isles/isles.ndgi")).unwrap();
    for page in 0..3 {
        let number = page.to_string();
        let output =
            run(&["decode", "isles/isles.ndgi", "--hour", "12", "--page", &number, "--out", "x.exr"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let image = Image::read_exr(&folder.path().join("x.exr")).unwrap();
        assert_eq!(image.texels, decoder.decode_page(page, 12.0).unwrap().texels);
    }
    let output = run(&["decode", "isles/isles.ndgi", "--hour", "12", "--page", "3", "--out", "y.exr"]);
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("the bundle has 3 pages"));
}
