//! Finds the bright facets of a scene in its solved cache: surfaces are cut into small triangles, and those
//! that send out much more than the mean are kept, in clusters that lie together.

use super::cache_half::CacheHalf;
use super::cache_map::CacheMap;
use crate::Rgb;
use crate::geometry::Geometry;
use crate::light::luminance;
use crate::trace::rays::Hit;
use crate::trace::sources::Room;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Length of a facet in entries of the cache, about.
const FACET_LENGTH: f64 = 2.0;
/// Most facets along a side of a triangle.
const MOST_FACETS_ALONG: u32 = 1024;
/// Most facets that are considered; where there would be more, they are longer.
const MOST_FACETS: u64 = 1 << 24;
/// Facets this many times as bright as the mean are lights.
const BRIGHT_FACTOR: f32 = 4.0;
/// They are worth sampling where they hold this part of the light's second moment over all surfaces, and so
/// about of the variance of what paths find by chance (0.91 for daylight in the scene `room`, 0.39 in `yard`,
/// 0.98 and more for lamps).
const LEAST_SHARE: f64 = 0.5;
/// Most clusters of facets.
pub(crate) const MOST_CLUSTERS: usize = 256;

/// How the bright facets of one list are chosen.
pub struct BrightSelection {
    /// The layers.
    pub layers: Range<usize>,
    /// Distinguishes its random numbers from those of other lists.
    pub key: u32,
    /// Most clusters of its facets.
    pub most_clusters: usize,
    /// The room whose surfaces count; `None`: all count.
    pub room: Option<Room>,
}

/// The bright facets, ordered by cluster.
pub(crate) struct BrightFacets {
    /// The facets.
    pub facets: Vec<BrightFacet>,
    /// Per facet, the sum of the powers of its cluster's facets up to and with it, over that of all.
    pub up_to: Vec<f32>,
    /// The clusters.
    pub clusters: Vec<Cluster>,
}

/// A small triangle of a surface.
#[derive(Clone, Copy, Debug)]
pub struct BrightFacet {
    /// The triangle it is a part of.
    pub triangle: u32,
    /// Which side of that.
    pub is_back: bool,
    /// Its number on its side of the triangle, which has along² of them.
    pub number: u32,
    /// Facets along an edge of the triangle.
    pub along: u32,
    /// Its cluster.
    pub cluster: u32,
    /// Light it sends out: of each layer in units of its integral over all surfaces, the root of the summed
    /// squares.
    pub power: f32,
    /// Its area.
    pub area: f32,
    /// Its first corner.
    pub corner: Vec3,
    /// The edges from there.
    pub edges: [Vec3; 2],
    /// Its centre.
    pub middle: Vec3,
    /// Unit normal of its side.
    pub normal: Vec3,
}

/// Nearby facets with similar normals.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cluster {
    /// The first of its facets.
    pub first: u32,
    /// How many they are.
    pub count: u32,
    /// The sum of their powers.
    pub power: f32,
    /// The square of half its size.
    pub extent2: f32,
}

/// A side of a triangle that has entries in the cache, cut into along² facets.
#[derive(Clone, Copy)]
pub struct TriangleSide {
    triangle: u32,
    is_back: bool,
    along: u32,
    /// Area of a facet.
    area: f64,
}

impl TriangleSide {
    fn facets(&self) -> std::ops::Range<u32> {
        0..self.along * self.along
    }
}

/// What the cache knows of some layers.
struct SentLight<'a> {
    geometry: &'a Geometry,
    map: &'a CacheMap<'a>,
    halves: &'a [CacheHalf; 2],
    layers: Range<usize>,
    /// Where surfaces count.
    room: Option<Room>,
}

