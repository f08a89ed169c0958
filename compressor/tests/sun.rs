//! The sun as a separate stream: from a dataset that keeps it apart, through the bundle and back, in Rust and
//! in Python.

mod common;

use common::court::{HOURS, Seen, behind_glass, direct, moving, path, write};
use common::{difference, image, python, read};
use compressor::bundle::Bundle;
use compressor::compress::{DRAFT, Options, Rate, Shard, Sharded, compress, train_shard};
use compressor::decode::{Decoder, Lights};
use compressor::evaluate::{Measures, evaluate};
use dataset::format::Light;
use dataset::observe::Silent;
use dataset::store::{Dataset, Writer};
use std::fs;
use std::path::{Path, PathBuf};

fn options(out: &Path) -> Options {
    Options { iterations: 400, out: Some(out.to_owned()), ..Options::of(DRAFT) }
}

#[test]
fn the_sun_goes_through_the_bundle_and_back() {
    for (glass, seen) in [(false, moving as Seen), (true, behind_glass)] {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("court");
        write(&root, seen);
        let dataset = Dataset::open(&root).unwrap();
        let faults = dataset.verify(|| ()).faults;
        assert!(faults.is_empty(), "{faults:?}");
        let out = folder.path().join("court.ndgi");
        compress(&root, &options(&out), &Silent).unwrap();
        let decoder = Decoder::open(&out).unwrap();
        let header = &decoder.bundle().header;
        let sun = header.sun.as_ref().unwrap();
        // Besides the frames where the sun rises and sets, and as many as it takes for shadows to move well.
        let has = |hour: &f64| sun.times.contains(hour);
        assert!([6.1, 9.0, 12.0, 15.0, 18.1].iter().all(has) && header.shadows, "{:?}", sun.times);
        assert!(sun.times.windows(2).all(|pair| pair[1] - pair[0] <= 1.1), "{:?}", sun.times);
        assert!(sun.times[0] > 5.9 && *sun.times.last().unwrap() > 18.9, "{:?}", sun.times);
        assert!(!header.timeline.between.is_empty());

        // A compact layout at a time: two times of three bits a texel and channel, at least.
        for place in header.places().filter(|place| place.column == 1) {
            let (width, height) = header.pages[0].stored(place.column, place.row);
            let held = decoder.bundle().bytes_held_of_sun(place).unwrap() as usize;
            let levels = if glass { 3 } else { 1 } * 2 * width * height * 3 / 8;
            assert!((levels..levels + 5000).contains(&held), "{glass} {held} {levels}");
        }

        // At the frames: three bits of visibility, a degree of the normals.
        let valid = dataset.mask(0).unwrap().valid;
        for hour in [6.1, 9.0, 12.0, 15.0, 18.1] {
            let (found, expected) =
                (decoder.decode_page_of(Lights::Sun, 0, hour).unwrap(), direct(hour, seen));
            let peak = expected.texels.iter().flatten().fold(0.0, |a: f32, b| a.max(*b));
            for i in (0..valid.len()).filter(|&i| valid[i]) {
                for c in 0..3 {
                    let error = (found.texels[i][c] - expected.texels[i][c]).abs();
                    assert!(
                        error < 0.12 * peak,
                        "{glass} {hour} h, texel {i}: {:?} {:?}",
                        found.texels[i],
                        expected.texels[i]
                    );
                }
            }
            let squared =
                |i: usize| (0..3).map(|c| (found.texels[i][c] - expected.texels[i][c]).powi(2)).sum::<f32>();
            let mse =
                (0..valid.len()).filter(|&i| valid[i]).map(squared).sum::<f32>() / (3 * valid.len()) as f32;
            assert!(mse.sqrt() < 0.025 * peak, "{hour} h: {} of {peak}", mse.sqrt());
        }
        // By night there is none; all light is its parts.
        assert!(
            decoder
                .decode_page_of(Lights::Sun, 0, 3.0)
                .unwrap()
                .texels
                .iter()
                .all(|texel| *texel == [0.0; 3])
        );
        for hour in [7.7, 12.0, 19.5] {
            let of = |lights| decoder.decode_page_of(lights, 0, hour).unwrap();
            let [all, baked, sun] = [Lights::All, Lights::Baked, Lights::Sun].map(of);
            for (i, texel) in all.texels.iter().enumerate() {
                assert!(
                    (0..3).all(|c| (texel[c] - baked.texels[i][c] - sun.texels[i][c]).abs()
                        < 1e-4 * texel[c].max(1.0))
                );
            }
            let [x, y] = [40, 30];
            let sample = decoder.sample(0, (x as f64 + 0.5) / 150.0, (y as f64 + 0.5) / 70.0, hour).unwrap();
            let texel = all.texels[y * 150 + x];
            assert!(
                (0..3).all(|c| (sample[c] - texel[c]).abs() < 1e-3 * texel[c].max(0.1)),
                "{sample:?} {texel:?}"
            );
        }

        // What is evaluated: all light, what maps hold, and both are good.
        let evaluation = evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap();
        let baked = evaluation.without_sun.unwrap();
        assert!(baked.psnr_db.unwrap() > 40.0, "{baked:?}");
        assert!(evaluation.sunny.unwrap().psnr_pooled_db.unwrap() > 30.0, "{:?}", evaluation.sunny);
        assert!(evaluation.bytes_of_sun > 0 && evaluation.bytes_of_sun < evaluation.bytes);
        // Between the frames shadows move, better than they fade.
        let shadows = evaluation.shadows.unwrap();
        assert!(shadows.worst_db < shadows.mean_db && evaluation.bytes_of_shadows > 0, "{shadows:?}");
        let still = folder.path().join("still.ndgi");
        compress(&root, &Options { still_shadows: true, ..options(&still) }, &Silent).unwrap();
        let still = Decoder::open(&still).unwrap();
        assert!(!still.bundle().header.shadows);
        let faded = evaluate(&dataset, &still, Measures::default(), &Silent).unwrap();
        let of_faded = faded.shadows.unwrap();
        assert!(faded.bytes_of_shadows == 0 && (8.0..30.0).contains(&of_faded.pooled_db), "{of_faded:?}");
        assert!(shadows.pooled_db > of_faded.pooled_db + 3.0, "{shadows:?} {of_faded:?}");
        // Dusk falls by the curve: at 19.5 h a twentieth of what a straight line has.
        let worst = evaluation.between.unwrap().worst;
        assert!(worst.0 > 25.0, "{worst:?}");

        // A second reader, from the document alone.
        let Some(python) = python() else { continue };
        for hour in [6.05, 7.7, 12.0, 16.3, 18.05, 19.2, 23.0] {
            let (output, npy) = read(&python, &out, &[&format!("--hour={hour}")]);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let error = difference(&decoder, 0, hour, &image(&npy));
            assert!(error <= 2e-4, "{glass} at {hour} h: {error}");
        }
    }
}

