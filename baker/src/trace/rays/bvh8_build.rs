//! Builds the eight-wide hierarchy: obvhs makes a binary one (PLOC, then reinsertion), and the cheapest way
//! to merge its nodes into wide ones and its leaves into packets is found by dynamic programming (Ylitie,
//! Karras & Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", section
//! 3.1).

use super::bvh8::{Bvh8, CUT_OUT, LEAF, Node, Packet, STACK, Tier};
use crate::geometry::Geometry;
use crate::trace::memory_pages::in_large;
use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::node::Bvh2Node;
use std::time::Duration;

/// Cost of a packet's test relative to that of a wide node.
const PACKET_COST: f32 = 1.2;

/// The binary hierarchy: obvhs's nodes (root first, siblings side by side) and the triangles of its leaves.
struct Binary {
    nodes: Vec<Bvh2Node>,
    /// Triangle of each leaf's `first_index`.
    triangles: Vec<u32>,
}

/// How a binary node is best merged: 4 bits per number of places it may take. For 2..=7 places, how many go
/// to its first child (0: one place less is as good); for 1, whether it is a leaf; bits 0..4 are the split of
/// the 8 places of a wide node.
#[derive(Clone, Copy, Default)]
struct Merge(u32);

impl Merge {
    fn get(self, places: usize) -> usize {
        (self.0 >> (4 * places) & 15) as usize
    }

    fn set(&mut self, places: usize, choice: usize) {
        self.0 |= (choice as u32) << (4 * places);
    }
}

impl Bvh8 {
    /// Builds the hierarchy of all triangles that have an area.
    pub fn new(geometry: &Geometry) -> Self {
        let solid: Vec<u32> = (0..geometry.triangles.len() as u32)
            .filter(|&i| has_area(&geometry.corners(i as usize)))
            .collect();
        let mut bvh = Bvh8 { nodes: Vec::new(), packets: Vec::new(), tier: Tier::detect() };
        if solid.is_empty() {
            return bvh;
        }
        let binary = binary(geometry, &solid);
        if !bvh.merge(geometry, &binary) {
            // Deeper than the kernels' stack: the same order of triangles, halved again and again.
            let binary = balanced(geometry, &binary);
            let fits = bvh.merge(geometry, &binary);
            assert!(fits, "a balanced hierarchy is shallow");
        }
        bvh.nodes = in_large(&bvh.nodes);
        bvh.packets = in_large(&bvh.packets);
        bvh
    }

    /// Fills in the wide hierarchy; false where a traversal could overflow the kernels' stack.
    fn merge(&mut self, geometry: &Geometry, binary: &Binary) -> bool {
        let merges = best_merges(&binary.nodes);
        self.nodes.clear();
        self.packets.clear();
        self.nodes.push(Node::EMPTY);
        // Wide nodes to fill: (binary node, wide node, entries that a traversal leaves on the stack on the
        // way there).
        let mut to_fill = vec![(0, 0, 0)];
        while let Some((root, number, waiting)) = to_fill.pop() {
            let mut children = Vec::with_capacity(8);
            places(&binary.nodes, &merges, root, &mut children);
            // All children are pushed and one popped again.
            let waiting = waiting + children.len() - 1;
            if waiting + 1 > STACK {
                return false;
            }
            for (lane, &child) in children.iter().enumerate() {
                let node = &binary.nodes[child];
                let index = if merges[child].get(1) == 1 {
                    self.packets.push(packet(geometry, binary, child));
                    LEAF | (self.packets.len() - 1) as u32
                } else {
                    self.nodes.push(Node::EMPTY);
                    to_fill.push((child, self.nodes.len() - 1, waiting));
                    (self.nodes.len() - 1) as u32
                };
                self.nodes[number].set(lane, node.aabb, index);
            }
        }
        true
    }
}

impl Node {
    const EMPTY: Node = Node {
        planes: [
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
        ],
        children: [LEAF; 8],
    };

    fn set(&mut self, lane: usize, aabb: Aabb, child: u32) {
        for k in 0..3 {
            self.planes[2 * k][lane] = aabb.min[k];
            self.planes[2 * k + 1][lane] = aabb.max[k];
        }
        self.children[lane] = child;
    }
}

/// Whether the triangle has an area, however small, and finite corners.
fn has_area(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let cross = (b - a).cross(c - a);
    cross != DVec3::ZERO && cross.is_finite()
}

