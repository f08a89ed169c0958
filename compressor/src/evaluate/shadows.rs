//! The sun's direct light between frames: a bundle's compared with the dataset's visibility as a function of
//! time. Traces no rays.

use super::strips::decode;
use crate::Result;
use crate::decode::{Decoder, Lights};
use crate::mean::mean;
use dataset::format::{Between, Planes, TILE};
use dataset::host::signals::stop_if_interrupted;
use dataset::observe::Observer;
use dataset::pictures::metrics;
use dataset::store::Dataset;

/// Times of a day that are evaluated, evenly from sunrise to sunset. Times of visibility are about an hour
/// apart; with fewer times too large a share of them may lie near one.
const TIMES: usize = 40;
/// Tiles whose light is below this share of the sun's are not evaluated: next to nothing is lit.
const LIT: f64 = 0.01;

/// PSNR of the sun's direct light over (tile, time), peak = the tile's brightest at that time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadows {
    /// From the mean squared error relative to the peak.
    pub pooled_db: f64,
    /// The mean.
    pub mean_db: f64,
    /// The mean of the worst 5 % of the pairs, at least one.
    pub worst_db: f64,
    /// Pairs evaluated.
    pub pairs: usize,
}

/// Evaluates a bundle whose sun is a separate stream, on tiles of 128×128 texels. `None` if nothing is lit.
pub(super) fn shadows(
    dataset: &Dataset,
    decoder: &Decoder,
    console: &dyn Observer,
) -> Result<Option<Shadows>> {
    let path = dataset.sun_path()?.filter(|_| decoder.bundle().header.sun.is_some());
    let Some(path) = path else { return Ok(None) };
    let is_up = |i: &usize| path.irradiance[*i] != [0.0; 3];
    let (first, last) = ((0..path.hours.len()).find(is_up), (0..path.hours.len()).rfind(is_up));
    let Some((first, last)) = first.zip(last) else { return Ok(None) };
    let (rise, frame) = (path.hours[first], path.hours[last]);
    let hours: Vec<f64> =
        (0..TIMES).map(|i| rise + (frame - rise) * (i as f64 + 0.5) / TIMES as f64).collect();
    let (mut errors, mut decibels) = (Vec::new(), Vec::new());
    let progress = console.progress("the sun between frames", dataset.config.pages.len() as u64);
    for page in 0..dataset.config.pages.len() {
        let mask = dataset.mask(page)?;
        let Some(sunlight) = dataset.sunlight(page)? else { return Ok(None) };
        for y0 in (0..mask.height).step_by(TILE) {
            stop_if_interrupted()?;
            let rows = y0..(y0 + TILE).min(mask.height);
            if !mask.valid[rows.start * mask.width..rows.end * mask.width].contains(&true) {
                continue;
            }
            let tiles = sunlight.visibility.tiles.iter().enumerate().filter(|(_, rect)| rect.y0 == y0);
            let tiles = tiles.map(|(i, rect)| Ok((*rect, sunlight.visibility.tile(i)?)));
            let tiles: Vec<(dataset::format::Rect, Planes)> = tiles.collect::<Result<_>>()?;
            for &hour in &hours {
                let Some((_, irradiance)) = path.at(hour) else { continue };
                let decoded = decode(decoder, Lights::Sun, page, hour, &rows)?;
                let between = Between::new(&sunlight.visibility.hours, hour);
                for (rect, planes) in &tiles {
                    let seen = |texel: usize| {
                        let level = |time: usize| {
                            planes
                                .level(texel, time)
                                .map(|l| f32::from(l) / f32::from(sunlight.visibility.top))
                        };
                        let (before, after) = (level(between.before), level(between.after));
                        [0, 1, 2].map(|c| between.lerp(before[c], after[c]))
                    };
                    let (mut sum, mut count, mut peak) = (0.0, 0usize, 0.0f64);
                    for (texel, (x, y)) in
                        (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))).enumerate()
                    {
                        let i = y * mask.width + x;
                        if !mask.valid[i] {
                            continue;
                        }
                        let wanted = path.light(hour, sunlight.normals.normals[i], seen(texel));
                        let found = decoded.texels[(y - rows.start) * mask.width + x];
                        for c in 0..3 {
                            sum += (f64::from(found[c]) - f64::from(wanted[c])).powi(2);
                            peak = peak.max(f64::from(wanted[c]));
                        }
                        count += 3;
                    }
                    if count > 0 && peak > LIT * f64::from(irradiance.into_iter().fold(0.0, f32::max)) {
                        let error = sum / count as f64;
                        errors.push(error / (peak * peak));
                        decibels.push(metrics::psnr_db(peak, error));
                    }
                }
            }
        }
        progress.advance(1);
    }
    decibels.sort_by(f64::total_cmp);
    let worst = &decibels[..decibels.len().div_ceil(20)];
    let (Some(pooled), Some(mean_db), Some(worst_db)) =
        (mean(errors.into_iter()), mean(decibels.iter().copied()), mean(worst.iter().copied()))
    else {
        return Ok(None);
    };
    Ok(Some(Shadows { pooled_db: metrics::psnr_db(1.0, pooled), mean_db, worst_db, pairs: decibels.len() }))
}
