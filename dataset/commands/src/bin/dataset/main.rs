//! `dataset`: shows and verifies datasets, converts them from and to other layouts, and packages them for
//! release.

mod exchange;
mod halve;
mod release;

use clap::{Parser, Subcommand};
use commands::console::{Console, ConsoleArgs, catch_interrupts, fail, refuse_arguments_not_utf8};
use dataset::exchange::lightmaps_of;
use dataset::format::{Config, Daylight, Layer, Visibility};
use dataset::halve::extent;
use dataset::image::Mask;
use dataset::observe::{Meter, count};
use dataset::store::{Dataset, Verification};
use dataset::{Error, Result};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Shows and verifies datasets of temporal lightmaps; converts from and to other layouts; halves their
/// resolution; packages them for release.
#[derive(Parser)]
#[command(
    name = "dataset",
    version,
    after_help = "\
Examples:
  dataset info dataset/yard            scene, pages, hours, light groups, sizes
  dataset check dataset/yard           every checksum and texel; lists each fault
  dataset check dataset/yard --json    the same as JSON; exit code 1 if there are faults
  dataset import contest --layout hprc2 --out dataset/contest
  dataset import renders --pattern 'light_{hour}.exr' --mask renders/mask.png --out dataset/hall
  dataset export dataset/yard --layout hprc1 --out yard-hprc1
  dataset halve dataset/yard --out dataset/yard-1    half the resolution: a coarser level for virtual texturing
  dataset release dataset/yard dataset/city --cc0 --out release
  dataset verify release               every checksum and all archives

Exit codes: 0 success; 1 a fault or other invalid input, 2 an invalid command line: do not retry; 75 retry later (the disk is full, a file
server is away, a file changed while it was packed); 143, 130, 129 ended by SIGTERM, Ctrl-C, a closed terminal."
)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    console: ConsoleArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Prints what a dataset contains.
    ///
    /// With --json, one object: scene, generator, unit, seed, samples, files, bytes, pages [{width, height,
    /// valid_texels}], level (how often its resolution was halved, or null), version (of the manifest on
    /// disk), sun and sky (what is baked of them, or null), groups [{name, on, baked}], frames [{hour, on,
    /// relative_error}], layers [{light, group, part, images, curve}], sun_path (true if present), visibility
    /// (of the sun, or null: {minutes, times, bytes}), source (of an imported dataset, or null: {layout,
    /// replaced_values, lightmaps [{id, level}]}), transfer (of a scene's transfer, or null: {scene,
    /// functions, times}).
    #[command(after_help = "Example:\n  dataset info dataset/yard --json")]
    Info {
        /// The dataset: the folder with config.json.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Verifies everything that readers rely on and lists each fault.
    ///
    /// Checks the manifest, each file's length and checksum, masks, estimated errors, the sun's path and
    /// visibility, the geometry (a complete GLB, indices and lightmap coordinates in range, pages that
    /// exist), that all texels are finite and not negative, that each frame's light groups are on as their
    /// schedules say, and, where layers are stored, that each lightmap is (sun + sky) + local: bit for bit,
    /// or within 1/1024 on surfaces in imported datasets. Warns of switches without a frame close by, and of
    /// files that killed processes left behind. With --json, one object: ok, faults [text], warnings [text],
    /// files, bytes, frames, dead_texels [per page; null where unknown], seconds.
    #[command(after_help = "Example:\n  dataset check dataset/yard")]
    Check {
        /// The dataset: the folder with config.json.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Makes a dataset from lightmaps in another layout.
    ///
    /// FROM is a folder in the layout hprc1 or hprc2, a folder of EXR files (float or half; R, G, B, or names
    /// such as Layer.R, red, Y), or a TOML file:
    ///
    ///   unit = "kilolux"            # optional; so are [[group]] and, without masks, [[page]]
    ///   layer = "Combined"          # for EXR files with several layers
    ///   [[page]]
    ///   mask = "mask.png"
    ///   [[frame]]
    ///   hour = 5.9
    ///   files = ["dawn.exr"]        # one per page
    ///   [[group]]
    ///   name = "lamps"
    ///   on = [[18.0, 6.0]]
    ///
    /// Texels are copied exactly. Values that are negative or not finite become 0 outside the masks; on
    /// surfaces they are an error. With --json, one object: out, layout, scene, pages, hours, groups, layers,
    /// replaced_values, seconds.
    #[command(
        verbatim_doc_comment,
        after_help = "\
Examples:
  dataset import contest --layout hprc2 --out dataset/contest
  dataset import renders --pattern 'light_{hour}.exr' --mask renders/mask.png --out dataset/hall
  dataset import renders/hall.toml --out dataset/hall"
    )]
    Import(exchange::Import),
    /// Writes a dataset in the layout hprc1 or hprc2.
    ///
    /// Lists what the layout cannot store. A dataset that was imported from the same layout gives the same
    /// bytes again. With --json, one object: out, layout, lightmaps, hours, omitted [text], files, bytes,
    /// seconds.
    #[command(after_help = "\