fn box_of(geometry: &Geometry, triangle: u32) -> Aabb {
    let [a, b, c] = geometry.corners(triangle as usize).map(Vec3A::from);
    Aabb::new(a.min(b).min(c), a.max(b).max(c))
}

fn binary(geometry: &Geometry, solid: &[u32]) -> Binary {
    // Triangles with the same box share a leaf: obvhs's search takes quadratic time over equal ones.
    let key = |&i: &u32| {
        let aabb = box_of(geometry, i);
        [aabb.min.x, aabb.min.y, aabb.min.z, aabb.max.x, aabb.max.y, aabb.max.z].map(f32::to_bits)
    };
    let mut sorted: Vec<([u32; 6], u32)> = solid.iter().map(|i| (key(i), *i)).collect();
    sorted.sort_unstable();
    let mut runs: Vec<usize> =
        (0..sorted.len()).filter(|&i| i == 0 || sorted[i].0 != sorted[i - 1].0).collect();
    let boxes: Vec<Aabb> = runs.iter().map(|&i| box_of(geometry, sorted[i].1)).collect();
    runs.push(sorted.len());
    let sorted: Vec<u32> = sorted.iter().map(|(_, i)| *i).collect();
    let parameters = BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::medium_build() };
    let built = build_bvh2(&boxes, parameters, &mut Duration::default());
    drop(boxes);
    let (mut nodes, mut triangles) = (built.nodes, Vec::with_capacity(sorted.len()));
    for i in 0..nodes.len() {
        if !nodes[i].is_leaf() {
            continue;
        }
        let run = built.primitive_indices[nodes[i].first_index as usize] as usize;
        let first = triangles.len() as u32;
        triangles.extend_from_slice(&sorted[runs[run]..runs[run + 1]]);
        // More than a packet takes: halved until they fit.
        let mut to_halve = vec![(i, first, triangles.len() as u32)];
        while let Some((i, first, end)) = to_halve.pop() {
            let aabb = nodes[i].aabb;
            if end - first <= 8 {
                nodes[i] = Bvh2Node::new(aabb, end - first, first);
                continue;
            }
            let (middle, child) = (first + (end - first) / 2, nodes.len());
            nodes[i] = Bvh2Node::new(aabb, 0, child as u32);
            nodes.extend([Bvh2Node::new(aabb, 1, 0); 2]);
            to_halve.extend([(child, first, middle), (child + 1, middle, end)]);
        }
    }
    Binary { nodes, triangles }
}

/// The triangles in the order of `deep`'s leaves, under a hierarchy that halves their list down to single
/// ones.
fn balanced(geometry: &Geometry, deep: &Binary) -> Binary {
    let triangles = deep.triangles.clone();
    let mut nodes = vec![Bvh2Node::default()];
    let mut runs = Vec::from_iter(std::iter::once(0..triangles.len()));
    let mut next = 0;
    while next < nodes.len() {
        let run = runs[next].clone();
        if run.len() == 1 {
            nodes[next] = Bvh2Node::new(box_of(geometry, triangles[run.start]), 1, run.start as u32);
        } else {
            let middle = run.start + run.len() / 2;
            nodes[next].first_index = nodes.len() as u32;
            nodes.extend([Bvh2Node::default(); 2]);
            runs.extend([run.start..middle, middle..run.end]);
        }
        next += 1;
    }
    // Children stand after their parents: boxes from the back.
    for i in (0..nodes.len()).rev().filter(|&i| runs[i].len() > 1) {
        let first = nodes[i].first_index as usize;
        nodes[i].aabb = nodes[first].aabb.union(&nodes[first + 1].aabb);
    }
    Binary { nodes, triangles }
}

