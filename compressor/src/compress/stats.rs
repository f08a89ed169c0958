//! Training statistics of a tile.

use serde::{Deserialize, Serialize};

/// Training statistics of one tile.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileStats {
    /// Valid texels including the border: its weight in means over tiles.
    pub texels: usize,
    /// Steps of the main phase; 0 for a tile without light.
    pub steps: usize,
    /// CPU seconds of these steps.
    pub stepping_seconds: f64,
    /// PSNR before quantisation, in dB, where the tile has one.
    pub psnr_unquantised_db: Option<f64>,
    /// The same with features of 8 bits.
    pub psnr_8bit_features_db: Option<f64>,
    /// The same as stored.
    pub psnr_db: Option<f64>,
    /// Squared error as stored, as [`crate::train::TrialFit::error`] counts it.
    pub error: Option<f64>,
    /// (step, CPU seconds, dB) along the training.
    pub curve: Vec<(usize, f64, f64)>,
    /// Remarks: what was omitted and why, and others.
    #[serde(rename = "left_out")]
    pub omitted: Vec<String>,
    /// CPU seconds.
    pub seconds: f64,
}
