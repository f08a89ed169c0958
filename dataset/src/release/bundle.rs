//! Bundles of a release: whole, and of the light that they are released with.

use crate::error::of_bundle;
use crate::{Error, Result};
use ndgi::Bundle;
use std::path::Path;

/// An error for a bundle that is damaged anywhere, or that does not say that it was made from the light of
/// this digest, or that it is a coarser level of it.
pub(super) fn expect_whole(path: &Path, light: &str) -> Result<()> {
    let bundle = Bundle::open(path).map_err(of_bundle)?;
    bundle.verify().map_err(of_bundle)?;
    let info: serde_json::Value = serde_json::from_str(&bundle.header.info).unwrap_or_default();
    if info["inputs"] == light || info["level_of"] == light {
        return Ok(());
    }
    let how = "run `compress` on this dataset again";
    let what = match info["inputs"].is_string() {
        true => format!("made from different light than the dataset's; {how}"),
        false => format!("does not say from which light it was made, so it may be another dataset's; {how}"),
    };
    Err(Error::invalid(path.display(), what))
}