Examples:
  dataset export dataset/yard --layout hprc1 --out yard-hprc1
  dataset export dataset/yard --layout hprc2 --out yard-hprc2")]
    Export(exchange::Export),
    /// Makes a dataset of half the resolution: a coarser level for virtual texturing.
    ///
    /// A page of w × h texels becomes one of ⌈w/2⌉ × ⌈h/2⌉. A texel's light is the mean of the valid texels
    /// among the four it covers. Texel position p becomes p/2. Layers, visibility and normals are halved, and
    /// frames are summed from the halved layers. Estimated errors are omitted: that of a mean is unknown.
    /// All else is copied. The result is a full dataset: halve it again for the next level.
    /// `compress --levels` makes bundles of all levels. A transfer cannot be halved. With --json, one object:
    /// out, scene, level (how often it was halved), pages [[width, height]], files, bytes, seconds.
    #[command(after_help = "\
Examples:
  dataset halve dataset/yard --out dataset/yard-1
  dataset halve dataset/yard-1 --out dataset/yard-2
  compress dataset/yard-1 --out yard.1.ndgi")]
    Halve(halve::Halve),
    /// Packages datasets for release: archives, bundles, pictures, datasheets, checksums.
    ///
    /// Per scene: SCENE-sets.tar.zst (manifest, masks, lightmaps, geometry), one archive for each of sun,
    /// sky and lamps where layers are stored, the bundles (*.ndgi) found in its folder, pictures, a datasheet
    /// SCENE.md. Also release.json, read_dataset.py and SHA256SUMS. Equal datasets give equal bytes. Each
    /// dataset is checked first; a stopped or failed command leaves nothing behind. With --json, one object:
    /// out, scenes, omitted [text], files, bytes, seconds.
    #[command(after_help = "\
Examples:
  dataset release dataset/yard dataset/city --out release
  dataset release dataset/yard --layout hprc1 --layout hprc2 --out release")]
    Release(release::Release),
    /// Verifies a release, or a dataset unpacked from one.
    ///
    /// Checks that a release's files match SHA256SUMS, and that the archives contain what release.json and
    /// each dataset's manifest say; nothing is unpacked to disk. A folder with config.json is verified as by
    /// `check`. With --json, one object: ok, faults [text], scenes, files, bytes, seconds; for an unpacked
    /// dataset, the object of `check`.
    #[command(after_help = "\
