//! Chart placements on pages of half the size.
//!
//! Texel position p of a page is p ÷ 2 of its half. Where a side is odd, its half ends beyond it, and page
//! coordinates shrink.

use crate::format::Config;
use gltf::Glb;
use serde_json::{Value, json};
use std::borrow::Cow;

/// A side of the half in which the whole side lies, as its share of the half's side: 1 for an even number of
/// texels.
fn share(side: u32) -> f64 {
    f64::from(side) / (2.0 * f64::from(side.div_ceil(2)))
}

/// The factors of page coordinates u and v, of a page of the full resolution.
fn shares(config: &Config, page: usize) -> Option<[f64; 2]> {
    config.pages.get(page).map(|page| [share(page.width), share(page.height)])
}

/// Moves the instances of a manifest whose pages still have the full resolution.
pub(super) fn move_instances(config: &mut Config) {
    let shares: Vec<Option<[f64; 2]>> =
        config.instances.iter().map(|instance| shares(config, instance.page as usize)).collect();
    for (instance, shares) in config.instances.iter_mut().zip(shares) {
        for (axis, share) in shares.iter().flatten().enumerate() {
            for value in [&mut instance.scale[axis], &mut instance.offset[axis]] {
                *value = (f64::from(*value) * share) as f32;
            }
        }
    }
}

/// The geometry with the places of its nodes moved alike; as it was where all sides are even. `config` has
/// the pages of full resolution.
///
/// # Errors
/// What is wrong with the file.
pub(super) fn moved_geometry<'a>(bytes: &'a [u8], config: &Config) -> Result<Cow<'a, [u8]>, String> {
    let is_even = |page: usize| shares(config, page) == Some([1.0; 2]);
    if (0..config.pages.len()).all(is_even) {
        return Ok(Cow::Borrowed(bytes));
    }
    let mut glb = Glb::from_slice(bytes).map_err(|e| format!("is not a GLB file: {e}"))?;
    let mut root: Value =
        serde_json::from_slice(&glb.json).map_err(|e| format!("its JSON is damaged: {e}"))?;
    // (Indexing by a key that is not there would add it.)
    for node in root.get_mut("nodes").and_then(Value::as_array_mut).into_iter().flatten() {
        let Some(page) = node["extras"]["lightmapPage"].as_u64() else { continue };
        let Some(shares) = shares(config, page as usize) else { continue };
        for key in ["lightmapScale", "lightmapOffset"] {
            for (axis, share) in shares.iter().enumerate() {
                let Some(value) = node["extras"][key][axis].as_f64() else { continue };
                // As of instances: a 32-bit float before and after.
                node["extras"][key][axis] = json!((f64::from(value as f32) * share) as f32);
            }
        }
    }
    glb.json = Cow::Owned(root.to_string().into_bytes());
    Ok(Cow::Owned(glb.to_vec().map_err(|e| format!("cannot be written: {e}"))?))
}
