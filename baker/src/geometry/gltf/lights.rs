//! Lamps (`KHR_lights_punctual`) and cameras of the nodes of a glTF.

use crate::geometry::contents::{Contents, FileCamera, FileLamp, FileLampKind, direction};
use crate::geometry::notes::Notes;
use dataset::{Error, Result};
use glam::{DMat4, DVec3};
use gltf::camera::Projection;
use gltf::khr_lights_punctual::Kind;
use serde_json::Value;

/// The extension by which a glTF has lamps.
const EXTENSION: &str = "KHR_lights_punctual";

/// Aspect ratio of a camera that gives none.
const ASPECT: f64 = 16.0 / 9.0;

/// Checks the form of the lamps and of the nodes that have one, which the crate tells in names of its own.
///
/// # Errors
/// [`Error::Invalid`] names the extension, the lamp or node, the value and what was expected.
pub(super) fn check(root: &Value, file: &str) -> Result<()> {
    let lamps = &root["extensions"][EXTENSION]["lights"];
    let wrong = |of: String, key: &str, value: &Value, expected: &str| {
        let value = if value.is_null() { "is missing".to_owned() } else { format!("= {value}") };
        let what = format!("not glTF 2.0: {EXTENSION}, {of}: `{key}` {value}: expected {expected}");
        Err(Error::invalid(file, what))
    };
    let number = |value: &Value| value.is_null() || value.is_number();
    let lamps = match lamps {
        Value::Null => &[][..],
        Value::Array(lamps) => lamps,
        other => return wrong("the file".to_owned(), "lights", other, "a list"),
    };
    for (i, lamp) in lamps.iter().enumerate() {
        let of = || match lamp["name"].as_str() {
            Some(name) => format!("lamp {i} ({name:?})"),
            None => format!("lamp {i}"),
        };
        let kind = lamp["type"].as_str().unwrap_or("");
        if !["directional", "point", "spot"].contains(&kind) {
            return wrong(of(), "type", &lamp["type"], "\"directional\", \"point\" or \"spot\"");
        }
        let colour = &lamp["color"];
        let three = |list: &Vec<Value>| list.len() == 3 && list.iter().all(Value::is_number);
        if !(colour.is_null() || colour.as_array().is_some_and(three)) {
            return wrong(of(), "color", colour, "three numbers");
        }
        for key in ["intensity", "range"] {
            if !number(&lamp[key]) {
                return wrong(of(), key, &lamp[key], "a number");
            }
        }
        if kind == "spot" && !lamp["spot"].is_object() {
            return wrong(of(), "spot", &lamp["spot"], "an object, which may be empty");
        }
        for key in ["innerConeAngle", "outerConeAngle"] {
            if !number(&lamp["spot"][key]) {
                return wrong(of(), key, &lamp["spot"][key], "a number of radians");
            }
        }
    }
    for (i, node) in root["nodes"].as_array().into_iter().flatten().enumerate() {
        let Some(named) = node["extensions"].get(EXTENSION) else { continue };
        let index = named["light"].as_u64().and_then(|index| usize::try_from(index).ok());
        if index.is_none_or(|index| index >= lamps.len()) {
            let expected = match lamps.len() {
                0 => "none, since the file lists no lamps".to_owned(),
                n => format!("an index below {n}"),
            };
            return wrong(format!("node {i}"), "light", &named["light"], &expected);
        }
    }
    Ok(())
}

/// Adds the lamp of a node, whose place in the tree of nodes is `place`.
pub(super) fn read_lamp(
    node: &gltf::Node,
    place: usize,
    file_from_node: DMat4,
    file: &str,
    contents: &mut Contents,
    notes: &mut Notes,
) {
    if let Some(light) = node.light() {
        let names = lamp_names(node, light.name());
        let name = names[0].clone();
        match lamp(&light) {
            Ok((kind, colour, intensity)) => contents.lamps.push(FileLamp {
                name,
                names,
                node: place,
                kind,
                colour,
                intensity,
                file_from_lamp: file_from_node,
            }),
            Err(what) => notes.add(file, "lamp", name, what),
        }
    }
}

/// Adds the camera of a node.
pub(super) fn read_camera(node: &gltf::Node, file_from_node: DMat4, contents: &mut Contents) {
    if let Some(camera) = node.camera() {
        let names = [node.name(), camera.name()].into_iter().flatten().map(valid);
        let name =
            names.into_iter().find(|n| !n.is_empty()).unwrap_or_else(|| format!("camera {}", node.index()));
        if let Projection::Perspective(lens) = camera.projection()
            && let Some(direction) = direction(&file_from_node)
        {
            let aspect = lens.aspect_ratio().map_or(ASPECT, f64::from);
            let fov = 2.0 * ((0.5 * f64::from(lens.yfov())).tan() * aspect).atan().to_degrees();
            if fov > 0.0 && fov < 180.0 {
                let position = file_from_node.w_axis.truncate();
                contents.cameras.push(FileCamera { name, position, direction, fov });
            }
        }
    }
}

/// Kind, colour and intensity of a light; an error says what is wrong with it.
fn lamp(
    light: &gltf::khr_lights_punctual::Light,
) -> std::result::Result<(FileLampKind, DVec3, f64), &'static str> {
    let colour = DVec3::from(light.color().map(f64::from));
    let intensity = f64::from(light.intensity());
    if !(colour.is_finite() && colour.min_element() >= 0.0 && intensity.is_finite() && intensity >= 0.0) {
        return Err("left out: expected a colour and an intensity of finite numbers, each 0 or more");
    }
    let kind = match light.kind() {
        Kind::Directional => FileLampKind::Directional,
        Kind::Point => FileLampKind::Point,
        Kind::Spot { inner_cone_angle, outer_cone_angle } => {
            let (inner, outer) = (f64::from(inner_cone_angle), f64::from(outer_cone_angle));
            // The specification keeps the outer angle to a right one, which single precision rounds up.
            let right = std::f64::consts::FRAC_PI_2;
            if !(0.0 <= inner && inner <= outer && outer > 0.0 && outer <= right + 1e-6) {
                return Err("left out: expected 0 ≤ innerConeAngle < outerConeAngle ≤ π/2");
            }
            FileLampKind::Spot { inner, outer: outer.min(right) }
        }
    };
    Ok((kind, colour, intensity))
}

/// What a lamp is called: after its node and itself; where both have no name, by number.
pub(super) fn lamp_names(node: &gltf::Node, own: Option<&str>) -> Vec<String> {
    let names = [node.name(), own].into_iter().flatten().map(valid);
    let mut names: Vec<String> = names.filter(|name| !name.is_empty()).collect();
    if names.is_empty() {
        names.push(format!("lamp {}", node.index()));
    }
    names
}

/// A name that a group can have: without control characters and blanks at its ends.
pub(super) fn valid(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    plain.trim().to_owned()
}
