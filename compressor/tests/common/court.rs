//! The dataset `court`, whose sun is apart: with layers, curves, the sun's path and its visibility.

use dataset::format::Curve;
use dataset::format::tiles::{TILE, tiles};
use dataset::format::{
    Baked, Config, Daylight, FORMAT, Frame, Group, Layer, Light, Normals, Page, Part, Planes, SunPath,
    SunVisibility, VERSION, visibility,
};
use dataset::image::{Image, Mask};
use dataset::store::Writer;
use std::path::Path;

/// Dark, sunrise within the minute of the lamp's switch, day, dusk.
pub const HOURS: [f64; 8] = [0.0, 5.9, 6.1, 9.0, 12.0, 15.0, 18.1, 21.0];
pub const SIZE: [usize; 2] = [150, 70];

pub fn path() -> SunPath {
    let hours: Vec<f64> = (0..=1440).map(|minute| f64::from(minute) / 60.0).collect();
    let up = |hour: f64| ((hour - 6.0) / 13.0 * std::f64::consts::PI).sin();
    let is_day = |hour: f64| (6.0..=19.0).contains(&hour);
    let direction = |&hour: &f64| {
        let y = up(hour).clamp(-1.0, 1.0);
        [
            ((1.0 - y * y).sqrt() * if hour < 12.5 { 0.8 } else { -0.8 }) as f32,
            y as f32,
            (0.6 * (1.0 - y * y).sqrt()) as f32,
        ]
    };
    let light = |&hour: &f64| {
        if is_day(hour) { [100.0, 90.0, 70.0].map(|e| e * up(hour).max(0.0).sqrt() as f32) } else { [0.0; 3] }
    };
    SunPath {
        direction: hours.iter().map(direction).collect(),
        irradiance: hours.iter().map(light).collect(),
        hours,
    }
}

/// Ground to the left, a wall that faces east to the right of a column.
pub fn normal(x: usize, y: usize) -> [f32; 3] {
    match x {
        0..70 => [0.0, 1.0, 0.0],
        70..90 => {
            let angle = (x - 70) as f32 / 20.0 + y as f32 / 200.0;
            [angle.sin(), angle.cos(), 0.0]
        }
        _ => [1.0, 0.0, 0.0],
    }
}

/// What a texel sees of the sun, by its place and the hour.
pub type Seen = fn(usize, usize, f64) -> [f32; 3];

/// A soft shadow that moves.
pub fn moving(x: usize, y: usize, hour: f64) -> [f32; 3] {
    let edge = 12.0 * (hour - 6.0) + 0.3 * y as f64;
    [((x as f64 - edge).abs() / 3.0 - 3.0).clamp(0.0, 1.0) as f32; 3]
}

/// The same, with red glass before the right end.
pub fn behind_glass(x: usize, y: usize, hour: f64) -> [f32; 3] {
    let [grey, ..] = moving(x, y, hour);
    if x > 120 { [grey, 0.5 * grey, 0.1 * grey] } else { [grey; 3] }
}

pub fn sum(a: &Image, b: &Image) -> Image {
    let texels = a.texels.iter().zip(&b.texels).map(|(a, b)| [0, 1, 2].map(|c| a[c] + b[c])).collect();
    Image { width: a.width, height: a.height, texels }
}

pub fn image_of(light: impl Fn(usize, usize) -> [f32; 3]) -> Image {
    let [width, height] = SIZE;
    Image { width, height, texels: (0..width * height).map(|i| light(i % width, i / width)).collect() }
}

pub fn direct(hour: f64, seen: Seen) -> Image {
    let path = path();
    image_of(|x, y| path.light(hour, normal(x, y), seen(x, y, hour)))
}

/// By the sky's light at an hour: it falls by a thousand in an hour of dusk.
pub fn sky(hour: f64) -> f32 {
    let day = 10f64.powf((4.0 * (1.0 - ((hour - 12.5) / 7.5).powi(2))).clamp(-4.0, 1.0));
    day as f32
}

