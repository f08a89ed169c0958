//! `[lights]`: what becomes of the lamps and glowing materials of geometry files.

use super::LightsOfFiles;
use super::raw::{Table, Value};
use dataset::Result;
use std::f64::consts::PI;

/// Keys of `[lights]`.
pub(super) const KEYS: &[&str] = &["from_file", "unit", "scale", "emission"];

/// Lumens per watt by which Blender's exporter converts: those of green light of 555 nm.
const LUMENS_PER_WATT: f64 = 683.0;

/// Reads `[lights]`, if there is one; `names` are the `lights` of the groups.
pub(super) fn read(table: Option<Table>, names: Vec<(String, usize)>) -> Result<LightsOfFiles> {
    let mut lights = LightsOfFiles { names, ..Default::default() };
    if let Some(table) = table {
        lights.from_file = table.get("from_file").map_or(Ok(true), |v| v.boolean())?;
        let factor = |key: &str| {
            let expected = "a number from 0 to 1e12";
            table.get(key).map_or(Ok(1.0), |v| v.number(expected, super::is_light))
        };
        let [candela, lux] = table.get("unit").map_or(Ok([1.0; 2]), |v| unit(&v))?;
        let scale = factor("scale")?;
        (lights.candela, lights.lux, lights.profile) = (scale * candela, scale * lux, scale);
        lights.emission = factor("emission")?;
    }
    Ok(lights)
}

/// Candela of a point or spot, and lux of a directional light, of which a file writes 1. The words are those
/// of Blender's export: "Unitless" writes W/sr and W/m², "Raw" writes W of a lamp and W/m² of a sun.
fn unit(value: &Value) -> Result<[f64; 2]> {
    let expected = r#""standard" (candela and lux, as the format says), or as Blender exported them: "unitless" or "raw""#;
    match value.text(expected)? {
        "standard" => Ok([1.0, 1.0]),
        "unitless" => Ok([LUMENS_PER_WATT; 2]),
        "raw" => Ok([LUMENS_PER_WATT / (4.0 * PI), LUMENS_PER_WATT]),
        _ => Err(value.error(format!("expected {expected}"))),
    }
}
