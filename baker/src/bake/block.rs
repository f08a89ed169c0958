//! What works on blocks of texels: the points of a texel that are its surface. (What light they get: `direct`, `indirect`.)

use super::state::{ALL_PROBES, BlockState, PROBES, is_enough};
use crate::atlas::Atlas;
use crate::surface::{BlockSurface, FaceBins, SurfacePoint};
use crate::trace::counts::RayCounts;
use crate::trace::sampler::{Kind, Sample, Sequence};
use crate::trace::space::Receiver;
use crate::trace::walk::{Transport, point_pair};
use glam::Vec2;
use rayon::prelude::*;

/// A point of a texel: the bit of a probed one, none of others.
type Point = (u16, Receiver);

/// What a sequence of random numbers is for. Each comes in two halves, scrambled independently.
#[derive(Clone, Copy, Debug)]
pub enum Stream {
    /// Indirect light.
    Indirect = 0,
    /// Direct light.
    Direct = 2,
    /// Points probed for being the texel's surface.
    Probe = 4,
    /// The walks the cache is solved on.
    Pilot = 6,
    /// The reference texels are checked against.
    Check = 8,
    /// What bright surfaces are seen.
    View = 10,
    /// Direct light that only decides how many samples it gets.
    Trial = 12,
}

/// What blocks are worked on with.
pub struct Worker<'a> {
    /// Light and geometry.
    pub transport: Transport<'a>,
    /// Where texels lie.
    pub atlas: &'a Atlas,
    /// The faces of each block.
    pub bins: &'a FaceBins,
    /// Seed of all randomness.
    pub seed: u64,
}

