//! Whether nodes move, and what is kept of a file so that they can: skins, animations, and the bytes of
//! meshes that these deform.

use super::accessor::{Buffers, read_floats, read_indices, read_packed, read_raw};
use super::material::OpenAsset;
use crate::geometry::motion::{Elements, Motion, Use, index, is_deformable, use_of};
use dataset::{Error, Result};
use gltf::accessor::{Accessor, DataType, Dimensions};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// The key of the extras of nodes that move.
const MOVABLE: &str = "movable";
/// Most bytes of zeros that a file asks for without storing them.
const MOST_ZEROS: usize = 1 << 28;
/// glTF's number for 32-bit floats.
const FLOAT: u32 = 5126;
/// And for 32-bit unsigned integers.
const UNSIGNED_INT: u32 = 5125;

/// What the extras of a node (its JSON) say of whether it moves; an error says what is wrong with them.
pub(super) fn movable(node: &Value) -> std::result::Result<Option<bool>, String> {
    match &node["extras"][MOVABLE] {
        Value::Null => Ok(None),
        Value::Bool(movable) => Ok(Some(*movable)),
        // Programs whose custom properties are numbers.
        Value::Number(number) if number.as_f64() == Some(1.0) => Ok(Some(true)),
        Value::Number(number) if number.as_f64() == Some(0.0) => Ok(Some(false)),
        _ => Err(format!("`{MOVABLE}` in its extras is not used: expected true or false")),
    }
}

/// Skins, animations and deformable meshes of an asset.
pub(super) fn read(asset: &OpenAsset) -> Motion {
    let list = |key: &str| asset.root[key].as_array().cloned().unwrap_or_default();
    let mut motion = Motion { skins: list("skins"), animations: list("animations"), ..Motion::default() };
    if let Err(error) = elements(asset, &mut motion) {
        motion.elements.clear();
        motion.fault = Some(crate::geometry::model::reason(&error));
    }
    motion
}

/// Reads the accessors that skins, animations and deformable primitives name.
fn elements(asset: &OpenAsset, motion: &mut Motion) -> Result<()> {
    let mut wanted = BTreeSet::new();
    let mut want = |value: &Value, of: Use| wanted.extend(index(value).map(|index| (index, of)));
    motion.skins.iter().for_each(|skin| want(&skin["inverseBindMatrices"], Use::Data));
    for sampler in motion.animations.iter().flat_map(|animation| list(&animation["samplers"])) {
        want(&sampler["input"], Use::Data);
        want(&sampler["output"], Use::Data);
    }
    let meshes = list(&asset.root["meshes"]).iter();
    for primitive in meshes.flat_map(|mesh| list(&mesh["primitives"])).filter(|p| is_deformable(p)) {
        let targets = list(&primitive["targets"]).iter();
        for (name, accessor) in targets.chain([&primitive["attributes"]]).flat_map(attributes) {
            want(accessor, use_of(name));
        }
        want(&primitive["indices"], Use::Indices);
    }
    let all: Vec<Accessor> = asset.document.accessors().collect();
    let mut zeros = 0;
    for (index, of) in wanted {
        let accessor = all.get(index).ok_or_else(|| {
            Error::invalid(asset.file, format!("accessor {index}: expected an index below {}", all.len()))
        })?;
        if accessor.view().is_none() {
            zeros += accessor.count().saturating_mul(accessor.size());
        }
        if zeros > MOST_ZEROS {
            let what = format!("accessors without bufferView: expected at most {MOST_ZEROS} bytes in all");
            return Err(Error::invalid(asset.file, what));
        }
        motion.elements.insert((index, of), read_elements(accessor, of, asset.buffers)?);
    }
    for (i, mesh) in list(&asset.root["meshes"]).iter().enumerate() {
        let primitives = list(&mesh["primitives"]).iter().enumerate();
        for (j, primitive) in primitives.filter(|(_, primitive)| is_deformable(primitive)) {
            check(primitive, &motion.elements, &format!("{}: mesh {i}, primitive {j}", asset.file))?;
        }
    }
    Ok(())
}

/// Checks that all attributes and targets of a primitive are as many as its positions, and that its indices
/// name them.
fn check(primitive: &Value, elements: &BTreeMap<(usize, Use), Elements>, place: &str) -> Result<()> {
    let of = |accessor: &Value, of: Use| elements.get(&(index(accessor)?, of));
    let count = of(&primitive["attributes"]["POSITION"], Use::Floats).map_or(0, |positions| positions.count);
    let targets = list(&primitive["targets"]).iter();
    for (name, accessor) in targets.chain([&primitive["attributes"]]).flat_map(attributes) {
        let found = of(accessor, use_of(name)).map_or(0, |elements| elements.count);
        if found != count {
            return Err(Error::invalid(
                place,
                format!("{name} has {found} elements: expected {count}, as many as POSITION"),
            ));
        }
    }
    let indices = of(&primitive["indices"], Use::Indices).map_or(&[][..], |indices| &indices.bytes);
    let words = indices.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
    match words.max() {
        Some(most) if most as usize >= count => Err(Error::invalid(
            place,
            format!("a triangle names vertex {most}: expected an index below {count}"),
        )),
        _ => Ok(()),
    }
}

/// The elements of an array.
fn list(json: &Value) -> &[Value] {
    json.as_array().map_or(&[], Vec::as_slice)
}

/// The attributes of a primitive or of a morph target: names and accessors.
fn attributes(json: &Value) -> impl Iterator<Item = (&String, &Value)> {
    json.as_object().into_iter().flatten()
}

fn read_elements(accessor: &Accessor, of: Use, buffers: &Buffers) -> Result<Elements> {
    let kind = match accessor.dimensions() {
        Dimensions::Scalar => "SCALAR",
        Dimensions::Vec2 => "VEC2",
        Dimensions::Vec3 => "VEC3",
        Dimensions::Vec4 => "VEC4",
        Dimensions::Mat2 => "MAT2",
        Dimensions::Mat3 => "MAT3",
        Dimensions::Mat4 => "MAT4",
    };
    let component = accessor.data_type().as_gl_enum();
    let count = accessor.count();
    let as_it_is = |bytes| Elements { component, kind, normalized: accessor.normalized(), count, bytes };
    let of_words = |component, bytes| Elements { component, kind, normalized: false, count, bytes };
    let floats = |floats: Vec<f32>| match floats.iter().find(|value| !value.is_finite()) {
        None => Ok(bytemuck::cast_slice(&floats).to_vec()),
        Some(value) => Err(Error::invalid(
            "",
            format!("accessor {}: {value}: expected finite numbers", accessor.index()),
        )),
    };
    Ok(match of {
        Use::Floats => of_words(
            FLOAT,
            floats(match accessor.dimensions() {
                Dimensions::Vec2 => read_floats::<2>(accessor, buffers, "")?.concat(),
                Dimensions::Vec4 => read_floats::<4>(accessor, buffers, "")?.concat(),
                _ => read_floats::<3>(accessor, buffers, "")?.concat(),
            })?,
        ),
        Use::Indices => {
            of_words(UNSIGNED_INT, bytemuck::cast_slice(&read_indices(accessor, buffers, "")?).to_vec())
        }
        Use::Vertices => as_it_is(read_raw(accessor, buffers)?.1),
        Use::Data => {
            let bytes = read_packed(accessor, buffers)?;
            if accessor.data_type() == DataType::F32 {
                let words = bytes.as_chunks::<4>().0.iter().map(|word| f32::from_le_bytes(*word));
                floats(words.collect())?;
            }
            as_it_is(bytes)
        }
    })
}
