//! `[[object]]`: geometry files, where they stand, and what is overridden.

use super::raw::{Table, Value};
use super::{Group, Object, Part, SurfaceOverrides};
use dataset::{Error, Result};
use glam::{DMat3, DMat4, DVec3};
use std::path::Path;

/// Keys of `[[object]]`.
pub(super) const KEYS: &[&str] = &[
    "file",
    "translate",
    "rotate",
    "scale",
    "instances",
    "vt",
    "albedo",
    "transmission",
    "lightmap",
    "movable",
    "density",
    "two_sided",
    "emission",
    "group",
    "part",
];
const INSTANCE: &[&str] = &["translate", "rotate", "scale"];
const PART: &[&str] =
    &["name", "albedo", "transmission", "lightmap", "movable", "density", "two_sided", "emission", "group"];

/// Reads `[[object]]`. Files are looked for in `folder`; `groups` are those emission may name.
pub(super) fn read(
    tables: Vec<Table>,
    folder: &Path,
    groups: &[Group],
    warnings: &mut Vec<String>,
) -> Result<Vec<Object>> {
    expect_files(&tables, folder)?;
    tables.iter().map(|table| object(table, folder, groups, warnings)).collect()
}

const EXPECTED_FILE: &str = "the path of an .obj, .gltf or .glb file, relative to the scene file";

/// An error that lists all files that are not there.
fn expect_files(tables: &[Table], folder: &Path) -> Result<()> {
    let missing = |table: &Table| {
        let value = table.get("file")?;
        let file = folder.join(value.text(EXPECTED_FILE).ok()?);
        let what = format!("there is no file {}: expected {EXPECTED_FILE}", file.display());
        (is_model(&file) && !file.is_file()).then(|| value.error(what))
    };
    let mut errors: Vec<Error> = tables.iter().filter_map(missing).collect();
    if errors.len() < 2 {
        return errors.pop().map_or(Ok(()), Err);
    }
    let list: String = errors.iter().map(|error| format!("\n  {error}")).collect();
    Err(Error::invalid("the scene's geometry", format!("{} files are missing:{list}", errors.len())))
}

/// Whether a file's name says that it holds geometry.
pub(super) fn is_model(file: &Path) -> bool {
    ["obj", "gltf", "glb"].contains(&extension(file).as_str())
}

/// How to convert a model of another format, to end a message; empty if its name says no such.
pub(super) fn conversion(file: &Path) -> String {
    const BY_BLENDER: [&str; 6] = ["blend", "abc", "usd", "usda", "usdc", "usdz"];
    const BY_ASSIMP: [&str; 13] =
        ["fbx", "dae", "3ds", "stl", "ply", "lwo", "x", "ifc", "3mf", "off", "ase", "dxf", "x3d"];
    const BY_ITS_PROGRAM: [&str; 9] = ["max", "ma", "mb", "skp", "3dm", "c4d", "step", "stp", "dwg"];
    let extension = extension(file);
    let (from, to) = (file.display(), file.with_extension("glb"));
    let is_one = |list: &[&str]| list.contains(&extension.as_str());
    if is_one(&BY_ASSIMP) {
        let to = to.display();
        format!("; open it in Blender and export glTF 2.0 (.glb), or run `assimp export {from} {to} -fglb2`")
    } else if is_one(&BY_BLENDER) {
        "; open it in Blender and export glTF 2.0 (.glb)".to_owned()
    } else if is_one(&BY_ITS_PROGRAM) {
        "; export glTF 2.0 (.glb) or OBJ from the program that wrote it".to_owned()
    } else {
        String::new()
    }
}

/// Why a path is not that of a model.
pub(super) fn why_no_model(file: &Path) -> Option<Error> {
    let models = "expected a model: an .obj, .gltf or .glb file";
    let what = match () {
        () if file.is_dir() => "is a folder; expected models: .obj, .gltf or .glb files".to_owned(),
        () if !file.exists() => format!("no such file; {models}"),
        () if !is_model(file) => format!("{models}{}", conversion(file)),
        () => return None,
    };
    Some(Error::invalid(file.display(), what))
}

fn extension(file: &Path) -> String {
    file.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}

fn object(table: &Table, folder: &Path, groups: &[Group], warnings: &mut Vec<String>) -> Result<Object> {
    let value = table.require("file", EXPECTED_FILE)?;
    let file = folder.join(value.text(EXPECTED_FILE)?);
    if !is_model(&file) {
        return Err(value.error(format!("expected {EXPECTED_FILE}{}", conversion(&file))));
    }
    let vt_is_lightmap = match table.get("vt") {
        None => false,
        Some(v) => {
            let expected = r#""texture" or "lightmap""#;
            let lightmap = match v.text(expected)? {
                "texture" => false,
                "lightmap" => true,
                _ => return Err(v.error(format!("expected {expected}"))),
            };
            if extension(&file) != "obj" {
                return Err(v.error("expected only for .obj files; a glTF's TEXCOORD_1 is used by itself"));
            }
            lightmap
        }
    };
    // World from object, then object from instance.
    let world_from_object = transform(table)?;
    let world_from_file = match table.get("instances") {
        None => vec![world_from_object],
        Some(value) => {
            let expected = "a list of { translate, rotate, scale }, not empty";
            let instances = value.array(expected)?;
            if instances.is_empty() {
                return Err(value.error(format!("expected {expected}")));
            }
            let read =
                |v: &Value| Ok(world_from_object * transform(&v.table("instances".to_owned(), INSTANCE)?)?);
            instances.iter().map(read).collect::<Result<_>>()?
        }
    };
    let overrides = overrides(table, groups, warnings)?;
    let mut parts = Vec::new();
    for part in table.tables("part", PART)? {
        let expected = "a name, * standing for any run of characters";
        let value = part.require("name", expected)?;
        let pattern = value.text(expected)?.to_owned();
        if pattern.is_empty() {
            return Err(value.error(format!("expected {expected}")));
        }
        parts.push(Part {
            pattern,
            overrides: self::overrides(&part, groups, warnings)?,
            source_line: value.source_line(),
        });
    }
    Ok(Object { file, source_line: value.source_line(), world_from_file, overrides, parts, vt_is_lightmap })
}

