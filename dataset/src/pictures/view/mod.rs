//! A dataset's scene as a camera sees it, for reports: which texel each sample of a picture shows is found
//! once, and lit by any maps then.
//!
//! A depth buffer over the dataset's own geometry file, which is all that a reader of datasets has;
//! `bake preview` traces rays in the scene. Surfaces with texels show the same light in both. What has no
//! texels is lit evenly, by the median light of what has some in view. Panes are omitted, nothing glows, and
//! the sky is one colour.
//!
//! `lens`: cameras; `texture`, `model`: the geometry file; `raster`: the depth buffer; `lookout`: a camera
//! where none is known; `picture`: samples and their light.

mod lens;
mod texture;
mod model;
mod raster;
mod lookout;
mod picture;

pub use lens::Camera;
pub use picture::{Light, View};
