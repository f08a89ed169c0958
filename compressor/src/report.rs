//! Report sections: summary (`lead`), what is seen (`seen`), training curves, quality table, pictures,
//! omissions.

mod lead;
mod seen;

pub use lead::lead;
pub use seen::seen;

use crate::Result;
use crate::compress::{Outcome, TileOutcome};
use crate::decode::{Decoder, Lights};
use crate::evaluate::{COLUMNS, Evaluation, cell, decode, read, reference_law, strips, valid};
use crate::mean::mean;
use dataset::image::Image;
use dataset::pictures::preview::{Reduction, exposure, tone_mapped_png};
use dataset::store::Dataset;
use reports::Section;
use reports::plot::Plot;
use reports::scene::shown_frames;
use std::collections::BTreeMap;

/// A page of at most this many texels is decoded whole for a picture.
const SMALL: usize = 1 << 22;
/// Errors are shown this much brighter than the light.
const ERROR_GAIN: f32 = 16.0;
/// Longest side of a picture in texels.
const PICTURE_SIDE: usize = 320;
/// Remarks listed before the rest is summed up.
const LISTED: usize = 20;

/// PSNR against seconds of training.
pub fn training(outcome: &Outcome) -> Section {
    let decibels = |db: Option<f64>| db.map_or("–".to_owned(), |db| format!("{db:.2} dB"));
    if outcome.is_basis {
        let mut section = Section::new("Encoding");
        section.paragraph(&format!(
            "{} tiles, {} of them without light, {} reused from an earlier run; {:.1} s of wall-clock time, {:.1} CPU seconds of \
             encoding planes. PSNR of the maps, mean over tiles weighted by their texels, at peaks with the sun's direct light: {}.",
            outcome.tiles,
            outcome.empty,
            outcome.resumed,
            outcome.seconds,
            outcome.training_seconds,
            decibels(outcome.psnr_trained_db),
        ));
        return section;
    }
    let mut section = Section::new("Training");
    section.paragraph(&format!(
        "{} tiles, {} of them without light, {} reused from an earlier run; {:.1} s of wall-clock time, {:.1} CPU seconds of \
         training. Steps per tile: {}. PSNR of the maps, mean over tiles weighted by their texels: before quantisation {}, with \
         8-bit features {}, as stored in BC7 {}.",
        outcome.tiles,
        outcome.empty,
        outcome.resumed,
        outcome.seconds,
        outcome.training_seconds,
        match outcome.steps {
            None => "–".to_owned(),
            Some([least, most]) if least == most => least.to_string(),
            Some([least, most]) => format!("{least} to {most}"),
        },
        decibels(outcome.psnr_unquantised_db),
        decibels(outcome.psnr_8bit_features_db),
        decibels(outcome.psnr_trained_db),
    ));
    let line = |value: &dyn Fn(&crate::compress::CurvePoint) -> f64| {
        outcome.curve.iter().map(|point| (point.seconds, value(point))).collect()
    };
    if !outcome.curve.is_empty() {
        section.plot(&Plot {
            title: "Quality against training time".to_owned(),
            x: "CPU seconds per tile".to_owned(),
            y: "PSNR in dB; drops where the maps are quantised".to_owned(),
            log_x: false,
            log_y: false,
            lines: vec![
                ("mean over tiles, weighted by texels".to_owned(), line(&|point| point.mean_db)),
                ("worst tile".to_owned(), line(&|point| point.worst_db)),
            ],
        });
    }
    section
}

/// The quality table by hour and the worst tiles, after remarks on targets and limits.
pub fn quality(evaluation: &Evaluation, remarks: &[String]) -> Section {
    let mut section = Section::new("Quality");
    section.paragraph(
        "Decoded from the written bundle. Tiles of 128×128 texels, valid texels only, linear RGB; peak = the tile's largest valid \
         value; means over tiles. Pooled: from the mean squared error relative to the peak. 8-bit: after an output of three \
         mantissas and a shared exponent. Log: of ln(1 + E/ε), ε a thousandth of the page's mean, where equal ratios weigh the same. In the \
         dark: the relative error over the darkest quarter of the frame's texels, whose mean counts as a thousandth of the frame's where it is \
         less. The noise ceiling is the bake's own sampling error as a PSNR: above it, a bundle is closer to this bake than this bake is to the truth.",
    );
    section.list(&remarks.iter().cloned().chain(evaluation.remarks()).collect::<Vec<_>>());
    section.table(&COLUMNS, &evaluation.rows());
    let quality =
        |hour: &(f64, crate::evaluate::Quality), value: Option<f64>| value.map(|value| (hour.0, value));
    let hours = &evaluation.by_hour;
    section.plot(&Plot {
        title: "Quality over the day".to_owned(),
        x: "hour".to_owned(),
        y: "dB".to_owned(),
        log_x: false,
        log_y: false,
        lines: vec![
            ("PSNR".to_owned(), hours.iter().filter_map(|h| quality(h, h.1.psnr_db)).collect()),
            (
                "worst 1 %".to_owned(),
                hours.iter().filter_map(|h| quality(h, h.1.psnr_worst_percent_db)).collect(),
            ),
            (
                "noise ceiling".to_owned(),
                hours.iter().filter_map(|h| quality(h, h.1.noise_ceiling_db)).collect(),
            ),
        ],
    });
    other_measures(evaluation, &mut section);
    let steps = |switch: bool| {
        let each = evaluation.steps.each.iter().filter(|step| step.switch == switch);
        each.filter_map(|step| Some((step.from, step.error?))).collect::<Vec<_>>()
    };
    if evaluation.steps.each.iter().any(|step| step.error.is_some()) {
        section.plot(&Plot {
            title: "Error of the change of light to the next frame".to_owned(),
            x: "hour".to_owned(),
            y: "RMS of the error ÷ RMS of the change".to_owned(),
            log_x: false,
            log_y: true,
            lines: vec![("same lamps".to_owned(), steps(false)), ("across a switch".to_owned(), steps(true))],
        });
    }
    worst_tiles(evaluation, &mut section);
    section
}

