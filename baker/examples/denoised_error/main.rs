//! What denoising is worth, and whether its error is estimated truly: two bakes of a scene that differ in
//! seed and samples are compared, layer by layer, in their indirect light.
//! `denoised_error SCENE DATASET REFERENCE_SCENE REFERENCE_DATASET HOURS [--draft] [--peer FOLDER]`; the
//! hours are those of both bakes, which had `--extra-times 0`. What the dataset's layers are filtered to is
//! kept beside them.
//!
//! Of each layer with light: the error of cells of 16×16 texels relative to their own light, median and 95th
//! percentile, before and after; cells that became worse by more than 5 % and by half; by eighths of the
//! reference's brightness the estimated ÷ the true error, before and after; light gained in all, and charts
//! that gained or lost more than three standard errors. The reference's own noise is taken out of what is
//! measured. With `CELLS` in the environment also the cells that became worse by a third. With
//! `--peer FOLDER` another denoiser is judged too (`peer`).

mod peer;

use baker::atlas::owners::Owners;
use baker::bake::errors::CellMap;
use baker::bake::finish::Assembler;
use baker::bake::layers::{Denoiser, Layers};
use baker::bake::output::folder;
use baker::bake::prepare::Part;
use baker::bake::run::{Denoise, Options, Prepared, Preset, prepare, with_worker};
use baker::bake::store::Value;
use baker::light::times::schedule::parse_hours;
use baker::receivers::SurfaceTexels;
use dataset::observe::Silent;
use peer::Peer;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn main() {
    let mut args: Vec<String> = std::env::args().skip(1).collect();
    let is_draft = args.iter().any(|arg| arg == "--draft");
    args.retain(|arg| arg != "--draft");
    let peer = args.iter().position(|arg| arg == "--peer").map(|at| args.drain(at..at + 2).nth(1).unwrap());
    let [scene, out, reference_scene, reference_out, hours] = &args[..] else {
        panic!("expected SCENE DATASET REFERENCE_SCENE REFERENCE_DATASET HOURS [--draft] [--peer FOLDER]")
    };
    let prepared = |scene: &str, out: &str| -> (Prepared, Layers) {
        let options = Options {
            extra_times: 0,
            preset: if is_draft { Preset::Draft } else { Preset::Default },
            out: Some(PathBuf::from(out)),
            denoise: Denoise::Own,
            samples: samples_of(out),
            ..Options::new(parse_hours(hours).unwrap())
        };
        (prepare(Path::new(scene), &options, &Silent).unwrap(), Layers::new(Path::new(out)))
    };
    let (ours, layers) = prepared(scene, out);
    let _lock = folder::lock(Path::new(out)).expect("nobody else writes there");
    let (theirs, reference_layers) = prepared(reference_scene, reference_out);
    let (atlas, _) = ours.atlas().unwrap();
    let texels = layers.texels(&ours.base()).expect("the dataset's layers");
    let cell_map = CellMap::seeing_nothing(&SurfaceTexels::new(&atlas));
    let plan = &ours.plan;
    let assembler =
        Assembler::new(plan, &ours.geometry, &atlas, (&layers, &ours.digests), texels, &cell_map, 4).unwrap();
    let mut denoiser = Denoiser::new(Denoise::METHOD);
    let valid: Vec<bool> = (0..assembler.texels().len()).map(|place| assembler.is_valid(place)).collect();
    let filtered = with_worker(&ours, &atlas, &[], |worker| {
        denoiser.denoise(&worker, &layers, &ours.digests, (assembler.texels(), &valid), &Silent)
    })
    .unwrap();
    let denoised = denoiser.outcome(&filtered);
    println!("{:?}", denoised);
    println!(
        "layer                    median before after | 95 % before after | worse 5 % 50 % | estimated before, after by eighths (darkest first) | light"
    );
    let width = atlas.width as usize;
    let valid: Vec<usize> = (0..assembler.texels().len()).filter(|&i| assembler.is_valid(i)).collect();
    let cell = |i: usize| {
        let index = assembler.texels()[i].index as usize;
        (index / width / 16, index % width / 16)
    };
    let mut peer = peer.map(|folder| {
        let cell_map = with_worker(&ours, &atlas, &[], |worker| CellMap::find(&worker, &Silent));
        let indices = valid.iter().map(|&i| assembler.texels()[i].index as usize).collect();
        Peer::new(PathBuf::from(folder), cell_map.unwrap().0, (width, atlas.height as usize), indices)
    });
    for layer in 0..plan.layers() {
        let Some(filtered) = &filtered[layer] else { continue };
        let before = layers.read(&ours.digests[layer], Part::Rest).unwrap();
        let after = layers.read_filtered(filtered).unwrap();
        let reference = reference_layers.read(&theirs.digests[layer], Part::Rest).unwrap();
        assert_eq!(reference.len(), after.len(), "texels of the reference");
        if let Some(peer) = &mut peer {
            let light = |of: &[Value]| valid.iter().map(|&i| of[i].mean).collect();
            let reference = valid.iter().map(|&i| reference[i]).collect();
            peer.add(layer, plan.name_of(layer), [light(&before), light(&after)], reference);
        }
        let truth = |i: usize| reference[i].mean.as_dvec3();
        let measured = |values: &[Value], i: usize| {
            (values[i].mean.as_dvec3() - truth(i)).length_squared()
                - reference[i].noise.as_dvec3().length_squared()
        };
        let mut cells: BTreeMap<(usize, usize), [f64; 4]> = BTreeMap::new();
        for &i in &valid {
            let sums = cells.entry(cell(i)).or_default();
            sums[0] += measured(&before, i);
            sums[1] += measured(&after, i);
            sums[2] += truth(i).element_sum();
            sums[3] += 3.0;
        }
        let relative = |k: usize| {
            let mut all: Vec<f64> = cells
                .values()
                .filter(|sums| sums[2] > 0.0)
                .map(|sums| (sums[k].max(0.0) / sums[3]).sqrt() / (sums[2] / sums[3]))
                .collect();
            all.sort_by(f64::total_cmp);
            if all.is_empty() { [0.0; 2] } else { [all[all.len() / 2], all[all.len() * 19 / 20]] }
        };
        let (b, a) = (relative(0), relative(1));
        let worse = |by: f64| {
            let count = cells.values().filter(|s| s[1].max(0.0).sqrt() > by * s[0].max(0.0).sqrt()).count();
            100.0 * count as f64 / cells.len() as f64
        };
        if std::env::var("CELLS").is_ok() {
            for (c, s) in &cells {
                if s[1].max(0.0).sqrt() > 1.3 * s[0].max(0.0).sqrt() {
                    let of = valid.iter().filter(|&&i| cell(i) == *c);
                    let estimated: f64 = of.map(|&i| after[i].variance() + after[i].squared_bias()).sum();
                    println!(
                        "  {c:?} {} texels, light {:.3e}, before {:.1} % after {:.1} % estimated {:.1} %",
                        s[3] / 3.0,
                        s[2] / s[3],
                        100.0 * (s[0].max(0.0) / s[3]).sqrt() / (s[2] / s[3]),
                        100.0 * (s[1].max(0.0) / s[3]).sqrt() / (s[2] / s[3]),
                        100.0 * (estimated.max(0.0) / s[3]).sqrt() / (s[2] / s[3])
                    );
                }
            }
        }
        let mut sorted = valid.clone();
        sorted.sort_by(|&a, &b| truth(a).element_sum().total_cmp(&truth(b).element_sum()));
        let estimated = |values: &[Value]| -> String {
            let eighth = |k: usize| {
                let of = &sorted[k * sorted.len() / 8..(k + 1) * sorted.len() / 8];
                let estimated: f64 =
                    of.iter().map(|&i| values[i].variance() + values[i].squared_bias()).sum();
                let is: f64 = of.iter().map(|&i| measured(values, i)).sum();
                if is > 0.0 { format!("{:.2}", (estimated.max(0.0) / is).sqrt()) } else { "-".to_owned() }
            };
            (0..8).map(eighth).collect::<Vec<_>>().join(" ")
        };
        // Charts whose light changed by more than three standard errors.
        let owners = Owners::new(&atlas);
        let mut charts: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
        for &i in &valid {
            let index = assembler.texels()[i].index as usize;
            let Some(chart) = owners.of(index % width, index / width) else { continue };
            let sums = charts.entry(chart).or_default();
            sums[0] += after[i].shift.as_dvec3().element_sum();
            sums[1] += after[i].noise.as_dvec3().element_sum().powi(2);
        }
        let off = charts.values().filter(|s| s[0].abs() > 3.0 * s[1].sqrt()).count();
        let sum =
            |values: &[Value]| valid.iter().map(|&i| values[i].mean.as_dvec3().element_sum()).sum::<f64>();
        println!(
            "{:24} {:6.2} {:6.2} | {:6.2} {:6.2} | {:5.1} {:5.1} | {} | {} | {:+.3} % {}/{}",
            plan.name_of(layer),
            100.0 * b[0],
            100.0 * a[0],
            100.0 * b[1],
            100.0 * a[1],
            worse(1.05),
            worse(1.5),
            estimated(&before),
            estimated(&after),
            100.0 * (sum(&after) / sum(&before) - 1.0),
            off,
            charts.len()
        );
    }
    if let Some(peer) = peer {
        let layers: Vec<usize> = (0..plan.layers()).collect();
        peer.finish(&ours.frames(&layers), serde_json::json!(denoised));
    }
}

/// The samples of the bake, as its manifest tells them.
fn samples_of(out: &str) -> Option<u32> {
    let text = std::fs::read_to_string(Path::new(out).join("config.json")).expect("the dataset's manifest");
    let manifest: serde_json::Value = serde_json::from_str(&text).unwrap();
    manifest["samples"].as_u64().map(|samples| samples as u32)
}
