//! Which triangles bound solids: closed surfaces that are seen from outside. What first meets the back of one
//! began inside it.
//!
//! Triangles are connected where they share an edge, its ends equal to the bit. Where two meet, once in each
//! direction, they belong together. Where more do (blocks that share an edge, duplicates, a sheet attached to
//! a block), surfaces that are closed there by themselves stay apart, and the others are taken together.

use super::Geometry;
use glam::Vec3;
use rayon::prelude::*;

/// Edges sorted at a time: 64 MiB.
const AT_A_TIME: usize = 1 << 22;

/// A bit per triangle.
#[derive(Clone, Debug, Default)]
pub struct Solids {
    bits: Vec<u64>,
}

/// A side of a triangle.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    /// The same for both directions: a hash of the ends. (Of 30 million edges two get the same by chance once
    /// in 40,000 scenes; then one that is open may count as closed.)
    key: u64,
    triangle: u32,
    is_forward: bool,
}

impl Solids {
    /// Finds the closed surfaces of one-sided triangles, no cut-outs and no glass, whose fronts look
    /// outwards. The memory taken meanwhile is 64 MiB and 18 bytes per triangle, more where edges of more
    /// than two triangles are the rule.
    pub fn new(geometry: &Geometry) -> Self {
        let triangles = geometry.triangles.len();
        let is_glass = |index: usize| geometry.glass_of(index as u32).is_some();
        let materials = geometry.materials.iter().enumerate();
        let may_bound: Vec<bool> =
            materials.map(|(i, m)| !m.two_sided && m.alpha_cutoff.is_none() && !is_glass(i)).collect();
        let may_bound = |triangle: usize| may_bound[geometry.material_of[triangle] as usize];
        let mut parts = Parts::new(triangles);
        // Triangles with an edge at which their part is not closed.
        let mut open = vec![false; triangles];
        // Edges of more than two triangles, or of two that are wound against each other, all of one key
        // together.
        let mut crowded: Vec<Edge> = Vec::new();
        let runs = (3 * triangles).div_ceil(AT_A_TIME) as u64;
        for run in 0..runs {
            let in_run = |edge: &Edge| edge.key % runs == run;
            let of_triangle = |triangle| edges_of(geometry, triangle).into_iter().flatten().filter(in_run);
            let bounding = (0..triangles).into_par_iter().filter(|&triangle| may_bound(triangle));
            let mut edges: Vec<Edge> = bounding.flat_map_iter(of_triangle).collect();
            edges.par_sort_unstable();
            for shared in edges.chunk_by(|a, b| a.key == b.key) {
                match shared {
                    [alone] => open[alone.triangle as usize] = true,
                    [a, b] if a.is_forward != b.is_forward => parts.join(a.triangle, b.triangle),
                    _ => crowded.extend(shared),
                }
            }
        }
        let mut together: Vec<[u32; 2]> = Vec::new();
        for shared in crowded.chunk_by(|a, b| a.key == b.key) {
            together.extend(unbalanced(shared, &mut parts).windows(2).map(|pair| [pair[0], pair[1]]));
        }
        together.iter().for_each(|&[a, b]| parts.join(a, b));
        for shared in crowded.chunk_by(|a, b| a.key == b.key) {
            unbalanced(shared, &mut parts).iter().for_each(|&part| open[part as usize] = true);
        }
        let part_of: Vec<u32> = (0..triangles as u32).map(|triangle| parts.find(triangle)).collect();
        for triangle in 0..triangles {
            if open[triangle] {
                open[part_of[triangle] as usize] = true;
            }
        }
        // Six times the volume, about a corner of the part: positive where fronts look outwards.
        let mut volume = vec![0.0f64; triangles];
        for (triangle, &part) in part_of.iter().enumerate() {
            if may_bound(triangle) && !open[part as usize] {
                let about = geometry.corners(part as usize)[0].as_dvec3();
                let [a, b, c] = geometry.corners(triangle).map(|corner| corner.as_dvec3() - about);
                volume[part as usize] += a.dot(b.cross(c));
            }
        }
        let bounds = |triangle: usize| may_bound(triangle) && volume[part_of[triangle] as usize] > 0.0;
        let word = |first: usize| {
            (first..triangles.min(first + 64)).fold(0, |w, t| w | u64::from(bounds(t)) << (t - first))
        };
        let bits: Vec<u64> = (0..triangles).step_by(64).map(word).collect();
        Solids { bits: if bits.iter().any(|w| *w != 0) { bits } else { Vec::new() } }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bits.is_empty()
    }

    /// Whether a triangle bounds a solid.
    pub fn bound_by(&self, triangle: u32) -> bool {
        self.bits.get(triangle as usize / 64).is_some_and(|word| word >> (triangle % 64) & 1 == 1)
    }
}

