//! Layouts of others: what goes out comes back with every bit, and what comes in goes out again.

mod common;

use common::layouts::{self, content};
use common::{noise_image, write_hours};
use dataset::digest::Digest;
use dataset::exchange::{Origin, export, import, lightmaps_of};
use dataset::format::{Config, Light};
use dataset::layout::hprc1::Hprc1;
use dataset::layout::hprc2::Hprc2;
use dataset::layout::{Id, Layout, Lightmap};
use dataset::observe::Silent;
use dataset::store::{DATA, Dataset};
use std::fs;
use std::path::Path;

/// A day with both sides of the porch's switches, and one time that no layout has a place for.
fn day() -> Vec<f64> {
    let mut hours: Vec<f64> = (0..24).map(f64::from).chain([5.9, 18.1, 20.4]).collect();
    hours.sort_by(f64::total_cmp);
    hours
}

fn import_folder(layout: &'static dyn Layout, from: &Path, out: &Path) -> Config {
    import(&Origin::Folder(layout, from.to_owned()), out, &Silent).unwrap()
}

fn export_folder(dataset: &Path, layout: &dyn Layout, out: &Path) -> dataset::exchange::Exported {
    export(&Dataset::open(dataset).unwrap(), layout, out, &Silent).unwrap()
}

fn faults(root: &Path) -> Vec<String> {
    Dataset::open(root).unwrap().verify(|| {}).faults.iter().map(ToString::to_string).collect()
}

fn bits(texels: &[[f32; 3]]) -> Vec<[u32; 3]> {
    texels.iter().map(|texel| texel.map(f32::to_bits)).collect()
}

#[test]
fn a_dataset_in_layout_2_keeps_every_bit_in_a_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set, back] = ["contest", "set", "back"].map(|name| folder.path().join(name));
    let lightmaps = layouts::write2(&source);
    let config = import_folder(&Hprc2, &source, &set);
    assert_eq!(faults(&set), Vec::<String>::new());

    // Pages in the file's order, whatever their ids; hours sorted; lamps told by the hours beside their
    // switches.
    let dataset = Dataset::open(&set).unwrap();
    assert_eq!(dataset.config, config);
    let sizes: Vec<_> = config.pages.iter().map(|page| (page.width as usize, page.height as usize)).collect();
    assert_eq!(sizes, lightmaps.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>());
    let reported = lightmaps_of(&dataset).unwrap().unwrap();
    assert_eq!(
        reported.iter().map(|l| l.id.clone()).collect::<Vec<_>>(),
        lightmaps.iter().map(|l| Id::Number(l.id)).collect::<Vec<_>>()
    );
    assert_eq!(reported[1].level.as_deref(), Some("Level \u{e9}"));
    let lit: Vec<(f64, bool)> = config.frames.iter().map(|set| (set.hour, set.groups_on[0])).collect();
    assert_eq!(
        lit,
        [(0.0, true), (5.9, true), (6.0, false), (7.5, false), (18.0, false), (18.1, true), (23.0, true)]
    );
    assert_eq!((&*config.groups[0].name, &*config.groups[0].on), ("local", &[[18.0, 6.0]][..]));

    for (page, lightmap) in lightmaps.iter().enumerate() {
        let mask = dataset.mask(page).unwrap();
        assert_eq!(mask.valid, lightmap.valid);
        for set in 0..config.frames.len() {
            assert_eq!(bits(&dataset.map(set, page).unwrap().texels), bits(&lightmap.light[set]));
        }
    }
    let exported = export_folder(&set, &Hprc2, &back);
    assert_eq!(exported.omitted, Vec::<String>::new());
    assert_eq!(content(&back), content(&source));
}

