//! Small datasets and pseudo-random content for the tests.
#![allow(dead_code, reason = "each test file uses its part")]

use dataset::Result;
use dataset::format::tiles::{TILE, tiles};
use dataset::format::{
    Baked, Config, Daylight, FORMAT, Frame, Group, Instance, Layer, Light, Noise, Page, Part, VERSION,
};
use dataset::image::{Image, Mask};
use dataset::store::Writer;
use std::path::Path;
use std::process::Command;

pub mod layouts;

/// A Python that has numpy and OpenEXR: that of `NDGI_PYTHON`, which must work, or else `python3`; `None` if
/// that lacks them.
pub fn python() -> Option<String> {
    let named = std::env::var("NDGI_PYTHON").ok();
    let python = named.clone().unwrap_or("python3".to_owned());
    let imports = Command::new(&python).args(["-c", "import numpy, OpenEXR"]).output();
    let works = imports.is_ok_and(|output| output.status.success());
    assert!(works || named.is_none(), "NDGI_PYTHON={python} does not run, or lacks numpy or OpenEXR");
    if !works {
        eprintln!("skipped: there is no python3 with numpy and OpenEXR");
    }
    works.then_some(python)
}

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }
}

pub fn noise_image(width: usize, height: usize, seed: u64) -> Image {
    let mut random = Random(seed);
    let texels = (0..width * height).map(|_| std::array::from_fn(|_| random.unit())).collect();
    Image { width, height, texels }
}

pub fn full_mask(width: usize, height: usize) -> Mask {
    Mask { width, height, valid: vec![true; width * height] }
}

fn plus(a: &Image, b: &Image) -> Image {
    let sum = a.texels.iter().zip(&b.texels).map(|(a, b)| std::array::from_fn(|c| a[c] + b[c]));
    Image { texels: sum.collect(), ..*a }
}

/// Writes a dataset of three hours with two light groups and all layers; pages of the sizes given. `seed`
/// decides the texels.
pub fn write_set(root: &Path, sizes: &[(usize, usize)], seed: u64) -> Result<Config> {
    write_hours(root, sizes, seed, &[0.0, 12.0, 21.5])
}

/// What the layers of the lights hold in [`write_hours`]: the sun shines at noon only, the sky is black at
/// midnight, surfaces reflect nothing of the porch.
pub fn share(
    (light, group, part): (Light, u32, Part),
    hour: f64,
    page: usize,
    (width, height): (usize, usize),
    seed: u64,
) -> Option<Image> {
    let noise = |salt: u64| Some(noise_image(width, height, seed ^ salt));
    let page = 100 * page as u64;
    match (light, part) {
        (Light::Sun, Part::Direct) if hour == 12.0 => noise(0xabc),
        (Light::Sun, Part::Indirect) if hour == 12.0 => noise(0xbca),
        (Light::Sky, Part::All) if hour != 0.0 => noise(0xdef ^ hour.to_bits()),
        (Light::Group, Part::Direct) => noise(u64::from(group) + page),
        (Light::Group, Part::Indirect) if group == 1 => noise(7 + page),
        _ => None,
    }
}

/// [`write_set`] at other hours.
pub fn write_hours(root: &Path, sizes: &[(usize, usize)], seed: u64, hours: &[f64]) -> Result<Config> {
    let mut writer = Writer::create(root)?;
    let mut pages = Vec::new();
    let groups: Vec<Group> = [("porch", [18.0, 6.0]), ("garden", [20.0, 23.0])]
        .map(|(name, on)| Group { name: name.into(), on: vec![on], baked: Baked::All })
        .into();
    let frame = |&hour: &f64| {
        let groups_on = groups.iter().map(|group| group.is_on(hour) == Some(true)).collect();
        Frame { hour, groups_on, relative_error: Some(0.01), maps: vec![] }
    };
    let mut frames: Vec<Frame> = hours.iter().map(frame).collect();
    let lights = [
        (Light::Sun, 0, Part::Direct),
        (Light::Sun, 0, Part::Indirect),
        (Light::Sky, 0, Part::All),
        (Light::Group, 0, Part::Direct),
        (Light::Group, 0, Part::Indirect),
        (Light::Group, 1, Part::Direct),
        (Light::Group, 1, Part::Indirect),
    ];
    let mut layers = lights.map(|(light, group, part)| {
        let is_group = light == Light::Group;
        let files = vec![vec![]; if is_group { 1 } else { hours.len() }];
        Layer { light, group: is_group.then_some(group), part, files, curve: None }
    });
    for (page, &(width, height)) in sizes.iter().enumerate() {
        let mut mask = full_mask(width, height);
        mask.valid[0] = width * height == 1;
        let mask = writer.add(&format!("mask-{page}"), "png", &mask.to_png())?;
        pages.push(Page::atlas(width as u32, height as u32, mask));
        for (layer, light) in layers.iter_mut().zip(lights) {
            for (row, hour) in layer.files.iter_mut().zip(hours) {
                let stem = format!("{}{}-{}-{hour}-{page}", light.0.name(), light.1, light.2.name());
                let image = share(light, *hour, page, (width, height), seed);
                row.push(image.map(|image| writer.add(&stem, "exr", &image.to_exr())).transpose()?);
            }
        }
        for frame in &mut frames {
            let black = Image::black(width, height);
            let of = |light: usize| {
                let image = share(lights[light], frame.hour, page, (width, height), seed);
                image.unwrap_or(black.clone())
            };
            let lit = (0..2).filter(|&group| frame.groups_on[group]);
            let local = lit.map(|group| plus(&of(3 + 2 * group), &of(4 + 2 * group)));
            let local = local.fold(black.clone(), |sum, lamp| plus(&sum, &lamp));
            let whole = plus(&plus(&plus(&of(0), &of(1)), &of(2)), &local);
            let stem = format!("frame-{}-{page}", frame.hour);
            frame.maps.push(writer.add(&stem, "exr", &whole.to_exr())?);
        }
    }
    let mse = frames.iter().map(|_| {
        let page =
            |&(width, height): &(usize, usize)| tiles(width, height, TILE).iter().map(|_| 1e-6).collect();
        sizes.iter().map(page).collect()
    });
    let noise = Noise { tile: TILE as u32, mse: mse.collect() };
    let noise = writer.add("noise", "json", &serde_json::to_vec(&noise).unwrap())?;
    let geometry = writer.add("scene", "glb", &empty_glb())?;
    writer.alias(&geometry, "scene.glb");
    let config = Config {
        format: FORMAT.into(),
        version: VERSION,
        instances: vec![Instance { name: "crate".into(), page: 0, scale: [0.5, 0.25], offset: [0.0, 0.75] }],
        scene: "test".into(),
        generator: "test 1".into(),
        unit: "kilolux".into(),
        seed,
        inputs: "none".into(),
        samples: 1,
        pages,
        sun: Some(Daylight { baked: Baked::All }),
        sky: Some(Daylight { baked: Baked::All }),
        groups,
        layers: layers.into(),
        frames,
        noise: Some(noise),
        geometry: Some(geometry),
        settings: serde_json::json!({"b": 1, "a": [2.5]}),
        source: None,
        sun_path: None,
        visibility: None,
        transfer: None,
    };
    writer.commit(&config)?;
    Ok(config)
}

/// A geometry file without geometry.
pub fn empty_glb() -> Vec<u8> {
    let json = b"{\"asset\":{\"version\":\"2.0\"}} ";
    let word = |n: usize| (n as u32).to_le_bytes();
    let header = [word(2), word(20 + json.len()), word(json.len())].concat();
    [&b"glTF"[..], &header, b"JSON", json].concat()
}
