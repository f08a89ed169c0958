//! What models hold, as far as a scene file tells of it.

use super::dim::{self, SwitchedOff};
use super::units::{Size, Unit};
use super::up::{self, Up};
use super::{glowing, units};
use crate::bake::forecast::is_usual_length;
use crate::bake::prepare::openings;
use crate::geometry::{Bounds, FileCamera, Geometry};
use crate::preview::options::Options as PreviewOptions;
use crate::preview::view;
use crate::scene::{Camera, MAX_FOV, Part, Portal, Scene, SunKey, SunTrack, SurfaceOverrides, transform_of};
use crate::trace::rays::RayTracer;
use crate::{Error, Result, geometry};
use glam::DVec3;
use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// What models hold.
pub struct Found {
    /// Each model.
    pub models: Vec<Model>,
    /// Triangles of all.
    pub triangles: usize,
    /// The sides of the box around all, metres.
    pub extent: DVec3,
    /// The unit they seem to be in.
    pub unit: Unit,
    /// Side of the lightmap in texels.
    pub side: u32,
    /// What that comes to, about.
    pub texels_per_metre: f64,
    /// Window-like openings, metres.
    pub portals: Vec<Portal>,
    /// Light groups of the emitters in them.
    pub groups: Vec<String>,
    /// A file holds lamps or a sun, beside emission.
    pub has_lamps: bool,
    /// The directional light that would be their sun.
    pub sun: Option<SunKey>,
    /// Viewpoints, metres.
    pub cameras: Vec<Camera>,
    /// The models have no cameras: those are made up.
    pub cameras_are_ours: bool,
    /// What reading the models warned of, and what is doubtful.
    pub warnings: Vec<String>,
}

/// A model, and how it is placed.
pub struct Model {
    /// Its file.
    pub file: PathBuf,
    /// Its sides in metres, Y up.
    pub extent: DVec3,
    /// What its geometry says of its upward axis; `None`: its format says that it is Y.
    pub up: Option<Up>,
    /// Its materials whose emission is better off.
    pub switched_off: Vec<SwitchedOff>,
    /// Parts that are named like lamps and have no light.
    pub glowing: Vec<String>,
}

impl Model {
    /// Whether it is turned, so that its Z points up.
    pub fn is_turned(&self) -> bool {
        self.up == Some(Up::Z)
    }
}

/// Texels per metre for scenes up to so many metres long.
const DENSITIES: [(f64, f64); 4] = [(30.0, 24.0), (100.0, 12.0), (300.0, 6.0), (f64::INFINITY, 3.0)];
/// Sides of the lightmap.
const SIDES: RangeInclusive<u32> = 256..=2048;
/// Share of the page that charts fill, about.
const FILLED_SHARE: f64 = 0.7;
/// Most parts of a model that are told to be named like lamps.
const MOST_GLOWING: usize = 8;

