//! Kernel file (holds `unsafe`): traversal of the hierarchy, written once over [`Lanes`].
//!
//! Soundness: node and packet numbers come from [`super::bvh8_build`] alone, which makes only such as exist
//! and refuses a hierarchy that could need more than [`STACK`] entries; entries are written before they are
//! read. A debug build checks. Everything is `inline(always)`, so that it is compiled for the features of the
//! function that calls it.

use super::bvh8::{Bvh8, CUT_OUT, LEAF, Line, Node, Packet, Reach, STACK};
use super::lanes::Lanes;
use super::triangle::TriangleHit;
use glam::Vec3;
use std::mem::MaybeUninit;

/// Children still to visit, each with the distance where the ray enters its box (bits of a float ≥ 0, which
/// order as integers) in the upper half.
struct Stack {
    entries: [MaybeUninit<u64>; STACK],
    len: usize,
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Stack { entries: [const { MaybeUninit::uninit() }; STACK], len: 0 }
    }

    #[inline(always)]
    fn push(&mut self, entry: u64) {
        debug_assert!(self.len < STACK);
        // SAFETY: the builder bounds the entries any traversal needs by STACK.
        unsafe { self.entries.get_unchecked_mut(self.len).write(entry) };
        self.len += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<u64> {
        self.len = self.len.checked_sub(1)?;
        // SAFETY: below `len` all entries were pushed.
        Some(unsafe { self.entries.get_unchecked(self.len).assume_init() })
    }

    /// Sorts the entries from `first` up, farthest first, by insertion: they are few.
    #[inline(always)]
    fn sort_from(&mut self, first: usize) {
        for i in first + 1..self.len {
            // SAFETY: all indices lie in first..len, and those were pushed.
            unsafe {
                let entry = self.entries.get_unchecked(i).assume_init();
                let mut j = i;
                while j > first && self.entries.get_unchecked(j - 1).assume_init() < entry {
                    *self.entries.get_unchecked_mut(j) = *self.entries.get_unchecked(j - 1);
                    j -= 1;
                }
                self.entries.get_unchecked_mut(j).write(entry);
            }
        }
    }
}

#[inline(always)]
fn splat<L: Lanes>(v: Vec3) -> [L; 3] {
    [L::splat(v.x), L::splat(v.y), L::splat(v.z)]
}

/// # Safety
/// `k` must be an index of `rows`.
#[inline(always)]
unsafe fn load<L: Lanes>(rows: &[[f32; 8]], k: usize) -> L {
    // SAFETY: promised by the caller.
    L::load(unsafe { rows.get_unchecked(k) })
}

/// A ray's numbers, one per lane.
struct Rays8<L> {
    origin: [L; 3],
    near: [L; 3],
    far: [L; 3],
}

impl<L: Lanes> Rays8<L> {
    #[inline(always)]
    fn new(line: &Line) -> Self {
        Rays8 { origin: splat(line.origin), near: splat(line.near), far: splat(line.far) }
    }

    /// Which children's boxes the ray meets before `t_max`, and where it enters them.
    #[inline(always)]
    fn boxes(&self, line: &Line, node: &Node, t_max: f32) -> (u32, L) {
        let [x, y, z] = line.enters;
        // SAFETY: `enters` holds zeros and ones.
        let [low_x, low_y, low_z, high_x, high_y, high_z]: [L; 6] = unsafe {
            let p = &node.planes;
            [load(p, x), load(p, 2 + y), load(p, 4 + z), load(p, 1 - x), load(p, 3 - y), load(p, 5 - z)]
        };
        // The operand that may be NaN comes first: min and max then return the other.
        let mut enter = low_x.sub(self.origin[0]).mul(self.near[0]).max(L::splat(0.0));
        enter = low_y.sub(self.origin[1]).mul(self.near[1]).max(enter);
        enter = low_z.sub(self.origin[2]).mul(self.near[2]).max(enter);
        let mut leave = high_x.sub(self.origin[0]).mul(self.far[0]).min(L::splat(t_max));
        leave = high_y.sub(self.origin[1]).mul(self.far[1]).min(leave);
        leave = high_z.sub(self.origin[2]).mul(self.far[2]).min(leave);
        (enter.less_or_equal(leave), enter)
    }
}

/// A ray's numbers for the triangle test, one per lane.
struct Shear8<L> {
    origin: [L; 3],
    shear: [L; 2],
    axes: [usize; 3],
}

