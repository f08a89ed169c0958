//! Texels as pieces of surface: which parts of which triangles a texel covers, and points on them.

use crate::atlas::Atlas;
use crate::atlas::raster::{TOLERANCE, x_interval};
use crate::geometry::Geometry;
use glam::{DVec2, DVec3, Vec2, Vec3, dvec2, dvec3};

/// Side of the square blocks of texels that are worked on at a time; divides the metric tiles' side.
pub const BLOCK: usize = 64;

/// For every block of a page, the faces that may touch it.
#[derive(Debug)]
pub struct FaceBins {
    /// Blocks across.
    pub columns: usize,
    /// Blocks down.
    pub rows: usize,
    starts: Vec<u32>,
    faces: Vec<u32>,
}

impl FaceBins {
    /// Sorts the faces of an atlas into blocks.
    pub fn new(atlas: &Atlas) -> Self {
        let columns = (atlas.width as usize).div_ceil(BLOCK);
        let rows = (atlas.height as usize).div_ceil(BLOCK);
        let mut starts = vec![0u32; columns * rows + 1];
        let blocks_of = |corners: &[Vec2; 3]| {
            let low = corners[0].min(corners[1]).min(corners[2]).max(Vec2::ZERO);
            let high = corners[0].max(corners[1]).max(corners[2]).max(Vec2::ZERO);
            let block = |v: f32, n: usize| ((v / BLOCK as f32) as usize).min(n - 1);
            let (x0, x1) = (block(low.x, columns), block(high.x, columns));
            (block(low.y, rows)..=block(high.y, rows))
                .flat_map(move |y| (x0..=x1).map(move |x| y * columns + x))
        };
        // Counting sort: count, then place.
        for face in &atlas.faces {
            for block in blocks_of(&face.corners) {
                starts[block + 1] += 1;
            }
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut faces = vec![0; *starts.last().unwrap_or(&0) as usize];
        for (i, face) in atlas.faces.iter().enumerate() {
            for block in blocks_of(&face.corners) {
                faces[next[block] as usize] = i as u32;
                next[block] += 1;
            }
        }
        FaceBins { columns, rows, starts, faces }
    }

    /// The blocks that hold surface.
    pub fn occupied(&self) -> Vec<usize> {
        (0..self.columns * self.rows).filter(|&block| !self.faces(block).is_empty()).collect()
    }

    /// Indices into `Atlas::faces` of the faces that may touch a block.
    pub fn faces(&self, block: usize) -> &[u32] {
        &self.faces[self.starts[block] as usize..self.starts[block + 1] as usize]
    }
}

/// The surface under one block of texels.
#[derive(Debug)]
pub struct BlockSurface {
    /// Left column of the block.
    pub x0: usize,
    /// Top row of the block.
    pub y0: usize,
    /// Texels across (less than [`BLOCK`] at the page's edge).
    pub width: usize,
    /// Texels down.
    pub height: usize,
    starts: Vec<u32>,
    fragments: Vec<Fragment>,
}

/// A triangular piece of a face within one texel.
#[derive(Clone, Copy, Debug)]
struct Fragment {
    face: u32,
    corners: [Vec2; 3],
    /// Area of the texel's fragments up to and including this one, in texels.
    cumulative: f32,
}

/// A point on a triangle of the geometry.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Index into `Geometry::triangles`.
    pub triangle: u32,
    /// Weights of its corners, none negative.
    pub barycentric: Vec3,
}

/// Less covered area than this (in texels) is no surface. It is measured in double precision, where a face
/// without area has less than 1e-9 at any place of a page: whatever has a fragment has an area to divide by.
const LEAST_AREA: f64 = 1e-5;

