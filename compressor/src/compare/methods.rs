//! The list of methods, each with the function that runs it.

use super::keyframes::{self, Float16, KEPT};
use super::method::{AtHour, ImageCodec, Method, Way, each_tile};
use super::tiles::TileSet;
use super::{Effort, Options, ndgi, ntc, svd};
use crate::compress::{FINAL, Preset};
use crate::model::{PROFILES, Profile};
use crate::{Error, Result};

/// Components of the singular value decomposition.
const RANKS: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// The named methods, or all without names. Case does not matter, and × may be written x.
///
/// # Errors
/// [`Error::Invalid`] with a name that no method has.
pub(super) fn named<'a>(methods: Vec<Method<'a>>, names: &[String]) -> Result<Vec<Method<'a>>> {
    let plain = |name: &str| name.to_lowercase().replace('×', "x");
    let is_of = |name: &String, method: &Method| plain(name) == plain(&method.name);
    if let Some(unknown) = names.iter().find(|name| !methods.iter().any(|method| is_of(name, method))) {
        let there = methods.iter().map(|method| format!("“{}”", method.name)).collect::<Vec<_>>().join(", ");
        return Err(Error::invalid(
            "--method",
            format!("no method is named “{unknown}”; expected one of {there}"),
        ));
    }
    let is_wanted = |method: &Method| names.is_empty() || names.iter().any(|name| is_of(name, method));
    Ok(methods.into_iter().filter(is_wanted).collect())
}

/// Methods without third-party codecs.
pub(super) fn own<'a>(set: &'a TileSet, options: &'a Options) -> Vec<Method<'a>> {
    let ndgi = |name: String, profile: &'static Profile, preset: Preset| Method {
        family: "NDGI",
        name,
        run: Box::new(move || {
            let (coded, params) = ndgi::code(set, profile, &preset, options.seed)?;
            let at_hour: AtHour = Box::new(move |hour| ndgi::at_hour(set, &params, hour));
            let note = format!("preset {}", preset.name);
            Ok(vec![Way { coded, note, at_hour: Some(at_hour) }])
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
                    format!("networks not counted: {networks:.2} bpp more if shared only by these tiles");
                Ok(vec![Way::new(coded, note)])
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
                Ok(vec![Way::new(coded, note)])
            }),
        });
    }
    methods.push(keys(set, "float16", || Box::new(Float16)));
    methods
}

/// Frames that are kept, by some codec.
fn keys<'a>(
    set: &'a TileSet,
    codec_name: &'a str,
    codec: impl Fn() -> Box<dyn ImageCodec> + 'a,
) -> Method<'a> {
    Method {
        family: "keyframes",
        name: format!("{KEPT} frames, {codec_name}"),
        run: Box::new(move || {
            let (coded, kept) = keyframes::code(set, &*codec())?;
            let hours: Vec<String> = kept.iter().map(|&k| set.timeline.hours[k].to_string()).collect();
            Ok(vec![Way::new(coded, format!("light linear between {} h", hours.join(", ")))])
        }),
    }
}

#[cfg(not(feature = "baselines"))]
pub(super) fn foreign(_: &TileSet, _: &Options, _: &mut Vec<Method>, skipped: &mut Vec<String>) {
    skipped.push(
        "BC6H, BC7 and ASTC: this build lacks these codecs; build with `--features compressor/baselines` (a C++ compiler)".to_owned(),
    );
}

/// Methods with third-party codecs.
#[cfg(feature = "baselines")]
pub(super) fn foreign<'a>(
    set: &'a TileSet,
    options: &'a Options,
    methods: &mut Vec<Method<'a>>,
    _: &mut Vec<String>,
) {
    use super::astc::Astc;
    use super::bc::{Bc6h, Bc7, Bc7Rgbm, Halves};
    use super::method::each_image;
    let effort = options.effort;
    let image = |family, name: &str, codec: fn(Effort) -> Box<dyn ImageCodec>| Method {
        family,
        name: name.to_owned(),
        run: Box::new(move || {
            let coded = each_image(set, &*codec(effort))?;
            let note = coded.note();
            Ok(vec![Way::new(coded, note)])
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
                    Ok(Way::new(coded, note))
                };
                Ok(vec![way(false)?, way(true)?])
            }),
        });
    }
    methods.push(keys(set, "BC6H", move || Box::new(Bc6h(effort, Halves::Direct))));
    methods.push(keys(set, "ASTC 8×8", move || Box::new(Astc { side: 8, hdr: false, effort })));
    methods.push(keys(set, "ASTC 6×6", move || Box::new(Astc { side: 6, hdr: false, effort })));
}