impl<L: Lanes> Shear8<L> {
    #[inline(always)]
    fn new(line: &Line) -> Self {
        let [kx, ky, kz] = line.exact.axes;
        let o = line.origin;
        Shear8 {
            origin: [L::splat(o[kx]), L::splat(o[ky]), L::splat(o[kz])],
            shear: [L::splat(line.shear[0]), L::splat(line.shear[1])],
            axes: line.exact.axes,
        }
    }

    /// A corner relative to the origin, sheared so that the ray runs along +z.
    #[inline(always)]
    fn corner(&self, corner: &[[f32; 8]; 3]) -> (L, L, L) {
        // SAFETY: `axes` holds the numbers 0, 1, 2.
        let [x, y, z]: [L; 3] =
            unsafe { [load(corner, self.axes[0]), load(corner, self.axes[1]), load(corner, self.axes[2])] };
        let z = z.sub(self.origin[2]);
        let x = x.sub(self.origin[0]).sub(self.shear[0].mul(z));
        let y = y.sub(self.origin[1]).sub(self.shear[1].mul(z));
        (x, y, z)
    }
}

/// The lanes of a packet whose triangle the ray's line may cross: all but those that [`super::triangle`] is
/// sure to refuse.
#[inline(always)]
fn crossed<L: Lanes>(line: &Line, packet: &Packet) -> u32 {
    let shear = Shear8::<L>::new(line);
    let (ax, ay, az) = shear.corner(&packet.corners[0]);
    let (bx, by, bz) = shear.corner(&packet.corners[1]);
    let (cx, cy, cz) = shear.corner(&packet.corners[2]);
    // Signed areas of the edges seen from the ray.
    let u = cx.mul(by).sub(cy.mul(bx));
    let v = ax.mul(cy).sub(ay.mul(cx));
    let w = bx.mul(ay).sub(by.mul(ax));
    // Their error. With ε = 2⁻²⁴, Z the largest |z| and S the sum of all |x| and |y|: a sheared coordinate p
    // is off by at most ε (|p − sₓz| + 4|sₓz| + |p|) ≤ ε (5 Z + 2 S), as |sₓ| ≤ 1; an edge function by S
    // times that, and by ε S² / 2 of its own roundings. Rounded up to 8 and 4, which also covers the
    // roundings of the bound and of the test in doubles.
    const EPSILON: f32 = 0.5 * f32::EPSILON;
    let size = ax.abs().add(ay.abs()).add(bx.abs().add(by.abs())).add(cx.abs().add(cy.abs()));
    let depth = az.abs().max(bz.abs()).max(cz.abs());
    let error = size.mul(depth.mul(L::splat(8.0 * EPSILON)).add(size.mul(L::splat(4.0 * EPSILON))));
    // Unless one area is surely negative and another surely positive. (Never in empty lanes, where all is
    // NaN.)
    let none_negative = L::splat(0.0).sub(error).less_or_equal(u.min(v).min(w));
    let none_positive = u.max(v).max(w).less_or_equal(error);
    none_negative | none_positive
}

/// The stack's entry for a child.
///
/// # Safety
/// `lane` must be less than 8.
#[inline(always)]
unsafe fn queued(node: &Node, enter: &[f32; 8], lane: usize) -> u64 {
    // SAFETY: promised by the caller.
    let (enter, child) = unsafe { (*enter.get_unchecked(lane), *node.children.get_unchecked(lane)) };
    u64::from(enter.to_bits()) << 32 | u64::from(child)
}

#[inline(always)]
fn corners(packet: &Packet, lane: usize) -> [Vec3; 3] {
    // SAFETY: lanes are bit numbers of a mask of eight.
    let corner = |c: &[[f32; 8]; 3]| unsafe {
        Vec3::new(*c[0].get_unchecked(lane), *c[1].get_unchecked(lane), *c[2].get_unchecked(lane))
    };
    [corner(&packet.corners[0]), corner(&packet.corners[1]), corner(&packet.corners[2])]
}

