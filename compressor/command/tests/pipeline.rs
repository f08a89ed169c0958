//! A dataset through the whole compressor: bundle, decoding, quality, resuming, refusals, the command line.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{HOURS, Scene, islands};
use compressor::bundle::Bundle;
use compressor::compress::{Options, Rate, compress, light_of};
use compressor::decode::Decoder;
use compressor::evaluate::{Measures, evaluate};
use compressor::model::Contents;
use compressor::run::compress_and_judge;
use dataset::image::Image;
use dataset::observe::Silent;
use dataset::store::Dataset;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Enough steps to learn something, few enough for a test.
fn brief(iterations: usize) -> Options {
    Options { iterations, ..Options::default() }
}

fn command(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_compress"));
    command.args(arguments).current_dir(folder);
    command
}

fn run(arguments: &[&str], folder: &Path) -> Output {
    command(arguments, folder).output().unwrap()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.stdout.iter().filter(|&&byte| byte == b'\n').count(), 1, "one object on stdout");
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_dataset_comes_back_from_its_bundle() {
    let folder = tempfile::tempdir().unwrap();
    let scene = islands();
    scene.write(folder.path());
    let judged = compress_and_judge(folder.path(), &brief(1500), &Silent).unwrap();
    let outcome = &judged.outcome;
    assert_eq!(outcome.bundle, folder.path().join("isles.ndgi"));
    assert_eq!((outcome.tiles, outcome.resumed), (4, 0));
    // The single texel is the same at every hour, its means apart.
    let same = "the same at every hour except for its mean: F_uv alone";
    assert_eq!(outcome.omitted, [("no valid texel".to_owned(), 1), (same.to_owned(), 1)]);
    assert!(!outcome.curve.is_empty() && outcome.curve.is_sorted_by_key(|point| point.iteration));
    // Neither poor nor suspiciously good for 1500 steps on smooth light.
    let psnr = judged.evaluation.all.psnr_db.unwrap();
    assert!((45.0..78.0).contains(&psnr), "{psnr}");
    // Training and the decoder see the same values: the tiles differ (126 and 128), the quality hardly.
    assert!((outcome.psnr_trained_db.unwrap() - psnr).abs() < 12.0, "{outcome:?}");
    let bytes = fs::metadata(&outcome.bundle).unwrap().len();
    assert!((judged.evaluation.bpp - bytes as f64 * 8.0 / (150.0 * 140.0 * 6.0)).abs() < 1e-9);
    assert!(judged.evaluation.all.noise_ceiling_db.is_some());
    // The work folder is gone, the timings stand beside the bundle, nothing else was left.
    let mut names: Vec<_> =
        fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["config.json", "data", "isles.ndgi", "isles.ndgi.run.json"]);
    assert_eq!(judged.sections.len(), 5);

    let decoder = Decoder::open(&outcome.bundle).unwrap();
    // The lamp: on at 18.05 exactly as at 18.1, off at 18.0, on until 6.
    let page = |hour| decoder.decode_page(0, hour).unwrap();
    assert_eq!(page(18.05), page(18.1));
    assert_eq!(page(5.95), page(5.9));
    let at_lamp = |image: &compressor::decode::Image| image.texels[70 * 150 + 60][0];
    let (off, on) = (at_lamp(&page(18.0)), at_lamp(&page(18.05)));
    let expected = |hour: f64| (scene.light)(60, 70, hour, common::lamp_is_on(hour))[0];
    assert!((off - expected(18.0)).abs() < 0.15 && (on - expected(18.1)).abs() < 0.3, "{off} {on}");
    assert!(on > off + 1.0);
    // Rows of it, across a border of tiles.
    let rows = decoder.decode_rows(0, 18.05, 100..135).unwrap();
    assert_eq!(rows.texels, page(18.05).texels[100 * 150..135 * 150]);
    assert!(decoder.decode_rows(0, 18.05, 100..141).is_err());
    // Any time of the day is finite, and texels agree with the page.
    for i in 0..48 {
        let image = page(f64::from(i) / 2.0);
        assert!(image.texels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
        let sample = decoder.sample(0, 60.5 / 150.0, 70.5 / 140.0, f64::from(i) / 2.0).unwrap();
        assert!((sample[0] - at_lamp(&image)).abs() < 1e-3 * at_lamp(&image).max(0.1));
    }
}

/// A dataset of the dataset crate's tests.
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../dataset/tests/fixtures").join(name)
}

