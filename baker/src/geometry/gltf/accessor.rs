//! Accessors: typed views of buffers, every read bounds-checked. Any component type is read, as
//! `KHR_mesh_quantization` allows.

use super::meshopt::Decoded;
use dataset::{Error, Result};
use gltf::accessor::{Accessor, DataType};
use std::collections::BTreeMap;

/// More elements than a mesh with 32-bit indices can use.
const MAX_COUNT: usize = 1 << 31;
/// Without a view the elements cost no bytes in the file: a bound of its own.
const MAX_COUNT_WITHOUT_VIEW: usize = 1 << 18;

/// Bytes of the asset's buffers, in order, and of the views that are compressed.
pub(super) struct Buffers<'a> {
    /// One that stands in for compressed views is empty.
    pub plain: Vec<std::borrow::Cow<'a, [u8]>>,
    /// By the view's index.
    pub decoded: BTreeMap<usize, Decoded>,
}

impl Buffers<'_> {
    /// The bytes of a view from an offset in it; `None` if they do not all lie within view and buffer.
    pub(super) fn bytes(&self, view: &gltf::buffer::View, offset: usize, length: usize) -> Option<&[u8]> {
        let end = offset.checked_add(length).filter(|&end| end <= view.length())?;
        if let Some(decoded) = self.decoded.get(&view.index()) {
            return decoded.bytes().get(offset..end);
        }
        let start = view.offset().checked_add(offset)?;
        self.plain.get(view.buffer().index())?.get(start..start.checked_add(length)?)
    }
}

/// Reads a vertex attribute of `N` components as floats.
pub(super) fn read_floats<const N: usize>(
    accessor: &Accessor,
    buffers: &Buffers,
    place: &str,
) -> Result<Vec<[f32; N]>> {
    expect(accessor, N, place)?;
    let (kind, normalized) = (accessor.data_type(), accessor.normalized());
    let size = kind.size();
    let decode = |bytes: &[u8]| std::array::from_fn(|i| float(&bytes[i * size..], kind, normalized));
    read(accessor, buffers, place, [0.0; N], decode)
}

/// Reads indices.
pub(super) fn read_indices(accessor: &Accessor, buffers: &Buffers, place: &str) -> Result<Vec<u32>> {
    expect(accessor, 1, place)?;
    let kind = accessor.data_type();
    if !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32) {
        return Err(bad(accessor, place, "indices that are not unsigned integers"));
    }
    read(accessor, buffers, place, 0, |bytes| index(bytes, kind))
}

/// Reads elements of up to four components as they are, each filled up to a multiple of 4 bytes. Gives that
/// length, too.
pub(super) fn read_raw(accessor: &Accessor, buffers: &Buffers) -> Result<(usize, Vec<u8>)> {
    let size = accessor.size();
    if size > 16 || accessor.count() > MAX_COUNT_WITHOUT_VIEW && accessor.view().is_none() {
        return Err(bad(accessor, "", "more than is read"));
    }
    let decode = |bytes: &[u8]| {
        let mut element = [0u8; 16];
        element[..size].copy_from_slice(bytes);
        element
    };
    let stride = size.next_multiple_of(4);
    let elements = read(accessor, buffers, "", [0; 16], decode)?;
    Ok((stride, elements.iter().flat_map(|element| &element[..stride]).copied().collect()))
}

/// Reads elements of any kind as they are, one right after the other.
pub(super) fn read_packed(accessor: &Accessor, buffers: &Buffers) -> Result<Vec<u8>> {
    let size = accessor.size();
    if accessor.count() > MAX_COUNT || accessor.count() > MAX_COUNT_WITHOUT_VIEW && accessor.view().is_none()
    {
        return Err(bad(accessor, "", "more than is read"));
    }
    // The largest is a matrix of 4 × 4 floats.
    let decode = |bytes: &[u8]| {
        let mut element = [0u8; 64];
        element[..size].copy_from_slice(bytes);
        element
    };
    let elements = read(accessor, buffers, "", [0; 64], decode)?;
    Ok(elements.iter().flat_map(|element| &element[..size]).copied().collect())
}

