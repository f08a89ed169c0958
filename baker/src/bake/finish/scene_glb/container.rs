//! A GLB under construction: its bytes, and the JSON that describes them.

use crate::{Error, Result};
use serde_json::{Value, json};

/// glTF's numbers for targets of views.
pub(super) const VERTICES: u32 = 34962;
/// See [`VERTICES`].
pub(super) const INDICES: u32 = 34963;
/// glTF's numbers for types of components.
pub(super) const FLOAT: u32 = 5126;
/// See [`FLOAT`].
pub(super) const UNSIGNED_SHORT: u32 = 5123;
/// See [`FLOAT`].
pub(super) const UNSIGNED_INT: u32 = 5125;

/// The binary part, and the views and accessors that say what lies in it.
#[derive(Default)]
pub(super) struct Glb {
    pub binary: Vec<u8>,
    pub views: Vec<Value>,
    pub accessors: Vec<Value>,
}

impl Glb {
    /// Appends bytes as a view; gives its index.
    pub(super) fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// Appends bytes as a view and an accessor, which is yet to be [pushed](Glb::push).
    pub(super) fn accessor(
        &mut self,
        bytes: &[u8],
        count: usize,
        component: u32,
        kind: &str,
        target: u32,
    ) -> Value {
        let view = self.view(bytes, Some(target));
        json!({ "bufferView": view, "componentType": component, "count": count, "type": kind })
    }

    /// Appends an accessor; gives its index.
    pub(super) fn push(&mut self, accessor: Value) -> Value {
        self.accessors.push(accessor);
        json!(self.accessors.len() - 1)
    }

    /// The file: header, JSON chunk padded with spaces, binary chunk.
    pub(super) fn finish(self, root: &Value) -> Result<Vec<u8>> {
        let mut text = serde_json::to_vec(root).map_err(|e| Error::invalid("scene.glb", e))?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.binary.len();
        let word = |length: usize| {
            let length = u32::try_from(length).map_err(|_| {
                Error::unsupported("scene.glb", format!("{length} bytes: a GLB holds less than 4 GiB"))
            });
            length.map(u32::to_le_bytes)
        };
        let mut glb = Vec::with_capacity(total);
        glb.extend_from_slice(b"glTF");
        for bytes in [word(2)?, word(total)?, word(text.len())?] {
            glb.extend_from_slice(&bytes);
        }
        glb.extend_from_slice(b"JSON");
        glb.extend_from_slice(&text);
        glb.extend_from_slice(&word(self.binary.len())?);
        glb.extend_from_slice(b"BIN\0");
        glb.extend_from_slice(&self.binary);
        Ok(glb)
    }
}
