//! `[[group]]`: lamps that switch together, and their power in photometric units.

use super::colour::{KELVIN, black_body};
use super::raw::Table;
use super::{Group, Lamp, schedule};
use dataset::Result;
use glam::DVec3;
use std::f64::consts::PI;

/// Keys of `[[group]]`.
pub(super) const KEYS: &[&str] = &["name", "on", "lights", "sphere", "rectangle", "disc", "spot", "point"];
const SPHERE: &[&str] = &["centre", "radius", "radiance", "lumens", "kelvin"];
const RECTANGLE: &[&str] = &["corner", "edge_u", "edge_v", "radiance", "lumens", "kelvin"];
const DISC: &[&str] = &["centre", "direction", "radius", "radiance", "lumens", "kelvin"];
const SPOT: &[&str] = &["position", "direction", "inner", "outer", "intensity", "lumens", "kelvin"];
const POINT: &[&str] = &["position", "intensity", "lumens", "kelvin"];

/// Reads `[[group]]`; names must be unique. Gives also the `lights` of each, with its index.
pub(super) fn read(tables: Vec<Table>) -> Result<(Vec<Group>, Vec<(String, usize)>)> {
    let (mut groups, mut names): (Vec<Group>, Vec<(String, usize)>) = (Vec::new(), Vec::new());
    for table in tables {
        let value = table.require("name", "a name")?;
        let name = value.text("a name")?;
        if name.trim().is_empty() || name.trim() != name {
            return Err(value.error("expected a name"));
        }
        if groups.iter().any(|g| g.name == name) {
            return Err(value.error("expected a name that no other group has"));
        }
        let on = table.get("on").map_or(Ok(vec![schedule::ALWAYS]), |v| schedule::read(&v))?;
        if let Some(value) = table.get("lights") {
            let expected = "a list of names of lamps or materials, * standing for any run of characters";
            for name in value.array(expected)? {
                names.push((name.text(expected)?.to_owned(), groups.len()));
            }
        }
        let mut lamps = Vec::new();
        for t in table.tables("sphere", SPHERE)? {
            lamps.push(sphere(&t)?);
        }
        for t in table.tables("rectangle", RECTANGLE)? {
            lamps.push(rectangle(&t)?);
        }
        for t in table.tables("disc", DISC)? {
            lamps.push(disc(&t)?);
        }
        for t in table.tables("spot", SPOT)? {
            lamps.push(spot(&t)?);
        }
        for t in table.tables("point", POINT)? {
            lamps.push(point(&t)?);
        }
        groups.push(Group { name: name.to_owned(), on, lamps });
    }
    Ok((groups, names))
}

fn sphere(table: &Table) -> Result<Lamp> {
    let (centre, radius) = (vector(table, "centre")?, radius(table)?);
    // Φ = π L A, A = 4 π R².
    let radiance = power(table, "radiance", PI * 4.0 * PI * radius * radius)?;
    Ok(Lamp::Sphere { centre, radius, radiance })
}

fn rectangle(table: &Table) -> Result<Lamp> {
    let [corner, edge_u, edge_v] = corner_and_edges(table)?;
    // Φ = π L A, from one side.
    let radiance = power(table, "radiance", PI * edge_u.length() * edge_v.length())?;
    Ok(Lamp::Rectangle { corner, edge_u, edge_v, radiance })
}

/// `corner`, `edge_u` and `edge_v` of a rectangle with an area.
pub(super) fn corner_and_edges(table: &Table) -> Result<[DVec3; 3]> {
    let corner = vector(table, "corner")?;
    let (edge_u, edge_v) = (vector(table, "edge_u")?, vector(table, "edge_v")?);
    let area = edge_u.length() * edge_v.length();
    let skew = edge_u.dot(edge_v).abs();
    if !(area > 0.0 && area.is_finite() && skew <= 1e-4 * area) {
        let value = table.require(if edge_u.length() > 0.0 { "edge_v" } else { "edge_u" }, "")?;
        return Err(
            value.error("expected edge_u and edge_v perpendicular to each other, and neither of length 0")
        );
    }
    Ok([corner, edge_u, edge_v])
}

