//! The stream on a device: what shaders sample, against the decoder on the CPU.
//!
//! Without an adapter these tests say so and pass; with `NDGI_GPU` set they must run.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

mod common;

use ndgi::Bundle;
use ndgi::decode::Decoder;
use ndgi::source::ReadAt;
use ndgi::testing::Random;
use ndgi_stream::gpu::{Done, Files, Reader, Report, Runtime, Settings, Threads, read};
use ndgi_stream::{Budgets, Entry, Pyramid, Read, Seen, Spot, Tile};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Texels of slots are 16-bit floats.
const EXACT: f32 = 1e-3;

fn device() -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::default();
    let Ok(adapter) = pollster::block_on(instance.request_adapter(&Default::default())) else {
        assert!(std::env::var_os("NDGI_GPU").is_none(), "NDGI_GPU is set, but there is no adapter");
        eprintln!("skipped: no adapter");
        return None;
    };
    let descriptor = wgpu::DeviceDescriptor {
        required_features: ndgi_gpu::features(&adapter),
        required_limits: adapter.limits(),
        ..Default::default()
    };
    Some(pollster::block_on(adapter.request_device(&descriptor)).unwrap())
}

/// A view that samples at points instead of drawing: page, level, u, v.
struct Probe {
    device: wgpu::Device,
    queue: wgpu::Queue,
    runtime: Runtime,
    pipeline: wgpu::ComputePipeline,
}

type Point = (u32, u32, [f32; 2]);

impl Probe {
    fn new(gpu: (wgpu::Device, wgpu::Queue), pyramid: Arc<Pyramid>, budgets: Budgets) -> Self {
        Self::with(gpu, pyramid, budgets, Box::new(Threads::new(2).unwrap()))
    }