impl BrightFacets {
    /// The bright facets among the surfaces that count, by the light of some layers; `None` where little
    /// comes from them.
    pub(crate) fn find(
        geometry: &Geometry,
        map: &CacheMap,
        halves: &[CacheHalf; 2],
        sides: &[TriangleSide],
        selection: &BrightSelection,
    ) -> Option<Self> {
        let (layers, room) = (selection.layers.clone(), selection.room);
        let sent = SentLight { geometry, map, halves, layers, room };
        let inside: Vec<TriangleSide>;
        let sides = match room {
            None => sides,
            Some(room) => {
                let is_inside = |side: &&TriangleSide| {
                    room.touches(geometry.corners(side.triangle as usize))
                        && side.facets().any(|number| sent.is_counted(side, number))
                };
                inside = sides.par_iter().filter(is_inside).copied().collect();
                &inside
            }
        };
        let brightness = sent.brightness(sides);
        // Over the surfaces that count, the integrals of 1, brightness and its square.
        let [mut area, mut light, mut second] = [0f64; 3];
        for (side, brightness) in sides.iter().zip(&brightness) {
            area += side.area * side.facets().filter(|number| sent.is_counted(side, *number)).count() as f64;
            light += side.area * brightness.iter().map(|b| f64::from(*b)).sum::<f64>();
            second += side.area * brightness.iter().map(|b| f64::from(*b).powi(2)).sum::<f64>();
        }
        let least = BRIGHT_FACTOR * (light / area.max(f64::MIN_POSITIVE)) as f32;
        let mut facets = Vec::new();
        for (side, brightness) in sides.iter().zip(&brightness) {
            let bright = side.facets().zip(brightness).filter(|(_, b)| **b > least);
            facets.extend(bright.filter_map(|(number, b)| BrightFacet::new(geometry, side, number, *b)));
        }
        let bright: f64 = facets.iter().map(|f| f64::from(f.power).powi(2) / f64::from(f.area)).sum();
        if bright < LEAST_SHARE * second {
            return None;
        }
        let (clusters, up_to) = cluster(&mut facets, selection.most_clusters);
        Some(BrightFacets { facets, up_to, clusters })
    }
}

impl BrightFacet {
    /// Facet `number` of a side; `None` where it sends out nothing, or has no normal.
    fn new(geometry: &Geometry, side: &TriangleSide, number: u32, brightness: f32) -> Option<Self> {
        let triangle = side.triangle as usize;
        let front = geometry.normal(triangle);
        let area = side.area as f32;
        let power = brightness * area;
        if power <= 0.0 || front == Vec3::ZERO {
            return None;
        }
        let [p, q, r] = geometry.corners(triangle);
        let at = |u| {
            let b = point_of(side.along, number, u);
            p * b.x + q * b.y + r * b.z
        };
        let corner = at(Vec2::ZERO);
        Some(BrightFacet {
            triangle: side.triangle,
            is_back: side.is_back,
            number,
            along: side.along,
            cluster: 0,
            power,
            area,
            corner,
            edges: [at(Vec2::X) - corner, at(Vec2::Y) - corner],
            middle: at(Vec2::splat(1.0 / 3.0)),
            normal: if side.is_back { -front } else { front },
        })
    }
}

