//! Where texels lie in space, and which of them are near enough to a texel, and like enough, to say something
//! of its light.

use super::stored_blocks::{StoredBlocks, StoredBlocksWriter};
use super::texel_in_space::{Key, SECTORS, TexelInSpace};
use crate::Result;
use crate::bake::layers::folder::Texel;
use crate::bake::samples::{Worker, indices};
use crate::receivers::ReceiverBlock;
use crate::trace::counts::RayCounts;
use crate::trace::solids::Receiver;
use glam::{IVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;

/// How far neighbours are looked for, in texels: some 200 on flat surfaces.
pub(super) const REACH: f32 = 8.0;
/// Neighbours of a texel, itself among them; of more the nearest.
pub(super) const MAX_NEIGHBOURS: usize = 224;
/// Texels of distance that a difference of 1 between unit normals counts as.
const PER_NORMAL: f32 = 8.0;
/// Farthest a neighbour may lie off a texel's plane, in texels: the first, plus the second per texel of
/// distance.
const MOST_OFF_PLANE: [f32; 2] = [0.25, 0.125];
/// Nothing in sight.
const UNBLOCKED: [u8; SECTORS] = [u8::MAX; SECTORS];
/// Slope at which these rays rise off the surface, so that low bumps are no obstacles.
const RISE: f32 = 1.0 / 32.0;
/// Stored steps per texel of distance.
const STEPS_PER_TEXEL: f32 = 255.0 / REACH;

/// The covered texels of a page in space. Invalid ones have no neighbours, and are neighbours of none.
pub(super) struct TexelsInSpace {
    blocks: StoredBlocks,
}

/// Texels near a place, kept for the next one beside it.
#[derive(Default)]
pub(super) struct Nearby {
    octave: i16,
    middle: Vec3,
    radius: f32,
    /// The positions of `texels`, each with its index there.
    positions: Vec<(Vec3, u32)>,
    texels: Vec<(TexelInSpace, u32)>,
}

/// A neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Neighbour {
    /// Its index among the covered texels.
    pub texel: u32,
    /// Squared distance in texels, by position and normal.
    pub squared: f32,
    /// Where it lies along the surface, in texels.
    pub along: [f32; 2],
}

impl TexelsInSpace {
    /// Finds where the texels of some blocks lie in space; some of them are `valid`. The records go to a
    /// nameless file in `folder`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub(super) fn find(
        worker: &Worker,
        blocks: &[(usize, Range<u32>)],
        texels: &[Texel],
        valid: impl Fn(usize) -> bool + Sync,
        folder: &Path,
    ) -> Result<(Self, RayCounts)> {
        /// Blocks whose texels are found at once, per thread.
        const AT_ONCE: usize = 4;
        let of_block = |(block, range): &(usize, Range<u32>)| {
            let (receivers, mut counts) = (worker.block(*block), RayCounts::default());
            let texel_in_space = |(i, texel): (u32, usize)| match valid(i as usize) {
                true => texel_in_space(worker, &receivers, texel, texels[i as usize].points, &mut counts),
                false => None,
            };
            let texels_in_space: Vec<Option<TexelInSpace>> =
                range.clone().zip(receivers.covered()).map(texel_in_space).collect();
            (texels_in_space, counts)
        };
        let mut writer = StoredBlocksWriter::create(folder)?;
        let mut counts = RayCounts::default();
        for some in blocks.chunks(AT_ONCE * rayon::current_num_threads()) {
            let found: Vec<_> = some.par_iter().map(of_block).collect();
            for (of_block, of_rays) in found {
                writer.push(&of_block)?;
                counts += of_rays;
            }
        }
        Ok((TexelsInSpace { blocks: writer.finish()? }, counts))
    }

    /// The neighbours of a texel, itself first. An invalid texel has none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub(super) fn neighbours(&self, texel: u32, nearby: &mut Nearby, out: &mut Vec<Neighbour>) -> Result<()> {
        out.clear();
        let texel_in_space = &self.blocks.texel(texel)?;
        if texel_in_space.size <= 0.0 {
            return Ok(());
        }
        let octave = octave(texel_in_space);
        let reach = REACH * texel_in_space.size;
        if nearby.octave != octave || texel_in_space.position.distance(nearby.middle) + reach > nearby.radius
        {
            self.gather(octave, texel_in_space.position, 1.5 * reach, nearby)?;
        }
        let pair = texel_in_space.normal.any_orthonormal_pair();
        let near = nearby
            .positions
            .iter()
            .filter(|(at, _)| at.distance_squared(texel_in_space.position) <= reach * reach);
        out.extend(near.filter_map(|&(_, i)| texel_in_space.neighbour(&nearby.texels[i as usize], pair)));
        if out.len() > MAX_NEIGHBOURS {
            out.sort_unstable_by_key(|n| (n.texel != texel, n.squared.to_bits(), n.texel));
            out.truncate(MAX_NEIGHBOURS);
        }
        match out.iter().position(|n| n.texel == texel) {
            Some(own) => out.swap(0, own),
            // (Boxes so far off that their keys begin anew.)
            None => out.clear(),
        }
        Ok(())
    }

    /// Gathers the texels near a place of the octave, of like size.
    fn gather(&self, octave: i16, middle: Vec3, radius: f32, nearby: &mut Nearby) -> Result<()> {
        (nearby.octave, nearby.middle, nearby.radius) = (octave, middle, radius);
        nearby.texels.clear();
        for octave in octave - 1..=octave + 1 {
            if !self.blocks.holds(first_key(octave)..first_key(octave + 1)) {
                continue;
            }
            let side = box_side(octave);
            let low = ((middle - radius) / side).floor().as_ivec3();
            let high = ((middle + radius) / side).floor().as_ivec3();
            // (The last coordinate varies fastest: boxes along it stand together.)
            for (x, y) in (low.x..=high.x).flat_map(|x| (low.y..=high.y).map(move |y| (x, y))) {
                let [first, last] = [low.z, high.z].map(|z| pack(octave, IVec3::new(x, y, z)));
                self.blocks.each_in(first..last + 1, |texel, texel_in_space| {
                    if texel_in_space.position.distance_squared(middle) <= radius * radius {
                        nearby.texels.push((*texel_in_space, texel));
                    }
                })?;
            }
        }
        nearby.positions.clear();
        nearby.positions.extend(nearby.texels.iter().map(|(texel, _)| texel.position).zip(0..));
        Ok(())
    }
}

