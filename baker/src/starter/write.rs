//! The text of a scene file to begin with.

use super::find::{Found, Model};
use super::up::Up;
use crate::scene::{Camera, Portal};
use glam::DVec3;
use std::fmt::Write;

/// The scene file for what was found; `name` where the file's own name cannot be the scene's, `files` are the
/// models as the scene file names them.
pub(super) fn scene_file(found: &Found, name: Option<&str>, files: &[String]) -> String {
    let mut text = String::new();
    let mut line = |what: &str| {
        text.push_str(what);
        text.push('\n');
    };
    line(
        "# Written by `bake new`: what stands here was guessed from the model. Change what is wrong; every key is in scenes/README.md.",
    );
    line("");
    if let Some(name) = name {
        line(&format!("name = {}", quoted(name)));
        line("");
    }
    line("# Where and when: decides the course of the sun and the colour of the sky. Hours are local time.");
    line("[place]");
    line("latitude = 48.1     # degrees, north positive");
    line("longitude = 11.6    # degrees, east positive");
    line("utc_offset = 2      # hours that local time adds to UTC, summer time included");
    line("date = 2026-06-21");
    line("north = 0           # degrees from -Z, clockwise seen from above");
    line("");
    line("[sun]");
    if let Some(sun) = found.sun {
        line(
            "# The model has its own sun. To use it at all hours, uncomment the next line. Its irradiance is in kilolux if the file's is in lux;",
        );
        line("# if Blender exported it as Unitless or Raw, multiply the irradiance by 683.");
        let (direction, irradiance) = (vector(sun.direction), vector(sun.irradiance));
        line(&format!("# track = [{{ hour = 0, direction = {direction}, irradiance = {irradiance} }}]"));
    }
    line("");
    line("[sky]");
    line("model = \"hosek-wilkie\"");
    line("turbidity = 3       # 2 is very clear, 10 is murky");
    line(
        "ground_albedo = 0.2 # of the land around, which is seen where the model ends; `ground = false` makes it black there",
    );
    for (model, file) in found.models.iter().zip(files) {
        object(found, model, file, &mut line);
    }
    if found.models.iter().any(|model| !model.glowing.is_empty()) {
        line("");
        line("# [[group]]");
        line("# name = \"lamps\"");
        line("# on = [[\"18:00\", \"23:30\"]]");
    }
    units_of_lights(found, &mut line);
    groups(&found.groups, &mut line);
    portals(&found.portals, &mut line);
    cameras(&found.cameras, found.cameras_are_ours, &mut line);
    line("");
    line("[lightmap]");
    line(&format!(
        "size = {:<12} # texels; about {} texels per metre. Half with --draft, twice with --final",
        found.side,
        short(found.texels_per_metre)
    ));
    line("");
    line("[bake]");
    line("samples = 64        # per texel on average");
    text
}

/// A model.
fn object(found: &Found, model: &Model, file: &str, line: &mut impl FnMut(&str)) {
    let [x, y, z] = model.extent.to_array();
    line("");
    line("[[object]]");
    line(&format!("file = {}", quoted(file)));
    let size = format!("{} × {} × {} m", short(x), short(y), short(z));
    if found.unit.metres == 1.0 {
        line(&format!(
            "# scale = 0.01      # the model is taken as {size}; if it is in centimetres, it needs this scale"
        ));
    } else {
        let unit = found.unit;
        line(&format!(
            "scale = {:<11} # taken as {}, so the model is {size}; without this line it is in metres",
            unit.metres, unit.name
        ));
    }
    match model.up {
        None => {}
        Some(Up::Z) => line(
            "rotate = [-90, 0, 0] # its z axis seems to point up, so the model is turned; delete this line if y already points up",
        ),
        Some(Up::Y | Up::PerhapsZ) => {
            line("# rotate = [-90, 0, 0] # for an OBJ whose z axis points up: if the model lies on its side")
        }
    }
    switched_off(model, line);
    glowing(model, line);
}

