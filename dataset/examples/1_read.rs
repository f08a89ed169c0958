//! Reads a dataset: `cargo run --release -p dataset --example 1_read -- dataset/yard`.

use dataset::store::Dataset;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = std::env::args().nth(1).ok_or("the folder of a dataset is missing")?;
    let dataset = Dataset::open(root.as_ref())?;
    let config = &dataset.config;
    println!(
        "{}: {} pages, {} frames, in {}",
        config.scene,
        config.pages.len(),
        config.frames.len(),
        config.unit
    );
    for (page, of) in config.pages.iter().enumerate() {
        let mask = dataset.mask(page)?;
        println!("page {page}: {} × {} texels, {} of them valid", of.width, of.height, mask.count());
        for (index, frame) in config.frames.iter().enumerate() {
            // RGB irradiance in linear Rec. 709; what lies outside the mask fills gutters.
            let lightmap = dataset.map(index, page)?;
            let valid = lightmap.texels.iter().zip(&mask.valid).filter(|(_, valid)| **valid);
            let sum: f64 = valid.flat_map(|(texel, _)| texel).map(|value| f64::from(*value)).sum();
            println!("  {:5.2} h: mean {:.6}", frame.hour, sum / (3 * mask.count().max(1)) as f64);
        }
    }
    // Between the frames light is interpolated layer by layer, and the sun's shadows move.
    if let [first, second, ..] = &config.frames[..] {
        let hour = 0.5 * (first.hour + second.hour);
        let between = dataset.light_at(hour, 0)?;
        let brightest = between.texels.iter().flatten().copied().fold(0.0, f32::max);
        println!("page 0 at {hour} h, between two frames: at most {brightest:.6}");
    }
    Ok(())
}
