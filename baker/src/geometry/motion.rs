//! What lets the nodes of a glTF move, as it stands in the file: skins, animations, and meshes that skins or
//! morph targets deform.

use serde_json::Value;
use std::collections::BTreeMap;

/// Skins, animations and deformed meshes of a file, kept to be written again where they are of what moves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Motion {
    /// JSON as in the file.
    pub skins: Vec<Value>,
    /// JSON as in the file.
    pub animations: Vec<Value>,
    /// What the JSON of skins, animations and deformed primitives names by numbers of accessors.
    pub elements: BTreeMap<(usize, Use), Elements>,
    /// Why `elements` are not there, if they cannot be read.
    pub fault: Option<String>,
}

/// What an accessor is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Use {
    /// Positions and normals of vertices, and other attributes that are written as 32-bit floats.
    Floats,
    /// Other attributes of vertices, as they are.
    Vertices,
    /// Numbers of vertices.
    Indices,
    /// Times and values of animations, and matrices of skins.
    Data,
}

/// The elements of an accessor.
#[derive(Clone, Debug)]
pub(crate) struct Elements {
    /// glTF's number for the type of a component.
    pub component: u32,
    /// Such as `VEC4`.
    pub kind: &'static str,
    pub normalized: bool,
    pub count: usize,
    /// One after the other, those of vertices filled up to multiples of 4 bytes.
    pub bytes: Vec<u8>,
}

/// What an attribute of a vertex is used as, by its name.
pub(crate) fn use_of(attribute: &str) -> Use {
    match attribute {
        "POSITION" | "NORMAL" | "TANGENT" => Use::Floats,
        _ if attribute.starts_with("TEXCOORD_") => Use::Floats,
        _ => Use::Vertices,
    }
}

/// Whether morph targets or a skin can deform a primitive, which is given as JSON.
pub(crate) fn is_deformable(primitive: &Value) -> bool {
    let has_targets = primitive["targets"].as_array().is_some_and(|targets| !targets.is_empty());
    has_targets || primitive["attributes"].get("JOINTS_0").is_some()
}

/// A number of the JSON that counts or names something.
pub(crate) fn index(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|index| usize::try_from(index).ok())
}

impl Motion {
    /// Of a file in which nothing moves.
    pub(crate) const NONE: Motion =
        Motion { skins: Vec::new(), animations: Vec::new(), elements: BTreeMap::new(), fault: None };

    /// Feeds all of it into a hash.
    pub(crate) fn update_digest(&self, hash: &mut blake3::Hasher) {
        for json in self.skins.iter().chain(&self.animations) {
            hash.update(json.to_string().as_bytes());
        }
        for elements in self.elements.values() {
            hash.update(&elements.component.to_le_bytes()).update(elements.kind.as_bytes());
            hash.update(&[u8::from(elements.normalized)]).update(&elements.bytes);
        }
    }
}
