//! Milliseconds per 1024² texels and per tile on the adapter that there is, by bundle, precision and light
//! (medians of nine), beside the CPU's decoder.
//!
//!     cargo bench -p ndgi-gpu -- dataset/yard/yard.ndgi …
//!
//! Without bundles: random tiles of every profile. Times are of the GPU's own clock where it has one
//! (timestamp queries), else of whole submissions. Times of a software adapter say nothing about GPUs.

use ndgi::Bundle;
use ndgi::bundle::{self, Header};
use ndgi::decode::Lights;
use ndgi::grid::Grid;
use ndgi::model::PROFILES;
use ndgi::testing;
use ndgi_gpu::{DecodeParams, Decoder, Options, Output, Page, Precision};
use std::time::Instant;

struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    clock: Option<wgpu::QuerySet>,
}

fn gpu() -> Option<Gpu> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default())).ok()?;
    let info = adapter.get_info();
    println!("{} ({:?}, {})", info.name, info.device_type, info.driver_info);
    let clock = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
    let clock = adapter.features() & clock;
    let descriptor = wgpu::DeviceDescriptor {
        required_features: ndgi_gpu::features(&adapter) | clock,
        required_limits: adapter.limits(),
        ..Default::default()
    };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).ok()?;
    let clock = clock.contains(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS).then(|| {
        device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        })
    });
    Some(Gpu { device, queue, clock })
}

impl Gpu {
    /// Milliseconds of one decoding of a page.
    fn once(&self, decoder: &mut Decoder, page: &mut Page, params: &DecodeParams) -> f64 {
        let buffer = |usage| {
            let descriptor =
                wgpu::BufferDescriptor { label: None, size: 16, usage, mapped_at_creation: false };
            self.device.create_buffer(&descriptor)
        };
        let resolved = buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
        let read = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        if let Some(clock) = &self.clock {
            encoder.write_timestamp(clock, 0);
        }
        decoder.decode_page(&mut encoder, page, params).unwrap();
        if let Some(clock) = &self.clock {
            encoder.write_timestamp(clock, 1);
            encoder.resolve_query_set(clock, 0..2, &resolved, 0);
            encoder.copy_buffer_to_buffer(&resolved, 0, &read, 0, 16);
        }
        let commands = encoder.finish();
        let start = Instant::now();
        self.queue.submit([commands]);
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let whole = 1e3 * start.elapsed().as_secs_f64();
        if self.clock.is_none() {
            return whole;
        }
        read.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let bytes = read.get_mapped_range(..).unwrap();
        let [from, to] = [0, 8].map(|at| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()));
        (to - from) as f64 * f64::from(self.queue.get_timestamp_period()) / 1e6
    }
}

/// Least milliseconds per 1024² on an RTX 4060 and an H100, by counts of machine code: a width of 16, all
/// maps, no sun.
fn floor(precision: Precision) -> [f64; 2] {
    match precision {
        Precision::Single => [0.12, 0.027],
        Precision::Half => [0.096, 0.016],
    }
}

/// Multiplications of a network of a width, by which the floors of wider networks are estimated.
fn multiplications(hidden: usize) -> f64 {
    let h = hidden as f64;
    12.0 * h + h * h + 4.0 * h
}

/// A square page of random tiles of a profile.
fn random(profile: usize, side: usize) -> Vec<u8> {
    let mut header = Header { pages: vec![Grid { width: side, height: side }], ..testing::header() };
    header.kinds.truncate(1);
    let contents = PROFILES[profile].contents(24, 1);
    let payload = |(i, place)| {
        let mut tile = testing::tile(header.shape(place, &contents), i as u64);
        tile.knots.push(testing::dusk());
        bundle::encode_payload(&tile).unwrap()
    };
    let payloads: Vec<_> = header.places().enumerate().map(payload).collect();
    bundle::encode(&header, &payloads).unwrap()
}

