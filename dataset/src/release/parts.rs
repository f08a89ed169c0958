//! What of a dataset goes into which archive: the sets with all that is needed to use them, and each layer of light apart.

use crate::config::{Config, FileRef};
use crate::store::layers_kept;
use std::collections::BTreeSet;

/// The dataset's own manifest, beside that of the sets alone: it names the layers, too.
pub const LAYERS: &str = "layers.json";

/// The archives that a dataset is split into, without empty ones. A file that several need is in the first of them.
pub(super) fn split(config: &Config) -> Vec<(&'static str, Vec<&FileRef>)> {
    let maps = || config.sets.iter().flat_map(|set| &set.maps);
    let source = config.source.iter().flat_map(|source| &source.config);
    let own = config.pages.iter().map(|page| &page.mask).chain(maps().map(|map| &map.file));
    let own = own.chain(&config.noise).chain(&config.geometry).chain(source);
    let lamps = config.groups.iter().flat_map(|group| &group.layers);
    let parts: [(&str, Vec<&FileRef>); 4] = [
        ("sets", own.collect()),
        ("sun", maps().flat_map(|map| &map.sun).collect()),
        ("sky", maps().flat_map(|map| &map.sky).collect()),
        ("lamps", lamps.chain(maps().flat_map(|map| &map.local)).collect()),
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

/// The manifest of the sets alone, of a dataset that has layers.
pub(super) fn without_layers(config: &Config) -> Option<Config> {
    let mut sets = layers_kept(config).then(|| config.clone())?;
    sets.groups.iter_mut().for_each(|group| group.layers.clear());
    for map in sets.sets.iter_mut().flat_map(|set| &mut set.maps) {
        (map.sun, map.sky, map.local) = (None, None, None);
    }
    Some(sets)
}
