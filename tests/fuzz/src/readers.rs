//! One function per reader: it must not panic on any bytes, nor take more memory than they account for; what
//! it accepts must keep the rules. Used by libFuzzer and by the ordinary test `mutations`.

use baker::scene::{Profile, read_radiance};
use baker::{geometry, scene as scenes};
use compressor::bundle::{Bundle, checksum};
use compressor::decode::Decoder;
use dataset::exchange::{Origin, import};
use dataset::format::{Curve, Normals, SunPath, Visibility};
use dataset::image::{Image, Mask, read_exr_rows};
use dataset::layout::hprc1::Hprc1;
use dataset::layout::hprc2::Hprc2;
use dataset::observe::Silent;
use dataset::release::{MANIFEST, SUMS, verify};
use dataset::store::{Dataset, parse_config};
use std::fs;
use std::path::Path;

/// A reader's function: a folder for its files, and the bytes to be read; whether they are accepted.
pub type Target = fn(&Path, &[u8]) -> bool;

/// All of them, by the names of their corpora.
pub const TARGETS: [(&str, Target); 15] = [
    ("config", config),
    ("exr", exr),
    ("mask", mask),
    ("table", table),
    ("hprc1", hprc1),
    ("hprc2", hprc2),
    ("bundle", bundle),
    ("archive", archive),
    ("scene", scene),
    ("ies", ies),
    ("radiance", radiance),
    ("visibility", visibility),
    ("normals", normals),
    ("sun", sun),
    ("curve", curve),
];

/// `config.json`.
pub fn config(_: &Path, bytes: &[u8]) -> bool {
    let Ok((config, faults)) = parse_config(Path::new("config.json"), bytes) else { return false };
    let again = serde_json::to_vec(&config).expect("a manifest can be written");
    let (_, again) = parse_config(Path::new("config.json"), &again).expect("and read again");
    assert_eq!(faults.len(), again.len());
    faults.is_empty()
}

/// An EXR file as a dataset has it, and as others have it, with any channels, as light and as its own mask.
pub fn exr(scratch: &Path, bytes: &[u8]) -> bool {
    let folder = scratch.join("exr");
    fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join("light_12.exr");
    fs::write(&path, bytes).expect("a file");
    if let Ok(image) = Image::read_exr(&path) {
        let half = image.height / 2;
        let rows = read_exr_rows(&path, half, image.height).expect("rows of a whole image");
        assert!(rows == image.texels[half * image.width..]);
    }
    let import = |mask| {
        let pattern = "light_{hour}.exr".to_owned();
        imported(scratch, &Origin::Pattern { folder: folder.clone(), pattern, mask, layer: None })
    };
    import(None) | import(Some(path.clone()))
}

/// A mask.
pub fn mask(scratch: &Path, bytes: &[u8]) -> bool {
    let path = scratch.join("mask.png");
    fs::write(&path, bytes).expect("a file");
    let Ok(mask) = Mask::read_png(&path) else { return false };
    fs::write(&path, mask.to_png()).expect("a file");
    assert!(Mask::read_png(&path).expect("a mask") == mask);
    true
}

/// A table of EXR files; there is one that it may name, and a mask.
pub fn table(scratch: &Path, bytes: &[u8]) -> bool {
    let folder = scratch.join("table");
    fs::create_dir_all(&folder).expect("a folder");
    let image = Image::black(3, 2);
    fs::write(folder.join("a.exr"), image.to_exr()).expect("a file");
    fs::write(folder.join("m.png"), Mask { width: 3, height: 2, valid: vec![true; 6] }.to_png())
        .expect("a file");
    fs::write(folder.join("table.toml"), bytes).expect("a file");
    imported(scratch, &Origin::Table(folder.join("table.toml")))
}

