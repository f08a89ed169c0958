//! `[sky]`: which sky, and the picture of one.

use super::radiance::{is_radiance, read_radiance};
use super::raw::Table;
use super::{Sky, is_light};
use dataset::image::Image;
use dataset::{Error, Result};
use glam::DVec3;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Keys of `[sky]`.
pub(super) const KEYS: &[&str] = &[
    "model",
    "baked",
    "turbidity",
    "ground_albedo",
    "ground",
    "radiance",
    "file",
    "scale",
    "rotation",
    "find_portals",
];
/// Turbidity of a clear day.
pub(super) const TURBIDITY: f64 = 3.0;

/// A lat-long picture of the whole sphere: the top row is +Y, the middle column looks along −Z (before
/// `rotation`), and columns run clockwise seen from above, so that +X is a quarter of the width to the right
/// of the middle.
#[derive(Clone, Debug, Serialize)]
pub struct SkyImage {
    /// The file's name, without its folder.
    pub file: String,
    /// kcd/m² per unit of the file.
    pub scale: f64,
    /// Degrees from −Z, clockwise seen from above, to where the middle column looks.
    pub rotation: f64,
    /// BLAKE3 of the file: what is serialised changes with the picture.
    pub blake3: String,
    /// Radiance in kcd/m², finite and not negative; twice as wide as high.
    #[serde(skip)]
    pub radiance: Arc<Image>,
}

pub(super) fn turbidity(table: &Table) -> Result<Option<f64>> {
    let expected = "a number from 1 to 10";
    table.get("turbidity").map(|v| v.number(expected, |x| (1.0..=10.0).contains(&x))).transpose()
}

/// Reads `[sky] ground`: the albedo of the ground that is seen below the horizon, where nothing of the scene
/// is; `None`: what the sky shows there. A computed sky has the ground of its `ground_albedo`, unless the key
/// says otherwise.
pub(super) fn ground(table: &Table, sky: &Sky) -> Result<Option<DVec3>> {
    let expected = "false, a number from 0 to 1, or [r, g, b]";
    match (table.get("ground"), sky) {
        (Some(value), _) if value.boolean().is_ok_and(|is_there| !is_there) => Ok(None),
        (Some(value), _) => value.vector_or_number(expected, |x| (0.0..=1.0).contains(&x)).map(Some),
        (None, Sky::HosekWilkie { ground_albedo, .. }) => Ok(Some(DVec3::splat(*ground_albedo))),
        (None, _) => Ok(None),
    }
}

/// Reads `[sky]`; `folder` is the scene file's.
pub(super) fn read(table: &Table, has_location: bool, folder: &Path) -> Result<Sky> {
    let expected = r#""hosek-wilkie", "constant" or "image""#;
    let model = table.require("model", expected)?;
    // A key of another model would be ignored without a word.
    let only = |keys: &[&str]| {
        let other = KEYS
            .iter()
            .filter(|key| !["model", "baked", "find_portals"].contains(key) && !keys.contains(key));
        match other.filter_map(|key| table.get(key)).next() {
            Some(value) => Err(value.error(format!("not a key of this sky: its {}", model.shown()))),
            None => Ok(()),
        }
    };
    match model.text(expected)? {
        "hosek-wilkie" => {
            only(&["turbidity", "ground_albedo", "ground"])?;
            if !has_location {
                return Err(model.error("expected a [place], from which this sky has its sun"));
            }
            let expected = "a number from 0 to 1";
            let ground = table.get("ground_albedo");
            Ok(Sky::HosekWilkie {
                turbidity: turbidity(table)?.unwrap_or(TURBIDITY),
                ground_albedo: ground
                    .map_or(Ok(0.2), |v| v.number(expected, |x| (0.0..=1.0).contains(&x)))?,
            })
        }
        "constant" => {
            only(&["radiance"])?;
            let expected = "[r, g, b] in kcd/m², each 0 or more";
            let radiance = table.require("radiance", expected)?.vector(expected, is_light)?;
            Ok(Sky::Constant { radiance })
        }
        "image" => {
            only(&["file", "scale", "rotation"])?;
            Ok(Sky::Image(image(table, folder)?))
        }
        _ => Err(model.error(format!("expected {expected}"))),
    }
}

fn image(table: &Table, folder: &Path) -> Result<SkyImage> {
    let expected_file = "a lat-long picture, OpenEXR (.exr) with channels R, G, B, or Radiance (.hdr)";
    let value = table.require("file", expected_file)?;
    let name = value.text(expected_file)?;
    let path = folder.join(name);
    let expected = "kcd/m² per unit of the file, above 0";
    let scale = table.get("scale").map_or(Ok(1.0), |v| v.number(expected, |x| x > 0.0))?;
    let expected = "degrees from -360 to 360";
    let rotation = table.get("rotation").map_or(Ok(0.0), |v| v.number(expected, |x| x.abs() <= 360.0))?;

    // Whatever is wrong with the file is told at the line that names it.
    let at = |error: Error| value.error(format!("{error}; expected {expected_file}"));
    let bytes = std::fs::read(&path).map_err(|e| at(Error::io(&path)(e)))?;
    let image = match is_radiance(&bytes) {
        true => read_radiance(&bytes, &path.display().to_string()),
        false => Image::read_exr(&path),
    };
    let mut image = image.map_err(at)?;
    if image.width != 2 * image.height {
        let what = format!(
            "{} × {} texels: expected a lat-long picture, twice as wide as high",
            image.width, image.height
        );
        return Err(value.error(what));
    }
    for (i, texel) in image.texels.iter_mut().enumerate() {
        for (value_of_file, name) in texel.iter_mut().zip(["R", "G", "B"]) {
            let radiance = f64::from(*value_of_file) * scale;
            if !is_light(radiance) {
                let (x, y) = (i % image.width, i / image.width);
                let what = format!(
                    "texel ({x}, {y}), channel {name}: {value_of_file}: expected a radiance, 0 or more"
                );
                return Err(value.error(what));
            }
            *value_of_file = radiance as f32;
        }
    }
    Ok(SkyImage {
        file: path.file_name().and_then(|n| n.to_str()).unwrap_or(name).to_owned(),
        scale,
        rotation,
        blake3: blake3::hash(&bytes).to_hex().to_string(),
        radiance: Arc::new(image),
    })
}
