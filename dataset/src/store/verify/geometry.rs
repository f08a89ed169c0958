//! The geometry file: that it is a complete GLB, its accessors lie inside it, and its lightmap coordinates on
//! pages that exist.

use crate::format::Config;
use crate::observe::count;
use crate::{Error, Result};
use gltf::accessor::{Accessor, DataType, Dimensions};
use gltf::json::Root;
use gltf::json::deserialize::from_slice;
use gltf::{Document, Glb, Node, Primitive, Semantic};
use serde::Deserialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// Lightmap coordinates may lie so far outside [0, 1]: they are 32-bit sums.
const SLACK: f32 = 1e-4;

/// What a node with texels says in its extras.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Placed {
    pub lightmap_scale: [f32; 2],
    pub lightmap_offset: [f32; 2],
    pub lightmap_page: usize,
}

/// The range of a mesh's lightmap coordinates; `None` if it has none.
type Range = Option<([f32; 2], [f32; 2])>;

/// Everything in a geometry file that is invalid; `path` names it in errors.
pub(crate) fn faults(path: &Path, bytes: &[u8], config: &Config) -> Vec<Error> {
    let mut found = Vec::new();
    let mut wrong = |what: String| found.push(Error::invalid(path.display(), what));
    if let Err(what) = check(bytes, config, &mut wrong) {
        wrong(what);
    }
    found
}

/// A file's JSON part, each index in it checked, and its binary part, in which all of its buffer views lie.
pub(crate) fn open(bytes: &[u8]) -> Result<(Document, Cow<'_, [u8]>), String> {
    let states = bytes.get(8..12).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    if let Some(length) = states.filter(|length| *length as usize != bytes.len()) {
        return Err(format!(
            "{}; its header says {length}: expected a complete GLB file",
            count(bytes.len(), "byte")
        ));
    }
    let glb = Glb::from_slice(bytes).map_err(|e| format!("is not a GLB file: {e}"))?;
    let document = document(&glb.json)?;
    let binary = glb.bin.unwrap_or_default();
    for buffer in document.buffers() {
        let is_own = matches!(buffer.source(), gltf::buffer::Source::Bin) && buffer.index() == 0;
        if !is_own || buffer.length() > binary.len() {
            let length = count(buffer.length(), "byte");
            return Err(format!(
                "buffer {} of {length}: expected one buffer, inside the file's binary part of {}",
                buffer.index(),
                count(binary.len(), "byte")
            ));
        }
    }
    for view in document.views() {
        let end = view.offset().checked_add(view.length());
        if end.is_none_or(|end| end > view.buffer().length()) {
            return Err(format!("buffer view {}: ends outside its buffer", view.index()));
        }
    }
    Ok((document, binary))
}

/// Checks a file. Faults of its parts go to `wrong`; the error is a fault that leaves nothing to check.
fn check(bytes: &[u8], config: &Config, wrong: &mut impl FnMut(String)) -> Result<(), String> {
    let (document, binary) = open(bytes)?;
    let binary = &*binary;
    for accessor in document.accessors() {
        let _ = bytes_of(&accessor, binary)?;
    }
    // Per mesh, where its lightmap coordinates lie.
    let mut ranges: BTreeMap<usize, Range> = BTreeMap::new();
    for mesh in document.meshes() {
        let mut range: Range = None;
        for (i, primitive) in mesh.primitives().enumerate() {
            match check_primitive(&primitive, binary) {
                Ok(found) => range = joined(range, found),
                Err(what) => wrong(format!("mesh {}, primitive {i}: {what}", mesh.index())),
            }
        }
        ranges.insert(mesh.index(), range);
    }
    check_nodes(&document, config, &ranges, wrong);
    Ok(())
}

/// The JSON part, each index in it checked.
fn document(json: &[u8]) -> Result<Document, String> {
    let mut root: Root = from_slice(json).map_err(|e| format!("its JSON is not glTF: {e}"))?;
    // Nothing here looks at what extensions add; the crate would refuse those that it does not read.
    root.extensions_required.clear();
    // The crate's own check of positions reads past the list of accessors.
    for (i, mesh) in root.meshes.iter().enumerate() {
        for (semantic, accessor) in mesh.primitives.iter().flat_map(|p| &p.attributes) {
            if accessor.value() >= root.accessors.len() {
                let (name, at, all) = (semantic.to_string(), accessor.value(), root.accessors.len());
                return Err(format!("mesh {i}: {name} names accessor {at}; expected one of {all}, from 0"));
            }
        }
    }
    Document::from_json(root).map_err(|e| match e {
        gltf::Error::Validation(list) => {
            let list: Vec<_> = list.iter().take(3).map(|(at, what)| format!("{at}: {what}")).collect();
            format!("its JSON is not glTF: {}", list.join("; "))
        }
        other => format!("its JSON is not glTF: {other}"),
    })
}

fn joined(a: Range, b: Range) -> Range {
    let (Some(a), Some(b)) = (a, b) else { return a.or(b) };
    let with = |f: fn(f32, f32) -> f32, a: [f32; 2], b: [f32; 2]| [f(a[0], b[0]), f(a[1], b[1])];
    Some((with(f32::min, a.0, b.0), with(f32::max, a.1, b.1)))
}

