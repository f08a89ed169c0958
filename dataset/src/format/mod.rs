//! The format: what `config.json` and the files beside it hold, apart from images.
//!
//! In: bytes. Out: [`Config`] and the rest, each checked by itself; `tiles` is the grid of evaluation.
//! Callers: the store, and all that make such files. README.md describes each file.

pub mod config;
pub mod tiles;
pub mod visibility;
mod sun;
pub mod curve;
pub mod normals;

pub use config::{
    Baked, Config, Daylight, FORMAT, FileRef, Frame, Group, Instance, Layer, Light, Noise, Page, PageKind,
    Part, Source, SunVisibility, Transfer, TransferLight, TransferPart, VERSION,
};
pub use curve::Curve;
pub use normals::Normals;
pub use sun::SunPath;
pub use tiles::{Rect, TILE};
pub use visibility::{Between, MOST_TIMES, Planes, Visibility};