fn disc(table: &Table) -> Result<Lamp> {
    let (centre, radius) = (vector(table, "centre")?, radius(table)?);
    let direction = direction(&table.require("direction", "a vector [x, y, z]")?)?;
    // Φ = π L A, from one side.
    let radiance = power(table, "radiance", PI * PI * radius * radius)?;
    Ok(Lamp::Disc { centre, direction, radius, radiance })
}

fn point(table: &Table) -> Result<Lamp> {
    let position = vector(table, "position")?;
    // Φ = 4π I.
    let intensity = power(table, "intensity", 4.0 * PI)?;
    Ok(Lamp::Point { position, intensity })
}

fn spot(table: &Table) -> Result<Lamp> {
    let position = vector(table, "position")?;
    let value = table.require("direction", "a vector [x, y, z]")?;
    let direction = direction(&value)?;
    let expected = "a half angle in degrees, above 0, at most 180";
    let outer = table.require("outer", expected)?.number(expected, |x| x > 0.0 && x <= 180.0)?.to_radians();
    let expected = "a half angle in degrees from 0 to `outer`";
    let inner = table
        .require("inner", expected)?
        .number(expected, |x| x >= 0.0 && x.to_radians() <= outer)?
        .to_radians();
    // Φ = ∫ I dω = 2π I [(1 − cos inner) + ∫ smoothstep d cos] = 2π I [1 − (cos inner + cos outer) / 2].
    let per_intensity = 2.0 * PI * (1.0 - 0.5 * (inner.cos() + outer.cos()));
    let intensity = power(table, "intensity", per_intensity)?;
    Ok(Lamp::Spot { position, direction, inner, outer, intensity })
}

/// `key` as RGB, or `lumens` and `kelvin`: RGB of luminance lumens ÷ 1000 ÷ `lumens_per_unit` (1 unit is 1000 lm/sr).
fn power(table: &Table, key: &str, lumens_per_unit: f64) -> Result<DVec3> {
    let expected = "[r, g, b], each 0 or more";
    match (table.get(key), table.get("lumens"), table.get("kelvin")) {
        (Some(value), None, None) => value.vector(expected, super::is_light),
        (None, Some(lumens), Some(kelvin)) => {
            let lumens = lumens.number("a number of lumens, 0 or more", |x| x >= 0.0)?;
            let kelvin = kelvin.number("a colour temperature from 1000 to 40000", |x| KELVIN.contains(&x))?;
            let colour = black_body(kelvin) * (lumens / 1000.0 / lumens_per_unit);
            if !colour.to_array().into_iter().all(super::is_light) {
                return Err(table.error("too many lumens from so small a lamp"));
            }
            Ok(colour)
        }
        _ => Err(table.error(format!("expected either `{key}`, or both `lumens` and `kelvin`"))),
    }
}

/// A radius that must be there.
fn radius(table: &Table) -> Result<f64> {
    let expected = "a number of metres above 0";
    table.require("radius", expected)?.number(expected, |x| x > 0.0)
}

/// A vector that must be there.
fn vector(table: &Table, key: &str) -> Result<DVec3> {
    let expected = "a vector [x, y, z] of finite numbers";
    table.require(key, expected)?.vector(expected, |_| true)
}

/// A direction of any length but zero, normalised.
pub(super) fn direction(value: &super::raw::Value) -> Result<DVec3> {
    let expected = "a vector [x, y, z] of finite numbers";
    let vector = value.vector(expected, |_| true)?;
    // Scaled first: squares of very small or large components leave the range of f64.
    (vector / vector.abs().max_element())
        .try_normalize()
        .filter(|_| vector != DVec3::ZERO)
        .ok_or_else(|| value.error("expected a vector that is not zero"))
}
