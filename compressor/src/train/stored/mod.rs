//! The room of what is stored: BC7 blocks, and the form that the bundle has.
//!
//! In: trained maps. Out: their bytes. `blocks` encodes (`matrices` are its small linear algebra), `form`
//! chooses modes, `descent` trains through them, `quantise` rounds the rest.

pub(super) mod matrices;
pub(super) mod blocks;
pub(super) mod form;
pub(super) mod descent;
pub(super) mod quantise;