#[test]
fn bundles_name_the_light_that_they_were_made_from() {
    // With what the bundles that were made of them then say of their light.
    let cases = [
        ("baked", "de955576d230f127f696af57db4acfbef0e425412d500c857d1738253fe414e3"),
        ("imported", "d4f3feaa852d714a4dfcb7125dc2afdcfb0c5d0119dc7fbcab469c27f6e1d3da"),
    ];
    for (name, light) in cases {
        let folder = tempfile::tempdir().unwrap();
        let dataset = Dataset::open(&fixture(name)).unwrap();
        let options = Options { out: Some(folder.path().join("light.ndgi")), ..brief(1000) };
        let judged = compress_and_judge(&dataset.root, &options, &Silent).unwrap();
        let psnr = judged.evaluation.all.psnr_db.unwrap();
        assert!((40.0..90.0).contains(&psnr), "{name}: {psnr}");
        assert!(compress(&dataset.root, &options, &Silent).unwrap().up_to_date);

        let decoder = Decoder::open(&judged.outcome.bundle).unwrap();
        assert_eq!(light_of(&decoder.bundle().header).as_deref(), Some(light));
        let valid = dataset.mask(0).unwrap().valid;
        let green = |texels: &[[f32; 3]]| {
            let texels = texels.iter().zip(&valid).filter(|(_, valid)| **valid);
            texels.map(|(texel, _)| f64::from(texel[1])).sum::<f64>()
        };
        for (number, frame) in dataset.config.frames.iter().enumerate() {
            let found = green(&decoder.decode_page(0, frame.hour).unwrap().texels);
            let expected = green(&dataset.map(number, 0).unwrap().texels);
            assert!((found - expected).abs() <= 0.02 * expected, "{name}: {found} {expected}");
        }
    }
}

#[test]
fn a_bundle_decodes_to_what_its_trainer_measured() {
    // No valid texel in the border, and one evaluation tile: trainer and evaluation judge the same texels.
    let scene = Scene {
        width: 70,
        height: 50,
        valid: |x, y| (2..68).contains(&x) && (2..48).contains(&y),
        ..islands()
    };
    let folder = tempfile::tempdir().unwrap();
    scene.write(folder.path());
    {
        let out = folder.path().join("isles.ndgi");
        let options = Options { out: Some(out.clone()), ..brief(800) };
        let judged = compress_and_judge(folder.path(), &options, &Silent).unwrap();
        let decoder = Decoder::open(&out).unwrap();
        let (reported, found) =
            (judged.outcome.psnr_trained_db.unwrap(), judged.evaluation.all.psnr_db.unwrap());
        assert!(found > 20.0 && (reported - found).abs() < 0.02, "{reported} {found}");
        // Between frames, around midnight, and read texel by texel.
        for hour in [3.0, 9.25, 18.05, 21.0, 23.99] {
            let image = decoder.decode_page(0, hour).unwrap();
            assert!(image.texels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
            let sample = decoder.sample(0, 30.5 / 70.0, 20.5 / 50.0, hour).unwrap();
            let texel = image.texels[20 * 70 + 30];
            assert!((sample[0] - texel[0]).abs() < 1e-3 * texel[0].max(0.1), "{sample:?} {texel:?}");
        }
    }
}

#[test]
fn one_and_two_threads_write_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    let bytes = |threads: usize| {
        let out = folder.path().join(format!("{threads}.ndgi"));
        let options = Options { out: Some(out.clone()), ..brief(60) };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| compress(folder.path(), &options, &Silent)).unwrap();
        fs::read(out).unwrap()
    };
    let one = bytes(1);
    assert!(one == bytes(2) && one == bytes(3));
    // Another seed is another bundle.
    let out = folder.path().join("other.ndgi");
    compress(folder.path(), &Options { out: Some(out.clone()), seed: 2, ..brief(60) }, &Silent).unwrap();
    assert!(one != fs::read(out).unwrap());
}

