//! Where paths read the light of surfaces: one ray then carries all bounces of the whole day. (What they
//! read: `cache_half`.)
//!
//! Lightmapped surfaces have an entry per square of 1, 2 or 4 texels' side (charts start on 4-texel
//! boundaries, so that a square hardly ever mixes two; those of scaled shared layouts may). On pages so large
//! that these are too many, the squares of 4 texels that lie together and are of one chart share an entry.
//! What has no texels (other triangles, and the backs of two-sided ones) is cut into patches about 4 entries
//! long, or 16 where there would be too many.

use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use crate::geometry::Geometry;
use crate::surface::SurfacePoint;
use crate::trace::counts::RayCounts;
use crate::trace::rays::Hit;
use crate::trace::solids::{Receiver, Space};
use glam::{Vec2, Vec3};
use std::collections::BTreeMap;

/// No entry, no face.
const NONE: u32 = u32::MAX;
/// Length of a patch in sides of an entry.
const PATCH: f64 = 4.0;
/// log₂ of the side in texels of the largest squares: those of larger entries are put together, chart by
/// chart.
const LARGEST_SQUARE: u32 = 2;
/// Most patches along a side of a triangle: larger ones are not cached, paths go on from them.
const MOST_ALONG: u32 = 16;

/// Where a point of a surface finds its entry.
pub struct CacheMap<'a> {
    atlas: &'a Atlas,
    /// Per triangle of the geometry, its face of the atlas.
    face_of: Vec<u32>,
    /// log₂ of the side of an entry in texels.
    shift: u32,
    /// log₂ of the side of a square in texels.
    square_shift: u32,
    columns: usize,
    /// Per square of the page, its entry.
    entry_of: Vec<u32>,
    /// Entries of lightmapped surfaces, the first of all.
    squares: usize,
    /// The sides of triangles that are cut into patches.
    pieces: Vec<Piece>,
    /// Per triangle, the piece of its front and of its back.
    piece_of: Vec<[u32; 2]>,
    entries: usize,
    /// Points of entries whose square reaches across a wall, on the side that the entry stands for.
    surface_points: Vec<Vec<Receiver>>,
    /// Per square, its index in `surface_points`; empty while there are none.
    points_of: Vec<u32>,
}

/// One side of a triangle, cut into patches: cells of a grid of `along`² in barycentric coordinates.
#[derive(Clone, Copy, Debug)]
struct Piece {
    triangle: u32,
    is_back: bool,
    along: u32,
    /// Its first entry.
    first: u32,
}

/// A patch: a cell (i, j) of a side of a triangle, i + j < along.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Its entry.
    pub entry: u32,
    /// The triangle.
    pub triangle: u32,
    /// Which side of it.
    pub is_back: bool,
    along: u32,
    cell: [u32; 2],
}

impl Patch {
    /// A point of it, uniformly distributed for `u` in [0, 1)².
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let at = |u: Vec2| (Vec2::new(self.cell[0] as f32, self.cell[1] as f32) + u) / self.along as f32;
        let mut b = at(u);
        // The far half of a cell on the edge lies outside: it is turned onto the near one.
        if b.x + b.y > 1.0 {
            b = at(Vec2::ONE - u);
        }
        Vec3::new((1.0 - b.x - b.y).max(0.0), b.x, b.y)
    }
}

