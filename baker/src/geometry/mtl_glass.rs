//! What a material of an MTL library lets through: `d` or `Tr`, `Tf`, and `illum`.

use super::Glass;
use super::notes::Notes;
use glam::Vec3;

/// Illumination models of glass, whose `Tf` counts without a `d` too.
const GLASS: [u8; 4] = [4, 6, 7, 9];

/// Reads what a material lets through: 1 − `d` (or `Tr`) times `Tf`; where neither makes it transparent and
/// `illum` says glass, `Tf`.
///
/// A `Tf` alone is no glass: exporters write `Tf 1 1 1` into opaque materials.
pub(super) fn read(material: &tobj::Material, file: &str, notes: &mut Notes) -> Option<Glass> {
    let mut wrong = |key: &str, text: &str, expected: &str| {
        let name = format!("{} (`{key} {text}`)", material.name);
        notes.add(
            file,
            "material",
            name,
            format!("a transparency that cannot be read is not used: expected {expected}"),
        );
    };
    let statement = |key: &str| material.unknown_param.get(key).map(|text| text.trim());
    let filter = statement("Tf").and_then(|text| {
        let words: Vec<_> = text.split_whitespace().map(share).collect();
        match words[..] {
            [Some(r), Some(g), Some(b)] => Some(Vec3::new(r, g, b)),
            _ => {
                wrong("Tf", text, "one number or three");
                None
            }
        }
    });
    let open = match (material.dissolve, statement("Tr")) {
        (Some(d), _) => 1.0 - (d as f32).clamp(0.0, 1.0),
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
    let is_glass = material.illumination_model.is_some_and(|model| GLASS.contains(&model));
    let through = match filter {
        Some(filter) if open == 0.0 && is_glass => filter,
        filter => filter.unwrap_or(Vec3::ONE) * open,
    };
    // (A `d` that is not a number leaves no more than an opaque surface.)
    (through.max_element() > 0.0).then(|| Glass::clear(through))
}

/// A number, limited to what a share can be.
fn share(word: &str) -> Option<f32> {
    word.parse::<f32>().ok().filter(|x| x.is_finite()).map(|x| x.clamp(0.0, 1.0))
}
