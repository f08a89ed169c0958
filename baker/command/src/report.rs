//! The bake's part of a report: error against run time, what was done, what was skipped.

use baker::Result;
use baker::bake::errors::{EYE_ROOM, LEAST_IRRADIANCE, LocalErrorSummary, PICTURE_STEP, VISIBLE_PART};
use baker::bake::finish::{Check, FrameCheck};
use baker::bake::output::ERRORS_FILE;
use baker::bake::run::{Integrator, Outcome};
use baker::bake::store::CELL;
use dataset::image::Image;
use dataset::observe::count;
use dataset::pictures::View;
use dataset::store::Dataset;
use reports::Section;
use reports::plot::Plot;
use reports::scene::PICTURE;

/// Local error against run time: as traced, and of rounds that were denoised, and in the end, what was left.
fn error_plot(outcome: &Outcome) -> Plot {
    let line = |name: &str, value: fn(&LocalErrorSummary) -> f64| {
        let points =
            outcome.rounds.iter().filter_map(|r| Some((r.seconds, value(r.local.as_ref()?) * 100.0)));
        (name.to_owned(), points.collect())
    };
    let denoised = |name: &str, value: fn(&LocalErrorSummary) -> f64| {
        let judged = outcome.rounds.iter().filter_map(|r| Some((r.seconds, r.denoised?)));
        let last = outcome.rounds.last().filter(|_| outcome.denoised.is_some());
        let last = last.filter(|r| r.denoised.is_none()).and_then(|r| Some((r.seconds, outcome.local.all?)));
        let points = judged.chain(last).map(|(seconds, local)| (seconds, value(&local) * 100.0));
        (format!("{name}, denoised"), points.collect())
    };
    let mut lines = vec![
        line("median cell", |local| local.median),
        line("95 % of cells", |local| local.p95),
        line("worst cell", |local| local.worst),
    ];
    if outcome.denoised.is_some() {
        lines.extend([
            denoised("median cell", |local| local.median),
            denoised("95 % of cells", |local| local.p95),
        ]);
    }
    Plot {
        title: "Estimated local error against run time".to_owned(),
        x: "seconds of tracing".to_owned(),
        y: "error of cells, %".to_owned(),
        log_x: true,
        log_y: true,
        lines,
    }
}

/// What cells of 16×16 texels are wrong by, hour by hour, and where.
fn add_local(section: &mut Section, outcome: &Outcome, dataset: &Dataset) -> Result<()> {
    section.subheading("Local error");
    section.paragraph(&format!(
        "The estimated standard error of cells of 16×16 texels, each texel relative to the mean light of its chart's part of the cell: what \
         shows as blotches. Light that is darker than 1/{:.0} of the median of what is seen from there, or than {:.0} µlx, counts as that bright. In a gap with less than {:.0} cm of room, what is seen from its opening counts. \
         Cells count by their texels. The bias of the cache is not in it (--check measures it).",
        1.0 / VISIBLE_PART,
        LEAST_IRRADIANCE * 1e9,
        EYE_ROOM * 100.0
    ));
    if let Some(picture) = error_picture(outcome, dataset)? {
        section.row(&[picture]);
        section.paragraph(
            "Where it is, at the worst hour: blue 1 % or less, green 3 %, yellow 5 %, red 10 %, white 30 % or more; grey has no texels or no light.",
        );
    }
    section.plot(&error_plot(outcome));
    outcome.denoised_in_words().into_iter().for_each(|what| {
        section.paragraph(&format!(
            "{}. The table shows the error that is left after denoising.",
            capitalised(&what)
        ));
    });
    outcome.local.advice.iter().for_each(|what| {
        section.paragraph(&format!("{}.", capitalised(what)));
    });
    let percent = |v: f64| format!("{:.1}", v * 100.0);
    let row = |hour: String, local: &Option<LocalErrorSummary>| match local {
        None => vec![hour, "no light".to_owned()],
        Some(LocalErrorSummary { median, p95, worst, over }) => [median, p95, worst]
            .into_iter()
            .chain(over)
            .map(|v| percent(*v))
            .fold(vec![hour], |mut row, cell| {
                row.push(cell);
                row
            }),
    };
    let hours = outcome.hours.iter().zip(&outcome.local.frames);
    let rows: Vec<_> = std::iter::once(row("all".to_owned(), &outcome.local.all))
        .chain(hours.map(|(hour, local)| row(format!("{hour:.2}"), local)))
        .collect();
    section.table(
        &[
            "hour",
            "median cell, %",
            "95 % of cells, %",
            "worst, %",
            "cells over 5 %, %",
            "over 10 %",
            "over 20 %",
        ],
        &rows,
    );
    Ok(())
}

