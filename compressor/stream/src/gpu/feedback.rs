//! Feedback: a small target into which the view draws the numbers of the tiles that it needs, read back
//! without waiting.

use crate::{Seen, Tile};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Read-backs that can be under way at once.
const RING: usize = 3;
/// States of a buffer.
const FREE: u8 = 0;
const COPIED: u8 = 1;
const MAPPING: u8 = 2;
const MAPPED: u8 = 3;
const FAILED: u8 = 4;

/// The target into which the view draws feedback: per pixel the number of the tile that it needs there plus
/// 1, or 0 for none.
#[derive(Debug)]
pub struct Feedback {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    size: [u32; 2],
    /// Oldest first.
    buffers: Vec<(wgpu::Buffer, Arc<AtomicU8>)>,
}

impl Feedback {
    /// The format of the target: one `u32` a pixel.
    pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

    pub(super) fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture = texture(device, "ndgi feedback", size, Self::FORMAT, usage);
        let buffer = |_| {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("ndgi feedback"),
                size: u64::from(row(size)) * u64::from(size[1]),
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            (buffer, Arc::new(AtomicU8::new(FREE)))
        };
        let view = texture.create_view(&Default::default());
        Feedback { view, texture, size, buffers: (0..RING).map(buffer).collect() }
    }

    /// The target, for a render pass that clears it to 0.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Width and height of the target in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Copies the target into a free buffer. If there is none, this frame's feedback is skipped.
    pub(super) fn read_back(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let free = self.buffers.iter().position(|(_, state)| state.load(Ordering::Acquire) == FREE);
        let Some(free) = free else { return };
        let (buffer, state) = self.buffers.remove(free);
        let [width, height] = self.size;
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row(self.size)),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        state.store(COPIED, Ordering::Release);
        self.buffers.push((buffer, state));
    }

    pub(super) fn submitted(&mut self) {
        for (buffer, state) in &self.buffers {
            if state.load(Ordering::Acquire) == COPIED {
                state.store(MAPPING, Ordering::Release);
                let reported = Arc::clone(state);
                buffer.map_async(wgpu::MapMode::Read, .., move |result| {
                    reported.store(if result.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
                });
            }
        }
    }

    /// The newest feedback that has arrived since the last call: tiles, and their pixels at the target's
    /// resolution.
    pub(super) fn arrived(&mut self, device: &wgpu::Device, tiles: usize) -> Option<Vec<Seen>> {
        // An error would mean that the device is lost, which the view learns by itself.
        let _ = device.poll(wgpu::PollType::Poll);
        let mut seen = None;
        for (buffer, state) in &self.buffers {
            match state.load(Ordering::Acquire) {
                MAPPED => {
                    if let Ok(bytes) = buffer.get_mapped_range(..) {
                        seen = Some(count(&bytes, self.size, tiles));
                    }
                    buffer.unmap();
                    state.store(FREE, Ordering::Release);
                }
                FAILED => state.store(FREE, Ordering::Release),
                _ => {}
            }
        }
        seen
    }
}

/// A texture of one layer.
pub(super) fn texture(
    device: &wgpu::Device,
    label: &str,
    [width, height]: [u32; 2],
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// Bytes of a buffer's row.
fn row([width, _]: [u32; 2]) -> u32 {
    (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

fn count(bytes: &[u8], size: [u32; 2], tiles: usize) -> Vec<Seen> {
    let mut pixels = BTreeMap::<u32, u32>::new();
    for line in bytes.chunks_exact(row(size) as usize) {
        for number in line[..4 * size[0] as usize].as_chunks::<4>().0 {
            let number = u32::from_le_bytes(*number);
            if (1..=tiles).contains(&(number as usize)) {
                *pixels.entry(number - 1).or_default() += 1;
            }
        }
    }
    pixels.into_iter().map(|(tile, pixels)| Seen { tile: Tile(tile), pixels }).collect()
}
