//! Which triangles are near: those whose boxes meet a box.

use super::bvh8::{Bvh8, CUT_OUT, LEAF, Node, Packet, STACK};
use glam::Vec3;

impl Bvh8 {
    /// Whether `stands` holds for a triangle (its index and corners) whose box meets the one from `low` to
    /// `high`.
    pub fn any_in_box(&self, low: Vec3, high: Vec3, mut stands: impl FnMut(u32, [Vec3; 3]) -> bool) -> bool {
        let mut stack = [0u32; STACK];
        let mut len = usize::from(!self.nodes.is_empty());
        while len > 0 {
            len -= 1;
            let child = stack[len];
            if child & LEAF != 0 {
                let packet = &self.packets[(child & !LEAF) as usize];
                let mut lanes = met_in_packet(packet, low, high);
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize;
                    lanes &= lanes - 1;
                    let corner = |c: usize| Vec3::from_array([0, 1, 2].map(|k| packet.corners[c][k][lane]));
                    if stands(packet.triangles[lane] & !CUT_OUT, [corner(0), corner(1), corner(2)]) {
                        return true;
                    }
                }
                continue;
            }
            let node = &self.nodes[child as usize];
            let mut lanes = met(node, low, high);
            while lanes != 0 {
                stack[len] = node.children[lanes.trailing_zeros() as usize];
                len += 1;
                lanes &= lanes - 1;
            }
        }
        false
    }
}

/// The children whose boxes meet a box, one bit each. (Where there is no child, low is ∞.)
fn met(node: &Node, low: Vec3, high: Vec3) -> u32 {
    let mut lanes = [true; 8];
    for k in 0..3 {
        let (lows, highs) = (&node.planes[2 * k], &node.planes[2 * k + 1]);
        for (lane, met) in lanes.iter_mut().enumerate() {
            *met &= (lows[lane] <= high[k]) & (highs[lane] >= low[k]);
        }
    }
    bits(lanes)
}

/// The same of a packet's triangles. (Empty lanes hold NaN.)
fn met_in_packet(packet: &Packet, low: Vec3, high: Vec3) -> u32 {
    let mut lanes = [true; 8];
    for k in 0..3 {
        let [a, b, c] = [0, 1, 2].map(|corner| &packet.corners[corner][k]);
        for (lane, met) in lanes.iter_mut().enumerate() {
            let least = a[lane].min(b[lane]).min(c[lane]);
            let most = a[lane].max(b[lane]).max(c[lane]);
            *met &= (least <= high[k]) & (most >= low[k]);
        }
    }
    bits(lanes)
}

fn bits(lanes: [bool; 8]) -> u32 {
    lanes.iter().enumerate().fold(0, |bits, (lane, met)| bits | u32::from(*met) << lane)
}

#[cfg(test)]
mod tests {
    use super::super::bvh8::Bvh8;
    use crate::geometry::{Geometry, Material};
    use glam::Vec3;

    #[test]
    fn what_meets_a_box_is_what_a_search_through_all_triangles_finds() {
        // Triangles of all sizes about a lattice.
        let mut g = Geometry::default();
        for i in 0..600u32 {
            let at = Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32);
            let size = 0.1 * 1.5f32.powi((i % 11) as i32);
            let turned = |k: u32| {
                Vec3::new(((i * 7 + k * 3) as f32).sin(), ((i + k) as f32).cos(), (k as f32 + 0.3).sin())
            };
            g.positions.extend([at, at + size * turned(1), at + size * turned(2)]);
            g.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        g.material_of = vec![0; 600];
        g.materials.push(Material {
            albedo: Vec3::ONE,
            albedo_max: 1.0,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: Some(0.5),
            two_sided: true,
            emission: None,
        });
        let bvh = Bvh8::new(&g);
        let mut met = 0;
        for i in 0..300 {
            let low = Vec3::new((i % 13) as f32 - 1.0, (i % 11) as f32 - 0.5, (i % 7) as f32 - 0.7);
            let high = low + Vec3::new(0.1, 0.3, 0.7) * (1.0 + (i % 5) as f32);
            let meets = |t: &u32| {
                let [a, b, c] = g.corners(*t as usize);
                a.min(b).min(c).cmple(high).all() && a.max(b).max(c).cmpge(low).all()
            };
            let expected: Vec<u32> = (0..600).filter(meets).collect();
            let mut found = Vec::new();
            let none = bvh.any_in_box(low, high, |triangle, corners| {
                assert_eq!(corners, g.corners(triangle as usize));
                found.push(triangle);
                false
            });
            found.sort_unstable();
            assert_eq!((none, &found), (false, &expected), "{low} {high}");
            assert_eq!(bvh.any_in_box(low, high, |_, _| true), !expected.is_empty());
            met += expected.len();
        }
        assert!(met > 1000, "{met}");
        assert!(!Bvh8::new(&Geometry::default()).any_in_box(Vec3::MIN, Vec3::MAX, |_, _| true));
    }
}