/// The scene in colours of the local errors at the worst hour; `None` where it cannot be shown.
fn error_picture(outcome: &Outcome, dataset: &Dataset) -> Result<Option<(String, Vec<Vec<u8>>)>> {
    let Some((hour, _)) = outcome.worst_hour() else { return Ok(None) };
    let config = &dataset.config;
    // (What is wrong with the geometry is told where the scene is shown.)
    let Ok(Some(view)) = View::of(dataset, PICTURE) else { return Ok(None) };
    let Ok(errors) = image::open(dataset.root.join(ERRORS_FILE)) else { return Ok(None) };
    let errors = errors.to_luma8();
    let heights: Vec<usize> = config.pages.iter().map(|page| page.height as usize).collect();
    let light = view.light(config, |page, rows| {
        let (width, first) = (config.pages[page].width as usize, heights[..page].iter().sum::<usize>());
        let texel = |x: usize, y: usize| {
            let code = errors
                .get_pixel_checked((x / CELL) as u32, ((first + y) / CELL) as u32)
                .map_or(0, |p| p.0[0]);
            colour(f64::from(code) * PICTURE_STEP)
        };
        let texels =
            rows.clone().flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect();
        Ok(Image { width, height: rows.len(), texels })
    })?;
    Ok(Some((format!("{hour} h"), vec![view.to_map(&light)])))
}

/// The colour of an error: on a logarithmic scale from 1 to 30 %.
fn colour(error: f64) -> [f32; 3] {
    const STOPS: [(f64, [f32; 3]); 5] = [
        (0.01, [0.03, 0.08, 0.5]),
        (0.03, [0.03, 0.45, 0.2]),
        (0.05, [0.9, 0.75, 0.05]),
        (0.1, [0.75, 0.04, 0.02]),
        (0.3, [1.0, 1.0, 1.0]),
    ];
    if error <= 0.0 {
        return [0.1; 3];
    }
    let above = STOPS.iter().position(|(stop, _)| error < *stop).unwrap_or(STOPS.len());
    let Some(((low, a), (high, b))) = above.checked_sub(1).and_then(|i| Some((STOPS[i], *STOPS.get(above)?)))
    else {
        return STOPS[above.min(STOPS.len() - 1)].1;
    };
    let share = ((error / low).ln() / (high / low).ln()) as f32;
    std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))
}

/// Where light was lost or gained beyond chance, by the light of the texels concerned, in words.
pub(crate) fn worst_eighth(outcome: &Outcome, check: &Check) -> String {
    match check.worst_eighth() {
        Some((frame, eighth)) => {
            let hour = outcome.hours.get(frame).copied().unwrap_or_default();
            format!("by brightness, relative to the light there: {} (at {hour:.2} h)", eighth.words())
        }
        None => "by brightness, no eighth of the texels lost or gained light beyond their scatter".to_owned(),
    }
}

