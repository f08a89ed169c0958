//! Where light is gathered. Today that is at texels ([`SurfaceTexels`]). Anything else, such as points in the
//! air, implements [`Receivers`], and is sampled by the same code.
//!
//! Receivers lie on a page in blocks of [`BLOCK`]×[`BLOCK`] places, as texels do. Storage, threads and error
//! estimates use these blocks.

use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use crate::geometry::Geometry;
use crate::surface::{BLOCK, BlockSurface, FaceBins};
use crate::trace::rays::Hit;
use crate::trace::solids::{Receiver, Space};
use glam::{Vec2, Vec3};

/// Where light is gathered, on a page.
pub trait Receivers: Sync {
    /// Places across and down.
    fn size(&self) -> [usize; 2];

    /// The blocks that have any, ascending.
    fn blocks(&self) -> Vec<usize>;

    /// One block of them.
    fn block(&self, block: usize) -> ReceiverBlock<'_>;

    /// Which places belong together, as the texels of one chart do.
    fn owners(&self) -> Owners;

    /// Finds the place where a hit lies; `None` if there is none.
    fn place_finder(&self, geometry: &Geometry) -> PlaceFinder<'_>;

    /// Blocks across.
    fn columns(&self) -> usize {
        self.size()[0].div_ceil(BLOCK)
    }

    /// Blocks of the whole page.
    fn all_blocks(&self) -> usize {
        self.columns() * self.size()[1].div_ceil(BLOCK)
    }

    /// The block of a place.
    fn block_of(&self, x: usize, y: usize) -> usize {
        y / BLOCK * self.columns() + x / BLOCK
    }
}

/// Gives the column and row of the place that a hit lies at.
pub type PlaceFinder<'r> = Box<dyn Fn(&Hit) -> Option<[usize; 2]> + Sync + 'r>;

/// The points of the places of a block. A place is an index within its block, row by row.
pub trait PlacePoints {
    /// Whether light is gathered at a place.
    fn is_covered(&self, place: usize) -> bool;

    /// A point of a covered place: uniformly distributed for uniform `u`. `None` where light cannot arrive.
    fn receiver(&self, space: &Space, place: usize, u: Vec2) -> Option<Receiver>;

    /// The outermost points of a covered place: of a whole texel its corners.
    fn rim(&self, space: &Space, place: usize) -> Vec<Receiver>;

    /// The way from a covered place to the next in its row.
    fn along(&self, geometry: &Geometry, place: usize) -> Vec3;
}

/// A block of receivers.
pub struct ReceiverBlock<'r> {
    /// Left column of the block.
    pub x0: usize,
    /// Top row of the block.
    pub y0: usize,
    /// Places across (less than [`BLOCK`] at the page's edge).
    pub width: usize,
    /// Places down.
    pub height: usize,
    /// Places across the page.
    page_width: usize,
    points: Box<dyn PlacePoints + Sync + Send + 'r>,
}

impl<'r> ReceiverBlock<'r> {
    /// The places of a block of a page of this size, with these points.
    pub fn new(
        [page_width, page_height]: [usize; 2],
        block: usize,
        points: Box<dyn PlacePoints + Sync + Send + 'r>,
    ) -> Self {
        let columns = page_width.div_ceil(BLOCK);
        let (x0, y0) = (block % columns * BLOCK, block / columns * BLOCK);
        let (width, height) = (BLOCK.min(page_width - x0), BLOCK.min(page_height - y0));
        ReceiverBlock { x0, y0, width, height, page_width, points }
    }

    /// Whether light is gathered at a place.
    pub fn is_covered(&self, place: usize) -> bool {
        self.points.is_covered(place)
    }

    /// The places at which light is gathered, ascending.
    pub fn covered(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.width * self.height).filter(|&place| self.is_covered(place))
    }

    /// The index of a place on the page, row by row.
    pub fn page_index(&self, place: usize) -> usize {
        (self.y0 + place / self.width) * self.page_width + self.x0 + place % self.width
    }

    /// As [`PlacePoints::receiver`].
    pub fn receiver(&self, space: &Space, place: usize, u: Vec2) -> Option<Receiver> {
        self.points.receiver(space, place, u)
    }

    /// As [`PlacePoints::rim`].
    pub fn rim(&self, space: &Space, place: usize) -> Vec<Receiver> {
        self.points.rim(space, place)
    }

    /// As [`PlacePoints::along`].
    pub fn along(&self, geometry: &Geometry, place: usize) -> Vec3 {
        self.points.along(geometry, place)
    }
}

/// The texels of an atlas.
pub struct SurfaceTexels<'a> {
    atlas: &'a Atlas,
    bins: FaceBins,
}

impl<'a> SurfaceTexels<'a> {
    /// All of them.
    pub fn new(atlas: &'a Atlas) -> Self {
        SurfaceTexels { atlas, bins: FaceBins::new(atlas) }
    }
}

impl Receivers for SurfaceTexels<'_> {
    fn size(&self) -> [usize; 2] {
        [self.atlas.width as usize, self.atlas.height as usize]
    }

    fn blocks(&self) -> Vec<usize> {
        self.bins.occupied()
    }

    fn block(&self, block: usize) -> ReceiverBlock<'_> {
        let surface = BlockSurface::new(self.atlas, &self.bins, block);
        ReceiverBlock::new(self.size(), block, Box::new(TexelPoints { atlas: self.atlas, surface }))
    }

    fn owners(&self) -> Owners {
        Owners::new(self.atlas)
    }

    fn place_finder(&self, geometry: &Geometry) -> PlaceFinder<'_> {
        let atlas = self.atlas;
        let mut face_of = vec![u32::MAX; geometry.triangles.len()];
        for (i, face) in (0..).zip(&atlas.faces) {
            face_of[face.triangle as usize] = i;
        }
        Box::new(move |hit| {
            let [a, b, c] = atlas.faces.get(face_of[hit.triangle as usize] as usize)?.corners;
            let at = a * hit.barycentric.x + b * hit.barycentric.y + c * hit.barycentric.z;
            let clamped = |v: f32, size: u32| (v.max(0.0) as usize).min(size as usize - 1);
            Some([clamped(at.x, atlas.width), clamped(at.y, atlas.height)])
        })
    }
}

/// Those of a block.
struct TexelPoints<'a> {
    atlas: &'a Atlas,
    surface: BlockSurface,
}

impl PlacePoints for TexelPoints<'_> {
    fn is_covered(&self, texel: usize) -> bool {
        self.surface.is_covered(texel)
    }

    fn receiver(&self, space: &Space, texel: usize, u: Vec2) -> Option<Receiver> {
        space.receiver(&self.surface.sample(self.atlas, texel, u))
    }

    fn rim(&self, space: &Space, texel: usize) -> Vec<Receiver> {
        let rim = self.surface.rim(self.atlas, texel);
        rim.iter().filter_map(|at| space.receiver(at)).collect()
    }

    fn along(&self, geometry: &Geometry, texel: usize) -> Vec3 {
        self.surface.along(self.atlas, geometry, texel)
    }
}