/// Checks the number of components and of elements.
fn expect(accessor: &Accessor, components: usize, place: &str) -> Result<()> {
    if accessor.dimensions().multiplicity() != components {
        return Err(bad(
            accessor,
            place,
            format!("{:?}, expected {components} components", accessor.dimensions()),
        ));
    }
    let most = if accessor.view().is_some() { MAX_COUNT } else { MAX_COUNT_WITHOUT_VIEW };
    if accessor.count() > most {
        let what = format!("{} elements, expected at most {most}", accessor.count());
        return Err(bad(accessor, place, what));
    }
    Ok(())
}

fn bad(accessor: &Accessor, place: &str, what: impl std::fmt::Display) -> Error {
    Error::invalid(place, format!("accessor {}: {what}", accessor.index()))
}

/// Dense values (zero without a view), then the sparse ones in their places.
fn read<T: Copy>(
    accessor: &Accessor,
    buffers: &Buffers,
    place: &str,
    zero: T,
    decode: impl Fn(&[u8]) -> T,
) -> Result<Vec<T>> {
    let (count, size) = (accessor.count(), accessor.size());
    let mut values = match accessor.view() {
        Some(view) => {
            let stride = view.stride().unwrap_or(size);
            let bytes = slice(&view, accessor.offset(), count, stride, size, buffers)
                .ok_or_else(|| bad(accessor, place, "it ends outside its buffer"))?;
            bytes.chunks(stride).take(count).map(|element| decode(&element[..size])).collect()
        }
        None => vec![zero; count],
    };
    if let Some(sparse) = accessor.sparse() {
        let (indices, changes) = (sparse.indices(), sparse.values());
        let kind = match indices.index_type() {
            gltf::accessor::sparse::IndexType::U8 => DataType::U8,
            gltf::accessor::sparse::IndexType::U16 => DataType::U16,
            gltf::accessor::sparse::IndexType::U32 => DataType::U32,
        };
        let view = (indices.view(), changes.view());
        let at = slice(&view.0, indices.offset(), sparse.count(), kind.size(), kind.size(), buffers);
        let to = slice(&view.1, changes.offset(), sparse.count(), size, size, buffers);
        let (Some(at), Some(to)) = (at, to) else {
            return Err(bad(accessor, place, "its sparse part ends outside its buffer"));
        };
        for (at, to) in at.chunks_exact(kind.size()).zip(to.chunks_exact(size)) {
            let at = index(at, kind) as usize;
            *values
                .get_mut(at)
                .ok_or_else(|| bad(accessor, place, format!("sparse index {at} of {count}")))? = decode(to);
        }
    }
    Ok(values)
}

/// The bytes of `count` elements; `None` if they do not all lie within view and buffer.
fn slice<'a>(
    view: &gltf::buffer::View,
    offset: usize,
    count: usize,
    stride: usize,
    size: usize,
    buffers: &'a Buffers,
) -> Option<&'a [u8]> {
    if count == 0 {
        return Some(&[]);
    }
    let length = (count - 1).checked_mul(stride)?.checked_add(size)?;
    if stride < size {
        return None;
    }
    buffers.bytes(view, offset, length)
}

/// A little-endian unsigned integer.
fn index(bytes: &[u8], kind: DataType) -> u32 {
    match kind {
        DataType::U8 => bytes[0].into(),
        DataType::U16 => u16::from_le_bytes([bytes[0], bytes[1]]).into(),
        _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}

/// A component as a float (glTF 2.0, 3.6.2.2 for normalized integers).
fn float(bytes: &[u8], kind: DataType, normalized: bool) -> f32 {
    let (value, limit) = match kind {
        DataType::I8 => (f32::from(bytes[0] as i8), 127.0),
        DataType::U8 => (f32::from(bytes[0]), 255.0),
        DataType::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        DataType::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        DataType::U32 => return index(bytes, kind) as f32,
        DataType::F32 => return f32::from_bits(index(bytes, DataType::U32)),
    };
    if normalized { (value / limit).max(-1.0) } else { value }
}
