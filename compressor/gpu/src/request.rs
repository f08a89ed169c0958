//! What is asked for, and what was done.

use crate::pipelines::Pipelines;
use crate::shader::{Output, Precision};
use ndgi::decode::Lights;
use ndgi::grid::Place;

/// Features of a device that the decoder makes use of, so far as the adapter has them: BC7 textures, and 16-bit floats.
pub fn features(adapter: &wgpu::Adapter) -> wgpu::Features {
    adapter.features() & (wgpu::Features::TEXTURE_COMPRESSION_BC | wgpu::Features::SHADER_F16)
}

/// How a bundle is decoded.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The network's precision. A tile whose weights are too large for 16 bits is decoded in 32.
    pub precision: Precision,
    /// Upload RGBA8 (4× the memory) even if the device supports BC7; always done if it does not.
    pub unpacks: bool,
    /// Pipeline cache; clone it into other decoders of the same device.
    pub pipelines: Pipelines,
}

/// Which light is decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodeParams {
    /// The hour, periodic in 24.
    pub hour: f64,
    /// All light, or some of it.
    pub lights: Lights,
    /// What light is multiplied with before it is stored: see [`Output`].
    pub exposure: f32,
}

impl DecodeParams {
    /// All light at an hour, as it is.
    pub fn at(hour: f64) -> Self {
        DecodeParams { hour, lights: Lights::All, exposure: 1.0 }
    }
}

/// A tile that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The tile.
    pub place: Place,
    /// Where its upper left texel comes on the target: the first of its payload, or the border's.
    pub to: [i32; 2],
    /// Whether the border around the payload is written too, a texel wide, for filters of hardware.
    pub with_border: bool,
}

/// A tile in a slot of a [`Pool`](crate::Pool) that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotRequest {
    /// The slot.
    pub slot: u32,
    /// Where the tile's upper left texel comes on the target: the first of its payload, or the border's.
    pub to: [i32; 2],
    /// Whether the border around the payload is written too, a texel wide, for filters of hardware.
    pub with_border: bool,
}

/// Where decoded texels go.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// A texture of two dimensions, of the output's format, with [`wgpu::TextureUsages::STORAGE_BINDING`].
    pub view: &'a wgpu::TextureView,
    /// What is stored.
    pub output: Output,
}

/// What a call did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Work<R = Request> {
    /// Tiles dispatched; those that are black are not counted.
    pub tiles: usize,
    /// Those of them whose network was evaluated; the others have the sun alone.
    pub networks: usize,
    /// Tiles that are black at the time. A [`Decoder`](crate::Decoder) dispatched nothing for them, and the target is as it was; a
    /// [`Pool`](crate::Pool) wrote black.
    pub black: Vec<R>,
    /// Bytes uploaded.
    pub bytes: u64,
}

impl<R> Default for Work<R> {
    fn default() -> Self {
        Work { tiles: 0, networks: 0, black: Vec::new(), bytes: 0 }
    }
}

impl Output {
    /// Its format of texture.
    pub fn format(self) -> wgpu::TextureFormat {
        match self {
            Output::Rgba16Float => wgpu::TextureFormat::Rgba16Float,
            Output::Rgba32Float => wgpu::TextureFormat::Rgba32Float,
            Output::Rgba8Unorm => wgpu::TextureFormat::Rgba8Unorm,
        }
    }
}
