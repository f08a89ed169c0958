//! The pose in which a mesh stands: its morph targets by their default weights, then its skin by its joints
//! (glTF 2.0, 3.7.2.2 and 3.7.3.3).

use super::accessor::{Buffers, read_floats};
use super::material::OpenAsset;
use super::parent_from_node;
use crate::geometry::model::{Attribute, Mesh, normal_matrix};
use dataset::{Error, Result};
use glam::{DMat3, DMat4, DVec3, Vec3};
use gltf::mesh::Semantic;
use std::collections::BTreeMap;

/// What a node makes of its mesh: nodes of the same pose show the same triangles.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Pose {
    /// Bits of the weight of each morph target; empty: none has any.
    weights: Vec<u32>,
    /// Index of the skin.
    pub skin: Option<usize>,
}

/// A skin in the pose of its joints.
#[derive(Clone, Debug)]
pub(super) struct Joints {
    /// What positions under the skin are relative to, in the file's space: of single precision.
    origin: DVec3,
    /// Per joint, from the mesh's space to the file's about `origin`.
    from_mesh: Vec<DMat4>,
}

impl Pose {
    /// The default pose: the node's weights go before those of its mesh. A mesh without joints follows no
    /// skin.
    pub(super) fn of(node: &gltf::Node, mesh: &gltf::Mesh) -> Self {
        let weights = node.weights().or(mesh.weights()).unwrap_or_default();
        let weights = match weights.iter().all(|&weight| weight == 0.0) {
            true => Vec::new(),
            false => weights.iter().map(|weight| weight.to_bits()).collect(),
        };
        let is_bound = |primitive: gltf::Primitive| {
            [Semantic::Joints(0), Semantic::Weights(0)]
                .iter()
                .all(|semantic| primitive.get(semantic).is_some())
        };
        let skin = node.skin().filter(|_| mesh.primitives().all(is_bound));
        Pose { weights, skin: skin.map(|skin| skin.index()) }
    }

    /// Brings a mesh as it stands in the file into the pose. `joints` are those of its skin: it then lies in
    /// the file's space.
    pub(super) fn apply(
        &self,
        asset: &OpenAsset,
        primitive: &gltf::Primitive,
        joints: Option<&Joints>,
        mesh: &mut Mesh,
        place: &str,
    ) -> Result<()> {
        let is_tangent = |attribute: &Attribute| attribute.name == "TANGENT";
        let at = mesh.attributes.iter().position(is_tangent);
        let mut tangents: Vec<[f32; 4]> =
            at.map_or(Vec::new(), |at| bytemuck::pod_collect_to_vec(&mesh.attributes[at].bytes));
        for (target, weight) in primitive.morph_targets().zip(&self.weights) {
            let weight = f32::from_bits(*weight);
            let displace = |accessor: Option<gltf::Accessor>,
                            add: &mut dyn FnMut(usize, Vec3),
                            count: usize| {
                let Some(accessor) = accessor.filter(|_| weight != 0.0 && count > 0) else { return Ok(()) };
                let by = read_floats::<3>(&accessor, asset.buffers, place)?;
                if by.len() != count {
                    let what = format!("a morph target of {} elements for {count} vertices", by.len());
                    return Err(Error::invalid(place, what));
                }
                by.into_iter().enumerate().for_each(|(i, by)| add(i, weight * Vec3::from(by)));
                Ok(())
            };
            let (positions, normals) = (&mut mesh.positions, &mut mesh.normals);
            let count = positions.len();
            displace(target.positions(), &mut |i, by| positions[i] += by, count)?;
            let count = normals.len();
            displace(target.normals(), &mut |i, by| normals[i] += by, count)?;
            let count = tangents.len();
            let mut turn = |i: usize, by: Vec3| (0..3).for_each(|k| tangents[i][k] += by[k]);
            displace(target.tangents(), &mut turn, count)?;
        }
        if let Some(joints) = joints {
            joints.apply(primitive, asset.buffers, mesh, &mut tangents, place)?;
        }
        if let Some(at) = at {
            tangents.iter_mut().for_each(make_unit);
            mesh.attributes[at].bytes = bytemuck::cast_slice(&tangents).to_vec();
        }
        Ok(())
    }

    /// Whether it leaves every mesh as it is in the file.
    pub(super) fn is_plain(&self) -> bool {
        self.weights.is_empty() && self.skin.is_none()
    }
}

/// The skins of an asset, as nodes use them.
#[derive(Default)]
pub(super) struct Skins {
    file_from_node: Vec<Option<DMat4>>,
    known: BTreeMap<usize, Joints>,
}

impl Skins {
    /// A skin in the pose of its joints.
    pub(super) fn joints(&mut self, asset: &OpenAsset, skin: &gltf::Skin) -> Result<&Joints> {
        if self.file_from_node.is_empty() {
            self.file_from_node = file_from_nodes(asset.document);
        }
        if !self.known.contains_key(&skin.index()) {
            let joints = joints(asset, skin, &self.file_from_node)?;
            self.known.insert(skin.index(), joints);
        }
        Ok(&self.known[&skin.index()])
    }
}