#[test]
fn a_target_gives_each_tile_what_it_needs_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    let run = |name: &str, rate: Rate, threads: usize| {
        let out = folder.path().join(name);
        let options = Options { rate, out: Some(out.clone()), ..brief(700) };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let judge = || compress_and_judge(folder.path(), &options, &Silent).unwrap();
        (pool.install(judge), fs::read(out).unwrap())
    };
    let uniform = run("m.ndgi", Options::default().rate, 2).0.evaluation;
    let (judged, bytes) = run("b.ndgi", Rate::Bpp(0.6 * uniform.bpp), 2);
    assert!(judged.evaluation.bpp <= 0.6 * uniform.bpp, "{} of {}", judged.evaluation.bpp, uniform.bpp);
    let pooled = |e: &compressor::evaluate::Evaluation| e.all.psnr_pooled_db.unwrap();
    assert!((45.0..70.0).contains(&pooled(&judged.evaluation)), "{:?}", judged.evaluation.all);
    assert!(bytes == run("one.ndgi", Rate::Bpp(0.6 * uniform.bpp), 1).1);
    // Each tile says what was chosen, little for the single texel.
    let chosen = |name: &str| {
        let bundle = Bundle::open(&folder.path().join(name)).unwrap();
        bundle
            .index
            .iter()
            .map(|e| (e.maps.length, Contents::of_word(e.maps.word).unwrap()))
            .collect::<Vec<_>>()
    };
    let tiles = chosen("b.ndgi");
    assert!((1..1500).contains(&tiles[3].0) && tiles[0].1 != tiles[3].1, "{tiles:?}");
    let reported = judged.outcome.omitted.iter().filter(|(why, _)| why.starts_with("chosen by trial fits: "));
    assert_eq!(reported.map(|(_, n)| n).sum::<usize>(), 3);
    // More quality takes more bits, and is reached, about: of what the one large tile may have, 45 dB is next
    // below 52.
    let [low, high] = [35.0, 48.0].map(|db| run(&format!("{db}.ndgi"), Rate::Psnr(db), 2).0.evaluation);
    assert!(
        low.bytes < high.bytes
            && (32.0..60.0).contains(&pooled(&low))
            && (47.5..53.0).contains(&pooled(&high)),
        "{:?}",
        [pooled(&low), pooled(&high), low.bytes as f64, high.bytes as f64]
    );
}