impl BlockSurface {
    /// Clips the faces of a block to its texels.
    pub fn new(atlas: &Atlas, bins: &FaceBins, block: usize) -> Self {
        let (x0, y0) = ((block % bins.columns) * BLOCK, (block / bins.columns) * BLOCK);
        let width = BLOCK.min(atlas.width as usize - x0);
        let height = BLOCK.min(atlas.height as usize - y0);
        let mut pieces: Vec<(u32, Fragment)> = Vec::new();
        for &face in bins.faces(block) {
            let corners = atlas.faces[face as usize].corners;
            let low = corners[0].min(corners[1]).min(corners[2]);
            let high = corners[0].max(corners[1]).max(corners[2]);
            let range = |low: f64, high: f64, from: usize, n: usize| {
                let first = (low.floor().max(from as f64) as usize).max(from);
                first..((high.floor() + 1.0).max(0.0) as usize).min(from + n)
            };
            let corners = corners.map(DVec2::from);
            for y in range(low.y.into(), high.y.into(), y0, height) {
                // A long sliver meets few texels of its box.
                let band = (y as f64 - TOLERANCE, (y + 1) as f64 + TOLERANCE);
                let Some((left, right)) = x_interval(corners, band) else { continue };
                for x in range(left - TOLERANCE, right + TOLERANCE, x0, width) {
                    let polygon = clip(&corners, dvec2(x as f64, y as f64));
                    for i in 2..polygon.len {
                        let corners = [polygon.points[0], polygon.points[i - 1], polygon.points[i]];
                        let area = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]).abs() * 0.5;
                        if area > LEAST_AREA {
                            let texel = ((y - y0) * width + x - x0) as u32;
                            let corners = corners.map(|corner| corner.as_vec2());
                            pieces.push((texel, Fragment { face, corners, cumulative: area as f32 }));
                        }
                    }
                }
            }
        }
        // Stable: within a texel the fragments stand in the order of the faces.
        pieces.sort_by_key(|p| p.0);
        let mut starts = vec![0u32; width * height + 1];
        for (texel, _) in &pieces {
            starts[*texel as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut fragments: Vec<Fragment> = pieces.into_iter().map(|p| p.1).collect();
        for texel in 0..width * height {
            let mut sum = 0.0;
            for f in &mut fragments[starts[texel] as usize..starts[texel + 1] as usize] {
                sum += f.cumulative;
                f.cumulative = sum;
            }
        }
        BlockSurface { x0, y0, width, height, starts, fragments }
    }

    /// Whether any surface lies under the texel (an index within the block, row by row).
    pub fn is_covered(&self, texel: usize) -> bool {
        self.starts[texel] < self.starts[texel + 1]
    }

    /// The covered texels (indices within the block), ascending.
    pub fn covered(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.width * self.height).filter(|&texel| self.is_covered(texel))
    }

    /// A point uniformly distributed over the texel's surface, by area on the page. The texel must be
    /// covered.
    pub fn sample(&self, atlas: &Atlas, texel: usize, u: Vec2) -> SurfacePoint {
        let fragments = &self.fragments[self.starts[texel] as usize..self.starts[texel + 1] as usize];
        // Choose a fragment by area, and reuse what is left of the number.
        let target = u.x * fragments[fragments.len() - 1].cumulative;
        let i = fragments.partition_point(|f| f.cumulative <= target).min(fragments.len() - 1);
        let below = if i == 0 { 0.0 } else { fragments[i - 1].cumulative };
        let fragment = &fragments[i];
        // (Among very many fragments the sum may swallow one.)
        let area = (fragment.cumulative - below).max(f32::MIN_POSITIVE);
        let ux = ((target - below) / area).clamp(0.0, 1.0);
        // A uniform point of the triangle.
        let r = ux.sqrt();
        let [a, b, c] = fragment.corners;
        let point = a * (1.0 - r) + b * (r * (1.0 - u.y)) + c * (r * u.y);
        fragment.point(atlas, point)
    }

    /// The direction in space in which the columns of the page run on a texel's surface; its length is that
    /// of a texel. The texel must be covered.
    pub fn along(&self, atlas: &Atlas, geometry: &Geometry, texel: usize) -> Vec3 {
        let face = &atlas.faces[self.fragments[self.starts[texel] as usize].face as usize];
        let [a, b, c] = face.corners.map(DVec2::from);
        let [p, q, r] = geometry.corners(face.triangle as usize).map(Vec3::as_dvec3);
        let twice_area = (b - a).perp_dot(c - a);
        // How the weights of the second and third corner grow along x.
        ((q - p) * ((c - a).y / twice_area) - (r - p) * ((b - a).y / twice_area)).as_vec3()
    }

    /// The outermost points of a texel's surface in each of eight directions on the page, equal ones once: of
    /// a whole texel its four corners. The texel must be covered.
    pub fn rim(&self, atlas: &Atlas, texel: usize) -> Vec<SurfacePoint> {
        const DIRECTIONS: [[f32; 2]; 8] = [
            [-1.0, -1.0],
            [1.0, -1.0],
            [1.0, 1.0],
            [-1.0, 1.0],
            [-1.0, 0.0],
            [0.0, -1.0],
            [1.0, 0.0],
            [0.0, 1.0],
        ];
        let fragments = &self.fragments[self.starts[texel] as usize..self.starts[texel + 1] as usize];
        let mut rim: Vec<(&Fragment, Vec2)> = Vec::new();
        for direction in DIRECTIONS.map(Vec2::from_array) {
            let reach = |at: Vec2| at.dot(direction);
            let farthest = rim.iter().map(|(_, at)| reach(*at)).fold(f32::NEG_INFINITY, f32::max);
            let corners = fragments.iter().flat_map(|f| f.corners.map(|corner| (f, corner)));
            let beyond = corners.filter(|(_, at)| reach(*at) > farthest);
            rim.extend(beyond.reduce(|a, b| if reach(b.1) > reach(a.1) { b } else { a }));
        }
        rim.into_iter().map(|(fragment, at)| fragment.point(atlas, at)).collect()
    }
}

