//! The bake's part of a report: error against run time, what was done, what was left out.

use crate::bake::check::{Check, SetCheck};
use crate::bake::rounds::Round;
use crate::bake::run::{Integrator, Outcome};
use dataset::console::count;
use dataset::report::Section;
use dataset::report::plot::Plot;

/// Error against run time.
fn error_plot(outcome: &Outcome) -> Plot {
    let line = |name: &str, value: fn(&Round) -> f64| {
        (name.to_owned(), outcome.rounds.iter().map(|r| (r.seconds, value(r) * 100.0)).collect())
    };
    Plot {
        title: "Estimated error of tiles against run time".to_owned(),
        x: "seconds of tracing".to_owned(),
        y: "relative error, %".to_owned(),
        log_x: true,
        log_y: true,
        lines: vec![
            line("median over (tile, set)", |r| r.median_error),
            line("95th percentile", |r| r.p95_error),
            line("worst", |r| r.worst_error),
        ],
    }
}

/// Where light was lost or gained beyond chance, by the light of the texels concerned, in words.
pub fn worst_eighth(outcome: &Outcome, check: &Check) -> String {
    match check.worst_eighth() {
        Some((set, eighth)) => {
            let hour = outcome.hours.get(set).copied().unwrap_or_default();
            format!("by brightness, relative to the light there: {} (at {hour:.2} h)", eighth.words())
        }
        None => "by brightness, no eighth of the texels lost or gained light beyond their scatter".to_owned(),
    }
}

/// The true error of the checked texels, set by set.
fn add_check(section: &mut Section, outcome: &Outcome, check: &Check) {
    section.subheading("Checked against unbiased walks");
    section.paragraph(&format!(
        "Traced again by {} unbiased walks each: {}. True error: root mean square of the difference, the noise of the \
         second tracing taken out; the estimated error is that of the same texels. Bias: what of the true error the estimated one \
         does not explain. These are relative to the mean light of the checked texels, so dark regions weigh little in them. Own \
         error: the median of |difference| ÷ the texel's own light, dark texels counting as much as bright ones; of it, the second \
         tracing's own noise accounts for what stands in brackets.",
        check.samples,
        count(check.texels, "texel")
    ));
    let percent = |v: f64| format!("{:.2}", v * 100.0);
    let hour = |set: usize| format!("{:.2}", outcome.hours.get(set).copied().unwrap_or_default());
    let row = |s: &SetCheck| {
        vec![
            hour(s.set),
            s.true_error.map_or("below the noise".to_owned(), percent),
            percent(s.estimated_error),
            percent(s.bias),
            percent(s.mean_difference),
            percent(s.reference_error),
            format!("{} ({})", percent(s.own_error), percent(s.own_reference_error)),
        ]
    };
    let rows: Vec<Vec<String>> = check.sets.iter().map(row).collect();
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
    section.paragraph(&format!(
        "Light lost (−) or gained (+) by brightness: the checked texels sorted into eighths, the difference summed over each ÷ the \
         light there, in %, ± its standard error, from the scatter of the texels (too small where a few of them hold most of the \
         light). {}.",
        capitalised(&worst_eighth(outcome, check))
    ));
    let row = |s: &SetCheck| {
        let cell = |place| match s.eighths.iter().find(|e| e.place == place) {
            Some(e) => format!("{:+.1} ± {:.1}", e.difference * 100.0, e.standard_error * 100.0),
            None => "–".to_owned(),
        };
        std::iter::once(hour(s.set)).chain((0..8).map(cell)).collect()
    };
    let rows: Vec<Vec<String>> = check.sets.iter().map(row).collect();
    section.table(&["hour", "darkest", "2", "3", "4", "5", "6", "7", "brightest"], &rows);
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// The section of a bake.
pub fn section(outcome: &Outcome) -> Section {
    let mut section = Section::new("Bake");
    let how = match outcome.integrator {
        Integrator::Cached => {
            "Walks end at the first surface, where the light of the whole day was solved for beforehand (integrator \
             cached: biased by the size of a texel; --check measures by how much)."
        }
        Integrator::Path => "Walks were followed to their end (integrator path: unbiased).",
    };
    section.paragraph(&format!(
        "{:.0} samples per texel on average; the last round went for {} (more where they differ), in {:.1} s of tracing. {how} The estimated error of tiles is as that \
         of sets above, but over each tile of 128×128 texels and relative to the tile's own mean light: its median over tiles and \
         sets is {:.2} %.",
        outcome.mean_samples,
        outcome.samples,
        outcome.rounds.last().map_or(0.0, |r| r.seconds),
        outcome.relative_error * 100.0
    ));
    if !outcome.rounds.is_empty() {
        section.plot(&error_plot(outcome));
    }
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
                row("walk segments", rays.walk),
                row("shadow rays to the sun", rays.sun),
                row("shadow rays to lamps", rays.lamp),
                row("shadow rays to the sky", rays.sky),
                row("shadow rays to bright surfaces", rays.reflector),
                row("tests for points inside solids or behind walls", rays.inside),
            ],
        );
    }
    section.paragraph("Left out:");
    section.list(&outcome.left_out);
    if !outcome.warnings.is_empty() {
        section.paragraph("Warnings:");
        section.list(&outcome.warnings);
    }
    section
}