#[test]
fn a_dataset_in_layout_1_with_parts_and_shares_survives_a_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set, back] = ["contest", "set", "back"].map(|name| folder.path().join(name));
    let light = layouts::write1(&source, &[(7, (12, 8), 4), (3, (5, 3), 1)], true);
    let config = import_folder(&Hprc1, &source, &set);
    assert_eq!(faults(&set), Vec::<String>::new());
    let dataset = Dataset::open(&set).unwrap();
    // Time 24 is midnight.
    assert_eq!(bits(&dataset.map(0, 0).unwrap().texels), bits(&light(7, "Original", 24, 12 * 8)));
    assert_eq!(bits(&dataset.map(13, 1).unwrap().texels), bits(&light(3, "Original", 13, 5 * 3)));
    let local = dataset.light(Light::Lamps, None, 13, 1).unwrap();
    assert_eq!(bits(&local.texels), bits(&light(3, "LocalOnly", 13, 5 * 3)));
    assert!(config.groups.is_empty());
    export_folder(&set, &Hprc1, &back);
    assert_eq!(content(&back), content(&source));

    // In the other layout it keeps its numbers.
    let other = folder.path().join("other");
    let exported = export_folder(&set, &Hprc2, &other);
    assert!(exported.omitted.iter().any(|what| what.contains("layers")), "{:?}", exported.omitted);
    let written = fs::read_to_string(other.join("config.json")).unwrap();
    assert!(written.contains("\"id\": 7") && written.contains("\"level\": \"set\""), "{written}");
}

/// Changes the text of a folder's configuration; each part must be there.
fn edit(root: &Path, changes: &[(&str, &str)]) {
    let place = root.join("config.json");
    let mut text = fs::read_to_string(&place).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}: {text}");
        text = text.replace(from, to);
    }
    fs::write(place, text).unwrap();
}

#[test]
fn ids_are_numbers_or_texts_and_are_written_back_as_read() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set, back] = ["contest", "set", "back"].map(|name| folder.path().join(name));
    let maps = [(1, (8, 4), 2), (17, (5, 3), 1), (3, (2, 2), 1)];
    layouts::write1(&source, &maps, false);
    edit(&source, &[("\"id\":1,", "\"id\": \"1\","), ("\"id\":17,", "\"id\":\"Hall 2\",")]);
    for kind in ["Original", "Mask"] {
        for entry in fs::read_dir(source.join(kind)).unwrap().flatten() {
            let name = entry.file_name().into_string().unwrap();
            let renamed = name.replace("Texture0_17_", "Texture0_Hall 2_");
            fs::rename(entry.path(), entry.path().with_file_name(renamed)).unwrap();
        }
    }
    import_folder(&Hprc1, &source, &set);
    let dataset = Dataset::open(&set).unwrap();
    let ids: Vec<Id> = lightmaps_of(&dataset).unwrap().unwrap().into_iter().map(|l| l.id).collect();
    assert_eq!(ids, [Id::Text("1".to_owned()), Id::Text("Hall 2".to_owned()), Id::Number(3)]);
    export_folder(&set, &Hprc1, &back);
    assert_eq!(content(&back), content(&source));
    // In the other layout, too.
    let [other, again] = ["other", "again"].map(|name| folder.path().join(name));
    export_folder(&set, &Hprc2, &other);
    let written = fs::read_to_string(other.join("config.json")).unwrap();
    let expected = ["\"id\": \"1\"", "\"id\": \"Hall 2\"", "\"id\": 3", "_Hall 2_5_3_2300.bin_0"];
    assert!(expected.iter().all(|what| written.contains(what)), "{written}");
    import_folder(&Hprc2, &other, &again);
    assert_eq!(faults(&again), Vec::<String>::new());
}

#[test]
fn level_and_id_together_name_a_lightmap() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set, back] = ["contest", "set", "back"].map(|name| folder.path().join(name));
    let lightmaps = layouts::write2(&source);
    edit(&source, &[("\"id\": 4", "\"id\": 0"), ("\"id\": -1", "\"id\": 0")]);
    import_folder(&Hprc2, &source, &set);
    let dataset = Dataset::open(&set).unwrap();
    for (page, lightmap) in lightmaps.iter().enumerate() {
        assert_eq!(bits(&dataset.map(3, page).unwrap().texels), bits(&lightmap.light[3]));
    }
    export_folder(&set, &Hprc2, &back);
    assert_eq!(content(&back), content(&source));
    // Layout 1 has no levels, and would name two lightmaps alike.
    let map =
        |level: &str| Lightmap { id: Id::Number(0), level: Some(level.to_owned()), width: 1, height: 1 };
    let reason = "lightmap 0 of a and lightmap 0 of b have the same id, and the layout has no levels";
    assert!(Hprc1.confuses(&[map("a"), map("b")]).unwrap().starts_with(reason));
    assert_eq!(Hprc2.confuses(&[map("a"), map("b")]), None);
}

