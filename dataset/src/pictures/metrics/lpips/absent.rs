//! Placeholder for the network in builds without the feature `lpips`.

use crate::{Error, Result};
use std::convert::Infallible;
use std::path::Path;

/// An error: this build has no network.
#[derive(Debug)]
pub(super) struct Network(Infallible);

impl Network {
    pub(super) fn load(path: &Path) -> Result<Self> {
        let what = "this build has no LPIPS: build with `--features compressor/lpips`";
        Err(Error::unsupported(path.display(), what))
    }

    pub(super) fn run(&self, _reference: Vec<f32>, _decoded: Vec<f32>) -> Result<f64> {
        match self.0 {}
    }
}
