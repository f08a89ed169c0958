//! NDGI beside what else there is: every method on the same tiles, in the same run, judged by the same measures.
//!
//! How each is set up stands in `BASELINES.md`. Methods of foreign codecs are there with the feature `baselines`.

mod tiles;
mod curve;
mod method;
#[cfg(test)]
mod testing;
mod judge;
mod table;
mod linear;
mod ndgi;
mod keyframes;
mod svd;
mod ntc;
mod prt;
#[cfg(feature = "baselines")]
mod bc;
#[cfg(feature = "baselines")]
mod astc;
mod ablations;

pub use table::{Comparison, Row};

use crate::compress::{DRAFT, FINAL, MEDIUM, Preset};
use crate::evaluate::Looks;
use crate::model::{PROFILES, Profile};
use crate::{Error, Result};
use dataset::config::Config;
use dataset::console::{Console, stop_if_interrupted};
use dataset::store::Dataset;
use judge::{Judge, Judged};
use keyframes::{Float16, KEPT};
use method::{CodedTiles, ImageCodec, each_tile};
use prt::Transfer;
use table::Shown;
use tiles::TileSet;

/// What is compared on what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Tiles with valid texels, at most, drawn by the seed from all pages; otherwise those of the first page.
    pub tiles: Option<usize>,
    /// How hard every encoder and trainer tries.
    pub effort: Effort,
    /// The paper's ablations instead of other methods.
    pub ablations: bool,
    /// Seed of all randomness.
    pub seed: u64,
}

/// How hard every encoder and trainer tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// A first look.
    Draft,
    /// NDGI's default preset, and for M its thorough one too; the thorough ones of the others.
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

/// Components of the singular value decomposition.
const RANKS: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// Ways of one method, and what is to be said of each; the best is shown.
type Ways = Vec<(CodedTiles, String)>;

/// A row of the table to be.
struct Method<'a> {
    family: &'static str,
    name: String,
    run: Box<dyn Fn() -> Result<Ways> + 'a>,
}

/// Compares all methods on tiles of a dataset; `transfer` is that of its scene, `looks` what is measured of looks. Writes nothing.
///
/// # Errors
/// As [`crate::compress::compress`], and a transfer that is not of this dataset.
pub fn compare(
    dataset: &Dataset,
    transfer: Option<&Dataset>,
    looks: Looks,
    options: &Options,
    console: &Console,
) -> Result<Comparison> {
    dataset.expect_moments()?;
    let set = TileSet::load(dataset, options)?;
    if set.tiles.is_empty() {
        return Err(Error::invalid(
            dataset.root.display(),
            "no tile has a valid texel: nothing to compare on",
        ));
    }
    let transfer = transfer.map(|transfer| Transfer::open(dataset, transfer, &set)).transpose()?;
    let noise = dataset.noise()?;
    let judge = Judge::new(&set, noise.as_ref(), looks);
    let mut comparison = Comparison::new(&set, options);
    let mut left_out = Vec::new();
    let methods = if options.ablations {
        ablations::methods(&set, options)
    } else {
        let mut methods = own(&set, options);
        match &transfer {
            Some(transfer) => methods.extend(prt::methods(&set, transfer)),
            None => left_out.push(without_transfer(&dataset.config)),
        }
        foreign(&set, options, &mut methods, &mut left_out);
        methods
    };
    let progress = console.progress("comparing", methods.len() as u64);
    let mut shown = Vec::new();
    for method in methods {
        progress.note(&method.name);
        let (row, judged) = measure(&set, &judge, &method)?;
        // The same for all.
        comparison.noise_ceiling_db = judged.quality.noise_ceiling_db;
        shown.push(Shown { method: row.method.clone(), images: judged.shown });
        comparison.rows.push(row);
        progress.advance(1);
    }
    if options.ablations {
        comparison.rows.extend(ablations::sizes(&set, options)?);
    }
    comparison.left_out = left_out;
    comparison.finish(&set, &judge.shown, shown);
    Ok(comparison)
}

/// What is said where PRT is not in the table.
fn without_transfer(config: &Config) -> String {
    if config.source.is_some() {
        return "PRT (clustered PCA of precomputed radiance transfer): it needs a bake of the scene, and this set was imported".to_owned();
    }
    format!(
        "PRT (clustered PCA of precomputed radiance transfer): it needs the scene's transfer, which the command that baked this set makes \
         with --transfer instead of --hours; then `--transfer DIR` here, by default dataset/{}-transfer",
        config.scene
    )
}

/// Runs a method; the best of its ways counts.
fn measure(set: &TileSet, judge: &Judge, method: &Method) -> Result<(Row, Judged)> {
    stop_if_interrupted()?;
    let mut best: Option<(Row, Judged)> = None;
    let mut notes = Vec::new();
    for (coded, note) in (method.run)()? {
        // (Means leave out what is not a number: a method must not gain by that.)
        let is_number = |texel: &[f32; 3]| texel.iter().all(|value| value.is_finite());
        if !coded.decoded.iter().flatten().flatten().all(is_number) {
            return Err(Error::invalid(
                &method.name,
                "decodes to what is no finite number: a fault of this method",
            ));
        }
        let judged = judge.judge(&coded)?;
        let row = Row::new(set, method.family, &method.name, &coded, &judged);
        let db = table::decibels(row.psnr_db);
        notes.push((note.clone(), db));
        if best.as_ref().is_none_or(|(best, _)| row.psnr_db > best.psnr_db) {
            best = Some((Row { note, ..row }, judged));
        }
    }
    let (mut row, judged) = best.ok_or_else(|| Error::invalid(method.name.clone(), "has no way to run"))?;
    if notes.len() > 1 {
        let others = notes.iter().filter(|(note, _)| *note != row.note);
        let others: Vec<String> = others.map(|(note, db)| format!("({note}: {db} dB)")).collect();
        row.note = format!("{} {}", row.note, others.join(" "));
    }
    Ok((row, judged))
}

