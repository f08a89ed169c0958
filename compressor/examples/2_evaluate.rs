//! Compares what a bundle decodes to with its dataset:
//! `cargo run --release -p compressor --example 2_evaluate -- dataset/yard yard.ndgi`.
//!
//! How to decode for a game is shown by the examples of the crate `ndgi`.

use compressor::decode::Decoder;
use compressor::evaluate::{Measures, evaluate};
use dataset::observe::Silent;
use dataset::store::Dataset;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [dataset, bundle] = &arguments[..] else {
        return Err("expected the folder of a dataset and a bundle".into());
    };
    let dataset = Dataset::open(dataset.as_ref())?;
    let decoder = Decoder::open(bundle.as_ref())?;
    let found = evaluate(&dataset, &decoder, Measures::default(), &Silent)?;
    let in_db = |value: Option<f64>| value.map_or("–".to_owned(), |db| format!("{db:.1} dB"));
    for (hour, quality) in &found.by_hour {
        println!(
            "{hour:5.2} h: PSNR {}, worst 1 % {}",
            in_db(quality.psnr_db),
            in_db(quality.psnr_worst_percent_db)
        );
    }
    let all = &found.all;
    println!(
        "mean {}, pooled {}, {:.3} bits per texel and frame",
        in_db(all.psnr_db),
        in_db(all.psnr_pooled_db),
        found.bpp
    );
    // The columns of `compress evaluate`, one line per frame.
    println!("{}", found.table().join("\n"));
    Ok(())
}
