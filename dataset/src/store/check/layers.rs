//! Checks layers: their order, that each is of a baked light with an image or black for each frame and page,
//! and that all lights have layers or none.

use crate::format::{Baked, Config, Layer, Light, Part};
use crate::observe::count;

/// Everything in the layers that is invalid.
pub(super) fn layers(config: &Config, wrong: &mut impl FnMut(String)) {
    for (index, layer) in config.layers.iter().enumerate() {
        let name = format!("layer {index} ({})", name(config, layer));
        light(config, layer, &name, wrong);
        shape(config, layer, &name, wrong);
    }
    let key = |layer: &Layer| (layer.light, layer.group, layer.part);
    for (index, pair) in config.layers.windows(2).enumerate() {
        if key(&pair[0]) >= key(&pair[1]) {
            let [before, after] = [&pair[0], &pair[1]].map(|layer| name(config, layer));
            wrong(format!(
                "layer {} ({after}) comes after that of {before}; expected the order sun, sky, groups, lamps, each direct before \
                 indirect, none twice",
                index + 1
            ));
        }
    }
    if !config.layers.is_empty() {
        complete(config, wrong);
    }
}

/// Such as `group "porch", direct`.
fn name(config: &Config, layer: &Layer) -> String {
    let light = layer.light.name();
    let light = match layer.group {
        None => light.to_owned(),
        Some(index) => match config.groups.get(index as usize) {
            Some(group) => format!("{light} {:?}", group.name),
            None => format!("{light} {index}"),
        },
    };
    format!("{light}, {}", layer.part.name())
}

/// The light is one that the dataset has.
fn light(config: &Config, layer: &Layer, name: &str, wrong: &mut impl FnMut(String)) {
    let groups = config.groups.len();
    match (layer.light, layer.group) {
        (Light::Group, None) => {
            wrong(format!("{name}: group is null; expected the index of a light group"));
        }
        (Light::Group, Some(index)) if index as usize >= groups => {
            wrong(format!("{name}: group is {index}; expected one of {groups}, from 0"));
        }
        (Light::Group, Some(_)) if config.source.is_some() => wrong(format!(
            "{name}: a light group's layer in an imported dataset; expected one layer of light \"lamps\" for all groups"
        )),
        (Light::Sun | Light::Sky | Light::Lamps, Some(index)) => {
            wrong(format!("{name}: group is {index}; expected null unless light is \"group\""));
        }
        (Light::Lamps, None) if config.source.is_none() => {
            wrong(format!("{name}: light is \"lamps\"; expected this only in imported datasets"));
        }
        (Light::Lamps, None) if layer.part != Part::All => {
            wrong(format!("{name}: part is {:?}; expected \"all\" of lamps", layer.part.name()));
        }
        _ => {}
    }
}

/// A row per frame, or one of a light group; an entry per page in each.
fn shape(config: &Config, layer: &Layer, name: &str, wrong: &mut impl FnMut(String)) {
    let (rows, why) = match layer.light {
        Light::Group => (1, "a group's light does not depend on the hour"),
        _ => (config.frames.len(), "one per frame"),
    };
    if layer.light == Light::Group && layer.curve.is_some() {
        wrong(format!("{name}: curve: expected none ({why})"));
    }
    if layer.files.len() != rows {
        wrong(format!("{name}: files for {}; expected {rows} ({why})", count(layer.files.len(), "frame")));
    }
    for (index, row) in layer.files.iter().enumerate().filter(|(_, row)| row.len() != config.pages.len()) {
        let (found, expected) = (count(row.len(), "page"), config.pages.len());
        wrong(format!("{name}, row {index}: files for {found}; expected {expected}"));
    }
}

/// Each light has the layers of what is baked of it.
fn complete(config: &Config, wrong: &mut impl FnMut(String)) {
    let mut expect = |light: Light, group: Option<u32>, baked: Baked, name: String| {
        let found: Vec<Part> = config.layers_of(light, group).map(|layer| layer.part).collect();
        let expected: &[&[Part]] = match (baked, light) {
            (Baked::None, _) => &[&[]],
            (Baked::Indirect, _) => &[&[Part::Indirect]],
            (Baked::All, Light::Sky) => &[&[Part::All]],
            (Baked::All, _) => &[&[Part::Direct, Part::Indirect], &[Part::All]],
        };
        if !expected.contains(&&found[..]) {
            let words = |parts: &[Part]| match parts {
                [] => "none".to_owned(),
                parts => parts.iter().map(|part| part.name()).collect::<Vec<_>>().join(" and "),
            };
            let either: Vec<String> = expected.iter().map(|parts| words(parts)).collect();
            wrong(format!(
                "{name}: layers of the parts {}; expected {} (baked is {:?}; all lights have their layers, or none has)",
                words(&found),
                either.join(", or "),
                baked.name()
            ));
        }
    };
    for (light, of) in [(Light::Sun, config.sun), (Light::Sky, config.sky)] {
        let baked = of.map_or(Baked::None, |of| of.baked);
        let there = if of.is_some() { "" } else { " is null" };
        expect(light, None, baked, format!("{}{there}", light.name()));
    }
    // What lamps give in an imported dataset is one layer of them all, or black.
    if config.source.is_none() {
        for (index, group) in (0..).zip(&config.groups) {
            expect(Light::Group, Some(index), group.baked, format!("group {:?}", group.name));
        }
    }
}