/// The layout `hprc1`: its configuration, a zero byte, the mask of 4×2 texels, their light at all hours; of
/// four times as many bytes, the light and its three shares.
pub fn hprc1(scratch: &Path, bytes: &[u8]) -> bool {
    const KINDS: [&str; 4] = ["Original", "DirectionalOnly", "SkyLightOnly", "LocalOnly"];
    let folder = scratch.join("hprc1");
    let name = |kind: &str, time: u32| format!("{kind}_Dilate_VirtualTexture0_0_HQ_4_2_{time}.00.bin_0");
    let (config, mask, light) = parts(bytes);
    // Nothing of the input before.
    drop(fs::remove_dir_all(&folder));
    fs::create_dir_all(folder.join("Mask")).expect("a folder");
    fs::write(folder.join("config.json"), config).expect("a file");
    fs::write(folder.join("Mask").join(name("lightmapCoverage", 1)), mask).expect("a file");
    let shares = if light.len() > 8 * 12 { KINDS.len() } else { 1 };
    for (light, kind) in light.chunks_exact((light.len() / shares).max(1)).zip(KINDS) {
        let folder = folder.join(kind);
        fs::create_dir_all(&folder).expect("a folder");
        for time in 1..=24 {
            fs::write(folder.join(name("lightmapRawData", time)), light).expect("a file");
        }
    }
    imported(scratch, &Origin::Folder(&Hprc1, folder))
}

/// The layout `hprc2`: its configuration, a zero byte, the content of `Data/m` (8 bytes), the content of
/// `Data/l`.
pub fn hprc2(scratch: &Path, bytes: &[u8]) -> bool {
    let folder = scratch.join("hprc2");
    let (config, mask, light) = parts(bytes);
    fs::create_dir_all(folder.join("Data")).expect("a folder");
    fs::write(folder.join("config.json"), config).expect("a file");
    fs::write(folder.join("Data/m"), mask).expect("a file");
    fs::write(folder.join("Data/l"), light).expect("a file");
    imported(scratch, &Origin::Folder(&Hprc2, folder))
}

/// A bundle, as it is and with its checksums mended: else most changes would end at them.
pub fn bundle(_: &Path, bytes: &[u8]) -> bool {
    let mut mended = bytes.to_vec();
    mend(&mut mended);
    decode(bytes.to_vec()) | decode(mended)
}

/// A release: its manifest, a zero byte, the archive, unpacked; and once more the archive as it is.
pub fn archive(scratch: &Path, bytes: &[u8]) -> bool {
    let folder = scratch.join("release");
    fs::create_dir_all(&folder).expect("a folder");
    let (manifest, tar) = split(bytes);
    fs::write(folder.join(MANIFEST), manifest).expect("a file");
    let sums = [MANIFEST, "hut-sets.tar.zst"].map(|name| format!("{}  {name}\n", "0".repeat(64)));
    fs::write(folder.join(SUMS), sums.concat()).expect("a file");
    let verified = |packed: &[u8]| {
        fs::write(folder.join("hut-sets.tar.zst"), packed).expect("a file");
        let verified = verify(&folder, &Silent).expect("a folder that can be read");
        assert_eq!(fs::read_dir(&folder).expect("a folder").count(), 3);
        // The checksums are wrong in any case.
        assert!(!verified.faults.is_empty());
        verified.faults.iter().all(|fault| fault.to_string().contains("SHA-256"))
    };
    verified(tar) | verified(&zstd::encode_all(tar, 1).expect("packed"))
}

/// A scene: its file, a zero byte, `model.mtl`, a zero byte, and a model, which is there as OBJ, glTF and
/// GLB.
pub fn scene(scratch: &Path, bytes: &[u8]) -> bool {
    let folder = scratch.join("scene");
    fs::create_dir_all(&folder).expect("a folder");
    let (file, rest) = split(bytes);
    let (materials, model) = split(rest);
    for (name, bytes) in [
        ("scene.toml", file),
        ("model.mtl", materials),
        ("model.obj", model),
        ("model.gltf", model),
        ("model.glb", model),
    ] {
        fs::write(folder.join(name), bytes).expect("a file");
    }
    let Ok((scene, _)) = scenes::load(&folder.join("scene.toml")) else { return false };
    let Ok((geometry, _)) = geometry::load(&scene) else { return false };
    assert!(geometry.positions.iter().all(|at| at.is_finite()) && geometry.origin.is_finite());
    assert!(geometry.normals.iter().all(|normal| normal.is_finite()));
    assert!(geometry.triangles.iter().flatten().all(|&vertex| (vertex as usize) < geometry.positions.len()));
    assert_eq!(geometry.triangles.len(), geometry.material_of.len());
    let mut scene = scene;
    geometry.lights.add_to(&mut scene);
    let emissions = geometry.materials.iter().filter_map(|material| material.emission);
    assert!(emissions.into_iter().all(|emission| emission.radiance.is_finite()
        && (emission.group as usize) < scene.groups.len()
        && emission.map.is_none_or(|map| (map as usize) < geometry.emission_maps.len())));
    assert!(scene.groups.iter().flat_map(|group| &group.lamps).all(|lamp| lamp.light().is_finite()));
    true
}

