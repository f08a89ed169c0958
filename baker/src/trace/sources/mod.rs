//! What a bake's light comes from.
//!
//! In: the lights of a scene. Out: [`Lights`], a layer each for suns, skies and light groups. Callers: paths,
//! plans.
//!
//! `light_subset` draws some of many groups, `room` is the box of a room that has a portal, `flush` finds the
//! emission of panels that lie in the plane of another surface, `visibility_sampler` looks at the sun's disc.

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
