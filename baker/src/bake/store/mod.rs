//! What a bake keeps on disk, and the values in it. It reads no scene and traces no rays.
//!
//! In: sums of samples, values of layers, charts of meshes. Out: the same, read back whole or not at all.
//! Callers: every other folder.
//!
//! - [`BlockState`]: the sums of a block (`state`), packed by `columns`; [`Value`]: a layer at one texel
//!   (`value`).
//! - [`WorkFolder`]: the folder of unfinished work (`work`). Its files are sealed with a checksum (`sealed`)
//!   or JSON (`json`).
//! - [`Charts`]: how meshes were unwrapped, for later bakes, too.

pub(super) mod json;
pub(super) mod sealed;
mod columns;
mod state;
mod value;
mod work;
mod charts;

pub(super) use charts::{CHARTS_FILE, LAYERS_FOLDER};
pub use charts::{Charts, Counts};
pub use state::CELL;
pub(super) use state::{
    ALL_POINTS, BlockState, CELLS, Direct, POINTS, SumKinds, cell_of, is_enough, is_usable,
};
pub(super) use value::{Filtered, StoredValue};
pub use value::{Parts, Value};
pub(super) use work::{CACHE_FILE, DIRECT_FILE, PIVOT_FILE, ROUNDS_FILE, UNSETTLED_FILE, WorkFolder};