impl TexelInSpace {
    /// An invalid one.
    pub(super) const INVALID: TexelInSpace =
        TexelInSpace { position: Vec3::ZERO, normal: Vec3::ZERO, size: 0.0, free_distances: [0; SECTORS] };

    /// The key of the box that holds it.
    pub(super) fn key(&self) -> Key {
        let octave = octave(self);
        pack(octave, (self.position / box_side(octave)).floor().as_ivec3())
    }

    /// Another texel as its neighbour, if it is one.
    fn neighbour(
        &self,
        &(ref other, texel): &(TexelInSpace, u32),
        (tangent, bitangent): (Vec3, Vec3),
    ) -> Option<Neighbour> {
        let way = (other.position - self.position) / self.size;
        let distance2 = way.length_squared();
        let squared = distance2 + PER_NORMAL * PER_NORMAL * other.normal.distance_squared(self.normal);
        if squared > REACH * REACH {
            return None;
        }
        let distance = distance2.sqrt();
        let off = way.dot(self.normal).abs().max(way.dot(other.normal).abs());
        let is_on_plane = off <= MOST_OFF_PLANE[0] + MOST_OFF_PLANE[1] * distance;
        let along = [way.dot(tangent), way.dot(bitangent)];
        let is_seen = || {
            let sees_back = || {
                let (tangent, bitangent) = other.normal.any_orthonormal_pair();
                other.sees(-way.dot(tangent), -way.dot(bitangent), distance * self.size / other.size)
            };
            self.sees(along[0], along[1], distance) && (other.free_distances == UNBLOCKED || sees_back())
        };
        (is_on_plane && (distance2 == 0.0 || is_seen())).then_some(Neighbour { texel, squared, along })
    }

    /// Whether nothing stands between it and what lies in this direction, at this distance in texels.
    fn sees(&self, along: f32, across: f32, distance: f32) -> bool {
        if self.free_distances == UNBLOCKED {
            return true;
        }
        let sector = (turn(along, across) * (SECTORS / 4) as f32) as usize % SECTORS;
        let steps = distance * STEPS_PER_TEXEL;
        [sector, (sector + 1) % SECTORS].into_iter().all(|s| steps <= f32::from(self.free_distances[s]))
    }
}

/// How far a direction is turned from the first axis to the second, in quarters: on a square, not a circle.
fn turn(along: f32, across: f32) -> f32 {
    let part = |a: f32, b: f32| b / (a + b);
    match (along >= 0.0, across >= 0.0) {
        _ if along == 0.0 && across == 0.0 => 0.0,
        (true, true) => part(along, across),
        (false, true) => 1.0 + part(across, -along),
        (false, false) => 2.0 + part(-along, -across),
        (true, false) => 3.0 + part(-across, along),
    }
}

/// A direction of that turn, of no particular length.
fn at_turn(turn: f32) -> Vec2 {
    let t = turn.fract();
    match turn as usize % 4 {
        0 => Vec2::new(1.0 - t, t),
        1 => Vec2::new(-t, 1.0 - t),
        2 => Vec2::new(t - 1.0, -t),
        _ => Vec2::new(t, t - 1.0),
    }
}

/// The side of the boxes of an octave.
fn box_side(octave: i16) -> f32 {
    REACH * f32::from(octave).exp2()
}

/// The octave of a texel's size.
fn octave(texel_in_space: &TexelInSpace) -> i16 {
    texel_in_space.size.log2().floor().clamp(-100.0, 100.0) as i16
}

/// The least key of an octave.
fn first_key(octave: i16) -> Key {
    ((octave + 128) as u64) << 56
}