/// A photometric file.
pub fn ies(_: &Path, bytes: &[u8]) -> bool {
    let Ok(profile) = Profile::parse(bytes, "a.ies") else { return false };
    for (vertical, horizontal) in [(0.0, 0.0), (0.7, 1.0), (3.2, 6.2), (1.5, -3.0), (f64::MAX, f64::MIN)] {
        assert!((0.0..=1.0).contains(&profile.at(vertical, horizontal)));
    }
    assert!(profile.peak.is_finite() && (0.0..3.2).contains(&profile.reach()));
    true
}

/// A Radiance picture of the sky.
pub fn radiance(_: &Path, bytes: &[u8]) -> bool {
    let Ok(image) = read_radiance(bytes, "a.hdr") else { return false };
    assert_eq!(image.texels.len(), image.width * image.height);
    assert!(image.texels.as_flattened().iter().all(|value| *value >= 0.0));
    true
}

/// The sun's visibility over a page.
pub fn visibility(scratch: &Path, bytes: &[u8]) -> bool {
    let path = scratch.join("page.vis");
    fs::write(&path, bytes).expect("a file");
    let Ok(visibility) = Visibility::open(&path) else { return false };
    let mut whole = true;
    for (tile, rect) in visibility.tiles.iter().enumerate().take(3) {
        // A few bytes may tell of more times than memory should hold here.
        if 3 * rect.width() * rect.height() * visibility.hours.len() > 16 << 20 {
            continue;
        }
        let planes = visibility.tile(tile);
        if let Ok(planes) = &planes {
            assert!(planes.levels.iter().all(|level| *level <= visibility.top));
            let last = planes.level(planes.texels - 1, visibility.hours.len() - 1);
            assert!(planes.channels == 3 || last == [last[0]; 3]);
        }
        whole &= planes.is_ok();
    }
    whole
}

/// The normals of a page.
pub fn normals(scratch: &Path, bytes: &[u8]) -> bool {
    let path = scratch.join("normals.png");
    fs::write(&path, bytes).expect("a file");
    let Ok(normals) = Normals::read_png(&path) else { return false };
    assert!(normals.normals.iter().flatten().all(|x| x.abs() <= 1.001));
    fs::write(&path, normals.to_png()).expect("a file");
    assert!(Normals::read_png(&path).expect("normals") == normals);
    true
}

/// The sun by the minute.
pub fn sun(scratch: &Path, bytes: &[u8]) -> bool {
    let file = scratch.join("sun.json");
    fs::write(&file, bytes).expect("a file");
    let Ok(path) = SunPath::read(&file) else { return false };
    for hour in [0.0, 6.7, 12.0, 24.0] {
        let light = path.light(hour, [0.6, 0.8, 0.0], [1.0; 3]);
        assert!(light.iter().all(|x| x.is_finite() && *x >= 0.0), "{light:?}");
    }
    fs::write(&file, path.to_json()).expect("a file");
    assert!(SunPath::read(&file).expect("a sun") == path);
    true
}

/// How light goes between frames.
pub fn curve(scratch: &Path, bytes: &[u8]) -> bool {
    let file = scratch.join("curve.json");
    fs::write(&file, bytes).expect("a file");
    let Ok(curve) = Curve::read(&file) else { return false };
    for (frames, hour) in [([6.0, 7.0], 6.3), ([23.0, 1.0], 0.5), ([12.0, 12.0], 12.0), ([19.5, 20.0], 20.0)]
    {
        let weights = curve.weights(frames, hour);
        assert!(weights.iter().flatten().all(|x| x.is_finite() && *x >= 0.0), "{weights:?}");
    }
    fs::write(&file, curve.to_json()).expect("a file");
    assert!(Curve::read(&file).expect("a curve") == curve);
    true
}

/// What is imported without an error is a dataset without a fault; else nothing is left.
fn imported(scratch: &Path, origin: &Origin) -> bool {
    let out = scratch.join("out");
    if import(origin, &out, &Silent).is_err() {
        assert!(!out.exists());
        return false;
    }
    let dataset = Dataset::open(&out).expect("a dataset");
    let faults = dataset.verify(|| ()).faults;
    assert!(faults.is_empty(), "{faults:?}");
    fs::remove_dir_all(&out).expect("a folder");
    true
}