#[test]
fn a_killed_run_continues_without_repeating_a_tile() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    let arguments = [".", "--json", "--threads", "1", "--iterations", "600", "--out", "a.ndgi", "--quiet"];
    let mut child = command(&arguments, folder.path()).stdout(std::process::Stdio::null()).spawn().unwrap();
    let part = folder.path().join("a.ndgi.part");
    let finished = || -> Vec<_> {
        let entries = fs::read_dir(&part).into_iter().flatten().flatten().map(|entry| entry.path());
        entries.filter(|path| path.extension().is_some_and(|e| e == "tile")).collect()
    };
    // Kill -9 once a tile is finished, and before the last is.
    let start = Instant::now();
    while finished().is_empty() {
        assert!(start.elapsed() < Duration::from_secs(120) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let kept = finished().len();
    assert!((1..4).contains(&kept), "{kept} tiles finished before the kill");
    assert!(!folder.path().join("a.ndgi").exists());
    let kept_tile = finished()[0].clone();

    // Another recipe takes none of them over and leaves what it does not own; the same command takes all.
    let mut other = arguments;
    other[5] = "30";
    other[7] = "b.ndgi";
    fs::create_dir(folder.path().join("b.ndgi.part")).unwrap();
    fs::copy(&kept_tile, folder.path().join("b.ndgi.part").join(kept_tile.file_name().unwrap())).unwrap();
    assert_eq!(json(&run(&other, folder.path()))["tiles_resumed"], 0);
    let left = fs::read_dir(folder.path().join("b.ndgi.part")).unwrap().flatten();
    let left: Vec<_> = left.filter(|entry| entry.file_name() != ".lock").collect();
    assert!(left.len() == 1 && left[0].file_name() == kept_tile.file_name().unwrap(), "{left:?}");
    assert_eq!(json(&run(&arguments, folder.path()))["tiles_resumed"], kept);
    assert!(!part.exists());

    // What stands there is not retrained; an undisturbed run gives the same bytes, and --force starts over.
    let bytes = fs::read(folder.path().join("a.ndgi")).unwrap();
    assert_eq!(json(&run(&arguments, folder.path()))["up_to_date"], true);
    // One trained for less does not take its place unasked.
    let shorter = other.map(|word| if word == "b.ndgi" { "a.ndgi" } else { word });
    let refused = run(&shorter, folder.path());
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(
        !refused.status.success()
            && said.contains("trained for 600 steps")
            && said.contains("replace it with --force"),
        "{said}"
    );
    assert!(bytes == fs::read(folder.path().join("a.ndgi")).unwrap());
    assert_eq!(json(&run(&[&shorter[..], &["--force"]].concat(), folder.path()))["up_to_date"], false);
    let forced = [&arguments[..], &["--force"]].concat();
    assert_eq!(json(&run(&forced, folder.path()))["tiles_resumed"], 0);
    assert!(bytes == fs::read(folder.path().join("a.ndgi")).unwrap());

    // Nor do a bundle of another scene and a file that is none give way.
    let config = folder.path().join("config.json");
    let text = fs::read_to_string(&config).unwrap();
    fs::write(&config, text.replacen("\"isles\"", "\"other\"", 1)).unwrap();
    fs::write(folder.path().join("notes.ndgi"), "not to be lost").unwrap();
    for (out, what) in [("a.ndgi", "of scene isles, not of other"), ("notes.ndgi", "is not a bundle")] {
        let before = fs::read(folder.path().join(out)).unwrap();
        let refused = run(&arguments.map(|word| if word == "a.ndgi" { out } else { word }), folder.path());
        let said = String::from_utf8_lossy(&refused.stderr);
        assert!(!refused.status.success() && said.contains(what) && said.contains("--force"), "{said}");
        assert!(before == fs::read(folder.path().join(out)).unwrap());
    }
}

#[test]
fn a_bad_texel_is_refused_and_nothing_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    compress(folder.path(), &brief(20), &Silent).unwrap();
    let before = fs::read(folder.path().join("isles.ndgi")).unwrap();
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let light: fn(usize, usize, f64, bool) -> [f32; 3] = match bad {
            b if b.is_nan() => |x, y, h, on| {
                if (x, y, h) == (149, 2, 12.0) {
                    [1.0, f32::NAN, 1.0]
                } else {
                    (islands().light)(x, y, h, on)
                }
            },
            b if b < 0.0 => |x, y, h, on| {
                if (x, y, h) == (149, 2, 12.0) { [1.0, -1.0, 1.0] } else { (islands().light)(x, y, h, on) }
            },
            _ => |x, y, h, on| {
                if (x, y, h) == (149, 2, 12.0) {
                    [1.0, f32::INFINITY, 1.0]
                } else {
                    (islands().light)(x, y, h, on)
                }
            },
        };
        Scene { light, ..islands() }.write(folder.path());
        let output = run(&["."], folder.path());
        assert_eq!(output.status.code(), Some(1));
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(message.contains("map-12") && message.contains("(149, 2)"), "{message}");
        assert!(before == fs::read(folder.path().join("isles.ndgi")).unwrap());
        assert!(!folder.path().join("isles.ndgi.part").exists());
    }
    // A truncated file likewise.
    islands().write(folder.path());
    let dataset = Dataset::open(folder.path()).unwrap();
    let map = dataset.path(&dataset.config.frames[3].maps[0]);
    let mut bytes = fs::read(&map).unwrap();
    bytes.truncate(bytes.len() / 2);
    fs::write(&map, bytes).unwrap();
    assert!(compress(folder.path(), &brief(20), &Silent).is_err());
    assert!(before == fs::read(folder.path().join("isles.ndgi")).unwrap());
}

#[test]
fn pages_and_masks_of_any_size() {
    let uniform = |width, height, hours: &[f64], valid| Scene {
        width,
        height,
        hours: hours.to_vec(),
        valid,
        light: |_, _, hour, _| [hour as f32, 1.0, 0.0],
    };
    let scenes = [
        uniform(1, 1, &[12.0], |_, _| true),
        uniform(129, 1, &[0.0, 12.0], |_, _| true),
        uniform(5, 130, &HOURS, |_, y| y == 129),
        uniform(130, 130, &HOURS, |x, y| (x, y) == (127, 126)),
        uniform(40, 40, &HOURS, |_, _| false),
        uniform(127, 3, &[3.0], |x, _| x == 126),
    ];
    for scene in scenes {
        let folder = tempfile::tempdir().unwrap();
        scene.write(folder.path());
        let outcome = compress(folder.path(), &brief(80), &Silent).unwrap();
        let dataset = Dataset::open(folder.path()).unwrap();
        let decoder = Decoder::open(&outcome.bundle).unwrap();
        let evaluation = evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap();
        let mask = scene.mask();
        assert_eq!(evaluation.samples.is_empty(), !mask.valid.contains(&true));
        for &hour in &scene.hours {
            let image = decoder.decode_page(0, hour).unwrap();
            for (i, texel) in image.texels.iter().enumerate().filter(|(i, _)| mask.valid[*i]) {
                assert!(texel.iter().all(|v| v.is_finite()));
                assert!(
                    (texel[1] - 1.0).abs() < 0.3,
                    "{}×{}, {hour} h, texel {i}: {texel:?}",
                    scene.width,
                    scene.height
                );
                assert_eq!(texel[2], 0.0, "a channel that is always zero stays zero");
            }
        }
        let bytes = fs::read(&outcome.bundle).unwrap();
        assert_eq!(Bundle::from_bytes(bytes).unwrap().header, decoder.bundle().header);
    }
}

