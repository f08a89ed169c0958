//! Which parts of a dataset go into which archive: the lightmaps with all that is needed to use them, and
//! each layer of light separately.

use crate::format::{Config, FileRef, Light, SunVisibility};
use std::collections::BTreeSet;

/// The dataset's full manifest, which also names the layers; `config.json` of the release names only the
/// lightmaps.
pub const LAYERS: &str = "layers.json";

/// The archives that a dataset is split into, without empty ones. A file that several need is in the first of
/// them.
pub(super) fn split(config: &Config) -> Vec<(&'static str, Vec<&FileRef>)> {
    let maps = config.frames.iter().flat_map(|frame| &frame.maps);
    let source = config.source.iter().flat_map(|source| &source.config);
    let own = config.pages.iter().map(|page| &page.mask).chain(maps);
    let own = own.chain(&config.noise).chain(&config.geometry).chain(&config.sun_path).chain(source);
    let own = own.chain(config.visibility.iter().flat_map(SunVisibility::references));
    let of = |lights: &[Light]| {
        let layers = config.layers.iter().filter(|layer| lights.contains(&layer.light));
        layers.flat_map(|layer| layer.files().chain(&layer.curve)).collect()
    };
    let parts: [(&str, Vec<&FileRef>); 4] = [
        ("sets", own.collect()),
        ("sun", of(&[Light::Sun])),
        ("sky", of(&[Light::Sky])),
        ("lamps", of(&[Light::Group, Light::Lamps])),
    ];
    let mut seen = BTreeSet::new();
    let distinct = parts.map(|(name, mut files)| {
        files.retain(|file| seen.insert(&file.path));
        // Order is by name, so that it does not depend on how the manifest lists them.
        files.sort_by(|a, b| a.path.cmp(&b.path));
        (name, files)
    });
    distinct.into_iter().filter(|(_, files)| !files.is_empty()).collect()
}

/// The manifest of only the lightmaps, for a dataset that has layers.
pub(super) fn without_layers(config: &Config) -> Option<Config> {
    (!config.layers.is_empty()).then(|| Config { layers: Vec::new(), ..config.clone() })
}
