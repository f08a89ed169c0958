//! `config.json` of version 1, which is read for ever: each light has one layer, named by the maps and the
//! groups.

use super::{
    Baked, Config, Daylight, FileRef, Frame, Instance, Layer, Light, Part, Source, Transfer, VERSION,
};
use serde::Deserialize;

/// The manifest.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config1 {
    format: String,
    /// 1, which the caller has seen.
    #[serde(rename = "version")]
    _version: u32,
    scene: String,
    generator: String,
    unit: String,
    seed: u64,
    inputs: String,
    samples: u32,
    pages: Vec<Page>,
    groups: Vec<Group>,
    sets: Vec<Set>,
    #[serde(deserialize_with = "Option::deserialize")]
    noise: Option<FileRef>,
    #[serde(deserialize_with = "Option::deserialize")]
    geometry: Option<FileRef>,
    instances: Vec<Instance>,
    settings: serde_json::Value,
    #[serde(default)]
    source: Option<Source>,
    #[serde(default)]
    transfer: Option<Transfer>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Page {
    width: u32,
    height: u32,
    mask: FileRef,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Group {
    name: String,
    on: Vec<[f64; 2]>,
    /// One per page; empty if layers are not stored.
    layers: Vec<FileRef>,
}

/// A frame.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Set {
    hour: f64,
    groups_on: Vec<bool>,
    #[serde(deserialize_with = "Option::deserialize")]
    relative_error: Option<f64>,
    maps: Vec<Map>,
}

/// The lightmap of a frame on a page and its shares.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Map {
    file: FileRef,
    #[serde(deserialize_with = "Option::deserialize")]
    sun: Option<FileRef>,
    #[serde(deserialize_with = "Option::deserialize")]
    sky: Option<FileRef>,
    #[serde(default)]
    local: Option<FileRef>,
}

impl Config1 {
    /// The same dataset in the words of the current version.
    pub(crate) fn upgrade(self) -> Config {
        let sun = self.shares(Light::Sun, |map| &map.sun);
        let sky = self.shares(Light::Sky, |map| &map.sky);
        let lamps = self.shares(Light::Lamps, |map| &map.local);
        let daylight = |layer: &Option<Layer>| layer.as_ref().map(|_| Daylight { baked: Baked::All });
        let (has_sun, has_sky) = (daylight(&sun), daylight(&sky));
        let mut groups = Vec::new();
        let mut of_groups = Vec::new();
        for (index, group) in (0..).zip(self.groups) {
            if !group.layers.is_empty() {
                let files = vec![group.layers.into_iter().map(Some).collect()];
                of_groups.push(Layer {
                    light: Light::Group,
                    group: Some(index),
                    part: Part::All,
                    files,
                    curve: None,
                });
            }
            groups.push(super::Group { name: group.name, on: group.on, baked: Baked::All });
        }
        let frame = |set: Set| Frame {
            hour: set.hour,
            groups_on: set.groups_on,
            relative_error: set.relative_error,
            maps: set.maps.into_iter().map(|map| map.file).collect(),
        };
        let page = |page: Page| super::Page::atlas(page.width, page.height, page.mask);
        Config {
            format: self.format,
            version: VERSION,
            scene: self.scene,
            generator: self.generator,
            unit: self.unit,
            seed: self.seed,
            inputs: self.inputs,
            samples: self.samples,
            pages: self.pages.into_iter().map(page).collect(),
            sun: has_sun,
            sky: has_sky,
            groups,
            layers: sun.into_iter().chain(sky).chain(of_groups).chain(lamps).collect(),
            frames: self.sets.into_iter().map(frame).collect(),
            noise: self.noise,
            geometry: self.geometry,
            instances: self.instances,
            settings: self.settings,
            sun_path: None,
            visibility: None,
            source: self.source,
            transfer: self.transfer,
        }
    }

    /// The layer of a light that the maps name; `None` if none does.
    fn shares(&self, light: Light, of: fn(&Map) -> &Option<FileRef>) -> Option<Layer> {
        let row = |set: &Set| set.maps.iter().map(|map| of(map).clone()).collect();
        let files: Vec<Vec<Option<FileRef>>> = self.sets.iter().map(row).collect();
        let is_named = files.iter().flatten().any(Option::is_some);
        is_named.then_some(Layer { light, group: None, part: Part::All, files, curve: None })
    }
}