#[test]
fn between_frames_a_bundle_is_evaluated_by_a_withheld_bake_or_linear_light() {
    // Red grows with the square of the hour: at 12 h it is 2, halfway between those at 8 h and 16 h it would
    // be 19/9; the peak is 2.
    let scene = |hours: &[f64]| Scene {
        width: 40,
        height: 40,
        hours: hours.to_vec(),
        valid: |_, _| true,
        light: |_, _, hour, _| [1.0 + (hour as f32 / 12.0).powi(2), 1.5, 1.5],
    };
    let folder = tempfile::tempdir().unwrap();
    let [root, other] = ["sets", "withheld"].map(|name| folder.path().join(name));
    scene(&[8.0, 16.0]).write(&root);
    scene(&[8.0, 12.0, 16.0]).write(&other);
    let outcome = compress(&root, &brief(400), &Silent).unwrap();
    let [dataset, withheld] = [&root, &other].map(|root| Dataset::open(root).unwrap());
    let decoder = Decoder::open(&outcome.bundle).unwrap();
    let between = |withheld: Option<&Dataset>| {
        evaluate(&dataset, &decoder, Measures { withheld, ..Measures::default() }, &Silent)
            .unwrap()
            .between
            .unwrap()
    };
    let judged = between(Some(&withheld));
    let expected = -10.0 * ((1.0 / 9.0f64).powi(2) / 3.0 / 4.0).log10();
    assert_eq!(judged.points, 1);
    assert!((judged.linear_median_db.unwrap() - expected).abs() < 0.01, "{judged:?} {expected}");
    assert!((judged.median_db - expected).abs() < 0.5, "{judged:?} {expected}");
    assert_eq!(judged.worst, (judged.median_db, 12.0));
    // At 10 h and 14 h. Not at midnight: the lamp is on then.
    let judged = between(None);
    assert_eq!((judged.points, judged.linear_median_db), (2, None));
    assert!((35.0..90.0).contains(&judged.worst.0) && judged.worst.0 <= judged.median_db, "{judged:?}");
    // A bake of other pages is none of this scene.
    let small = folder.path().join("small");
    Scene { width: 39, ..scene(&[12.0]) }.write(&small);
    let small = Dataset::open(&small).unwrap();
    let message =
        evaluate(&dataset, &decoder, Measures { withheld: Some(&small), ..Measures::default() }, &Silent)
            .unwrap_err()
            .to_string();
    assert!(message.contains("small") && message.contains("39 × 40"), "{message}");
}

#[test]
fn a_black_dataset_takes_no_payload() {
    let folder = tempfile::tempdir().unwrap();
    Scene { light: |_, _, _, _| [0.0; 3], ..islands() }.write(folder.path());
    let judged = compress_and_judge(folder.path(), &brief(50), &Silent).unwrap();
    assert_eq!((judged.outcome.tiles, judged.outcome.empty), (4, 4));
    assert_eq!(judged.evaluation.all.psnr_db, None);
    assert_eq!(judged.evaluation.all.black_largest_error, 0.0);
    assert!(judged.evaluation.bytes < 1000);
}

