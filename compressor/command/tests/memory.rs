//! The largest page there is room for goes through `compress` and `evaluate` in bounded memory.

use dataset::format::{Config, FORMAT, Frame, Page, VERSION};
use dataset::image::{Mask, exr_of};
use dataset::store::Writer;
use std::ops::Range;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Side of the page.
const SIDE: usize = 16384;
/// Frames, all of them different.
const SETS: usize = 26;
/// Most memory of either command.
const LIMIT: u64 = 2 << 30;
/// Three islands far apart: within a tile, across the corner of four, and in the last corner of the page:
/// left, top, side.
const ISLANDS: [[usize; 3]; 3] = [[40, 40, 60], [8130, 8130, 120], [SIDE - 70, SIDE - 70, 70]];

/// Calls `each` with the columns of every island that has texels in row `y`.
fn islands(y: usize, mut each: impl FnMut(Range<usize>)) {
    let crossed = ISLANDS.iter().filter(|[_, top, side]| (*top..top + side).contains(&y));
    crossed.for_each(|[left, _, side]| each(*left..left + side));
}

/// Light of frame k.
fn light(x: usize, y: usize, k: usize) -> [f32; 3] {
    let wave = 1.0 + 0.5 * (0.05 * (x + 3 * k) as f32).sin();
    [wave, 1.0 + (y % 128) as f32 / 128.0, 0.5 + k as f32 / SETS as f32]
}

fn write(root: &Path) {
    let mut writer = Writer::create(root).unwrap();
    let mut mask = Mask { width: SIDE, height: SIDE, valid: vec![false; SIDE * SIDE] };
    for (y, row) in mask.valid.chunks_exact_mut(SIDE).enumerate() {
        islands(y, |columns| row[columns].fill(true));
    }
    let mask = writer.add("mask", "png", &mask.to_png()).unwrap();
    let mut set = |k: usize| {
        let fill = |y: usize, row: &mut [[f32; 3]]| {
            row.fill([0.0; 3]);
            islands(y, |columns| columns.for_each(|x| row[x] = light(x, y, k)));
        };
        let file = writer.add(&format!("map-{k}"), "exr", &exr_of(SIDE, SIDE, fill)).unwrap();
        let maps = vec![file];
        Frame { hour: k as f64 * 24.0 / SETS as f64, groups_on: vec![], relative_error: None, maps }
    };
    let frames = (0..SETS).map(&mut set).collect();
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        instances: Vec::new(),
        scene: "plain".to_owned(),
        generator: "test".to_owned(),
        unit: "arbitrary".to_owned(),
        seed: 1,
        inputs: "0".repeat(64),
        samples: 1,
        pages: vec![Page::atlas(SIDE as u32, SIDE as u32, mask)],
        sun: None,
        sky: None,
        groups: vec![],
        layers: vec![],
        frames,
        noise: None,
        geometry: None,
        settings: serde_json::json!({}),
        source: None,
        sun_path: None,
        visibility: None,
        transfer: None,
    };
    writer.commit(&config).unwrap();
}

/// Runs the command; the most memory that it had resident, in bytes, and its PSNR.
fn peak(arguments: &[&str], folder: &Path) -> (u64, f64) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_compress"));
    let mut child = command.args(arguments).current_dir(folder).stdout(Stdio::piped()).spawn().unwrap();
    let mut peak = 0;
    // The system forgets it with the process, so it is requested while the command runs.
    let status = loop {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
        peak = peak.max(1024 * kilobytes.unwrap_or(0));
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(status.success() && peak > 0);
    let reported: serde_json::Value = serde_json::from_reader(child.stdout.unwrap()).unwrap();
    (peak, reported["psnr_db"].as_f64().unwrap())
}

#[test]
#[ignore = "writes 1.4 GB and takes minutes: cargo test --release -p compress --test memory -- --ignored --nocapture"]
fn a_page_of_16384_streams_through_in_two_gibibytes() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    for command in [&[".", "--iterations", "200"][..], &["evaluate", "."]] {
        let (bytes, psnr) = peak(&[command, &["--threads", "2", "--json"]].concat(), folder.path());
        println!("{command:?}: {} MiB, {psnr} dB", bytes >> 20);
        assert!(bytes < LIMIT && psnr > 25.0, "{command:?}: {bytes} bytes, {psnr} dB");
    }
}
