//! The bake's part of a report: error against run time, what was done, what was left out.

use crate::bake::run::Outcome;
use dataset::report::Section;
use dataset::report::plot::Plot;

/// The section of a bake.
pub fn section(outcome: &Outcome) -> Section {
    let mut section = Section::new("Bake");
    section.paragraph(&format!(
        "{} samples per texel in {:.1} s of tracing; estimated relative error (median over tiles and sets) {:.2} %. \
         Relative error: root of the mean squared standard error over a tile's valid texels ÷ their mean.",
        outcome.samples,
        outcome.rounds.last().map_or(0.0, |r| r.seconds),
        outcome.relative_error * 100.0
    ));
    let line = |name: &str, value: fn(&crate::bake::rounds::Round) -> f64| {
        (name.to_owned(), outcome.rounds.iter().map(|r| (r.seconds, value(r) * 100.0)).collect())
    };
    section.plot(&Plot {
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
    });
    section.list(&outcome.facts);
    if !outcome.up_to_date {
        let rays = outcome.rays;
        let total = (rays.walk + rays.sun + rays.lamp + rays.inside).max(1) as f64;
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
