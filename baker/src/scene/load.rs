//! From a scene file's path to the resolved scene: every default filled in, every value checked.

use super::raw::{Source, Table, parse};
use super::{
    Baked, HiddenFaces, Lightmap, LightmapSize, Location, MAX_SAMPLES, Portal, Sampling, Scene, Sky, Sun,
    SunKey, SunTrack, SunVisibility, UvSource, camera, lamp, lights, object, sky,
};
use dataset::{Error, Result};
use glam::DVec3;
use std::path::Path;

const TOP_KEYS: &[&str] = &[
    "name",
    "description",
    "place",
    "sun",
    "sky",
    "portal",
    "object",
    "group",
    "lights",
    "lightmap",
    "bake",
    "camera",
];
const LOCATION_KEYS: &[&str] = &["latitude", "longitude", "utc_offset", "date", "north", "refraction"];
const SUN_KEYS: &[&str] = &["disc_angle", "turbidity", "track", "baked", "visibility"];
const SUN_KEY_KEYS: &[&str] = &["hour", "direction", "irradiance"];
const PORTAL_KEYS: &[&str] = &["corner", "edge_u", "edge_v"];
const LIGHTMAP_KEYS: &[&str] = &["size", "texels_per_metre", "pages", "padding", "hidden", "uv"];
const BAKE_KEYS: &[&str] = &["samples", "bounces", "seed", "albedo_max"];

/// Full angle of the solar disc in degrees, mean over the year.
const DISC_ANGLE: f64 = 0.533;
/// Largest page side in texels.
const MAX_SIDE: i64 = 16384;

