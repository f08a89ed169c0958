//! After tracing, per layer: light is carried from valid texels into the gutter between charts.

use crate::atlas::owners::Owners;
use dataset::image::{Image, Mask};
use std::ops::Range;

/// Fills invalid texels around valid ones with the mean of their filled 8-neighbours, ring by ring. Linear in
/// the layer's values, so layers may be dilated one by one and summed. Which texels are filled from which is
/// found once for all images of one mask.
///
/// First texels that belong to a chart are filled from that chart's alone, then all that is left. So neither
/// what bilinear samples read for a chart, nor any other texel of its blocks of 4×4, holds light of another
/// one.
#[derive(Clone, Debug)]
pub struct Dilation {
    width: usize,
    height: usize,
    /// The texels to be filled, ring by ring, each with a bit per 8-neighbour that it is filled from.
    fills: Vec<(u32, u8)>,
}

impl Dilation {
    /// Finds what is filled from what within a distance (Chebyshev), in time proportional to the mask.
    pub fn new(mask: &Mask, owners: &Owners, distance: u32) -> Self {
        Dilation::of_rows(mask, owners, distance, 0..mask.height)
    }

    /// The same for some rows, as if there were no others. Rows are right if they are [`Dilation::reach`] or
    /// more away from those left out.
    pub fn of_rows(mask: &Mask, owners: &Owners, distance: u32, rows: Range<usize>) -> Self {
        let (width, height) = (mask.width, rows.len());
        let owner = |texel: usize| owners.of(texel % width, rows.start + texel / width);
        let of_one_chart = |a: usize, b: usize| owner(a).is_some_and(|chart| owner(b) == Some(chart));
        let mut fills = Vec::new();
        let mut filled = mask.valid[rows.start * width..rows.end * width].to_vec();
        rings(&mut filled, (width, height), distance, of_one_chart, &mut fills);
        // (By now the rings of charts count as valid: all within the distance of a valid texel is filled, and
        // some beyond.)
        rings(&mut filled, (width, height), distance, |_, _| true, &mut fills);
        Dilation { width, height, fills }
    }

    /// How far away the source of what is filled within a distance may lie: charts' own rings come first,
    /// then the space beyond, each with that distance.
    pub fn reach(distance: u32) -> usize {
        2 * distance as usize
    }

    /// Fills them, in time proportional to their number.
    ///
    /// # Panics
    /// If the image is not of the size of those rows of the mask.
    pub fn apply(&self, image: &mut Image) {
        assert_eq!((image.width, image.height), (self.width, self.height), "width and height of the image");
        for &(texel, bits) in &self.fills {
            let (mut sum, mut n) = ([0.0; 3], 0.0);
            for (_, source) in
                neighbours(texel as usize, self.width, self.height).filter(|(bit, _)| bits >> bit & 1 != 0)
            {
                let v = image.texels[source];
                (0..3).for_each(|c| sum[c] += v[c]);
                n += 1.0;
            }
            image.texels[texel as usize] = sum.map(|s| s / n);
        }
    }
}

/// Fills rings around what is filled, each texel from those neighbours that `may_fill` it.
fn rings(
    filled: &mut [bool],
    (width, height): (usize, usize),
    distance: u32,
    may_fill: impl Fn(usize, usize) -> bool,
    fills: &mut Vec<(u32, u8)>,
) {
    // The texels that were filled last; at first all.
    let mut ring: Vec<u32> = (0..filled.len() as u32).filter(|&i| filled[i as usize]).collect();
    let mut queued = filled.to_vec();
    for _ in 0..distance {
        let mut next: Vec<u32> = Vec::new();
        for &texel in &ring {
            for (_, n) in neighbours(texel as usize, width, height) {
                if !queued[n] && may_fill(texel as usize, n) {
                    queued[n] = true;
                    next.push(n as u32);
                }
            }
        }
        next.sort_unstable();
        for &texel in &next {
            let near = neighbours(texel as usize, width, height)
                .filter(|&(_, n)| filled[n] && may_fill(n, texel as usize));
            fills.push((texel, near.fold(0, |bits, (bit, _)| bits | 1 << bit)));
        }
        next.iter().for_each(|&texel| filled[texel as usize] = true);
        ring = next;
    }
}

