//! One mesh of a file as a primitive: its own vertices, those on edges of charts once per chart.

use super::container::{FLOAT, Glb, INDICES, UNSIGNED_INT, UNSIGNED_SHORT, VERTICES};
use crate::geometry::{Bounds, Mesh};
use glam::{DVec3, Vec2, Vec3};
use serde_json::{Map, Value, json};

/// Lightmap coordinates per triangle of a mesh, by its number, ascending, in the order of the mesh's corners.
pub(super) type Layout = Vec<(u32, [Vec2; 3])>;

/// How a mesh's own attributes are written.
#[derive(Clone, Copy, Default)]
pub(super) struct Own {
    /// The set that the file's `TEXCOORD_1` becomes, where the material reads it.
    pub moved: Option<u32>,
    /// The scene file gives the surface another colour, so the vertices keep no more than their alpha.
    pub is_recoloured: bool,
}

/// What a mesh's positions are relative to as they are written: in whole numbers of single precision.
pub(super) fn origin(mesh: &Mesh) -> DVec3 {
    mesh.origin.as_vec3().as_dvec3()
}

/// The attributes and indices of some triangles, by their numbers, ascending. Triangles that the layout
/// leaves out have (0, 0).
///
/// `TEXCOORD_1` holds the layout, and the file's own, if `own.moved` is a set, is that one. Without a layout
/// the file's own stay where they are, if `own.moved` asks for any.
pub(super) fn write(
    mesh: &Mesh,
    triangles: impl Iterator<Item = u32>,
    layout: Option<&Layout>,
    own: Own,
    out: &mut Glb,
) -> Map<String, Value> {
    let mut vertices: Vec<(u32, Vec2)> = Vec::new();
    // Per vertex of the mesh the first of its copies, per copy the next one.
    let (mut first, mut next) = (vec![u32::MAX; mesh.positions.len()], Vec::new());
    let mut indices: Vec<u32> = Vec::new();
    let mut faces = layout.into_iter().flatten().peekable();
    for triangle in triangles {
        while faces.next_if(|face| face.0 < triangle).is_some() {}
        let face = faces.next_if(|face| face.0 == triangle);
        for k in 0..3 {
            let vertex = mesh.triangles[triangle as usize][k];
            let uv = face.map_or(Vec2::ZERO, |face| face.1[k]);
            let mut copy = first[vertex as usize];
            while copy != u32::MAX
                && vertices[copy as usize].1.to_array().map(f32::to_bits) != uv.to_array().map(f32::to_bits)
            {
                copy = next[copy as usize];
            }
            if copy == u32::MAX {
                copy = vertices.len() as u32;
                vertices.push((vertex, uv));
                next.push(std::mem::replace(&mut first[vertex as usize], copy));
            }
            indices.push(copy);
        }
    }
    let count = vertices.len();
    let mut attributes = Map::new();
    let rest = (mesh.origin - origin(mesh)).as_vec3();
    let positions: Vec<Vec3> = vertices.iter().map(|v| mesh.positions[v.0 as usize] + rest).collect();
    let Bounds { low, high } = Bounds::of(positions.iter().copied());
    let mut position = out.accessor(bytemuck::cast_slice(&positions), count, FLOAT, "VEC3", VERTICES);
    position["min"] = json!(low.to_array());
    position["max"] = json!(high.to_array());
    attributes.insert("POSITION".into(), out.push(position));
    if !mesh.normals.is_empty() {
        let normals = unit_normals(mesh);
        let normals: Vec<Vec3> = vertices.iter().map(|v| normals[v.0 as usize]).collect();
        let normal = out.accessor(bytemuck::cast_slice(&normals), count, FLOAT, "VEC3", VERTICES);
        attributes.insert("NORMAL".into(), out.push(normal));
    }
    for attribute in &mesh.attributes {
        let mut bytes: Vec<u8> = vertices.iter().flat_map(|v| attribute.of(v.0 as usize)).copied().collect();
        if own.is_recoloured && attribute.name == "COLOR_0" {
            if attribute.kind != "VEC4" {
                continue;
            }
            bytes.chunks_exact_mut(attribute.stride).for_each(|colour| whiten(colour, attribute.component));
        }
        let mut accessor = out.accessor(&bytes, count, attribute.component, attribute.kind, VERTICES);
        if attribute.normalized {
            accessor["normalized"] = json!(true);
        }
        if attribute.component != FLOAT && attribute.component != UNSIGNED_INT {
            // Elements are filled up to 4 bytes.
            let view = accessor["bufferView"].as_u64().unwrap_or(0) as usize;
            out.views[view]["byteStride"] = json!(attribute.stride);
        }
        attributes.insert(attribute.name.clone(), out.push(accessor));
    }
    let mut pairs = |uvs: Vec<Vec2>| {
        let accessor = out.accessor(bytemuck::cast_slice(&uvs), count, FLOAT, "VEC2", VERTICES);
        out.push(accessor)
    };
    let of_mesh = |from: &[Vec2]| {
        vertices.iter().map(|v| from.get(v.0 as usize).copied().unwrap_or_default()).collect()
    };
    if mesh.primitive.is_none() && !mesh.uvs.is_empty() {
        attributes.insert("TEXCOORD_0".into(), pairs(of_mesh(&mesh.uvs)));
    }
    if let (Some(set), false) = (own.moved, mesh.lightmap_uvs.is_empty()) {
        attributes.insert(format!("TEXCOORD_{set}"), pairs(of_mesh(&mesh.lightmap_uvs)));
    }
    if layout.is_some() {
        // Sets are numbered without gaps.
        if !attributes.contains_key("TEXCOORD_0") {
            attributes.insert("TEXCOORD_0".into(), pairs(of_mesh(&[])));
        }
        attributes.insert("TEXCOORD_1".into(), pairs(vertices.iter().map(|v| v.1).collect()));
    }
    let mut primitive = Map::new();
    primitive.insert("attributes".into(), Value::Object(attributes));
    primitive.insert("indices".into(), write_indices(&indices, count, out));
    primitive
}

