//! The limits of a stream.

use crate::{Error, Result};

/// The limits of a stream. The defaults suit a view of 1920×1080, whatever the size of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Budgets {
    /// Decoded tiles on the device: 128² texels of 16 bytes each, so 262 KB a tile, the sun included.
    pub slots: u32,
    /// Tiles whose features are on the device, about 60 KB each. At least `slots`, so that every shown tile
    /// can be decoded again.
    pub features: u32,
    /// Tiles that are being read, or wait in memory to be loaded. And as many reads of intervals of the sun.
    pub reads: usize,
    /// Tiles that are loaded onto the device per step, and as many intervals of the sun.
    pub loads: usize,
    /// Tiles whose maps are decoded per step. At a light switch all wanted tiles that it affects are decoded
    /// in one step, however many.
    pub decodes: usize,
    /// Tiles of which only the sun is decoded, per step.
    pub suns: usize,
    /// Relative change of light up to which a tile is not decoded again.
    pub tolerance: f32,
    /// Failed reads of a tile after which it is reported. It is tried on, less and less often, unless the
    /// failure is lasting.
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
    /// An error for budgets under which nothing could ever be shown.
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
                "a budget of {} features for {} slots; expected at least one per slot",
                self.features, self.slots
            )));
        }
        if self.tolerance.is_nan() || self.tolerance < 0.0 {
            return Err(Error::Invalid(format!("a tolerance of {}; expected a number ≥ 0", self.tolerance)));
        }
        Ok(())
    }
}
