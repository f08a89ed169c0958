//! The finished dataset to look at, and whether it is of this scene.

use crate::atlas::{self, Atlas};
use crate::bake::hidden;
use crate::bake::scene_glb::to_glb;
use crate::geometry::Geometry;
use crate::scene::{Lightmap, Scene};
use crate::{Error, Result};
use dataset::console::Console;
use dataset::store::{Dataset, MANIFEST, UNFINISHED, WORK};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// An error where a folder holds no finished dataset.
pub fn expect_finished(folder: &Path, scene_file: &Path, scene: &str) -> Result<()> {
    if folder.join(MANIFEST).is_file() {
        return Ok(());
    }
    if folder.join(WORK).is_dir() {
        return Err(Error::invalid(folder.display(), UNFINISHED));
    }
    let what = format!(
        "no finished dataset; expected one of the scene {scene:?}: `bake {}` makes it, --dataset DIR names another folder",
        scene_file.display()
    );
    Err(Error::invalid(folder.display(), what))
}

/// Opens a dataset and lays out its texels.
///
/// # Errors
/// [`Error::Invalid`] where it is one of another geometry or layout than the scene has.
pub fn open(
    folder: &Path,
    scene_file: &Path,
    scene: &Scene,
    geometry: &Geometry,
    console: &Console,
) -> Result<(Dataset, Atlas, Vec<String>)> {
    let scene_file = scene_file.display();
    let dataset = Dataset::open(folder)?;
    dataset.expect_moments()?;
    let config = &dataset.config;
    let other = |what: &str| {
        let expected = format!("expected a dataset that `bake {scene_file}` made of the scene as it is now");
        Error::invalid(folder.display(), format!("{what}; {expected}"))
    };
    // As it was baked: a draft has other pages than the scene asks for.
    let lightmap = Lightmap::deserialize(&config.settings["lightmap"]);
    let lightmap = lightmap.map_err(|_| other("its settings do not say how its texels were laid out"))?;
    let atlas = {
        let progress = console.progress("unwrapping", 1);
        let hidden = hidden::find(geometry, &lightmap).triangles;
        let atlas = atlas::build_without(geometry, &lightmap, &hidden)?;
        progress.advance(1);
        atlas
    };
    // The geometry with its lightmap coordinates is a file of the dataset: the same bytes, the same texels at the same places.
    let glb = blake3::hash(&to_glb(geometry, &atlas)?.glb).to_hex();
    if config.geometry.as_ref().is_none_or(|file| file.blake3 != glb.as_str()) {
        return Err(other(&format!(
            "it is of the scene {:?}, whose geometry, materials or layout are not those that {scene_file} gives now",
            config.scene
        )));
    }
    let names = |names: Vec<&str>| format!("light groups {names:?}");
    let (baked, now) = (
        names(config.groups.iter().map(|g| g.name.as_str()).collect()),
        names(scene.groups.iter().map(|g| g.name.as_str()).collect()),
    );
    if baked != now {
        return Err(other(&format!("it has the {baked}, and {scene_file} the {now}")));
    }
    // Through text, as the manifest went: reading a number back may round it.
    let settings = serde_json::to_string(scene).and_then(|text| serde_json::from_str::<Value>(&text));
    let settings = settings.map_err(|e| Error::invalid("scene", e))?;
    let changed: Vec<&str> = ["place", "sun", "sky", "groups"]
        .into_iter()
        .filter(|key| settings[key] != config.settings[key])
        .collect();
    let warnings = match changed.is_empty() {
        true => Vec::new(),
        false => vec![format!(
            "{scene_file} gives other light now than when {} was baked ({}): what has no texels shows the light as it is now",
            folder.display(),
            changed.join(", ")
        )],
    };
    warnings.iter().for_each(|w| console.warn(w));
    Ok((dataset, atlas, warnings))
}
