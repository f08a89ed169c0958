//! Which instances share a layout of charts.
//!
//! The rule: lightmapped instances of one mesh share a layout when their linear parts differ by rotation, mirroring and uniform
//! scale (within 10⁻³) and their texels per metre of the mesh by no more than a factor of 4. Other stretches would stretch
//! texels with them, and the gaps between charts, which the smallest member needs, grow with the scale.

use crate::geometry::{Geometry, Instance};
use glam::DVec3;
use std::collections::BTreeMap;

/// The largest ratio of scales in a group.
const LARGEST_RATIO: f64 = 4.0;

/// Scales closer than this, relatively, are one: what is left of equal scales after a rotation is rounding.
const SAME: f64 = 1e-6;

/// Instances that share a layout, or one that shares with none.
#[derive(Clone, Debug)]
pub struct Group {
    /// In the order of the geometry; the layout is made from the first one.
    pub members: Vec<Member>,
    /// Density of the smallest member in units of the first one's metres.
    pub density: f64,
}

/// An instance of a group.
#[derive(Clone, Copy, Debug)]
pub struct Member {
    /// Index into `Geometry::instances`.
    pub instance: usize,
    /// Scale of the layout: texels per texel of the smallest member, at least 1.
    pub scale: f64,
    /// Whether its triangles run the other way round than the first one's: the last two corners are swapped.
    pub mirrored: bool,
    /// The middle of its corners, in metres.
    pub centre: DVec3,
}

/// Groups all lightmapped instances, in the order of their first members: each joins the first group that takes it.
pub fn groups(geometry: &Geometry) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    let mut of_mesh: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    let lightmapped = geometry.instances.iter().enumerate().filter(|(_, instance)| instance.lightmap);
    for (index, instance) in lightmapped {
        let candidates = of_mesh.entry(instance.mesh).or_default();
        let joined = candidates.iter().any(|&group| {
            let members = &mut groups[group].members;
            let first = &geometry.instances[members[0].instance];
            let Some(similarity) = first.similarity(instance, geometry.origin) else { return false };
            // Until the group is whole, scales count texels per metre of the first member.
            let scale = similarity.scale * instance.density;
            let scale =
                members.iter().map(|m| m.scale).find(|s| (s / scale - 1.0).abs() < SAME).unwrap_or(scale);
            let (low, high) =
                members.iter().fold((scale, scale), |(l, h), m| (l.min(m.scale), h.max(m.scale)));
            let joins = high <= low * LARGEST_RATIO * (1.0 + SAME)
                && first.has_lightmap_uvs == instance.has_lightmap_uvs;
            if joins {
                let mirrored = similarity.mirrored;
                members.push(Member { instance: index, scale, mirrored, centre: centre(geometry, instance) });
            }
            joins
        });
        if !joined {
            candidates.push(groups.len());
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

/// The middle of an instance's corners.
fn centre(geometry: &Geometry, instance: &Instance) -> DVec3 {
    let corners = &geometry.positions[instance.vertices.clone()];
    corners.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / corners.len().max(1) as f64
}
