//! What is kept of an asset so that it can be written again: its JSON, its images, and attributes that
//! nothing here reads.

use super::accessor::{Buffers, read_floats, read_raw};
use super::container::read_uri;
use super::{material, motion};
use crate::geometry::model::{self, Attribute};
use gltf::accessor::{Accessor, Dimensions};
use gltf::mesh::Semantic;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What stands in the JSON for the sake of bytes, and what `motion` keeps.
const LEFT_OUT: &[&str] = &["accessors", "animations", "bufferViews", "buffers", "skins"];

/// The asset but its triangles. `materials` are those in use, `profiles` the bytes of photometric files.
pub(super) fn asset(
    asset: &material::OpenAsset,
    nodes: Vec<usize>,
    roots: Vec<usize>,
    scene: Option<usize>,
    materials: impl Iterator<Item = usize>,
    profiles: BTreeMap<usize, Vec<u8>>,
) -> model::Asset {
    let mut root = asset.root.clone();
    if let Some(root) = root.as_object_mut() {
        LEFT_OUT.iter().for_each(|key| drop(root.remove(*key)));
    }
    let scene = scene.map_or(Value::Null, |scene| asset.root["scenes"][scene].clone());
    let mut used = BTreeSet::new();
    materials.for_each(|material| textures(&root["materials"][material], &mut used));
    let of_texture = |texture: usize| images(&root["textures"][texture]).collect::<Vec<_>>();
    let wanted: BTreeSet<usize> = used.into_iter().flat_map(of_texture).collect();
    let count = root["images"].as_array().map_or(0, Vec::len);
    let images =
        (0..count).map(|image| wanted.contains(&image).then(|| image_bytes(asset, image))?).collect();
    let motion = motion::read(asset);
    model::Asset { root, nodes, roots, scene, images, profiles, motion }
}

/// Adds the indices of the textures that a material names, wherever it does.
fn textures(material: &Value, found: &mut BTreeSet<usize>) {
    for (key, value) in material.as_object().into_iter().flatten() {
        if key.ends_with("Texture") {
            found.extend(value["index"].as_u64().and_then(|index| usize::try_from(index).ok()));
        }
        textures(value, found);
    }
}

/// The images of a texture: its own and those of its extensions.
fn images(texture: &Value) -> impl Iterator<Item = usize> {
    let extensions = texture["extensions"].as_object().into_iter().flat_map(|e| e.values());
    let sources = extensions.chain([texture]).filter_map(|of| of["source"].as_u64());
    sources.filter_map(|index| usize::try_from(index).ok())
}

/// The encoded bytes of an image, if they can be had.
fn image_bytes(asset: &material::OpenAsset, index: usize) -> Option<Vec<u8>> {
    let image = asset.document.as_json().images.get(index)?;
    match (&image.buffer_view, &image.uri) {
        (Some(view), _) => {
            let view = asset.document.views().nth(view.value())?;
            Some(asset.buffers.bytes(&view, 0, view.length())?.to_vec())
        }
        (None, Some(uri)) => read_uri(uri, asset.folder, asset.file).ok(),
        (None, None) => None,
    }
}

/// An attribute as it is written again; `None` for one that is written in another way or not at all, and for
/// a broken one.
pub(super) fn attribute(semantic: &Semantic, accessor: &Accessor, buffers: &Buffers) -> Option<Attribute> {
    let name = semantic.to_string();
    let plain = |components: usize, kind, floats: Vec<f32>| {
        let is_finite = floats.iter().all(|v| v.is_finite());
        let bytes = bytemuck::cast_slice(&floats).to_vec();
        is_finite.then_some(Attribute {
            name: name.clone(),
            component: 5126,
            kind,
            normalized: false,
            stride: 4 * components,
            bytes,
        })
    };
    match semantic {
        Semantic::Tangents => plain(4, "VEC4", read_floats::<4>(accessor, buffers, "").ok()?.concat()),
        Semantic::TexCoords(set) if *set != 1 => {
            plain(2, "VEC2", read_floats::<2>(accessor, buffers, "").ok()?.concat())
        }
        Semantic::Colors(_) | Semantic::Extras(_) => {
            let kind = match accessor.dimensions() {
                Dimensions::Scalar => "SCALAR",
                Dimensions::Vec2 => "VEC2",
                Dimensions::Vec3 => "VEC3",
                Dimensions::Vec4 => "VEC4",
                _ => return None,
            };
            let (stride, bytes) = read_raw(accessor, buffers).ok()?;
            let component = accessor.data_type().as_gl_enum();
            Some(Attribute { name, component, kind, normalized: accessor.normalized(), stride, bytes })
        }
        _ => None,
    }
}