/// Writes the dataset `court`, the sun seen as told.
pub fn write(root: &Path, seen: Seen) {
    let [width, height] = SIZE;
    let mut writer = Writer::create(root).unwrap();
    let mask = Mask {
        width,
        height,
        valid: (0..width * height).map(|i| i % width % 75 > 1 && i / width > 2).collect(),
    };
    let mask = writer.add("mask", "png", &mask.to_png()).unwrap();
    let curve = Curve {
        hours: (0..=240).map(|i| f64::from(i) / 10.0).collect(),
        values: (0..=240).map(|i| [sky(f64::from(i) / 10.0); 3]).collect(),
    };
    let curve = writer.add("curve", "json", &curve.to_json()).unwrap();
    let is_on = |hour: f64| !(6.0..=18.0).contains(&hour);
    let of_sky = |hour: f64| {
        image_of(|x, y| [sky(hour) * (1.0 + 0.3 * (x as f32 / 40.0).sin() + y as f32 / 100.0); 3])
    };
    let lamp = image_of(|x, y| {
        let far = (x as f32 - 40.0).powi(2) + (y as f32 - 30.0).powi(2);
        [1.0, 0.6, 0.2].map(|c| c * 3.0 / (1.0 + far / 200.0))
    });
    let (mut frames, mut of_sun, mut of_skies) = (Vec::new(), Vec::new(), Vec::new());
    for hour in HOURS {
        let (direct, sky) = (direct(hour, seen), of_sky(hour));
        let whole = sum(&direct, &sky);
        let local = if is_on(hour) { lamp.clone() } else { Image::black(width, height) };
        let map = writer.add(&format!("map-{hour}"), "exr", &sum(&whole, &local).to_exr()).unwrap();
        let is_black = direct.texels.iter().all(|texel| *texel == [0.0; 3]);
        let mut add = |name: &str, image: &Image| {
            Some(writer.add(&format!("{name}-{hour}"), "exr", &image.to_exr()).unwrap())
        };
        of_sun.push(vec![if is_black { None } else { add("sun", &direct) }]);
        of_skies.push(vec![add("sky", &sky)]);
        frames.push(Frame { hour, groups_on: vec![is_on(hour)], relative_error: None, maps: vec![map] });
    }
    let lamp = writer.add("lamp", "exr", &lamp.to_exr()).unwrap();
    let times: Vec<f64> = (0..=96).map(|i| f64::from(i) / 4.0).collect();
    let payloads = tiles(width, height, TILE)
        .iter()
        .map(|rect| {
            let grey = |&(x, y): &(usize, usize)| {
                times.iter().map(|&hour| seen(x, y, hour)).all(|[r, g, b]| r == g && g == b)
            };
            let places: Vec<(usize, usize)> =
                (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))).collect();
            let channels = if places.iter().all(grey) { 1 } else { 3 };
            let mut levels = Vec::new();
            for c in 0..channels {
                for &hour in &times {
                    levels.extend(places.iter().map(|&(x, y)| (64.0 * seen(x, y, hour)[c]).round() as u8));
                }
            }
            Planes { texels: places.len(), channels, levels }.to_payload()
        })
        .collect::<Vec<_>>();
    let files = vec![
        writer
            .add(
                "visibility",
                "vis",
                &visibility::to_bytes([width as u32, height as u32], 64, &times, &payloads),
            )
            .unwrap(),
    ];
    let normals = Normals {
        width,
        height,
        normals: (0..width * height).map(|i| normal(i % width, i / width)).collect(),
    };
    let normals = vec![writer.add("normals", "png", &normals.to_png()).unwrap()];
    let layer = |light: Light, part: Part, files, curve| Layer { light, group: None, part, files, curve };
    let layers = vec![
        layer(Light::Sun, Part::Direct, of_sun, None),
        layer(Light::Sun, Part::Indirect, vec![vec![None]; HOURS.len()], None),
        layer(Light::Sky, Part::All, of_skies, Some(curve)),
        Layer {
            light: Light::Group,
            group: Some(0),
            part: Part::All,
            files: vec![vec![Some(lamp)]],
            curve: None,
        },
    ];
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        instances: Vec::new(),
        scene: "court".to_owned(),
        generator: "test".to_owned(),
        unit: "irradiance in kilolux".to_owned(),
        seed: 1,
        inputs: "0".repeat(64),
        samples: 1,
        pages: vec![Page::atlas(width as u32, height as u32, mask)],
        sun: Some(Daylight { baked: Baked::All }),
        sky: Some(Daylight { baked: Baked::All }),
        groups: vec![Group { name: "lamp".to_owned(), on: vec![[18.0, 6.0]], baked: Baked::All }],
        layers,
        frames,
        noise: None,
        geometry: None,
        settings: serde_json::json!({}),
        source: None,
        sun_path: Some(writer.add("sun-path", "json", &path().to_json()).unwrap()),
        visibility: Some(SunVisibility { minutes: 15.0, files, normals }),
        transfer: None,
    };
    writer.commit(&config).unwrap();
}
