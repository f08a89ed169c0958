//! Which points of texels are their surface: outside solids, and on the side of a wall that the texel stands
//! for.
//!
//! Most texels lie in the open: nothing stands on them, and they are outside all bodies. That is found out
//! for squares of texels at once. Where nothing stands on a flat square
//! ([`crate::trace::solids::Space::is_clear`]), all of its points reach each other, and all lie in the same
//! closed solids, because the surface of a solid would have to pass between them. Then the point in the
//! middle tells whether they lie in a solid, and that one and the corners whether they lie in a body that is
//! open a little. Other squares are cut in four, down to single texels, whose points are asked one by one.

use super::block::Worker;
use crate::bake::store::{ALL_POINTS, BlockState, POINTS, is_enough};
use crate::receivers::ReceiverBlock;
use crate::surface::BLOCK;
use crate::trace::counts::{RayCounts, sum};
use crate::trace::solids::{Receiver, SurfaceAxes, SurroundingHits};
use glam::Vec3;
use rayon::prelude::*;

/// A point of a texel: the bit of one of its 16, none of others.
type Point = (u16, Receiver);

/// Side of the largest squares that are looked at as a whole, in texels; a power of two.
const SQUARE: usize = 16;

/// The height above a square, as a part of its longer side, up to which nothing may stand on it. Under a body
/// that hangs higher, rays close to the surface meet it only where the body is wider than the square: then a
/// corner of the square tells.
const HEADROOM: f32 = 0.5;

/// What is known of the texels of a square of the block.
struct Square {
    /// Covered texels and the points of each.
    texels: Vec<(usize, Vec<Point>)>,
    /// The points of each that are its surface, one bit each.
    bits: Vec<u16>,
    counts: RayCounts,
}