    fn with(
        (device, queue): (wgpu::Device, wgpu::Queue),
        pyramid: Arc<Pyramid>,
        budgets: Budgets,
        reader: Box<dyn Reader>,
    ) -> Self {
        let settings = Settings { budgets, ..Settings::of_view([64, 64]) };
        let runtime = Runtime::new(&device, &queue, pyramid, reader, settings).unwrap();
        let shader = "
            @group(1) @binding(0) var<storage, read> points: array<vec4<f32>>;
            @group(1) @binding(1) var<storage, read_write> light: array<vec4<f32>>;
            @compute @workgroup_size(64)
            fn main(@builtin(global_invocation_id) id: vec3<u32>) {
                if (id.x >= arrayLength(&points)) { return; }
                let point = points[id.x];
                light[id.x] = vec4(ndgi_light_at(u32(point.x), point.zw, u32(point.y)), 1.0);
            }";
        let source = format!("{}\n{shader}", Runtime::wgsl(0));
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let storage = |binding, read_only| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let own = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[storage(0, true), storage(1, false)],
        });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(runtime.layout()), Some(&own)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: Some(&layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Probe { device, queue, runtime, pipeline }
    }

    fn frame(&mut self, seen: &[Seen], hour: f64) -> Report {
        self.runtime.see(seen.to_vec());
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let report = self.runtime.frame(&self.device, &self.queue, &mut encoder, hour).unwrap();
        self.queue.submit([encoder.finish()]);
        report
    }

    /// Frames until nothing is done any more.
    fn settle(&mut self, seen: &[Seen], hour: f64) -> Vec<Report> {
        let mut reports = Vec::new();
        let mut quiet = 0;
        while quiet < 20 {
            let report = self.frame(seen, hour);
            let commands = &report.commands;
            let is_quiet =
                commands.reads.is_empty() && commands.loads.is_empty() && commands.decodes.is_empty();
            quiet = if is_quiet { quiet + 1 } else { 0 };
            reports.push(report);
            assert!(reports.len() < 3000, "it goes on and on");
            std::thread::sleep(Duration::from_millis(2));
        }
        reports
    }

    fn sample(&self, points: &[Point]) -> Vec<[f32; 3]> {
        let exposure = 256.0;
        let words: Vec<[f32; 4]> =
            points.iter().map(|(page, level, [u, v])| [*page as f32, *level as f32, *u, *v]).collect();
        let points = self.device.create_buffer_init(&BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&words),
            usage: wgpu::BufferUsages::STORAGE,
        });
        let buffer = |usage| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: points.size(),
                usage,
                mapped_at_creation: false,
            })
        };
        let light = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let read = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(1),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: points.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: light.as_entire_binding() },
            ],
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, self.runtime.bind_group(), &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups((words.len() as u32).div_ceil(64), 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&light, 0, &read, 0, light.size());
        self.queue.submit([encoder.finish()]);
        read.map_async(wgpu::MapMode::Read, .., |_| {});
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let bytes = read.get_mapped_range(..).unwrap();
        let texels: &[[f32; 4]] = bytemuck::cast_slice(&bytes);
        texels.iter().map(|texel| [0, 1, 2].map(|c| texel[c] / exposure)).collect()
    }

    /// Samples everywhere, most of all at tile borders, and compares with the decoder at the level that the
    /// page table has. Gives the number of points by level, and last of those that show the mean.
    fn expect_exact(&self, hour: f64) -> Vec<usize> {
        let pyramid = self.runtime.stream().pyramid();
        let mut random = Random(5);
        let mut points: Vec<Point> = Vec::new();
        for page in 0..pyramid.pages() as u32 {
            for level in 0..pyramid.levels() as u32 {
                for _ in 0..600 {
                    let grid = pyramid.bundle(0).header.pages[page as usize];
                    let axis = |random: &mut Random, side: usize| match random.below(3) {
                        0 => random.unit(),
                        // About a texel around the border of a tile of the level.
                        _ => {
                            let border = 126 * random.below(side / 126 + 2);
                            ((border as f32 + 3.0 * (random.unit() - 0.5)) * (1 << level) as f32
                                / side as f32)
                                .clamp(0.0, 1.0)
                        }
                    };
                    let at = [axis(&mut random, grid.width), axis(&mut random, grid.height)];
                    points.push((page, level, at));
                }
            }
        }
        let found = self.sample(&points);
        let decoders: Vec<Decoder> =
            (0..pyramid.levels()).map(|level| Decoder::new(self.copy_of(level))).collect();
        let mut counts = vec![0; pyramid.levels() + 1];
        let now = pyramid.at(hour).unwrap();
        for ((page, level, [u, v]), found) in points.into_iter().zip(found) {
            let tile = self.tile_at(page as usize, level as usize, [u, v]);
            let (expected, floor) = match self.runtime.stream().entry(tile) {
                Entry::Mean => {
                    counts[pyramid.levels()] += 1;
                    // Nine bits, beside the largest channel: twice as coarse.
                    let mean = pyramid.mean(tile, &now);
                    (mean, 2.0 * mean.into_iter().fold(0.0, f32::max))
                }
                Entry::Slot { level, .. } => {
                    counts[usize::from(level)] += 1;
                    let level = usize::from(level);
                    let [fine, own] =
                        [0, level].map(|level| pyramid.bundle(level).header.pages[page as usize]);
                    let part = |u: f32, fine: usize, own: usize| {
                        f64::from(u) * fine as f64 / f64::from(1 << level) / own as f64
                    };
                    let at = [part(u, fine.width, own.width), part(v, fine.height, own.height)];
                    let mean = pyramid.mean(tile, &now).into_iter().fold(0.0, f32::max);
                    let owner = self.owner(tile, level);
                    let light = if owner == tile {
                        decoders[level].sample(page as usize, at[0], at[1], hour).unwrap()
                    } else {
                        // Half a texel across its border, it is the tile that covers the one looked for that
                        // is sampled, not its neighbour.
                        let place = pyramid.spot(owner).unwrap().place;
                        let local =
                            |at: f64, side: usize, i: usize| (at * side as f64) as f32 - (126 * i) as f32;
                        let tile = decoders[level].bundle().at(hour).unwrap().tile(place).unwrap();
                        tile.sample(
                            local(at[0], own.width, place.column),
                            local(at[1], own.height, place.row),
                        )
                    };
                    (light, mean / 100.0)
                }
            };
            // Places are 32-bit floats: a channel that is dark beside the others takes from them.
            let floor = floor.max(expected.into_iter().fold(0.0, f32::max) / 100.0);
            for c in 0..3 {
                let error = (found[c] - expected[c]).abs() / expected[c].max(floor).max(1e-5);
                assert!(
                    error <= EXACT,
                    "page {page}, level {level}, ({u}, {v}): {found:?}, expected {expected:?}"
                );
            }
        }
        counts
    }

    /// The tile of a level that covers a tile.
    fn owner(&self, mut tile: Tile, level: usize) -> Tile {
        let pyramid = self.runtime.stream().pyramid();
        while pyramid.spot(tile).unwrap().level < level {
            tile = pyramid.parent(tile).unwrap();
        }
        tile
    }

    fn copy_of(&self, level: usize) -> Bundle {
        Bundle::from_bytes(self.runtime.stream().pyramid().bundle(level).repeated(1).unwrap()).unwrap()
    }

    fn tile_at(&self, page: usize, level: usize, [u, v]: [f32; 2]) -> Tile {
        let pyramid = self.runtime.stream().pyramid();
        let [fine, own] = [0, level].map(|level| pyramid.bundle(level).header.pages[page]);
        let axis = |u: f32, fine: usize, own: usize| {
            let position = u * fine as f32 * (-(level as f32)).exp2();
            ((position - 0.5).floor().max(0.0) as usize).min(own - 1) / 126
        };
        let (column, row) = (axis(u, fine.width, own.width), axis(v, fine.height, own.height));
        pyramid.tile(Spot { level, place: ndgi::grid::Place { page, column, row } }).unwrap()
    }
}

