//! How many tiles of the pages the scene's cameras see: what a game would have to hold of them, were it to
//! load tiles on demand.

use crate::atlas::Atlas;
use crate::geometry::Geometry;
use crate::scene::Camera;
use crate::trace::rays::{Lens, NO_TRIANGLE, RayTracer};
use dataset::format::TILE;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;

/// Pixels of the picture that is looked at.
const PICTURE: [u32; 2] = [480, 270];

/// Cameras that are looked through at most: the first.
const MOST_CAMERAS: usize = 16;

/// The tiles of 128×128 texels that hold what a camera sees.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct View {
    /// The camera's name.
    pub camera: String,
    /// Tiles with at least one of 480 × 270 pixels.
    pub tiles: usize,
}

/// The views of the first of these cameras, by a ray through the middle of every pixel. `tile_side`: the side
/// of a tile in texels of the atlas.
pub fn views(
    cameras: &[Camera],
    geometry: &Geometry,
    atlas: &Atlas,
    tile_side: usize,
    ray_tracer: &RayTracer,
) -> Vec<View> {
    let mut face_of = vec![u32::MAX; geometry.triangles.len()];
    for (number, face) in atlas.faces.iter().enumerate() {
        face_of[face.triangle as usize] = number as u32;
    }
    let view = |camera: &Camera| {
        let lens = Lens::new(camera, geometry.origin, PICTURE);
        let tile = |x: u32, y: u32| {
            let direction = lens.direction(Vec2::new(x as f32, y as f32) + 0.5);
            let hit = ray_tracer.nearest_wall(lens.origin, direction, NO_TRIANGLE)?;
            let face = atlas.faces.get(face_of[hit.triangle as usize] as usize)?;
            Some(tile_of(atlas, tile_side, face.corners, hit.barycentric))
        };
        let row = |y: u32| (0..PICTURE[0]).filter_map(|x| tile(x, y)).collect::<BTreeSet<_>>();
        let rows: Vec<BTreeSet<[u32; 2]>> = (0..PICTURE[1]).into_par_iter().map(row).collect();
        let tiles = rows.into_iter().flatten().collect::<BTreeSet<_>>().len();
        View { camera: camera.name.clone(), tiles }
    };
    cameras.iter().take(MOST_CAMERAS).map(view).collect()
}

/// Tiles of this side in texels that hold surface.
pub fn lit_tiles(atlas: &Atlas, side: usize) -> usize {
    let (width, across) = (atlas.width as usize, (atlas.width as usize).div_ceil(side));
    let mut lit = vec![false; across * (atlas.height as usize).div_ceil(side)];
    atlas.touched().for_each(|i| lit[i / width / side * across + i % width / side] = true);
    lit.into_iter().filter(|&lit| lit).count()
}

/// The views in words; `None` of a scene without cameras.
pub fn in_words(views: &[View], lit_tiles: usize) -> Option<String> {
    let named: Vec<String> = views.iter().map(|view| format!("{} {}", view.camera, view.tiles)).collect();
    let which = if views.len() == MOST_CAMERAS {
        format!("the first {MOST_CAMERAS} cameras")
    } else {
        "cameras".into()
    };
    (!views.is_empty())
        .then(|| format!("of {lit_tiles} tiles of {TILE} × {TILE} texels, {which} see: {}", named.join(", ")))
}

/// The tile of a point of a face.
fn tile_of(atlas: &Atlas, side: usize, [a, b, c]: [Vec2; 3], barycentric: Vec3) -> [u32; 2] {
    let texel = a * barycentric.x + b * barycentric.y + c * barycentric.z;
    // (A face that keeps its file's coordinates may end at the page's very edge.)
    let tile = |texel: f32, size: u32| (texel as u32).min(size - 1) / side as u32;
    [tile(texel.x, atlas.width), tile(texel.y, atlas.height)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::Face;
    use glam::{DVec3, vec2};

    #[test]
    fn a_camera_sees_the_tiles_in_front_of_it() {
        // A floor of 2 × 2 m on a page of 256 × 256, up to its edges; a camera above its first quarter, and
        // one that looks away.
        let mut geometry = Geometry::default();
        geometry.positions =
            [[0.0, 0.0], [0.0, 2.0], [2.0, 2.0], [2.0, 0.0]].map(|[x, z]| Vec3::new(x, 0.0, z)).to_vec();
        geometry.normals = vec![Vec3::Y; 4];
        geometry.triangles = vec![[0, 1, 2], [0, 2, 3]];
        geometry.material_of = vec![0, 0];
        geometry.uvs = vec![Vec2::ZERO; 4];
        geometry.lightmap_uvs = geometry.uvs.clone();
        geometry.materials = vec![crate::geometry::Material {
            albedo: Vec3::splat(0.5),
            albedo_max: 1.0,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: false,
            emission: None,
        }];
        let place = |v: u32| vec2(geometry.positions[v as usize].x, geometry.positions[v as usize].z) * 128.0;
        let faces = [0, 1].map(|t| Face {
            triangle: t,
            corners: geometry.triangles[t as usize].map(place),
            chart: 0,
        });
        let atlas = Atlas::for_tests(256, 256, faces.to_vec());
        assert_eq!(lit_tiles(&atlas, TILE), 4);
        let camera = |look_at: DVec3| Camera {
            name: "c".into(),
            position: DVec3::new(0.5, 0.3, 0.5),
            look_at,
            fov: 60.0,
        };
        let ray_tracer = RayTracer::new(&geometry);
        let cameras = [
            camera(DVec3::new(0.5, 0.0, 0.5)),
            camera(DVec3::new(0.5, 1.0, 0.5)),
            camera(DVec3::new(2.0, 0.0, 2.0)),
        ];
        let seen: Vec<usize> =
            views(&cameras, &geometry, &atlas, TILE, &ray_tracer).iter().map(|view| view.tiles).collect();
        assert_eq!(seen, [1, 0, 4]);
        let many = vec![camera(DVec3::ZERO); MOST_CAMERAS + 1];
        let many = views(&many, &geometry, &atlas, TILE, &ray_tracer);
        assert_eq!(many.len(), MOST_CAMERAS);
        assert!(in_words(&many, 4).is_some_and(|words| words.contains("the first 16 cameras see")));
        assert_eq!(tile_of(&atlas, TILE, atlas.faces[0].corners, Vec3::Z), [1, 1]);
    }
}
