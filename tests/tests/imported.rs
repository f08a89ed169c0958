//! A set that others made: raw files of two lightmaps → dataset → bundle → light, at uneven hours.

use compressor::compress::{Options, compress};
use compressor::decode::Decoder;
use compressor::evaluate::{Measures, evaluate};
use dataset::exchange::{Origin, import};
use dataset::image::Mask;
use dataset::layout::hprc2::Hprc2;
use dataset::observe::Silent;
use dataset::store::Dataset;
use std::fs;
use std::path::Path;

/// Time keys of the layout: uneven hours, both sides of the lamps' switches.
const KEYS: [u32; 8] = [0, 400, 590, 600, 1150, 1800, 1810, 2200];
/// Width and height of the lightmaps: more than a tile across, and less than one by more than two down.
const SIZES: [(usize, usize); 2] = [(150, 60), (40, 260)];

/// Light of a lightmap at a time: daylight from the left, a lamp in the middle at night.
fn light(lightmap: usize, key: u32, x: usize, y: usize) -> [f32; 3] {
    let hour = key as f32 / 100.0;
    let (width, height) = SIZES[lightmap];
    let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
    let day = (1.0 - ((hour - 12.0) / 6.5).powi(2)).max(0.0) * (1.0 - 0.5 * u) * (1.0 + lightmap as f32);
    let is_on = !(6.0..=18.0).contains(&hour);
    let lamp = if is_on { 2.0 / (1.0 + 10.0 * ((u - 0.5).powi(2) + (v - 0.5).powi(2))) } else { 0.0 };
    [day + lamp + 0.1, day + 0.6 * lamp + 0.1, 1.4 * day + 0.2 * lamp + 0.2]
}

fn is_valid(x: usize, y: usize) -> bool {
    !(x + y).is_multiple_of(41)
}

/// Writes the set in layout 2.
fn write(root: &Path) {
    fs::create_dir_all(root.join("Data")).unwrap();
    let mut list = Vec::new();
    for (id, &(width, height)) in SIZES.iter().enumerate() {
        let texels = || (0..width * height).map(move |i| (i % width, i / width));
        let mask: Vec<u8> = texels().map(|(x, y)| if is_valid(x, y) { 127 } else { 255 }).collect();
        fs::write(root.join(format!("Data/mask_{id}.bin_0")), mask).unwrap();
        let mut names = serde_json::json!({ "lightmaps": {}, "masks": {} });
        for key in KEYS {
            let values = texels().flat_map(|(x, y)| light(id, key, x, y)).flat_map(f32::to_le_bytes);
            let name = format!("light_{id}_{key}.bin_0");
            fs::write(root.join("Data").join(&name), values.collect::<Vec<u8>>()).unwrap();
            names["lightmaps"][key.to_string()] = name.into();
            names["masks"][key.to_string()] = format!("mask_{id}.bin_0").into();
        }
        list.push(serde_json::json!({
            "id": id, "level": "test", "resolution": { "width": width, "height": height },
            "lightmaps": names["lightmaps"], "masks": names["masks"],
        }));
    }
    let config = serde_json::json!({ "lightmap_count": 2, "lightmap_list": list });
    fs::write(root.join("config.json"), config.to_string()).unwrap();
}

/// Root of the mean squared difference of valid texels, over that of the reference.
fn error(
    image: &compressor::decode::Image,
    mask: &Mask,
    reference: impl Fn(usize, usize) -> [f32; 3],
) -> f64 {
    let (mut difference, mut size) = (0.0, 0.0);
    for (i, texel) in image.texels.iter().enumerate().filter(|(i, _)| mask.valid[*i]) {
        let expected = reference(i % image.width, i / image.width);
        for c in 0..3 {
            difference += f64::from(texel[c] - expected[c]).powi(2);
            size += f64::from(expected[c]).powi(2);
        }
    }
    (difference / size).sqrt()
}

#[test]
fn lightmaps_of_others_are_compressed_like_our_own() {
    let folder = tempfile::tempdir().unwrap();
    let [source, root] = ["contest", "set"].map(|name| folder.path().join(name));
    write(&source);
    import(&Origin::Folder(&Hprc2, source), &root, &Silent).unwrap();
    let dataset = Dataset::open(&root).unwrap();
    let checked = dataset.verify(|| {});
    assert!(checked.faults.is_empty() && checked.warnings.is_empty(), "{checked:?}");

    let options = Options { iterations: 600, ..Options::default() };
    let outcome = compress(&root, &options, &Silent).unwrap();
    assert_eq!(outcome.bundle, root.join("set.ndgi"));
    let decoder = Decoder::open(&outcome.bundle).unwrap();
    let header = &decoder.bundle().header;
    let sizes: Vec<_> = header.pages.iter().map(|page| (page.width, page.height)).collect();
    assert_eq!((sizes, &*header.groups), (SIZES.to_vec(), &["local".to_owned()][..]));
    assert_eq!(header.timeline.hours, KEYS.map(|key| f64::from(key) / 100.0));

    for page in 0..2 {
        let mask = dataset.mask(page).unwrap();
        let decode = |hour: f64| decoder.decode_page(page, hour).unwrap();
        for key in KEYS {
            let found = error(&decode(f64::from(key) / 100.0), &mask, |x, y| light(page, key, x, y));
            assert!(found < 0.05, "page {page}, key {key}: {found}");
        }
        // The lamp jumps at 18 h and at 6 h, and does not fade towards the sets beside.
        for (hour, held) in [(18.02, 18.1), (18.08, 18.1), (5.92, 5.9), (5.98, 5.9)] {
            assert_eq!(decode(hour), decode(held), "page {page}, {hour} h");
        }
        let before = error(&decode(17.99), &mask, |x, y| light(page, 1800, x, y));
        let lit = error(&decode(18.1), &mask, |x, y| light(page, 1800, x, y));
        assert!(before < 0.1 && lit > 0.3, "page {page}: {before}, {lit}");
    }

    // Judged like a baked set: all tiles of both sizes, at every hour.
    let evaluation = evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap();
    let tiles = |page: usize| evaluation.samples.iter().filter(|sample| sample.page == page).count();
    assert_eq!([tiles(0), tiles(1)], [2 * KEYS.len(), 3 * KEYS.len()]);
}
