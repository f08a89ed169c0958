//! Pictures of baked light: camera rays meet the scene's surfaces, which are shown by the irradiance that a
//! dataset, or a bundle of it, holds for them.
//!
//! `options` says what is asked for, `triangle_layout` where triangles lie on the pages, `existing` opens the
//! dataset and finds the geometry to show it on, `blend` finds the frames to show, `bundle` opens one and
//! says whether it is of this dataset, `baked` reads the texels of either, `light` holds the emitters of that
//! time, `viewpoint` finds a place with a view, `view` is the camera, `shade` what a ray of it sees,
//! `picture` all pixels, `run` the whole of it. How they are exposed stands in the crate `dataset` (`tone`),
//! for reports show scenes likewise.

pub mod options;
mod triangle_layout;
mod existing;
mod blend;
mod bundle;
mod baked;
mod light;
mod default_viewpoint;
pub(crate) mod view;
mod shade;
mod picture;
pub mod run;
