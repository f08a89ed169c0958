//! Bright surfaces as lights. What a walk meets by the cosine alone, and reads from the cache, is noisy where much of the
//! light comes from little surface: a patch of sun on the floor, the inside of a lampshade. Once the cache is solved, those are
//! known: they are cut into facets, sampled, and weighted against the walk by the balance heuristic.
//!
//! Daylight has facets of its own, shared by all its layers, and so has every group: a group's light must not depend on what else
//! is traced. A facet is chosen in proportion to √Σ (its light ÷ the layer's mean)² over those layers, the best choice for the
//! sum of their relative variances; and by how much of it arrives at the receiver, which a [`View`] holds for clusters of facets,
//! shadows included.

use super::cache::{CacheHalf, CacheMap};
use super::rays::Hit;
use super::sampler::Sample;
use super::walk::{RayCounts, Receiver, Transport};
use crate::Rgb;
use crate::geometry::Geometry;
use crate::light::luminance;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::ops::Range;

/// Length of a facet in texels of the cache, about.
const LENGTH: f64 = 2.0;
/// Most facets along a side of a triangle.
const MOST_ALONG: u32 = 1024;
/// Most facets that are looked at; they get longer where there would be more.
const MOST: u64 = 1 << 24;
/// Facets this many times as bright as the mean are lights.
const BRIGHT: f32 = 4.0;
/// They are worth a look where they hold this part of the light's second moment over all surfaces, and so about of the variance of
/// what walks find by chance (0.91 for daylight in the scene `room`, 0.39 in `yard`, 0.98 and more for lamps).
const WORTH: f64 = 0.5;
/// Clusters of facets.
const CLUSTERS: usize = 256;
/// No facet.
const NONE: u32 = u32::MAX;

/// The bright facets of a scene, for some of its layers.
pub struct Reflectors {
    /// The layers.
    pub layers: Range<usize>,
    /// Tells its random numbers from those of other layers.
    pub key: u32,
    /// Per triangle and side, the place of its first facet in `facet_of`, and the facets along a side.
    sides: Vec<[(u32, u32); 2]>,
    /// Per facet of those sides, its place among `facets`.
    facet_of: Vec<u32>,
    facets: Vec<Facet>,
    /// Per facet, the sum of the powers of its cluster's facets up to and with it, over that of all.
    up_to: Vec<f32>,
    clusters: Vec<Cluster>,
}

#[derive(Clone, Copy, Debug)]
struct Facet {
    triangle: u32,
    is_back: bool,
    /// Its number on its side of the triangle, which has along² of them.
    number: u32,
    along: u32,
    cluster: u32,
    /// Light it sends out, in means of the layers times area.
    power: f32,
    /// Its area.
    area: f32,
    /// Its first corner, and the edges from there.
    corner: Vec3,
    edges: [Vec3; 2],
    middle: Vec3,
    normal: Vec3,
}

#[derive(Clone, Copy, Debug)]
struct Cluster {
    first: u32,
    count: u32,
    power: f32,
    /// The square of half its size.
    extent2: f32,
}

/// A point of a facet.
#[derive(Clone, Copy, Debug)]
struct FacetPoint {
    triangle: u32,
    is_back: bool,
    barycentric: Vec3,
    /// The same in space.
    point: Vec3,
    /// Unit normal of that side.
    normal: Vec3,
    /// Density over area with which it was chosen.
    density: f32,
}

/// How much of each cluster's light arrives somewhere: sums of probabilities, up to 1.
#[derive(Clone, Debug)]
pub struct View {
    up_to: Vec<f32>,
}