/// Reads models and looks at them; `unit` is theirs, if it is known.
///
/// # Errors
/// As [`Scene::of_models`] and [`geometry::load`]; models of different units.
pub fn find(files: &[PathBuf], unit: Option<Unit>) -> Result<Found> {
    let mut scene = Scene::of_models(files)?;
    let (mut geometry, mut warnings) = geometry::load(&scene)?;
    let of_model = |model: usize| triangles_of(&geometry, model);
    let unit = match unit {
        Some(unit) => unit,
        None => {
            let sizes: Vec<Size> = (0..files.len()).map(|m| Size::of(&geometry, of_model(m))).collect();
            guess_unit(files, &sizes, Size::of(&geometry, 0..geometry.triangles.len()))?
        }
    };
    let mut switched_off = dim::switched_off(&geometry, files.len(), unit.metres);
    let (mut models, mut doubts) = (Vec::new(), Vec::new());
    for (index, file) in files.iter().enumerate() {
        let up = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")).then(|| {
            let program = up::program(file);
            (up::guess(&geometry, of_model(index), unit.metres, program), program)
        });
        doubts.extend(up.and_then(|(up, program)| lying(file, up, program)));
        models.push(Model {
            file: file.clone(),
            extent: DVec3::ZERO,
            up: up.map(|(up, _)| up),
            switched_off: std::mem::take(&mut switched_off[index]),
            glowing: Vec::new(),
        });
    }
    // Read again as the scene file will place it, and with what it will switch off.
    let mut is_changed = false;
    for (object, model) in scene.objects.iter_mut().zip(&models) {
        let rotate = if model.is_turned() { up::TURN } else { DVec3::ZERO };
        object.world_from_file = vec![transform_of(DVec3::splat(unit.metres), rotate, DVec3::ZERO)];
        object.parts = model.switched_off.iter().map(off).collect();
        is_changed |= unit.metres != 1.0 || rotate != DVec3::ZERO || !object.parts.is_empty();
    }
    if is_changed {
        (geometry, warnings) = geometry::load(&scene)?;
    }
    // The scene file tells of the lights.
    warnings.retain(|warning| !warning.starts_with("lit all day") && !warning.contains("directional light"));
    warnings.extend(doubts);
    look(scene, &geometry, models, unit, warnings)
}

/// What is found once the models are placed.
fn look(
    mut scene: Scene,
    geometry: &Geometry,
    mut models: Vec<Model>,
    unit: Unit,
    mut warnings: Vec<String>,
) -> Result<Found> {
    let extent = Bounds::of(geometry.positions.iter().copied()).size();
    let longest = extent.max_element();
    if longest <= 0.0 {
        let files: Vec<String> = models.iter().map(|model| model.file.display().to_string()).collect();
        let what = "all corners of its triangles are at one point: expected surfaces";
        return Err(Error::invalid(files.join(", "), what));
    }
    if !is_usual_length(longest) {
        warnings.push(format!(
            "taken as {}, the models are {longest:.3e} m long: set a `scale` that gives their size in metres",
            unit.name
        ));
    }
    let wanted = DENSITIES.iter().find(|(most, _)| longest <= *most).map_or(3.0, |(_, density)| *density);
    let area: f64 = (0..geometry.triangles.len()).map(|t| geometry.area_f64(t)).sum();
    let side = (wanted * (area / FILLED_SHARE).sqrt()).max(1.0).min(f64::from(*SIDES.end())) as u32;
    let side = side.next_power_of_two().clamp(*SIDES.start(), *SIDES.end());
    let texels_per_metre = f64::from(side) * (FILLED_SHARE / area.max(f64::MIN_POSITIVE)).sqrt();
    let ray_tracer = RayTracer::new(geometry);
    // A prop has gaps, and no windows.
    let portals = match longest < view::SMALLEST_ROOM {
        true => Vec::new(),
        false => openings(geometry, &ray_tracer),
    };
    geometry.lights.add_to(&mut scene);
    let cameras = cameras(geometry.originals.cameras(), unit);
    let cameras_are_ours = cameras.is_empty();
    let cameras = match cameras_are_ours {
        true => vec![view::default(&PreviewOptions::new(12.0), geometry, &ray_tracer, &|_| 1.0)?],
        false => cameras,
    };
    let has_lamps = scene.groups.iter().any(|group| !group.lamps.is_empty()) || scene.sun.is_some();
    let groups: Vec<String> = scene.groups.into_iter().map(|group| group.name).collect();
    for (index, model) in models.iter_mut().enumerate() {
        let corners = triangles_of(geometry, index).flat_map(|triangle| geometry.corners(triangle));
        model.extent = Bounds::of(corners).size();
        // In models that have light, what has none is not meant to.
        if groups.is_empty() {
            model.glowing = named_like_lamps(geometry, index);
        }
    }
    Ok(Found {
        models,
        triangles: geometry.triangles.len(),
        extent,
        unit,
        side,
        texels_per_metre,
        portals,
        groups,
        has_lamps,
        sun: scene.sun.and_then(|sun| match sun.track {
            SunTrack::Authored(keys) => keys.first().copied(),
            SunTrack::Computed { .. } => None,
        }),
        cameras,
        cameras_are_ours,
        warnings,
    })
}

