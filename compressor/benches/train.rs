//! Quality against seconds of the trainer on synthetic tiles:
//! `cargo bench -p compressor --bench train -- [iterations …]`, and with `--kinds` the seconds of tiles that
//! need less than others.
//!
//! Each tile has 128² texels and 26 frames: two moving pole shadows with penumbrae under a sun that follows
//! the day, a sky gradient, and lamps that are off from 6 to 18 h.

use compressor::model::{PROFILES, Profile};
use compressor::tile::{Coverage, Gate, TileSource};
use compressor::train::{Aim, Recipe, train};

fn tile(variant: usize) -> TileSource {
    let hours: Vec<f32> = (0..24).map(|h| h as f32).chain([5.9, 18.1]).collect();
    let mut hours = hours;
    hours.sort_by(f32::total_cmp);
    let v = variant as f32;
    let light = |hour: f32| {
        let day = ((hour - 5.0) / 14.0 * std::f32::consts::PI).sin().max(0.0)
            * f32::from(hour > 5.0 && hour < 19.0);
        let azimuth = (hour - 12.0) / 12.0 * std::f32::consts::PI;
        let lamps = if (6.0..=18.0).contains(&hour) { 0.0 } else { 1.0 };
        let mut texels = Vec::with_capacity(128 * 128);
        for y in 0..128 {
            for x in 0..128 {
                let (px, py) = (x as f32 / 128.0, y as f32 / 128.0);
                let mut sun = day;
                for pole in 0..2 {
                    let (cx, cy) = (0.3 + 0.35 * pole as f32 + 0.03 * v, 0.4 + 0.2 * pole as f32 - 0.05 * v);
                    let (dx, dy) = (px - cx, py - cy);
                    let (sx, sy) = (azimuth.sin(), azimuth.cos() * 0.8 + 0.1);
                    let norm = (sx * sx + sy * sy).sqrt();
                    let along = (dx * sx + dy * sy) / norm;
                    let across = (dx * sy - dy * sx) / norm;
                    let width = 0.02 + 0.01 * v + 0.02 * along.max(0.0);
                    let edge =
                        ((across.abs() - width) / (0.006 + 0.05 * along.max(0.0)) + 0.5).clamp(0.0, 1.0);
                    let end = ((along - 0.5) / 0.05).clamp(0.0, 1.0);
                    let start = (-along / 0.01).clamp(0.0, 1.0);
                    sun *= edge.max(end).max(start);
                }
                let sky = (0.1 + 0.3 * day)
                    * (0.6 + 0.4 * py)
                    * (1.0 - 0.3 * (-((px - 0.5).powi(2) + (py - 0.2).powi(2)) * 30.0).exp());
                let mut texel = [2.0 * sun + 0.5 * sky, 1.8 * sun + 0.7 * sky, 1.5 * sun + sky];
                for lamp in 0..3 {
                    let (lx, ly) = (
                        (0.2 + 0.37 * lamp as f32 + 0.11 * v).fract(),
                        (0.7 + 0.29 * lamp as f32 + 0.07 * v).fract(),
                    );
                    let d = (px - lx).powi(2) + (py - ly).powi(2);
                    let e = lamps * 0.004 / (d + 0.004).powf(1.5) * 0.1;
                    texel = [texel[0] + e, texel[1] + 0.8 * e, texel[2] + 0.5 * e];
                }
                let texture = 1.0 + 0.1 * (x as f32 * 0.9 + v).sin() * (y as f32 * 0.7).cos();
                texels.push(texel.map(|c| (c * texture * 0.3).max(0.0)));
            }
        }
        texels
    };
    TileSource {
        width: 128,
        height: 128,
        hours: hours.iter().map(|&h| h.into()).collect(),
        frames: hours.into_iter().map(light).collect(),
        coverage: vec![Coverage::Valid; 128 * 128],
        gates: vec![],
        neighbours: [true; 4],
    }
}

