//! A scene file to begin with, written for models: what `bake new` does.
//!
//! `glowing` knows names of lamps, `units` guesses the unit of length, `up` the upward axis, `dim` what is no
//! lamp though it emits, `bake::prepare::openings` finds windows, `find` puts that together, `write`
//! makes the text.

mod glowing;
mod units;
mod up;
mod dim;
mod find;
mod write;

pub use find::{Found, Model, find};
pub use units::Unit;

use crate::bake::output::relative_to;
use crate::scene::{Scene, is_reserved};
use crate::{Error, Result};
use dataset::host::files::write_atomically;
use dataset::observe::{Observer, count};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Where to write, and whether over a file that is there.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// The scene file to write [default: beside the first model, with its name, or its folder's if it is
    /// called scene, model or untitled].
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// The unit of length of all models: metres, centimetres or millimetres [default: guessed].
    #[arg(long, value_name = "UNIT", value_parser = units::parse)]
    pub unit: Option<Unit>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
}

/// For `--help`.
pub const HELP: &str = "\
Examples:
  bake new models/house.glb                        models/house.toml, then: bake models/house.toml --draft
  bake new models/house.glb --out scenes/house.toml
  bake new house.glb garden.glb trees.obj          house.toml, which has all three
  bake new plan.obj --unit millimetres

The file is a start, with a comment on each guess: the unit of length (metres, centimetres or millimetres, by the size of the
models and of their triangles), a turn for an OBJ whose z axis points up, window-like openings as portals, the models' emitters as
light groups (leaves and faint ones are switched off), the models' cameras or a default one, and the lightmap's size.

With --json, one object on stdout: scene, triangles, unit, metres_per_unit, extent (metres), size, texels_per_metre, portals, groups
and cameras (names), models (each file, extent in metres, up: y or z, switched_off: names of materials), warnings.";

/// Writes a scene file for models; gives what `--json` prints.
///
/// # Errors
/// As [`find`]; a scene file that is there already, or cannot be written.
pub fn new(models: &[PathBuf], options: &Options, console: &dyn Observer) -> Result<serde_json::Value> {
    // (Before anything is said of the file to write: a scene file may be what was given.)
    Scene::of_models(models)?;
    let first = models.first().ok_or_else(|| Error::invalid("bake new", "expected a model"))?;
    let name = plain(&name_of(first));
    let out = options.out.clone().unwrap_or_else(|| first.with_file_name(format!("{name}.toml")));
    if out.extension().is_none_or(|e| e != "toml") {
        return Err(Error::invalid(
            "--out",
            format!("{}: expected a file that ends in .toml", out.display()),
        ));
    }
    if out.exists() && !options.force {
        let what = "is there already; --force replaces it, --out writes elsewhere";
        return Err(Error::invalid(out.display(), what));
    }
    let found = find(models, options.unit)?;
    found.warnings.iter().for_each(|warning| console.warn(warning));
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let named = plain(&stem);
    let files: Result<Vec<String>> = models.iter().map(|model| from_folder_of(&out, model)).collect();
    let text = write::scene_file(&found, (named != stem).then_some(&named), &files?);
    write_atomically(&out, text.as_bytes())?;

    let [x, y, z] = found.extent.to_array();
    console.say(format!(
        "{}: {}{}, taken as {}: {x:.2} × {y:.2} × {z:.2} m, {}, {}, a lightmap of {}² (about {:.0} texels per metre)",
        out.display(),
        if models.len() > 1 { format!("{}, ", count(models.len(), "model")) } else { String::new() },
        count(found.triangles, "triangle"),
        found.unit.name,
        count(found.portals.len(), "portal"),
        count(found.groups.len(), "light group"),
        found.side,
        found.texels_per_metre
    ));
    let off: Vec<&str> =
        found.models.iter().flat_map(|m| &m.switched_off).map(|off| off.name.as_str()).collect();
    if !off.is_empty() {
        let (shown, rest) = off.split_at(off.len().min(5));
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        let shown = shown.join(", ");
        console.say(format!(
            "  emission switched off, because it is probably not a lamp: {shown}{more} (reasons in the file)"
        ));
    }
    let shown = out.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@%".contains(c);
    let shown =
        if shown.chars().all(is_plain) { shown } else { format!("'{}'", shown.replace('\'', "'\\''")) };
    console.say(format!("  next: bake {shown} --draft --compress"));
    let of_model = |model: &Model| {
        json!({
            "file": model.file,
            "extent": model.extent.to_array(),
            "up": if model.is_turned() { "z" } else { "y" },
            "switched_off": model.switched_off.iter().map(|off| &off.name).collect::<Vec<_>>(),
        })
    };
    Ok(json!({
        "scene": out,
        "triangles": found.triangles,
        "unit": found.unit.name,
        "metres_per_unit": found.unit.metres,
        "extent": [x, y, z],
        "size": found.side,
        "texels_per_metre": found.texels_per_metre,
        "portals": found.portals.len(),
        "groups": found.groups,
        "cameras": found.cameras.iter().map(|c| &c.name).collect::<Vec<_>>(),
        "models": found.models.iter().map(of_model).collect::<Vec<_>>(),
        "warnings": found.warnings,
    }))
}

/// What a model is called: by its folder, where its own name is one that many have.
fn name_of(model: &Path) -> String {
    let stem = model.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let folder = std::path::absolute(model).ok();
    let folder = folder.as_deref().and_then(Path::parent).and_then(Path::file_name);
    match folder {
        Some(folder) if ["scene", "model", "untitled"].contains(&stem.to_ascii_lowercase().as_str()) => {
            folder.to_string_lossy().into_owned()
        }
        _ => stem,
    }
}

/// A text as the name of a scene: letters, digits, `_` and `-`.
fn plain(text: &str) -> String {
    let plain: String = text
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || c == '_' || c == '-' { c } else { '-' })
        .collect();
    let plain = plain.trim_matches('-');
    match plain {
        "" => "scene".to_owned(),
        taken if is_reserved(taken) => format!("{taken}-scene"),
        plain => plain.to_owned(),
    }
}

/// The path of a model as a scene file in another folder names it, with slashes also where folders are
/// divided otherwise.
fn from_folder_of(scene_file: &Path, model: &Path) -> Result<String> {
    // (Without `..` and links to folders: what is left of a path after a step up depends on where they lead.)
    let real = |path: &Path| {
        let path = if path == Path::new("") { Path::new(".") } else { path };
        path.canonicalize().map_err(Error::io(path))
    };
    let folder = real(scene_file.parent().unwrap_or(Path::new("")))?;
    let models = real(model.parent().unwrap_or(Path::new("")))?;
    let relative = relative_to(&folder, &models.join(model.file_name().unwrap_or_default()));
    Ok(relative.components().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/"))
}
