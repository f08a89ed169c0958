//! `Ke` and `map_Ke` of an MTL: what its materials emit.

use super::{map_options, resolve};
use crate::geometry::model::{FileEmission, reason};
use crate::geometry::notes::Notes;
use crate::geometry::texture::TextureStore;
use dataset::Error;
use glam::Vec3;
use std::path::Path;

/// What the reader is shown in place of `Ke`.
pub(super) const KE: &str = "as_written_Ke";

/// Reads what a material emits; what is wrong is noted, and emits nothing.
pub(super) fn read(
    material: &tobj::Material,
    file: &str,
    folder: &Path,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Option<FileEmission> {
    let ke = material.unknown_param.get(KE).map(|ke| (ke, numbers(ke)));
    let map = material.unknown_param.get("map_Ke");
    let value = match ke {
        // A map alone means Ke 1; exporters write Ke 0 beside a map that is meant to shine.
        None | Some((_, Some(Vec3::ZERO))) if map.is_some() => Vec3::ONE,
        None | Some((_, Some(Vec3::ZERO))) => return None,
        Some((_, Some(value))) => value,
        Some((written, None)) => {
            let what = "Ke is not used: expected one number or three, each 0 or more";
            notes.add(file, "material", format!("{} (Ke {written})", material.name), what);
            return None;
        }
    };
    let Some(map) = map else { return Some(FileEmission { value, texture: None }) };
    let (name, wrap) = map_options(map);
    let path = resolve(folder, name);
    let bytes = std::fs::read(&path).map_err(Error::io(&path));
    let place = format!("{file}: material {}", material.name);
    match bytes.and_then(|bytes| textures.emission().add(&bytes, wrap, wrap, &place)) {
        Ok(texture) => Some(FileEmission { value, texture: Some(texture) }),
        Err(error) => {
            let error = match error {
                Error::Io { .. } => error.to_string(),
                _ => format!("{}: {}", path.display(), reason(&error)),
            };
            let what = "map_Ke cannot be read: the material emits nothing; add the file, or give the part an `emission`";
            notes.add(file, "material", format!("{} ({error})", material.name), what);
            None
        }
    }
}

/// One number, which stands for three, or three.
fn numbers(text: &str) -> Option<Vec3> {
    let numbers: Option<Vec<f32>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    let value = match numbers?[..] {
        [grey] => Vec3::splat(grey),
        [r, g, b] => Vec3::new(r, g, b),
        _ => return None,
    };
    (value.is_finite() && value.min_element() >= 0.0).then_some(value)
}
