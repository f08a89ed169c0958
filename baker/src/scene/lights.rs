//! `[lights]`: what becomes of the lamps and glowing materials of geometry files.

use super::LightsOfFiles;
use super::raw::Table;
use dataset::Result;

/// Keys of `[lights]`.
pub(super) const KEYS: &[&str] = &["from_file", "scale", "emission"];

/// Reads `[lights]`, if there is one; `names` are the `lights` of the groups.
pub(super) fn read(table: Option<Table>, names: Vec<(String, usize)>) -> Result<LightsOfFiles> {
    let mut lights = LightsOfFiles { names, ..Default::default() };
    if let Some(table) = table {
        lights.from_file = table.get("from_file").map_or(Ok(true), |v| v.boolean())?;
        let factor = |key: &str| {
            let expected = "a number from 0 to 1e12";
            table.get(key).map_or(Ok(1.0), |v| v.number(expected, super::is_light))
        };
        (lights.scale, lights.emission) = (factor("scale")?, factor("emission")?);
    }
    Ok(lights)
}
