//! A scene's transfer: the scene under spherical harmonics instead of its own sun, sky and lamps.

use crate::light::daylight::harmonics::{hours, parts};
use crate::light::daylight::project::{coefficients, is_upper};
use crate::light::times::{Hours, extra_times};
use crate::scene::{Baked, LightsOfFiles, Scene, Sky, SurfaceOverrides};
use crate::{Error, Result};
use dataset::format::{Transfer, TransferLight};
use std::path::Path;

/// What is baked instead of a scene: the same surfaces with one part of a harmonic as the sky at each of
/// these hours; and what that stands for. `inputs` is the digest of the day's bake that it goes with, which
/// has at most `most` extra times.
///
/// # Errors
/// A scene whose light is that of lamps alone.
pub(super) fn of_scene(
    scene: Scene,
    scene_file: &Path,
    inputs: String,
    most: u32,
) -> Result<(Scene, Hours, Transfer)> {
    if scene.sun.is_none() && scene.sky.is_none() {
        return Err(Error::invalid(
            scene_file.display(),
            "has neither sun nor sky; expected one of them for --transfer, which is of daylight",
        ));
    }
    if scene.ground.is_some() && scene.ground_is_written {
        return Err(Error::invalid(
            scene_file.display(),
            "has a ground below the horizon, which --transfer does not know; expected `ground = false` in [sky] for it",
        ));
    }
    if scene.sun_baked != Baked::All || scene.sky_baked != Baked::All {
        return Err(Error::invalid(
            scene_file.display(),
            "leaves a part of its sun or sky to the game (`baked`), which --transfer does not know; expected `baked = \"all\"` for it",
        ));
    }
    let upper = is_upper(&scene);
    let (times, _) = extra_times::all_times(&scene, &Hours::day(), most);
    let times: Vec<f64> = times.iter().map(|time| time.hour).collect();
    let light = times.iter().zip(coefficients(&scene, &times));
    let transfer = Transfer {
        scene: scene.name.clone(),
        inputs,
        parts: parts(upper),
        light: light.map(|(&hour, coefficients)| TransferLight { hour, coefficients }).collect(),
    };
    let mut objects = scene.objects;
    for object in &mut objects {
        object
            .parts
            .iter_mut()
            .map(|part| &mut part.overrides)
            .chain([&mut object.overrides])
            .for_each(darken);
    }
    let scene = Scene {
        name: format!("{}-transfer", scene.name),
        sun: None,
        sky: Some(Sky::Harmonics { upper }),
        ground: None,
        objects,
        groups: Vec::new(),
        lights: LightsOfFiles { from_file: false, ..Default::default() },
        ..scene
    };
    Ok((scene, Hours { list: hours(upper), ..Hours::default() }, transfer))
}

/// What a transfer leaves out of a scene's light, if anything.
pub(super) fn omitted(scene: &Scene) -> Option<String> {
    (scene.ground.is_some() && !scene.ground_is_written).then(|| {
        "--transfer leaves out the ground below the horizon, which the bake of the day has; `ground = false` in [sky] leaves it out of both"
            .to_owned()
    })
}

/// Surfaces that shine do so with a group.
fn darken(overrides: &mut SurfaceOverrides) {
    (overrides.emission, overrides.group) = (None, None);
}