fn main() {
    let numbers: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    let iterations = if numbers.is_empty() { vec![1000, 2000] } else { numbers };
    let name = std::env::args().skip_while(|a| a != "--profile").nth(1).unwrap_or("M".into());
    let profile = PROFILES.iter().find(|p| p.name == name).expect("a profile");
    if std::env::args().any(|a| a == "--kinds") {
        iterations.into_iter().for_each(|iterations| kinds(profile, iterations));
        return;
    }
    let tiles: Vec<_> = (0..4).map(tile).collect();
    println!("iterations  s/tile (float, all)  ms/iteration  dB unquantised  dB stored");
    for iterations in iterations {
        let (mut float, mut stored, mut seconds, mut all) = (0.0, 0.0, 0.0, 0.0);
        for (i, tile) in tiles.iter().enumerate() {
            let recipe =
                Recipe { iterations, passes: 2, paper: false, seed: 7 + i as u64, aim: Aim::MeanPsnr };
            let start = std::time::Instant::now();
            let trained = train(tile, profile, &recipe).expect("training");
            all += start.elapsed().as_secs_f64() / 4.0;
            float += trained.psnr_unquantised_db.unwrap_or(f64::NAN) / 4.0;
            stored += trained.psnr_db.unwrap_or(f64::NAN) / 4.0;
            let main = trained.curve.iter().find(|p| p.iteration >= iterations).expect("a curve");
            seconds += main.seconds / 4.0;
        }
        println!(
            "{iterations:10}  {seconds:.2} {all:.2}  {:.3}  {float:.2}  {stored:.2}",
            1e3 * seconds / iterations as f64
        );
    }
}

/// Seconds of tiles that have all there is, and of such that lack something.
fn kinds(profile: &Profile, iterations: usize) {
    let whole = tile(0);
    let off = |hour: &f64| (6.0..=18.0).contains(hour);
    let lamps = Gate { group: 0, on: whole.hours.iter().map(|hour| !off(hour)).collect() };
    let noon =
        whole.frames[whole.hours.iter().position(|&hour| hour == 12.0).expect("noon is a set")].clone();
    let by_day: Vec<usize> = (0..whole.hours.len()).filter(|&k| off(&whole.hours[k])).collect();
    let few = |i: usize| if i % 128 < 12 && i / 128 < 10 { Coverage::Valid } else { Coverage::Outside };
    let kinds = [
        ("full", TileSource { gates: vec![lamps], ..whole.clone() }),
        ("no lamps", whole.clone()),
        (
            "by day",
            TileSource {
                hours: by_day.iter().map(|&k| whole.hours[k]).collect(),
                frames: by_day.iter().map(|&k| whole.frames[k].clone()).collect(),
                ..whole.clone()
            },
        ),
        ("static", TileSource { frames: vec![noon; whole.frames.len()], ..whole.clone() }),
        ("120 texels", TileSource { coverage: (0..128 * 128).map(few).collect(), ..whole.clone() }),
        ("black", TileSource { frames: vec![vec![[0.0; 3]; 128 * 128]; whole.frames.len()], ..whole }),
    ];
    println!("{iterations} iterations\ntile  s (all)  ms/iteration  bytes  dB stored");
    for (name, tile) in kinds {
        let recipe = Recipe { iterations, passes: 2, paper: false, seed: 7, aim: Aim::MeanPsnr };
        let start = std::time::Instant::now();
        let trained = train(&tile, profile, &recipe).expect("training");
        let all = start.elapsed().as_secs_f64();
        let main = trained.curve.iter().find(|p| p.iteration >= iterations).map_or(0.0, |p| p.seconds);
        let bytes = trained.params.as_ref().map_or(0, |params| {
            compressor::bundle::encode_payload(params).expect("finite parameters").bytes()
        });
        let db = trained.psnr_db.map_or("–".to_owned(), |db| format!("{db:.1}"));
        println!("{name:10}  {all:.2}  {:.3}  {bytes}  {db}", 1e3 * main / iterations as f64);
    }
}
