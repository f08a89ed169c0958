//! Sets in the layouts of others, written by hand.

use super::Random;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Every file below a folder with its content.
pub fn content(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(root).unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap();
        match entry.path().is_dir() {
            true => files.extend(content(&entry.path()).into_iter().map(|(n, b)| (format!("{name}/{n}"), b))),
            false => drop(files.insert(name, fs::read(entry.path()).unwrap())),
        }
    }
    files
}

pub fn light_bytes(texels: &[[f32; 3]]) -> Vec<u8> {
    texels.iter().flatten().flat_map(|value| value.to_le_bytes()).collect()
}

/// A lightmap of [`write2`]: its light by ascending hour.
pub struct Lightmap {
    pub id: i64,
    pub width: usize,
    pub height: usize,
    pub valid: Vec<bool>,
    pub light: Vec<Vec<[f32; 3]>>,
}

/// Time keys of [`write2`], not in order.
pub const KEYS: [&str; 7] = ["590", "0", "600", "750", "1810", "2300", "1800"];

/// Writes two lightmaps in layout 2, with values at the edges of float32; the configuration is nobody's usual
/// format.
pub fn write2(root: &Path) -> Vec<Lightmap> {
    fs::create_dir_all(root.join("Data")).unwrap();
    let mut entries = Vec::new();
    let mut lightmaps = Vec::new();
    for (id, (width, height), level) in [(4, (9, 6), "Level_A"), (-1, (130, 3), "Level \u{e9}")] {
        let mut random = Random(id as u64);
        let valid: Vec<bool> = (0..width * height).map(|i| i % 5 != 2).collect();
        let mut keys = KEYS.map(|key| (key.parse::<u32>().unwrap(), key));
        keys.sort_unstable();
        let edges = [0.0, -0.0, f32::from_bits(1), f32::MAX, f32::MIN_POSITIVE, 1.0 / 3.0];
        let light = keys.map(|_| {
            let value = |random: &mut Random| match random.below(3) {
                0 => edges[random.below(edges.len())],
                _ => random.unit(),
            };
            (0..width * height)
                .map(|_| std::array::from_fn(|_| value(&mut random)))
                .collect::<Vec<[f32; 3]>>()
        });
        for ((_, key), texels) in keys.iter().zip(&light) {
            fs::write(root.join(format!("Data/raw_{id}_{key}.bin_0")), light_bytes(texels)).unwrap();
        }
        let mask: Vec<u8> = valid.iter().map(|&valid| if valid { 127 } else { 255 }).collect();
        let mut names = [Vec::new(), Vec::new()];
        for key in KEYS {
            fs::write(root.join(format!("Data/mask_{id}_{key}.bin_0")), &mask).unwrap();
            names[0].push(format!("\"{key}\" : \"raw_{id}_{key}.bin_0\""));
            names[1].push(format!("\"{key}\" : \"mask_{id}_{key}.bin_0\""));
        }
        let [raw, masks] = names.map(|names| names.join(",\n "));
        entries.push(format!(
            "{{\"level\": {level:?}, \"id\": {id},\n\t\"masks\": {{{masks}}}, \"lightmaps\": {{{raw}}},\n\
             \"resolution\": {{\"height\": {height}, \"width\": {width}}}}}"
        ));
        lightmaps.push(Lightmap { id, width, height, valid, light: light.into() });
    }
    let config = format!("{{ \"lightmap_list\": [{}],\r\n \"lightmap_count\":2 }}", entries.join(" , "));
    fs::write(root.join("config.json"), config).unwrap();
    lightmaps
}

/// Gives the light of a lightmap's folder at a time, this many texels.
pub type Light1 = fn(i64, &str, u32, usize) -> Vec<[f32; 3]>;

/// Writes lightmaps in layout 1: id, size, parts. The first texel of each is not valid.
pub fn write1(root: &Path, lightmaps: &[(i64, (usize, usize), usize)], with_shares: bool) -> Light1 {
    let light: Light1 = |id, folder, time, texels| {
        let one = |kind: u64, i: usize| -> [f32; 3] {
            let mut random = Random(1000 * id as u64 + 10 * u64::from(time) + kind + ((i as u64) << 32));
            std::array::from_fn(|_| random.unit())
        };
        let texel = |i: usize| {
            let (sun, sky, local) = (one(1, i), one(2, i), one(3, i));
            match folder {
                "DirectionalOnly" => sun,
                "SkyLightOnly" => sky,
                "LocalOnly" => local,
                _ => std::array::from_fn(|c| (sun[c] + sky[c]) + local[c]),
            }
        };
        (0..texels).map(texel).collect()
    };
    let mut entries = Vec::new();
    for &(id, (width, height), parts) in lightmaps {
        let write = |folder: &str, kind: &str, time: u32, bytes: Vec<u8>| {
            fs::create_dir_all(root.join(folder)).unwrap();
            for (part, bytes) in bytes.chunks(bytes.len() / parts).enumerate() {
                let name =
                    format!("{kind}_Dilate_VirtualTexture0_{id}_HQ_{width}_{height}_{time}.00.bin_{part}");
                fs::write(root.join(folder).join(name), bytes).unwrap();
            }
        };
        for time in 1..=24 {
            let folders = ["Original", "DirectionalOnly", "SkyLightOnly", "LocalOnly"];
            for folder in &folders[..if with_shares { 4 } else { 1 }] {
                let bytes = light_bytes(&light(id, folder, time, width * height));
                write(folder, "lightmapRawData", time, bytes);
            }
        }
        let mut mask = vec![127; width * height];
        mask[0] = 255;
        write("Mask", "lightmapCoverage", 1, mask);
        entries.push(format!(
            "{{\"id\":{id},\"resolution\":{{\"width\":{width},\"height\":{height}}},\"parts\":{parts}}}"
        ));
    }
    let list = entries.join(",");
    let config = format!("{{\"lightmap_count\":{},\"lightmap_list\":[{list}]}}", lightmaps.len());
    fs::write(root.join("config.json"), config).unwrap();
    light
}