fn main() {
    let Some(gpu) = gpu() else {
        println!("skipped: no adapter was found");
        return;
    };
    let has_half = gpu.device.features().contains(wgpu::Features::SHADER_F16);
    let files: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let mut bundles: Vec<(String, Vec<u8>)> = Vec::new();
    if files.is_empty() {
        for (i, profile) in PROFILES.iter().enumerate() {
            for side in [252, 1008] {
                bundles.push((format!("{} {side}²", profile.name), random(i, side)));
            }
        }
    }
    bundles.extend(files.into_iter().map(|file| (file.clone(), std::fs::read(file).unwrap())));
    println!(
        "{:28} {:12} {:>6} {:>10} {:>12} {:>12} {:>15} {:>10} {:>10} {:>16}",
        "bundle",
        "network",
        "tiles",
        "ms a tile",
        "ms per 1024²",
        "CPU, 1 core",
        "4060, H100 least",
        "first, ms",
        "resident",
        "uploaded, then"
    );
    for (name, bytes) in bundles {
        for (precision, lights) in [
            (Precision::Single, Lights::All),
            (Precision::Half, Lights::All),
            (Precision::Single, Lights::Baked),
            (Precision::Single, Lights::Sun),
        ] {
            let apart = Bundle::from_bytes(bytes.clone()).unwrap().header.sun.is_some();
            if precision == Precision::Half && !has_half || lights != Lights::All && !apart {
                continue;
            }
            let bundle = Bundle::from_bytes(bytes.clone()).unwrap();
            let options = Options { precision, ..Options::default() };
            let mut decoder = Decoder::new(&gpu.device, &gpu.queue, bundle, options).unwrap();
            let mut page = decoder.page(0, Output::Rgba16Float).unwrap();
            let params = DecodeParams { lights, exposure: 256.0, ..DecodeParams::at(12.3) };
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let work = decoder.decode_page(&mut encoder, &mut page, &params).unwrap();
            let start = Instant::now();
            gpu.queue.submit([encoder.finish()]);
            gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
            gpu.once(&mut decoder, &mut page, &params);
            let first = 1e3 * start.elapsed().as_secs_f64();
            let mut times: Vec<f64> = (0..9).map(|_| gpu.once(&mut decoder, &mut page, &params)).collect();
            times.sort_by(f64::total_cmp);
            let at = decoder.bundle().at(params.hour).unwrap().only(lights);
            let (mut texels, mut cpu) = (0, 0.0);
            let grid = decoder.bundle().header.pages[0];
            for place in grid.places(0) {
                let (width, height) = grid.payload(place.column, place.row);
                let tile = at.tile(place).unwrap();
                let mut out = vec![[0.0; 3]; width * height];
                let start = Instant::now();
                tile.decode_into(&mut out);
                cpu += 1e3 * start.elapsed().as_secs_f64();
                texels += if tile.is_black() { 0 } else { width * height };
            }
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let later = decoder.decode_page(&mut encoder, &mut page, &params).unwrap();
            let widths = grid.places(0).filter_map(|place| decoder.bundle().tile(place).unwrap());
            let width = widths.map(|tile| tile.shape.hidden).max().unwrap_or(16);
            let ([of_4060, of_h100], wider) =
                (floor(precision), multiplications(width) / multiplications(16));
            let scale = f64::from(1 << 20) / texels as f64;
            let of = match lights {
                Lights::All => "",
                Lights::Baked => ", maps",
                Lights::Sun => ", sun",
            };
            let network = format!("{precision:?}{of}");
            let median = times[times.len() / 2];
            println!(
                "{name:28} {network:12} {:6} {:10.3} {:12.4} {:12.2} {:>15} {first:10.1} {:10} {:>16}",
                work.tiles,
                median / work.tiles.max(1) as f64,
                median * scale,
                cpu * scale,
                format!("{:.3}, {:.3}", of_4060 * wider, of_h100 * wider),
                decoder.bytes(),
                format!("{}, {}", work.bytes, later.bytes),
            );
        }
    }
}
