//! Decodes NDGI bundles on a GPU: any number of tiles at any hour in one dispatch of a compute shader, into a texture.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let (device, queue): (wgpu::Device, wgpu::Queue) = unimplemented!();
//! use ndgi_gpu::{Decoder, Moment, Options, Output};
//!
//! let bundle = ndgi::Bundle::open("yard.ndgi".as_ref())?;
//! let mut decoder = Decoder::new(&device, &queue, bundle, Options::default())?;
//! let mut page = decoder.page(0, Output::Rgba16Float)?; // a texture of the page
//! let mut encoder = device.create_command_encoder(&Default::default());
//! decoder.decode_page(&mut encoder, &mut page, &Moment { exposure: 256.0, ..Moment::at(18.05) })?;
//! queue.submit([encoder.finish()]);
//! # Ok(())
//! # }
//! ```
//!
//! BC7 blocks, weights, planes and normals stay on the device. A call uploads one job per tile (272 bytes at width 16) and, when the hour enters a new
//! visibility interval, each tile's visibility for it. How it fits into other engines: `INTEGRATION.md`.

#![forbid(unsafe_code)]

#[cfg(doctest)]
#[doc = include_str!("../../INTEGRATION.md")]
mod guide {}

mod decoder;
mod error;
mod load;
mod pipelines;
mod place;
mod shader;
mod tile;

pub use decoder::{Decoder, Moment, Options, Page, Request, Target, Work, features};
pub use error::{Error, Result};
pub use pipelines::Pipelines;
pub use shader::{Output, Precision, Shader, coarse};
