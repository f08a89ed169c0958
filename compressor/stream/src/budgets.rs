//! What a stream may use.

use crate::{Error, Result};

/// What a stream may use. The defaults are those of a view of 1920×1080 over a scene of any size.
#[derive(Clone, Debug, PartialEq)]
pub struct Budgets {
    /// Decoded tiles on the device: 128² texels each, 256 KB with the sun apart.
    pub slots: u32,
    /// Tiles whose features are on the device, some 60 KB each: at least as many as `slots`, so that what is seen can be decoded again.
    pub features: u32,
    /// Tiles that are being read, or are read and not yet on the device.
    pub reads: usize,
    /// Tiles that are put on the device per step; and as many intervals of the sun.
    pub loads: usize,
    /// Tiles whose maps are decoded per step. At a light switch all that are seen and that it reaches are decoded in one step, however many.
    pub decodes: usize,
    /// Tiles whose sun alone is decoded per step.
    pub suns: usize,
    /// Relative change of a tile's light below which it is not decoded again.
    pub tolerance: f32,
    /// How often a read is tried again after it failed.
    pub retries: u32,
}

impl Default for Budgets {
    fn default() -> Self {
        Budgets {
            slots: 256,
            features: 384,
            reads: 16,
            loads: 8,
            decodes: 16,
            suns: 256,
            tolerance: 0.005,
            retries: 3,
        }
    }
}

impl Budgets {
    /// An error where nothing could ever be shown.
    pub(crate) fn check(&self) -> Result<()> {
        let counts = [
            ("slots", self.slots as usize),
            ("features", self.features as usize),
            ("reads", self.reads),
            ("loads", self.loads),
            ("decodes", self.decodes),
            ("suns", self.suns),
        ];
        if let Some((what, _)) = counts.iter().find(|(_, count)| *count == 0) {
            return Err(Error::Invalid(format!("a budget of 0 {what}; expected at least 1")));
        }
        if self.features < self.slots {
            return Err(Error::Invalid(format!(
                "a budget of {} features for {} slots; expected at least as many",
                self.features, self.slots
            )));
        }
        if self.tolerance.is_nan() || self.tolerance < 0.0 {
            return Err(Error::Invalid(format!("a tolerance of {}; expected a number ≥ 0", self.tolerance)));
        }
        Ok(())
    }
}