fn pack(octave: i16, at: IVec3) -> Key {
    const BITS: u32 = 18;
    let bits = |v: i32| v.wrapping_add(1 << (BITS - 1)) as u64 & ((1 << BITS) - 1);
    first_key(octave) | bits(at.x) << (2 * BITS) | bits(at.y) << BITS | bits(at.z)
}

/// Where a texel lies: the mean of those of its points that are surface; none where that has no size.
fn texel_in_space(
    worker: &Worker,
    receivers: &ReceiverBlock,
    texel: usize,
    points: u16,
    counts: &mut RayCounts,
) -> Option<TexelInSpace> {
    let space = &worker.transport.space;
    let at = |point| worker.point(receivers, texel, point);
    let points: Vec<Receiver> = indices(points).filter_map(at).collect();
    let position = points.iter().map(Receiver::origin).sum::<Vec3>() / points.len() as f32;
    let normal = points.iter().map(Receiver::normal).sum::<Vec3>().try_normalize()?;
    let size = receivers.along(space.geometry, texel).length();
    if !(size > 0.0 && size.is_finite() && position.is_finite()) {
        return None;
    }
    // One sees from the point in the middle.
    let near = |r: &&Receiver| r.origin().distance_squared(position);
    let from = points.iter().min_by(|a, b| near(a).total_cmp(&near(b)))?;
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let mut free_distances = UNBLOCKED;
    for (sector, free_distance) in free_distances.iter_mut().enumerate() {
        let aside = at_turn(4.0 * sector as f32 / SECTORS as f32);
        let direction = ((tangent * aside.x + bitangent * aside.y).normalize() + normal * RISE).normalize();
        counts.inside += 1;
        if let Some(free) = space.distance_to_obstacle(from, direction, REACH * size) {
            *free_distance = (free / size * STEPS_PER_TEXEL) as u8;
        }
    }
    Some(TexelInSpace { position, normal, size, free_distances })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A floor of n × n texels of a decimetre, around the origin, with a wall that stands on it along x =
    /// 0.05.
    pub(crate) fn floor(n: i32, walled: bool) -> TexelsInSpace {
        let free_distance = |x: i32, aside: Vec2| {
            let distance = (0.5 - x as f32) / aside.normalize().x;
            if walled && distance > 0.0 { (distance * STEPS_PER_TEXEL).min(255.0) as u8 } else { u8::MAX }
        };
        let texel_in_space = |i: i32| {
            let (x, z) = (i % n - n / 2, i / n - n / 2);
            let normal = Vec3::Y;
            let (tangent, bitangent) = normal.any_orthonormal_pair();
            let free_distances = std::array::from_fn(|s| {
                let aside = at_turn(4.0 * s as f32 / SECTORS as f32);
                let direction = tangent * aside.x + bitangent * aside.y;
                free_distance(x, Vec2::new(direction.x, direction.z))
            });
            Some(TexelInSpace {
                position: Vec3::new(x as f32, 0.0, z as f32) * 0.1,
                normal,
                size: 0.1,
                free_distances,
            })
        };
        let mut writer = StoredBlocksWriter::create(&std::env::temp_dir()).unwrap();
        let texels: Vec<_> = (0..n * n).map(texel_in_space).collect();
        texels.chunks(200).for_each(|block| writer.push(block).unwrap());
        TexelsInSpace { blocks: writer.finish().unwrap() }
    }

    #[test]
    fn turns_go_all_around() {
        for k in 0..64 {
            let at = at_turn(k as f32 / 16.0);
            assert!((turn(at.x, at.y) - k as f32 / 16.0).abs() < 1e-5, "{k}: {at}");
        }
    }

    #[test]
    fn neighbours_are_those_within_reach() {
        let n = 33;
        let texels_in_space = floor(n, false);
        let (mut nearby, mut found) = (Nearby::default(), Vec::new());
        for texel in 0..(n * n) as u32 {
            texels_in_space.neighbours(texel, &mut nearby, &mut found).unwrap();
            let (x, z) = (texel as i32 % n, texel as i32 / n);
            let near = |i: &i32| (i % n - x).pow(2) + (i / n - z).pow(2) <= 64;
            let mut expected: Vec<u32> = (0..n * n).filter(near).map(|i| i as u32).collect();
            assert_eq!(found[0].texel, texel);
            // (At the very reach rounding decides.)
            found.retain(|n| n.squared < 63.9);
            expected.retain(|&i| (i as i32 % n - x).pow(2) + (i as i32 / n - z).pow(2) < 64);
            let mut all: Vec<u32> = found.iter().map(|n| n.texel).collect();
            all.sort_unstable();
            assert_eq!(all, expected);
        }
    }

    #[test]
    fn nothing_is_seen_through_a_wall() {
        let n = 33;
        let texels_in_space = floor(n, true);
        let (mut nearby, mut found) = (Nearby::default(), Vec::new());
        for texel in 0..(n * n) as u32 {
            texels_in_space.neighbours(texel, &mut nearby, &mut found).unwrap();
            let side = |i: u32| i as i32 % n - n / 2 > 0;
            assert!(found.iter().all(|other| side(other.texel) == side(texel)));
            assert!(found.len() > 20, "{}", found.len());
        }
    }
}