/// Attributes of one length, finite; indices that name a vertex. The range of the lightmap coordinates.
fn check_primitive(primitive: &Primitive, binary: &[u8]) -> Result<Range, String> {
    let positions = primitive.get(&Semantic::Positions).ok_or("has no POSITION; expected one per vertex")?;
    let vertices = positions.count();
    let mut range = None;
    for (semantic, accessor) in primitive.attributes() {
        let name = semantic.to_string();
        if accessor.count() != vertices {
            return Err(format!("{name} of {}; expected {vertices}", count(accessor.count(), "vertex")));
        }
        let components = match semantic {
            Semantic::Positions | Semantic::Normals => Dimensions::Vec3,
            Semantic::TexCoords(_) => Dimensions::Vec2,
            _ => continue,
        };
        if accessor.data_type() != DataType::F32 || accessor.dimensions() != components {
            let found = (accessor.dimensions(), accessor.data_type());
            return Err(format!("{name} is {found:?}; expected {components:?} of 32-bit floats"));
        }
        for (vertex, element) in bytes_of(&accessor, binary)?.enumerate() {
            let floats = element.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            if let Some(value) = floats.clone().find(|value| !value.is_finite()) {
                return Err(format!("{name} of vertex {vertex} is {value}; expected finite numbers"));
            }
            if semantic == Semantic::TexCoords(1) {
                let uv: Vec<f32> = floats.collect();
                range = joined(range, Some(([uv[0], uv[1]], [uv[0], uv[1]])));
            }
        }
    }
    if let Some(indices) = primitive.indices() {
        let size = match indices.data_type() {
            DataType::U8 => 1,
            DataType::U16 => 2,
            DataType::U32 => 4,
            other => return Err(format!("indices are {other:?}; expected unsigned integers")),
        };
        if indices.dimensions() != Dimensions::Scalar {
            return Err(format!("indices are {:?}; expected scalars", indices.dimensions()));
        }
        for (place, element) in bytes_of(&indices, binary)?.enumerate() {
            let index = (0..size).rev().fold(0, |index, byte| index << 8 | u64::from(element[byte]));
            if index >= vertices as u64 {
                return Err(format!("index {place} is {index}; expected one of {vertices}, from 0"));
            }
        }
    }
    Ok(range)
}

/// Lightmap coordinates that lie on a page that exists.
fn check_nodes(
    document: &Document,
    config: &Config,
    ranges: &BTreeMap<usize, Range>,
    wrong: &mut impl FnMut(String),
) {
    for node in document.nodes() {
        if let Err(what) = check_node(&node, config, ranges) {
            wrong(format!("node {}, {:?}: {what}", node.index(), node.name().unwrap_or_default()));
        }
    }
}

fn check_node(node: &Node, config: &Config, ranges: &BTreeMap<usize, Range>) -> Result<(), String> {
    let Some(extras) = node.extras() else { return Ok(()) };
    let extras: serde_json::Value = serde_json::from_str(extras.get()).map_err(|e| format!("extras: {e}"))?;
    if extras.get("lightmapPage").is_none() {
        return Ok(());
    }
    let placed: Placed = serde_json::from_value(extras).map_err(|e| format!("extras: {e}"))?;
    if placed.lightmap_page >= config.pages.len() {
        let (page, pages) = (placed.lightmap_page, config.pages.len());
        return Err(format!("lightmapPage is {page}; expected one of {pages}, from 0"));
    }
    let mesh = node.mesh().map(|mesh| mesh.index());
    let Some((low, high)) = mesh.and_then(|mesh| ranges.get(&mesh).copied().flatten()) else {
        return Err("has a lightmapPage but no TEXCOORD_1; expected lightmap coordinates".to_owned());
    };
    for axis in 0..2 {
        let (scale, offset) = (placed.lightmap_scale[axis], placed.lightmap_offset[axis]);
        for at in [scale * low[axis] + offset, scale * high[axis] + offset] {
            if !(-SLACK..=1.0 + SLACK).contains(&at) {
                let axis = ["u", "v"][axis];
                return Err(format!("a lightmap coordinate {axis} is {at} on its page; expected 0 to 1"));
            }
        }
    }
    Ok(())
}

/// The elements of an accessor; an error if they do not all lie in its view. (Views lie in the binary part.)
fn bytes_of<'a>(
    accessor: &Accessor,
    binary: &'a [u8],
) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>, String> {
    let wrong = |what: &str| format!("accessor {}: {what}", accessor.index());
    if accessor.sparse().is_some() {
        return Err(wrong("is sparse; expected a dense accessor"));
    }
    let view = accessor.view().ok_or_else(|| wrong("has no buffer view; expected one"))?;
    let (size, length) = (accessor.size(), accessor.count());
    let stride = view.stride().unwrap_or(size);
    let end =
        || length.saturating_sub(1).checked_mul(stride)?.checked_add(size)?.checked_add(accessor.offset());
    let is_inside = length == 0 || end().is_some_and(|end| end <= view.length());
    if stride < size || !is_inside {
        return Err(wrong("ends outside its buffer view"));
    }
    let from = view.offset();
    let bytes =
        binary.get(from..from + view.length()).ok_or_else(|| wrong("its view ends outside the file"))?;
    let start = accessor.offset();
    Ok((0..length).map(move |i| &bytes[start + i * stride..][..size]))
}

#[cfg(test)]
#[path = "geometry_tests.rs"]
mod tests;
