//! Lamps that shine as photometric files say: `EXT_lights_ies`.

use super::container::read_uri;
use super::lights::lamp_names;
use super::material::OpenAsset;
use crate::geometry::contents::{Contents, FileLamp, FileLampKind};
use crate::geometry::model::reason;
use crate::geometry::notes::Notes;
use crate::scene::Profile;
use dataset::{Error, Result};
use glam::{DMat4, DVec3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The extension's name.
pub(super) const EXTENSION: &str = "EXT_lights_ies";
/// The media type of a profile.
const MIME: &str = "application/x-ies-lm-63";

/// Profiles by their index, as they are read; `None` for one that cannot be.
#[derive(Default)]
pub(super) struct Profiles {
    known: BTreeMap<usize, Option<Arc<Profile>>>,
    /// The bytes of those that were read.
    pub bytes: BTreeMap<usize, Vec<u8>>,
}

/// Checks the form of the profiles and of the nodes that have one.
///
/// # Errors
/// [`Error::Invalid`] names the extension, the profile or node, the value and what was expected.
pub(super) fn check(root: &Value, file: &str) -> Result<()> {
    let wrong = |of: String, key: &str, value: &Value, expected: &str| {
        let value = if value.is_null() { "is missing".to_owned() } else { format!("= {value}") };
        let what = format!("not glTF 2.0: {EXTENSION}, {of}: `{key}` {value}: expected {expected}");
        Err(Error::invalid(file, what))
    };
    let lights = match &root["extensions"][EXTENSION]["lights"] {
        Value::Null => &[][..],
        Value::Array(lights) => lights,
        other => return wrong("the file".to_owned(), "lights", other, "a list"),
    };
    let views = root["bufferViews"].as_array().map_or(0, Vec::len) as u64;
    for (i, light) in lights.iter().enumerate() {
        let (uri, view, of) = (&light["uri"], &light["bufferView"], || format!("profile {i}"));
        match (uri, view) {
            (Value::String(_), Value::Null) => {}
            (Value::Null, view) if view.as_u64().is_some_and(|view| view < views) => {}
            (Value::Null, Value::Null) => {
                return wrong(of(), "uri", uri, "either `uri` or `bufferView`");
            }
            (Value::Null, _) => {
                return wrong(of(), "bufferView", view, &format!("an index below {views}"));
            }
            _ => return wrong(of(), "uri", uri, "text, and no `bufferView` beside it"),
        }
        let mime = &light["mimeType"];
        if *mime != MIME && !(mime.is_null() && view.is_null()) {
            return wrong(of(), "mimeType", mime, &format!("{MIME:?}"));
        }
    }
    for (i, node) in root["nodes"].as_array().into_iter().flatten().enumerate() {
        let Some(named) = node["extensions"].get(EXTENSION) else { continue };
        let of = || format!("node {i}");
        if named["light"].as_u64().is_none_or(|light| light >= lights.len() as u64) {
            let expected = match lights.len() {
                0 => "none, since the file lists no profiles".to_owned(),
                n => format!("an index below {n}"),
            };
            return wrong(of(), "light", &named["light"], &expected);
        }
        let (multiplier, colour) = (&named["multiplier"], &named["color"]);
        if !(multiplier.is_null() || multiplier.as_f64().is_some_and(|factor| factor >= 0.0)) {
            return wrong(of(), "multiplier", multiplier, "a number, 0 or more");
        }
        let three = |list: &Vec<Value>| list.len() == 3 && list.iter().all(Value::is_number);
        if !(colour.is_null() || colour.as_array().is_some_and(three)) {
            return wrong(of(), "color", colour, "three numbers");
        }
    }
    Ok(())
}

impl Profiles {
    /// Adds the lamp that a node has by this extension, if it has one, to `contents`; of a hidden node there
    /// are none, and its profile alone is kept. `place` is the node's place in the
    /// tree of nodes.
    ///
    /// # Errors
    /// Those of [`Profile::parse`] for a damaged profile, and any where the asset requires the extension.
    pub(super) fn read(
        &mut self,
        asset: &OpenAsset,
        node: &gltf::Node,
        place: usize,
        file_from_node: DMat4,
        contents: Option<&mut Contents>,
        notes: &mut Notes,
    ) -> Result<()> {
        let named = &asset.root["nodes"][node.index()]["extensions"][EXTENSION];
        let Some(index) = named["light"].as_u64().map(|index| index as usize) else { return Ok(()) };
        let light = &asset.root["extensions"][EXTENSION]["lights"][index];
        let names = lamp_names(node, light["name"].as_str());
        let name = names[0].clone();
        if !self.known.contains_key(&index) {
            let profile = self.profile(asset, index, light, &name, notes)?;
            self.known.insert(index, profile);
        }
        let (Some(profile), Some(contents)) = (self.known[&index].clone(), contents) else { return Ok(()) };
        let colour = serde_json::from_value::<[f64; 3]>(named["color"].clone()).unwrap_or([1.0; 3]);
        contents.lamps.push(FileLamp {
            name,
            names,
            node: place,
            colour: DVec3::from(colour).clamp(DVec3::ZERO, DVec3::ONE),
            intensity: (profile.peak * named["multiplier"].as_f64().unwrap_or(1.0)).min(f32::MAX.into()),
            kind: FileLampKind::Ies(profile),
            file_from_lamp: file_from_node,
        });
        Ok(())
    }

    /// Reads a profile. One that is not there or of a kind that is not read is noted, unless the asset
    /// requires it.
    fn profile(
        &mut self,
        asset: &OpenAsset,
        index: usize,
        light: &Value,
        lamp: &str,
        notes: &mut Notes,
    ) -> Result<Option<Arc<Profile>>> {
        let place = format!("{}: {EXTENSION}, profile {index}", asset.file);
        let parsed = bytes(asset, light, &place).map_err(|error| (error, true)).and_then(|bytes| {
            let parsed = Profile::parse(&bytes, &place);
            self.bytes.insert(index, bytes);
            parsed.map_err(|error| {
                let is_foreign = matches!(error, Error::Unsupported { .. });
                (error, is_foreign)
            })
        });
        let required =
            asset.root["extensionsRequired"].as_array().is_some_and(|all| all.iter().any(|n| n == EXTENSION));
        match parsed {
            Ok(profile) => Ok(Some(Arc::new(profile))),
            Err((error, true)) if !required => {
                let what = "left out: its photometric profile cannot be read; put the file there, or give the scene file a `[[group.point]]` with `ies`";
                notes.add(asset.file, "lamp", format!("{lamp} ({})", reason(&error)), what);
                Ok(None)
            }
            Err((error, _)) => Err(error),
        }
    }
}

/// The bytes of a profile.
fn bytes(asset: &OpenAsset, light: &Value, place: &str) -> Result<Vec<u8>> {
    if let Some(uri) = light["uri"].as_str() {
        return read_uri(uri, asset.folder, place);
    }
    let view = light["bufferView"].as_u64().and_then(|view| asset.document.views().nth(view as usize));
    let bytes = view.and_then(|view| asset.buffers.bytes(&view, 0, view.length()));
    Ok(bytes.ok_or_else(|| Error::invalid(place, "it ends outside its buffer"))?.to_vec())
}

#[cfg(test)]
#[path = "photometric_tests.rs"]
mod tests;
