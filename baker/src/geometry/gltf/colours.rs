//! Vertex colours: `COLOR_0`, linear RGB or RGBA, which multiply the base colour.

use super::accessor::{Buffers, read_floats};
use dataset::{Error, Result};
use glam::Vec4;
use gltf::accessor::{Accessor, DataType, Dimensions};

/// Reads them, held to [0, 1]; alpha is 1 where there is none.
pub(super) fn read(accessor: &Accessor, buffers: &Buffers, place: &str) -> Result<Vec<Vec4>> {
    // Integers stand for fractions, whether or not the exporter says so (glTF 2.0, 3.7.2.1).
    let unit = match accessor.data_type() {
        _ if accessor.normalized() => 1.0,
        DataType::U8 => 255.0,
        DataType::U16 => 65535.0,
        DataType::F32 => 1.0,
        other => {
            let what = format!("COLOR_0 is {other:?}: expected floats or unsigned integers of 8 or 16 bits");
            return Err(Error::invalid(place, what));
        }
    };
    let colours: Vec<Vec4> = match accessor.dimensions() {
        Dimensions::Vec4 => read_floats::<4>(accessor, buffers, place)?.into_iter().map(Vec4::from).collect(),
        _ => {
            let opaque = |[r, g, b]: [f32; 3]| Vec4::new(r, g, b, unit);
            read_floats::<3>(accessor, buffers, place)?.into_iter().map(opaque).collect()
        }
    };
    // (A colour that is no number stays, to be told with its vertex.)
    let held =
        |colour: Vec4| if colour.is_nan() { colour } else { (colour / unit).clamp(Vec4::ZERO, Vec4::ONE) };
    Ok(colours.into_iter().map(held).collect())
}