impl Reflectors {
    /// The bright facets among all surfaces of the cache, by the light of `layers`; `None` where little comes from them.
    pub fn new(
        geometry: &Geometry,
        map: &CacheMap,
        halves: &[CacheHalf; 2],
        layers: Range<usize>,
        key: u32,
    ) -> Option<Self> {
        // Per side of a triangle with entries, the facets along a side.
        let lengths = std::iter::successors(Some(LENGTH * map.entry_length()), |length| Some(2.0 * length));
        let along = lengths.take(8).map(|length| facets_along(geometry, map, length));
        let counts =
            |along: &Vec<[u32; 2]>| along.iter().flatten().map(|n| u64::from(*n).pow(2)).sum::<u64>();
        let along = along.into_iter().find(|along| counts(along) <= MOST)?;
        let sides: Vec<(u32, bool, u32)> = along
            .iter()
            .enumerate()
            .flat_map(|(t, n)| [(t as u32, false, n[0]), (t as u32, true, n[1])])
            .filter(|side| side.2 > 0)
            .collect();
        // Light sent out by a layer per area, at a point.
        let sent = |light: &mut [Rgb], triangle: u32, is_back: bool, barycentric: Vec3| {
            light.fill(Rgb::ZERO);
            let hit = Hit { triangle, barycentric, t: 0.0 };
            if let Some(entry) = map.of_hit(&hit, is_back) {
                let albedo = geometry.albedo_at(triangle as usize, barycentric);
                halves.iter().for_each(|half| half.add_layers(entry, albedo, layers.clone(), light));
            }
        };
        // Integral of each layer over all surfaces.
        let sums = {
            let sums = sides.par_chunks(256).map(|sides| {
                let (mut sums, mut light) = (vec![0f64; layers.len()], vec![Rgb::ZERO; layers.len()]);
                for &(triangle, is_back, n) in sides {
                    let area = f64::from(geometry.area(triangle as usize)) / f64::from(n * n);
                    for number in 0..n * n {
                        sent(&mut light, triangle, is_back, point_of(n, number, Vec2::splat(1.0 / 3.0)));
                        sums.iter_mut().zip(&light).for_each(|(s, l)| *s += area * f64::from(luminance(*l)));
                    }
                }
                sums
            });
            let mut all = vec![0f64; layers.len()];
            for sums in sums.collect::<Vec<_>>() {
                all.iter_mut().zip(sums).for_each(|(a, s)| *a += s);
            }
            all
        };
        let unit: Vec<f32> =
            sums.iter().map(|&s| if s > 0.0 { (1.0 / s).min(1e30) as f32 } else { 0.0 }).collect();
        // Light of all layers per area, in units of those sums: one number per facet.
        let brightness: Vec<Vec<f32>> = sides
            .par_iter()
            .map_init(
                || vec![Rgb::ZERO; layers.len()],
                |light, &(triangle, is_back, n)| {
                    let at = |number: u32, light: &mut Vec<Rgb>| {
                        let mut squares = 0.0;
                        for u in [Vec2::new(0.6, 0.2), Vec2::new(0.2, 0.6), Vec2::splat(0.2)] {
                            sent(light, triangle, is_back, point_of(n, number, u));
                            let relative = light.iter().zip(&unit).map(|(l, unit)| luminance(*l) * unit);
                            squares += relative.map(|l| l * l).sum::<f32>() / 3.0;
                        }
                        squares.sqrt().min(1e30)
                    };
                    (0..n * n).map(|number| at(number, light)).collect()
                },
            )
            .collect();
        let (mut area, mut light, mut second) = (0f64, 0f64, 0f64);
        for (&(triangle, _, n), brightness) in sides.iter().zip(&brightness) {
            let of_facet = f64::from(geometry.area(triangle as usize)) / f64::from(n * n);
            area += of_facet * f64::from(n * n);
            light += of_facet * brightness.iter().map(|b| f64::from(*b)).sum::<f64>();
            second += of_facet * brightness.iter().map(|b| f64::from(*b).powi(2)).sum::<f64>();
        }
        let least = BRIGHT * (light / area.max(f64::MIN_POSITIVE)) as f32;
        // The bright ones.
        let mut facets = Vec::new();
        for (&(triangle, is_back, n), brightness) in sides.iter().zip(&brightness) {
            let of_facet = geometry.area(triangle as usize) / (n * n) as f32;
            let front = geometry.normal(triangle as usize);
            let normal = if is_back { -front } else { front };
            for (number, &brightness) in brightness.iter().enumerate() {
                let power = brightness * of_facet;
                if brightness > least && power > 0.0 && normal != Vec3::ZERO {
                    let number = number as u32;
                    let [p, q, r] = geometry.corners(triangle as usize);
                    let at = |u| {
                        let b = point_of(n, number, u);
                        p * b.x + q * b.y + r * b.z
                    };
                    let corner = at(Vec2::ZERO);
                    facets.push(Facet {
                        triangle,
                        is_back,
                        number,
                        along: n,
                        cluster: 0,
                        power,
                        area: of_facet,
                        corner,
                        edges: [at(Vec2::X) - corner, at(Vec2::Y) - corner],
                        middle: at(Vec2::splat(1.0 / 3.0)),
                        normal,
                    });
                }
            }
        }
        let bright: f64 = facets.iter().map(|f| f64::from(f.power).powi(2) / f64::from(f.area)).sum();
        if bright < WORTH * second {
            return None;
        }
        let (clusters, up_to) = cluster(&mut facets);
        // From a hit back to its facet.
        let mut reflectors = Reflectors {
            layers,
            key,
            sides: vec![[(NONE, 0); 2]; geometry.triangles.len()],
            facet_of: Vec::new(),
            facets,
            up_to,
            clusters,
        };
        for (i, facet) in reflectors.facets.iter().enumerate() {
            let side = usize::from(facet.is_back);
            let n = along[facet.triangle as usize][side];
            let place = &mut reflectors.sides[facet.triangle as usize][side];
            if place.0 == NONE {
                *place = (reflectors.facet_of.len() as u32, n);
                reflectors.facet_of.resize(reflectors.facet_of.len() + (n * n) as usize, NONE);
            }
            reflectors.facet_of[(place.0 + facet.number) as usize] = i as u32;
        }
        Some(reflectors)
    }

