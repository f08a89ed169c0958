//! A scene file to begin with, written for a model: what `bake new` does.
//!
//! `glowing` knows names of lamps, `units` guesses the unit of length, [`crate::bake::openings`] finds
//! windows, `write` makes the text.

mod glowing;
mod units;
mod write;

pub use units::Unit;

use crate::bake::openings::openings;
use crate::bake::output::relative_to;
use crate::geometry::{Bounds, FileCamera, Geometry};
use crate::preview::options::Options as PreviewOptions;
use crate::preview::view;
use crate::scene::{Camera, MAX_FOV, Portal, Scene, SunKey, SunTrack, is_reserved};
use crate::trace::ray_tracer::RayTracer;
use crate::{Error, Result, geometry};
use dataset::files::write_atomically;
use dataset::observe::{Observer, count};
use glam::DVec3;
use serde_json::json;
use std::path::{Path, PathBuf};

/// What a model holds, as far as a scene file tells of it.
pub struct Found {
    /// Triangles.
    pub triangles: usize,
    /// The sides of the box around it, in its own unit.
    pub extent: DVec3,
    /// The unit it seems to be in.
    pub unit: Unit,
    /// Side of the lightmap in texels.
    pub side: u32,
    /// What that comes to, about.
    pub texels_per_metre: f64,
    /// Window-like openings, metres.
    pub portals: Vec<Portal>,
    /// Light groups of the emitters in it.
    pub groups: Vec<String>,
    /// The directional light that would be its sun.
    pub sun: Option<SunKey>,
    /// Viewpoints, metres.
    pub cameras: Vec<Camera>,
    /// The model has no cameras: those are made up.
    pub cameras_are_ours: bool,
    /// Parts that are named like lamps and have no light.
    pub glowing: Vec<String>,
    /// What reading the model warned of.
    pub warnings: Vec<String>,
}

/// Where to write, and whether over a file that is there.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// The scene file to write [default: beside the model, with its name, or its folder's if it is called
    /// scene, model or untitled].
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
}

/// For `--help`.
pub const HELP: &str = "\
Examples:
  bake new models/house.glb                        models/house.toml, then: bake models/house.toml --draft
  bake new models/house.glb --out scenes/house.toml

The file is a start, with a comment on each guess: the unit of length (metres, centimetres or millimetres, by the size of the
model and of its triangles), window-like openings as portals, the model's emitters as light groups, the model's cameras or a
default one, and the lightmap's size.

With --json, one object on stdout: scene, triangles, unit, metres_per_unit, extent (metres), size, texels_per_metre, portals, groups
and cameras (names), warnings.";

/// Texels per metre for scenes up to so many metres long.
const DENSITIES: [(f64, f64); 4] = [(30.0, 24.0), (100.0, 12.0), (300.0, 6.0), (f64::INFINITY, 3.0)];
/// Sides of the lightmap.
const SIDES: std::ops::RangeInclusive<u32> = 256..=2048;
/// Share of the page that charts fill, about.
const FILLED_SHARE: f64 = 0.7;

/// Writes a scene file for a model; gives what `--json` prints.
///
/// # Errors
/// A model that cannot be read; a scene file that is there already, or cannot be written.
pub fn new(model: &Path, options: &Options, console: &dyn Observer) -> Result<serde_json::Value> {
    // (Before anything is said of the file to write: a scene file may be what was given.)
    Scene::of_model(model)?;
    let name = plain(&name_of(model));
    let out = options.out.clone().unwrap_or_else(|| model.with_file_name(format!("{name}.toml")));
    if out.extension().is_none_or(|e| e != "toml") {
        return Err(Error::invalid(
            "--out",
            format!("{}: expected a file that ends in .toml", out.display()),
        ));
    }
    if out.exists() && !options.force {
        let what = "is there already; --force replaces it, --out writes elsewhere";
        return Err(Error::invalid(out.display(), what));
    }
    let found = find(model)?;
    found.warnings.iter().for_each(|warning| console.warn(warning));
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let named = plain(&stem);
    let text = write::scene_file(&found, (named != stem).then_some(&named), &from_folder_of(&out, model)?);
    write_atomically(&out, text.as_bytes())?;

    let [x, y, z] = (found.extent * found.unit.metres).to_array();
    console.say(format!(
        "{}: {}, taken as {}: {x:.2} × {y:.2} × {z:.2} m, {}, {}, a lightmap of {}² (about {:.0} texels per metre)",
        out.display(),
        count(found.triangles, "triangle"),
        found.unit.name,
        count(found.portals.len(), "portal"),
        count(found.groups.len(), "light group"),
        found.side,
        found.texels_per_metre
    ));
    let shown = out.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@%".contains(c);
    let shown =
        if shown.chars().all(is_plain) { shown } else { format!("'{}'", shown.replace('\'', "'\\''")) };
    console.say(format!("  next: bake {shown} --draft --compress"));
    Ok(json!({
        "scene": out,
        "triangles": found.triangles,
        "unit": found.unit.name,
        "metres_per_unit": found.unit.metres,
        "extent": [x, y, z],
        "size": found.side,
        "texels_per_metre": found.texels_per_metre,
        "portals": found.portals.len(),
        "groups": found.groups,
        "cameras": found.cameras.iter().map(|c| &c.name).collect::<Vec<_>>(),
        "warnings": found.warnings,
    }))
}

