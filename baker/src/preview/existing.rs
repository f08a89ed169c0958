//! The finished dataset to look at, and the geometry to show it on.

use super::triangle_layout::TriangleLayout;
use crate::atlas::{self, Atlas};
use crate::bake::finish::to_glb;
use crate::bake::prepare::hidden;
use crate::bake::store::Charts;
use crate::geometry::{self, Geometry, LightmapPlace};
use crate::scene::{Baked, Lightmap, Scene};
use crate::{Error, Result};
use dataset::digest::Digest;
use dataset::observe::Observer;
use dataset::store::{Dataset, MANIFEST, UNFINISHED, WORK};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// A dataset, and what it is shown on.
pub(super) struct Shown {
    /// The finished dataset.
    pub dataset: Dataset,
    /// The scene whose light it is, with that of its files.
    pub scene: Scene,
    /// That of the scene file as it is now, or, where it is another, that of the dataset.
    pub geometry: Geometry,
    /// Where it lies on the pages.
    pub layout: TriangleLayout,
    /// What has been warned of.
    pub warnings: Vec<String>,
}

/// An error where a folder holds no finished dataset.
pub(super) fn expect_finished(folder: &Path, scene_file: &Path, scene: &str) -> Result<()> {
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

/// Opens a dataset of a scene, and finds out on what to show it: on the scene's geometry where that was
/// baked, else on the dataset's own.
///
/// # Errors
/// [`Error::Invalid`] where it is of another scene, or has no geometry of its own where it needs one.
pub(super) fn open(
    folder: &Path,
    scene_file: &Path,
    mut scene: Scene,
    geometry: Geometry,
    console: &dyn Observer,
) -> Result<Shown> {
    let dataset = Dataset::open(folder)?;
    dataset.expect_day()?;
    // What has no texels shows the same part of each light as what has some: `--indirect` is not in the scene
    // file.
    let baked = |key: &str| Baked::deserialize(&dataset.config.settings[key]).unwrap_or_default();
    (scene.sun_baked, scene.sky_baked) = (baked("sun_baked"), baked("sky_baked"));
    let Some(atlas) = as_baked(&dataset, &geometry, console)? else {
        return of_dataset(folder, scene_file, scene, dataset, console);
    };
    geometry.lights.add_to(&mut scene);
    // Through text, as the manifest went: reading a number back may round it.
    let settings = serde_json::to_string(&scene).and_then(|text| serde_json::from_str::<Value>(&text));
    let settings = settings.map_err(|e| Error::invalid("scene", e))?;
    let tables = [("location", "place"), ("sun", "sun"), ("sky", "sky"), ("groups", "group")];
    let changed: Vec<&str> = tables
        .into_iter()
        .filter(|(key, _)| settings[key] != dataset.config.settings[key])
        .map(|(_, table)| table)
        .collect();
    let warnings = match changed.is_empty() {
        true => Vec::new(),
        false => vec![format!(
            "the light of {} has changed since {} was baked ({}): surfaces without texels are drawn in the new light",
            scene_file.display(),
            folder.display(),
            changed.join(", ")
        )],
    };
    warnings.iter().for_each(|w| console.warn(w));
    let layout = TriangleLayout::of_atlas(&geometry, &atlas);
    Ok(Shown { dataset, scene, geometry, layout, warnings })
}

/// The texels of a geometry, if a dataset has the same; `None` where geometry, materials or layout are
/// others.
fn as_baked(dataset: &Dataset, geometry: &Geometry, console: &dyn Observer) -> Result<Option<Atlas>> {
    let config = &dataset.config;
    // As it was baked: a draft has other pages than the scene asks for.
    let Ok(lightmap) = Lightmap::deserialize(&config.settings["lightmap"]) else { return Ok(None) };
    let progress = console.progress("unwrapping", 1);
    let hidden = hidden::find(geometry, &lightmap).triangles;
    let atlas = match atlas::build_from(geometry, &lightmap, &hidden, &Charts::beside(&dataset.root)) {
        Ok(atlas) => atlas,
        // It does not fit the pages that the other one did.
        Err(Error::Unsupported { .. }) => return Ok(None),
        Err(error) => return Err(error),
    };
    progress.advance(1);
    // The geometry with its lightmap coordinates is a file of the dataset: the same bytes, the same texels at
    // the same places.
    let glb = Digest::of(&to_glb(geometry, &atlas)?.glb);
    let is_same = config.geometry.as_ref().is_some_and(|file| file.blake3 == glb);
    Ok(is_same.then_some(atlas))
}

/// A dataset on its own geometry, in the light of a scene.
fn of_dataset(
    folder: &Path,
    scene_file: &Path,
    mut scene: Scene,
    dataset: Dataset,
    console: &dyn Observer,
) -> Result<Shown> {
    let (config, shown) = (&dataset.config, scene_file.display());
    let file = config.geometry.as_ref().filter(|_| config.scene == scene.name);
    let Some(file) = file else {
        let what = format!(
            "it is of the scene {:?}, whose geometry, materials or layout are not those that {shown} gives now; expected a dataset \
             that `bake {shown}` made of the scene {:?}",
            config.scene, scene.name
        );
        return Err(Error::invalid(folder.display(), what));
    };
    scene.objects = Scene::of_models(&[folder.join(&file.path)])?.objects;
    let (mut geometry, _) = geometry::load(&scene)?;
    for instance in &mut geometry.instances {
        instance.lightmap = matches!(instance.lightmap_place, LightmapPlace::At { .. });
    }
    geometry.lights.add_to(&mut scene);
    let warning = format!(
        "{} was baked with other geometry, materials or layout than {shown} gives now, or by another version of the baker: the picture \
         shows the dataset's own geometry file, and what has no texels in the light of {shown}; `bake {shown}` makes a new dataset",
        folder.display()
    );
    console.warn(&warning);
    let layout = TriangleLayout::of_file(&geometry, &config.pages);
    Ok(Shown { dataset, scene, geometry, layout, warnings: vec![warning] })
}
