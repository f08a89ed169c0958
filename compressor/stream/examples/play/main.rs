//! Streams a dataset's bundle under a budget, headless: see `--help`.

mod args;
mod camera;
mod disk;
mod draw;
mod page;
mod scene;
mod stats;

use args::{Args, Play, Scenario};
use clap::Parser;
use dataset::format::Config;
use dataset::host::files::write_atomically;
use dataset::pictures::Camera;
use dataset::store::Dataset;
use draw::{Frame, Picture, Stage, Whole};
use ndgi::Bundle;
use ndgi::bundle::Header;
use ndgi_stream::gpu::{Files, Runtime, Settings};
use ndgi_stream::{Budgets, Pyramid};
use page::Played;
use scene::Scene;
use serde_json::json;
use stats::Stats;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

type Result<T, E = Box<dyn std::error::Error>> = std::result::Result<T, E>;

/// Frames a second of scene time.
const RATE: f64 = 30.0;
/// The colour of the sky.
const SKY: [u8; 3] = [96, 120, 150];
/// Codes of 255 from which on a pixel counts as lit.
const LIT: u8 = 8;

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<()> {
    let dataset = Dataset::open(&args.dataset)?;
    let config = &dataset.config;
    let finest = args.bundle.clone().unwrap_or_else(|| args.dataset.join(format!("{}.ndgi", config.scene)));
    if !finest.exists() {
        let (path, folder) = (finest.display(), args.dataset.display());
        let what = format!(
            "no such file; write the bundle with `compress {folder} --levels`, or name another with --bundle"
        );
        return Err(format!("{path}: {what}").into());
    }
    let one = Files::beside(&finest).open()?;
    expect_same_scene(&finest, &one.bundle(0).header, config)?;
    if one.bundle(one.levels() - 1).header.pages.iter().any(|page| page.tiles() > 1) {
        let (levels, folder) = (one.levels(), args.dataset.display());
        eprintln!(
            "warning: coarse levels are missing (found {levels}); `compress {folder} --levels` writes them"
        );
    }
    let Some(geometry) = &config.geometry else {
        return Err(format!(
            "{}: the dataset has no geometry; expected a dataset made by `bake`",
            args.dataset.display()
        )
        .into());
    };
    let (device_name, device, queue) = draw::device()?;
    let gpu = (&device, &queue);
    std::fs::create_dir_all(&args.out).map_err(dataset::Error::io(&args.out))?;
    let bundles = (0..one.levels()).map(|level| -> Result<Arc<Bundle>> {
        Ok(Arc::new(Bundle::from_bytes(one.bundle(level).repeated(args.copies)?)?))
    });
    let pyramid = Arc::new(Pyramid::new(bundles.collect::<Result<_>>()?)?);
    let scene = Scene::read(&dataset.path(geometry), args.copies)?;
    let start = Camera::of_manifest(config).next().unwrap_or_else(|| scene.camera());
    let masks = (0..config.pages.len()).map(|page| dataset.mask(page)).collect::<Result<Vec<_>, _>>()?;
    let exposure = Settings::of_view(args.size).exposure;
    let mut whole = Whole::new(gpu, Bundle::open(&finest)?, &masks, pyramid.levels() as u32, exposure)?;
    let on = one.bundle(0).header.timeline.intervals.iter().flatten().map(|[from, _]| *from);
    let switch = on.filter(|from| (17.0..22.0).contains(from)).min_by(f64::total_cmp);
    if switch.is_none() && matches!(args.scenario, Scenario::Switch | Scenario::All) {
        eprintln!(
            "warning: no light group goes on between 17 and 22 h; the scenario `switch` plays around 20 h without a switch"
        );
    }
    let mut all = Vec::new();
    let mut memory = String::new();
    for play in args.plays(switch) {
        let began = Instant::now();
        let played = perform(args, &play, (&pyramid, &scene, &start), gpu, &mut whole, &mut memory)?;
        println!("{}: {:.0} s, {}", play.name, began.elapsed().as_secs_f64(), played.summary);
        all.push(played);
    }
    let summaries: serde_json::Map<_, _> =
        all.iter().map(|played| (played.name.to_owned(), played.summary.clone())).collect();
    let result = json!({
        "scene": config.scene, "device": device_name, "copies": args.copies, "tiles": pyramid.tiles(),
        "tiles_of_level_0": pyramid.bundle(0).index.len(), "levels": pyramid.levels(), "memory": memory,
        "scenarios": summaries,
    });
    write_atomically(&args.out.join("play.json"), &serde_json::to_vec_pretty(&result)?)?;
    let html = page::page(&config.scene, &device_name, &all, &memory);
    write_atomically(&args.out.join("play.html"), html.as_bytes())?;
    println!("{}", args.out.join("play.html").display());
    Ok(())
}

