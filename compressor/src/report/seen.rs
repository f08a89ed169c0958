//! What is seen of the errors: a table by hour, a plot, and the worst tile close up.

use crate::Result;
use crate::decode::{Decoder, Lights};
use crate::evaluate::{Evaluation, Quality, clock, decode, percent, read, reference_law, valid};
use crate::seen::Quantiles;
use dataset::format::Rect;
use dataset::image::{Image, Mask};
use dataset::pictures::preview::tone_mapped_png;
use dataset::pictures::tone::luminance;
use dataset::store::Dataset;
use reports::Section;
use reports::plot::Plot;
use std::ops::Range;

/// Differences in the worst tile are shown this much brighter than the light.
const GAIN: f32 = 2.0;
/// What the median luminance of the worst tile becomes, so that its dark parts show.
const MIDDLE_GREY: f32 = 0.18;
/// Pixels along each side of a texel.
const ZOOM: usize = 2;

/// The section, whose errors are relative to the light around each texel.
///
/// # Errors
/// As reading the dataset and the bundle.
pub fn seen(dataset: &Dataset, decoder: &Decoder, evaluation: &Evaluation) -> Result<Section> {
    let mut section = Section::new("What is seen");
    section.paragraph(&format!("{}.", evaluation.seen_sentence()));
    worst_tile(dataset, decoder, evaluation, &mut section)?;
    section.subheading("By hour");
    section.paragraph(
        "Local error: a texel's error (root mean square over red, green and blue) relative to the mean light of its cell of 16×16 texels, or to 1/30 \
         of the median light of its tile where that is more. Chroma: the part of it that is not grey. Δu′v′: the distance of the colours (CIE 1976) \
         where the light is above that floor. Half, 95 % and 99 % of the texels have at most these errors.",
    );
    let line = |of: fn(&Quality) -> Option<Quantiles>, value: fn(Quantiles) -> f64| {
        let points = evaluation.by_hour.iter();
        points.filter_map(|(hour, quality)| Some((*hour, 100.0 * value(of(quality)?)))).collect()
    };
    let local = |quality: &Quality| quality.seen.local;
    section.plot(&Plot {
        title: "Local error over the day".to_owned(),
        x: "hour".to_owned(),
        y: "% of the light around".to_owned(),
        log_x: false,
        log_y: true,
        lines: vec![
            ("99 % of texels".to_owned(), line(local, |q| q.p99)),
            ("95 %".to_owned(), line(local, |q| q.p95)),
            ("median".to_owned(), line(local, |q| q.median)),
            ("chroma, 95 %".to_owned(), line(|quality| quality.seen.chroma, |q| q.p95)),
        ],
    });
    section.table(&evaluation.seen_columns(), &evaluation.seen_rows());
    Ok(section)
}

/// The worst tile in the dataset and in the bundle, and their difference.
fn worst_tile(
    dataset: &Dataset,
    decoder: &Decoder,
    evaluation: &Evaluation,
    section: &mut Section,
) -> Result<()> {
    let Some(worst) = evaluation.worst_tile else { return Ok(()) };
    let (Rect { x0, x1, y0, y1 }, page) = (worst.rect, worst.page);
    let hour = evaluation.by_hour[worst.frame].0;
    let rows = y0..y1;
    let reference = read(dataset, &reference_law(decoder), worst.frame, page, &rows)?;
    let decoded = decode(decoder, Lights::All, page, hour, &rows)?;
    let mask = dataset.mask(page)?;
    let mask =
        Mask { width: x1 - x0, height: rows.len(), valid: columns(valid(&mask, &rows), mask.width, x0..x1) };
    let [reference, decoded] = [reference, decoded].map(|image| Image {
        width: x1 - x0,
        height: rows.len(),
        texels: columns(&image.texels, image.width, x0..x1),
    });
    let error = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (a[c] - b[c]).abs());
    let texels = reference.texels.iter().zip(&decoded.texels).map(error).collect();
    let difference = Image { texels, ..reference };
    let bright = exposure(&reference, &mask);
    let picture = |image: &Image, gain: f32| {
        let (image, mask) = enlarged(image, &mask);
        tone_mapped_png(&image, &mask, gain * bright, image.width.max(image.height))
    };
    section.subheading("The worst tile");
    section.paragraph(&format!(
        "Page {page}, texels {x0}–{x1}, {y0}–{y1} at {}: one texel in twenty is off by {} or more of the light around it. Exposed for the tile's median.",
        clock(hour),
        percent(worst.local_p95)
    ));
    section.pictures(&[
        ("dataset".to_owned(), picture(&reference, 1.0)),
        ("bundle".to_owned(), picture(&decoded, 1.0)),
        (format!("difference × {GAIN}"), picture(&difference, GAIN)),
    ]);
    Ok(())
}

/// The exposure that makes the median of valid luminances that are not 0 middle grey; 1 without any.
fn exposure(image: &Image, mask: &Mask) -> f32 {
    let valid = image.texels.iter().zip(&mask.valid).filter(|(_, valid)| **valid);
    let mut luminances: Vec<f32> = valid.map(|(texel, _)| luminance(*texel)).filter(|y| *y > 0.0).collect();
    if luminances.is_empty() {
        return 1.0;
    }
    let middle = luminances.len() / 2;
    let (_, median, _) = luminances.select_nth_unstable_by(middle, f32::total_cmp);
    (MIDDLE_GREY / *median).clamp(f32::MIN_POSITIVE, f32::MAX)
}

/// Columns of rows of this width.
fn columns<T: Copy>(rows: &[T], width: usize, columns: Range<usize>) -> Vec<T> {
    rows.chunks_exact(width).flat_map(|row| row[columns.clone()].iter().copied()).collect()
}

/// Each texel as a square of pixels.
fn enlarged(image: &Image, mask: &Mask) -> (Image, Mask) {
    let (width, height) = (image.width * ZOOM, image.height * ZOOM);
    let texel = |i: usize| i / width / ZOOM * image.width + i % width / ZOOM;
    (
        Image { width, height, texels: (0..width * height).map(|i| image.texels[texel(i)]).collect() },
        Mask { width, height, valid: (0..width * height).map(|i| mask.valid[texel(i)]).collect() },
    )
}