/// The unit of all models.
///
/// # Errors
/// One that can only be in another unit.
fn guess_unit(files: &[PathBuf], sizes: &[Size], of_all: Size) -> Result<Unit> {
    let unit = of_all.unit();
    let others: Vec<String> = (files.iter().zip(sizes))
        .filter_map(|(file, size)| {
            Some(format!("{} ({size}) in {}", file.display(), size.contradiction(&unit)?.name))
        })
        .collect();
    if files.len() == 1 || others.is_empty() {
        return Ok(unit);
    }
    let rest = files.iter().zip(sizes).filter(|(_, size)| size.contradiction(&unit).is_none());
    let rest: Vec<String> = rest.map(|(file, size)| format!("{} ({size})", file.display())).collect();
    let what = format!(
        "the models seem to be in different units: {}; {} in {}. If all are in one unit, name it with `--unit {}`. Otherwise run \
         `bake new` on those of one unit, and add the others as [[object]] with their own `scale`",
        others.join(", "),
        if rest.is_empty() { "the others".to_owned() } else { rest.join(", ") },
        unit.name,
        units::UNITS.map(|unit| unit.name).join("|")
    );
    Err(Error::invalid("bake new", what))
}

/// A warning about a model that lies on its side, or may do so.
fn lying(file: &std::path::Path, up: Up, program: Option<&str>) -> Option<String> {
    let by = program.map_or(String::new(), |program| format!(", as in {program}, which wrote it"));
    let file = file.display();
    match up {
        Up::Y => None,
        Up::PerhapsZ => Some(format!(
            "{file}: it may lie on its side, with its z axis up{by}. If `bake preview` shows that, uncomment `rotate` in the scene file"
        )),
        Up::Z => Some(format!(
            "{file}: judging by its floors and height, its z axis points up{by}. The scene file turns it with `rotate = [-90, 0, 0]`: \
             delete that line if `bake preview` shows the model on its side"
        )),
    }
}

/// The override that switches a material off.
fn off(material: &SwitchedOff) -> Part {
    Part {
        pattern: material.name.clone(),
        overrides: SurfaceOverrides { emission: Some(DVec3::ZERO), ..SurfaceOverrides::default() },
        source_line: String::new(),
    }
}

/// The triangles of a model.
fn triangles_of(geometry: &Geometry, model: usize) -> impl Iterator<Item = usize> + Clone + '_ {
    let placed = geometry.instances.iter().zip(geometry.originals.baked());
    placed
        .filter(move |(_, source)| source.object == model)
        .flat_map(|(instance, _)| instance.triangles.clone())
}

/// The first few parts of a model whose names tell of light.
fn named_like_lamps(geometry: &Geometry, model: usize) -> Vec<String> {
    let placed = geometry.instances.iter().zip(geometry.originals.baked());
    let names = placed.filter(|(_, source)| source.object == model).filter_map(|(instance, _)| {
        let (_, names) = instance.name.split_once(": ")?;
        names.split('/').next()
    });
    let glowing: BTreeSet<&str> = names.filter(|name| glowing::is_glowing(name)).collect();
    glowing.into_iter().take(MOST_GLOWING).map(str::to_owned).collect()
}

/// The models' cameras, under names that no two of them have.
fn cameras<'a>(of_files: impl Iterator<Item = &'a FileCamera>, unit: Unit) -> Vec<Camera> {
    /// How far the point that a camera looks at is from it, in metres.
    const AHEAD: f64 = 4.0;
    let mut cameras: Vec<Camera> = Vec::new();
    for camera in of_files {
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