impl<'a> CacheMap<'a> {
    /// A map of the squares with side 2^`shift` that hold one of the `covered` texels (page indices, in the
    /// order in which entries are to be numbered), and of patches where they are not too many: no more than
    /// make `most` entries in all.
    pub fn new(
        atlas: &'a Atlas,
        geometry: &Geometry,
        (shift, most): (u32, usize),
        covered: impl Iterator<Item = usize>,
    ) -> Self {
        let triangles = geometry.triangles.len();
        let mut face_of = vec![NONE; triangles];
        for (i, face) in atlas.faces.iter().enumerate() {
            face_of[face.triangle as usize] = i as u32;
        }
        let square_shift = shift.min(LARGEST_SQUARE);
        let columns = (atlas.width as usize).div_ceil(1 << square_shift);
        let rows = (atlas.height as usize).div_ceil(1 << square_shift);
        let entry_of = vec![NONE; columns * rows];
        let piece_of = vec![[NONE; 2]; triangles];
        let mut map = CacheMap {
            atlas,
            face_of,
            shift,
            square_shift,
            columns,
            entry_of,
            squares: 0,
            pieces: Vec::new(),
            piece_of,
            entries: 0,
            surface_points: Vec::new(),
            points_of: Vec::new(),
        };
        let owners = (shift > square_shift).then(|| Owners::new(atlas));
        // Of larger entries, those known by where they are and of which chart.
        let mut larger: BTreeMap<(usize, usize, Option<u32>), u32> = BTreeMap::new();
        for texel in covered {
            let (x, y) = (texel % atlas.width as usize, texel / atlas.width as usize);
            let square = map.square(x, y);
            if map.entry_of[square] != NONE {
                continue;
            }
            let next = map.squares as u32;
            let entry = match &owners {
                Some(owners) => *larger.entry((y >> shift, x >> shift, owners.of(x, y))).or_insert(next),
                None => next,
            };
            map.entry_of[square] = entry;
            map.squares += usize::from(entry == next);
        }
        map.entries = map.squares;
        map.cut(geometry, most);
        map
    }

    /// Cuts what has no texels into patches [`PATCH`] entries long, or 4 times as long: the shorter of the
    /// two with which there are no more entries in all than a million, or twice the squares; else into none.
    /// Where patches are few they are shorter, down to an eighth: a room without texels amid large ones is
    /// not lit by the mean of its walls. There are never more than `limit` entries.
    fn cut(&mut self, geometry: &Geometry, limit: usize) {
        let most = (2 * self.squares).max(1 << 20).min(limit);
        let length = PATCH * self.entry_length();
        let few = (self.squares + self.squares / 2).min(limit);
        let finer = [8, 4, 2].map(|part| (length, part, few));
        for (length, part, most) in finer.into_iter().chain([(length, 1, most), (4.0 * length, 1, most)]) {
            let (pieces, entries) = self.pieces_of(geometry, length, part);
            if entries <= most {
                for (i, piece) in pieces.iter().enumerate() {
                    self.piece_of[piece.triangle as usize][usize::from(piece.is_back)] = i as u32;
                }
                (self.pieces, self.entries) = (pieces, entries);
                return;
            }
        }
    }

    /// The sides without texels, cut into patches no longer than `length`, where that makes at most
    /// [`MOST_ALONG`]; these into up to `part` times as many along each side. And the number of entries there
    /// would be.
    fn pieces_of(&self, geometry: &Geometry, length: f64, part: u32) -> (Vec<Piece>, usize) {
        let (mut pieces, mut entries) = (Vec::new(), self.squares);
        // No path is reflected by clear glass.
        let is_clear = |material: usize| {
            geometry.glass_of(material as u32).is_some() && geometry.reflects_at_most(material) == 0.0
        };
        let clear: Vec<bool> = match geometry.has_glass() {
            true => (0..geometry.materials.len()).map(is_clear).collect(),
            false => Vec::new(),
        };
        for triangle in 0..geometry.triangles.len() {
            if clear.get(geometry.material_of[triangle] as usize).is_some_and(|&clear| clear) {
                continue;
            }
            let material = &geometry.materials[geometry.material_of[triangle] as usize];
            let along = (geometry.longest_edge(triangle) / length).ceil().max(1.0);
            if along > f64::from(MOST_ALONG) {
                continue;
            }
            let fine = (geometry.longest_edge(triangle) * f64::from(part) / length).ceil().max(1.0);
            let along = fine.min(f64::from(MOST_ALONG)) as u32;
            for is_back in [false, true] {
                let has_texels = !is_back && self.face_of[triangle] != NONE;
                if !has_texels && (!is_back || material.two_sided) {
                    pieces.push(Piece { triangle: triangle as u32, is_back, along, first: entries as u32 });
                    entries += (along * (along + 1) / 2) as usize;
                }
            }
        }
        (pieces, entries)
    }

    fn square(&self, x: usize, y: usize) -> usize {
        (y >> self.square_shift) * self.columns + (x >> self.square_shift)
    }