/// All of a bundle's tiles by two shards.
fn shards(root: &Path, options: &Options) {
    for number in [2, 1] {
        match train_shard(root, options, Shard { number, of: 2 }, &Silent).unwrap() {
            Sharded::UpToDate(_) => panic!("there is no bundle"),
            Sharded::Trained(note) | Sharded::TrialFits(note) => assert!(note.is_finished()),
        }
    }
}

/// Merges, and runs the shards again as often as the merge asks for it; what it says the first time.
fn merged(root: &Path, options: &Options) -> (Vec<u8>, String) {
    let merge = Options { merge: true, ..options.clone() };
    let mut said = Vec::new();
    while let Err(error) = compress(root, &merge, &Silent) {
        assert!(error.exit_code() == 75 && said.len() < 3, "{error}");
        shards(root, options);
        said.push(error.to_string());
    }
    assert!(!said.is_empty(), "tiles of other light were merged");
    (fs::read(options.out.as_ref().unwrap()).unwrap(), said.swap_remove(0))
}

/// The file of a light at a frame, and other light of the same length as a file: one value, or the same with
/// few bits.
fn exchanged(root: &Path, light: Light, frame: usize, is_slight: bool) -> (PathBuf, [Vec<u8>; 2]) {
    let dataset = Dataset::open(root).unwrap();
    let mut layers = dataset.config.layers.iter().filter(|layer| layer.light == light);
    let file = layers.find_map(|layer| layer.file(frame, 0)).unwrap();
    let mut image = dataset.image(file, 0).unwrap();
    let other = |value: f32| if is_slight { f32::from_bits(value.to_bits() & !0x3fff) } else { 0.25 };
    image.texels.iter_mut().flatten().for_each(|value| *value = other(*value));
    let file = dataset.path(file);
    let (intact, mut other) = (fs::read(&file).unwrap(), image.to_exr());
    assert!(other.len() <= intact.len());
    other.resize(intact.len(), 0);
    (file, [intact, other])
}

