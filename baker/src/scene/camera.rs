//! `[[camera]]`: viewpoints for pictures of the baked light.

use super::raw::Table;
use super::{Camera, MAX_FOV};
use dataset::Result;
use glam::DVec3;

/// Keys of `[[camera]]`.
pub(super) const KEYS: &[&str] = &["name", "position", "look_at", "fov"];

/// Reads `[[camera]]`; names must be unique.
pub(super) fn read(tables: Vec<Table>) -> Result<Vec<Camera>> {
    let mut cameras: Vec<Camera> = Vec::new();
    for table in tables {
        let value = table.require("name", "a name")?;
        let name = value.text("a name")?;
        // Three numbers on the command line are a position.
        if name.trim().is_empty() || name.trim() != name || name.contains(',') {
            return Err(value.error("expected a name without commas"));
        }
        if cameras.iter().any(|c| c.name == name) {
            return Err(value.error("expected a name that no other camera has"));
        }
        let expected = "a point [x, y, z]";
        let point = |key: &str| table.require(key, expected)?.vector(expected, |_| true);
        let (position, look_at): (DVec3, DVec3) = (point("position")?, point("look_at")?);
        if position == look_at {
            return Err(table.require("look_at", expected)?.error("expected another point than `position`"));
        }
        let expected = "degrees from 1 to 170";
        let fov = table
            .get("fov")
            .map_or(Ok(Camera::FOV), |v| v.number(expected, |x| (1.0..=MAX_FOV).contains(&x)))?;
        cameras.push(Camera { name: name.to_owned(), position, look_at, fov });
    }
    Ok(cameras)
}
