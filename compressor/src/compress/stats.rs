//! Training statistics of a tile.

use crate::train::TrainedTile;
use serde::{Deserialize, Serialize};

/// Training statistics of one tile.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileStats {
    /// Valid texels including the border: its weight in means over tiles.
    pub texels: usize,
    /// What training gave, without the parameters.
    pub trained: TrainedTile,
    /// CPU seconds.
    pub seconds: f64,
}
