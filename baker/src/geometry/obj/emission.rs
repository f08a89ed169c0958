//! `Ke` and `map_Ke` of an MTL: what its materials emit.

use super::map::{self, Placement};
use super::material::Material;
use crate::geometry::model::FileEmission;
use crate::geometry::notes::Notes;
use crate::geometry::texture::TextureStore;
use dataset::Result;
use glam::Vec3;
use std::path::Path;

/// Reads what a material emits, and how its map lies on the `vt`; a colour or picture that is wrong is noted,
/// and emits nothing.
pub(super) fn read(
    material: &Material,
    file: &str,
    folder: &Path,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<Option<(FileEmission, Option<Placement>)>> {
    let map = map::read(material, "map_Ke", folder, notes)?;
    let value = match material.get("Ke") {
        None => Vec3::ZERO,
        Some(ke) => match ke.triple().filter(|v| v.is_finite() && v.min_element() >= 0.0) {
            Some(value) => value,
            None => {
                let what = "Ke is not used: expected one number or three, each 0 or more";
                notes.add(file, "material", format!("{} (Ke {})", material.name, ke.text), what);
                return Ok(None);
            }
        },
    };
    // A map alone means Ke 1; exporters write Ke 0 beside a map that is meant to shine.
    let value = if value == Vec3::ZERO && map.is_some() { Vec3::ONE } else { value };
    let Some(map) = map else {
        return Ok((value != Vec3::ZERO).then_some((FileEmission { value, texture: None }, None)));
    };
    let then =
        "map_Ke cannot be read: the material emits nothing; add the file, or give the part an `emission`";
    let texture = map.add(material, textures.emission(), file, then, notes);
    Ok(texture.map(|texture| (FileEmission { value, texture: Some(texture) }, Some(map.placement))))
}
