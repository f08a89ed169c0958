//! The bake's part of a report: error against run time, what was done, what was left out.

use crate::bake::check::{Check, SetCheck};
use crate::bake::rounds::Round;
use crate::bake::run::{Integrator, Outcome};
use dataset::report::Section;
use dataset::report::plot::Plot;

/// Error against run time.
fn error_plot(outcome: &Outcome) -> Plot {
    let line = |name: &str, value: fn(&Round) -> f64| {
        (name.to_owned(), outcome.rounds.iter().map(|r| (r.seconds, value(r) * 100.0)).collect())
    };
    Plot {
        title: "Estimated error against run time".to_owned(),
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

/// The true error of the checked texels, set by set.
fn add_check(section: &mut Section, outcome: &Outcome, check: &Check) {
    section.paragraph(&format!(
        "{} texels were traced again by {} unbiased walks each. True error: root mean square of the difference, the noise of the \
         second tracing taken out. Bias: what of it the estimated error does not explain. All relative to the mean light of \
         these texels.",
        check.texels, check.samples
    ));
    let percent = |v: f64| format!("{:.2}", v * 100.0);
    let row = |s: &SetCheck| {
        let hour = outcome.hours.get(s.set).copied().unwrap_or_default();
        vec![
            format!("{hour:.2}"),
            percent(s.true_error),
            percent(s.estimated_error),
            percent(s.bias),
            percent(s.mean_difference),
            percent(s.reference_error),
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
        ],
        &rows,
    );
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
        "{:.0} samples per texel on average, at most {}, in {:.1} s of tracing; estimated relative error (median over tiles \
         and sets) {:.2} %. Relative error: root of the mean squared standard error over a tile's valid texels ÷ their mean. {how}",
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
                row("tests for points inside solids", rays.inside),
            ],
        );
    }
    section.paragraph("Left out, because this scene does not need it:");
    section.list(&outcome.left_out);
    if !outcome.warnings.is_empty() {
        section.paragraph("Warnings:");
        section.list(&outcome.warnings);
    }
    section
}