/// What emits and is no lamp.
fn switched_off(model: &Model, line: &mut impl FnMut(&str)) {
    for (i, off) in model.switched_off.iter().enumerate() {
        line("");
        if i == 0 {
            line(
                "# These materials emit light, but are probably not lamps, so they are switched off. To switch one on again,",
            );
            line(
                "# delete its three lines, and add a [[group]] with its name and the times when it is `on`.",
            );
        }
        line("[[object.part]]");
        line(&format!("name = {}", quoted(&off.name)));
        line(&format!("emission = [0, 0, 0] # {}", off.why));
    }
}

/// Parts whose names tell of light.
fn glowing(model: &Model, line: &mut impl FnMut(&str)) {
    if model.glowing.is_empty() {
        return;
    }
    line("");
    line(
        "# These parts are named like lamps, but the model gives them no light. To let one shine, uncomment its lines and",
    );
    line("# the group's below. `emission` is in kcd/m²: 2 is a bright lampshade, 20 a frosted bulb.");
    for name in &model.glowing {
        line("# [[object.part]]");
        line(&format!("# name = {}", quoted(name)));
        line("# emission = [2, 1.6, 1.1]");
        line("# group = \"lamps\"");
    }
}

/// In what units files may give the strength of lamps.
fn units_of_lights(found: &Found, line: &mut impl FnMut(&str)) {
    if !found.has_lamps {
        return;
    }
    line("");
    line("# If Blender exported the model with lighting mode Unitless or Raw, uncomment both lines.");
    line("# [lights]");
    line("# unit = \"unitless\" # or \"raw\"; the default is \"standard\", as in Blender");
}

/// The emitters in the model.
fn groups(names: &[String], line: &mut impl FnMut(&str)) {
    for (i, name) in names.iter().enumerate() {
        line("");
        if i == 0 {
            line(
                "# What shines in the model, by the names of its lamps and materials. To switch a group, say when it is on, such as",
            );
            line("# on = [[\"18:00\", \"23:30\"]].");
        }
        line("[[group]]");
        line(&format!("name = {}", quoted(name)));
        line("on = \"always\"");
    }
}

/// Openings, as portals.
fn portals(portals: &[Portal], line: &mut impl FnMut(&str)) {
    if portals.is_empty() {
        return;
    }
    line("");
    line(
        "# Openings that look like windows: the sky is looked for there, which takes noise out of rooms. One at a wrong place does no harm but",
    );
    line("# costs a little time; delete it.");
    for portal in portals {
        line("[[portal]]");
        line(&format!("corner = {}", vector(portal.corner)));
        line(&format!("edge_u = {}", vector(portal.edge_u)));
        line(&format!("edge_v = {}", vector(portal.edge_v)));
    }
}

/// Viewpoints for previews.
fn cameras(cameras: &[Camera], are_ours: bool, line: &mut impl FnMut(&str)) {
    for (i, camera) in cameras.iter().enumerate() {
        line("");
        if i == 0 {
            line(match are_ours {
                true => "# A viewpoint for `bake preview`: the model has none.",
                false => "# The model's viewpoints, for `bake preview`.",
            });
        }
        line("[[camera]]");
        line(&format!("name = {}", quoted(&camera.name)));
        line(&format!("position = {}", vector(camera.position)));
        line(&format!("look_at = {}", vector(camera.look_at)));
        line(&format!("fov = {}", short(camera.fov)));
    }
}

/// As TOML has it.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// To the millimetre, as TOML has it.
fn vector(v: DVec3) -> String {
    let number = |x: f64| {
        let rounded = (x * 1e3).round() / 1e3;
        // (No negative zero.)
        (rounded + 0.0).to_string()
    };
    let [x, y, z] = v.to_array().map(number);
    format!("[{x}, {y}, {z}]")
}

/// To three digits.
fn short(x: f64) -> String {
    let mut text = String::new();
    let digits = if x > 0.0 { (2 - x.log10().floor() as i32).clamp(0, 6) as usize } else { 0 };
    let _ = write!(text, "{x:.digits$}");
    if text.contains('.') {
        text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
    }
    text
}