#[test]
fn a_frame_in_layout_1_without_shares_is_imported() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set, back] = ["contest", "set", "back"].map(|name| folder.path().join(name));
    layouts::write1(&source, &[(0, (4, 4), 2)], false);
    let config = import_folder(&Hprc1, &source, &set);
    assert!(config.layers.is_empty() && config.sun.is_none());
    export_folder(&set, &Hprc1, &back);
    assert_eq!(content(&back), content(&source));
}

#[test]
fn a_baked_day_goes_out_and_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("yard");
    write_hours(&root, &[(20, 20), (7, 3)], 1, &day()).unwrap();
    let baked = Dataset::open(&root).unwrap();
    for (layout, hours, reason) in [
        (&Hprc1 as &dyn Layout, 24, "3 frames at 5.9, 18.1, 20.4 h: the layout stores only whole hours"),
        (&Hprc2, 26, "1 frame at 20.4 h: the layout stores only whole hours, 5.9 and 18.1"),
    ] {
        let at = |name: &str| folder.path().join(format!("{name}-{}", layout.name()));
        let exported = export_folder(&root, layout, &at("out"));
        assert_eq!((exported.hours.len(), &*exported.omitted[0]), (hours, reason));
        let reported = exported.omitted.join("\n");
        assert!(reported.contains("geometry") && reported.contains("noise"), "{reported}");
        let bytes: u64 = content(&at("out")).values().map(|bytes| bytes.len() as u64).sum();
        assert_eq!(exported.bytes, bytes);

        let config = import_folder(layout, &at("out"), &at("in"));
        assert_eq!(faults(&at("in")), Vec::<String>::new());
        let imported = Dataset::open(&at("in")).unwrap();
        for page in 0..2 {
            assert_eq!(imported.mask(page).unwrap(), baked.mask(page).unwrap());
            for (k, set) in config.frames.iter().enumerate() {
                let own = baked.config.frames.iter().position(|own| own.hour == set.hour).unwrap();
                assert_eq!(
                    bits(&imported.map(k, page).unwrap().texels),
                    bits(&baked.map(own, page).unwrap().texels)
                );
                if layout.name() == "hprc1" {
                    for light in [Light::Sun, Light::Sky] {
                        let [sum, own] = [(&imported, k), (&baked, own)]
                            .map(|(dataset, frame)| dataset.light(light, None, frame, page).unwrap());
                        assert_eq!(bits(&sum.texels), bits(&own.texels), "{light:?}, {} h", set.hour);
                    }
                    let local = config.files_of(Light::Lamps, None, k, page);
                    assert_eq!(local.len(), usize::from(set.hour < 6.0 || set.hour > 18.0), "{} h", set.hour);
                }
            }
        }
        export_folder(&at("in"), layout, &at("again"));
        assert_eq!(content(&at("again")), content(&at("out")));
    }
    // A plain texel of the first layout, as others would read it.
    let name = "out-hprc1/LocalOnly/lightmapRawData_Dilate_VirtualTexture0_1_HQ_7_3_22.00.bin_0";
    let bytes = fs::read(folder.path().join(name)).unwrap();
    let [porch, direct, indirect] = [100, 101, 107].map(|salt| noise_image(7, 3, 1 ^ salt).texels[9][2]);
    let sum = porch + (direct + indirect);
    assert_eq!(bytes[4 * (3 * 9 + 2)..][..4], sum.to_le_bytes());
    let name = "out-hprc1/Mask/lightmapCoverage_Dilate_VirtualTexture0_0_HQ_20_20_1.00.bin_0";
    let mask = fs::read(folder.path().join(name)).unwrap();
    assert_eq!((mask.len(), mask[0] as i8, mask[1] as i8), (400, -1, 127));
}

