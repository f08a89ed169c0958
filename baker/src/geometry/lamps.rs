//! The lamps of geometry files in the world, and the sun that a directional light of them is.

use super::contents::FileLampKind;
use super::lights::{BRIGHTEST, Groups, Lamps};
use super::model::Model;
use super::notes::{self, Notes};
use crate::scene::{Lamp, Scene, Sky, Sun, SunKey, SunTrack};
use glam::DVec3;
use std::f64::consts::PI;

/// A lamp of a file this near to one of the scene file is the same, in metres.
const SAME_LAMP: f64 = 0.1;
/// Full angle of the disc of a file's sun in degrees.
const DISC_ANGLE: f64 = 0.533;
/// Candela per kilocandela, lux per kilolux.
const KILO: f64 = 1000.0;

/// Places the lamps of all files in the world, but those that move. `model_of` has the index of each object's
/// model, and `moving` whether each of its lamps moves.
pub(super) fn lamps(
    scene: &Scene,
    models: &[(String, Model)],
    model_of: &[Option<usize>],
    moving: &[Vec<bool>],
    groups: &mut Groups,
    notes: &mut Notes,
) -> Lamps {
    let mut found = Lamps::default();
    if !scene.lights.from_file {
        return found;
    }
    let taken: Vec<DVec3> = scene.groups.iter().flat_map(|g| &g.lamps).map(middle).collect();
    let mut suns: Vec<FileSun> = Vec::new();
    for ((object, model), moving) in scene.objects.iter().zip(model_of).zip(moving) {
        let Some(model) = model.map(|index| &models[index].1) else { continue };
        let file = object.file.display().to_string();
        for (lamp, moves) in model.contents.lamps.iter().zip(moving) {
            let names = model.names_of_lamp(lamp);
            if *moves {
                groups.leave_out(&names, None);
                continue;
            }
            let unit = match lamp.kind {
                FileLampKind::Directional => scene.lights.lux,
                FileLampKind::Point | FileLampKind::Spot { .. } => scene.lights.candela,
                FileLampKind::Ies(_) => scene.lights.profile,
            };
            let light = lamp.colour * (lamp.intensity / KILO * unit);
            if light.max_element() <= 0.0 {
                notes.add(&file, "lamp", &lamp.name, "gives no light: its colour or its intensity is 0");
                continue;
            }
            let light = light.min(DVec3::splat(BRIGHTEST));
            for world_from_file in &object.world_from_file {
                let (position, direction) = (lamp.position(world_from_file), lamp.direction(world_from_file));
                let direction = match (&lamp.kind, direction) {
                    (FileLampKind::Point, _) => DVec3::NEG_Y,
                    (_, Some(direction)) => direction,
                    (_, None) => {
                        notes.add(
                            &file,
                            "lamp",
                            &lamp.name,
                            "left out: its transform leaves it no direction",
                        );
                        continue;
                    }
                };
                if !position.is_finite() {
                    notes.add(
                        &file,
                        "lamp",
                        &lamp.name,
                        "left out: its transform leads out of the range of numbers",
                    );
                    continue;
                }
                if taken.iter().any(|other| other.distance(position) < SAME_LAMP) {
                    let what = "left out: a lamp of the scene file stands within 0.1 m of it";
                    notes.add(&file, "lamp", &lamp.name, what);
                    continue;
                }
                let made = match &lamp.kind {
                    FileLampKind::Directional => {
                        if let Some(what) = why_no_sun(scene, -direction, light) {
                            notes.add(&file, "directional light", &lamp.name, what);
                        } else {
                            suns.push(FileSun {
                                names: (file.clone(), lamp.name.clone()),
                                direction: -direction,
                                irradiance: light,
                            });
                        }
                        continue;
                    }
                    FileLampKind::Point => Lamp::Point { position, intensity: light },
                    &FileLampKind::Spot { inner, outer } => {
                        Lamp::Spot { position, direction, inner, outer, intensity: light }
                    }
                    FileLampKind::Ies(profile) => Lamp::Ies {
                        position,
                        direction,
                        up: lamp.sideways(world_from_file, direction),
                        inner: PI,
                        outer: PI,
                        intensity: light,
                        profile: profile.clone(),
                    },
                };
                found.lamps.push((groups.of(&names), made));
            }
        }
    }
    found.sun = sun(&suns, notes);
    found
}

/// Where a directional light is not used: why, and what to do. The sun and place of the scene go before it.
fn why_no_sun(scene: &Scene, to_sun: DVec3, light: DVec3) -> Option<String> {
    let write = || {
        // Ready to paste: as short as single precision has them, and no −0.
        let list = |v: DVec3| format!("[{}, {}, {}]", v.x as f32, v.y as f32, v.z as f32);
        let direction = (to_sun * 1e4).round() / 1e4 + DVec3::ZERO;
        format!("`track = [{{ hour = 0, direction = {}, irradiance = {} }}]`", list(direction), list(light))
    };
    match (&scene.sun, &scene.location, &scene.sky) {
        (Some(_), ..) => Some("left out: the scene file has a [sun]".to_owned()),
        (None, Some(_), _) => Some(format!(
            "left out: the scene file has a [place], whose sun a [sun] turns on; for the file's light at all hours write {} into it",
            write()
        )),
        (None, None, Some(Sky::Image(_))) => Some(format!(
            "left out: the picture of the sky may hold a sun; for the file's light at all hours write {} into [sun]",
            write()
        )),
        _ => None,
    }
}

/// A directional light of a file in the world.
struct FileSun {
    /// File and name.
    names: (String, String),
    /// Towards it.
    direction: DVec3,
    /// klx.
    irradiance: DVec3,
}

/// The brightest of the directional lights as the sun of all hours.
fn sun(suns: &[FileSun], notes: &mut Notes) -> Option<Sun> {
    let brightness = |sun: &FileSun| sun.irradiance.element_sum();
    let FileSun { names: (file, name), direction, irradiance } =
        suns.iter().reduce(|best, sun| if brightness(sun) > brightness(best) { sun } else { best })?;
    let name = match suns.len() - 1 {
        0 => name.clone(),
        n => format!("{name} (the brightest; {} left out: a scene has one sun)", notes::plural(n, "other")),
    };
    let what = "the sun of the scene, at the same place at all hours; a [sun] with a [place] follows the day";
    notes.add(file, "directional light", name, what);
    let key = SunKey { hour: 0.0, direction: *direction, irradiance: *irradiance };
    Some(Sun { disc_angle: DISC_ANGLE, track: SunTrack::Authored(vec![key]) })
}

/// The middle of a lamp.
fn middle(lamp: &Lamp) -> DVec3 {
    match lamp {
        Lamp::Sphere { centre, .. } | Lamp::Disc { centre, .. } => *centre,
        Lamp::Point { position, .. } | Lamp::Spot { position, .. } | Lamp::Ies { position, .. } => *position,
        Lamp::Rectangle { corner, edge_u, edge_v, .. } => *corner + 0.5 * (*edge_u + *edge_v),
    }
}
