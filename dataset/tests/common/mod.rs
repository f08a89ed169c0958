//! Small sets and pseudo-random content for the tests.
#![allow(dead_code, reason = "each test file uses its part")]

use dataset::Result;
use dataset::config::{Config, FORMAT, Group, Instance, Map, Noise, Page, Set, VERSION};
use dataset::image::{Image, Mask};
use dataset::store::Writer;
use dataset::tiles::{TILE, tiles};
use std::path::Path;

pub mod layouts;

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

/// Writes a set of three hours with two light groups and all layers; pages of the sizes given. `seed` decides the texels.
pub fn write_set(root: &Path, sizes: &[(usize, usize)], seed: u64) -> Result<Config> {
    write_hours(root, sizes, seed, &[0.0, 12.0, 21.5])
}

/// [`write_set`] at other hours.
pub fn write_hours(root: &Path, sizes: &[(usize, usize)], seed: u64, hours: &[f64]) -> Result<Config> {
    let mut writer = Writer::create(root)?;
    let mut pages = Vec::new();
    let mut groups: Vec<Group> = [("porch", [18.0, 6.0]), ("garden", [20.0, 23.0])]
        .map(|(name, on)| Group { name: name.into(), on: vec![on], layers: vec![] })
        .into();
    let set = |&hour: &f64| {
        let groups_on = groups.iter().map(|group| group.is_on(hour) == Some(true)).collect();
        Set { hour, groups_on, relative_error: Some(0.01), maps: vec![] }
    };
    let mut sets: Vec<Set> = hours.iter().map(set).collect();
    for (page, &(width, height)) in sizes.iter().enumerate() {
        let mut mask = full_mask(width, height);
        mask.valid[0] = width * height == 1;
        let mask = writer.add(&format!("mask-{page}"), "png", &mask.to_png())?;
        pages.push(Page { width: width as u32, height: height as u32, mask });
        let lamps: Vec<Image> =
            (0..2).map(|lamp| noise_image(width, height, seed ^ (lamp + 100 * page as u64))).collect();
        for (group, lamp) in groups.iter_mut().zip(&lamps) {
            group.layers.push(writer.add(&format!("{}-{page}", group.name), "exr", &lamp.to_exr())?);
        }
        for set in &mut sets {
            // The sun shines at noon only; the sky is black at midnight.
            let black = Image::black(width, height);
            let sun = (set.hour == 12.0).then(|| noise_image(width, height, seed ^ 0xabc));
            let sky =
                (set.hour != 0.0).then(|| noise_image(width, height, seed ^ 0xdef ^ set.hour.to_bits()));
            let local = lamps
                .iter()
                .zip(&set.groups_on)
                .filter(|(_, on)| **on)
                .fold(black.clone(), |sum, (lamp, _)| plus(&sum, lamp));
            let whole = plus(&plus(sun.as_ref().unwrap_or(&black), sky.as_ref().unwrap_or(&black)), &local);
            let mut add = |stem: &str, image: &Image| {
                writer.add(&format!("{stem}-{}-{page}", set.hour), "exr", &image.to_exr())
            };
            let file = add("set", &whole)?;
            let sun = sun.map(|image| add("sun", &image)).transpose()?;
            let sky = sky.map(|image| add("sky", &image)).transpose()?;
            set.maps.push(Map { file, sun, sky, local: None });
        }
    }
    let mse = sets.iter().map(|_| {
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
        groups,
        sets,
        noise: Some(noise),
        geometry: Some(geometry),
        settings: serde_json::json!({"b": 1, "a": [2.5]}),
        source: None,
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