#[test]
fn what_a_layout_cannot_hold_is_said_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let [root, out] = ["yard", "out"].map(|name| folder.path().join(name));
    let refused = |hours: &[f64], layout: &dyn Layout| {
        let _ = fs::remove_dir_all(&root);
        write_hours(&root, &[(5, 5)], 1, hours).unwrap();
        let error = export(&Dataset::open(&root).unwrap(), layout, &out, &Silent).unwrap_err().to_string();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "only the set");
        error
    };
    let error = refused(&day()[1..], &Hprc1);
    assert!(error.contains("no frame at 0 h; the layout needs all 24 whole hours"), "{error}");
    let error = refused(&[4.5, 20.4], &Hprc2);
    assert!(error.contains("frames at 4.5, 20.4 h have no time key"), "{error}");
    // A damaged dataset, though its texels can still be read.
    write_hours(&root, &[(5, 5)], 1, &[0.0, 12.0]).unwrap();
    let dataset = Dataset::open(&root).unwrap();
    let victim = dataset.path(&dataset.config.frames[1].maps[0]);
    let mut bytes = fs::read(&victim).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&victim, bytes).unwrap();
    let error = export(&dataset, &Hprc2, &out, &Silent).unwrap_err().to_string();
    assert!(error.contains("checksum"), "{error}");
    // A folder with something in it is left alone.
    fs::create_dir(&out).unwrap();
    fs::write(out.join("mine"), b"x").unwrap();
    let error = export(&dataset, &Hprc2, &out, &Silent).unwrap_err().to_string();
    assert!(error.contains("stands there already"), "{error}");
}

#[test]
fn values_outside_the_mask_that_are_no_light_become_zero_and_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set] = ["contest", "set"].map(|name| folder.path().join(name));
    let lightmaps = layouts::write2(&source);
    let outside = lightmaps[0].valid.iter().position(|valid| !valid).unwrap();
    let file = source.join("Data/raw_4_0.bin_0");
    let mut bytes = fs::read(&file).unwrap();
    for (channel, value) in [f32::NAN, -1.5, 7.0].into_iter().enumerate() {
        bytes[4 * (3 * outside + channel)..][..4].copy_from_slice(&value.to_le_bytes());
    }
    fs::write(&file, bytes).unwrap();
    let config = import_folder(&Hprc2, &source, &set);
    assert_eq!(config.source.unwrap().replaced_values, 2);
    let map = Dataset::open(&set).unwrap().map(0, 0).unwrap();
    assert_eq!(map.texels[outside], [0.0, 0.0, 7.0]);
    assert_eq!(faults(&set), Vec::<String>::new());
}

#[test]
fn a_sum_that_is_nearly_one_is_good_enough_for_an_import() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set] = ["contest", "set"].map(|name| folder.path().join(name));
    let light = layouts::write1(&source, &[(0, (4, 4), 1)], true);
    let file = source.join("Original/lightmapRawData_Dilate_VirtualTexture0_0_HQ_4_4_9.00.bin_0");
    let write = |factor: f32| {
        let mut texels = light(0, "Original", 9, 16);
        texels[6] = texels[6].map(|value| factor * value);
        // Beside the mask anything goes.
        texels[0] = [5.0; 3];
        fs::write(&file, layouts::light_bytes(&texels)).unwrap();
    };
    write(1.01);
    let origin = Origin::Folder(&Hprc1, source.clone());
    let error = import(&origin, &set, &Silent).unwrap_err().to_string();
    assert!(error.contains("_9.00.bin_0, texel (2, 1)") && error.contains("sum to"), "{error}");
    assert!(!set.exists());
    write(1.0005);
    let config = import_folder(&Hprc1, &source, &set);
    assert_eq!(faults(&set), Vec::<String>::new());
    // The check has the same measure, and names the place.
    let mut image = Dataset::open(&set).unwrap().map(9, 0).unwrap();
    image.texels[6] = image.texels[6].map(|value| 1.01 * value);
    let mut config = config;
    let file = &mut config.frames[9].maps[0];
    let bytes = image.to_exr();
    fs::write(set.join(&file.path), &bytes).unwrap();
    (file.bytes, file.blake3) = (bytes.len() as u64, Digest::of(&bytes));
    fs::write(set.join("config.json"), serde_json::to_vec(&config).unwrap()).unwrap();
    let found = faults(&set);
    assert!(found.len() == 1 && found[0].contains("texel (2, 1)"), "{found:?}");
}

#[test]
fn equal_files_are_stored_once_and_no_temporary_stays() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set] = ["contest", "set"].map(|name| folder.path().join(name));
    layouts::write2(&source);
    fs::copy(source.join("Data/raw_4_0.bin_0"), source.join("Data/raw_4_2300.bin_0")).unwrap();
    let config = import_folder(&Hprc2, &source, &set);
    assert_eq!(config.frames[0].maps[0], config.frames[6].maps[0]);
    // Two lightmaps at 7 hours less one, two masks, the configuration.
    assert_eq!(fs::read_dir(set.join(DATA)).unwrap().count(), 2 * 7 - 1 + 2 + 1);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}