#[test]
fn a_time_limit_of_too_little_and_one_of_more_than_enough() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    // One second is too little for anything, an hour enough for all.
    let steps = |limit: &str, iterations: &str| {
        let arguments = ["--threads", "1", "--iterations", iterations, "--time-limit", limit, "--json"];
        let reported = json(&run(&[&["."], &arguments[..]].concat(), folder.path()));
        assert_eq!((&reported["tiles"], &reported["tiles_empty"]), (&Value::from(4), &Value::from(1)));
        assert!(reported["psnr_db"].as_f64().unwrap() > 25.0, "{reported}");
        let report = fs::read_to_string(folder.path().join("isles.html")).unwrap();
        assert_eq!(report.contains("another run can give different bytes"), limit == "1s");
        [&reported["steps_min"], &reported["steps_max"]].map(|steps| steps.as_u64().unwrap())
    };
    let start = Instant::now();
    let [least, most] = steps("1s", "1000000");
    assert!(200 <= least && least <= most && most < 20_000, "{least} {most}");
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
    assert_eq!(steps("1h", "230"), [230, 230]);
    // Without a limit the same steps give the same bytes; the limit itself stands in the bundle.
    let bundle = || Bundle::open(&folder.path().join("isles.ndgi")).unwrap();
    let limited = bundle();
    compress(folder.path(), &brief(230), &Silent).unwrap();
    let sums = |bundle: &Bundle| bundle.index.iter().map(|entry| entry.maps.checksum).collect::<Vec<_>>();
    assert_eq!(sums(&limited), sums(&bundle()));
    assert!(limited.header.info.contains("\"time_limit_secs\":3600.0"), "{}", limited.header.info);
}

#[test]
fn methods_and_ablations_are_compared_on_one_tile() {
    let folder = tempfile::tempdir().unwrap();
    let hours = vec![0.0, 5.9, 6.0, 12.0];
    Scene { width: 20, height: 12, hours, valid: |x, y| (x + y) % 5 > 0, ..islands() }.write(folder.path());
    for (what, method, control) in
        [("compare", "SVD 4", "SVD 1"), ("--ablations", "hybrid, profile M", "3D map alone, 32²")]
    {
        let arguments =
            ["compare", ".", "--draft", "--flip", "--csv", "c.csv", "--report", "c.html", "--json", what];
        let arguments = if what == "compare" { &arguments[..9] } else { &arguments[..] };
        let reported = json(&run(arguments, folder.path()));
        assert_eq!(
            (&reported["tiles"], &reported["tiles_of"], &reported["frames"]),
            (&1.into(), &1.into(), &4.into())
        );
        assert!((reported["noise_ceiling_db"].as_f64().unwrap() - 60.0).abs() < 20.0);
        let rows = reported["rows"].as_array().unwrap();
        let row = |name: &str| rows.iter().find(|row| row["method"] == name).unwrap();
        let db = |name: &str| row(name)["psnr_db"].as_f64().unwrap();
        assert!(db(method) > db(control) && db(control) > 10.0, "{} {}", db(method), db(control));
        let own = if what == "compare" { "NDGI M" } else { method };
        assert!(db(own) > 50.0, "{}", db(own));
        assert!(rows.is_sorted_by_key(|row| row["bpp"].as_f64().unwrap().to_bits()));
        assert!(rows.iter().all(|row| row["lpips"].is_null()));
        let flip = |name: &str| row(name)["flip"].as_f64().unwrap();
        assert!(0.0 < flip(own) && flip(own) < flip(control) && flip(control) < 0.5, "{what}: {rows:?}");
        let csv = fs::read_to_string(folder.path().join("c.csv")).unwrap();
        assert_eq!(csv.lines().count(), 1 + rows.len());
        let report = fs::read_to_string(folder.path().join("c.html")).unwrap();
        assert!(
            report.contains("<svg") && report.contains("its error × 16") && report.contains("not measured")
        );
    }
    // There is nothing to render, and no such method: told before anything is trained.
    for (what, expected) in [("--render", "has no geometry file"), ("--method=NDGI X", "“NDGI M”")] {
        let output = run(&["compare", ".", "--draft", what], folder.path());
        assert_eq!(output.status.code(), Some(1));
        assert!(String::from_utf8(output.stderr).unwrap().contains(expected), "{what}");
    }
    let output =
        run(&["compare", ".", "--draft", "--method", "svd 2", "--method", "NDGI m", "--json"], folder.path());
    let reported = json(&output);
    let of = reported["rows"].as_array().unwrap().iter().map(|row| row["method"].as_str().unwrap());
    assert_eq!(
        (of.collect::<BTreeSet<_>>(), &reported["rendered"]),
        (["SVD 2", "NDGI M"].into(), &Value::Null)
    );
    // Nothing valid is nothing to compare.
    let empty = folder.path().join("empty");
    Scene { width: 20, height: 12, valid: |_, _| false, ..islands() }.write(&empty);
    let output = run(&["compare", "empty", "--draft"], folder.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("no tile has a valid texel"));
}