/// Numbers of some vertices as a new accessor.
pub(super) fn write_indices(indices: &[u32], vertices: usize, out: &mut Glb) -> Value {
    // (65535 is reserved.)
    let indices = if vertices < 65535 {
        let short: Vec<u16> = indices.iter().map(|&index| index as u16).collect();
        out.accessor(bytemuck::cast_slice(&short), short.len(), UNSIGNED_SHORT, "SCALAR", INDICES)
    } else {
        out.accessor(bytemuck::cast_slice(indices), indices.len(), UNSIGNED_INT, "SCALAR", INDICES)
    };
    out.push(indices)
}

/// Makes a colour with alpha white, whose components are of this type.
pub(super) fn whiten(colour: &mut [u8], component: u32) {
    let one: &[u8] = match component {
        FLOAT => &1f32.to_le_bytes(),
        UNSIGNED_SHORT => &[0xff; 2],
        _ => &[0xff],
    };
    colour.chunks_exact_mut(one.len()).take(3).for_each(|channel| channel.copy_from_slice(one));
}

/// A mesh's normals, those that are not of unit length made so; where there is none, that of the triangles
/// around.
fn unit_normals(mesh: &Mesh) -> Vec<Vec3> {
    let mut normals = mesh.normals.clone();
    if normals.iter().all(is_unit) {
        return normals;
    }
    let mut around = vec![DVec3::ZERO; normals.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize].as_dvec3());
        triangle.iter().for_each(|&v| around[v as usize] += (b - a).cross(c - a));
    }
    for (normal, around) in normals.iter_mut().zip(around) {
        *normal = unit(*normal, around.try_normalize().unwrap_or(DVec3::Y).as_vec3());
    }
    normals
}

fn is_unit(vector: &Vec3) -> bool {
    (vector.length() - 1.0).abs() < 1e-4
}

/// A vector of unit length, as it is if it is one; `other` for one without direction.
pub(super) fn unit(vector: Vec3, other: Vec3) -> Vec3 {
    if is_unit(&vector) {
        return vector;
    }
    vector.as_dvec3().try_normalize().map_or(other, |unit| unit.as_vec3())
}
