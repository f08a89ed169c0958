//! A whole page as an image of 8 bits (PPM), all cores:
//! `cargo run --features rayon --example 4_page -- yard.ndgi 12 page.ppm`.

use ndgi::decode::Decoder;
use std::io::Write;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, hour, out] = &arguments[..] else {
        return Err("expected a bundle's path, an hour and a file to write".into());
    };
    let decoder = Decoder::open(path.as_ref())?;
    let page = decoder.decode_page(0, hour.parse()?)?;
    // The middle of the lit texels is mid-grey.
    let mut levels: Vec<f32> =
        page.texels.iter().map(|texel| texel[1]).filter(|level| *level > 0.0).collect();
    levels.sort_by(f32::total_cmp);
    let middle = levels.get(levels.len() / 2).copied().unwrap_or(1.0);
    let byte = |light: f32| (255.0 * (0.2 * light / middle).min(1.0).powf(1.0 / 2.2)) as u8;
    let mut file = std::io::BufWriter::new(std::fs::File::create(out)?);
    writeln!(file, "P6 {} {} 255", page.width, page.height)?;
    page.texels.iter().try_for_each(|texel| file.write_all(&texel.map(byte)))?;
    Ok(file.flush()?)
}