#[test]
fn a_sweep_gives_what_compressing_would_give() {
    let folder = tempfile::tempdir().unwrap();
    // No valid texel in the border, and one evaluation tile: both judge the same texels.
    let valid = |x, y| (2..68).contains(&x) && (2..48).contains(&y);
    Scene { width: 70, height: 50, valid, ..islands() }.write(folder.path());
    let arguments = [
        "sweep",
        ".",
        "--presets",
        "draft",
        "--profiles",
        "L,M",
        "--csv",
        "s.csv",
        "--report",
        "s.html",
        "--json",
    ];
    let reported = json(&run(&arguments, folder.path()));
    assert_eq!((&reported["tiles"], &reported["tiles_of"]), (&Value::from(1), &Value::from(1)));
    let rows = reported["rows"].as_array().unwrap();
    let number = |row: usize, key: &str| rows[row][key].as_f64().unwrap();
    assert_eq!([&rows[0]["profile"], &rows[1]["profile"]], ["L", "M"]);
    assert!(number(0, "bpp") < number(1, "bpp") && number(0, "seconds") > 0.0);
    let csv = fs::read_to_string(folder.path().join("s.csv")).unwrap();
    assert_eq!(csv.lines().count(), 3);
    assert!(csv.lines().all(|line| line.split(',').count() == 8), "{csv}");
    assert!(fs::read_to_string(folder.path().join("s.html")).unwrap().contains("<svg"));
    // The same training as that of the bundle, and 8 bits cost little, though at 68 dB they show.
    let compressed = json(&run(&[".", "--preset", "draft", "--json"], folder.path()));
    for key in ["psnr_unquantised_db", "psnr_8bit_features_db"] {
        let of_row = number(1, key);
        assert!((compressed[key].as_f64().unwrap() - of_row).abs() < 1e-9, "{key} {of_row}");
    }
    assert!((number(1, "psnr_unquantised_db") - number(1, "psnr_8bit_features_db")).abs() < 2.0, "{rows:?}");
    assert!((number(1, "psnr_bc7_db") - compressed["psnr_db"].as_f64().unwrap()).abs() < 1e-9, "{rows:?}");
}

#[test]
fn a_quiet_run_says_nothing() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    let reported = |quiet: &[&str]| {
        let output = run(&[&[".", "--iterations", "30"], quiet].concat(), folder.path());
        assert!(output.status.success());
        (output.stdout.len(), output.stderr.len())
    };
    assert_eq!(reported(&["-q"]), (0, 0));
    assert!(reported(&[]).0 > 0);
}