/// The sides of a triangle; none if two of its corners are the same.
fn edges_of(geometry: &Geometry, triangle: usize) -> Option<[Edge; 3]> {
    // (Adding zero makes −0 the same as 0.)
    let [a, b, c] =
        geometry.corners(triangle).map(|corner| (corner + Vec3::ZERO).to_array().map(f32::to_bits));
    let edge = |from: [u32; 3], to: [u32; 3]| {
        let [x, y] = if from < to { [from, to] } else { [to, from] };
        let words = [[x[0], x[1]], [x[2], y[0]], [y[1], y[2]]];
        let key = words.iter().fold(0, |hash, w| mixed(hash ^ (u64::from(w[0]) << 32 | u64::from(w[1]))));
        Edge { key, triangle: triangle as u32, is_forward: from < to }
    };
    (a != b && b != c && c != a).then(|| [edge(a, b), edge(b, c), edge(c, a)])
}

/// Mixes all bits into each (the finaliser of SplitMix64; Steele, Lea & Flood 2014).
fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

/// The parts, ascending, that run along an edge more often in one direction than in the other.
fn unbalanced(shared: &[Edge], parts: &mut Parts) -> Vec<u32> {
    let mut sides: Vec<(u32, i64)> =
        shared.iter().map(|e| (parts.find(e.triangle), if e.is_forward { 1 } else { -1 })).collect();
    sides.sort_unstable();
    let of_part = sides.chunk_by(|a, b| a.0 == b.0);
    of_part.filter(|sides| sides.iter().map(|s| s.1).sum::<i64>() != 0).map(|sides| sides[0].0).collect()
}

/// Triangles that belong together: a forest, the lowest of each part its root.
struct Parts {
    parent: Vec<u32>,
}

impl Parts {
    fn new(triangles: usize) -> Self {
        Parts { parent: (0..triangles as u32).collect() }
    }