impl Fragment {
    /// A point of it, given on the page.
    fn point(&self, atlas: &Atlas, at: Vec2) -> SurfacePoint {
        let face = &atlas.faces[self.face as usize];
        SurfacePoint {
            triangle: face.triangle,
            barycentric: inset(&face.corners, barycentric(&face.corners, at)),
        }
    }
}

/// Points keep this far from the edges of their triangle, in texels.
const INSET: f64 = 0.01;

/// Moves a point that is nearer than [`INSET`] to an edge (in a sliver: than an eighth of the height) to that
/// distance. A point on an edge of a closed room lies on the neighbouring wall's plane to the last bit, and a
/// ray from there passes that wall; texels of which an edge covers a hair have no other points.
fn inset(corners: &[Vec2; 3], weights: DVec3) -> Vec3 {
    let [a, b, c] = corners.map(DVec2::from);
    let twice_area = (b - a).perp_dot(c - a).abs();
    // A corner's height above the opposite edge is twice the area ÷ that edge's length.
    let least = (dvec3((c - b).length(), (a - c).length(), (b - a).length()) * (INSET / twice_area))
        .min(DVec3::splat(0.125));
    let beyond = (weights - least).max(DVec3::ZERO);
    (least + beyond * ((1.0 - least.element_sum()) / beyond.element_sum())).as_vec3()
}

/// Weights of a triangle's corners at a point, clamped into the triangle.
fn barycentric(corners: &[Vec2; 3], point: Vec2) -> DVec3 {
    let [a, b, c] = corners.map(DVec2::from);
    let p = DVec2::from(point);
    let area = (b - a).perp_dot(c - a);
    let b1 = ((p - a).perp_dot(c - a) / area).clamp(0.0, 1.0);
    let b2 = ((b - a).perp_dot(p - a) / area).clamp(0.0, 1.0 - b1);
    dvec3(1.0 - b1 - b2, b1, b2)
}

/// A convex polygon of at most seven corners: a triangle cut by four lines.
struct Polygon {
    points: [DVec2; 7],
    len: usize,
}