    /// Says that a texel reaches across a wall, and gives a few points of the side it stands for. Only what
    /// they see is that side: see [`CacheMap::entry`]. An entry of several texels is taken out: paths that
    /// land there go on.
    pub fn split(&mut self, texel: usize, surface_points: Vec<Receiver>) {
        let width = self.atlas.width as usize;
        let square = self.square(texel % width, texel / width);
        if self.shift == 0 && !surface_points.is_empty() {
            self.points_of.resize(self.squares, NONE);
            self.points_of[self.entry_of[square] as usize] = self.surface_points.len() as u32;
            self.surface_points.push(surface_points);
        } else {
            self.entry_of[square] = NONE;
        }
    }

    /// The entry of a point on the front or the back of a surface, on this side of any wall; `None` where
    /// there is none.
    pub fn entry(&self, space: &Space, hit: &Hit, is_back: bool, counts: &mut RayCounts) -> Option<u32> {
        let entry = self.of_hit(hit, is_back)?;
        let place = self.points_of.get(entry as usize).copied().unwrap_or(NONE);
        let Some(surface_points) = self.surface_points.get(place as usize) else { return Some(entry) };
        let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
        let at = space.receiver_on(&point, is_back)?;
        // The nearest one most likely sees the place.
        let away = |i: &usize| surface_points[*i].distance_squared(&at);
        let nearest = (0..surface_points.len()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        let mut sees = |i: usize| space.sees(&surface_points[i], &at, counts);
        (sees(nearest) || (0..surface_points.len()).any(|i| i != nearest && sees(i))).then_some(entry)
    }

    /// Length of the side of an entry in metres, on surfaces of the page's density.
    pub fn entry_length(&self) -> f64 {
        f64::from(1u32 << self.shift) / self.atlas.texels_per_metre
    }

    /// Length of the side of those entries that a side of a triangle has, in metres.
    pub fn length_on(&self, geometry: &Geometry, triangle: u32, is_back: bool) -> f64 {
        let triangle = triangle as usize;
        let piece = self.piece_of[triangle][usize::from(is_back)];
        if piece != NONE {
            return geometry.longest_edge(triangle) / f64::from(self.pieces[piece as usize].along);
        }
        let face = self.face_of[triangle];
        if face == NONE || is_back {
            return self.entry_length();
        }
        // Objects may have texels of their own density. (The longest edge: short ones are mostly rounding.)
        let (corners, page) = (geometry.corners(triangle), self.atlas.faces[face as usize].corners);
        let edges = [(0, 1), (1, 2), (2, 0)]
            .map(|(a, b)| (corners[a].distance(corners[b]), page[a].distance(page[b])));
        let [length, texels] = edges
            .into_iter()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map_or([0.0; 2], |(a, b)| [a, b].map(f64::from));
        if texels > 0.0 { f64::from(1u32 << self.shift) * length / texels } else { self.entry_length() }
    }

    /// Whether a side of a triangle has entries.
    pub fn holds(&self, triangle: u32, is_back: bool) -> bool {
        let triangle = triangle as usize;
        self.piece_of[triangle][usize::from(is_back)] != NONE || (!is_back && self.face_of[triangle] != NONE)
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.entries
    }

    /// Entries of lightmapped surfaces.
    pub fn squares(&self) -> usize {
        self.squares
    }

    /// Patches: the other entries.
    pub fn patches(&self) -> usize {
        self.entries - self.squares
    }

    /// All patches, by ascending entry.
    pub fn all_patches(&self) -> Vec<Patch> {
        let of_piece = |p: &Piece| {
            let (piece, cells) =
                (*p, (0..p.along).flat_map(|i| (0..p.along - i).map(move |j| [i, j])).collect::<Vec<_>>());
            cells.into_iter().enumerate().map(move |(k, cell)| Patch {
                entry: piece.first + k as u32,
                triangle: piece.triangle,
                is_back: piece.is_back,
                along: piece.along,
                cell,
            })
        };
        self.pieces.iter().flat_map(of_piece).collect()
    }

    /// The entry of a texel of the page.
    pub fn of_texel(&self, texel: usize) -> Option<u32> {
        let width = self.atlas.width as usize;
        let entry = self.entry_of[self.square(texel % width, texel / width)];
        (entry != NONE).then_some(entry)
    }

    /// The entry of a point on the front or the back of a surface, whatever stands on it; `None` where there
    /// is none.
    pub fn of_hit(&self, hit: &Hit, is_back: bool) -> Option<u32> {
        let piece = self.piece_of[hit.triangle as usize][usize::from(is_back)];
        if piece != NONE {
            let piece = &self.pieces[piece as usize];
            let n = piece.along;
            let i = ((hit.barycentric.y * n as f32) as u32).min(n - 1);
            let j = ((hit.barycentric.z * n as f32) as u32).min(n - 1 - i);
            // Rows before i hold n, n − 1, … cells.
            return Some(piece.first + i * n - i * i.saturating_sub(1) / 2 + j);
        }
        let face = self.face_of[hit.triangle as usize];
        if face == NONE || is_back {
            return None;
        }
        let [a, b, c] = self.atlas.faces[face as usize].corners;
        let at: Vec2 = a * hit.barycentric.x + b * hit.barycentric.y + c * hit.barycentric.z;
        let x = (at.x.max(0.0) as usize).min(self.atlas.width as usize - 1);
        let y = (at.y.max(0.0) as usize).min(self.atlas.height as usize - 1);
        let entry = self.entry_of[self.square(x, y)];
        (entry != NONE).then_some(entry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::Face;
    use crate::geometry::Material;

    #[test]
    fn a_point_of_a_patch_is_found_there() {
        for along in [1u32, 2, 5, 16] {
            let piece = Piece { triangle: 0, is_back: true, along, first: 7 };
            let atlas = Atlas::for_tests(1, 1, Vec::new());
            let map = CacheMap {
                atlas: &atlas,
                face_of: vec![NONE],
                shift: 0,
                square_shift: 0,
                columns: 1,
                entry_of: vec![NONE],
                squares: 7,
                pieces: vec![piece],
                piece_of: vec![[NONE, 0]],
                entries: 7 + (along * (along + 1) / 2) as usize,
                surface_points: Vec::new(),
                points_of: Vec::new(),
            };
            let patches = map.all_patches();
            assert_eq!(patches.len(), map.entries() - 7);
            for patch in patches {
                for u in [Vec2::new(0.25, 0.3), Vec2::new(0.9, 0.8), Vec2::new(0.1, 0.95)] {
                    let barycentric = patch.sample(u);
                    assert!(barycentric.min_element() >= 0.0);
                    let hit = Hit { triangle: 0, barycentric, t: 1.0 };
                    assert_eq!(map.of_hit(&hit, true), Some(patch.entry));
                    assert_eq!(map.of_hit(&hit, false), None);
                }
            }
        }
    }

    #[test]
    fn large_entries_do_not_mix_charts() {
        // Two charts on a page of 32 × 16 texels, apart by a block of four texels: one entry of 16 texels
        // would hold both.
        let square = |x: f32, chart: u32, triangle: u32| {
            let corner = |dx: f32, y: f32| Vec2::new(x + dx, y);
            let (a, b, c, d) = (corner(0.5, 0.5), corner(0.5, 14.5), corner(6.5, 14.5), corner(6.5, 0.5));
            [[a, b, c], [a, c, d]].map(move |corners| Face {
                triangle: triangle + u32::from(corners[1] == c),
                corners,
                chart,
            })
        };
        let faces = [square(0.0, 0, 0), square(8.0, 1, 2), square(16.0, 1, 4)].concat();
        let atlas = Atlas { charts: 2, ..Atlas::for_tests(32, 16, faces) };
        let material = Material {
            albedo: Vec3::splat(0.5),
            albedo_max: 0.5,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: false,
            emission: None,
        };
        let geometry = Geometry {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Z],
            triangles: vec![[0, 1, 2]; 6],
            material_of: vec![0; 6],
            materials: vec![material],
            ..Geometry::default()
        };
        let of = |shift: u32| CacheMap::new(&atlas, &geometry, (shift, usize::MAX), atlas.touched());
        let (fine, large) = (of(2), of(4));
        assert_eq!(large.squares(), 3, "two charts in the first 16 texels, and one of them beyond");
        assert!(fine.squares() > 20);
        let [left, right, beyond] = [2, 10, 18].map(|x| large.of_texel(5 * 32 + x));
        assert!(left.is_some() && left != right && right != beyond && left != beyond);
        assert_eq!(large.of_texel(12 * 32 + 4), left);
        assert_eq!(large.entry_length(), 4.0 * fine.entry_length());
    }
}