Examples:
  dataset verify release
  dataset verify yard          unpacked from yard-sets.tar.zst")]
    Verify {
        /// A folder with SHA256SUMS or config.json.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

fn main() -> ExitCode {
    refuse_arguments_not_utf8::<Arguments>();
    let arguments = Arguments::parse();
    catch_interrupts();
    let console = Console::new(arguments.console);
    let result = match &arguments.command {
        Command::Info { folder } => info(&console, folder).map(|()| ExitCode::SUCCESS),
        Command::Check { folder } => check(&console, folder),
        Command::Import(import) => import.run(&console).map(|()| ExitCode::SUCCESS),
        Command::Export(export) => export.run(&console).map(|()| ExitCode::SUCCESS),
        Command::Halve(halve) => halve.run(&console).map(|()| ExitCode::SUCCESS),
        Command::Release(release) => release.run(&console).map(|()| ExitCode::SUCCESS),
        Command::Verify { folder } if folder.join(dataset::store::MANIFEST).is_file() => {
            check(&console, folder)
        }
        Command::Verify { folder } => release::verify_release(&console, folder),
    };
    result.unwrap_or_else(|error| fail(&error))
}

fn info(console: &Console, folder: &Path) -> Result<()> {
    let dataset = Dataset::open(folder)?;
    let config = &dataset.config;
    let valid: Vec<usize> = dataset.masks()?.iter().map(Mask::count).collect();
    let (files, bytes) = extent(config);
    let lightmaps = lightmaps_of(&dataset)?;

    match &config.source {
        None => console.print(format!(
            "{}: written by {}, seed {}, format version {}",
            config.scene, config.generator, config.seed, config.version
        )),
        Some(source) => {
            let (by, layout) = (&config.generator, &source.layout);
            console.print(format!("{}: imported from the layout {layout} by {by}", config.scene));
            if source.replaced_values > 0 {
                let replaced = count(source.replaced_values as usize, "value");
                console
                    .print(format!("  {replaced} outside the masks were negative or not finite and are 0"));
            }
        }
    }
    let level = config.halved().map(|halved| halved.times);
    if let Some(level) = level {
        console
            .print(format!("  level {level}: the resolution was halved {}", count(level as usize, "time")));
    }
    let transfer = config.transfer.as_ref().map(|transfer| {
        let functions = transfer.light.first().map_or(0, |light| light.coefficients.len());
        (&transfer.scene, functions, transfer.light.len())
    });
    if let Some((scene, functions, times)) = transfer {
        let times = count(times, "time");
        console.print(format!(
            "  transfer of {scene}: each frame is the positive or negative part of one of {functions} functions; light of {times}"
        ));
    }
    let names = lightmaps.as_deref().unwrap_or_default();
    for (index, (page, valid)) in config.pages.iter().zip(&valid).enumerate() {
        let share = 100.0 * *valid as f64 / (f64::from(page.width) * f64::from(page.height));
        let name = names.get(index).map_or(String::new(), |lightmap| format!("  {lightmap}"));
        console
            .print(format!("  page   {}×{} texels, {share:.1} % on surfaces{name}", page.width, page.height));
    }
    for group in &config.groups {
        let on: Vec<String> = group.on.iter().map(|[from, to]| format!("{from} to {to} h")).collect();
        let on = if on.is_empty() { "never on".to_owned() } else { format!("on {}", on.join(", ")) };
        console.print(format!("  light group {}: {on}", group.name));
    }
    for frame in &config.frames {
        let on: Vec<&str> = config.names_on(frame).collect();
        let on = if on.is_empty() { "no light group".to_owned() } else { on.join(", ") };
        let error =
            frame.relative_error.map_or(String::new(), |error| format!("  error {:.2} %", 100.0 * error));
        console.print(format!("  frame  {:>7} h  {on}{error}", frame.hour));
    }
    for layer in &config.layers {
        let light = group_of(config, layer).unwrap_or(layer.light.name());
        let (part, images) = (layer.part.name(), count(layer.files().count(), "image"));
        let curve = if layer.curve.is_some() { ", with a curve between frames" } else { "" };
        console.print(format!("  layer  {light}, {part}: {images}{curve}"));
    }
    let visibility = visibility_of(&dataset)?;
    if let Some((minutes, times, bytes)) = visibility {
        let megabytes = bytes as f64 / 1e6;
        let times = count(times, "time");
        console.print(format!(
            "  sun's visibility: {times}, every {minutes} min where it changes, {megabytes:.2} MB with normals"
        ));
    }
    console.print(format!("  {}, {:.1} MB; unit: {}", count(files, "file"), bytes as f64 / 1e6, config.unit));

    let frames = config.frames.iter().map(|frame| {
        json!({ "hour": frame.hour, "on": config.names_on(frame).collect::<Vec<_>>(), "relative_error": frame.relative_error })
    });
    let pages =
        config.pages.iter().zip(&valid).map(
            |(page, valid)| json!({ "width": page.width, "height": page.height, "valid_texels": valid }),
        );
    let groups =
        config.groups.iter().map(|group| json!({ "name": group.name, "on": group.on, "baked": group.baked }));
    let baked = |light: Option<Daylight>| light.map(|light| light.baked);
    let layers = config.layers.iter().map(|layer| {
        json!({
            "light": layer.light,
            "group": group_of(config, layer),
            "part": layer.part,
            "images": layer.files().count(),
            "curve": layer.curve.is_some(),
        })
    });
    console.result(&json!({
        "scene": config.scene,
        "generator": config.generator,
        "unit": config.unit,
        "seed": config.seed,
        "samples": config.samples,
        "files": files,
        "bytes": bytes,
        "pages": pages.collect::<Vec<_>>(),
        "level": level,
        "version": config.version,
        "sun": baked(config.sun),
        "sky": baked(config.sky),
        "groups": groups.collect::<Vec<_>>(),
        "frames": frames.collect::<Vec<_>>(),
        "layers": layers.collect::<Vec<_>>(),
        "sun_path": config.sun_path.is_some(),
        "visibility": visibility.map(|(minutes, times, bytes)| json!({
            "minutes": minutes,
            "times": times,
            "bytes": bytes,
        })),
        "source": config.source.as_ref().map(|source| json!({
            "layout": source.layout,
            "replaced_values": source.replaced_values,
            "lightmaps": lightmaps.unwrap_or_default().iter()
                .map(|lightmap| json!({ "id": lightmap.id, "level": lightmap.level }))
                .collect::<Vec<_>>(),
        })),
        "transfer": transfer.map(|(scene, functions, times)| json!({
            "scene": scene,
            "functions": functions,
            "times": times,
        })),
    }))?;
    Ok(())
}

/// The finest step of the sun's visibility in minutes, its times and the bytes of its files, if there are
/// any.
fn visibility_of(dataset: &Dataset) -> Result<Option<(f64, usize, u64)>> {
    let Some(visibility) = &dataset.config.visibility else { return Ok(None) };
    let opened = Visibility::open(&dataset.verified(&visibility.files[0])?)?;
    let bytes = visibility.references().map(|file| file.bytes).sum();
    Ok(Some((visibility.minutes, opened.hours.len(), bytes)))
}

fn check(console: &Console, folder: &Path) -> Result<ExitCode> {
    let start = std::time::Instant::now();
    // Lengths are part of the check, so that one missing file does not hide the others.
    let (opened, verification) = match Dataset::read_manifest(folder) {
        Ok((dataset, faults)) if faults.is_empty() => {
            let progress = console.progress("checking", dataset.verify_steps() as u64);
            let verification = dataset.verify(|| progress.advance(1));
            (Some(dataset), verification)
        }
        // Without a valid manifest, only the files' presence and checksums can be verified.
        Ok((dataset, mut faults)) => {
            faults.extend(dataset.verify_files(|| ()).0);
            (Some(dataset), Verification { faults, ..Verification::default() })
        }
        Err(fault @ (Error::Invalid { .. } | Error::Unsupported { .. })) => {
            (None, Verification { faults: vec![fault], ..Verification::default() })
        }
        Err(error) => return Err(error),
    };
    if dataset::host::signals::interrupted() {
        return Err(Error::Interrupted);
    }
    for fault in &verification.faults {
        console.error(fault);
    }
    for warning in &verification.warnings {
        console.warn(warning);
    }
    for (page, dead) in verification.dead_texels.iter().enumerate() {
        if let Some(dead @ 1..) = dead {
            console.say(format!("page {page}: {} on surfaces black in every frame", count(*dead, "texel")));
        }
    }
    let (files, bytes) = opened.as_ref().map_or((0, 0), |dataset| extent(&dataset.config));
    let frames = opened.as_ref().map_or(0, |dataset| dataset.config.frames.len());
    let faults: Vec<String> = verification.faults.iter().map(ToString::to_string).collect();
    let ok = faults.is_empty();
    let found = match ok {
        true => format!("{}, {}: no fault", count(frames, "frame"), count(files, "file")),
        false => count(faults.len(), "fault"),
    };
    console.say(format!("{}: {found}", folder.display()));
    console.result(&json!({
        "ok": ok,
        "faults": faults,
        "warnings": verification.warnings,
        "files": files,
        "bytes": bytes,
        "frames": frames,
        "dead_texels": verification.dead_texels,
        "seconds": start.elapsed().as_secs_f64(),
    }))?;
    Ok(exit_code(&verification.faults))
}

/// 75 if all faults can go away by themselves, such as those of a file server that is away.
pub(crate) fn exit_code(faults: &[Error]) -> ExitCode {
    ExitCode::from(faults.iter().map(Error::exit_code).min().unwrap_or(0))
}

/// The name of a layer's light group.
fn group_of<'a>(config: &'a Config, layer: &Layer) -> Option<&'a str> {
    Some(&config.groups.get(layer.group? as usize)?.name)
}