#[test]
fn the_command_line_answers_and_refuses() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(&folder.path().join("isles"));
    // The bake's report stays.
    fs::write(folder.path().join("isles/report.html"), "the bake's").unwrap();
    let reported = json(&run(&["isles", "--iterations", "100", "--profile", "l", "--json"], folder.path()));
    assert_eq!(fs::read_to_string(folder.path().join("isles/report.html")).unwrap(), "the bake's");
    assert_eq!(reported["report"], "isles/isles.html");
    let keys = [
        "psnr_db",
        "psnr_pooled_db",
        "psnr_unquantised_db",
        "noise_ceiling_db",
        "one_minus_ssim",
        "bpp",
        "tiles",
        "seconds",
    ];
    for key in keys {
        assert!(reported[key].is_number(), "{key}: {}", reported[key]);
    }
    let report = fs::read_to_string(folder.path().join(reported["report"].as_str().unwrap())).unwrap();
    for part in ["Training", "Quality", "Decoded and reference", "omitted", "<svg"] {
        assert!(report.contains(part), "{part}");
    }

    let judged =
        json(&run(&["evaluate", "isles", "--json", "--csv", "q.csv", "--threads", "1"], folder.path()));
    assert!((judged["psnr_db"].as_f64().unwrap() - reported["psnr_db"].as_f64().unwrap()).abs() < 1e-9);
    assert!(keys.iter().all(|key| judged.get(key).is_some()));
    let csv = fs::read_to_string(folder.path().join("q.csv")).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    // Four evaluation tiles, of which three hold valid texels, at six hours.
    assert_eq!(csv.lines().count(), 1 + 3 * 6, "{csv}");
    assert!(csv.lines().all(|line| line.split(',').count() == columns));

    // A network that is not there, or that this build cannot run, is an error, not a column without numbers.
    let output = run(&["evaluate", "isles", "--lpips", "alex.onnx"], folder.path());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && message.contains("alex.onnx"), "{message}");

    let output = run(&["decode", "isles/isles.ndgi", "--hour", "18.05", "--out", "x.exr"], folder.path());
    assert!(output.status.success());
    let image = Image::read_exr(&folder.path().join("x.exr")).unwrap();
    let decoder = Decoder::open(&folder.path().join("isles/isles.ndgi")).unwrap();
    assert_eq!(image.texels, decoder.decode_page(0, 18.1).unwrap().texels);
    let output = run(&["decode", "isles/isles.ndgi", "--hour", "18:03", "--out", "x.exr"], folder.path());
    assert!(output.status.success() && Image::read_exr(&folder.path().join("x.exr")).unwrap() == image);
    for wrong in ["24", "30", "-1", "nan", "12:60", "12:5", "24:00", "+1:00", ""] {
        let output =
            run(&["decode", "isles/isles.ndgi", &format!("--hour={wrong}"), "--out", "y.exr"], folder.path());
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && message.contains("from 0 to below 24"), "{wrong}: {message}");
    }
    for into_none in [
        &["decode", "isles/isles.ndgi", "--hour", "3", "--out", "none/y.exr"][..],
        &["isles", "--out", "none/y.ndgi"],
        &["isles", "--report", "none/y.html"],
        &["evaluate", "isles", "--csv", "none/y.csv"],
    ] {
        let output = run(into_none, folder.path());
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && !folder.path().join("none").exists());
        assert!(message.contains("none/y.") && message.contains("none does not exist"), "{message}");
    }
    assert_eq!(json(&run(&["info", "isles/isles.ndgi", "--json"], folder.path()))["profile"], "L");

    for (wrong, reported) in [
        (&["evalute", "isles"][..], "'evaluate'"),
        (&["ifno"], "'info'"),
        (&["missing"], "missing: not a dataset"),
        (&["isles", "--target-psnr", "-4"], "expected a number above 0"),
        (&["isles", "--target-bpp", "-0.5"], "expected a number above 0"),
        (&["isles", "--time-limit", "5"], "such as 90s"),
        (&["isles", "--preset", "fine"], "draft, medium, final"),
        (&["isles", "--preset", "final", "--draft"], "cannot be used with"),
        (&["isles", "--preset", "final", "--iterations", "9"], "cannot be used with"),
    ] {
        let output = run(wrong, folder.path());
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && message.contains(reported), "{wrong:?}: {message}");
    }
    for wrong in [
        &["isles", "--profile", "XL"][..],
        &["isles", "--iterations", "0"],
        &["isles", "--target-psnr", "40", "--target-bpp", "0.5"],
        &["isles", "--target-psnr", "40", "--profile", "L"],
        &["isles", "--target-psnr", "nan"],
        &["isles", "--target-bpp", "0"],
        &["decode", "isles/isles.ndgi", "--hour", "3", "--out", "y.exr", "--page", "1"],
        &["decode", "isles/config.json", "--hour", "3", "--out", "y.exr"],
        &["evaluate", "isles", "--bundle", "missing.ndgi"],
        &[],
    ] {
        let output = run(wrong, folder.path());
        assert!(!output.status.success() && !output.stderr.is_empty(), "{wrong:?}");
    }
    assert!(!folder.path().join("y.exr").exists());

    // What was baked differently is evaluated, with a warning.
    let light: fn(usize, usize, f64, bool) -> [f32; 3] =
        |x, y, h, on| (islands().light)(x, y, h, on).map(|e| 2.0 * e);
    Scene { light, ..islands() }.write(&folder.path().join("isles"));
    let output = run(&["evaluate", "isles"], folder.path());
    let message = String::from_utf8_lossy(&output.stderr);
    let expected = "the bundle was compressed from a different bake; run `compress` again";
    assert!(output.status.success() && message.contains(expected), "{message}");

    // A bundle of other hours is not evaluated against this dataset.
    let other = Scene { hours: vec![0.0, 12.0], ..islands() };
    other.write(&folder.path().join("isles"));
    let output = run(&["evaluate", "isles"], folder.path());
    assert!(String::from_utf8(output.stderr).unwrap().contains("hours"));
}
