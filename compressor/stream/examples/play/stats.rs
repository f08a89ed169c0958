//! What is measured of a scenario.

use ndgi_stream::gpu::{Report, Runtime};
use ndgi_stream::{Entry, Now, Pyramid, Seen, Tile};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Frames within which a tile that was evicted and is requested again counts as a mistake.
const AGAIN: usize = 60;

/// One frame.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// Of the pixels, and of the tiles, that the frame's feedback saw: the share that was shown at the level
    /// it requested.
    pub hits_by_pixels: f64,
    pub hits_by_tiles: f64,
    pub tiles: usize,
    /// Tiles that were requested the first time since they were gone.
    pub faults: usize,
    pub faults_again: usize,
    pub decoded: usize,
    pub suns: usize,
    pub loaded: usize,
    pub bytes: u64,
    pub evictions: usize,
    pub mip_bias: f64,
    /// Relative change of light since it was decoded, the mean over pixels.
    pub staleness: f64,
    /// Milliseconds of the frame's thread in the runtime, and of device and all.
    pub thread_ms: f64,
    pub all_ms: f64,
    /// Of frames that are compared: decibels to the fully decoded one, and pixels that are dark and should
    /// not be.
    pub psnr: Option<f64>,
    pub unlit: Option<usize>,
}

/// What is known from frame to frame.
#[derive(Debug, Default)]
pub struct Stats {
    pub rows: Vec<Row>,
    /// Since when a tile that is not shown is requested.
    asked: BTreeMap<Tile, usize>,
    /// Frames from request to shown.
    waits: Vec<usize>,
    gone: BTreeMap<Tile, usize>,
    /// The table when the frame was drawn of which feedback is awaited.
    shown: Vec<Entry>,
}

impl Stats {
    /// Takes up a frame's report. Its feedback is of the frame before.
    pub fn frame(&mut self, runtime: &Runtime, report: &Report, now: &Now) {
        let pyramid = runtime.stream().pyramid();
        let frame = self.rows.len();
        if let (Some(seen), Some(row)) = (&report.seen, self.rows.last_mut()) {
            let is_hit = |seen: &&Seen| is_exact(pyramid, self.shown[seen.tile.0 as usize], seen.tile);
            let pixels =
                |of: &mut dyn Iterator<Item = &Seen>| of.map(|seen| f64::from(seen.pixels)).sum::<f64>();
            row.tiles = seen.len();
            row.hits_by_tiles = seen.iter().filter(is_hit).count() as f64 / seen.len().max(1) as f64;
            row.hits_by_pixels = pixels(&mut seen.iter().filter(is_hit)) / pixels(&mut seen.iter()).max(1.0);
        }
        let mut row = Row { mip_bias: report.commands.mip_bias.into(), ..Row::default() };
        for tile in &report.commands.evictions {
            self.gone.insert(*tile, frame);
        }
        for seen in report.seen.iter().flatten() {
            let exact = is_exact(pyramid, runtime.stream().entry(seen.tile), seen.tile);
            if !exact && !self.asked.contains_key(&seen.tile) {
                self.asked.insert(seen.tile, frame);
                row.faults += 1;
                row.faults_again +=
                    usize::from(self.gone.get(&seen.tile).is_some_and(|gone| frame - gone <= AGAIN));
            }
        }
        let stream = runtime.stream();
        let waits = &mut self.waits;
        self.asked.retain(|tile, since| {
            let waits_still = !is_exact(pyramid, stream.entry(*tile), *tile);
            if !waits_still {
                waits.push(frame - *since);
            }
            waits_still
        });
        let (mut sum, mut pixels) = (0.0, 0.0);
        for seen in stream.wanted() {
            if let Some(change) = stream.staleness(seen.tile, now).filter(|change| change.is_finite()) {
                sum += f64::from(change.min(1.0)) * f64::from(seen.pixels);
                pixels += f64::from(seen.pixels);
            }
        }
        row.staleness = sum / f64::max(pixels, 1.0);
        row.decoded = report.commands.decodes.iter().filter(|decode| decode.maps).count();
        row.suns = report.commands.decodes.iter().filter(|decode| !decode.maps).count();
        row.loaded = report.commands.loads.iter().filter(|load| load.features).count();
        row.evictions = report.commands.evictions.len();
        row.bytes = report.bytes;
        self.shown = (0..pyramid.tiles() as u32).map(|i| stream.entry(Tile(i))).collect();
        self.rows.push(row);
    }

    /// The scenario in numbers.
    pub fn summary(&self) -> Value {
        // The first frames of a scenario have nothing in their caches, and the last one no feedback.
        let rows = &self.rows[..self.rows.len().saturating_sub(1)];
        let settled = &rows[rows.len().min(30)..];
        let mean = |of: &[Row], value: &dyn Fn(&Row) -> f64| {
            of.iter().map(value).sum::<f64>() / of.len().max(1) as f64
        };
        let compared: Vec<f64> = settled.iter().filter_map(|row| row.psnr).collect();
        let least = |values: &[f64]| values.iter().copied().reduce(f64::min);
        let mut waits = self.waits.clone();
        waits.sort_unstable();
        let at = |share: f64| waits.get(((waits.len() as f64 * share) as usize).min(waits.len().max(1) - 1));
        let mut pixels: Vec<f64> = settled.iter().map(|row| row.hits_by_pixels).collect();
        pixels.sort_by(f64::total_cmp);
        let most = |value: &dyn Fn(&Row) -> f64| rows.iter().map(value).fold(0.0, f64::max);
        json!({
            "frames": self.rows.len(),
            "hits_by_pixels": mean(settled, &|row| row.hits_by_pixels),
            "hits_by_pixels_min": pixels.first(),
            "hits_by_tiles": mean(settled, &|row| row.hits_by_tiles),
            "tiles_seen": mean(settled, &|row| row.tiles as f64),
            "faults_a_frame": mean(settled, &|row| row.faults as f64),
            "faults_again_within_60_frames": rows.iter().map(|row| row.faults_again).sum::<usize>(),
            "frames_from_request_to_shown": { "p50": at(0.5), "p95": at(0.95), "p99": at(0.99), "shown": waits.len(), "waiting": self.asked.len() },
            "decoded_a_frame": mean(settled, &|row| row.decoded as f64),
            "decoded_max": most(&|row| row.decoded as f64),
            "suns_a_frame": mean(settled, &|row| row.suns as f64),
            "upload_bytes_a_frame": mean(settled, &|row| row.bytes as f64),
            "evictions": rows.iter().map(|row| row.evictions).sum::<usize>(),
            "mip_bias": mean(settled, &|row| row.mip_bias),
            "staleness_by_pixels": mean(settled, &|row| row.staleness),
            "thread_ms": { "mean": mean(settled, &|row| row.thread_ms), "longest": settled.iter().map(|row| row.thread_ms).fold(0.0, f64::max), "first_second": most(&|row| row.thread_ms) },
            "psnr": { "mean": (!compared.is_empty()).then(|| compared.iter().sum::<f64>() / compared.len() as f64), "min": least(&compared), "frames": compared.len() },
            "unlit_pixels": rows.iter().skip(1).filter_map(|row| row.unlit).reduce(|a, b| a + b),
        })
    }
}

/// Whether a tile is shown by its own slot, or has no light that one could show.
fn is_exact(pyramid: &Pyramid, entry: Entry, tile: Tile) -> bool {
    let own = pyramid.spot(tile).map_or(0, |spot| spot.level);
    match entry {
        Entry::Slot { level, .. } => usize::from(level) == own,
        Entry::Mean => pyramid.is_black(tile),
    }
}
