//! Charts that meet along an edge of one surface agree across it: least-squares optimisation of the texels at
//! seams (Iwanicki, "Lighting technology of The Last of Us", SIGGRAPH 2013 talks).
//!
//! At points along both sides of every seam the bilinear samples are to be equal. Gutter texels are nearly
//! free to make them so; baked texels may move a little from their values. What is minimised is quadratic, so
//! its solution is linear in the image: layers may be stitched one by one and summed.
//!
//! Where a jump is noise, baked texels move by about half of their noise. Where it is not, because sunlight
//! or its shadow changes within a texel and the two sides average different parts of it, they move by more:
//! the mean of both sides hides the jump, but the step goes on in the texels behind the seam.

mod weld;
mod edges;
mod system;

use crate::atlas::Atlas;
use crate::geometry::Geometry;
use crate::surface::{BLOCK, BlockSurface, FaceBins};
use dataset::image::{Image, Mask};
use edges::SeamEdge;
use glam::Vec2;
use rayon::prelude::*;
use system::{Freedom, Point, System};

/// Points per texel along the longer side of a seam: bilinear samples along a line are parabolas between the
/// rows and columns of texel centres it crosses, less than three per texel.
const POINTS_PER_TEXEL: f32 = 3.0;
/// Price of moving a baked texel, per square, beside 1 for a jump along one texel of a seam. Where both sides
/// have only baked texels in reach, each moves by 1 / (2 + price) of the jump: a little less than to the mean
/// of both sides.
const PRICE_BAKED: f64 = 0.05;
/// Price of moving a gutter texel: low, and not zero, because one that a seam hardly reaches would have to
/// move by many times the jump.
const PRICE_GUTTER: f64 = 0.005;
/// Bilinear weights below this are rounding.
const LEAST_WEIGHT: f32 = 1e-4;

/// How far both sides of seams are apart, over all points of all seams and the three channels, relative to
/// the mean light there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Root of the mean square.
    pub rms: f64,
    /// Mean magnitude.
    pub mean: f64,
}

/// The seams of an atlas.
#[derive(Debug)]
pub struct Seams {
    width: usize,
    height: usize,
    edges: usize,
    system: System,
}

/// What lies under a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Texel {
    /// Baked.
    Valid,
    /// Surface that is not valid: inside a solid, or unlit by chance.
    Invalid,
    /// No surface.
    Gutter,
}

impl Seams {
    /// Finds the edges that two faces share in space, within a hundredth of a texel, but not on the page.
    /// Edges whose vertex normals differ by more than 15° between the faces are hard and keep their jump, as
    /// do edges with another surface standing on them. `mask` holds the valid texels; parts of seams where
    /// covered texels that are not valid weigh more than valid ones are left out, and such texels are never
    /// changed.
    ///
    /// # Panics
    /// If the mask is not of the atlas' size.
    pub fn new(geometry: &Geometry, atlas: &Atlas, mask: &Mask) -> Self {
        let (width, height) = (atlas.width as usize, atlas.height as usize);
        assert_eq!((mask.width, mask.height), (width, height), "width and height of the mask");
        let edges = edges::find(geometry, atlas);
        let mut points: Vec<Point> = Vec::new();
        for edge in &edges {
            add_points(edge, width, height, &mut points);
        }
        // Of the texels at seams that are not valid, those on surface.
        let mut invalid: Vec<u32> = points.iter().flat_map(|p| p.taps).map(|tap| tap.0).collect();
        invalid.retain(|&texel| !mask.valid[texel as usize]);
        invalid.par_sort_unstable();
        invalid.dedup();
        retain_covered(atlas, &mut invalid);
        let kind = |texel: u32| match () {
            _ if mask.valid[texel as usize] => Texel::Valid,
            _ if invalid.binary_search(&texel).is_ok() => Texel::Invalid,
            _ => Texel::Gutter,
        };
        points.retain(|point| {
            point.taps.chunks(4).all(|side| {
                let weight = |wanted: Texel| {
                    let taps = side.iter().filter(|tap| tap.1 != 0.0 && kind(tap.0) == wanted);
                    taps.map(|tap| tap.1.abs()).sum::<f32>()
                };
                let valid = weight(Texel::Valid);
                valid > 0.0 && valid >= weight(Texel::Invalid)
            })
        });
        let system = System::new(&points, |texel| match kind(texel) {
            Texel::Valid => Freedom::Free(PRICE_BAKED),
            Texel::Invalid => Freedom::Fixed,
            Texel::Gutter => Freedom::Free(PRICE_GUTTER),
        });
        Seams { width, height, edges: edges.len(), system }
    }

    /// Edges of the geometry that lie on the page twice.
    pub fn edges(&self) -> usize {
        self.edges
    }

    /// Texels at seams, baked ones and gutter, by their indices on the page.
    pub fn texels(&self) -> &[u32] {
        self.system.texels()
    }

    /// Stitches light, given at these texels after dilation: gutter texels change, and baked ones a little,
    /// so that both sides agree. Linear, save that negative results become zero; the same whatever the number
    /// of threads.
    pub fn stitched(&self, light: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.system.solve(light)
    }