    /// What of their light arrives around some receivers; the samples are those the receivers were chosen by. `None` where nothing
    /// does.
    pub fn view(
        &self,
        transport: &Transport,
        receivers: &[(Receiver, Sample)],
        counts: &mut RayCounts,
    ) -> Option<View> {
        let is_free = |r: usize, direction: Vec3, distance: f32| {
            counts.reflector += 1;
            let at = &receivers[r].0;
            !transport.rays.occluded(at.origin, direction, distance * (1.0 - 1e-3), at.triangle)
        };
        let places: Vec<(Vec3, Vec3)> = receivers.iter().map(|(r, _)| (r.origin, r.normal)).collect();
        let number = |r: usize, k: usize| receivers[r].1.number(dimension(k as u32));
        self.view_from(&places, number, is_free)
    }

    /// As [`Reflectors::view`], from places (origin, normal); `number` chooses a facet of the k-th cluster for a place, and `is_free`
    /// tells whether nothing stands between a place and the point in a direction at a distance.
    fn view_from(
        &self,
        places: &[(Vec3, Vec3)],
        number: impl Fn(usize, usize) -> f32,
        mut is_free: impl FnMut(usize, Vec3, f32) -> bool,
    ) -> Option<View> {
        /// Part of a cluster's light that is taken to arrive although no ray did.
        const HIDDEN: f32 = 0.05;
        /// Distances count for no less than this part of a cluster's size: one facet beside the receiver is not all of it.
        const NEAR2: f32 = 0.05;
        let mut arrives = vec![0f32; self.clusters.len()];
        for (k, cluster) in self.clusters.iter().enumerate() {
            for (r, &(origin, normal)) in places.iter().enumerate() {
                let facet = &self.facets[self.pick(cluster, number(r, k))];
                let (direction, distance) = (facet.middle - origin).normalize_and_length();
                let (at, from) = (direction.dot(normal), -direction.dot(facet.normal));
                if at <= 0.0 || from <= 0.0 {
                    continue;
                }
                let form = at * from / (distance * distance).max(NEAR2 * cluster.extent2);
                let free = is_free(r, direction, distance);
                arrives[k] += cluster.power * form * if free { 1.0 } else { HIDDEN };
            }
        }
        let total: f32 = arrives.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mut sum = 0.0;
        let mut up_to: Vec<f32> = arrives
            .iter()
            .map(|a| {
                sum += a / total;
                sum
            })
            .collect();
        if let Some(last) = up_to.last_mut() {
            *last = last.max(1.0);
        }
        Some(View { up_to })
    }

    /// One sample of the light that they reflect to `at`: where from, from which side, and the irradiance at `at` per unit of it there,
    /// weighted against the walk that may meet them.
    pub fn reflected(
        &self,
        transport: &Transport,
        at: &Receiver,
        view: &View,
        sample: Sample,
        counts: &mut RayCounts,
    ) -> Option<(Hit, bool, Rgb)> {
        let dimension = dimension(self.key);
        let point = self.sample(view, sample.number(dimension), sample.pair(dimension))?;
        let (direction, distance) = (point.point - at.origin).normalize_and_length();
        let from = -direction.dot(point.normal);
        let cosine = direction.dot(at.normal);
        if from <= 0.0 || cosine <= 0.0 || direction.dot(at.face_normal) <= 0.0 {
            return None;
        }
        // (A hole of a cut-out reflects nothing.)
        let FacetPoint { triangle, barycentric, is_back, .. } = point;
        if !transport.geometry.is_solid_at(triangle as usize, barycentric) {
            return None;
        }
        // Radiance is albedo ÷ π times the irradiance there; over the densities of both ways to find it.
        let pdf = point.density * distance * distance / from;
        let weight = cosine / (pdf + cosine / PI);
        if !(weight.is_finite() && weight > 0.0) {
            return None;
        }
        counts.reflector += 1;
        // The ray must not be stopped by the very surface it looks for.
        if transport.rays.occluded(at.origin, direction, distance * (1.0 - 1e-4), at.triangle) {
            return None;
        }
        let albedo = transport.geometry.albedo_at(triangle as usize, barycentric);
        Some((Hit { triangle, barycentric, t: distance }, is_back, albedo * (weight / PI)))
    }

    /// A facet of a cluster, in proportion to power.
    fn pick(&self, cluster: &Cluster, u: f32) -> usize {
        let up_to = &self.up_to[cluster.first as usize..(cluster.first + cluster.count) as usize];
        let i = up_to.partition_point(|sum| *sum <= u).min(up_to.len() - 1);
        cluster.first as usize + i
    }