/// Reads a model and looks at it.
///
/// # Errors
/// As [`geometry::load`].
pub fn find(model: &Path) -> Result<Found> {
    let scene = Scene::of_model(model)?;
    let (mut geometry, mut warnings) = geometry::load(&scene)?;
    // The scene file tells of the lights.
    warnings.retain(|warning| !warning.starts_with("lit all day") && !warning.contains("directional light"));
    let unit = units::guess(&geometry);
    let extent = Bounds::of(geometry.positions.iter().copied()).size();
    scale(&mut geometry, unit.metres);
    let longest = extent.max_element() * unit.metres;
    let wanted = DENSITIES.iter().find(|(most, _)| longest <= *most).map_or(3.0, |(_, density)| *density);
    let area: f64 = (0..geometry.triangles.len()).map(|t| f64::from(geometry.area(t))).sum();
    let side = (wanted * (area / FILLED_SHARE).sqrt()).max(1.0).min(f64::from(*SIDES.end())) as u32;
    let side = side.next_power_of_two().clamp(*SIDES.start(), *SIDES.end());
    let texels_per_metre = f64::from(side) * (FILLED_SHARE / area.max(f64::MIN_POSITIVE)).sqrt();
    let ray_tracer = RayTracer::new(&geometry);
    // A prop has gaps, and no windows.
    let portals = match longest < view::SMALLEST_ROOM {
        true => Vec::new(),
        false => openings(&geometry, &ray_tracer),
    };
    let mut lit = scene;
    geometry.lights.add_to(&mut lit);
    let cameras = cameras(geometry.originals.cameras(), unit);
    let cameras_are_ours = cameras.is_empty();
    let cameras = match cameras_are_ours {
        true => vec![view::default(&PreviewOptions::new(12.0), &geometry, &ray_tracer, &|_| 1.0)?],
        false => cameras,
    };
    let mut glowing: Vec<String> = geometry
        .instances
        .iter()
        .filter_map(|instance| {
            instance.name.split_once(": ").map(|(_, name)| name.split('/').next().unwrap_or(name))
        })
        .filter(|name| glowing::is_glowing(name))
        .map(str::to_owned)
        .collect();
    let groups: Vec<String> = lit.groups.into_iter().map(|group| group.name).collect();
    // In a model that has light, what has none is not meant to.
    glowing.retain(|_| groups.is_empty());
    glowing.sort_unstable();
    glowing.dedup();
    glowing.truncate(8);
    Ok(Found {
        triangles: geometry.triangles.len(),
        extent,
        unit,
        side,
        texels_per_metre,
        portals,
        cameras,
        cameras_are_ours,
        groups,
        sun: lit.sun.and_then(|sun| match sun.track {
            SunTrack::Authored(keys) => keys.first().copied(),
            SunTrack::Computed { .. } => None,
        }),
        glowing,
        warnings,
    })
}

/// The model's cameras, under names that no two of them have.
fn cameras<'a>(of_file: impl Iterator<Item = &'a FileCamera>, unit: Unit) -> Vec<Camera> {
    /// How far the point that a camera looks at is from it, in metres.
    const AHEAD: f64 = 4.0;
    let mut cameras: Vec<Camera> = Vec::new();
    for camera in of_file {
        let name = camera.name.replace(',', " ");
        let name = if name.trim().is_empty() { "camera" } else { name.trim() };
        let numbered = (2..).map(|number| format!("{name} {number}"));
        let mut names = std::iter::once(name.to_owned()).chain(numbered);
        let free = names.find(|name| cameras.iter().all(|camera| camera.name != *name));
        let position = camera.position * unit.metres;
        cameras.push(Camera {
            name: free.unwrap_or_default(),
            position,
            look_at: position + camera.direction * AHEAD,
            fov: camera.fov.clamp(1.0, MAX_FOV),
        });
    }
    cameras
}

/// The geometry in metres.
fn scale(geometry: &mut Geometry, metres: f64) {
    if metres != 1.0 {
        geometry.origin *= metres;
        geometry.positions.iter_mut().for_each(|p| *p *= metres as f32);
    }
}

/// What a model is called: by its folder, where its own name is one that many have.
fn name_of(model: &Path) -> String {
    let stem = model.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let folder = std::path::absolute(model).ok();
    let folder = folder.as_deref().and_then(Path::parent).and_then(Path::file_name);
    match folder {
        Some(folder) if ["scene", "model", "untitled"].contains(&stem.to_ascii_lowercase().as_str()) => {
            folder.to_string_lossy().into_owned()
        }
        _ => stem,
    }
}

/// A text as the name of a scene: letters, digits, `_` and `-`.
fn plain(text: &str) -> String {
    let plain: String = text
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || c == '_' || c == '-' { c } else { '-' })
        .collect();
    let plain = plain.trim_matches('-');
    match plain {
        "" => "scene".to_owned(),
        taken if is_reserved(taken) => format!("{taken}-scene"),
        plain => plain.to_owned(),
    }
}

/// The path of a model as a scene file in another folder names it, with slashes also where folders are
/// divided otherwise.
fn from_folder_of(scene_file: &Path, model: &Path) -> Result<String> {
    let absolute = |path: &Path| std::path::absolute(path).map_err(Error::io(path));
    let (model, scene) = (absolute(model)?, absolute(scene_file)?);
    let relative = relative_to(scene.parent().unwrap_or(Path::new("")), &model);
    Ok(relative.components().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/"))
}
