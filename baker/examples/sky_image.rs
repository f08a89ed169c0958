//! Writes a scene's sun and sky at given hours for other renderers:
//! `sky_image SCENE.toml HOURS FOLDER [HEIGHT]`.
//!
//! FOLDER/lights.json: per hour the sun (unit vector towards it in the scene's space, +Y up; perpendicular
//! irradiance in kilolux; full angle of the disc in degrees) or null. FOLDER/sky-HH.HHHH.f32 per hour: the
//! radiance of the sky, and of the ground below the horizon, at the centres of the pixels of a lat-long map,
//! little-endian f32 RGB, rows from the zenith down, 2·HEIGHT columns; column c looks along φ = 2π (c + ½) /
//! columns − π, that is (cos φ, sin φ) in (x, z) at the horizon. (So Blender reads it.)

use baker::light::daylight::SkyTable;
use baker::light::daylight::{ground, sun};
use baker::light::times::schedule;
use baker::scene;
use glam::Vec3;
use serde_json::json;
use std::error::Error;
use std::f32::consts::PI;
use std::fs;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [file, hours, folder, rest @ ..] = &args[..] else {
        return Err("usage: sky_image SCENE.toml HOURS FOLDER [HEIGHT]".into());
    };
    let height: usize = rest.first().map_or(Ok(512), |text| text.parse())?;
    let (scene, _) = scene::load(&PathBuf::from(file))?;
    let location = scene.location.as_ref();
    let folder = PathBuf::from(folder);
    fs::create_dir_all(&folder)?;

    let hours = schedule::parse_hours(hours)?.list;
    let mut entries = Vec::new();
    for &hour in &hours {
        let disc = scene.sun.as_ref().and_then(|s| sun::at(s, location, hour));
        let below = match (scene.ground, &scene.sky) {
            (Some(albedo), Some(sky)) => {
                let of_sun = disc.as_ref().map_or(Vec3::ZERO, |disc| ground::under_sun(albedo, disc));
                ground::under_sky(albedo, sky, location, hour) + of_sun
            }
            _ => Vec3::ZERO,
        };
        let disc = disc.map(|d| {
            let degrees = 2.0 * d.half_angle.to_degrees();
            json!({ "direction": d.direction.to_array(), "irradiance": d.irradiance.to_array(), "angle": degrees })
        });
        // The very table that the baker looks up.
        let table = SkyTable::new(scene.sky.as_ref(), location, &[hour]);
        let name = format!("sky-{hour:07.4}.f32");
        let mut bytes = Vec::with_capacity(24 * height * height);
        for row in 0..height {
            let (sin, cos) = (PI * (row as f32 + 0.5) / height as f32).sin_cos();
            for column in 0..2 * height {
                let (sin_phi, cos_phi) = (PI * ((column as f32 + 0.5) / height as f32 - 1.0)).sin_cos();
                let mut radiance = [Vec3::ZERO];
                let direction = Vec3::new(sin * cos_phi, cos, sin * sin_phi);
                table.add(direction, Vec3::ONE, &mut radiance[..table.lit.len()]);
                if direction.y < 0.0 {
                    radiance[0] += below;
                }
                bytes.extend(radiance[0].to_array().iter().flat_map(|v| v.to_le_bytes()));
            }
        }
        fs::write(folder.join(&name), bytes)?;
        entries.push(json!({ "hour": hour, "sun": disc, "sky": name }));
    }
    let text = serde_json::to_string_pretty(&json!({ "height": height, "hours": entries }))?;
    fs::write(folder.join("lights.json"), text)?;
    Ok(())
}