fn all(pyramid: &Pyramid) -> Vec<Seen> {
    (0..pyramid.tiles() as u32).map(|i| Seen { tile: Tile(i), pixels: 10 }).collect()
}

#[test]
fn what_is_sampled_is_the_page_within_a_thousandth_across_the_borders_of_tiles() {
    let Some(gpu) = device() else { return };
    let pyramid = common::pyramid();
    let seen = all(&pyramid);
    let budgets = Budgets { slots: 64, features: 64, ..Budgets::default() };
    let mut probe = Probe::new(gpu, pyramid, budgets);
    for hour in [8.3, 11.0, 20.5] {
        probe.settle(&seen, hour);
        let counts = probe.expect_exact(hour);
        assert_eq!(counts, [1200, 1200, 1200, 0]);
    }
}

#[test]
fn where_slots_are_few_what_covers_a_tile_is_sampled() {
    let Some(gpu) = device() else { return };
    let pyramid = common::pyramid();
    let mut seen = all(&pyramid);
    let budgets = Budgets { slots: 10, features: 12, ..Budgets::default() };
    let mut probe = Probe::new(gpu, Arc::clone(&pyramid), budgets);
    // Nothing is there yet.
    probe.frame(&[], 8.3);
    let counts = probe.expect_exact(8.3);
    assert!(counts[..3].iter().all(|count| *count == 0), "{counts:?}");
    seen.truncate(9);
    probe.settle(&seen, 8.3);
    let counts = probe.expect_exact(8.3);
    assert!(counts[0] > 50 && counts[2] > 50, "{counts:?}");
}

/// A source whose bytes are damaged from some moment on.
#[derive(Debug)]
struct Rotting(Vec<u8>, Arc<AtomicBool>, u64);