/// An error for a bundle of another scene than the dataset's, or of another resolution.
fn expect_same_scene(bundle: &Path, header: &Header, config: &Config) -> Result<()> {
    if header.scene != config.scene {
        let (found, expected) = (&header.scene, &config.scene);
        return Err(
            format!("{}: a bundle of scene {found:?}; expected {expected:?}", bundle.display()).into()
        );
    }
    let found: Vec<_> = header.pages.iter().map(|page| (page.width, page.height)).collect();
    let expected: Vec<_> =
        config.pages.iter().map(|page| (page.width as usize, page.height as usize)).collect();
    if found != expected {
        let what = format!("pages of {found:?} texels; expected those of the dataset, {expected:?}");
        return Err(format!("{}: {what}", bundle.display()).into());
    }
    Ok(())
}

fn perform(
    args: &Args,
    play: &Play,
    (pyramid, scene, start): (&Arc<Pyramid>, &Scene, &Camera),
    (device, queue): (&wgpu::Device, &wgpu::Queue),
    whole: &mut Whole,
    memory: &mut String,
) -> Result<Played> {
    let [clock, spent] = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
    let reader = Box::new(disk::Simulated::new(play.disk, &clock, &spent));
    let budgets = Budgets { slots: play.slots, features: play.slots + play.slots / 2, ..Budgets::default() };
    let settings = Settings { budgets, ..Settings::of_view(args.size) };
    let mut runtime = Runtime::new(device, queue, Arc::clone(pyramid), reader, settings)?;
    let pages = (pyramid.pages() / args.copies) as u32;
    let stage = Stage::new((device, queue), scene, &runtime, pages, args.size);
    *memory = memory_text(pyramid, &runtime);
    let mut stats = Stats::default();
    let mut pictures = Vec::new();
    let frames = (args.seconds * RATE).round() as usize;
    for number in 0..frames {
        let seconds = number as f64 / RATE;
        clock.store((seconds * 1e6) as u64, Ordering::Relaxed);
        let hour = play.clock.from + play.clock.pace * seconds;
        let camera = camera::at(play.camera, start, scene, seconds, args.size);
        let frame = Frame { camera, copies: scene.in_view(&camera), number: number as u32 };
        let began = Instant::now();
        let mut encoder = device.create_command_encoder(&Default::default());
        stage.look(&frame, runtime.feedback().size());
        let report = runtime.frame(device, queue, &mut encoder, hour)?;
        let thread = began.elapsed().as_secs_f64() - spent.swap(0, Ordering::Relaxed) as f64 * 1e-9;
        stage.draw(&mut encoder, &runtime, &frame);
        runtime.read_back(&mut encoder);
        queue.submit([encoder.finish()]);
        runtime.submitted();
        // Feedback is one frame late, in every run alike.
        device.poll(wgpu::PollType::wait_indefinitely())?;
        for failure in &report.commands.failures {
            eprintln!("warning: {}", failure.what);
        }
        let now = pyramid.at(hour)?;
        stats.frame(&runtime, &report, &now);
        if let Some(row) = stats.rows.last_mut() {
            row.thread_ms = thread * 1000.0;
            row.all_ms = began.elapsed().as_secs_f64() * 1000.0;
            if args.every > 0 && number.is_multiple_of(args.every) {
                let streamed = stage.picture()?;
                whole.decode(hour)?;
                let mut encoder = device.create_command_encoder(&Default::default());
                stage.draw_wholly(&mut encoder, &runtime, whole, &frame);
                queue.submit([encoder.finish()]);
                let (psnr, unlit, codes) = compare(&streamed, &stage.picture()?);
                (row.psnr, row.unlit) = (psnr, Some(unlit));
                let name = format!("{}-{number:04}.png", play.name);
                write_png(&args.out.join(&name), &codes, args.size)?;
                pictures.push(name);
            }
        }
    }
    let summary = stats.summary();
    // The page shows a few of them.
    let step = pictures.len().div_ceil(6).max(1);
    let pictures = pictures.into_iter().step_by(step).collect();
    Ok(Played { name: play.name, stats, summary, pictures })
}

