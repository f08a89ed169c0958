//! Decodes NDGI bundles on a GPU: any number of tiles at any hour in one dispatch of a compute shader, into a
//! texture.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let (device, queue): (wgpu::Device, wgpu::Queue) = unimplemented!();
//! use ndgi_gpu::{Decoder, DecodeParams, Options, Output};
//!
//! let bundle = ndgi::Bundle::open("yard.ndgi".as_ref())?;
//! let mut decoder = Decoder::new(&device, &queue, bundle, Options::default())?;
//! let mut page = decoder.page(0, Output::Rgba16Float)?; // a texture of the page
//! let mut encoder = device.create_command_encoder(&Default::default());
//! decoder.decode_page(&mut encoder, &mut page, &DecodeParams { exposure: 256.0, ..DecodeParams::at(18.05) })?;
//! queue.submit([encoder.finish()]);
//! # Ok(())
//! # }
//! ```
//!
//! BC7 blocks, weights, planes and normals stay on the device. A call uploads one job per tile (272 bytes at
//! width 16) and, when the hour enters a new visibility interval, each tile's visibility for it. How it fits
//! into other engines: `INTEGRATION.md`.

#![forbid(unsafe_code)]
#![warn(unreachable_pub)]

#[cfg(doctest)]
#[doc = include_str!("../../INTEGRATION.md")]
mod guide {}

mod error;
mod shader;
mod pipelines;
mod request;
mod place;
mod survey;
mod sun;
mod tile;
mod load;
mod stage;
mod decoder;
mod page;
mod features;
mod pool;

pub use decoder::Decoder;
pub use error::{Error, Result};
pub use features::{Features, Interval, Sunlight};
pub use page::Page;
pub use pipelines::Pipelines;
pub use pool::Pool;
pub use request::{DecodeParams, Options, Request, SlotRequest, Target, Work, features};
pub use shader::{Output, Precision, Shader, coarse};
