//! Parameters and results of decoding calls.

use crate::pipelines::Pipelines;
use crate::shader::{Output, Precision};
use ndgi::decode::Lights;
use ndgi::grid::Place;

/// Features of a device that the decoder makes use of, so far as the adapter has them: BC7 textures, and
/// 16-bit floats.
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

/// When and how light is decoded: hour, lights and exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodeParams {
    /// The hour, periodic in 24.
    pub hour: f64,
    /// All light, or some of it.
    pub lights: Lights,
    /// Factor of the light before it is stored: see [`Output`].
    pub exposure: f32,
}

impl DecodeParams {
    /// All light at an hour, with exposure 1.
    pub fn at(hour: f64) -> Self {
        DecodeParams { hour, lights: Lights::All, exposure: 1.0 }
    }
}

/// A tile to decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The tile.
    pub place: Place,
    /// Position of its upper left texel on the target: the payload's first, or the border's.
    pub to: [i32; 2],
    /// True to write also the border of one texel around the payload, for hardware filtering.
    pub with_border: bool,
}

/// A tile in a slot of a [`Pool`](crate::Pool) to decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotRequest {
    /// The slot.
    pub slot: u32,
    /// Position of the tile's upper left texel on the target: the payload's first, or the border's.
    pub to: [i32; 2],
    /// True to write also the border of one texel around the payload, for hardware filtering.
    pub with_border: bool,
}

/// Where decoded texels go.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// A texture of two dimensions, of the output's format, with [`wgpu::TextureUsages::STORAGE_BINDING`].
    pub view: &'a wgpu::TextureView,
    /// The output format.
    pub output: Output,
}

/// Statistics of a call.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Work<R = Request> {
    /// Tiles dispatched; those that are black are not counted.
    pub tiles: usize,
    /// Tiles whose network was evaluated; the others have only the sun.
    pub networks: usize,
    /// Tiles that are black at this time. A [`Decoder`](crate::Decoder) dispatched nothing for them and left
    /// the target unchanged; a [`Pool`](crate::Pool) wrote black.
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
