//! How far the light of a halved dataset is from the mean of the full one's:
//! `cargo run --release -p compressor --example halved_error -- FULL HALF`.
//!
//! Of the lightmaps, which are means but for rounding, and of the sun's direct light by visibility and
//! normals, hour by hour: RMS of the difference over valid texels and channels, divided by the RMS of the
//! light.

use dataset::Result;
use dataset::image::{Image, Mask};
use dataset::store::Dataset;
use std::path::PathBuf;

fn main() -> Result<()> {
    let folders: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [full, half] = &folders[..] else {
        eprintln!("usage: halved_error FULL HALF (two folders of datasets)");
        return Ok(());
    };
    let (full, half) = (Dataset::open(full)?, Dataset::open(half)?);
    let (mut maps, mut all) = ([0.0; 2], [0.0; 2]);
    for page in 0..full.config.pages.len() {
        let mask = full.mask(page)?;
        for frame in 0..full.config.frames.len() {
            add(&mut maps, errors(&mask, &full.map(frame, page)?, &half.map(frame, page)?));
        }
        let (Some(sunlight), Some(halved)) = (full.sunlight(page)?, half.sunlight(page)?) else { continue };
        for pair in sunlight.visibility.hours.windows(2) {
            for hour in [pair[0], 0.5 * (pair[0] + pair[1])] {
                let found = errors(&mask, &sunlight.at(hour)?, &halved.at(hour)?);
                println!("page {page}, {hour:>8.4} h: direct light of the sun {:.4}", relative(found));
                add(&mut all, found);
            }
        }
    }
    println!("lightmaps {:.2e}, the sun's direct light {:.4}", relative(maps), relative(all));
    Ok(())
}

fn add(sum: &mut [f64; 2], more: [f64; 2]) {
    (0..2).for_each(|i| sum[i] += more[i]);
}

fn relative([error, light]: [f64; 2]) -> f64 {
    (error / light.max(f64::MIN_POSITIVE)).sqrt()
}

/// Squares of the difference and of the mean light, summed over the half's valid texels.
fn errors(mask: &Mask, full: &Image, half: &Image) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for (texel, found) in half.texels.iter().enumerate() {
        let (x, y) = (2 * (texel % half.width), 2 * (texel / half.width));
        let inside =
            (y..(y + 2).min(full.height)).flat_map(|y| (x..(x + 2).min(full.width)).map(move |x| (x, y)));
        let valid: Vec<usize> = inside.map(|(x, y)| y * full.width + x).filter(|&i| mask.valid[i]).collect();
        if valid.is_empty() {
            continue;
        }
        for (channel, found) in found.iter().enumerate() {
            let sum: f64 = valid.iter().map(|i| f64::from(full.texels[*i][channel])).sum();
            let mean = sum / valid.len() as f64;
            sums[0] += (mean - f64::from(*found)).powi(2);
            sums[1] += mean * mean;
        }
    }
    sums
}
