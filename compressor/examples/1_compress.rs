//! Compresses a dataset: `cargo run --release -p compressor --example 1_compress -- dataset/yard yard.ndgi`.

use compressor::compress::{DRAFT, Options, compress};
use dataset::observe::Silent;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [dataset, out] = &arguments[..] else {
        return Err("expected the folder of a dataset and a bundle to write".into());
    };
    // DRAFT is a first look; MEDIUM is the command's default, FINAL for shipping.
    let options = Options { out: Some(out.into()), ..Options::of(DRAFT) };
    let outcome = compress(dataset.as_ref(), &options, &Silent)?;
    println!("{}: {} bytes, {} tiles in {:.1} s", out, outcome.bytes, outcome.tiles, outcome.seconds);
    for tile in &outcome.per_tile {
        let [page, column, row] = tile.place;
        let quality = tile.psnr_db.map_or("empty".to_owned(), |db| format!("{db:.1} dB"));
        println!("  page {page}, tile ({column}, {row}): {} bytes, {quality}", tile.bytes);
    }
    Ok(())
}
