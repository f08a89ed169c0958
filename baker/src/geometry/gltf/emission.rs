//! What glTF materials emit: `emissiveFactor`, `emissiveTexture`, `KHR_materials_emissive_strength`.

use super::material::{OpenAsset, UvSource, texture, uv_source};
use crate::geometry::model::{FileEmission, reason};
use crate::geometry::notes::Notes;
use crate::geometry::texture::TextureStore;
use dataset::Result;
use glam::{Mat2, Vec2, Vec3};

/// Reads what a material emits, and where the coordinates of its texture come from. A texture that cannot be
/// read is noted.
pub(super) fn emission(
    asset: &OpenAsset,
    material: &gltf::Material,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<(Option<FileEmission>, UvSource)> {
    let mut uv = UvSource { set: 0, matrix: Mat2::IDENTITY, offset: Vec2::ZERO };
    let shown = || match (material.name(), material.index()) {
        (Some(name), _) if !name.is_empty() => name.to_owned(),
        (_, index) => index.unwrap_or(0).to_string(),
    };
    let strength = material.emissive_strength().unwrap_or(1.0);
    let value = Vec3::from(material.emissive_factor()) * strength;
    if !(value.is_finite() && value.min_element() >= 0.0 && strength >= 0.0) {
        let what =
            "its emission is not used: expected a factor and a strength of finite numbers, each 0 or more";
        notes.add(asset.file, "material", shown(), what);
        return Ok((None, uv));
    }
    if value == Vec3::ZERO {
        return Ok((None, uv));
    }
    let Some(info) = material.emissive_texture() else {
        return Ok((Some(FileEmission { value, texture: None }), uv));
    };
    let place = format!("{}: material {}", asset.file, shown());
    uv = uv_source(&info, &place)?;
    match texture(asset, &info.texture(), textures.emission(), &place) {
        Ok(texture) => Ok((Some(FileEmission { value, texture: Some(texture) }), uv)),
        Err(error) => {
            let what = "the emissive texture cannot be read: the material emits nothing; add the file, or give the part an `emission`";
            notes.add(asset.file, "material", format!("{} ({})", shown(), reason(&error)), what);
            Ok((None, uv))
        }
    }
}