/// Means of metrics that are not in the table.
fn other_measures(evaluation: &Evaluation, section: &mut Section) {
    let (all, large) = (&evaluation.all, &evaluation.large);
    section.subheading("Other metrics");
    let row = |name: &str, value: String| vec![name.to_owned(), value];
    section.table(
        &["measure", "value"],
        &[
            row("PSNR dB, peak = largest − smallest", cell(all.psnr_range_db, 2)),
            row("1 − SSIM, 7×7 box window", cell(all.one_minus_ssim_uniform, 5)),
            row("PSNR dB, tiles of 256×256", cell(large.psnr_db, 2)),
            row("PSNR dB, tiles of 256×256, peak = largest − smallest", cell(large.psnr_range_db, 2)),
            row("1 − SSIM, tiles of 256×256", cell(large.one_minus_ssim, 5)),
            row("LPIPS", "not measured".to_owned()),
        ],
    );
}

/// The (tile, frame) pairs of least PSNR.
fn worst_tiles(evaluation: &Evaluation, section: &mut Section) {
    let mut worst: Vec<_> = evaluation
        .samples
        .iter()
        .filter(|s| !s.quality.constant)
        .filter_map(|s| Some((s.quality.psnr_db?, s)))
        .collect();
    worst.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Identical frames have identical PSNRs: only the first is listed.
    let mut shown = std::collections::BTreeSet::new();
    worst.retain(|(db, s)| shown.insert((s.page, s.rect.y0, s.rect.x0, db.to_bits())));
    let rows: Vec<Vec<String>> = worst
        .iter()
        .take(8)
        .map(|(db, s)| {
            let place = format!("{}–{}, {}–{}", s.rect.x0, s.rect.x1, s.rect.y0, s.rect.y1);
            let ceiling = cell(s.noise_ceiling_db, 2);
            let hour = evaluation.by_hour[s.frame].0;
            vec![
                hour.to_string(),
                s.page.to_string(),
                place,
                s.quality.texels.to_string(),
                format!("{db:.2}"),
                ceiling,
            ]
        })
        .collect();
    section.subheading("The worst tiles");
    section.paragraph("Of identical frames, only the first.");
    section.table(&["hour", "page", "texels x, y", "valid texels", "PSNR dB", "noise ceiling dB"], &rows);
}

/// Decoded pages, reference and difference at a few hours.
///
/// # Errors
/// As reading the dataset and the bundle.
pub fn pictures(dataset: &Dataset, decoder: &Decoder) -> Result<Section> {
    let mut section = Section::new("Decoded and reference");
    section.paragraph(&format!(
        "Reference, decoded, and the absolute difference {ERROR_GAIN} times brighter, each hour with its own exposure."
    ));
    let (frames, law) = (&dataset.config.frames, reference_law(decoder));
    for k in shown_frames(&dataset.config) {
        for page in 0..dataset.config.pages.len() {
            let hour = frames[k].hour;
            let mask = dataset.mask(page)?;
            let new = || Reduction::new(mask.width, mask.height, PICTURE_SIDE);
            let mut reductions = [new(), new(), new()];
            let mut next = 0;
            for rows in strips(&mask) {
                let (reference, decoded) =
                    (read(dataset, &law, k, page, &rows)?, decode(decoder, Lights::All, page, hour, &rows)?);
                let error = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (a[c] - b[c]).abs());
                let difference: Vec<_> = reference.texels.iter().zip(&decoded.texels).map(error).collect();
                let all = [&reference.texels, &decoded.texels, &difference];
                for (reduction, texels) in reductions.iter_mut().zip(all) {
                    reduction.skip_rows(rows.start - next);
                    reduction.add_rows(texels, valid(&mask, &rows));
                }
                next = rows.end;
            }
            let [(reference, mask), (decoded, _), (difference, _)] = reductions.map(Reduction::finish);
            let bright = exposure(&reference, &mask);
            let picture =
                |image: &Image, gain: f32| tone_mapped_png(image, &mask, gain * bright, PICTURE_SIDE);
            section.pictures(&[
                (format!("page {page}, {hour} h, reference"), picture(&reference, 1.0)),
                ("decoded".to_owned(), picture(&decoded, 1.0)),
                (format!("difference × {ERROR_GAIN}"), picture(&difference, ERROR_GAIN)),
            ]);
        }
    }
    between_frames(dataset, decoder, &mut section)?;
    Ok(section)
}

