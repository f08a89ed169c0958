//! `[[group]]`: lamps that switch together, and their power in photometric units.

use super::colour::{KELVIN, black_body};
use super::raw::Table;
use super::{Baked, Group, Lamp, Profile, schedule};
use dataset::Result;
use glam::DVec3;
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

/// Keys of `[[group]]`.
pub(super) const KEYS: &[&str] =
    &["name", "on", "baked", "lights", "sphere", "rectangle", "disc", "spot", "point"];
const SPHERE: &[&str] = &["centre", "radius", "radiance", "lumens", "kelvin"];
const RECTANGLE: &[&str] = &["corner", "edge_u", "edge_v", "radiance", "lumens", "kelvin"];
const DISC: &[&str] = &["centre", "direction", "radius", "radiance", "lumens", "kelvin"];
const SPOT: &[&str] =
    &["position", "direction", "inner", "outer", "intensity", "lumens", "kelvin", "ies", "up"];
const POINT: &[&str] = &["position", "intensity", "lumens", "kelvin", "ies", "direction", "up"];

/// Names of lamps and materials of files, each with its group's index.
type Names = Vec<(String, usize)>;

/// Reads `[[group]]`; names must be unique. Gives also the `lights` of each, with its index. Files are
/// relative to `folder`.
pub(super) fn read(
    tables: Vec<Table>,
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<(Vec<Group>, Names)> {
    let (mut groups, mut names): (Vec<Group>, Names) = Default::default();
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
            lamps.push(spot(&t, folder, warnings)?);
        }
        for t in table.tables("point", POINT)? {
            lamps.push(point(&t, folder, warnings)?);
        }
        groups.push(Group { name: name.to_owned(), on, lamps, baked: Baked::read(&table)? });
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

fn point(table: &Table, folder: &Path, warnings: &mut Vec<String>) -> Result<Lamp> {
    let position = vector(table, "position")?;
    if table.get("ies").is_some() {
        let direction = table.get("direction").map_or(Ok(DVec3::NEG_Y), |value| direction(&value))?;
        return ies(table, position, direction, [PI, PI], folder, warnings);
    }
    expect_ies(table, &["direction", "up"])?;
    // Φ = 4π I.
    let intensity = power(table, "intensity", 4.0 * PI)?;
    Ok(Lamp::Point { position, intensity })
}

fn spot(table: &Table, folder: &Path, warnings: &mut Vec<String>) -> Result<Lamp> {
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
    if table.get("ies").is_some() {
        return ies(table, position, direction, [inner, outer], folder, warnings);
    }
    expect_ies(table, &["up"])?;
    // Φ = ∫ I dω = 2π I [(1 − cos inner) + ∫ smoothstep d cos] = 2π I [1 − (cos inner + cos outer) / 2].
    let per_intensity = 2.0 * PI * (1.0 - 0.5 * (inner.cos() + outer.cos()));
    let intensity = power(table, "intensity", per_intensity)?;
    Ok(Lamp::Spot { position, direction, inner, outer, intensity })
}

/// A lamp by a photometric file. `intensity` (where it is greatest) or `lumens` scale it; `kelvin` gives its
/// colour.
fn ies(
    table: &Table,
    position: DVec3,
    direction: DVec3,
    [inner, outer]: [f64; 2],
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<Lamp> {
    let expected = "the path of an IES file (LM-63)";
    let value = table.require("ies", expected)?;
    let profile = Profile::read(&folder.join(value.text(expected)?)).map_err(|error| value.error(error))?;
    if profile.peak <= 0.0 {
        let what = "the lamp gives no light, since all candela values of the file are 0; expected a file with light, or no such lamp";
        warnings.push(format!("{}: {}: {what}", value.source_line(), value.shown()));
    }
    let up = match table.get("up") {
        Some(value) => {
            let up = self::direction(&value)?.reject_from_normalized(direction);
            if up.length() < 1e-6 {
                return Err(value.error("expected a vector that is not parallel to `direction`"));
            }
            up.normalize()
        }
        None if profile.is_round() => direction.any_orthonormal_vector(),
        None => {
            let what = "expected `up` beside it, a vector [x, y, z] towards the file's horizontal angle 0: it does not shine the same all round";
            return Err(value.error(what));
        }
    };
    let colour = match table.get("kelvin") {
        None => DVec3::ONE,
        Some(value) => {
            black_body(value.number("a colour temperature from 1000 to 40000", |x| KELVIN.contains(&x))?)
        }
    };
    let intensity = match (table.get("intensity"), table.get("lumens")) {
        (Some(value), None) if table.get("kelvin").is_none() => {
            value.vector("[r, g, b], each 0 or more", super::is_light)?
        }
        (Some(value), _) => {
            return Err(value.error("expected either `intensity`, or `lumens` and `kelvin`, beside `ies`"));
        }
        (None, Some(lumens)) => {
            let wanted = lumens.number("a number of lumens, 0 or more", |x| x >= 0.0)?;
            let flux = profile.flux(|cosine| cone(cosine, inner, outer));
            if flux <= 0.0 && wanted > 0.0 {
                return Err(lumens
                    .error("the IES file gives no light, or none within the cone: expected no `lumens`"));
            }
            colour * if flux > 0.0 { wanted / 1000.0 / flux } else { 0.0 }
        }
        (None, None) => colour * (profile.peak / 1000.0),
    };
    if !intensity.to_array().into_iter().all(super::is_light) {
        return Err(value.error("expected at most 1e15 candela"));
    }
    Ok(Lamp::Ies { position, direction, up, inner, outer, intensity, profile: Arc::new(profile) })
}

/// What a spot's cone leaves at a cosine to its axis: smoothstep in the cosine, a hard edge where inner =
/// outer.
fn cone(cosine: f64, inner: f64, outer: f64) -> f64 {
    let (inner, outer) = (inner.cos(), outer.cos());
    if cosine >= inner {
        1.0
    } else if cosine <= outer {
        0.0
    } else {
        let t = (cosine - outer) / (inner - outer);
        t * t * (3.0 - 2.0 * t)
    }
}

/// An error where one of these keys stands without `ies`.
fn expect_ies(table: &Table, keys: &[&str]) -> Result<()> {
    match keys.iter().find_map(|key| table.get(key)) {
        Some(value) => {
            Err(value.error("expected only beside `ies`: without it the lamp has no such direction"))
        }
        None => Ok(()),
    }
}

/// `key` as RGB, or `lumens` and `kelvin`: RGB of luminance lumens ÷ 1000 ÷ `lumens_per_unit` (1 unit is 1000
/// lm/sr).
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