/// A triangle clipped to the unit square at `corner` (Sutherland & Hodgman).
fn clip(triangle: &[DVec2; 3], corner: DVec2) -> Polygon {
    let mut polygon = Polygon { points: [DVec2::ZERO; 7], len: 3 };
    polygon.points[..3].copy_from_slice(triangle);
    for side in 0..4 {
        let axis = side / 2;
        // Signed distance into the square from one of its sides.
        let inside =
            |p: DVec2| if side % 2 == 0 { p[axis] - corner[axis] } else { corner[axis] + 1.0 - p[axis] };
        let mut out = Polygon { points: [DVec2::ZERO; 7], len: 0 };
        for i in 0..polygon.len {
            let (p, q) = (polygon.points[i], polygon.points[(i + 1) % polygon.len]);
            let (dp, dq) = (inside(p), inside(q));
            if dp >= 0.0 {
                out.points[out.len] = p;
                out.len += 1;
            }
            if (dp > 0.0 && dq < 0.0) || (dp < 0.0 && dq > 0.0) {
                out.points[out.len] = p.lerp(q, dp / (dp - dq));
                out.len += 1;
            }
        }
        polygon = out;
    }
    polygon
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::Face;
    use crate::trace::paths::{Sequence, SequenceKind};
    use glam::vec2;

    fn atlas(width: u32, height: u32, corners: &[[Vec2; 3]]) -> Atlas {
        let faces = corners
            .iter()
            .enumerate()
            .map(|(i, &corners)| Face { triangle: i as u32, corners, chart: 0 })
            .collect();
        Atlas::for_tests(width, height, faces)
    }

    #[test]
    fn fragments_cover_exactly_the_faces() {
        // Two triangles across several blocks: the fragments' areas add up to theirs, block by block.
        let a = atlas(
            150,
            70,
            &[
                [vec2(3.3, 2.2), vec2(140.1, 5.0), vec2(60.0, 66.6)],
                [vec2(60.0, 66.6), vec2(140.1, 5.0), vec2(149.9, 69.9)],
            ],
        );
        let bins = FaceBins::new(&a);
        let mut total = 0.0;
        for block in 0..bins.columns * bins.rows {
            let s = BlockSurface::new(&a, &bins, block);
            for texel in 0..s.width * s.height {
                if s.is_covered(texel) {
                    let area = s.fragments[s.starts[texel + 1] as usize - 1].cumulative;
                    assert!(area <= 1.0 + 1e-4);
                    total += f64::from(area);
                }
            }
        }
        let area: f32 = a
            .faces
            .iter()
            .map(|f| (f.corners[1] - f.corners[0]).perp_dot(f.corners[2] - f.corners[0]).abs() / 2.0)
            .sum();
        assert!((total - f64::from(area)).abs() < 0.05, "{total} {area}");
    }

    #[test]
    fn samples_keep_off_the_edges() {
        // A texel of which a triangle covers a hair: its points lie a hundredth of a texel inside the
        // triangle.
        let a = atlas(2, 2, &[[vec2(0.5, 0.5), vec2(1.01, 0.5), vec2(0.5, 1.6)]]);
        let s = BlockSurface::new(&a, &FaceBins::new(&a), 0);
        let texel = 1;
        assert!(s.is_covered(texel));
        let sequence = Sequence::new(1, SequenceKind::Texel, 0, 0);
        for i in 0..64 {
            let b = s.sample(&a, texel, sequence.sample(i).pair(0)).barycentric.as_dvec3();
            let corners = a.faces[0].corners.map(DVec2::from);
            let point = corners[0] * b.x + corners[1] * b.y + corners[2] * b.z;
            for k in 0..3 {
                let (p, q) = (corners[k], corners[(k + 1) % 3]);
                let away = (q - p).perp_dot(point - p) / (q - p).length();
                assert!(away > 0.99 * INSET, "{away} from edge {k}");
            }
        }
        // Slivers thinner than that keep their points inside them.
        let thin = [vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(0.0, 1e-4)];
        let b = inset(&thin, dvec3(0.0, 0.5, 0.5));
        assert!(b.min_element() > 0.0 && (b.element_sum() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_rim_is_the_outermost_corners_of_what_is_covered() {
        let rim = |corners: &[[Vec2; 3]]| {
            let a = atlas(1, 1, corners);
            let s = BlockSurface::new(&a, &FaceBins::new(&a), 0);
            let at = |p: SurfacePoint| {
                let [a, b, c] = a.faces[p.triangle as usize].corners;
                a * p.barycentric.x + b * p.barycentric.y + c * p.barycentric.z
            };
            s.rim(&a, 0).into_iter().map(at).collect::<Vec<Vec2>>()
        };
        let close = |rim: Vec<Vec2>, expected: &[[f32; 2]]| {
            assert_eq!(rim.len(), expected.len(), "{rim:?}");
            for corner in expected.iter().map(|c| Vec2::from_array(*c)) {
                assert!(rim.iter().any(|at| (*at - corner).length() < 0.05), "{corner} in {rim:?}");
            }
        };
        // Inside a large triangle; a triangle inside the texel, its corners in no diagonal direction.
        close(
            rim(&[[vec2(-4.0, -4.0), vec2(9.0, -4.0), vec2(-4.0, 9.0)]]),
            &[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]],
        );
        close(
            rim(&[[vec2(0.1, 0.5), vec2(0.9, 0.1), vec2(0.9, 0.9)]]),
            &[[0.1, 0.5], [0.9, 0.1], [0.9, 0.9]],
        );
    }

    #[test]
    fn samples_are_uniform_on_the_texel() {
        let a = atlas(
            1,
            1,
            &[
                [vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(0.0, 1.0)],
                [vec2(1.0, 0.0), vec2(1.0, 1.0), vec2(0.0, 1.0)],
            ],
        );
        let s = BlockSurface::new(&a, &FaceBins::new(&a), 0);
        let sequence = Sequence::new(1, SequenceKind::Texel, 0, 0);
        let mut count = [0u32; 16];
        let n = 16_000;
        for i in 0..n {
            let point = s.sample(&a, 0, sequence.sample(i).pair(0));
            let corners = a.faces[point.triangle as usize].corners;
            let b = point.barycentric;
            let p = corners[0] * b.x + corners[1] * b.y + corners[2] * b.z;
            count[((p.y * 4.0) as usize).min(3) * 4 + ((p.x * 4.0) as usize).min(3)] += 1;
        }
        // χ² with 15 degrees of freedom; low-discrepancy points stay far below the 0.1 % limit of 37.7.
        let chi2: f64 = count.iter().map(|&c| (f64::from(c) - 1000.0).powi(2) / 1000.0).sum();
        assert!(chi2 < 37.7, "{chi2}");
    }

    #[test]
    fn faces_without_area_give_no_fragments() {
        // Two faces of an interior as they came onto its page of 1024². Their corners lie on one line,
        // exactly; cut to a texel in single precision they seemed to have some area, and weights of their
        // corners were 0 ÷ 0.
        let line = |x: [u32; 3], y: u32| x.map(|x| vec2(f32::from_bits(x), f32::from_bits(y)));
        for corners in [
            line([1147740160, 1147741114, 1147857618], 1138376704),
            line([1120885699, 1120878060, 1119944704], 1138507776),
            [vec2(7.5, 7.5); 3],
            [vec2(1000.1, 3.3), vec2(1000.1, 3.3), vec2(1003.7, 9.1)],
        ] {
            let a = atlas(1024, 1024, &[corners]);
            let bins = FaceBins::new(&a);
            for block in bins.occupied() {
                assert_eq!(BlockSurface::new(&a, &bins, block).covered().count(), 0, "{corners:?}");
            }
        }
    }

    #[test]
    fn thin_faces_far_along_a_large_page_keep_their_area() {
        // A face 200 texels long and a few thousandths wide: its area is that of its exact corners.
        for width in [0.05, 0.01, 0.003] {
            let a =
                atlas(16384, 64, &[[vec2(16100.3, 30.5), vec2(16300.7, 30.5), vec2(16200.0, 30.5 + width)]]);
            let [p, q, r] = a.faces[0].corners.map(DVec2::from);
            let bins = FaceBins::new(&a);
            let mut total = 0.0;
            for block in bins.occupied() {
                let s = BlockSurface::new(&a, &bins, block);
                for texel in s.covered() {
                    total += f64::from(s.fragments[s.starts[texel + 1] as usize - 1].cumulative);
                    let point = s.sample(&a, texel, vec2(0.3, 0.6)).barycentric;
                    assert!(point.is_finite() && point.min_element() > 0.0, "{point}");
                }
            }
            let area = (q - p).perp_dot(r - p).abs() / 2.0;
            assert!((total / area - 1.0).abs() < 0.01, "{total} of {area}");
        }
    }
}
