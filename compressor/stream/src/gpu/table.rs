//! The buffers that shaders read: the page table, the tiles' means, and the sizes of all pages and levels.

use crate::{Commands, Entry, Now, Pyramid, Seen, Stream, Tile};
use std::collections::BTreeSet;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// One mean in this many is updated per frame, in turn; those of the tiles seen are updated in every
/// feedback.
const ROUND: usize = 64;
/// Hours for which means that are not seen may be old.
const FRESH: f64 = 0.25;

#[derive(Debug)]
pub(super) struct Table {
    pub layout: wgpu::BindGroupLayout,
    pub group: wgpu::BindGroup,
    paging: wgpu::Buffer,
    entries: wgpu::Buffer,
    means: wgpu::Buffer,
    bytes: u64,
    levels: u32,
    pages: u32,
    across: u32,
    exposure: f32,
    /// The tile at which the next frame's round of means begins.
    next: usize,
    /// The hour at which all means were written last, and the lamps then.
    filled: Option<(f64, Vec<bool>)>,
}

impl Table {
    pub(super) fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        pyramid: &Pyramid,
        slots: [&wgpu::TextureView; 2],
        (across, exposure): (u32, f32),
    ) -> Self {
        let (levels, pages) = (pyramid.levels() as u32, pyramid.pages() as u32);
        let mut sizes = Vec::new();
        for level in 0..pyramid.levels() {
            for (page, grid) in pyramid.bundle(level).header.pages.iter().enumerate() {
                let Tile(first) = pyramid.first(level, page);
                sizes.extend([first, grid.columns() as u32, grid.width as u32, grid.height as u32]);
            }
        }
        let storage = |label, contents: &[u32]| {
            device.create_buffer_init(&BufferInitDescriptor {
                label: Some(label),
                contents: bytemuck::cast_slice(contents),
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            })
        };
        let none = vec![0u32; pyramid.tiles()];
        let [entries, means] = ["ndgi entries", "ndgi means"].map(|label| storage(label, &none));
        let sizes = storage("ndgi pages", &sizes);
        let paging = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ndgi paging"),
            size: 16,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let (layout, group) = bind(device, &paging, [&sizes, &entries, &means], slots);
        let bytes = paging.size() + sizes.size() + entries.size() + means.size();
        let table = Table {
            layout,
            group,
            paging,
            entries,
            means,
            bytes,
            levels,
            pages,
            across,
            exposure,
            next: 0,
            filled: None,
        };
        table.write_paging(queue, 0.0);
        table
    }

    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    fn write_paging(&self, queue: &wgpu::Queue, mip_bias: f32) {
        let words = [mip_bias.to_bits(), self.levels, self.pages, self.across];
        queue.write_buffer(&self.paging, 0, bytemuck::cast_slice(&words));
    }

    /// Writes all entries of a new table.
    pub(super) fn fill(&self, queue: &wgpu::Queue, stream: &Stream) {
        let words: Vec<u32> =
            (0..stream.pyramid().tiles() as u32).map(|tile| word(stream.entry(Tile(tile)))).collect();
        queue.write_buffer(&self.entries, 0, bytemuck::cast_slice(&words));
    }

    /// Writes what has changed in a frame; returns the bytes.
    pub(super) fn write(
        &mut self,
        queue: &wgpu::Queue,
        stream: &Stream,
        now: &Now,
        commands: &Commands,
        seen: Option<&[Seen]>,
    ) -> u64 {
        self.write_paging(queue, commands.mip_bias);
        let changed: BTreeSet<usize> = commands.table.iter().map(|(tile, _)| tile.0 as usize).collect();
        let mut bytes = write_at(queue, &self.entries, &changed, |tile| word(stream.entry(tile)));
        let tiles = stream.pyramid().tiles();
        // After a switch or a jump of the clock all of them are wrong.
        let holds = |(hour, state): &(f64, Vec<bool>)| (hour - now.hour).abs() < FRESH && *state == now.state;
        let round = match self.filled.as_ref().is_some_and(holds) {
            false => 0..tiles,
            true => self.next..(self.next + tiles.div_ceil(ROUND)).min(tiles),
        };
        if round.len() == tiles {
            self.filled = Some((now.hour, now.state.clone()));
        }
        self.next = if round.end == tiles { 0 } else { round.end };
        let seen = seen.unwrap_or_default().iter().map(|seen| seen.tile.0 as usize);
        let shows_mean = |tile: &usize| stream.entry(Tile(*tile as u32)) == Entry::Mean;
        let is_one = |tile: &usize| *tile < tiles;
        let reported: BTreeSet<usize> =
            round.chain(seen.filter(is_one)).chain(changed).filter(shows_mean).collect();
        let mean = |tile: Tile| ndgi::pack::rgb9e5(stream.pyramid().mean(tile, now), self.exposure);
        bytes += write_at(queue, &self.means, &reported, mean);
        bytes
    }
}

/// Writes some words of a buffer, neighbours in one call; returns the bytes.
fn write_at(
    queue: &wgpu::Queue,
    buffer: &wgpu::Buffer,
    which: &BTreeSet<usize>,
    word: impl Fn(Tile) -> u32,
) -> u64 {
    let mut run: Vec<u32> = Vec::new();
    let mut end = 0;
    let flush = |run: &mut Vec<u32>, end: usize| {
        if !run.is_empty() {
            queue.write_buffer(buffer, 4 * (end - run.len()) as u64, bytemuck::cast_slice(run));
            run.clear();
        }
    };
    for at in which {
        if *at != end {
            flush(&mut run, end);
        }
        run.push(word(Tile(*at as u32)));
        end = at + 1;
    }
    flush(&mut run, end);
    4 * which.len() as u64
}

/// An entry as shaders read it: 0 for the mean, else 1 + 16 · slot + level.
fn word(entry: Entry) -> u32 {
    match entry {
        Entry::Mean => 0,
        Entry::Slot { slot, level } => 1 + (slot << 4 | u32::from(level)),
    }
}

fn bind(
    device: &wgpu::Device,
    paging: &wgpu::Buffer,
    storage: [&wgpu::Buffer; 3],
    slots: [&wgpu::TextureView; 2],
) -> (wgpu::BindGroupLayout, wgpu::BindGroup) {
    let visibility = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let read = wgpu::BufferBindingType::Storage { read_only: true };
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: false },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("ndgi stream"),
        entries: &[
            entry(0, buffer(wgpu::BufferBindingType::Uniform)),
            entry(1, buffer(read)),
            entry(2, buffer(read)),
            entry(3, buffer(read)),
            entry(4, texture),
            entry(5, texture),
        ],
    });
    let [sizes, entries, means] = storage.map(|buffer| buffer.as_entire_binding());
    let [maps, sun] = slots.map(wgpu::BindingResource::TextureView);
    let resources = [paging.as_entire_binding(), sizes, entries, means, maps, sun];
    let entries: Vec<wgpu::BindGroupEntry> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("ndgi stream"),
        layout: &layout,
        entries: &entries,
    });
    (layout, group)
}