/// The bytes before and after the first zero byte.
fn split(bytes: &[u8]) -> (&[u8], &[u8]) {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    (&bytes[..end], bytes.get(end + 1..).unwrap_or_default())
}

/// A configuration, eight bytes of a mask, light.
fn parts(bytes: &[u8]) -> (&[u8], &[u8], &[u8]) {
    let (config, data) = split(bytes);
    let (mask, light) = data.split_at(data.len().min(8));
    (config, mask, light)
}

/// Opens a bundle and decodes places and rows of it; whether all of them could be.
fn decode(bytes: Vec<u8>) -> bool {
    let Ok(bundle) = Bundle::from_bytes(bytes) else { return false };
    let pages = bundle.header.pages.clone();
    let decoder = Decoder::new(bundle);
    let mut whole = true;
    for (page, grid) in pages.iter().enumerate().take(3) {
        for (u, v, hour) in [(0.0, 0.0, 0.0), (0.5, 0.5, 5.95), (1.0, 1.0, 23.9)] {
            whole &= decoder.sample(page, u, v, hour).is_ok();
            // The way of games: a page at a moment. Both know of the same damage, and neither gives what is
            // no light.
            let ready = decoder.bundle().at(hour).and_then(|at| at.page(page)?.sample(u as f32, v as f32));
            whole &= ready.as_ref().is_ok_and(|light| light.iter().all(|e| e.is_finite() && *e >= 0.0));
        }
        // A few bytes may tell of a page that no memory holds.
        let rows = if grid.width <= 1024 { 0..grid.height.min(130) } else { 0..1 };
        whole &= decoder.decode_rows(page, 12.0, rows).is_ok();
    }
    whole
}

/// The same for the index that ends at a byte of the header, if one does, and the resident block
/// before its first section.
fn mend_index(bytes: &mut [u8], head: usize, end_of_index: usize, streams: usize) {
    let number = |bytes: &[u8], at: usize| -> usize {
        bytes
            .get(at..at + 4)
            .map_or(0, |four| u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
    };
    let (size, mut end) = (8 + 16 * streams, bytes.len());
    let mut line = end_of_index;
    while line >= 72 + size {
        let at = line - size;
        let lengths: usize = (0..streams).map(|i| number(bytes, at + 8 + 16 * i)).sum();
        let offset = number(bytes, at);
        if offset < head || offset.saturating_add(lengths) != end {
            break;
        }
        let mut section = offset;
        for i in 0..streams {
            let length = number(bytes, at + 8 + 16 * i);
            if length > 0 {
                let sum = checksum(&[&bytes[section..section + length]]);
                bytes[at + 16 + 16 * i..at + 24 + 16 * i].copy_from_slice(&sum.to_le_bytes());
            }
            section += length;
        }
        (line, end) = (at, offset);
    }
    // The resident block fills what is between the header and the first payload, if it is the only section of
    // the file: its line of the table has kind 0, flags 1 and a length, then the checksum.
    let room = end.saturating_sub(head);
    for at in 72..head.saturating_sub(24) {
        let length = number(bytes, at + 8);
        let is_line = bytes[at..at + 8] == [0, 0, 0, 0, 1, 0, 0, 0] && number(bytes, at + 12) == 0;
        if line < end_of_index && is_line && length.checked_next_multiple_of(16) == Some(room) {
            let sum = checksum(&[&bytes[head..head + length]]);
            bytes[at + 16..at + 24].copy_from_slice(&sum.to_le_bytes());
        }
    }
}

/// Gives the header and all tiles the checksums that they should have, as far as the lengths in the header
/// can be followed.
fn mend(bytes: &mut [u8]) {
    let number = |bytes: &[u8], at: usize| -> Option<usize> {
        Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize)
    };
    let whole = bytes.len() as u64;
    let Some(head) = number(bytes, 12).filter(|&head| (72..=bytes.len()).contains(&head)) else { return };
    bytes[16..24].copy_from_slice(&whole.to_le_bytes());
    // The index ends the header but for some padding. Payloads lie one after another, so the last line's ends
    // with the file.
    let streams = number(bytes, 56).unwrap_or(0).clamp(1, 16);
    for padding in 0..16 {
        mend_index(bytes, head, head.saturating_sub(padding), streams);
    }
    let sum = checksum(&[&bytes[..24], &bytes[32..head]]);
    bytes[24..32].copy_from_slice(&sum.to_le_bytes());
}
