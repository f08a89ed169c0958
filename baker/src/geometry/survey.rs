//! The lamps and cameras of a geometry file alone, without a scene.

use super::contents::Contents;
use super::notes::Notes;
use super::texture::TextureStore;
use super::{gltf, obj};
use dataset::{Error, Result};
use std::path::Path;

/// Lists the lamps and cameras of a geometry file.
///
/// # Errors
/// As [`super::load`], of one file.
pub fn contents(file: &Path) -> Result<Contents> {
    let (mut textures, mut notes) = (TextureStore::default(), Notes::default());
    let extension = file.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let model = match extension.as_str() {
        "obj" => obj::load(file, false, &mut textures, &mut notes)?,
        "gltf" | "glb" => gltf::load(file, &mut textures, &mut notes)?,
        _ => return Err(Error::unsupported(file.display(), "expected an .obj, .gltf or .glb file")),
    };
    Ok(model.contents)
}