/// The transform that a table gives.
fn transform(table: &Table) -> Result<DMat4> {
    let expected = "a vector [x, y, z] of finite numbers";
    let vector = |key| table.get(key).map_or(Ok(DVec3::ZERO), |v: Value| v.vector(expected, |_| true));
    let (translate, rotate) = (vector("translate")?, vector("rotate")?);
    let expected = "a number or [x, y, z], none nearer to 0 than 1e-9 (negative mirrors)";
    let scale =
        table.get("scale").map_or(Ok(DVec3::ONE), |v| v.vector_or_number(expected, |x| x.abs() > 1e-9))?;
    Ok(transform_of(scale, rotate, translate))
}

/// `scale`, then `rotate` (degrees) about X, Y and Z in this order, then `translate`.
pub fn transform_of(scale: DVec3, rotate: DVec3, translate: DVec3) -> DMat4 {
    let rotation = turn(2, rotate.z) * turn(1, rotate.y) * turn(0, rotate.x);
    let mut matrix = DMat4::from_mat3(rotation * DMat3::from_diagonal(scale));
    matrix.w_axis = translate.extend(1.0);
    matrix
}

/// Rotation about an axis (0, 1, 2) by degrees; quarter turns are exact.
fn turn(axis: usize, degrees: f64) -> DMat3 {
    let quarters = degrees / 90.0;
    let (sin, cos) = if quarters == quarters.round() {
        [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters.rem_euclid(4.0) as usize & 3]
    } else {
        degrees.to_radians().sin_cos()
    };
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut columns = DMat3::IDENTITY.to_cols_array_2d();
    columns[u][u] = cos;
    columns[u][v] = sin;
    columns[v][u] = -sin;
    columns[v][v] = cos;
    DMat3::from_cols_array_2d(&columns)
}

/// The keys objects and parts share.
fn overrides(table: &Table, groups: &[Group], warnings: &mut Vec<String>) -> Result<SurfaceOverrides> {
    let albedo = table.get("albedo").map(|v| albedo(&v, warnings)).transpose()?;
    let transmission = table.get("transmission").map(|v| share(&v)).transpose()?;
    let expected = "a number above 0";
    let density = table.get("density").map(|v| v.number(expected, |x| x > 0.0)).transpose()?;
    let expected = "[r, g, b], each 0 or more";
    let emission = table.get("emission").map(|v| v.vector(expected, super::is_light)).transpose()?;
    let group = match table.get("group") {
        None => None,
        Some(value) => {
            let name = value.text("the name of a [[group]]")?;
            if !groups.iter().any(|g| g.name == name) {
                let names: Vec<_> = groups.iter().map(|g| g.name.as_str()).collect();
                let have = if names.is_empty() { "there is none".to_owned() } else { names.join(", ") };
                return Err(value.error(format!("expected the name of a [[group]]: {have}")));
            }
            Some(name.to_owned())
        }
    };
    if emission.is_some_and(|emission| emission.max_element() > 0.0) && group.is_none() {
        return Err(
            table.error("`emission` without `group`: expected both, since the group switches the emission")
        );
    }
    let flag = |key: &str| table.get(key).map(|v| v.boolean()).transpose();
    let (lightmap, movable) = (flag("lightmap")?, flag("movable")?);
    if lightmap == Some(true) && movable == Some(true) {
        return Err(table.error(
            "`lightmap = true` with `movable = true`: expected one of them, since what moves gets no texels",
        ));
    }
    Ok(SurfaceOverrides {
        albedo,
        transmission,
        lightmap,
        movable,
        density,
        two_sided: flag("two_sided")?,
        emission,
        group,
    })
}

/// A share of the light, for all channels or per channel.
fn share(value: &Value) -> Result<DVec3> {
    let number = "a number from 0 to 1";
    let expected = if value.is_array() { "[r, g, b], each from 0 to 1" } else { number };
    value.vector_or_number(expected, |x| (0.0..=1.0).contains(&x))
}

/// An albedo; nearly white ones are warned about.
fn albedo(value: &Value, warnings: &mut Vec<String>) -> Result<DVec3> {
    let albedo = share(value)?;
    if albedo.max_element() > super::WHITE {
        warnings.push(format!(
            "{}: {}: above {} light hardly fades between bounces; white paint is about 0.8",
            value.source_line(),
            value.shown(),
            super::WHITE
        ));
    }
    Ok(albedo)
}