impl SentLight<'_> {
    /// Per side and facet, the light of all layers that it sends out per area, each in units of its integral
    /// over all surfaces: one number.
    fn brightness(&self, sides: &[TriangleSide]) -> Vec<Vec<f32>> {
        let sums = self.sums(sides);
        let unit: Vec<f32> =
            sums.iter().map(|&s| if s > 0.0 { (1.0 / s).min(1e30) as f32 } else { 0.0 }).collect();
        let of_facet = |side: &TriangleSide, number: u32, light: &mut [Rgb]| {
            if !self.is_counted(side, number) {
                return 0.0;
            }
            let mut squares = 0.0;
            for u in [Vec2::new(0.6, 0.2), Vec2::new(0.2, 0.6), Vec2::splat(0.2)] {
                self.at(side, number, u, light);
                let relative = light.iter().zip(&unit).map(|(l, unit)| luminance(*l) * unit);
                squares += relative.map(|l| l * l).sum::<f32>() / 3.0;
            }
            squares.sqrt().min(1e30)
        };
        sides
            .par_iter()
            .map_init(
                || vec![Rgb::ZERO; self.layers.len()],
                |light, side| side.facets().map(|number| of_facet(side, number, light)).collect(),
            )
            .collect()
    }

    /// The integral of each layer's luminance over all surfaces.
    fn sums(&self, sides: &[TriangleSide]) -> Vec<f64> {
        let of_sides = sides.par_chunks(256).map(|sides| {
            let (mut sums, mut light) = (vec![0f64; self.layers.len()], vec![Rgb::ZERO; self.layers.len()]);
            for side in sides {
                for number in side.facets().filter(|number| self.is_counted(side, *number)) {
                    self.at(side, number, Vec2::splat(1.0 / 3.0), &mut light);
                    sums.iter_mut().zip(&light).for_each(|(s, l)| *s += side.area * f64::from(luminance(*l)));
                }
            }
            sums
        });
        let mut all = vec![0f64; self.layers.len()];
        for sums in of_sides.collect::<Vec<_>>() {
            all.iter_mut().zip(sums).for_each(|(a, s)| *a += s);
        }
        all
    }

    /// Whether a facet lies where surfaces count.
    fn is_counted(&self, side: &TriangleSide, number: u32) -> bool {
        self.room.is_none_or(|room| {
            let [p, q, r] = self.geometry.corners(side.triangle as usize);
            let b = point_of(side.along, number, Vec2::splat(1.0 / 3.0));
            let normal = self.geometry.normal(side.triangle as usize);
            room.holds_surface(p * b.x + q * b.y + r * b.z, if side.is_back { -normal } else { normal })
        })
    }

    /// What each layer sends out per area, at the point `u` of a facet.
    fn at(&self, side: &TriangleSide, number: u32, u: Vec2, light: &mut [Rgb]) {
        light.fill(Rgb::ZERO);
        let (triangle, barycentric) = (side.triangle, point_of(side.along, number, u));
        if let Some(entry) = self.map.of_hit(&Hit { triangle, barycentric, t: 0.0 }, side.is_back) {
            let albedo = self.geometry.albedo_at(triangle as usize, barycentric);
            self.halves.iter().for_each(|half| half.add_layers(entry, albedo, self.layers.clone(), light));
        }
    }
}

/// The sides of triangles that have entries, cut into no more than `MOST_FACETS` facets; none where even long
/// ones are more.
pub(crate) fn sides(geometry: &Geometry, map: &CacheMap) -> Vec<TriangleSide> {
    let cut = |length: f64| {
        let of_triangle = |triangle: usize| {
            let along = facets_along(geometry, triangle, length);
            let area = f64::from(geometry.area(triangle)) / f64::from(along * along);
            let triangle = triangle as u32;
            let held = [false, true].into_iter().filter(move |&is_back| map.holds(triangle, is_back));
            held.map(move |is_back| TriangleSide { triangle, is_back, along, area })
        };
        (0..geometry.triangles.len()).flat_map(of_triangle).collect::<Vec<_>>()
    };
    let lengths = std::iter::successors(Some(FACET_LENGTH * map.entry_length()), |length| Some(2.0 * length));
    let facets = |sides: &Vec<TriangleSide>| sides.iter().map(|s| u64::from(s.along).pow(2)).sum::<u64>();
    lengths.take(8).map(cut).find(|sides| facets(sides) <= MOST_FACETS).unwrap_or_default()
}

/// How many facets of about this length lie along an edge of a triangle.
fn facets_along(geometry: &Geometry, triangle: usize, length: f64) -> u32 {
    // (Slivers would have too many: no more than a few times what their area holds.)
    let even = 4.0 * f64::from(geometry.area(triangle)).sqrt();
    ((geometry.longest_edge(triangle).min(even) / length).ceil().max(1.0) as u32).min(MOST_FACETS_ALONG)
}

