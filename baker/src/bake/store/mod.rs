//! The room of what is kept while a bake works, and of the values in it. It knows no scene and traces
//! nothing.
//!
//! In: sums of samples, values of layers, charts of meshes. Out: the same, read back whole or not at all.
//! Callers: every other room.
//!
//! - [`BlockState`], the sums of a block of texels (`state`), packed by `columns`; [`Value`], a layer at one
//!   texel (`value`);
//! - [`WorkFolder`], the folder of unfinished work (`work`), of sealed files (`sealed`) and JSON (`json`);
//! - [`Charts`], how meshes come apart (`charts`).

pub(super) mod json;
pub(super) mod sealed;
mod columns;
mod state;
mod value;
mod work;
mod charts;

pub(super) use charts::{CHARTS, FOLDER};
pub use charts::{Charts, Counts};
pub use state::CELL;
pub(super) use state::{
    ALL_POINTS, BlockState, CELLS, Direct, POINTS, SumKinds, cell_of, is_enough, is_usable,
};
pub(super) use value::{Filtered, Stored};
pub use value::{Parts, Value};
pub(super) use work::{CACHE, DIRECT, PIVOT, ROUNDS, UNSETTLED, WorkFolder};
