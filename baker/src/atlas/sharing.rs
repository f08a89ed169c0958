//! Which instances share a layout of charts.
//!
//! The rule: lightmapped instances of one mesh share a layout when their linear parts differ by rotation,
//! mirroring and uniform scale (within 10⁻³) and their texels per metre of the mesh by no more than a factor
//! of 4. Other stretches would stretch texels with them, and the gaps between charts, which the smallest
//! member needs, grow with the scale.

use crate::geometry::{Geometry, Instance};
use glam::DVec3;
use std::collections::BTreeMap;

/// The largest ratio of scales in a group.
const LARGEST_RATIO: f64 = 4.0;

/// Scales closer than this, relatively, are one: what is left of equal scales after a rotation is rounding.
const SAME_SCALE: f64 = 1e-6;

/// Instances that share a layout, or one that shares with none.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// In the order of the geometry; the layout is made from the first one.
    pub members: Vec<Member>,
    /// Density of the smallest member in units of the first one's metres.
    pub density: f64,
}

/// An instance of a group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    /// Index into `Geometry::instances`.
    pub instance: usize,
    /// Scale of the layout: texels per texel of the smallest member, at least 1.
    pub scale: f64,
    /// Whether its triangles run the other way round than the first one's: the last two corners are swapped.
    pub mirrored: bool,
    /// The middle of its corners, in metres.
    pub centre: DVec3,
}

/// Groups all lightmapped instances, in the order of their first members: each joins the first group that
/// takes it.
pub(super) fn groups(geometry: &Geometry) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    // The groups of a mesh, ascending, by the stretch of their first members.
    let mut of_mesh: BTreeMap<(u32, [i32; 2]), Vec<usize>> = BTreeMap::new();
    let lightmapped = geometry.instances.iter().enumerate().filter(|(_, instance)| instance.lightmap);
    for (index, instance) in lightmapped {
        let stretch = stretch(instance);
        let near = [-1, 0, 1].map(|x| [-1, 0, 1].map(|y| [stretch[0] + x, stretch[1] + y]));
        let near = near.as_flattened().iter().filter_map(|&near| of_mesh.get(&(instance.mesh, near)));
        let mut candidates: Vec<usize> = near.flatten().copied().collect();
        candidates.sort_unstable();
        let joined = candidates.into_iter().any(|group| {
            let members = &mut groups[group].members;
            let first = &geometry.instances[members[0].instance];
            let Some(similarity) = first.similarity(instance, geometry.origin) else { return false };
            // Until the group is whole, scales count texels per metre of the first member.
            let scale = similarity.scale * instance.density;
            let scale = members
                .iter()
                .map(|m| m.scale)
                .find(|s| (s / scale - 1.0).abs() < SAME_SCALE)
                .unwrap_or(scale);
            let (low, high) =
                members.iter().fold((scale, scale), |(l, h), m| (l.min(m.scale), h.max(m.scale)));
            let joins = high <= low * LARGEST_RATIO * (1.0 + SAME_SCALE)
                && first.has_lightmap_uvs == instance.has_lightmap_uvs;
            if joins {
                let mirrored = similarity.mirrored;
                members.push(Member { instance: index, scale, mirrored, centre: centre(geometry, instance) });
            }
            joins
        });
        if !joined {
            of_mesh.entry((instance.mesh, stretch)).or_default().push(groups.len());
            let centre = centre(geometry, instance);
            let first = Member { instance: index, scale: instance.density, mirrored: false, centre };
            groups.push(Group { members: vec![first], density: 1.0 });
        }
    }
    for group in &mut groups {
        group.density = group.members.iter().map(|m| m.scale).fold(f64::INFINITY, f64::min);
        group.members.iter_mut().for_each(|m| m.scale /= group.density);
    }
    groups
}

/// How a mesh is stretched, as a cell of a grid: the parts of two axes in the squared lengths of all three.
/// Turns, mirrors and uniform scales do not change them. Those of equal shapes (within the 10⁻³ of
/// [`Instance::similarity`]) differ by less than a cell, of 1/64.
fn stretch(instance: &Instance) -> [i32; 2] {
    const CELLS: f64 = 64.0;
    let linear = instance.world_from_mesh.matrix3;
    let squares = [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| axis.length_squared());
    let all = squares[0] + squares[1] + squares[2];
    [squares[0], squares[1]].map(|square| (CELLS * square / all).floor() as i32)
}

/// The middle of an instance's corners.
fn centre(geometry: &Geometry, instance: &Instance) -> DVec3 {
    let corners = &geometry.positions[instance.vertices.clone()];
    corners.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / corners.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DMat3, DQuat};

    #[test]
    fn equal_shapes_share_whatever_their_turn_and_scale() {
        // Stretches on both sides of borders of cells, each turned, mirrored, scaled and off by nearly the
        // tolerance.
        let mut geometry = Geometry::default();
        for i in 0..40 {
            let stretch = DVec3::new(1.0, 1.0 + 0.05 * f64::from(i), 2.0 - 0.03 * f64::from(i));
            for k in 0..12 {
                let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), f64::from(k));
                let mirror = DVec3::new(if k % 2 == 0 { 1.0 } else { -1.0 }, 1.0, 1.0);
                let off = DVec3::new(1.0, 1.0 - 4e-4 * f64::from(k % 3), 1.0 + 4e-4 * f64::from(k % 3));
                let scale = 1.0 + 0.2 * f64::from(k);
                let linear = DMat3::from_quat(turn) * DMat3::from_diagonal(mirror * off * stretch * scale);
                geometry.instances.push(Instance {
                    name: String::new(),
                    mesh: 0,
                    world_from_mesh: DAffine3 { matrix3: linear, translation: DVec3::ZERO },
                    triangles: 0..1,
                    vertices: 0..0,
                    lightmap: true,
                    has_lightmap_uvs: false,
                    lightmap_place: Default::default(),
                    density: 1.0,
                });
            }
        }
        let groups = groups(&geometry);
        let members: Vec<usize> = groups.iter().map(|group| group.members.len()).collect();
        assert_eq!(members, [12; 40]);
    }
}