/// What shards make while a file holds other light is not merged once the file is restored, nor continued by
/// a single process. (Shards verify no checksums: they read rows, not files.)
#[test]
fn tiles_of_other_light_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, moving);
    // Other light of the sky moves the hours between frames; slightly other light leaves them.
    let cases = [
        (Light::Sky, 7, false, Rate::Usual),
        (Light::Group, 0, true, Rate::Usual),
        (Light::Sky, 4, true, Rate::Psnr(40.0)),
    ];
    for (case, (light, frame, is_slight, rate)) in cases.into_iter().enumerate() {
        let of = |name: &str| Options { rate, iterations: 60, ..options(&folder.path().join(name)) };
        let whole = of(&format!("whole-{case}.ndgi"));
        compress(&root, &whole, &Silent).unwrap();
        let whole = fs::read(whole.out.unwrap()).unwrap();
        let (file, [intact, other]) = exchanged(&root, light, frame, is_slight);
        for is_merge in [true, false] {
            if !is_merge && !matches!(rate, Rate::Usual) {
                continue;
            }
            let options = of(&format!("{case}-{is_merge}.ndgi"));
            fs::write(&file, &other).unwrap();
            shards(&root, &options);
            // While the file is damaged its checksum is wrong, and nobody writes a bundle.
            let damaged =
                compress(&root, &Options { merge: is_merge, ..options.clone() }, &Silent).unwrap_err();
            assert!(damaged.exit_code() == 1 && damaged.to_string().contains("checksum"), "{damaged}");
            fs::write(&file, &intact).unwrap();
            let made = match is_merge {
                true => {
                    let (made, said) = merged(&root, &options);
                    let what = match rate {
                        Rate::Usual => "trained tiles of 2 of 2 ",
                        _ => "trial fits of 2 of 2 ",
                    };
                    assert_eq!(said.contains(what), is_slight, "{said}");
                    made
                }
                false => {
                    compress(&root, &options, &Silent).unwrap();
                    fs::read(options.out.as_ref().unwrap()).unwrap()
                }
            };
            assert!(whole == made, "case {case}, merge {is_merge}");
        }
    }
}

/// A merge measures for a target what training gains: not on tiles of other light that shards of another
/// target left.
#[test]
fn a_target_is_not_measured_on_tiles_of_other_light() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, moving);
    // Both targets take all of what tiles can have, so that they share tiles.
    let of = |name: &str, rate| Options { rate, iterations: 60, ..options(&folder.path().join(name)) };
    let (bits, quality) = (Rate::Bpp(500.0), Rate::Psnr(90.0));
    let whole = of("whole.ndgi", quality);
    compress(&root, &whole, &Silent).unwrap();
    let bits = of("a.ndgi", bits);
    shards(&root, &bits);
    // Chooses.
    let chosen = compress(&root, &Options { merge: true, ..bits.clone() }, &Silent).unwrap_err();
    assert!(chosen.to_string().contains("trained tiles of"), "{chosen}");
    let (file, [intact, other]) = exchanged(&root, Light::Group, 0, false);
    fs::write(&file, &other).unwrap();
    shards(&root, &bits);
    fs::write(&file, &intact).unwrap();
    // It trains both tiles again to measure by them, so that none is missing afterwards.
    let merge = Options { merge: true, ..of("a.ndgi", quality) };
    compress(&root, &merge, &Silent).unwrap();
    assert!(fs::read(whole.out.unwrap()).unwrap() == fs::read(merge.out.unwrap()).unwrap());
}