/// Methods that need nothing foreign.
fn own<'a>(set: &'a TileSet, options: &'a Options) -> Vec<Method<'a>> {
    let ndgi = |name: String, profile: &'static Profile, preset: Preset| Method {
        family: "NDGI",
        name,
        run: Box::new(move || {
            let coded = ndgi::code(set, profile, &preset, options.seed)?;
            Ok(vec![(coded, format!("preset {}", preset.name))])
        }),
    };
    let named =
        |profile: &'static Profile| ndgi(format!("NDGI {}", profile.name), profile, options.effort.preset());
    // The paper's four.
    let mut methods: Vec<Method> = PROFILES.iter().take(4).map(named).collect();
    if options.effort == Effort::Full {
        // What it has when it is given as much time as the others: M, the profile of the comparison.
        let [_, m, ..] = &PROFILES;
        methods.push(ndgi(format!("NDGI {}, {}", m.name, FINAL.name), m, FINAL));
    }
    for preset in &ntc::PRESETS {
        methods.push(Method {
            family: "NTC",
            name: preset.name.to_owned(),
            run: Box::new(move || {
                let (coded, networks) = ntc::code(set, preset, options.effort, options.seed)?;
                let note =
                    format!("networks not counted: {networks:.2} bpp more if only these tiles shared them");
                Ok(vec![(coded, note)])
            }),
        });
    }
    for rank in RANKS {
        methods.push(Method {
            family: "SVD",
            name: format!("SVD {rank}"),
            run: Box::new(move || {
                let coded = each_tile(set, |tile| svd::code(tile, rank))?;
                let note = format!("8-bit maps; {}", coded.note());
                Ok(vec![(coded, note)])
            }),
        });
    }
    methods.push(keys(set, "float16", || Box::new(Float16)));
    methods
}

/// Sets that are kept, by some codec.
fn keys<'a>(
    set: &'a TileSet,
    codec_name: &'a str,
    codec: impl Fn() -> Box<dyn ImageCodec> + 'a,
) -> Method<'a> {
    Method {
        family: "keyframes",
        name: format!("{KEPT} sets, {codec_name}"),
        run: Box::new(move || {
            let (coded, kept) = keyframes::code(set, &*codec())?;
            let hours: Vec<String> = kept.iter().map(|&k| set.timeline.hours[k].to_string()).collect();
            Ok(vec![(coded, format!("light linear between {} h", hours.join(", ")))])
        }),
    }
}

#[cfg(not(feature = "baselines"))]
fn foreign(_: &TileSet, _: &Options, _: &mut Vec<Method>, left_out: &mut Vec<String>) {
    left_out.push(
        "BC6H, BC7 and ASTC: this build has no foreign codecs; build with `--features compressor/baselines` (a C++ compiler)".to_owned(),
    );
}

/// Methods of foreign codecs.
#[cfg(feature = "baselines")]
fn foreign<'a>(set: &'a TileSet, options: &'a Options, methods: &mut Vec<Method<'a>>, _: &mut Vec<String>) {
    use astc::Astc;
    use bc::{Bc6h, Bc7, Bc7Rgbm, Halves};
    use method::each_image;
    let effort = options.effort;
    let image = |family, name: &str, codec: fn(Effort) -> Box<dyn ImageCodec>| Method {
        family,
        name: name.to_owned(),
        run: Box::new(move || {
            let coded = each_image(set, &*codec(effort))?;
            let note = coded.note();
            Ok(vec![(coded, note)])
        }),
    };
    methods.push(image("BC", "BC7", |effort| Box::new(Bc7(effort))));
    methods.push(image("BC", "BC7, RGBM", |effort| Box::new(Bc7Rgbm(effort))));
    methods.push(image("BC", "BC6H", |effort| Box::new(Bc6h(effort, Halves::Direct))));
    methods.push(image("BC", "BC6H, curve", |effort| Box::new(Bc6h(effort, Halves::Curve))));
    for side in [12, 10, 8] {
        methods.push(Method {
            family: "ASTC",
            name: format!("ASTC {side}×{side}"),
            run: Box::new(move || {
                let way = |hdr: bool| {
                    let coded = each_image(set, &Astc { side, hdr, effort })?;
                    let note = if hdr { "HDR".to_owned() } else { format!("LDR, {}", coded.note()) };
                    Ok((coded, note))
                };
                Ok(vec![way(false)?, way(true)?])
            }),
        });
    }
    methods.push(keys(set, "BC6H", move || Box::new(Bc6h(effort, Halves::Direct))));
    methods.push(keys(set, "ASTC 8×8", move || Box::new(Astc { side: 8, hdr: false, effort })));
    methods.push(keys(set, "ASTC 6×6", move || Box::new(Astc { side: 6, hdr: false, effort })));
}
