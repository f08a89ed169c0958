//! Writes a dataset of one's own light, to be compressed like a baked one:
//! `cargo run --release -p dataset --example 2_write -- dataset/sweep`.

use dataset::format::{Config, FORMAT, Frame, Page, VERSION};
use dataset::image::{Image, Mask};
use dataset::store::{Dataset, Writer};

/// Side of the page, in texels.
const SIDE: usize = 128;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = std::env::args().nth(1).ok_or("a folder to write is missing")?;
    let mut writer = Writer::create(root.as_ref())?;
    // Here all texels lie on surfaces; where they do not, `valid` is false.
    let mask = Mask { width: SIDE, height: SIDE, valid: vec![true; SIDE * SIDE] };
    let mask = writer.add("mask", "png", &mask.to_png())?;
    let mut frames = Vec::new();
    for hour in 6..18 {
        // A spot of light that crosses the page within the day.
        let middle = (f64::from(hour) - 6.0) / 12.0 * SIDE as f64;
        let light = |i: usize| {
            let away = ((i % SIDE) as f64 - middle).hypot((i / SIDE) as f64 - 64.0);
            [(-(away / 20.0).powi(2)).exp() as f32; 3]
        };
        let lightmap = Image { width: SIDE, height: SIDE, texels: (0..SIDE * SIDE).map(light).collect() };
        let maps = vec![writer.add(&format!("frame-{hour}"), "exr", &lightmap.to_exr())?];
        frames.push(Frame { hour: f64::from(hour), groups_on: Vec::new(), relative_error: None, maps });
    }
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        scene: "sweep".to_owned(),
        generator: "example 2_write".to_owned(),
        unit: "kilolux".to_owned(),
        seed: 1,
        // A digest of all that decides the texels; equal light has an equal digest.
        inputs: "sweep-1".to_owned(),
        samples: 1,
        pages: vec![Page::atlas(SIDE as u32, SIDE as u32, mask)],
        // Without layers a reader takes each lightmap as it is.
        sun: None,
        sky: None,
        groups: Vec::new(),
        layers: Vec::new(),
        frames,
        noise: None,
        geometry: None,
        instances: Vec::new(),
        settings: serde_json::json!({ "spot": 20.0 }),
        sun_path: None,
        visibility: None,
        source: None,
        transfer: None,
    };
    // Only now is the folder a dataset: readers see all of it or none.
    writer.commit(&config)?;
    println!("{root}: {} frames", Dataset::open(root.as_ref())?.config.frames.len());
    Ok(())
}