impl Worker<'_> {
    /// Finds out which points of the texels are their surface, if that is not known.
    pub fn find_points(&self, receivers: &ReceiverBlock, state: &mut BlockState) -> RayCounts {
        if !state.points.is_empty() {
            return RayCounts::default();
        }
        let across = receivers.width.div_ceil(SQUARE);
        let squares: Vec<Square> = (0..across * receivers.height.div_ceil(SQUARE))
            .into_par_iter()
            .map(|i| self.settle_square(receivers, [i % across * SQUARE, i / across * SQUARE]))
            .collect();
        let mut bits = vec![0; BLOCK * BLOCK];
        for square in &squares {
            square.texels.iter().zip(&square.bits).for_each(|((texel, _), points)| bits[*texel] = *points);
        }
        state.points = receivers.covered().map(|texel| bits[texel]).collect();
        sum(squares.into_iter().map(|square| square.counts))
    }

    /// Finds the points of the texels of one of the largest squares of a block.
    fn settle_square(&self, receivers: &ReceiverBlock, corner: [usize; 2]) -> Square {
        let texels = square(receivers, corner, SQUARE).map(|texel| (texel, self.points(receivers, texel)));
        let texels: Vec<(usize, Vec<Point>)> = texels.collect();
        let bits = vec![0; texels.len()];
        let mut known = Square { texels, bits, counts: RayCounts::default() };
        self.settle(receivers, corner, SQUARE, &mut known);
        known
    }

    /// Finds those of the texels of a square of this side: at once if it lies in the open, else quarter by
    /// quarter.
    fn settle(&self, receivers: &ReceiverBlock, corner: [usize; 2], side: usize, known: &mut Square) {
        let index = |texel: usize| known.texels.binary_search_by_key(&texel, |known| known.0);
        let inside: Vec<usize> =
            square(receivers, corner, side).filter_map(|texel| index(texel).ok()).collect();
        let Some(&first) = inside.first() else { return };
        if side == 1 {
            let points = std::mem::take(&mut known.texels[first].1);
            known.bits[first] =
                self.bits_of_texel(receivers, known.texels[first].0, points, &mut known.counts);
            return;
        }
        let along = receivers.along(self.transport.space.geometry, known.texels[first].0);
        let of_all = || inside.iter().flat_map(|&i| &known.texels[i].1).map(|(_, at)| at);
        if self.is_in_the_open(of_all, along, &mut known.counts) {
            inside.iter().for_each(|&i| known.bits[i] = bits_of(&known.texels[i].1));
            return;
        }
        let half = side / 2;
        for [x, y] in [[0, 0], [half, 0], [0, half], [half, half]] {
            self.settle(receivers, [corner[0] + x, corner[1] + y], half, known);
        }
    }

    /// Whether points lie on a flat surface on which nothing stands, outside all bodies. `along` is a
    /// direction on the surface.
    fn is_in_the_open<'p, I: Iterator<Item = &'p Receiver>>(
        &self,
        points: impl Fn() -> I,
        along: Vec3,
        counts: &mut RayCounts,
    ) -> bool {
        let space = &self.transport.space;
        let Some(surface_axes) = points().next().and_then(|first| SurfaceAxes::new(first, along)) else {
            return false;
        };
        if !space.is_clear(&surface_axes, points(), HEADROOM) {
            return false;
        }
        // The outermost points in four directions, and the middle one.
        let mut outermost: [Option<(&Receiver, f64)>; 4] = [None; 4];
        for point in points() {
            let at = surface_axes.coordinates_of(point);
            for (k, outermost) in outermost.iter_mut().enumerate() {
                let reach = if k & 1 == 0 { at.x } else { -at.x } + if k & 2 == 0 { at.y } else { -at.y };
                if outermost.is_none_or(|(_, farthest)| reach > farthest) {
                    *outermost = Some((point, reach));
                }
            }
        }
        let middle = points().nth(points().count() / 2);
        let mut known_hits = SurroundingHits::default();
        let is_inside = middle.is_none_or(|middle| {
            space.is_in_solid(middle, &mut known_hits, counts)
                || space.is_enclosed(middle, &mut known_hits, counts)
        });
        let corners = outermost.into_iter().flatten();
        !is_inside
            && !corners
                .into_iter()
                .any(|(at, _)| space.is_enclosed(at, &mut SurroundingHits::default(), counts))
    }

    /// Which of a texel's 16 points are its surface, one bit each: those outside solids, and where a wall
    /// stands on the texel, only the largest group of those that reach each other. No texel mixes the light
    /// of two rooms.
    pub fn surface_points(&self, receivers: &ReceiverBlock, texel: usize, counts: &mut RayCounts) -> u16 {
        self.bits_of_texel(receivers, texel, self.points(receivers, texel), counts)
    }

    /// The points of a texel that tell which of them are its surface.
    fn points(&self, receivers: &ReceiverBlock, texel: usize) -> Vec<Point> {
        let point = |i| Some((1u16 << i, self.point(receivers, texel, i)?));
        let mut points: Vec<Point> = (0..POINTS).filter_map(point).collect();
        // A wall that divides the texel stands between one of these points and another, or a corner.
        points.extend(receivers.rim(&self.transport.space, texel).into_iter().map(|at| (0, at)));
        points
    }

    /// [`Worker::surface_points`] of a texel with these points.
    fn bits_of_texel(
        &self,
        receivers: &ReceiverBlock,
        texel: usize,
        points: Vec<Point>,
        counts: &mut RayCounts,
    ) -> u16 {
        let space = &self.transport.space;
        let along = receivers.along(space.geometry, texel);
        let surface_axes = points.first().and_then(|(_, first)| SurfaceAxes::new(first, along));
        let is_clear = surface_axes
            .is_some_and(|surface_axes| space.is_clear(&surface_axes, points.iter().map(|(_, at)| at), 0.0));
        let groups = if is_clear { vec![points] } else { self.groups(points, counts) };
        self.bits_of_groups(groups, counts)
    }

    /// [`Worker::surface_points`] of a texel whose points reach each other in these groups.
    fn bits_of_groups(&self, groups: Vec<Vec<Point>>, counts: &mut RayCounts) -> u16 {
        let (groups, buried) = self.in_the_open(groups, counts);
        let all = groups.iter().fold(0, |bits, group| bits | bits_of(group));
        let Some((largest, beyond)) = self.largest(groups, counts) else { return 0 };
        let beyond = beyond.or(buried);
        let bits = bits_of(&largest);
        // Many small pieces, as under a grating or in grass, are no two rooms.
        if 4 * bits.count_ones() < all.count_ones() {
            return all;
        }
        // All 16 points may lie on one side of a wall, and a corner on the other or in the wall: the
        // point next to it is given up, so that samples keep to where the others are.
        match beyond {
            Some(beyond) if bits == ALL_POINTS => {
                let away = |(_, at): &&Point| at.distance_squared(&beyond.1);
                let numbered = largest.iter().filter(|(bit, _)| *bit != 0);
                let next = numbered.min_by(|a, b| away(a).total_cmp(&away(b)));
                bits & !next.map_or(0, |(bit, _)| *bit)
            }
            _ => bits,
        }
    }

    /// Leaves out of a texel's groups what lies in solids, even if they are open a little. Gives also one of
    /// the points left out, if there are any.
    fn in_the_open(
        &self,
        mut groups: Vec<Vec<Point>>,
        counts: &mut RayCounts,
    ) -> (Vec<Vec<Point>>, Option<Point>) {
        let is_whole = groups.len() == 1;
        let space = &self.transport.space;
        let mut buried = None;
        let mut keep_if = |is_open: bool, point: &Point| {
            buried = buried.or((!is_open).then_some(*point));
            is_open
        };
        for group in &mut groups {
            let mut known_hits = vec![SurroundingHits::default(); group.len()];
            // All of a group lie in the same closed solids, or else the surface passes through itself.
            if space.is_in_solid(&group[0].1, &mut known_hits[0], counts) {
                group.retain(|point| {
                    keep_if(!space.is_in_solid(&point.1, &mut SurroundingHits::default(), counts), point)
                });
                known_hits = vec![SurroundingHits::default(); group.len()];
            }
            // What lies in a body that is open a little is divided from what does not, unless the body ends
            // above the surface: of a whole texel, the first points tell (of a (0, 2)-sequence four lie one
            // in each quarter).
            let mut is_enclosed = |k: usize, at: &Receiver| space.is_enclosed(at, &mut known_hits[k], counts);
            if !is_whole || (0..group.len().min(4)).any(|k| is_enclosed(k, &group[k].1)) {
                let mut k = 0..;
                group.retain(|point| keep_if(!k.next().is_some_and(|k| is_enclosed(k, &point.1)), point));
            }
        }
        groups.retain(|group| !group.is_empty());
        (groups, buried)
    }

    /// The largest group, and a point of another if there is one. What lies under open ground is the lesser
    /// side, however large.
    fn largest(
        &self,
        mut groups: Vec<Vec<Point>>,
        counts: &mut RayCounts,
    ) -> Option<(Vec<Point>, Option<Point>)> {
        let is_one = groups.len() == 1;
        let points = |group: &[Point]| bits_of(group).count_ones();
        let size_of = |open: u32, points: u32| (if is_enough(open) { open } else { 0 }, points);
        // From the group of most points on, so that the others need not be asked: none has more in the open
        // than it has points.
        let mut order: Vec<usize> = (0..groups.len()).collect();
        order.sort_by_key(|&i| std::cmp::Reverse(points(&groups[i])));
        let mut best: Option<((u32, u32), usize)> = None;
        for i in order {
            let points = points(&groups[i]);
            let is_beaten = |size| best.is_some_and(|best| best.0 > size || best.0 == size && best.1 < i);
            if is_beaten(size_of(points, points)) {
                continue;
            }
            let mut is_buried =
                |(bit, at): &&Point| *bit != 0 && self.transport.space.is_under_ground(at, counts);
            let buried = if is_one { 0 } else { groups[i].iter().filter(|at| is_buried(at)).count() as u32 };
            let size = size_of(points - buried, points);
            if !is_beaten(size) {
                best = Some((size, i));
            }
        }
        let largest = best?.1;
        let largest = groups.swap_remove(largest);
        Some((largest, groups.first().map(|beyond| beyond[0])))
    }

    /// Sorts points of a texel into groups that reach each other.
    fn groups(&self, mut left: Vec<Point>, counts: &mut RayCounts) -> Vec<Vec<Point>> {
        let mut groups = Vec::new();
        while !left.is_empty() {
            // All that is reached from the first, or from what is reached.
            let mut group = vec![left.remove(0)];
            let mut asked = 0;
            while asked < group.len() && !left.is_empty() {
                let from = group[asked].1;
                left.retain(|point| {
                    let reached = self.transport.space.reaches(&from, &point.1, counts);
                    group.extend(reached.then_some(*point));
                    !reached
                });
                asked += 1;
            }
            groups.push(group);
        }
        groups
    }
}

/// The covered texels of a square of a block, ascending.
fn square<'s>(
    receivers: &'s ReceiverBlock<'_>,
    [x0, y0]: [usize; 2],
    side: usize,
) -> impl Iterator<Item = usize> + 's {
    let (columns, rows) = (x0..(x0 + side).min(receivers.width), y0..(y0 + side).min(receivers.height));
    let all = rows.flat_map(move |y| columns.clone().map(move |x| y * receivers.width + x));
    all.filter(|&texel| receivers.is_covered(texel))
}

/// The numbered ones among some points of a texel, one bit each.
fn bits_of(points: &[Point]) -> u16 {
    points.iter().fold(0, |bits, (bit, _)| bits | bit)
}

#[cfg(test)]
#[path = "point_tests.rs"]
mod tests;