#[test]
fn a_bundle_of_all_light_is_evaluated_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, moving);
    let with = Dataset::open(&root).unwrap();
    // The same lightmaps, of which nothing is known of the sun: all light goes into the maps.
    let plain = folder.path().join("plain");
    write(&plain, moving);
    let mut config = Dataset::open(&plain).unwrap().config;
    config.visibility = None;
    Writer::create(&plain).unwrap().commit(&config).unwrap();
    let out = folder.path().join("plain.ndgi");
    compress(&plain, &options(&out), &Silent).unwrap();
    // Its layers still tell of the sun's direct light, so it can be omitted.
    let omitted = folder.path().join("left-out.ndgi");
    compress(&plain, &Options { without_sun: true, ..options(&omitted) }, &Silent).unwrap();
    let apart = folder.path().join("apart.ndgi");
    compress(&root, &Options { without_sun: true, ..options(&apart) }, &Silent).unwrap();
    let [omitted, apart] = [omitted, apart].map(|path| Bundle::open(&path).unwrap());
    for place in apart.header.places() {
        assert_eq!(omitted.tile(place).unwrap(), apart.tile(place).unwrap());
    }
    // Where it is in one sum with other light, it cannot.
    let mut config = Dataset::open(&plain).unwrap().config;
    config.layers.clear();
    let summed = folder.path().join("summed");
    write(&summed, moving);
    Writer::create(&summed).unwrap().commit(&config).unwrap();
    let refused = Options { without_sun: true, ..options(&folder.path().join("summed.ndgi")) };
    let error = compress(&summed, &refused, &Silent).unwrap_err().to_string();
    assert!(error.contains("cannot be omitted"), "{error}");
    let decoder = Decoder::open(&out).unwrap();
    assert!(decoder.bundle().header.sun.is_none());
    let judged = |dataset: &Dataset| evaluate(dataset, &decoder, Measures::default(), &Silent).unwrap();
    let (a, b) = (judged(&with), judged(&Dataset::open(&plain).unwrap()));
    assert_eq!((a.all, a.between), (b.all, b.between));
    assert!(a.without_sun.is_none() && a.between.unwrap().median_db > 15.0, "{:?}", a.between);
}

#[test]
fn without_the_sun_nothing_of_it_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, moving);
    let out = folder.path().join("court.ndgi");
    let without = Options { without_sun: true, ..options(&out) };
    compress(&root, &without, &Silent).unwrap();
    let decoder = Decoder::open(&out).unwrap();
    assert!(decoder.bundle().header.sun.is_none());
    assert!(decoder.bundle().index.iter().all(|entry| entry.sun.length == 0));
    let (all, baked) =
        (decoder.decode_page(0, 12.0).unwrap(), decoder.decode_page_of(Lights::Baked, 0, 12.0).unwrap());
    assert_eq!(all, baked);
    // It is compared with the same light of the dataset.
    let dataset = Dataset::open(&root).unwrap();
    let evaluation = evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap();
    assert!(evaluation.all.psnr_db.unwrap() > 40.0 && evaluation.without_sun.is_none());
    assert!(evaluation.remarks().iter().any(|remark| remark.contains("--without-sun")));
    // With the sun it is another bundle, whose maps are the same.
    let with = folder.path().join("with.ndgi");
    compress(&root, &options(&with), &Silent).unwrap();
    let with = Bundle::open(&with).unwrap();
    for place in with.header.places() {
        assert_eq!(with.tile(place).unwrap(), decoder.bundle().tile(place).unwrap());
    }
}

#[test]
fn bytes_do_not_depend_on_threads_or_on_what_a_stopped_run_left() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, behind_glass);
    let bytes = |threads: usize, name: &str| {
        let out = folder.path().join(name);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| compress(&root, &options(&out), &Silent)).unwrap();
        std::fs::read(out).unwrap()
    };
    assert!(bytes(1, "one.ndgi") == bytes(3, "three.ndgi"));
}

/// A number of 0 … 1 that looks random.
fn random(x: usize, y: usize, key: u64) -> f32 {
    let mut z = key ^ ((x as u64) << 32) ^ ((y as u64) << 48) ^ 0x9e37_79b9_7f4a_7c15;
    for _ in 0..2 {
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z ^= z >> 27;
    }
    (z >> 40) as f32 / (1u64 << 24) as f32
}

/// A texel to each state that there is: never, always, the morning, the evening, half, a blink between two
/// frames, a blink at one.
fn states(x: usize, y: usize, hour: f64) -> [f32; 3] {
    let is_lit = match (x + 3 * y) % 7 {
        0 => false,
        1 => true,
        2 => hour < 12.0,
        3 => hour >= 12.0,
        4 => return [0.5; 3],
        5 => (10.5..10.75).contains(&hour),
        _ => hour == 15.0,
    };
    [f32::from(u8::from(is_lit)); 3]
}

