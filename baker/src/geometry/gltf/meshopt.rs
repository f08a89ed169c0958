//! Compressed buffer views: `EXT_meshopt_compression`, and `KHR_meshopt_compression`, which allows the same
//! and a little more.
//!
//! The decoder is meshoptimizer's own, which is made for input that nobody vouches for. It takes sizes on
//! trust, so all of them are checked here first.

use dataset::{Error, Result};
use meshopt::ffi;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// The names under which a view says that it is compressed.
const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// The most bytes that one compressed byte can stand for; a view that claims more cannot be whole.
const MOST_PER_BYTE: usize = 2048;

/// What a view says about its compression.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Compressed {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: usize,
    count: usize,
    mode: String,
    #[serde(default)]
    filter: Option<String>,
}

/// The bytes of a view. They are held as words, for what undoes filters works on words.
pub(super) struct Decoded {
    words: Vec<u32>,
    size: usize,
}

impl Decoded {
    /// The bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.size]
    }
}

/// Whether a buffer of the asset is only a stand-in for compressed views, and has no bytes of its own.
pub(super) fn is_fallback(buffer: &Value) -> bool {
    let says = |name: &&str| buffer["extensions"][*name]["fallback"] == Value::Bool(true);
    NAMES.iter().any(says) && buffer.get("uri").is_none()
}

/// Decodes the compressed views of an asset: by the view's index, its bytes. `buffers` are the asset's.
pub(super) fn decode_views<B: AsRef<[u8]>>(
    root: &Value,
    buffers: &[B],
    file: &str,
) -> Result<BTreeMap<usize, Decoded>> {
    let mut decoded = BTreeMap::new();
    for (number, view) in root["bufferViews"].as_array().into_iter().flatten().enumerate() {
        let Some((name, extension)) = NAMES.iter().find_map(|n| Some((n, view["extensions"].get(n)?))) else {
            continue;
        };
        let wrong =
            |what: String| Error::invalid(format!("{file}: buffer view {number}"), format!("{name}: {what}"));
        let compressed = Compressed::deserialize(extension).map_err(|e| wrong(e.to_string()))?;
        let length = view["byteLength"].as_u64();
        decoded.insert(number, compressed.decode(length, buffers).map_err(wrong)?);
    }
    Ok(decoded)
}

impl Compressed {
    /// The view's bytes, or what is wrong with it. `length` is what the view states as its own.
    fn decode<B: AsRef<[u8]>>(&self, length: Option<u64>, buffers: &[B]) -> Result<Decoded, String> {
        let &Compressed { byte_stride: stride, count, .. } = self;
        let source = buffers
            .get(self.buffer)
            .ok_or_else(|| format!("buffer = {}: expected an index below {}", self.buffer, buffers.len()))?;
        let end = self.byte_offset.checked_add(self.byte_length);
        let source = end.and_then(|end| source.as_ref().get(self.byte_offset..end));
        let source = source.ok_or("it ends outside its buffer: is the file whole?")?;
        let size = count.checked_mul(stride).filter(|&size| length == Some(size as u64));
        let size = size.ok_or_else(|| {
            format!("{count} elements of {stride} bytes: expected as many bytes as the view has")
        })?;
        if size / MOST_PER_BYTE > source.len() {
            return Err(format!(
                "{size} bytes out of {}: expected {MOST_PER_BYTE} times as many at most",
                source.len()
            ));
        }
        let strides = |fits: bool, expected: &str| match fits {
            true => Ok(()),
            false => Err(format!("byteStride = {stride} with mode {}: expected {expected}", self.mode)),
        };
        let mut words: Vec<u32> = Vec::new();
        words
            .try_reserve_exact(size.div_ceil(4))
            .map_err(|_| format!("{size} bytes: more than there is memory for"))?;
        words.resize(size.div_ceil(4), 0);
        let (to, from) = (words.as_mut_ptr().cast(), source.as_ptr());
        let result = match self.mode.as_str() {
            "ATTRIBUTES" => {
                strides(stride % 4 == 0 && (4..=256).contains(&stride), "a multiple of 4, up to 256")?;
                // SAFETY: `to` has room for `count` elements of `stride` bytes, `from` has `source.len()`
                // bytes, and the stride is one that the decoder takes. It reads and writes no byte outside
                // them, whatever they hold.
                unsafe { ffi::meshopt_decodeVertexBuffer(to, count, stride, from, source.len()) }
            }
            "TRIANGLES" => {
                strides(stride == 2 || stride == 4, "2 or 4")?;
                if count % 3 != 0 {
                    return Err(format!("{count} indices of triangles: expected a multiple of 3"));
                }
                // SAFETY: as above; the count is a multiple of 3, as the decoder takes it.
                unsafe { ffi::meshopt_decodeIndexBuffer(to, count, stride, from, source.len()) }
            }
            "INDICES" => {
                strides(stride == 2 || stride == 4, "2 or 4")?;
                // SAFETY: as above.
                unsafe { ffi::meshopt_decodeIndexSequence(to, count, stride, from, source.len()) }
            }
            other => return Err(format!("mode {other:?}: expected ATTRIBUTES, TRIANGLES or INDICES")),
        };
        if result != 0 {
            return Err("its bytes cannot be decoded: is the file damaged?".to_owned());
        }
        self.undo_filter(&mut words)?;
        Ok(Decoded { words, size })
    }

    /// Undoes what was done to the values before they were compressed.
    fn undo_filter(&self, words: &mut [u32]) -> Result<(), String> {
        let &Compressed { byte_stride: stride, count, .. } = self;
        let filter = self.filter.as_deref().unwrap_or("NONE");
        let (undo, fits): (unsafe extern "C" fn(*mut std::ffi::c_void, usize, usize), bool) = match filter {
            "NONE" => return Ok(()),
            "OCTAHEDRAL" => (ffi::meshopt_decodeFilterOct, stride == 4 || stride == 8),
            "QUATERNION" => (ffi::meshopt_decodeFilterQuat, stride == 8),
            "EXPONENTIAL" => (ffi::meshopt_decodeFilterExp, stride % 4 == 0),
            "COLOR" => (ffi::meshopt_decodeFilterColor, stride == 4 || stride == 8),
            other => {
                let known = "expected NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR";
                return Err(format!("filter {other:?}: {known}"));
            }
        };
        if self.mode != "ATTRIBUTES" || !fits {
            let expected = "expected mode ATTRIBUTES and a stride that the filter takes";
            return Err(format!(
                "filter {filter} with mode {} and byteStride = {stride}: {expected}",
                self.mode
            ));
        }
        // SAFETY: `words` hold `count` elements of `stride` bytes, which is a stride that the filter takes.
        unsafe { undo(words.as_mut_ptr().cast(), count, stride) };
        Ok(())
    }
}
