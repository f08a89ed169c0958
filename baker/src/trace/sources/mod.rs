//! The room of what a bake's light comes from.
//!
//! In: the lights of a scene. Out: [`Lights`], a layer each for suns, skies and light groups.
//!
//! `light_subset` draws some of many groups, `room` bounds what shines behind a portal, `flush` finds the
//! emission of panels in one plane with others, `visibility_sampler` looks at the sun's disc.

mod room;
pub(crate) mod light_subset;
mod lights;
mod flush;
mod visibility_sampler;

pub(super) use flush::FlushEmitters;
pub(crate) use light_subset::FEW_GROUPS;
pub(super) use light_subset::SystematicSampler;
pub(crate) use lights::SunSample;
pub use lights::{GroupLight, Lights, SunLight};
pub(crate) use room::Room;
pub(crate) use visibility_sampler::{SunAtTime, VisibilitySampler};