    /// [`Seams::stitched`] within an image of the page.
    ///
    /// # Panics
    /// If the image is not of the atlas' size.
    pub fn stitch(&self, image: &mut Image) {
        let stitched = self.stitched(&self.light_of(image));
        self.texels().iter().zip(stitched).for_each(|(&texel, light)| image.texels[texel as usize] = light);
    }

    /// The light of an image at these texels.
    ///
    /// # Panics
    /// If the image is not of the atlas' size.
    pub fn light_of(&self, image: &Image) -> Vec<[f32; 3]> {
        assert_eq!((image.width, image.height), (self.width, self.height), "width and height of the image");
        self.texels().iter().map(|&texel| image.texels[texel as usize]).collect()
    }

    /// The jump across all seams; `None` where there are none, zero where there is no light.
    ///
    /// # Panics
    /// If the image is not of the atlas' size.
    pub fn jump(&self, image: &Image) -> Option<Jump> {
        self.jump_of(&self.light_of(image))
    }

    /// [`Seams::jump`] of the light at these texels.
    pub fn jump_of(&self, at_seams: &[[f32; 3]]) -> Option<Jump> {
        let (mut length, mut square, mut magnitude, mut light) = (0.0, 0.0, 0.0, 0.0);
        for (l, jump, sum) in self.system.jumps(at_seams) {
            length += l;
            square += l * jump.iter().map(|j| j * j).sum::<f64>();
            magnitude += l * jump.iter().map(|j| j.abs()).sum::<f64>();
            light += l * 0.5 * sum.iter().sum::<f64>();
        }
        if length == 0.0 {
            return None;
        }
        if light == 0.0 {
            return Some(Jump { rms: 0.0, mean: 0.0 });
        }
        Some(Jump { rms: (square * 3.0 * length).sqrt() / light, mean: magnitude / light })
    }
}

/// Points along an edge, evenly spaced.
fn add_points(edge: &SeamEdge, width: usize, height: usize, points: &mut Vec<Point>) {
    let lengths = edge.sides.map(|[a, b]| a.distance(b));
    let n = (POINTS_PER_TEXEL * lengths[0].max(lengths[1])).ceil().max(1.0) as usize;
    let length = 0.5 * (lengths[0] + lengths[1]) / n as f32;
    // An edge of no length on the page is no seam.
    if !(length > 0.0 && length.is_finite()) {
        return;
    }
    for i in 0..n {
        let t = (i as f32 + 0.5) / n as f32;
        let mut taps = [(0, 0.0); 8];
        for (side, [a, b]) in edge.sides.iter().enumerate() {
            for (tap, (texel, weight)) in
                taps[4 * side..].iter_mut().zip(bilinear(a.lerp(*b, t), width, height))
            {
                *tap = (texel, if side == 0 { weight } else { -weight });
            }
        }
        points.push(Point { taps, length });
    }
}

/// The texels under a point of the page, in texels, and their weights; beyond its rim the outermost texels go
/// on.
fn bilinear(p: Vec2, width: usize, height: usize) -> [(u32, f32); 4] {
    let p = p - 0.5;
    let f = p - p.floor();
    let clamp = |v: f32, n: usize| (v.max(0.0) as usize).min(n - 1);
    let (x0, x1) = (clamp(p.x.floor(), width), clamp(p.x.floor() + 1.0, width));
    let (y0, y1) = (clamp(p.y.floor(), height), clamp(p.y.floor() + 1.0, height));
    let weights = [(1.0 - f.x) * (1.0 - f.y), f.x * (1.0 - f.y), (1.0 - f.x) * f.y, f.x * f.y]
        .map(|weight| if weight < LEAST_WEIGHT { 0.0 } else { weight });
    // The rest sums to one again, so that even light has no jump.
    let sum: f32 = weights.iter().sum();
    let tap = |x: usize, y: usize, i: usize| ((y * width + x) as u32, weights[i] / sum);
    [tap(x0, y0, 0), tap(x1, y0, 1), tap(x0, y1, 2), tap(x1, y1, 3)]
}

/// Keeps the texels, ascending, under which there is surface.
fn retain_covered(atlas: &Atlas, texels: &mut Vec<u32>) {
    let width = atlas.width as usize;
    let bins = FaceBins::new(atlas);
    let block = |texel: u32| {
        let (x, y) = (texel as usize % width, texel as usize / width);
        y / BLOCK * bins.columns + x / BLOCK
    };
    texels.sort_by_key(|&texel| block(texel));
    let mut covered: Vec<u32> = texels
        .par_chunk_by(|&a, &b| block(a) == block(b))
        .flat_map_iter(|texels| {
            let surface = BlockSurface::new(atlas, &bins, block(texels[0]));
            texels.iter().copied().filter(move |&texel| {
                let (x, y) = (texel as usize % width, texel as usize / width);
                surface.is_covered((y - surface.y0) * surface.width + x - surface.x0)
            })
        })
        .collect();
    covered.sort_unstable();
    *texels = covered;
}
