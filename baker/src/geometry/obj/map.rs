//! Texture statements of an MTL, such as `map_Kd -s 2 2 1 bark.png`: their options and their picture.

use super::material::Material;
use super::statements::{find, name, read_file};
use crate::geometry::Wrap;
use crate::geometry::model::reason;
use crate::geometry::notes::Notes;
use crate::geometry::texture::TextureStore;
use dataset::{Error, Result};
use glam::{DVec2, Vec2};
use std::path::{Path, PathBuf};

/// What is read of a texture statement.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    /// The picture.
    pub path: PathBuf,
    pub wrap: Wrap,
    pub placement: Placement,
}

/// How a texture lies on the `vt`: `-s` and `-o`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    scale: DVec2,
    offset: DVec2,
}

impl Placement {
    /// Where the texture is not moved.
    pub(super) const IDENTITY: Self = Self { scale: DVec2::ONE, offset: DVec2::ZERO };

    /// Texture coordinates, v down, of a `vt`, whose v runs up.
    pub(super) fn uv(&self, vt: [f64; 2]) -> Vec2 {
        let [u, v] = (DVec2::from_array(vt) * self.scale + self.offset).to_array();
        Vec2::new(u as f32, (1.0 - v) as f32)
    }
}

/// Reads a texture statement of a material, if there is one.
///
/// Options that change colours in a way that is not read are an error; those that do not are skipped.
pub(super) fn read(
    material: &Material,
    key: &'static str,
    folder: &Path,
    notes: &mut Notes,
) -> Result<Option<Map>> {
    let Some(statement) = material.get(key) else { return Ok(None) };
    let mut rest = statement.text.trim();
    let (mut wrap, mut placement) = (Wrap::Repeat, Placement::IDENTITY);
    while rest.starts_with('-') {
        let words: Vec<&str> = rest.split_whitespace().take(5).collect();
        let option = words[0].to_ascii_lowercase();
        let numbers: Vec<f64> = words[1..].iter().take(3).map_while(|word| word.parse().ok()).collect();
        let arguments = match option.as_str() {
            "-o" | "-s" | "-t" => numbers.len(),
            "-mm" => 2,
            _ => 1,
        };
        if words.len() <= arguments + 1 {
            break;
        }
        let or = |i: usize, default: f64| numbers.get(i).copied().unwrap_or(default);
        match option.as_str() {
            "-clamp" if words[1].eq_ignore_ascii_case("on") => wrap = Wrap::Clamp,
            "-o" => placement.offset = DVec2::new(or(0, 0.0), or(1, 0.0)),
            "-s" => placement.scale = DVec2::new(or(0, 1.0), or(1, 1.0)),
            "-t" if numbers.iter().any(|x| *x != 0.0) => return Err(statement.unsupported("-t (turbulence)")),
            "-mm" if numbers.get(..2) != Some(&[0.0, 1.0]) => {
                return Err(statement.unsupported("-mm (brightness and contrast)"));
            }
            "-imfchan" if key != "map_d" => return Err(statement.unsupported("-imfchan (a channel alone)")),
            "-clamp" | "-t" | "-mm" | "-imfchan" | "-blendu" | "-blendv" | "-boost" | "-bm" | "-cc"
            | "-texres" | "-type" | "-colorspace" => {}
            _ => notes.add(
                &statement.file,
                "option",
                format!("{} ({key}, line {})", words[0], statement.line),
                "the option is unknown: it and the word after it are skipped",
            ),
        }
        for word in &words[..=arguments] {
            rest = rest.trim_start()[word.len()..].trim_start();
        }
    }
    if !(placement.scale.is_finite() && placement.offset.is_finite()) {
        return Err(statement.error("finite numbers after -o and -s"));
    }
    let folders = [material.folder(), folder];
    let whole = find(&folders, rest);
    let path = match name(rest) {
        // A name may hold what else begins a comment.
        _ if whole.is_file() => whole,
        // Exporters write the statement without a file, too.
        "" => PathBuf::new(),
        name => find(&folders, name),
    };
    Ok(Some(Map { path, wrap, placement }))
}

impl Map {
    /// Adds the picture to a store; gives its index there, or notes why it cannot be read, and that `then`.
    pub(super) fn add(
        &self,
        material: &Material,
        store: &mut TextureStore,
        file: &str,
        then: &str,
        notes: &mut Notes,
    ) -> Option<u32> {
        let place = format!("{file}: material {}", material.name);
        let bytes = if self.path == Path::new("") {
            Err(Error::invalid(&place, "it names no file"))
        } else {
            read_file(&self.path)
        };
        match bytes.and_then(|bytes| store.add(&bytes, self.wrap, self.wrap, &place)) {
            Ok(texture) => Some(texture),
            Err(error) => {
                let error = match error {
                    Error::Io { .. } => error.to_string(),
                    _ if self.path == Path::new("") => reason(&error),
                    _ => format!("{}: {}", self.path.display(), reason(&error)),
                };
                notes.add(file, "material", format!("{} ({error})", material.name), then);
                None
            }
        }
    }
}
