//! What is stored.
//!
//! In: a trained model. Out: its [`TileParams`](crate::model::TileParams). Callers: `phases`.
//!
//! `quantise` leads: it chooses the blocks of both maps, and rounds planes and network. `blocks` fits one
//! BC7 block to given texels, with the algebra of `matrices`. `descent` improves the blocks of F_uvt by
//! coordinate descent; `form` improves one of them.

pub(super) mod matrices;
pub(super) mod blocks;
pub(super) mod form;
pub(super) mod descent;
pub(super) mod quantise;
