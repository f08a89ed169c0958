//! Where triangles lie on the pages of a dataset.

use crate::atlas::Atlas;
use crate::geometry::{Geometry, LightmapPlace};
use dataset::format::Page;
use glam::Vec2;

/// Per triangle, its page and its corners there in texels; `None` where it has no texels.
pub(super) struct TriangleLayout(Vec<Option<(u32, [Vec2; 3])>>);

impl TriangleLayout {
    /// As an atlas has laid them out.
    pub(super) fn of_atlas(geometry: &Geometry, atlas: &Atlas) -> Self {
        let mut layout = vec![None; geometry.triangles.len()];
        for face in &atlas.faces {
            let page = atlas.page_of(face);
            let top = Vec2::new(0.0, atlas.page_rows(page).start as f32);
            layout[face.triangle as usize] = Some((page, face.corners.map(|corner| corner - top)));
        }
        TriangleLayout(layout)
    }

    /// As a geometry file tells them, for pages of these sizes. What the file leaves out has (0, 0) at all
    /// corners.
    pub(super) fn of_file(geometry: &Geometry, pages: &[Page]) -> Self {
        let mut layout = vec![None; geometry.triangles.len()];
        for instance in &geometry.instances {
            let LightmapPlace::At { page, scale, offset } = instance.lightmap_place else { continue };
            let Some(size) = pages.get(page as usize) else { continue };
            let size = Vec2::new(size.width as f32, size.height as f32);
            for triangle in instance.triangles.clone() {
                let uvs = geometry.triangles[triangle].map(|v| geometry.lightmap_uvs[v as usize]);
                if uvs != [Vec2::ZERO; 3] {
                    let corners = uvs.map(|uv| (Vec2::from(scale) * uv + Vec2::from(offset)) * size);
                    layout[triangle] = Some((page, corners));
                }
            }
        }
        TriangleLayout(layout)
    }

    /// The page of a triangle and its corners there.
    pub(super) fn of(&self, triangle: u32) -> Option<(usize, [Vec2; 3])> {
        self.0[triangle as usize].map(|(page, corners)| (page as usize, corners))
    }
}
