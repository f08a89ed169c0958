//! Compares NDGI with other methods: the same tiles, the same run, the same metrics.
//!
//! `BASELINES.md` describes the settings of each. Methods with third-party codecs need the feature
//! `baselines`.

mod tiles;
mod curve;
mod method;
#[cfg(test)]
mod testing;
mod judge;
mod table;
mod ndgi;
mod keyframes;
mod svd;
mod ntc;
mod prt;
#[cfg(feature = "baselines")]
mod bc;
#[cfg(feature = "baselines")]
mod astc;
mod methods;
mod ablations;
mod render;

pub use table::Comparison;

use crate::compress::{DRAFT, MEDIUM, Preset};
use crate::evaluate::SlowMetrics;
use crate::{Error, Result};
use dataset::format::Config;
use dataset::host::signals::stop_if_interrupted;
use dataset::observe::Observer;
use dataset::store::Dataset;
use judge::{Judge, Judged};
use method::{Method, Way};
use methods::{foreign, named, own};
use prt::Transfer;
use render::{Rendered, Stage};
use table::{Row, Shown};
use tiles::TileSet;

/// Options of a comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Largest number of tiles with valid texels, drawn by the seed from all pages; `None`: those of the
    /// first page.
    pub tiles: Option<usize>,
    /// Effort of every encoder and trainer.
    pub effort: Effort,
    /// The paper's ablations instead of other methods.
    pub ablations: bool,
    /// Only the methods with these names; empty for all.
    pub methods: Vec<String>,
    /// Also render the scene with the light of some methods; the tiles are then those of all pages.
    pub render: bool,
    /// Seed of all randomness.
    pub seed: u64,
}

/// Effort of every encoder and trainer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Quick results.
    Draft,
    /// NDGI's default preset, for M also its thorough one; the thorough presets of the others.
    Full,
}

impl Effort {
    /// NDGI's.
    fn preset(self) -> Preset {
        match self {
            Effort::Draft => DRAFT,
            Effort::Full => MEDIUM,
        }
    }
}

/// Compares all methods on tiles of a dataset; `transfer` is that of its scene. Writes nothing.
///
/// # Errors
/// As [`crate::compress::compress`]; a transfer of another dataset; an unknown method; a scene without
/// geometry to render.
pub fn compare(
    dataset: &Dataset,
    transfer: Option<&Dataset>,
    slow_metrics: SlowMetrics,
    options: &Options,
    console: &dyn Observer,
) -> Result<Comparison> {
    dataset.expect_day()?;
    let frame = TileSet::load(dataset, options)?;
    if frame.tiles.is_empty() {
        return Err(Error::invalid(
            dataset.root.display(),
            "no tile has a valid texel, so there is nothing to compare; check the dataset's masks",
        ));
    }
    let transfer = transfer.map(|transfer| Transfer::open(dataset, transfer, &frame)).transpose()?;
    let noise = dataset.noise()?;
    let judge = Judge::new(&frame, noise.as_ref(), slow_metrics);
    let mut comparison = Comparison::new(&frame, options);
    let mut skipped = Vec::new();
    let methods = if options.ablations {
        ablations::methods(&frame, options)
    } else {
        let mut methods = own(&frame, options);
        match &transfer {
            Some(transfer) => methods.extend(prt::methods(&frame, transfer)),
            None => skipped.push(without_transfer(&dataset.config)),
        }
        foreign(&frame, options, &mut methods, &mut skipped);
        named(methods, &options.methods)?
    };
    let mut stage = options.render.then(|| Stage::new(dataset, &frame, console)).transpose()?;
    let progress = console.progress("comparing", methods.len() as u64);
    let mut shown = Vec::new();
    for method in methods {
        progress.note(&method.name);
        let (row, judged, way) = measure(&frame, &judge, &method)?;
        stage.iter_mut().try_for_each(|stage| stage.show(&row, &way))?;
        // The same for all.
        comparison.noise_ceiling_db = judged.quality.noise_ceiling_db;
        shown.push(Shown { method: row.method.clone(), images: judged.shown });
        comparison.rows.push(row);
        progress.advance(1);
    }
    if options.ablations {
        comparison.rows.extend(ablations::sizes(&frame, options)?);
    }
    comparison.skipped = skipped;
    if let Some(stage) = stage {
        comparison.rendered = Some(stage.finish(&comparison, &judge.shown, &shown)?);
    }
    comparison.finish(&frame, &judge.shown, shown);
    Ok(comparison)
}

/// Why PRT is not in the table.
fn without_transfer(config: &Config) -> String {
    if config.source.is_some() {
        return "PRT (clustered PCA of precomputed radiance transfer): it needs a bake of the scene, and this dataset was imported".to_owned();
    }
    format!(
        "PRT (clustered PCA of precomputed radiance transfer): it needs the scene's transfer: run the command that baked this dataset \
         with --transfer instead of --hours, then add `--transfer DIR` here (by default dataset/{}-transfer)",
        config.scene
    )
}

/// Runs a method; its best variant counts.
fn measure<'a>(frame: &TileSet, judge: &Judge, method: &Method<'a>) -> Result<(Row, Judged, Way<'a>)> {
    stop_if_interrupted()?;
    let mut best: Option<(Row, Judged, Way)> = None;
    let mut notes = Vec::new();
    for way in (method.run)()? {
        // (Means omit what is not a number: a method must not gain by that.)
        let is_number = |texel: &[f32; 3]| texel.iter().all(|value| value.is_finite());
        if !way.coded.decoded.iter().flatten().flatten().all(is_number) {
            return Err(Error::invalid(
                &method.name,
                "decodes to a value that is not finite: a fault of this method",
            ));
        }
        let judged = judge.judge(&way.coded)?;
        let row = Row::new(frame, method.family, &method.name, &way.coded, &judged);
        notes.push((way.note.clone(), table::decibels(row.psnr_db)));
        if best.as_ref().is_none_or(|(best, ..)| row.psnr_db > best.psnr_db) {
            best = Some((Row { note: way.note.clone(), ..row }, judged, way));
        }
    }
    let (mut row, judged, way) = best.ok_or_else(|| Error::invalid(method.name.clone(), "cannot run"))?;
    if notes.len() > 1 {
        let others = notes.iter().filter(|(note, _)| *note != row.note);
        let others: Vec<String> = others.map(|(note, db)| format!("({note}: {db} dB)")).collect();
        row.note = format!("{} {}", row.note, others.join(" "));
    }
    Ok((row, judged, way))
}
