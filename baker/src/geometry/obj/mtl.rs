//! MTL libraries: the statements that are read of their materials, and what reflects.

use super::statements::{self, name, quoted, read_file, words};
use super::{emission, glass, map};
use crate::geometry::model::{DEFAULT_ALBEDO, FileMaterial, check_albedo};
use crate::geometry::notes::Notes;
use crate::geometry::texture::TextureStore;
use crate::text;
use dataset::{Error, Result};
use glam::Vec3;
use map::Placement;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The keywords that are read, in any case.
const KEYWORDS: [&str; 9] = ["Kd", "Ke", "d", "Tr", "Tf", "illum", "map_Kd", "map_Ke", "map_d"];

/// Materials by name.
pub(super) type Materials = BTreeMap<String, Material>;

/// A material as its library defines it.
pub(super) struct Material {
    pub name: String,
    path: Arc<Path>,
    statements: BTreeMap<&'static str, Statement>,
}

/// A statement about a material.
pub(super) struct Statement {
    keyword: &'static str,
    /// What follows the keyword.
    pub text: String,
    pub file: Arc<str>,
    pub line: usize,
}

/// A material that is ready to be used.
pub(super) struct Read {
    pub material: FileMaterial,
    /// How its texture lies on the `vt`.
    pub texture: Placement,
    /// How its emission map does, if it has one.
    pub emission: Option<Placement>,
}

impl Material {
    /// The last statement with a keyword of [`KEYWORDS`].
    pub(super) fn get(&self, keyword: &str) -> Option<&Statement> {
        self.statements.get(keyword)
    }

    /// The folder that its paths start from.
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }
}

impl Statement {
    /// The numbers that follow the keyword, if nothing else does.
    pub(super) fn numbers(&self) -> Option<Vec<f32>> {
        words(&self.text).map(|word| word.parse().ok()).collect()
    }

    /// Three numbers, or one that stands for three.
    pub(super) fn triple(&self) -> Option<Vec3> {
        match self.numbers()?[..] {
            [grey] => Some(Vec3::splat(grey)),
            [r, g, b] => Some(Vec3::new(r, g, b)),
            _ => None,
        }
    }

    /// An error that quotes it.
    pub(super) fn error(&self, expected: &str) -> Error {
        Error::invalid(self.place(), format!("{}: expected {expected}", quoted(self.keyword, &self.text)))
    }

    /// An error about an option that cannot be read.
    pub(super) fn unsupported(&self, option: &str) -> Error {
        let what = format!(
            "{}: the option {option} changes the texture and is not read: apply it to the picture itself, and remove it here",
            quoted(self.keyword, &self.text)
        );
        Error::unsupported(self.place(), what)
    }

    /// `file:line`.
    pub(super) fn place(&self) -> String {
        format!("{}:{}", self.file, self.line)
    }
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
