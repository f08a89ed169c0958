//! A preview from end to end.

use super::baked::Baked;
use super::light::Light;
use super::moment::Moment;
use super::options::Options;
use super::picture::Picture;
use super::shade::Shader;
use super::standing::Shown;
use super::{standing, view};
use crate::light::luminance;
use crate::scene::{Scene, Sky, SunTrack};
use crate::trace::lens::Lens;
use crate::trace::rays::Rays;
use crate::trace::space::Space;
use crate::trace::triangle::Hit;
use crate::trace::walk::Transport;
use crate::{Result, geometry, scene};
use dataset::console::Console;
use dataset::files::{expect_output, write_atomically};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Walks per pixel that estimate the light of what has no texels, at least.
const WALKS: u32 = 32;

/// Whether daylight changes with the hour.
fn changes(scene: &Scene) -> bool {
    let moves = |track: &SunTrack| match track {
        SunTrack::Authored(keys) => keys.len() > 1,
        SunTrack::Place { .. } => true,
    };
    matches!(scene.sky, Some(Sky::HosekWilkie { .. }))
        || scene.sun.as_ref().is_some_and(|sun| moves(&sun.track))
}

/// Draws the baked light of a scene and writes the picture; gives what `--json` prints.
///
/// # Errors
/// Bad input; no dataset, or one of another scene; a picture that cannot be written.
pub fn preview(scene_file: &Path, options: &Options, console: &Console) -> Result<serde_json::Value> {
    let start = Instant::now();
    options.backend.expect_built()?;
    if let Some(out) = &options.out {
        expect_output(out, "png", "--out")?;
    }
    let (scene, mut warnings) = scene::load(scene_file)?;
    let folder = options.dataset.clone().unwrap_or_else(|| Path::new("dataset").join(&scene.name));
    standing::expect_finished(&folder, scene_file, &scene.name)?;
    let (geometry, geometry_warnings) = geometry::load(&scene)?;
    warnings.extend(geometry_warnings);
    warnings.iter().for_each(|warning| console.warn(warning));
    let asked = view::asked(options, &scene, &geometry)?;
    let Shown { dataset, scene, geometry, places, warnings: changed } =
        standing::open(&folder, scene_file, scene, geometry, console)?;
    warnings.extend(changed);
    let rays = Rays::with_backend(&geometry, options.backend)?;

    let moment = Moment::new(&dataset.config, options.hour);
    if moment.is_doubtful {
        console.warn(&moment.note);
        warnings.push(moment.note.clone());
    } else {
        console.say(format!("{:.2} h: {}", options.hour, moment.note));
    }
    if changes(&scene)
        && let Some(far) = moment.far(&dataset.config, options.hour)
    {
        console.warn(&far);
        warnings.push(far);
    }
    let light = Light::new(&scene, &geometry, &dataset.config, &moment);
    let baked = Baked::read(&dataset, &moment, places)?;
    let camera = match asked {
        Some(camera) => camera,
        None => {
            let shown = |hit: &Hit| baked.irradiance(hit.triangle, hit.barycentric).map_or(0.0, luminance);
            view::default(options, &geometry, &rays, &shown)?
        }
    };
    let transport = Transport::new(Space::new(&geometry, &rays), &light.lights, scene.bake.bounces);
    let walks = WALKS.div_ceil(options.samples);
    let shader = Shader { transport, light: &light, baked: &baked, walks };
    let lens = Lens::new(&camera, geometry.origin, options.size);
    let picture = Picture::trace(&shader, &lens, options.size, options.samples, scene.bake.seed, console)?;
    if picture.covered() == 0.0 {
        let nothing = "the camera sees no surface";
        console.warn(nothing);
        warnings.push(nothing.to_owned());
    }
    let exposure = options.exposure.unwrap_or_else(|| picture.exposure());
    let out = options.out.clone().unwrap_or_else(|| {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
        let name: String = camera.name.chars().map(plain).collect();
        folder.join(format!("preview-{name}-{}.png", options.hour))
    });
    write_atomically(&out, &picture.to_png(exposure))?;

    let [x, y, z] = camera.position.to_array();
    console.say(format!(
        "{}: from {x:.2},{y:.2},{z:.2} ({}), exposure {exposure:.2} EV{}",
        out.display(),
        camera.name,
        if options.exposure.is_none() { " (--exposure fixes it)" } else { "" }
    ));
    let set =
        |&(set, weight): &(usize, f32)| json!({ "hour": dataset.config.frames[set].hour, "weight": weight });
    Ok(json!({
        "scene": scene.name,
        "dataset": folder,
        "image": out,
        "hour": options.hour,
        "sets": moment.parts.iter().map(set).collect::<Vec<_>>(),
        "camera": { "name": camera.name, "position": camera.position, "look_at": camera.look_at, "fov": camera.fov },
        "size": options.size,
        "samples": options.samples,
        "exposure": exposure,
        "seconds": start.elapsed().as_secs_f64(),
        "warnings": warnings,
    }))
}
