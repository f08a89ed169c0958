//! How many tiles of the pages the scene's cameras see: what a game would have to hold of them, were it to load tiles on demand.

use crate::atlas::Atlas;
use crate::geometry::Geometry;
use crate::scene::Camera;
use crate::trace::lens::{Lens, NOWHERE};
use crate::trace::rays::Rays;
use dataset::tiles::TILE;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;

/// Pixels of the picture that is looked at.
const PICTURE: [u32; 2] = [480, 270];

/// The tiles of 128×128 texels that hold what a camera sees.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct View {
    /// The camera's name.
    pub camera: String,
    /// Tiles with at least one of 480 × 270 pixels.
    pub tiles: usize,
}

/// The views of these cameras, by a ray through the middle of every pixel.
pub fn views(cameras: &[Camera], geometry: &Geometry, atlas: &Atlas, rays: &Rays) -> Vec<View> {
    let mut face_of = vec![u32::MAX; geometry.triangles.len()];
    for (number, face) in atlas.faces.iter().enumerate() {
        face_of[face.triangle as usize] = number as u32;
    }
    let view = |camera: &Camera| {
        let lens = Lens::new(camera, geometry.origin, PICTURE);
        let tile = |x: u32, y: u32| {
            let direction = lens.direction(Vec2::new(x as f32, y as f32) + 0.5);
            let hit = rays.nearest(lens.origin, direction, NOWHERE)?;
            let face = atlas.faces.get(face_of[hit.triangle as usize] as usize)?;
            Some(tile_of(face.corners, hit.barycentric))
        };
        let row = |y: u32| (0..PICTURE[0]).filter_map(|x| tile(x, y)).collect::<BTreeSet<_>>();
        let rows: Vec<BTreeSet<[u32; 2]>> = (0..PICTURE[1]).into_par_iter().map(row).collect();
        let tiles = rows.into_iter().flatten().collect::<BTreeSet<_>>().len();
        View { camera: camera.name.clone(), tiles }
    };
    cameras.iter().map(view).collect()
}

/// Tiles that hold surface.
pub fn lit_tiles(atlas: &Atlas) -> usize {
    let of_face = |corners: [Vec2; 3]| {
        let tile = |corner: Vec2| [corner.x as u32 / TILE as u32, corner.y as u32 / TILE as u32];
        let (low, high) = (
            tile(corners.into_iter().fold(Vec2::INFINITY, Vec2::min)),
            tile(corners.into_iter().fold(Vec2::ZERO, Vec2::max)),
        );
        (low[1]..=high[1]).flat_map(move |y| (low[0]..=high[0]).map(move |x| [x, y]))
    };
    atlas.faces.iter().flat_map(|face| of_face(face.corners)).collect::<BTreeSet<_>>().len()
}

/// The views in words; `None` of a scene without cameras.
pub fn in_words(views: &[View], lit_tiles: usize) -> Option<String> {
    let named: Vec<String> = views.iter().map(|view| format!("{} {}", view.camera, view.tiles)).collect();
    (!views.is_empty())
        .then(|| format!("of {lit_tiles} tiles of {TILE} × {TILE} texels, cameras see: {}", named.join(", ")))
}

/// The tile of a point of a face.
fn tile_of([a, b, c]: [Vec2; 3], barycentric: Vec3) -> [u32; 2] {
    let texel = a * barycentric.x + b * barycentric.y + c * barycentric.z;
    [texel.x as u32 / TILE as u32, texel.y as u32 / TILE as u32]
}