/// Reads a scene file and resolves it. Gives the scene and the warnings to show.
///
/// # Errors
/// [`Error::Invalid`] names file, line, key, value and what was expected; [`Error::Io`] if the file cannot be
/// read.
pub fn load(path: &Path) -> Result<(Scene, Vec<String>)> {
    let file = path.display().to_string();
    if path.is_dir() {
        return Err(Error::invalid(file, "is a folder; expected a scene file, such as scenes/yard.toml"));
    }
    if path.is_file() && object::is_model(path) {
        let model = path.file_name().and_then(|name| name.to_str()).unwrap_or("");
        let what = format!(
            "is a model; expected a scene, which is a TOML file. `bake new {file}` writes one, or, beside the model, these three \
             lines are one:\nsky = {{ model = \"constant\", radiance = [3, 3, 3] }}\n[[object]]\nfile = {model:?}"
        );
        return Err(Error::invalid(file, what));
    }
    let conversion = object::conversion(path);
    if !conversion.is_empty() {
        let what = format!(
            "is a model; expected a scene, which is a TOML file, with .obj, .gltf or .glb models{conversion}"
        );
        return Err(Error::invalid(file, what));
    }
    if !path.exists() {
        return Err(Error::invalid(file, "no such file; expected a scene, which is a TOML file"));
    }
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let text = std::str::from_utf8(&bytes).map_err(|e| {
        let line = 1 + bytes[..e.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        Error::invalid(format!("{file}:{line}"), "expected UTF-8 text")
    })?;
    parse(&Source { file, text }, TOP_KEYS, |top| resolve(&top, path))
}

fn resolve(top: &Table, path: &Path) -> Result<(Scene, Vec<String>)> {
    let mut warnings = Vec::new();
    let name = name(top, path)?;
    let description = top.get("description").map_or(Ok(""), |v| v.text("a string"))?.to_owned();
    let location = top.table("place", LOCATION_KEYS)?.map(|t| self::location(&t)).transpose()?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let of_sky = top.table("sky", sky::KEYS)?;
    let sky = of_sky.as_ref().map(|t| sky::read(t, location.is_some(), folder)).transpose()?;
    let ground = match (&of_sky, &sky) {
        (Some(table), Some(sky)) => sky::ground(table, sky)?,
        _ => None,
    };
    let ground_is_written = of_sky.as_ref().is_some_and(|table| table.get("ground").is_some());
    let sky_baked = of_sky.as_ref().map(Baked::read).transpose()?.unwrap_or_default();
    let of_sun = top.table("sun", SUN_KEYS)?;
    let sun_baked = of_sun.as_ref().map(Baked::read).transpose()?.unwrap_or_default();
    let sun_visibility = of_sun.as_ref().map(|table| visibility(table, sun_baked)).transpose()?.flatten();
    let sun = of_sun.map(|t| self::sun(&t, location.is_some(), sky.as_ref())).transpose()?;
    let find_portals = of_sky.as_ref().and_then(|table| table.get("find_portals"));
    let find_portals = find_portals.map_or(Ok(true), |value| value.boolean())?;
    let portals: Result<Vec<Portal>> = top
        .tables("portal", PORTAL_KEYS)?
        .iter()
        .map(|t| {
            lamp::corner_and_edges(t).map(|[corner, edge_u, edge_v]| Portal {
                corner,
                edge_u,
                edge_v,
                room: None,
            })
        })
        .collect();
    let portals = portals?;
    if !portals.is_empty() && sky.is_none() {
        warnings.push(format!("{}: [[portal]] has no use: the scene has no sky", path.display()));
    }
    let (groups, names) = lamp::read(top.tables("group", lamp::KEYS)?, folder, &mut warnings)?;
    let lights = lights::read(top.table("lights", lights::KEYS)?, names)?;
    let objects = object::read(top.tables("object", object::KEYS)?, folder, &groups, &mut warnings)?;
    if objects.is_empty() {
        return Err(top.error("expected at least one [[object]]"));
    }
    let layout = top.table("lightmap", LIGHTMAP_KEYS)?;
    let lightmap = layout.as_ref().map_or(Ok(Lightmap::default()), self::lightmap)?;
    let size_key = layout.and_then(|table| table.get("size").or_else(|| table.get("texels_per_metre")));
    let size_as_written = match size_key {
        Some(value) => format!("{}: {}", value.source_line(), value.shown()),
        None => format!("{}: no `size`, so 512", path.display()),
    };
    let bake = match top.table("bake", BAKE_KEYS)? {
        Some(table) => self::bake(&table)?,
        None => Sampling::default(),
    };
    let cameras = camera::read(top.tables("camera", camera::KEYS)?)?;
    let scene = Scene {
        name,
        description,
        location,
        sun,
        sky,
        sun_baked,
        sun_visibility,
        sky_baked,
        ground,
        ground_is_written,
        portals,
        find_portals,
        rooms: Vec::new(),
        objects,
        groups,
        lights,
        lightmap,
        size_as_written,
        bake,
        cameras,
    };
    Ok((scene, warnings))
}

/// Names that no scene may have: the folder of the datasets has folders of these names that are no dataset's.
const RESERVED: [&str; 6] = ["src", "tests", "benches", "python", "commands", "examples"];

/// Whether a scene may not have this name.
pub fn is_reserved(name: &str) -> bool {
    RESERVED.iter().any(|taken| name.eq_ignore_ascii_case(taken))
}

/// The scene's name: the folder its dataset is written to.
fn name(top: &Table, path: &Path) -> Result<String> {
    let expected = "letters, digits, _ and -, and not src, tests, benches, python, commands or examples";
    let good = |name: &str| {
        let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b == b'-';
        !name.is_empty() && name.bytes().all(plain) && !is_reserved(name)
    };
    match top.get("name") {
        Some(value) => {
            let name = value.text(expected)?;
            if good(name) { Ok(name.to_owned()) } else { Err(value.error(format!("expected {expected}"))) }
        }
        None => {
            let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("");
            if good(stem) {
                return Ok(stem.to_owned());
            }
            let what =
                format!("the file's name gives the scene's, {stem:?}: expected {expected}; set `name`");
            Err(Error::invalid(path.display(), what))
        }
    }
}

fn location(table: &Table) -> Result<Location> {
    let number = |key: &str, expected: &str, limit: f64| {
        table.require(key, expected)?.number(expected, |x| x.abs() <= limit)
    };
    let latitude = number("latitude", "degrees from -90 to 90, north positive", 90.0)?;
    let longitude = number("longitude", "degrees from -180 to 180, east positive", 180.0)?;
    let utc_offset = number("utc_offset", "hours from -14 to 14", 14.0)?;
    let expected = "degrees from -360 to 360";
    let north = table.get("north").map_or(Ok(0.0), |v| v.number(expected, |x| x.abs() <= 360.0))?;
    let expected = r#"a date "YYYY-MM-DD""#;
    let value = table.require("date", expected)?;
    let date = date(value.text(expected)?).ok_or_else(|| value.error(format!("expected {expected}")))?;
    let refraction = table.get("refraction").map_or(Ok(true), |v| v.boolean())?;
    Ok(Location { latitude, longitude, utc_offset, date, north, refraction })
}

/// A day of the Gregorian calendar.
fn date(text: &str) -> Option<(i32, u32, u32)> {
    let fields: Vec<&str> = text.split('-').collect();
    let [y, m, d] = fields[..] else { return None };
    let digits = |s: &str, n: usize| s.len() == n && s.bytes().all(|b| b.is_ascii_digit());
    if !(digits(y, 4) && digits(m, 2) && digits(d, 2)) {
        return None;
    }
    let (y, m, d): (i32, u32, u32) = (y.parse().ok()?, m.parse().ok()?, d.parse().ok()?);
    let leap = y % 4 == 0 && (y % 100 != 0 || y % 400 == 0);
    let days = match m {
        2 => 28 + u32::from(leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return None,
    };
    (y >= 1 && (1..=days).contains(&d)).then_some((y, m, d))
}

fn sun(table: &Table, has_location: bool, sky: Option<&Sky>) -> Result<Sun> {
    let expected = "degrees from 0 to 90";
    let disc_angle = table
        .get("disc_angle")
        .map_or(Ok(DISC_ANGLE), |v| v.number(expected, |x| (0.0..=90.0).contains(&x)))?;
    let track = match table.get("track") {
        Some(track) => {
            if let Some(value) = table.get("turbidity") {
                return Err(value.error("not used with `track`, which has its own irradiance"));
            }
            let expected = "a list of { hour, direction, irradiance }, not empty";
            let mut keys: Vec<SunKey> = Vec::new();
            for value in track.array(expected)? {
                keys.push(sun_key(&value.table("track".to_owned(), SUN_KEY_KEYS)?, keys.last())?);
            }
            if keys.is_empty() {
                return Err(track.error(format!("expected {expected}")));
            }
            SunTrack::Authored(keys)
        }
        None if !has_location => {
            return Err(table.error("expected a [place] to compute the sun's course from, or a `track`"));
        }
        None => {
            let of_sky = match sky {
                Some(Sky::HosekWilkie { turbidity, .. }) => *turbidity,
                _ => sky::TURBIDITY,
            };
            SunTrack::Computed { turbidity: sky::turbidity(table)?.unwrap_or(of_sky) }
        }
    };
    Ok(Sun { disc_angle, track })
}

/// Reads `visibility` of the sun, of which this much is baked.
fn visibility(table: &Table, baked: Baked) -> Result<Option<SunVisibility>> {
    let expected = r#""off", "15min" or "2.5min""#;
    let Some(value) = table.get("visibility") else { return Ok(None) };
    let visibility = match value.text(expected)? {
        "off" => SunVisibility::Off,
        "15min" => SunVisibility::Quarters,
        "2.5min" => SunVisibility::Fine,
        _ => return Err(value.error(format!("expected {expected}"))),
    };
    match (baked, visibility) {
        (Baked::None, SunVisibility::Quarters | SunVisibility::Fine) => {
            Err(value.error(r#"expected "off", or another `baked` than "none": that leaves out the sun"#))
        }
        _ => Ok(Some(visibility)),
    }
}

fn sun_key(table: &Table, before: Option<&SunKey>) -> Result<SunKey> {
    let expected = "an hour from 0 to below 24, later than the key before";
    let after = |x: f64| before.is_none_or(|k| x > k.hour);
    let value = table.require("hour", expected)?;
    let hour = value.number(expected, |x| (0.0..24.0).contains(&x) && after(x))?;
    let direction = lamp::direction(&table.require("direction", "a vector towards the sun")?)?;
    let expected = "[r, g, b] in kilolux, each 0 or more";
    let irradiance: DVec3 = table.require("irradiance", expected)?.vector(expected, super::is_light)?;
    Ok(SunKey { hour, direction, irradiance })
}

fn lightmap(table: &Table) -> Result<Lightmap> {
    let side = |x: i64| (1..=MAX_SIDE).contains(&x);
    let size = match (table.get("size"), table.get("texels_per_metre")) {
        (Some(value), Some(_)) => {
            return Err(value.error("expected either `size` or `texels_per_metre`, not both"));
        }
        (None, None) => Lightmap::default().size,
        (None, Some(value)) => LightmapSize::TexelsPerMetre(value.number("a number above 0", |x| x > 0.0)?),
        (Some(value), None) => {
            let expected = "texels from 1 to 16384, as one number or [width, height]";
            let (width, height) = if value.is_array() {
                let sides = value.array(expected)?;
                let [w, h] = &sides[..] else { return Err(value.error(format!("expected {expected}"))) };
                (w.integer(expected, side)?, h.integer(expected, side)?)
            } else {
                let side = value.integer(expected, side)?;
                (side, side)
            };
            LightmapSize::Fixed { width: width as u32, height: height as u32 }
        }
    };
    let padding = table.get("padding").map_or(Ok(i64::from(Lightmap::default().padding)), |v| {
        v.integer("texels from 0 to 64", |x| (0..=64).contains(&x))
    })?;
    let pages = table.get("pages").map_or(Ok(i64::from(Lightmap::default().pages)), |v| {
        v.integer("a number of pages from 1 to 64", |x| (1..=64).contains(&x))
    })?;
    let expected = r#""skip" or "keep""#;
    let hidden = match table.get("hidden") {
        None => Lightmap::default().hidden,
        Some(value) => match value.text(expected)? {
            "skip" => HiddenFaces::Skip,
            "keep" => HiddenFaces::Keep,
            _ => return Err(value.error(format!("expected {expected}"))),
        },
    };
    let expected = r#""auto" or "keep""#;
    let uv = match table.get("uv") {
        None => Lightmap::default().uv,
        Some(value) => match value.text(expected)? {
            "auto" => UvSource::Auto,
            "keep" if matches!(size, LightmapSize::TexelsPerMetre(_)) => {
                return Err(value.error("expected `size`, the page's size in texels, not `texels_per_metre`"));
            }
            "keep" => UvSource::Keep,
            _ => return Err(value.error(format!("expected {expected}"))),
        },
    };
    Ok(Lightmap { size, pages: pages as u32, padding: padding as u32, hidden, uv })
}

fn bake(table: &Table) -> Result<Sampling> {
    let defaults = Sampling::default();
    let samples = match table.get("samples") {
        None => defaults.samples,
        Some(value) => {
            let limits = 2..=i64::from(MAX_SAMPLES);
            let samples = value.integer("a power of two from 2 to 1048576", |x| limits.contains(&x))?;
            if samples.count_ones() != 1 {
                let below = 1i64 << samples.ilog2();
                let nearest = if samples - below <= 2 * below - samples { below } else { 2 * below };
                return Err(value.error(format!("expected a power of two, nearest is {nearest}")));
            }
            samples as u32
        }
    };
    let bounces = match table.get("bounces") {
        None => defaults.bounces,
        Some(value) => {
            let expected = r#"an integer from 0 to 1000, or "unlimited""#;
            if value.is_text() {
                if value.text(expected)? != "unlimited" {
                    return Err(value.error(format!("expected {expected}")));
                }
                None
            } else {
                Some(value.integer(expected, |x| (0..=1000).contains(&x))? as u32)
            }
        }
    };
    let seed = table
        .get("seed")
        .map(|v| v.integer("an integer, 0 or more", |x| x >= 0))
        .transpose()?
        .map_or(defaults.seed, |x| x as u64);
    let albedo_max = table.get("albedo_max").map_or(Ok(defaults.albedo_max), |v| {
        v.number("a number above 0 and at most 1, such as 0.95", |x| x > 0.0 && x <= 1.0)
    })?;
    Ok(Sampling { samples, bounces, seed, albedo_max })
}