/// A quarter of an hour after the frame in the middle of the day, or between it and the next where they are
/// closer: the first page, where it is of modest size and the bundle has a sun, next to the dataset's own
/// light there.
fn between_frames(dataset: &Dataset, decoder: &Decoder, section: &mut Section) -> Result<()> {
    let Some(sun) = &decoder.bundle().header.sun else { return Ok(()) };
    let mask = dataset.mask(0)?;
    if mask.valid.len() > SMALL {
        return Ok(());
    }
    let middle = sun.times.len().saturating_sub(1) / 2;
    let Some([frame, next]) = sun.times.get(middle..middle + 2) else { return Ok(()) };
    let hour = frame + 0.25_f64.min((next - frame) / 2.0);
    // The middle of the day may lie in hours that were not baked.
    if dataset.sun_path()?.is_none_or(|path| path.at(hour).is_none()) {
        return Ok(());
    }
    let reference = dataset.light_at(hour, 0)?;
    let decoded = decode(decoder, Lights::All, 0, hour, &(0..mask.height))?;
    let new = || Reduction::new(mask.width, mask.height, PICTURE_SIDE);
    let reduced = [&reference, &decoded].map(|image| {
        let mut reduction = new();
        reduction.add_rows(&image.texels, &mask.valid);
        reduction.finish()
    });
    let [(reference, mask), (decoded, _)] = reduced;
    let bright = exposure(&reference, &mask);
    let picture = |image: &Image| tone_mapped_png(image, &mask, bright, PICTURE_SIDE);
    section.paragraph(match decoder.bundle().header.shadows {
        true => "Between two frames the bundle's shadows of the sun move. They are compared with the dataset's visibility of the sun at that time.",
        false => "Between two frames the bundle's shadows of the sun cross-fade; the dataset's visibility shows where they are.",
    });
    section.pictures(&[
        (format!("page 0, {hour} h, the dataset's light"), picture(&reference)),
        ("decoded".to_owned(), picture(&decoded)),
    ]);
    Ok(())
}

/// Tile configurations and what training omitted and why, including the sun's direct light.
pub fn omitted(outcome: &Outcome, is_sun: bool) -> Section {
    let mut section = Section::new("Tile configurations, and what the compressor omitted");
    let mut kinds: BTreeMap<&str, Vec<&TileOutcome>> = BTreeMap::new();
    for tile in &outcome.per_tile {
        kinds.entry(tile.has.as_deref().unwrap_or("nothing")).or_default().push(tile);
    }
    let row = |(has, tiles): (&&str, &Vec<&TileOutcome>)| {
        let psnr = mean(tiles.iter().filter_map(|tile| tile.psnr_db));
        let bytes: usize = tiles.iter().map(|tile| tile.bytes).sum();
        let psnr = psnr.map_or("–".to_owned(), |db| format!("{db:.2}"));
        vec![has.to_string(), tiles.len().to_string(), bytes.to_string(), psnr]
    };
    let rows: Vec<Vec<String>> = kinds.iter().map(row).collect();
    section.table(&["maps and inputs", "tiles", "bytes", "mean PSNR of the maps, dB"], &rows);
    let tiles = |n: usize| if n == 1 { "1 tile".to_owned() } else { format!("{n} tiles") };
    let mut items: Vec<String> =
        outcome.omitted.iter().take(LISTED).map(|(remark, n)| format!("{}: {remark}", tiles(*n))).collect();
    if outcome.omitted.len() > LISTED {
        let rest = outcome.omitted[LISTED..].iter().map(|(_, n)| n).sum::<usize>();
        items.push(format!("{rest} further remarks; all are in the bundle's run.json"));
    }
    if is_sun {
        items.insert(0, "the bundle: the sun's direct light (--without-sun)".to_owned());
    }
    if items.is_empty() {
        section.paragraph("Nothing.");
    } else {
        section.list(&items);
    }
    section
}