impl ReadAt for Rotting {
    fn size(&self) -> std::io::Result<u64> {
        Ok(self.0.len() as u64)
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> std::io::Result<()> {
        let from = offset as usize;
        bytes.copy_from_slice(&self.0[from..from + bytes.len()]);
        if self.1.load(Ordering::Relaxed) && offset == self.2 {
            bytes[0] ^= 1;
        }
        Ok(())
    }
}

#[test]
fn a_tile_damaged_while_streaming_is_reported_once_and_the_rest_continues() {
    let Some(gpu) = device() else { return };
    let sound = common::pyramid();
    let damaged = common::lit(&sound).find(|tile| common::changes(&sound, *tile)).unwrap();
    let rots = Arc::new(AtomicBool::new(false));
    let bundle = |level: usize| {
        let of = sound.bundle(level);
        let offset = if level == 0 { of.index[damaged.0 as usize].maps.offset } else { u64::MAX };
        let source = Rotting(of.repeated(1).unwrap(), Arc::clone(&rots), offset);
        Arc::new(Bundle::from_source(source).unwrap())
    };
    let pyramid = Arc::new(Pyramid::new((0..3).map(bundle).collect()).unwrap());
    rots.store(true, Ordering::Relaxed);
    let seen = all(&pyramid);
    let mut probe = Probe::new(gpu, pyramid, Budgets { slots: 64, features: 64, ..Budgets::default() });
    let failures: Vec<_> =
        probe.settle(&seen, 8.3).into_iter().flat_map(|report| report.commands.failures).collect();
    assert_eq!(failures.len(), 1, "{failures:?}");
    assert_eq!(failures[0].tile, damaged);
    assert!(failures[0].what.contains("checksum"), "{}", failures[0].what);
    // What is compared with is sound.
    rots.store(false, Ordering::Relaxed);
    probe.expect_exact(8.3);
    assert!(!matches!(probe.runtime.stream().entry(damaged), Entry::Slot { level: 0, .. }));
}

#[test]
fn a_bundle_that_is_replaced_is_taken_up() {
    let Some(gpu) = device() else { return };
    let pyramid = common::pyramid();
    let seen = all(&pyramid);
    let budgets = Budgets { slots: 64, features: 64, ..Budgets::default() };
    let mut probe = Probe::new(gpu, pyramid, budgets);
    probe.settle(&seen, 8.3);
    let other = common::shuffled();
    let (device, queue) = (probe.device.clone(), probe.queue.clone());
    probe.runtime.replace(&device, &queue, other).unwrap();
    probe.settle(&seen, 8.3);
    let counts = probe.expect_exact(8.3);
    assert!(counts[..3].iter().all(|count| *count > 100), "{counts:?}");
}

#[test]
fn files_of_levels_are_found_opened_and_known_to_be_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let pyramid = common::pyramid();
    let path = |level: usize| match level {
        0 => folder.path().join("yard.ndgi"),
        _ => folder.path().join(format!("yard.{level}.ndgi")),
    };
    for level in 0..3 {
        std::fs::write(path(level), pyramid.bundle(level).repeated(1).unwrap()).unwrap();
    }
    let mut files = Files::beside(&path(0));
    assert_eq!(files.paths().len(), 3);
    assert!(files.changed(), "nothing was opened yet");
    assert_eq!(files.open().unwrap().tiles(), pyramid.tiles());
    assert!(!files.changed());
    // Another length: the time of a file may be too coarse.
    let other = common::other();
    std::fs::write(path(1), other.bundle(1).repeated(1).unwrap()).unwrap();
    assert!(files.changed());
    let error = files.open().unwrap_err().to_string();
    assert!(error.contains("level 1"), "{error}");
    std::fs::remove_file(path(2)).unwrap();
    assert!(files.changed());
    assert_eq!(Files::beside(&path(0)).paths().len(), 2);
}

/// A reader that brings the intervals of another tile, and for some tiles no features.
#[derive(Debug)]
struct Muddled(Vec<Done>);

impl Reader for Muddled {
    fn start(
        &mut self,
        pyramid: &Arc<Pyramid>,
        options: &ndgi_gpu::Options,
        of: Read,
        known: Option<ndgi_gpu::Sunlight>,
    ) {
        let mut what = read(pyramid, options, &of, known.as_ref());
        if let Ok(arrived) = &mut what
            && of.tile.0 % 3 == 1
        {
            arrived.features = None;
        }
        self.0.push(Done { ticket: of.ticket, what });
    }

    fn done(&mut self) -> Vec<Done> {
        std::mem::take(&mut self.0)
    }
}

#[test]
fn a_reader_that_breaks_its_contract_is_reported_and_frames_continue() {
    let Some(gpu) = device() else { return };
    let pyramid = common::pyramid();
    let seen = all(&pyramid);
    let budgets = Budgets { slots: 64, features: 64, ..Budgets::default() };
    let mut probe = Probe::with((gpu.0, gpu.1), pyramid, budgets, Box::new(Muddled(Vec::new())));
    let (mut refused, mut failures) = (0, Vec::new());
    for step in 0..60 {
        let report = probe.frame(&seen, 7.4 + 0.01 * f64::from(step));
        refused += report.refused;
        failures.extend(report.commands.failures);
    }
    assert!(refused > 0 && !failures.is_empty());
    let mut tiles: Vec<Tile> = failures.iter().map(|failure| failure.tile).collect();
    tiles.sort();
    assert!(tiles.is_sorted_by(|a, b| a < b), "each is told once: {failures:?}");
    assert!(failures[0].what.contains("returned no features"), "{}", failures[0].what);
    probe.expect_exact(7.4 + 0.01 * 59.0);
}
