//! Sky and sun.
//!
//! In: the scene's sky, sun and location. Out: tables of the sky's radiance for all hours ([`SkyTable`]),
//! where it is worth sampling ([`SkySampler`]), and the sun's disc ([`SunDisc`]). Callers: `times`, the light
//! of a bake, plans, previews.
//!
//! `sky_model` computes skies (`hosek_wilkie`, twilight), `sky_image` looks a sky picture up by direction,
//! `ground` is what lies below the horizon. `harmonics` has the skies of transfers; `project` fits a sky by
//! harmonics.

pub mod sun;
mod sky_image;
pub mod harmonics;
mod hosek_wilkie;
pub(super) mod sky_model;
pub mod sky;
mod sky_sampler;
pub mod ground;
pub(crate) mod project;

pub(super) use sky::Illuminance;
pub use sky::SkyTable;
pub use sky_sampler::SkySampler;
pub(crate) use sun::DiscSampler;
pub use sun::SunDisc;