    fn find(&mut self, mut triangle: u32) -> u32 {
        while self.parent[triangle as usize] != triangle {
            let above = self.parent[self.parent[triangle as usize] as usize];
            self.parent[triangle as usize] = above;
            triangle = above;
        }
        triangle
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Material;
    use glam::vec3;

    fn scene() -> Geometry {
        let material = |two_sided, alpha_cutoff| Material {
            albedo: Vec3::ONE,
            albedo_max: 1.0,
            alpha: 1.0,
            texture: None,
            alpha_cutoff,
            two_sided,
            emission: None,
        };
        let materials = vec![material(false, None), material(true, None), material(false, Some(0.5))];
        Geometry { materials, ..Geometry::default() }
    }

    /// Adds a quad of two triangles with corners of its own; its front sees them counter-clockwise.
    fn quad(g: &mut Geometry, corners: [Vec3; 4], material: u32) {
        let first = g.positions.len() as u32;
        g.positions.extend(corners);
        g.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        g.material_of.extend([material; 2]);
    }

    /// Adds the sides of a box that `which` picks, seen from outside.
    fn sides(g: &mut Geometry, low: Vec3, high: Vec3, which: &[usize], material: u32) {
        let size = high - low;
        for &side in which {
            let axis = side / 2;
            let edge = |a: usize| Vec3::AXES[a % 3] * size[a % 3];
            let (u, v) = (edge(axis + 1), edge(axis + 2));
            let (corner, u, v) = if side % 2 == 1 { (low + edge(axis), u, v) } else { (low, v, u) };
            quad(g, [corner, corner + u, corner + u + v, corner + v], material);
        }
    }

    const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

    fn block(g: &mut Geometry, low: Vec3, high: Vec3) {
        sides(g, low, high, &ALL, 0);
    }

    fn turn(g: &mut Geometry, from: usize) {
        g.triangles[from..].iter_mut().for_each(|t| t.swap(1, 2));
    }

    /// Which triangles bound a solid.
    fn found(g: &Geometry) -> Vec<bool> {
        let solids = Solids::new(g);
        let found: Vec<bool> = (0..g.triangles.len() as u32).map(|t| solids.bound_by(t)).collect();
        assert_eq!(solids.is_empty(), !found.contains(&true));
        found
    }

    #[test]
    fn a_block_is_a_solid_wherever_it_stands() {
        for at in [Vec3::ZERO, vec3(-0.5, -0.5, -0.5), Vec3::splat(5e4)] {
            let mut g = scene();
            block(&mut g, at, at + Vec3::ONE);
            assert_eq!(found(&g), [true; 12], "{at}");
        }
    }

    #[test]
    fn corners_at_minus_zero_are_corners_at_zero() {
        let mut g = scene();
        block(&mut g, Vec3::ZERO, Vec3::ONE);
        g.positions[..4].iter_mut().flat_map(|p| p.as_mut()).filter(|x| **x == 0.0).for_each(|x| *x = -0.0);
        assert_eq!(found(&g), [true; 12]);
    }

    #[test]
    fn an_open_block_is_none() {
        let mut g = scene();
        sides(&mut g, Vec3::ZERO, Vec3::ONE, &ALL[..5], 0);
        assert_eq!(found(&g), [false; 10]);
    }

    #[test]
    fn a_block_with_one_side_wound_the_other_way_is_none() {
        let mut g = scene();
        block(&mut g, Vec3::ZERO, Vec3::ONE);
        turn(&mut g, 10);
        assert_eq!(found(&g), [false; 12]);
    }

    #[test]
    fn a_room_is_none_and_the_house_around_it_is_one() {
        let mut g = scene();
        block(&mut g, Vec3::splat(1.0), Vec3::splat(2.0));
        turn(&mut g, 0);
        assert_eq!(found(&g), [false; 12]);
        block(&mut g, Vec3::ZERO, Vec3::splat(3.0));
        assert_eq!(found(&g), [[false; 12], [true; 12]].concat());
    }

    #[test]
    fn two_sided_and_cut_out_surfaces_bound_nothing() {
        for material in [1, 2] {
            let mut g = scene();
            sides(&mut g, Vec3::ZERO, Vec3::ONE, &ALL, material);
            assert_eq!(found(&g), [false; 12], "material {material}");
            // Nor a block of which one side is such a surface.
            let mut g = scene();
            sides(&mut g, Vec3::ZERO, Vec3::ONE, &ALL[..5], 0);
            sides(&mut g, Vec3::ZERO, Vec3::ONE, &ALL[5..], material);
            assert_eq!(found(&g), [false; 12], "material {material}");
        }
    }

    #[test]
    fn a_block_and_its_duplicate_are_solids() {
        let mut g = scene();
        block(&mut g, Vec3::ZERO, Vec3::ONE);
        block(&mut g, Vec3::ZERO, Vec3::ONE);
        assert_eq!(found(&g), [true; 24]);
    }

    #[test]
    fn blocks_that_share_an_edge_or_a_side_are_solids() {
        for second in [vec3(1.0, 1.0, 0.0), vec3(1.0, 0.0, 0.0)] {
            let mut g = scene();
            block(&mut g, Vec3::ZERO, Vec3::ONE);
            block(&mut g, second, second + Vec3::ONE);
            assert_eq!(found(&g), [true; 24], "{second}");
        }
    }

    #[test]
    fn a_block_stays_a_solid_beside_a_larger_room_that_shares_an_edge() {
        // The room's volume is −8: taken together, the block would not be one.
        let mut g = scene();
        block(&mut g, Vec3::ZERO, vec3(1.0, 1.0, 1.0));
        block(&mut g, vec3(1.0, 1.0, 0.0), vec3(9.0, 2.0, 1.0));
        turn(&mut g, 12);
        assert_eq!(found(&g), [[true; 12], [false; 12]].concat());
    }

    #[test]
    fn a_sheet_on_an_edge_of_a_block_leaves_it_a_solid() {
        let mut g = scene();
        block(&mut g, Vec3::ZERO, Vec3::ONE);
        quad(&mut g, [vec3(0.0, 1.0, 0.0), vec3(0.0, 1.0, 1.0), vec3(0.0, 2.0, 1.0), vec3(0.0, 2.0, 0.0)], 0);
        assert_eq!(found(&g), [&[true; 12][..], &[false; 2]].concat());
    }

    #[test]
    fn triangles_without_area_change_nothing() {
        let mut g = scene();
        block(&mut g, Vec3::ZERO, Vec3::ONE);
        g.triangles.push([0, 1, 1]);
        g.material_of.push(0);
        assert_eq!(found(&g)[..12], [true; 12]);
    }

    #[test]
    fn many_blocks_are_found_in_several_runs() {
        // More edges than are sorted at a time, and one block in the middle that is open.
        let n = AT_A_TIME / 36 + 10;
        let mut g = scene();
        for i in 0..n {
            let at = vec3((i % 1000) as f32 * 2.0, (i / 1000) as f32 * 2.0, 0.0);
            sides(&mut g, at, at + Vec3::ONE, if i == n / 2 { &ALL[..5] } else { &ALL }, 0);
        }
        let open = n / 2 * 12..n / 2 * 12 + 10;
        assert!(found(&g).iter().enumerate().all(|(t, solid)| *solid != open.contains(&t)));
    }
}