/// Noise, chequers that flip, a texel to each state, a slit of one texel, and coloured noise, beside each
/// other.
fn hard(x: usize, y: usize, hour: f64) -> [f32; 3] {
    match x {
        _ if y > 24 => [1.0; 3],
        0..30 => [random(x, y, hour.to_bits()); 3],
        30..60 => [((x + y + (4.0 * hour) as usize) % 2) as f32; 3],
        60..90 => states(x, y, hour),
        90..128 => [f32::from(u8::from(x == 90 + (2.0 * hour) as usize)); 3],
        _ => [1, 2, 3].map(|c| random(x, y, c * hour.to_bits())),
    }
}

#[test]
fn what_sees_the_sun_in_hard_ways_is_met() {
    // Name, what is seen, the most bytes of a texel and time.
    let cases: [(&str, Seen, f64); 3] = [
        ("never", |_, _, _| [0.0; 3], 0.0),
        // (What that takes are the normals of the column.)
        ("always", |_, _, _| [1.0; 3], 0.02),
        ("hard", hard, 0.5),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (name, seen, most) in cases {
        let root = folder.path().join(name).join("court");
        write(&root, seen);
        let dataset = Dataset::open(&root).unwrap();
        let faults = dataset.verify(|| ()).faults;
        assert!(faults.is_empty(), "{name}: {faults:?}");
        let out = folder.path().join(name).join("court.ndgi");
        let options = Options { iterations: 60, ..options(&out) };
        compress(&root, &options, &Silent).unwrap();
        let decoder = Decoder::open(&out).unwrap();
        let header = &decoder.bundle().header;
        let valid = dataset.mask(0).unwrap().valid;
        let places: Vec<usize> = (0..valid.len()).filter(|&i| valid[i]).collect();
        let times = header.sun.as_ref().map_or(0, |sun| sun.times.len());
        let stream: usize = decoder.bundle().index.iter().map(|entry| entry.sun.length as usize).sum();
        println!("{name}: {times} times, {stream} bytes, shadows {}", header.shadows);
        assert!(
            stream as f64 <= most * (places.len() * times) as f64,
            "{name}: {stream} bytes at {times} times"
        );

        let path = path();
        let hours: Vec<f64> = (0..96).map(|i| f64::from(i) / 4.0).collect();
        let mut squared = [0.0; 2];
        for &hour in HOURS.iter().chain(&hours) {
            let found = decoder.decode_page_of(Lights::Sun, 0, hour).unwrap();
            assert!(found.texels.iter().flatten().all(|e| e.is_finite() && *e >= 0.0), "{name} at {hour} h");
            // At most what the sun at its brightest can give.
            let most = path.irradiance.iter().flatten().fold(0.0f32, |a, b| a.max(*b));
            assert!(found.texels.iter().flatten().all(|e| *e <= 1.01 * most), "{name} at {hour} h");
            let expected = direct(hour, seen);
            let is_set = HOURS.contains(&hour);
            for &i in &places {
                let error =
                    (0..3).map(|c| (found.texels[i][c] - expected.texels[i][c]).abs()).fold(0.0, f32::max);
                assert!(!is_set || error <= 0.12 * most, "{name} at {hour} h, texel {i}: wrong by {error}");
                squared[usize::from(is_set)] += f64::from(error * error);
            }
        }
        // Between the frames shadows that move are no worse than shadows that fade.
        let still = folder.path().join(name).join("still.ndgi");
        compress(&root, &Options { out: Some(still.clone()), still_shadows: true, ..options }, &Silent)
            .unwrap();
        let still = Decoder::open(&still).unwrap();
        let mut faded = 0.0;
        for &hour in hours.iter().filter(|hour| !HOURS.contains(hour)) {
            let (found, expected) = (still.decode_page_of(Lights::Sun, 0, hour).unwrap(), direct(hour, seen));
            for &i in &places {
                let error =
                    (0..3).map(|c| (found.texels[i][c] - expected.texels[i][c]).abs()).fold(0.0, f32::max);
                faded += f64::from(error * error);
            }
        }
        println!("  moving {:.1}, faded {faded:.1}", squared[0]);
        assert!(squared[0] <= 1.02 * faded, "{name}: {} moving, {faded} faded", squared[0]);
    }
}
