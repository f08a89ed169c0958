//! The coding `basis` from a dataset through the bundle and back: lamps apart, time, shards, targets.

mod common;

use common::court::{HOURS, moving, sky, write};
use compressor::bundle::{Bundle, MapCoding};
use compressor::compress::{Options, Rate, Shard, Sharded, compress, train_shard};
use compressor::decode::{Decoder, Lights};
use compressor::evaluate::{Measures, evaluate};
use compressor::model::Profile;
use dataset::observe::Silent;
use dataset::store::Dataset;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn options(out: &Path) -> Options {
    Options { coding: MapCoding::Basis, out: Some(out.to_owned()), still_shadows: true, ..Options::default() }
}

/// The dataset `court` in a new folder, and where its bundle is to be.
fn court() -> (TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (root, out) = (folder.path().join("court"), folder.path().join("court.ndgi"));
    write(&root, moving);
    (folder, root, out)
}

#[test]
fn lamps_are_apart_and_light_follows_its_curve_between_frames() {
    let (_folder, root, out) = court();
    compress(&root, &options(&out), &Silent).unwrap();
    let decoder = Decoder::open(&out).unwrap();
    let (bundle, dataset) = (decoder.bundle(), Dataset::open(&root).unwrap());
    bundle.verify().unwrap();
    assert_eq!((bundle.header.coding, &bundle.header.apart[..]), (MapCoding::Basis, &[true][..]));
    let evaluation = evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap();
    let db = evaluation.without_sun.unwrap().psnr_db.unwrap();
    assert!((44.0..60.0).contains(&db), "{db} dB");

    // The lamp is on to 6 and from 18: what it adds at a switch is its own light, whatever else changes.
    let baked = |hour: f64| decoder.decode_page_of(Lights::Baked, 0, hour).unwrap();
    let valid = dataset.mask(0).unwrap().valid;
    let lamp =
        |x: usize, y: usize| 3.0 / (1.0 + ((x as f32 - 40.0).powi(2) + (y as f32 - 30.0).powi(2)) / 200.0);
    for switch in [6.0, 18.0] {
        let [before, after] = [switch - 1e-6, switch + 1e-6].map(baked);
        let (on, off) = if switch < 12.0 { (before, after) } else { (after, before) };
        for i in (0..valid.len()).filter(|&i| valid[i]) {
            let wanted = lamp(i % on.width, i / on.width);
            let found = on.texels[i][0] - off.texels[i][0];
            assert!((found - wanted).abs() < 0.05 * wanted + 0.03, "{switch} {i}: {found} {wanted}");
        }
    }
    // Skylight follows its curve from frame to frame.
    for hour in [6.5, 7.3, 10.0, 13.3, 17.0] {
        let image = baked(hour);
        for i in (0..valid.len()).filter(|&i| valid[i]).step_by(37) {
            let (x, y) = ((i % image.width) as f32, (i / image.width) as f32);
            let wanted = sky(hour) * (1.0 + 0.3 * (x / 40.0).sin() + y / 100.0);
            assert!(
                (image.texels[i][1] / wanted - 1.0).abs() < 0.06,
                "{hour} {i}: {:?} {wanted}",
                image.texels[i]
            );
        }
    }
    assert!(HOURS.len() > 4);
}

#[test]
fn threads_stops_and_shards_leave_the_same_bytes() {
    let (folder, root, out) = court();
    let bytes_of = |threads: usize, out: &Path| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| compress(&root, &options(out), &Silent)).unwrap();
        fs::read(out).unwrap()
    };
    let whole = bytes_of(1, &out);
    for threads in [2, 7] {
        assert!(bytes_of(threads, &folder.path().join(format!("{threads}.ndgi"))) == whole, "{threads}");
    }
    // Again: nothing to do.
    assert!(compress(&root, &options(&out), &Silent).unwrap().up_to_date);
    // One shard of two: a stopped run. Then the other, and a merge.
    let sharded = folder.path().join("sharded.ndgi");
    for number in [1, 2] {
        let shard = Shard { number, of: 2 };
        assert!(matches!(train_shard(&root, &options(&sharded), shard, &Silent), Ok(Sharded::Trained(_))));
    }
    compress(&root, &Options { merge: true, ..options(&sharded) }, &Silent).unwrap();
    assert!(fs::read(&sharded).unwrap() == whole);
    // A damaged tile is encoded again, to the same bytes.
    let mut damaged = whole.clone();
    let at = Bundle::open(&out).unwrap().index[0].maps.offset as usize + 9;
    damaged[at] ^= 0x10;
    fs::write(&out, damaged).unwrap();
    compress(&root, &options(&out), &Silent).unwrap();
    assert!(fs::read(&out).unwrap() == whole);
}

#[test]
fn targets_are_met_without_training() {
    let (folder, root, _) = court();
    let (dataset, mut sizes) = (Dataset::open(&root).unwrap(), Vec::new());
    for db in [40.0, 50.0] {
        let out = folder.path().join(format!("{db}.ndgi"));
        let options = Options { rate: Rate::Psnr(db), without_sun: true, ..options(&out) };
        compress(&root, &Options { still_shadows: false, ..options }, &Silent).unwrap();
        let evaluation =
            evaluate(&dataset, &Decoder::open(&out).unwrap(), Measures::default(), &Silent).unwrap();
        // (Of tiles with their borders, at peaks with the sun: not quite what is evaluated.)
        let found = evaluation.all.psnr_pooled_db.unwrap();
        assert!((db - 4.0..db + 4.0).contains(&found), "{db}: {found}");
        sizes.push(fs::metadata(&out).unwrap().len());
    }
    assert!(sizes[1] > sizes[0]);
    // A size between the two.
    let out = folder.path().join("bpp.ndgi");
    let wanted = sizes.iter().sum::<u64>() as f64 / 2.0;
    let header = Bundle::open(&folder.path().join("40.ndgi")).unwrap().header;
    let texels = header.pages[0].width * header.pages[0].height * HOURS.len();
    let rate = Rate::Bpp(8.0 * wanted / texels as f64);
    let options = Options { rate, without_sun: true, still_shadows: false, ..options(&out) };
    compress(&root, &options, &Silent).unwrap();
    let found = fs::metadata(&out).unwrap().len() as f64;
    assert!(found < 1.03 * wanted && found > 0.85 * wanted, "{found} {wanted} {sizes:?}");
    let refused = Options { rate: Rate::Profile(Profile::S), ..options };
    let error = compress(&root, &refused, &Silent).unwrap_err().to_string();
    assert!(error.contains("no profiles") && error.contains("--coding neural"), "{error}");
}

#[test]
fn what_was_trained_is_not_replaced_in_silence() {
    let (_folder, root, out) = court();
    let neural = Options { coding: MapCoding::Neural, iterations: 60, ..options(&out) };
    compress(&root, &neural, &Silent).unwrap();
    let trained = fs::read(&out).unwrap();
    let refused = compress(&root, &options(&out), &Silent).unwrap_err().to_string();
    assert!(
        refused.contains("with neural maps, trained for 60 steps") && refused.contains("--out"),
        "{refused}"
    );
    assert!(fs::read(&out).unwrap() == trained);
    compress(&root, &Options { force: true, ..options(&out) }, &Silent).unwrap();
    assert_eq!(Bundle::open(&out).unwrap().header.coding, MapCoding::Basis);
    // Planes take a second: they are replaced.
    compress(&root, &neural, &Silent).unwrap();
    assert_eq!(Bundle::open(&out).unwrap().header.coding, MapCoding::Neural);
}