/// The nearest hit with t > 0; of equally near triangles the one with the lowest index.
#[inline(always)]
pub(super) fn nearest<L: Lanes>(
    bvh: &Bvh8,
    line: &Line,
    from: u32,
    is_open: &dyn Fn(u32, &TriangleHit) -> bool,
) -> Option<(u32, TriangleHit)> {
    let rays = Rays8::<L>::new(line);
    let mut best: Option<(u32, TriangleHit)> = None;
    let mut t_max = f32::INFINITY;
    let mut stack = Stack::new();
    if !bvh.nodes.is_empty() {
        stack.push(0);
    }
    while let Some(entry) = stack.pop() {
        if f32::from_bits((entry >> 32) as u32) > t_max {
            continue;
        }
        let mut child = entry as u32;
        // Down to a leaf, always to the nearest child.
        while child & LEAF == 0 {
            debug_assert!((child as usize) < bvh.nodes.len());
            // SAFETY: the builder's numbers exist.
            let node = unsafe { bvh.nodes.get_unchecked(child as usize) };
            let (mut hits, enter) = rays.boxes(line, node, t_max);
            if hits == 0 {
                break;
            }
            let lane = hits.trailing_zeros() as usize;
            hits &= hits - 1;
            // SAFETY: lanes are bit numbers of a mask of eight.
            child = unsafe { *node.children.get_unchecked(lane) };
            if hits == 0 {
                continue;
            }
            let enter = enter.store();
            // SAFETY: as above.
            let first = unsafe { queued(node, &enter, lane) };
            let lane = hits.trailing_zeros() as usize;
            hits &= hits - 1;
            // SAFETY: as above.
            let second = unsafe { queued(node, &enter, lane) };
            if hits == 0 {
                stack.push(first.max(second));
                child = first.min(second) as u32;
                continue;
            }
            let bottom = stack.len;
            stack.push(first);
            stack.push(second);
            while hits != 0 {
                // SAFETY: as above.
                stack.push(unsafe { queued(node, &enter, hits.trailing_zeros() as usize) });
                hits &= hits - 1;
            }
            stack.sort_from(bottom);
            child = stack.pop().unwrap_or_default() as u32;
        }
        if child & LEAF == 0 {
            continue;
        }
        // SAFETY: the builder's numbers exist.
        let packet = unsafe { bvh.packets.get_unchecked((child & !LEAF) as usize) };
        let mut lanes = crossed::<L>(line, packet);
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            // SAFETY: as above.
            let marked = unsafe { *packet.triangles.get_unchecked(lane) };
            let triangle = marked & !CUT_OUT;
            if triangle == from {
                continue;
            }
            let Some(triangle_hit) = line.exact.intersect(&corners(packet, lane), f64::INFINITY) else {
                continue;
            };
            let is_nearer = best.as_ref().is_none_or(|(other, at)| {
                triangle_hit.t < at.t || triangle_hit.t == at.t && triangle < *other
            });
            if is_nearer && (marked & CUT_OUT == 0 || !is_open(triangle, &triangle_hit)) {
                best = Some((triangle, triangle_hit));
                t_max = triangle_hit.t as f32;
            }
        }
    }
    best
}

/// Whether a triangle of the packet is hit with 0 < t < `reach.t_max`.
#[inline(always)]
fn is_blocked_by<L: Lanes>(
    packet: &Packet,
    line: &Line,
    reach: Reach,
    from: u32,
    is_open: &dyn Fn(u32, &TriangleHit) -> bool,
) -> bool {
    let mut lanes = crossed::<L>(line, packet);
    while lanes != 0 {
        let lane = lanes.trailing_zeros() as usize;
        lanes &= lanes - 1;
        // SAFETY: lanes are bit numbers of a mask of eight.
        let marked = unsafe { *packet.triangles.get_unchecked(lane) };
        let triangle = marked & !CUT_OUT;
        if triangle == from {
            continue;
        }
        if let Some(triangle_hit) = line.exact.intersect(&corners(packet, lane), f64::from(reach.t_max))
            && (marked & CUT_OUT == 0 && triangle_hit.t < f64::from(reach.ask_from)
                || !is_open(triangle, &triangle_hit))
        {
            return true;
        }
    }
    false
}

/// Whether there is any hit with 0 < t < `reach.t_max`.
#[inline(always)]
pub(super) fn occluded<L: Lanes>(
    bvh: &Bvh8,
    line: &Line,
    reach: Reach,
    from: u32,
    is_open: &dyn Fn(u32, &TriangleHit) -> bool,
) -> bool {
    let rays = Rays8::<L>::new(line);
    let mut stack = Stack::new();
    if !bvh.nodes.is_empty() {
        stack.push(0);
    }
    while let Some(entry) = stack.pop() {
        let child = entry as u32;
        if child & LEAF != 0 {
            // SAFETY: the builder's numbers exist.
            let packet = unsafe { bvh.packets.get_unchecked((child & !LEAF) as usize) };
            if is_blocked_by::<L>(packet, line, reach, from, is_open) {
                return true;
            }
            continue;
        }
        // SAFETY: the builder's numbers exist.
        let node = unsafe { bvh.nodes.get_unchecked(child as usize) };
        let (mut hits, _) = rays.boxes(line, node, reach.t_max);
        while hits != 0 {
            // SAFETY: as above.
            stack.push(u64::from(unsafe { *node.children.get_unchecked(hits.trailing_zeros() as usize) }));
            hits &= hits - 1;
        }
    }
    false
}