/// For each binary node the cheapest merge, by expected cost: the sum over wide nodes and packets of their
/// cost times the chance to be entered, which is their box's surface relative to the root's.
fn best_merges(nodes: &[Bvh2Node]) -> Vec<Merge> {
    let mut merges = vec![Merge::default(); nodes.len()];
    // Depth first; each finished node leaves (cost with 1..=7 places, triangles) on a stack of its own.
    let mut finished: Vec<([f32; 8], u32)> = Vec::new();
    let mut to_do = vec![(0, false)];
    while let Some((i, are_children_done)) = to_do.pop() {
        let node = &nodes[i];
        let area = node.aabb.half_area();
        if node.is_leaf() {
            merges[i].set(1, 1);
            finished.push(([area * PACKET_COST; 8], node.prim_count));
            continue;
        }
        let first = node.first_index as usize;
        if !are_children_done {
            to_do.extend([(i, true), (first + 1, false), (first, false)]);
            continue;
        }
        let (Some((b, count_b)), Some((a, count_a))) = (finished.pop(), finished.pop()) else {
            break; // (Not reached: both children have just been finished.)
        };
        let count = count_a + count_b;
        let cheapest_split = |places: usize| {
            (1..places)
                .map(|k| (a[k] + b[places - k], k))
                .min_by(|x, y| x.0.total_cmp(&y.0))
                .unwrap_or((f32::INFINITY, 1))
        };
        let mut cost = [0.0; 8];
        let (below, k) = cheapest_split(8);
        merges[i].set(0, k);
        cost[1] = below + area;
        if count <= 8 && area * PACKET_COST <= cost[1] {
            merges[i].set(1, 1);
            cost[1] = area * PACKET_COST;
        }
        for places in 2..8 {
            let (split, k) = cheapest_split(places);
            cost[places] = cost[places - 1];
            if split < cost[places] {
                cost[places] = split;
                merges[i].set(places, k);
            }
        }
        finished.push((cost, count));
    }
    merges
}

/// The binary nodes that become the children of the wide node made of `root`.
fn places(nodes: &[Bvh2Node], merges: &[Merge], root: usize, children: &mut Vec<usize>) {
    if nodes[root].is_leaf() {
        // Only the root of a single triangle.
        children.push(root);
        return;
    }
    let mut to_place = vec![(root, 8)];
    while let Some((i, mut places)) = to_place.pop() {
        let split = if places == 8 {
            merges[i].get(0)
        } else {
            while places > 1 && merges[i].get(places) == 0 {
                places -= 1;
            }
            if places == 1 {
                children.push(i);
                continue;
            }
            merges[i].get(places)
        };
        let first = nodes[i].first_index as usize;
        to_place.extend([(first + 1, places - split), (first, split)]);
    }
}

/// The triangles below a binary node, as a packet.
fn packet(geometry: &Geometry, binary: &Binary, root: usize) -> Packet {
    let mut packet = Packet { corners: [[[f32::NAN; 8]; 3]; 3], triangles: [u32::MAX; 8] };
    let mut lane = 0;
    let mut below = vec![root];
    while let Some(i) = below.pop() {
        let node = &binary.nodes[i];
        let first = node.first_index as usize;
        if !node.is_leaf() {
            below.extend([first + 1, first]);
            continue;
        }
        for &triangle in &binary.triangles[first..first + node.prim_count as usize] {
            let material = geometry.material_of[triangle as usize];
            let may_be_open = geometry.materials[material as usize].alpha_cutoff.is_some()
                || geometry.glass_of(material).is_some();
            packet.triangles[lane] = if may_be_open { triangle | CUT_OUT } else { triangle };
            for (c, corner) in geometry.corners(triangle as usize).iter().enumerate() {
                for k in 0..3 {
                    packet.corners[c][k][lane] = corner[k];
                }
            }
            lane += 1;
        }
    }
    packet
}

#[cfg(test)]
mod tests {
    use super::super::bvh8::Line;
    use super::*;

    #[test]
    fn the_balanced_hierarchy_gives_the_same_hits() {
        let mut g = Geometry::default();
        for i in 0..200u32 {
            let x = (i % 20) as f32;
            let y = (i / 20) as f32;
            g.positions.extend([
                Vec3::new(x, y, 0.0),
                Vec3::new(x + 0.9, y, 0.0),
                Vec3::new(x, y + 0.9, 0.0),
            ]);
            g.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        g.material_of = vec![0; 200];
        g.materials.push(crate::geometry::Material {
            albedo: Vec3::ONE,
            albedo_max: 1.0,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: true,
            emission: None,
        });
        let own = Bvh8::new(&g);
        let mut halved = own.clone();
        let all: Vec<u32> = (0..200).collect();
        assert!(halved.merge(&g, &balanced(&g, &binary(&g, &all))));
        for i in 0..200u32 {
            let target = Vec3::new((i % 20) as f32 + 0.2, (i / 20) as f32 + 0.2, 0.0);
            let origin = Vec3::new(7.0, 3.0, 5.0);
            let line = Line::new(origin, (target - origin).normalize()).unwrap();
            let hit = |bvh: &Bvh8| bvh.nearest(&line, u32::MAX, &|_, _| false);
            assert_eq!(hit(&own).map(|(t, _)| t), Some(i));
            assert_eq!(hit(&own), hit(&halved));
        }
    }
}
