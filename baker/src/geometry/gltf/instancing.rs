//! `EXT_mesh_gpu_instancing`: a node whose mesh stands at several places.

use super::accessor::read_floats;
use super::material::OpenAsset;
use dataset::{Error, Result};
use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;

/// The extension's name.
const NAME: &str = "EXT_mesh_gpu_instancing";

/// Where the node's mesh stands, each relative to the node; `None` for a node that is not instanced. `node`
/// is its JSON.
pub(super) fn transforms(asset: &OpenAsset, node: &Value, place: &str) -> Result<Option<Vec<DMat4>>> {
    let Some(extension) = node["extensions"].get(NAME) else { return Ok(None) };
    let place = format!("{place}: {NAME}");
    let attributes = &extension["attributes"];
    let translations = attribute::<3>(asset, attributes, "TRANSLATION", &place)?;
    let rotations = attribute::<4>(asset, attributes, "ROTATION", &place)?;
    let scales = attribute::<3>(asset, attributes, "SCALE", &place)?;
    let counts = [
        translations.as_ref().map(Vec::len),
        rotations.as_ref().map(Vec::len),
        scales.as_ref().map(Vec::len),
    ];
    let mut counts = counts.into_iter().flatten();
    let Some(count) = counts.next() else {
        return Err(Error::invalid(place, "expected an attribute TRANSLATION, ROTATION or SCALE"));
    };
    if let Some(other) = counts.find(|&other| other != count) {
        let what =
            format!("attributes of {count} and {other} elements: expected one of each for every instance");
        return Err(Error::invalid(place, what));
    }
    let mut result = Vec::with_capacity(count);
    for i in 0..count {
        let vector = |values: &Option<Vec<[f32; 3]>>, default| {
            values.as_ref().map_or(default, |values| DVec3::from(values[i].map(f64::from)))
        };
        let rotation = rotations
            .as_ref()
            .map_or(DQuat::IDENTITY, |values| DQuat::from_array(values[i].map(f64::from)).normalize());
        let (scale, translation) = (vector(&scales, DVec3::ONE), vector(&translations, DVec3::ZERO));
        let node_from_instance = DMat4::from_scale_rotation_translation(scale, rotation, translation);
        if !node_from_instance.is_finite() {
            let what =
                format!("instance {i}: its transform: expected finite numbers and a rotation other than 0");
            return Err(Error::invalid(place, what));
        }
        result.push(node_from_instance);
    }
    Ok(Some(result))
}

/// An attribute of the instances, if there is one of this name.
fn attribute<const N: usize>(
    asset: &OpenAsset,
    attributes: &Value,
    name: &str,
    place: &str,
) -> Result<Option<Vec<[f32; N]>>> {
    let Some(index) = attributes.get(name) else { return Ok(None) };
    let accessor =
        index.as_u64().and_then(|index| asset.document.accessors().nth(usize::try_from(index).ok()?));
    let accessor = accessor.filter(|accessor| accessor.view().is_some());
    let accessor = accessor.ok_or_else(|| {
        Error::invalid(
            place,
            format!("{name} = {index}: expected the index of an accessor that has a buffer view"),
        )
    })?;
    Ok(Some(read_floats::<N>(&accessor, asset.buffers, place)?))
}
