//! The sun's visibility along its course, rebuilt to light and compared with light that was traced.

use crate::Stage;
use baker::bake::finish::{Page, VisibilityBaker};
use baker::bake::layers::{Layers, Texel};
use baker::bake::prepare::Part;
use baker::bake::run::{Options, Prepared, prepare};
use baker::bake::samples::Worker;
use baker::light::times::schedule::parse_hours;
use baker::light::times::visibility_times::{VisibilityTimes, sun_path};
use baker::receivers::SurfaceTexels;
use baker::trace::paths::Transport;
use dataset::format::{Between, Normals, Visibility};
use dataset::observe::Silent;
use std::path::Path;

const DAY: [f64; 2] = [7.0, 17.0];

/// The court at its defaults, baked for some hours, and what a bake of the same options would prepare.
fn baked(stage: &Stage, name: &str, hours: &str, samples: u32) -> (Prepared, Layers) {
    let out = stage.path(name);
    let options = Options {
        samples: Some(samples),
        out: Some(out.clone()),
        extra_times: 0,
        ..Options::new(parse_hours(hours).unwrap())
    };
    baker::bake::run::bake(&court(), &options, &Silent).unwrap();
    (prepare(&court(), &options, &Silent).unwrap(), Layers::new(&out))
}

fn court() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/court.toml")
}

/// Finds the visibility of the one page of a bake.
fn find(prepared: &Prepared, layers: &Layers, texels: &[Texel], minutes: f64, force: bool) -> (Page, u64) {
    let scene = &prepared.scene;
    let times = VisibilityTimes::new(scene.sun.as_ref().unwrap(), scene.location.as_ref(), DAY, minutes);
    let (atlas, _) = prepared.atlas().unwrap();
    let lights = prepared.plan.lights(scene, &prepared.geometry, &[]);
    let (receivers, rays) = (SurfaceTexels::new(&atlas), prepared.ray_tracer().unwrap());
    let transport = Transport::new(prepared.space(&rays), &lights, None);
    let worker = Worker { transport, receivers: &receivers, seed: scene.bake.seed, guaranteed_samples: 16 };
    let visibility_baker = VisibilityBaker::new(prepared, &worker, &atlas, layers, texels, &times).unwrap();
    if force {
        std::fs::read_dir(visibility_baker.folder())
            .unwrap()
            .for_each(|file| std::fs::remove_file(file.unwrap().path()).unwrap());
    }
    let mut pages = Vec::new();
    let each = |number: usize, page: Page| {
        assert_eq!(number, pages.len());
        pages.push(page);
        Ok(())
    };
    let counts = visibility_baker.pages(&Silent, each).unwrap();
    assert_eq!(pages.len(), 1);
    (pages.remove(0), counts.visibility)
}

/// The light of an hour, per texel of `texels`, from a page's file, its normals and the sun's path.
fn rebuilt(prepared: &Prepared, page: &Page, file: &Path, texels: &[Texel], hour: f64) -> Vec<[f32; 3]> {
    std::fs::write(file, &page.visibility).unwrap();
    let opened = Visibility::open(file).unwrap();
    let file_of_normals = file.with_extension("png");
    std::fs::write(&file_of_normals, &page.normals).unwrap();
    let normals = Normals::read_png(&file_of_normals).unwrap().normals;
    let scene = &prepared.scene;
    let path = sun_path(scene.sun.as_ref().unwrap(), scene.location.as_ref(), DAY);
    let (between, planes) = (Between::new(&opened.hours, hour), opened.tile(0).unwrap());
    let of_texel = |texel: &Texel| {
        // (The page is less than a tile.)
        let at = texel.index as usize;
        let normal = normals[at];
        let [before, after] = [between.before, between.after].map(|time| planes.level(at, time));
        let part = |c: usize| between.lerp(f32::from(before[c]), f32::from(after[c])) / f32::from(opened.top);
        path.light(hour, normal, std::array::from_fn(part))
    };
    texels.iter().map(of_texel).collect()
}

/// Root of the mean squared difference of green at exposed texels ÷ the greatest light there, in dB.
fn psnr(light: &[[f32; 3]], traced: &[f32], texels: &[Texel]) -> f64 {
    let usable = || (0..texels.len()).filter(|&i| texels[i].usable == 1);
    let peak = usable().map(|i| f64::from(traced[i])).fold(0.0, f64::max);
    let sum: f64 = usable().map(|i| f64::from(light[i][1] - traced[i]).powi(2)).sum();
    -10.0 * (sum / usable().count() as f64 / (peak * peak)).log10()
}