/// Compares two pictures at the exposure of the second. Gives the PSNR in decibels, `None` if no pixel has
/// texels; the number of pixels that are dark in the first alone; and the codes of the first.
fn compare(streamed: &Picture, wholly: &Picture) -> (Option<f64>, usize, Vec<u8>) {
    let luminance = |texel: &[f32; 4]| dataset::pictures::tone::luminance([texel[0], texel[1], texel[2]]);
    let has_texels = |texel: &&[f32; 4]| texel[3] > 0.5;
    let lit = wholly.iter().filter(has_texels);
    let exposure = (dataset::pictures::tone::automatic_exposure(lit.map(luminance)) as f32).exp2();
    let code = |texel: &[f32; 4]| match texel[3] {
        0.5.. => [0, 1, 2].map(|c| dataset::pictures::tone::code(texel[c] * exposure)),
        _ => SKY,
    };
    let codes = |picture: &Picture| -> Vec<u8> { picture.iter().flat_map(code).collect() };
    let [ours, reference] = [codes(streamed), codes(wholly)];
    let (mut sum, mut count) = (0.0, 0usize);
    let mut unlit = 0;
    for (i, texel) in wholly.iter().enumerate().filter(|(_, texel)| has_texels(texel)) {
        for c in 3 * i..3 * i + 3 {
            sum += (f64::from(ours[c]) - f64::from(reference[c])).powi(2);
        }
        count += 3;
        unlit += usize::from(
            luminance(&streamed[i]) < 0.01 * luminance(texel)
                && reference[3 * i..3 * i + 3].iter().all(|code| *code >= LIT),
        );
    }
    let psnr = (count > 0).then(|| dataset::pictures::metrics::psnr_db(255.0, sum / count as f64));
    (psnr, unlit, ours)
}

fn write_png(path: &Path, codes: &[u8], [width, height]: [u32; 2]) -> Result<()> {
    let colour = image::ExtendedColorType::Rgb8;
    let png = dataset::image::encode_png(codes, width as usize, height as usize, colour);
    Ok(write_atomically(path, &png)?)
}

/// The memory on the device, compared with keeping every lightmap there.
fn memory_text(pyramid: &Pyramid, runtime: &Runtime) -> String {
    let header = &pyramid.bundle(0).header;
    let texels: usize = header.pages.iter().map(|grid| grid.width * grid.height).sum();
    let frames = header.timeline.hours.len();
    // BC6H takes a byte a texel; its levels a third more.
    let all = texels as f64 * frames as f64 * 4.0 / 3.0;
    format!(
        "{} tiles of {} levels. On the device {:.0} MB: {} slots, features of {} tiles, page table. All {frames} lightmaps of the day as BC6H with levels: {:.0} MB.",
        pyramid.tiles(),
        pyramid.levels(),
        runtime.bytes() as f64 / 1e6,
        runtime.stream().budgets().slots,
        runtime.stream().budgets().features,
        all / 1e6
    )
}
