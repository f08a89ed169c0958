//! What a material of an MTL library lets through: `d` or `Tr`, `Tf`, and `illum`.

use super::material::Material;
use super::statements::words;
use crate::geometry::Glass;
use crate::geometry::notes::Notes;
use dataset::Result;
use glam::Vec3;

/// Illumination models of glass, whose `Tf` counts without a `d` too.
const GLASS: [u8; 4] = [4, 6, 7, 9];

/// Reads what a material lets through: 1 − `d` (or `Tr`) times `Tf`; where neither makes it transparent and
/// `illum` says glass, `Tf`.
///
/// A `Tf` alone is no glass: exporters write `Tf 1 1 1` into opaque materials.
///
/// # Errors
/// A `d` that is not a number.
pub(super) fn read(material: &Material, file: &str, notes: &mut Notes) -> Result<Option<Glass>> {
    let mut wrong = |key: &str, text: &str, expected: &str| {
        let name = format!("{} (`{key} {text}`)", material.name);
        notes.add(
            file,
            "material",
            name,
            format!("a transparency that cannot be read is not used: expected {expected}"),
        );
    };
    let filter = material.get("Tf").and_then(|tf| {
        let filter = tf.triple().filter(|filter| filter.is_finite());
        if filter.is_none() {
            wrong("Tf", &tf.text, "one number or three");
        }
        filter.map(|filter| filter.clamp(Vec3::ZERO, Vec3::ONE))
    });
    let dissolve = material.get("d").map(|d| {
        let words: Vec<&str> = words(&d.text).filter(|word| *word != "-halo").collect();
        let number = if let [word] = words[..] { word.parse::<f32>().ok() } else { None };
        number.filter(|d| !d.is_nan()).ok_or_else(|| d.error("a number from 0 to 1"))
    });
    let open = match (dissolve.transpose()?, material.get("Tr").map(|tr| tr.text.trim())) {
        (Some(d), _) => 1.0 - d.clamp(0.0, 1.0),
        (None, Some(text)) => match share(text) {
            Some(1.0) => {
                wrong(
                    "Tr",
                    text,
                    "`d 0` for a surface that nobody sees, since many exporters write `Tr 1` for an opaque one",
                );
                0.0
            }
            Some(open) => open,
            None => {
                wrong("Tr", text, "a number from 0 to 1");
                0.0
            }
        },
        (None, None) => 0.0,
    };
    let illum = material.get("illum").and_then(|illum| words(&illum.text).next()?.parse().ok());
    let is_glass = illum.is_some_and(|model: u8| GLASS.contains(&model));
    let through = match filter {
        Some(filter) if open == 0.0 && is_glass => filter,
        filter => filter.unwrap_or(Vec3::ONE) * open,
    };
    Ok((through.max_element() > 0.0).then(|| Glass::clear(through)))
}

/// A number, limited to what a share can be.
fn share(text: &str) -> Option<f32> {
    words(text).next()?.parse::<f32>().ok().filter(|x| x.is_finite()).map(|x| x.clamp(0.0, 1.0))
}
