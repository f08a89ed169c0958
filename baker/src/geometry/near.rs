//! What a pattern that fits nothing may have meant: the names that are nearest to it, with their parents'.

use super::model::Model;
use super::names::fits;
use super::notes::{list, plural};
use crate::scene::{Object, Part};
use dataset::Error;
use std::collections::BTreeMap;

/// Most names that a message lists.
const MOST: usize = 5;
/// Of names that have less in common with a pattern, none was meant.
const LEAST: f64 = 0.6;
/// How near a name is that contains the pattern, or is a part of it, whatever their lengths.
const CONTAINED: f64 = 0.9;
/// Characters of a name that are compared.
const COMPARED: usize = 64;

/// Something with a name.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Named<'a> {
    name: &'a str,
    noun: &'static str,
    /// The name of what holds it, or empty.
    above: &'a str,
}

/// An error about a part that fits nothing of its object's file.
pub(super) fn unmatched(object: &Object, part: &Part, model: &Model) -> Error {
    let pattern = &part.pattern;
    let lamp = model.contents.lamps.iter().find(|lamp| fits(pattern, &lamp.name));
    let hint = lamp.map_or_else(String::new, |lamp| {
        format!(
            "; {:?} is a lamp: to switch it, write a [[group]] with `lights = [{pattern:?}]`; to leave it out of the bake, set \
             `movable = true`",
            lamp.name
        )
    });
    let above = |node: Option<usize>| {
        model.tree.path(node).map(|node| node.name.as_str()).find(|name| !name.is_empty()).unwrap_or("")
    };
    let nodes = model.tree.nodes.iter().map(|node| ("node", node.name.as_str(), above(node.parent)));
    let meshes = model.placements.iter().flat_map(|placement| {
        let (mesh, node) = (&model.meshes[placement.mesh], above(placement.node));
        let material = model.materials[mesh.material].name.as_str();
        [
            ("mesh", mesh.name.as_str(), node),
            ("material", material, if node.is_empty() { &mesh.name } else { node }),
        ]
    });
    // Of what shares name and kind the first is enough.
    let mut all: BTreeMap<(&str, &'static str), &str> = BTreeMap::new();
    for (noun, name, above) in nodes.chain(meshes).filter(|(_, name, _)| !name.is_empty()) {
        all.entry((name, noun)).or_insert(above);
    }
    let all: Vec<Named> = all.into_iter().map(|((name, noun), above)| Named { name, noun, above }).collect();
    let mut near: Vec<(f64, &Named)> =
        all.iter().map(|named| (nearness(pattern, named.name), named)).collect();
    near.retain(|(nearness, _)| *nearness >= LEAST);
    near.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    let shown = |named: &Named| match named.above {
        "" => format!("{} {:?}", named.noun, named.name),
        above => format!("{} {:?} (of {above:?})", named.noun, named.name),
    };
    let have = if !near.is_empty() {
        let more = if near.len() > MOST { ", …" } else { "" };
        let near: Vec<String> = near.iter().take(MOST).map(|(_, named)| shown(named)).collect();
        format!("similar names: {}{more}", near.join(", "))
    } else if all.is_empty() {
        "the file has no names".to_owned()
    } else {
        let some: Vec<String> = all.iter().take(MOST).map(shown).collect();
        format!("no name is similar; it has {}: {}", plural(all.len(), "name"), list(&some, all.len()))
    };
    let what = format!(
        "part name = {pattern:?}: no node, mesh or material of {} has this name; {have}{hint}",
        object.file.display()
    );
    Error::invalid(&part.source_line, what)
}

/// The names that are near to one of some patterns, the nearest first.
pub(super) fn nearest<'a>(patterns: &[&str], names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let of = |name: &str| patterns.iter().map(|pattern| nearness(pattern, name)).fold(0.0, f64::max);
    let mut near: Vec<(f64, &str)> =
        names.map(|name| (of(name), name)).filter(|(nearness, _)| *nearness >= LEAST).collect();
    near.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    near.into_iter().map(|(_, name)| name).collect()
}

/// What a pattern and a name have in common, from 0 to 1, whatever their case.
fn nearness(pattern: &str, name: &str) -> f64 {
    let lower =
        |text: &str| -> Vec<char> { text.chars().take(COMPARED).flat_map(char::to_lowercase).collect() };
    let name = lower(name);
    let plain: Vec<char> = lower(pattern).into_iter().filter(|&c| c != '*').collect();
    if plain.is_empty() || name.is_empty() {
        return 0.0;
    }
    let text = |chars: &[char]| chars.iter().collect::<String>();
    let (whole, of_pattern) = (text(&name), text(&plain));
    let common = |name: &[char]| strsim::normalized_damerau_levenshtein(&of_pattern, &text(name));
    let mut best = common(&name);
    // A star stands for the rest.
    let length = plain.len().min(name.len());
    if pattern.ends_with('*') {
        best = best.max(common(&name[..length]));
    }
    if pattern.starts_with('*') {
        best = best.max(common(&name[name.len() - length..]));
    }
    let contains = |a: &str, b: &[char], text: &str| b.len() >= 3 && a.contains(text);
    if contains(&whole, &plain, &of_pattern) || contains(&of_pattern, &name, &whole) {
        best = best.max(CONTAINED);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_near_and_other_words_are_not() {
        for (pattern, name, is_near) in [
            ("lantrn", "lantern", true),
            ("Lantern", "lantern.001", true),
            ("leav*", "leaf.001", true),
            ("*_glss", "window_glass", true),
            ("roof", "floor", false),
            ("swing", "chimney", false),
            ("*", "anything", false),
        ] {
            assert_eq!(
                nearness(pattern, name) >= LEAST,
                is_near,
                "{pattern} {name} {}",
                nearness(pattern, name)
            );
        }
        let names = ["swing", "swing.seat", "ball"];
        assert_eq!(nearest(&["sving"], names.into_iter()), ["swing"]);
    }
}
