//! A preview from end to end.

use super::baked::Baked;
use super::blend::Blend;
use super::bundle::Compressed;
use super::existing::Shown;
use super::light::Light;
use super::options::Options;
use super::picture::Picture;
use super::shade::Shader;
use super::triangle_layout::TriangleLayout;
use super::{existing, view};
use crate::light::luminance;
use crate::scene::{Baked as Part, Scene, Sky, SunTrack};
use crate::trace::paths::Transport;
use crate::trace::rays::{Hit, Lens, RayTracer};
use crate::trace::solids::Space;
use crate::{Result, geometry, scene};
use dataset::host::files::{expect_output, write_atomically};
use dataset::observe::Observer;
use dataset::store::Dataset;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Paths per pixel that estimate the light of what has no texels, at least.
const PATHS: u32 = 32;

/// Whether daylight changes with the hour.
fn changes(scene: &Scene) -> bool {
    let moves = |track: &SunTrack| match track {
        SunTrack::Authored(keys) => keys.len() > 1,
        SunTrack::Computed { .. } => true,
    };
    matches!(scene.sky, Some(Sky::HosekWilkie { .. }))
        || scene.sun.as_ref().is_some_and(|sun| moves(&sun.track))
}

/// The light of texels.
struct Source {
    baked: Baked,
    /// The hours whose light it is, each with its share.
    hours: Vec<(f64, f32)>,
    /// Whether these are frames of the dataset.
    is_set: bool,
    /// What is to be warned of.
    doubts: Vec<String>,
}

/// The lightmaps of a dataset.
fn of_frames(
    dataset: &Dataset,
    hour: f64,
    scene: &Scene,
    layout: TriangleLayout,
    console: &dyn Observer,
) -> Result<Source> {
    let blend = Blend::new(&dataset.config, hour);
    let mut doubts = Vec::new();
    if blend.is_doubtful {
        doubts.push(blend.note.clone());
    } else {
        console.say(format!("{hour:.2} h: {}", blend.note));
    }
    doubts.extend(blend.far(&dataset.config, hour).filter(|_| changes(scene)));
    let hours = blend.parts.iter().map(|&(frame, weight)| (dataset.config.frames[frame].hour, weight));
    Ok(Source { hours: hours.collect(), is_set: true, doubts, baked: Baked::read(dataset, &blend, layout)? })
}

/// What a bundle of the dataset decodes to. Where the bundle lacks the sun's direct light, `scene` loses it,
/// too, for what has no texels.
fn of_bundle(
    bundle: &Compressed,
    dataset: &Dataset,
    hour: f64,
    scene: &mut Scene,
    layout: TriangleLayout,
    console: &dyn Observer,
) -> Result<Source> {
    bundle.expect_of(dataset)?;
    console.say(format!("{hour:.2} h: decoded from {}", bundle.path.display()));
    if bundle.lacks_sun() {
        scene.sun_baked = Part::Indirect;
    }
    let doubts = bundle.doubts(&dataset.config, hour, changes(scene));
    Ok(Source {
        baked: Baked::decode(bundle, hour, layout)?,
        hours: vec![(hour, 1.0)],
        is_set: false,
        doubts,
    })
}