fn joints(asset: &OpenAsset, skin: &gltf::Skin, file_from_node: &[Option<DMat4>]) -> Result<Joints> {
    let place = format!(
        "{}: skin {}",
        asset.file,
        skin.name().map_or_else(|| skin.index().to_string(), str::to_owned)
    );
    let nodes: Vec<usize> = skin.joints().map(|node| node.index()).collect();
    let from_mesh = match skin.inverse_bind_matrices() {
        None => vec![[0.0; 16]; 0],
        Some(accessor) => read_floats::<16>(&accessor, asset.buffers, &place)?,
    };
    if !from_mesh.is_empty() && from_mesh.len() < nodes.len() {
        let what = format!(
            "{} inverse bind matrices: expected one for each of {} joints",
            from_mesh.len(),
            nodes.len()
        );
        return Err(Error::invalid(place, what));
    }
    let mut origin = None;
    let mut matrices = Vec::with_capacity(nodes.len());
    for (i, &node) in nodes.iter().enumerate() {
        let Some(file_from_joint) = file_from_node[node] else {
            return Err(Error::invalid(
                place,
                format!("joint {i}: node {node} is below itself: expected a tree"),
            ));
        };
        let origin = *origin.get_or_insert_with(|| file_from_joint.w_axis.truncate().as_vec3().as_dvec3());
        let joint_from_mesh = from_mesh
            .get(i)
            .map_or(DMat4::IDENTITY, |columns| DMat4::from_cols_array(&columns.map(f64::from)));
        let matrix = DMat4::from_translation(-origin) * file_from_joint * joint_from_mesh;
        if !matrix.is_finite() {
            return Err(Error::invalid(place, format!("joint {i}: its transform: expected finite numbers")));
        }
        matrices.push(matrix);
    }
    Ok(Joints { origin: origin.unwrap_or_default(), from_mesh: matrices })
}

/// Where the nodes stand in the file's space; `None` for those that no root leads to.
fn file_from_nodes(document: &gltf::Document) -> Vec<Option<DMat4>> {
    let nodes: Vec<gltf::Node> = document.nodes().collect();
    let mut parent = vec![None; nodes.len()];
    nodes.iter().for_each(|node| node.children().for_each(|c| parent[c.index()] = Some(node.index())));
    let mut found = vec![None; nodes.len()];
    let mut stack: Vec<(usize, DMat4)> =
        (0..nodes.len()).filter(|&i| parent[i].is_none()).map(|i| (i, DMat4::IDENTITY)).collect();
    while let Some((i, file_from_parent)) = stack.pop() {
        let file_from_node = file_from_parent * parent_from_node(&nodes[i]);
        found[i] = Some(file_from_node);
        // (A node with two parents is a child of the last one alone.)
        let children = nodes[i].children().map(|child| child.index());
        stack.extend(children.filter(|&child| parent[child] == Some(i)).map(|child| (child, file_from_node)));
    }
    found
}

impl Joints {
    /// Brings a mesh to where its joints are.
    fn apply(
        &self,
        primitive: &gltf::Primitive,
        buffers: &Buffers,
        mesh: &mut Mesh,
        tangents: &mut [[f32; 4]],
        place: &str,
    ) -> Result<()> {
        let count = mesh.positions.len();
        let mut sums = vec![(DMat4::ZERO, 0.0); count];
        let mut sets = 0;
        while let (Some(joints), Some(weights)) =
            (primitive.get(&Semantic::Joints(sets)), primitive.get(&Semantic::Weights(sets)))
        {
            let joints = read_floats::<4>(&joints, buffers, place)?;
            let weights = read_floats::<4>(&weights, buffers, place)?;
            if joints.len() != count || weights.len() != count {
                let what =
                    format!("{} joints and {} weights for {count} positions", joints.len(), weights.len());
                return Err(Error::invalid(place, what));
            }
            for (vertex, (joints, weights)) in joints.iter().zip(&weights).enumerate() {
                for (&joint, &weight) in joints.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                    let Some(matrix) = self.from_mesh.get(joint as usize) else {
                        let what = format!(
                            "vertex {vertex} names joint {joint} of JOINTS_{sets}: expected an index below {}",
                            self.from_mesh.len()
                        );
                        return Err(Error::invalid(place, what));
                    };
                    let (sum, total) = &mut sums[vertex];
                    (*sum, *total) = (*sum + *matrix * f64::from(weight), *total + f64::from(weight));
                }
            }
            sets += 1;
        }
        // Weights that quantisation or the exporter left short of 1 mean shares; none at all mean the first
        // joint, as viewers read them.
        let first = self.from_mesh.first().copied().unwrap_or(DMat4::IDENTITY);
        let matrices: Vec<DMat4> = sums
            .into_iter()
            .map(|(sum, total)| if total == 0.0 { first } else { sum * (1.0 / total) })
            .collect();
        for (position, matrix) in mesh.positions.iter_mut().zip(&matrices) {
            *position = matrix.transform_point3(position.as_dvec3()).as_vec3();
        }
        for (normal, matrix) in mesh.normals.iter_mut().zip(&matrices) {
            let turned = normal_matrix(DMat3::from_mat4(*matrix)) * normal.as_dvec3();
            *normal = turned.normalize_or_zero().as_vec3();
        }
        for (tangent, matrix) in tangents.iter_mut().zip(&matrices) {
            let [x, y, z, _] = tangent.map(f64::from);
            let turned = matrix.transform_vector3(DVec3::new(x, y, z)).as_vec3();
            tangent[..3].copy_from_slice(&turned.to_array());
        }
        // A mirror turns the winding round; swapping two corners keeps the front in front.
        for [a, b, c] in &mut mesh.triangles {
            let determinant =
                |v: u32| matrices.get(v as usize).map_or(0.0, |m| DMat3::from_mat4(*m).determinant());
            if determinant(*a) + determinant(*b) + determinant(*c) < 0.0 {
                std::mem::swap(b, c);
            }
        }
        mesh.origin = self.origin;
        Ok(())
    }
}

/// Makes the direction of a tangent a unit vector.
fn make_unit(tangent: &mut [f32; 4]) {
    let [x, y, z, _] = *tangent;
    let unit = Vec3::new(x, y, z).try_normalize().unwrap_or(Vec3::X);
    tangent[..3].copy_from_slice(&unit.to_array());
}