/// The 8-neighbours of a texel on the page, row by row, each with its number from 0 to 7.
fn neighbours(texel: usize, width: usize, height: usize) -> impl Iterator<Item = (u8, usize)> {
    let (x, y) = (texel % width, texel / width);
    (0..9u8).filter(|&i| i != 4).filter_map(move |i| {
        let (nx, ny) = (x + usize::from(i % 3), y + usize::from(i / 3));
        // Both one too large, so that nothing falls below zero.
        let inside = (1..=width).contains(&nx) && (1..=height).contains(&ny);
        inside.then(|| (i - u8::from(i > 4), (ny - 1) * width + nx - 1))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::{self, Atlas};
    use crate::geometry::Geometry;
    use crate::scene::{Lightmap, LightmapSize};
    use glam::Vec3;

    /// Blocks of no chart.
    fn anyone(mask: &Mask) -> Owners {
        Owners::new(&Atlas::for_tests(mask.width as u32, mask.height as u32, Vec::new()))
    }

    /// What [`Dilation`] does where blocks are no chart's, the plain way.
    fn dilate(image: &mut Image, mask: &Mask, distance: u32) {
        let (w, h) = (image.width, image.height);
        let mut filled = mask.valid.clone();
        for _ in 0..distance {
            let ring: Vec<(usize, [f32; 3])> = (0..w * h)
                .filter(|&i| !filled[i])
                .filter_map(|i| {
                    let (x, y) = (i % w, i / w);
                    let (mut sum, mut n) = ([0.0; 3], 0.0);
                    for ny in y.saturating_sub(1)..(y + 2).min(h) {
                        for nx in x.saturating_sub(1)..(x + 2).min(w) {
                            if filled[ny * w + nx] {
                                let v = image.texels[ny * w + nx];
                                (0..3).for_each(|c| sum[c] += v[c]);
                                n += 1.0;
                            }
                        }
                    }
                    (n > 0.0).then(|| (i, sum.map(|s| s / n)))
                })
                .collect();
            for (i, value) in ring {
                image.texels[i] = value;
                filled[i] = true;
            }
        }
    }

    #[test]
    fn light_reaches_as_far_as_asked_and_keeps_its_value() {
        let mut image = Image::black(9, 7);
        let mut mask = Mask { width: 9, height: 7, valid: vec![false; 63] };
        for x in 3..5 {
            mask.valid[3 * 9 + x] = true;
            image.texels[3 * 9 + x] = [2.0, 1.0, 0.5];
        }
        dilate(&mut image, &mask, 2);
        for y in 0..7usize {
            for x in 0..9usize {
                let near = y.abs_diff(3) <= 2 && (1..=6).contains(&x);
                let expected = if near { [2.0, 1.0, 0.5] } else { [0.0; 3] };
                assert_eq!(image.texels[y * 9 + x], expected, "({x}, {y})");
            }
        }
    }

    /// A repeatable number in [0, 1).
    fn random(i: u32) -> f32 {
        let x = (i ^ 0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
        let x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
        ((x ^ x >> 16) >> 8) as f32 / (1 << 24) as f32
    }

    #[test]
    fn found_once_or_each_time_the_same_bits() {
        for (case, (width, height)) in [(1, 1), (1, 9), (13, 1), (31, 17), (64, 40)].into_iter().enumerate() {
            for density in [0.0, 0.01, 0.1, 0.7, 1.0] {
                let of = |i: usize, what: u32| random((i as u32 * 8 + what) * 5 + case as u32);
                let valid: Vec<bool> = (0..width * height).map(|i| of(i, 0) < density).collect();
                let mask = Mask { width, height, valid };
                let mut image = Image::black(width, height);
                for i in (0..width * height).filter(|&i| mask.valid[i]) {
                    image.texels[i] = [of(i, 1), of(i, 2) * 1e4, of(i, 3)];
                }
                for distance in 0..6 {
                    let (mut once, mut each) = (image.clone(), image.clone());
                    Dilation::new(&mask, &anyone(&mask), distance).apply(&mut once);
                    dilate(&mut each, &mask, distance);
                    assert_eq!(once, each, "{width}x{height}, density {density}, distance {distance}");
                }
            }
        }
    }

    /// Square sheets of many sizes, apart in space.
    fn sheets(count: u32, instances: bool) -> Geometry {
        let mut geometry = Geometry::default();
        for i in 0..count {
            let side = 0.02 + 3.0 * random(7 * i).powi(6) + 0.1 * random(3 * i + 1);
            let (at, base) = (Vec3::X * 5.0 * i as f32, geometry.positions.len() as u32);
            let corners = [[0.0, 0.0], [0.0, 1.0], [random(i), 1.0], [1.0, random(i + 9)]];
            geometry.positions.extend(corners.map(|[x, z]| at + side * Vec3::new(x, 0.0, z)));
            geometry.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
            geometry.material_of.extend([0, 0]);
            if instances || i == 0 {
                geometry.instances.push(crate::geometry::Instance {
                    name: format!("sheet {i}"),
                    mesh: i,
                    world_from_mesh: glam::DAffine3::IDENTITY,
                    triangles: 0..0,
                    vertices: 0..0,
                    lightmap: true,
                    has_lightmap_uvs: false,
                    density: 1.0,
                    lightmap_place: crate::geometry::LightmapPlace::Unsaid,
                });
                let last = geometry.instances.len() - 1;
                geometry.instances[last].triangles.start = geometry.triangles.len() - 2;
                geometry.instances[last].vertices.start = geometry.positions.len() - 4;
            }
            let instance = geometry.instances.last_mut().unwrap();
            (instance.triangles.end, instance.vertices.end) =
                (geometry.triangles.len(), geometry.positions.len());
        }
        geometry.normals = vec![Vec3::Y; geometry.positions.len()];
        geometry.uvs = vec![glam::Vec2::ZERO; geometry.positions.len()];
        geometry.lightmap_uvs = geometry.uvs.clone();
        geometry
    }

    #[test]
    fn neither_bilinear_samples_nor_blocks_mix_charts() {
        // Every chart has a light of its own, from 1 to 10⁸: after dilation bilinear samples on a chart give
        // that very light, and every block of 4×4 with a valid texel holds one light, except where charts
        // less than a texel wide share it.
        for instances in [true, false] {
            let geometry = sheets(300, instances);
            for side in [96, 160, 257] {
                let size = LightmapSize::Fixed { width: side, height: side };
                let atlas = atlas::build(&geometry, &Lightmap { size, ..Lightmap::default() }).unwrap();
                let n = side as usize;
                let mut mask = Mask { width: n, height: n, valid: vec![false; n * n] };
                let mut image = Image::black(n, n);
                let same = |a: f32, b: f32| (a - b).abs() <= 1e-5 * b;
                let light = |chart: u32| 10f32.powf(8.0 * random(chart));
                let bins = crate::surface::FaceBins::new(&atlas);
                let mut tiny = vec![true; atlas.charts as usize];
                for block in bins.occupied() {
                    let surface = crate::surface::BlockSurface::new(&atlas, &bins, block);
                    for texel in surface.covered() {
                        let (x, y) = (texel % surface.width, texel / surface.width);
                        let i = (surface.y0 + y) * atlas.width as usize + surface.x0 + x;
                        let point = surface.sample(&atlas, texel, glam::Vec2::splat(0.5));
                        let face = atlas.faces.iter().find(|face| face.triangle == point.triangle).unwrap();
                        let [a, b, c] = face.corners;
                        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
                        tiny[face.chart as usize] &= (high - low).min_element() < 1.0;
                        mask.valid[i] = true;
                        image.texels[i] = [light(face.chart); 3];
                    }
                }
                Dilation::new(&mask, &Owners::new(&atlas), 4).apply(&mut image);
                let mut blocks = vec![None; n.div_ceil(4) * n.div_ceil(4)];
                for face in &atlas.faces {
                    let expected = light(face.chart);
                    for k in 0..64 {
                        // Points of the triangle, its corners among them.
                        let (u, v) = ((k % 8) as f32 / 7.0, (k / 8) as f32 / 7.0);
                        let [a, b, c] = face.corners;
                        let point = a + (b - a) * u * (1.0 - v) + (c - a) * u * v - 0.5;
                        let (low, f) = (point.floor(), point - point.floor());
                        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                            let weight = [1.0 - f.x, f.x][dx] * [1.0 - f.y, f.y][dy];
                            let i = (low.y as usize + dy) * n + low.x as usize + dx;
                            if weight > 1e-3 {
                                let value = image.texels[i][0];
                                let chart = face.chart;
                                assert!(
                                    same(value, expected),
                                    "{value}, {expected}: texel {i} of {n}², chart {chart}"
                                );
                            }
                        }
                    }
                    let [a, b, c] = face.corners;
                    let middle = (a + b + c) / 3.0;
                    let block = middle.y as usize / 4 * n.div_ceil(4) + middle.x as usize / 4;
                    blocks[block] = Some(face.chart);
                }
                for (block, chart) in blocks.iter().enumerate().filter_map(|(b, chart)| Some((b, (*chart)?)))
                {
                    if tiny[chart as usize] {
                        continue;
                    }
                    let (x0, y0) = (block % n.div_ceil(4) * 4, block / n.div_ceil(4) * 4);
                    for (x, y) in (0..16).map(|i| (x0 + i % 4, y0 + i / 4)).filter(|&(x, y)| x < n && y < n) {
                        let value = image.texels[y * n + x][0];
                        assert!(
                            same(value, light(chart)),
                            "{value} at ({x}, {y}) of {n}² in a block of chart {chart}"
                        );
                    }
                }
            }
        }
    }
}
