//! MTL libraries: the statements that are read of their materials, and what reflects.

use super::material::{Material, Statement};
use super::statements::{self, name, read_file};
use super::{emission, glass, map};
use crate::geometry::model::{DEFAULT_ALBEDO, FileMaterial, check_albedo};
use crate::geometry::notes::Notes;
use crate::geometry::texture::TextureStore;
use crate::text;
use dataset::Result;
use glam::Vec3;
use map::Placement;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The keywords that are read, in any case.
const KEYWORDS: [&str; 9] = ["Kd", "Ke", "d", "Tr", "Tf", "illum", "map_Kd", "map_Ke", "map_d"];

/// Materials by name.
pub(super) type Materials = BTreeMap<String, Material>;

/// A material that is ready to be used.
pub(super) struct Read {
    pub material: FileMaterial,
    /// How its texture lies on the `vt`.
    pub texture: Placement,
    /// How its emission map does, if it has one.
    pub emission: Option<Placement>,
}

/// Adds the materials of a library; of several of one name, the last one holds. (The name may be empty, as
/// that after `usemtl`.)
///
/// # Errors
/// [`Error::Io`].
pub(super) fn load(path: &Path, materials: &mut Materials) -> Result<()> {
    let bytes = read_file(path)?;
    let (path, file): (Arc<Path>, Arc<str>) = (path.into(), path.display().to_string().into());
    let mut current = None;
    statements::read(&text::decode(&bytes), |statement| {
        if statement.keyword.eq_ignore_ascii_case("newmtl") {
            let name = name(statement.rest);
            let material =
                Material { name: name.to_owned(), path: path.clone(), statements: BTreeMap::new() };
            materials.insert(name.to_owned(), material);
            current = Some(name.to_owned());
        } else if let Some(keyword) = KEYWORDS.iter().find(|k| statement.keyword.eq_ignore_ascii_case(k)) {
            let material = current.as_ref().and_then(|name| materials.get_mut(name));
            if let Some(material) = material {
                let text = statement.rest.to_owned();
                let read = Statement { keyword, text, file: file.clone(), line: statement.line };
                material.statements.insert(keyword, read);
            }
        }
        Ok(())
    })
}

/// Reads a material for use: `Kd` (linear) and `map_Kd`, `Ke` and `map_Ke`; a `map_d` that is the same file
/// makes a cut-out. One that no library defines has the default albedo, or, where vertices have colours,
/// theirs.
pub(super) fn read(
    name: &str,
    material: Option<&Material>,
    has_colours: bool,
    file: &str,
    folder: &Path,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<Read> {
    let mut result = FileMaterial {
        name: name.to_owned(),
        albedo: if has_colours { Vec3::ONE } else { Vec3::splat(DEFAULT_ALBEDO) },
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: false,
        glass: None,
        undefined: material.is_none() && !has_colours,
        emission: None,
    };
    let Some(material) = material else {
        return Ok(Read { material: result, texture: Placement::IDENTITY, emission: None });
    };
    let kd = material.get("Kd");
    if let Some(kd) = kd {
        let colour = kd.triple().ok_or_else(|| kd.error("one number or three"))?;
        result.albedo = check_albedo(colour.to_array(), &kd.place(), "Kd")?;
    }
    let base = map::read(material, "map_Kd", folder, notes)?;
    if let Some(map) = &base {
        let then = "map_Kd cannot be read: Kd alone is used; add the file, or give the part an `albedo`";
        result.texture = map.add(material, textures, file, then, notes);
        // Exporters write Kd 0 beside a texture that is meant to be seen.
        if result.texture.is_some() && (kd.is_none() || result.albedo == Vec3::ZERO) {
            result.albedo = Vec3::ONE;
        }
    }
    if let Some(map) = map::read(material, "map_d", folder, notes)? {
        if base.as_ref().is_some_and(|base| base.path == map.path && base.placement == map.placement) {
            result.alpha_cutoff = Some(0.5);
        } else {
            let what = "map_d is not used: put the cut-out into map_Kd's alpha";
            notes.add(file, "material", format!("{} ({})", material.name, map.path.display()), what);
        }
    }
    let emission = emission::read(material, file, folder, textures, notes)?;
    result.emission = emission.as_ref().map(|(emission, _)| *emission);
    result.glass = glass::read(material, file, notes)?;
    Ok(Read {
        material: result,
        texture: base.map_or(Placement::IDENTITY, |map| map.placement),
        emission: emission.and_then(|(_, placement)| placement),
    })
}