/// Green of what came straight from the sun at a time of a bake.
fn traced(prepared: &Prepared, layers: &Layers, time: usize) -> Vec<f32> {
    let layer = prepared.plan.sun_of[time].unwrap();
    layers.read(&prepared.digests[layer], Part::Direct).unwrap().iter().map(|value| value.mean.y).collect()
}

#[test]
fn light_at_any_time_is_rebuilt() {
    let stage = Stage::new(&[]);
    let (prepared, layers) = baked(&stage, "hours", "7..18", 16);
    let texels = layers.texels(&prepared.base()).unwrap();
    let (withheld, other) = baked(&stage, "withheld", "8.37,10.8,13.13,15.45", 512);
    // Of other samples there are other digests, and the same texels.
    let places =
        |texels: &[Texel]| texels.iter().map(|texel| (texel.index, texel.usable)).collect::<Vec<_>>();
    assert_eq!(places(&texels), places(&other.texels(&withheld.base()).unwrap()));
    let file = stage.path("page.vis");
    // Reached with this seed: 45.6 and 43.2 dB, 52.9 and 43.8; at the hours the layers' own noise counts.
    let mut reached = Vec::new();
    for (minutes, least, at_the_hours) in [(15.0, 43.0, 41.0), (2.5, 50.0, 41.5)] {
        // (The bake itself kept tiles by quarters of an hour.)
        let (page, rays) = find(&prepared, &layers, &texels, minutes, true);
        assert!(rays > 0);
        let worst = |prepared: &Prepared, layers: &Layers| {
            let of = |time: usize| {
                let hour = prepared.plan.times[time].hour;
                let light = rebuilt(prepared, &page, &file, &texels, hour);
                psnr(&light, &traced(prepared, layers, time), &texels)
            };
            (0..prepared.plan.times.len()).map(of).fold(f64::INFINITY, f64::min)
        };
        let between = worst(&withheld, &other);
        let hours = worst(&prepared, &layers);
        println!(
            "{minutes} min: {} bytes, {rays} rays, {between:.1} dB between, {hours:.1} dB at the hours",
            page.visibility.len()
        );
        assert!(
            between >= least && hours >= at_the_hours,
            "{minutes} min: {between} dB, at the hours {hours} dB"
        );
        // Finished tiles are kept; without them, and on one thread, all comes out the same.
        let (again, none) = find(&prepared, &layers, &texels, minutes, false);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let (alone, as_many) = pool.install(|| find(&prepared, &layers, &texels, minutes, true));
        assert_eq!((none, as_many), (0, rays));
        for other in [again, alone] {
            assert!(other.visibility == page.visibility && other.normals == page.normals);
        }
        reached.push(between);
    }
    assert!(reached[1] > reached[0]);
}

#[test]
fn light_between_the_hours_is_better_than_between_lightmaps() {
    let stage = Stage::new(&[]);
    let (prepared, layers) = baked(&stage, "hours", "7..18", 16);
    let (withheld, other) = baked(&stage, "withheld", "8.37,10.8,13.13,15.45", 512);
    let texels = layers.texels(&prepared.base()).unwrap();
    let (page, _) = find(&prepared, &layers, &texels, 2.5, false);
    for (time, hour) in [8.37_f64, 10.8, 13.13, 15.45].into_iter().enumerate() {
        let truth = traced(&withheld, &other, time);
        let before = hour as usize - 7;
        let [a, b] = [before, before + 1].map(|time| traced(&prepared, &layers, time));
        let part = hour.fract() as f32;
        let linear: Vec<[f32; 3]> = a.iter().zip(&b).map(|(a, b)| [a + (b - a) * part; 3]).collect();
        let light = rebuilt(&withheld, &page, &stage.path("page.vis"), &texels, hour);
        let (found, linear) = (psnr(&light, &truth, &texels), psnr(&linear, &truth, &texels));
        println!("{hour} h: {found:.1} dB, {linear:.1} dB between lightmaps");
        assert!(found > linear + 12.0, "{hour} h: {found} dB, {linear} dB between lightmaps");
    }
}