/// The true error of the checked texels, frame by frame.
fn add_check(section: &mut Section, outcome: &Outcome, check: &Check) {
    section.subheading("Checked against unbiased paths");
    section.paragraph(&format!(
        "Traced again by {} unbiased paths each: {}. True error: root mean square of the difference, the noise of the \
         second tracing taken out; the estimated error is that of the same texels. Bias: what of the true error the estimated one \
         does not explain. These are relative to the mean light of the checked texels, so dark regions weigh little in them. Own \
         error: the median of |difference| ÷ the texel's own light, dark texels counting as much as bright ones; of it, the second \
         tracing's own noise accounts for what stands in brackets.",
        check.samples,
        count(check.texels, "texel")
    ));
    let percent = |v: f64| format!("{:.2}", v * 100.0);
    let hour = |frame: usize| format!("{:.2}", outcome.hours.get(frame).copied().unwrap_or_default());
    let row = |s: &FrameCheck| {
        vec![
            hour(s.frame),
            s.measured_error.map_or("below the noise".to_owned(), percent),
            percent(s.estimated_error),
            percent(s.bias),
            percent(s.mean_difference),
            percent(s.reference_noise),
            format!("{} ({})", percent(s.own_error), percent(s.own_reference_noise)),
        ]
    };
    let rows: Vec<Vec<String>> = check.frames.iter().map(row).collect();
    section.table(
        &[
            "hour",
            "true error, %",
            "estimated, %",
            "bias, %",
            "mean difference, %",
            "second tracing's noise, %",
            "own error (noise), %",
        ],
        &rows,
    );
    section.paragraph(
        "Estimated ÷ measured error by brightness: the checked texels sorted into eighths; in brackets the measured one, root mean \
         square ÷ the light of the eighth, in %; ± the standard error of the ratio. Below 1 the estimate does not tell all: what it lacks is \
         bias. As many texels of each octave of light were chosen as there are.",
    );
    let row = |s: &FrameCheck| {
        let cell = |rank| match s.estimates.iter().find(|estimate| estimate.rank == rank) {
            Some(estimate) => match (estimate.ratio(), estimate.measured, estimate.standard_error) {
                (Some(ratio), Some(measured), Some(error)) => {
                    format!("{ratio:.2} ± {:.2} ({:.1})", ratio * error, measured * 100.0)
                }
                _ => format!("below the noise ({:.1} estimated)", estimate.estimated * 100.0),
            },
            None => "–".to_owned(),
        };
        std::iter::once(hour(s.frame)).chain((0..8).map(cell)).collect()
    };
    let rows: Vec<Vec<String>> = check.frames.iter().map(row).collect();
    section.table(&["hour", "darkest", "2", "3", "4", "5", "6", "7", "brightest"], &rows);
    section.paragraph(&format!(
        "Light lost (−) or gained (+) by brightness: the checked texels sorted into eighths, the difference summed over each ÷ the \
         light there, in %, ± its standard error, from the scatter of the texels (too small where a few of them hold most of the \
         light). {}.",
        capitalised(&worst_eighth(outcome, check))
    ));
    let row = |s: &FrameCheck| {
        let cell = |rank| match s.eighths.iter().find(|e| e.rank == rank) {
            Some(e) => format!("{:+.1} ± {:.1}", e.difference * 100.0, e.standard_error * 100.0),
            None => "–".to_owned(),
        };
        std::iter::once(hour(s.frame)).chain((0..8).map(cell)).collect()
    };
    let rows: Vec<Vec<String>> = check.frames.iter().map(row).collect();
    section.table(&["hour", "darkest", "2", "3", "4", "5", "6", "7", "brightest"], &rows);
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// The section of a bake.
///
/// # Errors
/// As reading the dataset's geometry.
pub(crate) fn section(outcome: &Outcome, dataset: &Dataset) -> Result<Section> {
    let mut section = Section::new("Bake");
    let how = match outcome.integrator {
        Integrator::Cached => {
            "Paths end at the first surface, where the light of the whole day was solved for beforehand (integrator \
             cached: biased by the size of a texel; --check measures by how much)."
        }
        Integrator::Path => "Paths were followed to their end (integrator path: unbiased).",
    };
    section.paragraph(&format!(
        "{:.0} samples per texel on average; the last round went for {} (more where they differ), in {:.1} s of tracing. {how} The estimated error of tiles is as that \
         of frames above, but over each tile of 128×128 texels and relative to the tile's own mean light: its median over tiles and \
         frames is {:.2} %.",
        outcome.mean_samples,
        outcome.samples,
        outcome.rounds.last().map_or(0.0, |r| r.seconds),
        outcome.relative_error * 100.0
    ));
    add_local(&mut section, outcome, dataset)?;
    if let Some(check) = &outcome.check {
        add_check(&mut section, outcome, check);
    }
    section.list(&outcome.facts);
    if !outcome.up_to_date {
        let rays = outcome.rays;
        let total = rays.rays().max(1) as f64;
        let row = |what: &str, n: u64| {
            vec![
                what.to_owned(),
                format!("{:.1}", n as f64 / 1e6),
                format!("{:.1}", n as f64 / total * 100.0),
            ]
        };
        section.table(
            &["rays", "millions", "%"],
            &[
                row("path segments", rays.path),
                row("shadow rays to the sun", rays.sun),
                row("shadow rays to lamps", rays.lamp),
                row("shadow rays to the sky", rays.sky),
                row("shadow rays to bright surfaces", rays.bright_surface),
                row("tests for points inside solids or behind walls", rays.inside),
            ],
        );
    }
    section.paragraph("Skipped, and why:");
    section.list(&outcome.skipped);
    if !outcome.warnings.is_empty() {
        section.paragraph("Warnings:");
        section.list(&outcome.warnings);
    }
    Ok(section)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_go_from_blue_to_white_without_a_step() {
        assert_eq!(colour(0.0), [0.1; 3]);
        assert_eq!(colour(0.004), colour(0.01));
        assert_eq!(colour(0.5), [1.0; 3]);
        for (from, to) in (40..700).map(|i| (f64::from(i) * 5e-4, f64::from(i + 1) * 5e-4)) {
            let [a, b] = [from, to].map(colour);
            assert!((0..3).all(|c| (a[c] - b[c]).abs() < 0.08), "{from}: {a:?} {b:?}");
        }
    }
}