    /// A point in proportion to what arrives. `choice` chooses the facet, `u` the point on it.
    fn sample(&self, view: &View, choice: f32, u: Vec2) -> Option<FacetPoint> {
        let k = view.up_to.partition_point(|p| *p <= choice).min(view.up_to.len() - 1);
        let before = if k > 0 { view.up_to[k - 1] } else { 0.0 };
        let left = (choice - before) / (view.up_to[k] - before);
        if !(0.0..=1.0).contains(&left) {
            return None;
        }
        let i = self.pick(&self.clusters[k], left);
        let facet = &self.facets[i];
        let fold = if u.x + u.y > 1.0 { Vec2::ONE - u } else { u };
        Some(FacetPoint {
            triangle: facet.triangle,
            is_back: facet.is_back,
            barycentric: point_of(facet.along, facet.number, fold),
            point: facet.corner + facet.edges[0] * fold.x + facet.edges[1] * fold.y,
            normal: facet.normal,
            density: self.density(view, i),
        })
    }

    /// The density over area with which a look gives a point of the surface; 0 where it is not bright.
    pub fn density_at(&self, view: &View, hit: &Hit, is_back: bool) -> f32 {
        let (first, n) = self.sides[hit.triangle as usize][usize::from(is_back)];
        if first == NONE {
            return 0.0;
        }
        let facet = self.facet_of[(first + number_of(n, hit.barycentric)) as usize];
        if facet == NONE { 0.0 } else { self.density(view, facet as usize) }
    }

    fn density(&self, view: &View, facet: usize) -> f32 {
        let facet = &self.facets[facet];
        let k = facet.cluster as usize;
        let before = if k > 0 { view.up_to[k - 1] } else { 0.0 };
        (view.up_to[k] - before) * (facet.power / self.clusters[k].power) / facet.area
    }
}

/// Per triangle, how many facets of about this length lie along a side of its front and of its back; 0 where there is no entry.
fn facets_along(geometry: &Geometry, map: &CacheMap, length: f64) -> Vec<[u32; 2]> {
    let of_triangle = |triangle: usize| {
        let [a, b, c] = geometry.corners(triangle).map(|p| p.as_dvec3());
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        // (Slivers would have too many: no more than a few times what their area holds.)
        let even = 4.0 * f64::from(geometry.area(triangle)).sqrt();
        let n = ((longest.min(even) / length).ceil().max(1.0) as u32).min(MOST_ALONG);
        [false, true].map(|is_back| if map.holds(triangle as u32, is_back) { n } else { 0 })
    };
    (0..geometry.triangles.len()).map(of_triangle).collect()
}

/// Orders the facets by clusters: starting from six directions of their normals, the one with the greatest power × extent is halved
/// until there are enough.
fn cluster(facets: &mut [Facet]) -> (Vec<Cluster>, Vec<f32>) {
    let direction = |f: &Facet| {
        let n = f.normal;
        let axis = n.abs().max_position();
        2 * axis + usize::from(n[axis] < 0.0)
    };
    facets.sort_by_key(direction);
    // Ranges, with what halving them is worth.
    let extent = |facets: &[Facet]| {
        let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
        facets.iter().for_each(|f| (low, high) = (low.min(f.middle), high.max(f.middle)));
        high - low
    };
    let power = |facets: &[Facet]| facets.iter().map(|f| f64::from(f.power)).sum::<f64>();
    let worth = |facets: &[Facet]| {
        if facets.len() < 2 { -1.0 } else { power(facets).sqrt() * f64::from(extent(facets).length()) }
    };
    let mut ranges: Vec<(usize, usize, f64)> = Vec::new();
    let mut from = 0;
    for same in facets.chunk_by(|a, b| direction(a) == direction(b)) {
        ranges.push((from, same.len(), worth(same)));
        from += same.len();
    }
    while ranges.len() < CLUSTERS {
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

/// Dimensions of the samples' numbers.
fn dimension(key: u32) -> u32 {
    key.wrapping_add(0x7265_666c)
}

/// A point of facet `number` on a triangle of n × n of them, for `u` in the triangle u.x + u.y ≤ 1.
fn point_of(n: u32, number: u32, u: Vec2) -> Vec3 {
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

/// The facet of a point.
fn number_of(n: u32, barycentric: Vec3) -> u32 {
    let at = Vec2::new(barycentric.y, barycentric.z).max(Vec2::ZERO) * n as f32;
    let i = (at.x as u32).min(n - 1);
    let j = (at.y as u32).min(n - 1 - i);
    let is_down = j + 1 < n - i && (at.x - i as f32) + (at.y - j as f32) > 1.0;
    i * (2 * n - i) + 2 * j + u32::from(is_down)
}

#[cfg(test)]
#[path = "reflectors_tests.rs"]
mod tests;