/// Orders the facets by clusters: starting from six directions of their normals, the one with the greatest
/// power × extent is halved until there are enough.
fn cluster(facets: &mut [BrightFacet], most: usize) -> (Vec<Cluster>, Vec<f32>) {
    let direction = |f: &BrightFacet| {
        let n = f.normal;
        let axis = n.abs().max_position();
        2 * axis + usize::from(n[axis] < 0.0)
    };
    facets.sort_by_key(direction);
    // Ranges, with what halving them is worth.
    let extent = |facets: &[BrightFacet]| {
        let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
        facets.iter().for_each(|f| (low, high) = (low.min(f.middle), high.max(f.middle)));
        high - low
    };
    let power = |facets: &[BrightFacet]| facets.iter().map(|f| f64::from(f.power)).sum::<f64>();
    let worth = |facets: &[BrightFacet]| {
        if facets.len() < 2 { -1.0 } else { power(facets).sqrt() * f64::from(extent(facets).length()) }
    };
    let mut ranges: Vec<(usize, usize, f64)> = Vec::new();
    let mut from = 0;
    for same in facets.chunk_by(|a, b| direction(a) == direction(b)) {
        ranges.push((from, same.len(), worth(same)));
        from += same.len();
    }
    while ranges.len() < most {
        let best = (0..ranges.len()).max_by(|&a, &b| ranges[a].2.total_cmp(&ranges[b].2));
        let Some(best) = best.filter(|&b| ranges[b].2 > 0.0) else { break };
        let (first, count, _) = ranges[best];
        let part = &mut facets[first..first + count];
        let axis = extent(part).max_position();
        part.sort_by(|a, b| a.middle[axis].total_cmp(&b.middle[axis]));
        let (half, mut sum) = (0.5 * power(part), 0.0);
        let middle = part.iter().position(|f| {
            sum += f64::from(f.power);
            sum >= half
        });
        let middle = middle.unwrap_or(0).clamp(1, count - 1);
        ranges[best] = (first, middle, worth(&part[..middle]));
        ranges.insert(best + 1, (first + middle, count - middle, worth(&part[middle..])));
    }
    let (mut clusters, mut up_to) = (Vec::with_capacity(ranges.len()), Vec::with_capacity(facets.len()));
    for (k, &(first, count, _)) in ranges.iter().enumerate() {
        let part = &mut facets[first..first + count];
        let total = power(part);
        let mut sum = 0.0;
        for facet in part {
            sum += f64::from(facet.power);
            facet.cluster = k as u32;
            up_to.push((sum / total) as f32);
        }
        let extent2 = 0.25 * extent(&facets[first..first + count]).length_squared().max(1e-12);
        clusters.push(Cluster { first: first as u32, count: count as u32, power: total as f32, extent2 });
    }
    (clusters, up_to)
}

/// A point of facet `number` on a triangle of n × n of them, for `u` in the triangle u.x + u.y ≤ 1.
pub(crate) fn point_of(n: u32, number: u32, u: Vec2) -> Vec3 {
    // Row i starts at i (2n − i).
    let mut i = (f64::from(n) - (f64::from(n) * f64::from(n) - f64::from(number)).max(0.0).sqrt()) as u32;
    while i > 0 && i * (2 * n - i) > number {
        i -= 1;
    }
    while (i + 1) * (2 * n - i - 1) <= number {
        i += 1;
    }
    let k = number - i * (2 * n - i);
    let (j, is_down) = (k / 2, k % 2 == 1);
    let corner = Vec2::new(i as f32, j as f32);
    let at = (if is_down { corner + Vec2::ONE - u } else { corner + u }) / n as f32;
    Vec3::new((1.0 - at.x - at.y).max(0.0), at.x, at.y)
}

/// The facet of a point: rows i of constant first coordinate, in each of them by turns a triangle like the
/// whole and one upside down.
pub(crate) fn number_of(n: u32, barycentric: Vec3) -> u32 {
    let at = Vec2::new(barycentric.y, barycentric.z).max(Vec2::ZERO) * n as f32;
    let i = (at.x as u32).min(n - 1);
    let j = (at.y as u32).min(n - 1 - i);
    let is_down = j + 1 < n - i && (at.x - i as f32) + (at.y - j as f32) > 1.0;
    i * (2 * n - i) + 2 * j + u32::from(is_down)
}
