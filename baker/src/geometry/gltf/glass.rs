//! What glTF materials let through: `KHR_materials_transmission`, and `alphaMode` BLEND as coverage.

use super::material::{OpenAsset, UvSource, texture, uv_source};
use crate::geometry::Glass;
use crate::geometry::model::{FileMaterial, reason};
use crate::geometry::notes::Notes;
use crate::geometry::texture::{Alpha, TextureStore};
use dataset::{Error, Result};
use glam::Vec3;
use gltf::material::AlphaMode;

/// Where the surface of a BLEND that is a cut-out begins.
const CUTOFF: f32 = 0.5;

/// Reads what a material lets through. `is_thinned` says that vertex colours have an alpha below 1; `found`
/// is what else was read of it; `uv` its texture coordinates, which a transmission texture decides where
/// there is no other.
pub(super) fn read(
    asset: &OpenAsset,
    material: &gltf::Material,
    is_thinned: bool,
    found: &mut FileMaterial,
    uv: &mut UvSource,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<()> {
    let mut is_blended = material.alpha_mode() == AlphaMode::Blend;
    if is_blended && found.alpha == 1.0 && !is_thinned {
        let alpha = found.texture.map(|texture| textures.textures[texture as usize].alpha());
        match alpha {
            None | Some(Alpha::Opaque) => is_blended = false,
            Some(Alpha::CutOut) => (is_blended, found.alpha_cutoff) = (false, Some(CUTOFF)),
            Some(Alpha::Varied) => {}
        }
    }
    let mut glass = Glass { transmission: Vec3::ZERO, tint: None, texture: None, is_blended };
    if let Some(transmission) = material.transmission() {
        let shown = match (found.name.as_str(), material.index()) {
            ("", Some(number)) => number.to_string(),
            (name, _) => name.to_owned(),
        };
        let place = format!("{}: material {shown}", asset.file);
        let factor = transmission.transmission_factor();
        if !(0.0..=1.0).contains(&factor) {
            let what = format!("transmissionFactor = {factor}: expected a number from 0 to 1");
            return Err(Error::invalid(place, what));
        }
        (glass.transmission, glass.tint) = (Vec3::splat(factor), Some(found.albedo));
        if let Some(info) = transmission.transmission_texture().filter(|_| factor > 0.0) {
            let source = uv_source(&info, &place)?;
            match texture(asset, &info.texture(), textures, &place) {
                Err(error) => {
                    let what = "the transmission texture cannot be read: its factor alone is used";
                    notes.add(asset.file, "material", format!("{shown} ({})", reason(&error)), what);
                }
                Ok(_) if found.texture.is_some() && source != *uv => {
                    let what = "the transmission texture has other coordinates than the base colour: its factor alone is used";
                    notes.add(asset.file, "material", &shown, what);
                }
                Ok(index) => (glass.texture, *uv) = (Some(index), source),
            }
        }
        if factor > 0.0 && material.volume().is_some() {
            let what = "KHR_materials_volume is not used: glass is thin, and each surface of a closed body dims light by itself";
            notes.add(asset.file, "material", &shown, what);
        }
    }
    found.glass = (is_blended || glass.transmission != Vec3::ZERO).then_some(glass);
    Ok(())
}