impl Worker<'_> {
    /// The blocks that hold surface.
    pub fn blocks(&self) -> Vec<usize> {
        self.bins.occupied()
    }

    /// The surface of a block.
    pub fn surface(&self, block: usize) -> BlockSurface {
        BlockSurface::new(self.atlas, self.bins, block)
    }

    /// A texel's samples for one purpose and half. `texel` counts within the block, row by row.
    pub fn sequence(&self, surface: &BlockSurface, texel: usize, stream: Stream, half: usize) -> Sequence {
        let index = surface.page_index(self.atlas, texel);
        Sequence::new(self.seed, Kind::Texel, index as u32, stream as u32 + half as u32)
    }

    /// The point of a sample. Where only some of the texel's probed points are its surface (`probes` says which), it lies
    /// around one of those: in the sixteenth of the texel that the probed point stands for, as far as it is seen from there.
    pub fn receiver(
        &self,
        surface: &BlockSurface,
        texel: usize,
        sample: Sample,
        probes: u16,
        counts: &mut RayCounts,
    ) -> Option<Receiver> {
        if probes == ALL_PROBES {
            return self.any_point(surface, texel, sample);
        }
        // The k-th set bit; what is left of the number chooses the place around it.
        let u = point_pair(sample);
        let k = u.x * probes.count_ones() as f32;
        let probe = indices(probes).nth(k as usize)?;
        let probed = Self::probed(probe);
        // (The 16 points of a (0, 2)-sequence lie one in each square of a 4 × 4 grid.)
        let square = (probed * 4.0).floor();
        let around = ((square + Vec2::new(k.fract(), u.y)) / 4.0).min(Vec2::splat(1.0 - f32::EPSILON));
        let known = self.transport.space.receiver(&surface.sample(self.atlas, texel, probed))?;
        let at = self.transport.space.receiver(&surface.sample(self.atlas, texel, around));
        Some(at.filter(|at| self.transport.space.sees(&known, at, counts)).unwrap_or(known))
    }

    /// The point of a sample, be it inside a solid.
    pub fn any_point(&self, surface: &BlockSurface, texel: usize, sample: Sample) -> Option<Receiver> {
        self.transport.space.receiver(&surface.sample(self.atlas, texel, point_pair(sample)))
    }

    /// Which probed points of a texel are its surface, one bit each: those outside solids, and where a wall stands on the texel, only
    /// the largest group of those that reach each other. No texel mixes the light of two rooms.
    pub fn surface_probes(&self, surface: &BlockSurface, texel: usize, counts: &mut RayCounts) -> u16 {
        let probe =
            |i| Some((1u16 << i, self.transport.space.receiver(&self.probe_point(surface, texel, i))?));
        let mut points: Vec<Point> = (0..PROBES).filter_map(probe).collect();
        // A wall that divides the texel stands between one of these points and another, or a corner.
        let rim = surface.rim(self.atlas, texel).into_iter();
        points.extend(rim.filter_map(|at| Some((0, self.transport.space.receiver(&at)?))));
        let (groups, buried) = self.in_the_open(self.groups(points, counts), counts);
        let all = groups.iter().fold(0, |bits, group| bits | bits_of(group));
        let Some((largest, beyond)) = self.largest(groups, counts) else { return 0 };
        let beyond = beyond.or(buried);
        let probes = bits_of(&largest);
        // Many small pieces, as under a grating or in grass, are no two rooms.
        if 4 * probes.count_ones() < all.count_ones() {
            return all;
        }
        // All probed points may lie on one side of a wall, and a corner on the other or in the wall: the point next to it is given up,
        // so that samples keep to where the others are.
        match beyond {
            Some(beyond) if probes == ALL_PROBES => {
                let away = |(_, at): &&Point| at.distance_squared(&beyond.1);
                let probed = largest.iter().filter(|(bit, _)| *bit != 0);
                let next = probed.min_by(|a, b| away(a).total_cmp(&away(b)));
                probes & !next.map_or(0, |(bit, _)| *bit)
            }
            _ => probes,
        }
    }

    /// Leaves out of a texel's groups what lies in solids, even if they are open a little. Gives also one of the points left out, if
    /// there are any.
    fn in_the_open(
        &self,
        mut groups: Vec<Vec<Point>>,
        counts: &mut RayCounts,
    ) -> (Vec<Vec<Point>>, Option<Point>) {
        let is_whole = groups.len() == 1;
        let mut buried = None;
        let mut keep_if = |is_open: bool, point: &Point| {
            buried = buried.or((!is_open).then_some(*point));
            is_open
        };
        // All of a group lie in the same closed solids, or else the surface passes through itself.
        for group in &mut groups {
            if self.transport.space.is_in_solid(&group[0].1, counts) {
                group.retain(|point| keep_if(!self.transport.space.is_in_solid(&point.1, counts), point));
            }
        }
        groups.retain(|group| !group.is_empty());
        // What lies in a body that is open a little is divided from what does not, unless the body ends above the surface: of a
        // whole texel, the first points tell (of a (0, 2)-sequence four lie one in each quarter).
        for group in &mut groups {
            let mut is_enclosed = |(_, at): &Point| self.transport.space.is_enclosed(at, counts);
            if !is_whole || group.iter().take(4).any(&mut is_enclosed) {
                group.retain(|point| keep_if(!is_enclosed(point), point));
            }
        }
        groups.retain(|group| !group.is_empty());
        (groups, buried)
    }

    /// The largest group, and a point of another if there is one. What lies under open ground is the lesser side, however large.
    fn largest(
        &self,
        mut groups: Vec<Vec<Point>>,
        counts: &mut RayCounts,
    ) -> Option<(Vec<Point>, Option<Point>)> {
        let is_one = groups.len() == 1;
        let mut size = |group: &Vec<Point>| {
            let points = bits_of(group).count_ones();
            let mut is_buried =
                |(bit, at): &Point| *bit != 0 && self.transport.space.is_under_ground(at, counts);
            let buried =
                if is_one { 0 } else { group.iter().filter(|point| is_buried(point)).count() as u32 };
            let open = points - buried;
            (if is_enough(open) { open } else { 0 }, points)
        };
        let sizes: Vec<(u32, u32)> = groups.iter().map(&mut size).collect();
        let largest = (0..groups.len()).rev().max_by_key(|&i| sizes[i])?;
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

    /// Whether points of a texel that are not its surface lie outside solids all the same: on the other side of a wall.
    pub fn is_split(
        &self,
        surface: &BlockSurface,
        texel: usize,
        probes: u16,
        counts: &mut RayCounts,
    ) -> bool {
        indices(!probes).any(|probe| {
            let at = self.transport.space.receiver(&self.probe_point(surface, texel, probe));
            at.is_some_and(|at| !self.transport.space.is_inside(&at, counts))
        })
    }

    /// A few of the probed points that are a texel's surface.
    pub fn witnesses(&self, surface: &BlockSurface, texel: usize, probes: u16) -> Vec<Receiver> {
        const MOST: u32 = 4;
        let some = indices(probes).step_by(probes.count_ones().div_ceil(MOST).max(1) as usize);
        some.filter_map(|probe| self.transport.space.receiver(&self.probe_point(surface, texel, probe)))
            .collect()
    }

    /// One of the probed points that are a texel's surface.
    pub fn witness(&self, surface: &BlockSurface, texel: usize, probes: u16) -> Option<Receiver> {
        let at = |probe| self.transport.space.receiver(&self.probe_point(surface, texel, probe));
        indices(probes).find_map(at)
    }

    fn probe_point(&self, surface: &BlockSurface, texel: usize, probe: u32) -> SurfacePoint {
        surface.sample(self.atlas, texel, Self::probed(probe))
    }

    /// Where a texel is probed: at the same places in all, whatever the seed. A wall that stands along a row of texels then leaves them
    /// all the same side, not one or the other by chance.
    fn probed(probe: u32) -> Vec2 {
        // A sequence that stands well apart and has a point near every corner.
        const SPREAD: u32 = 239;
        point_pair(Sequence::new(0, Kind::Texel, SPREAD, Stream::Probe as u32).sample(probe))
    }

    /// Finds out which points of the texels are their surface, if that is not known.
    pub fn probe(&self, surface: &BlockSurface, state: &mut BlockState) -> RayCounts {
        if !state.probes.is_empty() {
            return RayCounts::default();
        }
        let covered: Vec<usize> = surface.covered().collect();
        let probed: Vec<(u16, RayCounts)> = covered
            .par_iter()
            .with_min_len(64)
            .map(|&texel| {
                let mut counts = RayCounts::default();
                (self.surface_probes(surface, texel, &mut counts), counts)
            })
            .collect();
        state.probes = probed.iter().map(|p| p.0).collect();
        sum(probed.into_iter().map(|p| p.1))
    }
}

/// The probed points among some points of a texel, one bit each.
fn bits_of(points: &[Point]) -> u16 {
    points.iter().fold(0, |bits, (bit, _)| bits | bit)
}

/// The probed points whose bits are set.
fn indices(probes: u16) -> impl Iterator<Item = u32> {
    (0..PROBES).filter(move |&probe| probes >> probe & 1 == 1)
}

/// The sum of counts.
pub fn sum(counts: impl IntoIterator<Item = RayCounts>) -> RayCounts {
    let mut all = RayCounts::default();
    counts.into_iter().for_each(|c| all += c);
    all
}

#[cfg(test)]
#[path = "block_tests.rs"]
mod tests;