/// Draws the baked light of a scene and writes the picture; gives what `--json` prints.
///
/// # Errors
/// Bad input; no dataset, or one of another scene; a picture that cannot be written.
pub fn preview(scene_file: &Path, options: &Options, console: &dyn Observer) -> Result<serde_json::Value> {
    let start = Instant::now();
    options.backend.expect_built()?;
    if let Some(out) = &options.out {
        expect_output(out, "png", "--out")?;
    }
    let bundle = options.bundle.as_deref().map(Compressed::open).transpose()?;
    let (scene, mut warnings) = scene::load(scene_file)?;
    let folder = options.dataset.clone().unwrap_or_else(|| Path::new("dataset").join(&scene.name));
    existing::expect_finished(&folder, scene_file, &scene.name)?;
    let (geometry, geometry_warnings) = geometry::load(&scene)?;
    warnings.extend(geometry_warnings);
    warnings.iter().for_each(|warning| console.warn(warning));
    let asked = view::asked(options, &scene, &geometry)?;
    let Shown { dataset, mut scene, geometry, layout, warnings: changed } =
        existing::open(&folder, scene_file, scene, geometry, console)?;
    warnings.extend(changed);
    let Source { baked, hours, is_set, doubts } = match &bundle {
        None => of_frames(&dataset, options.hour, &scene, layout, console)?,
        Some(bundle) => of_bundle(bundle, &dataset, options.hour, &mut scene, layout, console)?,
    };
    doubts.iter().for_each(|doubt| console.warn(doubt));
    warnings.extend(doubts);
    let ray_tracer = RayTracer::with_backend(&geometry, options.backend)?;
    let light = Light::new(&scene, &geometry, &hours);
    let camera = match asked {
        Some(camera) => camera,
        None => {
            let shown = |hit: &Hit| baked.irradiance(hit.triangle, hit.barycentric).map_or(0.0, luminance);
            view::default(options, &geometry, &ray_tracer, &shown)?
        }
    };
    let transport = Transport::new(Space::new(&geometry, &ray_tracer), &light.lights, scene.bake.bounces);
    let paths = (!options.as_game).then(|| PATHS.div_ceil(options.samples));
    let shader = Shader { transport, light: &light, baked: &baked, paths };
    let lens = Lens::new(&camera, geometry.origin, options.size);
    let picture = Picture::trace(&shader, &lens, options.size, options.samples, scene.bake.seed, console)?;
    let [lit, unlit] = picture.met();
    if lit + unlit == 0.0 {
        let nothing = "the camera sees no surface";
        console.warn(nothing);
        warnings.push(nothing.to_owned());
    }
    let unlit_share = options.as_game.then(|| unlit / (lit + unlit).max(f64::MIN_POSITIVE));
    if let Some(share) = unlit_share.filter(|share| *share > 0.0) {
        console.say(format!(
            "{:.1} % of the surfaces in view have no texels and are black: in a game they need texels (`lightmap = true`) or other light, \
             such as probes",
            100.0 * share
        ));
    }
    let exposure = options.exposure.unwrap_or_else(|| picture.exposure());
    let out = options.out.clone().unwrap_or_else(|| {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
        let name: String = camera.name.chars().map(plain).collect();
        let bundle = options.bundle.as_deref().and_then(Path::file_stem).map(|stem| stem.to_string_lossy());
        let bundle: String = bundle.map_or(String::new(), |stem| format!("-of-{stem}"));
        let mode = if options.as_game { "-as-game" } else { "" };
        folder.join(format!("preview-{name}-{}{bundle}{mode}.png", options.hour))
    });
    write_atomically(&out, &picture.to_png(exposure))?;

    let [x, y, z] = camera.position.to_array();
    console.say(format!(
        "{}: from {x:.2},{y:.2},{z:.2} ({}), exposure {exposure:.2} EV{}",
        out.display(),
        camera.name,
        if options.exposure.is_none() { " (--exposure fixes it)" } else { "" }
    ));
    let frame = |&(hour, weight): &(f64, f32)| json!({ "hour": hour, "weight": weight });
    let frames = if is_set { &hours[..] } else { &[] };
    Ok(json!({
        "scene": scene.name,
        "dataset": folder,
        "bundle": options.bundle,
        "image": out,
        "hour": options.hour,
        "frames": frames.iter().map(frame).collect::<Vec<_>>(),
        "camera": { "name": camera.name, "position": camera.position, "look_at": camera.look_at, "fov": camera.fov },
        "size": options.size,
        "samples": options.samples,
        "exposure": exposure,
        "unlit": unlit_share,
        "seconds": start.elapsed().as_secs_f64(),
        "warnings": warnings,
    }))
}
