//! Instances that share a layout.

use super::*;
use glam::{DMat3, DQuat};

/// A seat on four legs under a back.
fn chair() -> Vec<[DVec3; 3]> {
    let mut triangles = cuboid(DVec3::new(0.0, 0.4, 0.0), DVec3::new(0.4, 0.05, 0.4));
    triangles.extend(cuboid(DVec3::new(0.0, 0.45, 0.0), DVec3::new(0.4, 0.5, 0.04)));
    for (x, z) in [(0.0, 0.0), (0.35, 0.0), (0.0, 0.35), (0.35, 0.35)] {
        triangles.extend(cuboid(DVec3::new(x, 0.0, z), DVec3::new(0.05, 0.4, 0.05)));
    }
    triangles
}

/// Places a mesh as the loader does: corners in world space, wound to have the front in front.
fn place(geometry: &mut Geometry, mesh: u32, triangles: &[[DVec3; 3]], linear: DMat3, at: DVec3) {
    let map = DAffine3 { matrix3: linear, translation: at };
    let corners = |t: &[DVec3; 3]| {
        let [a, b, c] = t.map(|p| map.transform_point3(p));
        if linear.determinant() < 0.0 { [a, c, b] } else { [a, b, c] }
    };
    let triangles: Vec<_> = triangles.iter().map(corners).collect();
    add(geometry, &triangles);
    let instance = geometry.instances.last_mut().unwrap();
    (instance.mesh, instance.world_from_mesh) = (mesh, map);
}

fn turn(x: f64, y: f64, z: f64) -> DMat3 {
    DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(x, y, z)))
}

/// A floor, four chairs of one shape, one that is wider, and a box.
pub(super) fn room() -> Geometry {
    let mut geometry = Geometry::default();
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let wide = DMat3::from_diagonal(DVec3::new(1.5, 1.0, 1.0));
    let chair = chair();
    place(&mut geometry, 0, &quad(DVec3::ZERO, DVec3::Z * 6.0, DVec3::X * 6.0), DMat3::IDENTITY, DVec3::ZERO);
    place(&mut geometry, 1, &chair, turn(0.0, 1.0, 0.0), DVec3::X);
    place(&mut geometry, 1, &chair, turn(0.3, 2.0, 0.1) * mirror, DVec3::X * 2.0);
    place(&mut geometry, 1, &chair, turn(0.0, 3.0, 0.7) * 0.5, DVec3::X * 3.0);
    place(&mut geometry, 1, &chair, wide, DVec3::X * 4.0);
    place(&mut geometry, 1, &chair, turn(1.0, 0.0, 0.0) * 2.0, DVec3::X * 5.0);
    place(&mut geometry, 2, &cuboid(DVec3::ZERO, DVec3::ONE), DMat3::IDENTITY, DVec3::ZERO);
    geometry
}

/// Every face's corners are the placement applied to the layout, mirrored ones in their order.
pub(super) fn check_placements(geometry: &Geometry, atlas: &Atlas) {
    let page = Vec2::new(atlas.width as f32, atlas.page_height as f32);
    assert_eq!(atlas.placements.len(), geometry.instances.len());
    for (instance, placement) in geometry.instances.iter().zip(&atlas.placements) {
        let [placement] = placement[..] else { panic!("{placement:?}") };
        let top = Vec2::new(0.0, atlas.page_rows(placement.page).start as f32);
        let Some(layout) = placement.layout.map(|l| &atlas.layouts[l as usize]) else {
            assert_eq!((placement.scale, placement.offset), ([1.0; 2], [0.0; 2]));
            continue;
        };
        let first = &geometry.instances[layout.instance as usize];
        let relative =
            instance.world_from_mesh.matrix3.determinant() * first.world_from_mesh.matrix3.determinant();
        let order = if relative < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
        let faces = atlas.faces.iter().filter(|f| instance.triangles.contains(&(f.triangle as usize)));
        let mut count = 0;
        for (face, (triangle, uvs)) in faces.zip(&layout.faces) {
            let offset = face.triangle as usize - instance.triangles.start;
            assert_eq!(offset, *triangle as usize - first.triangles.start);
            assert!(uvs.iter().all(|uv| uv.min_element() > 0.0 && uv.max_element() < 1.0));
            for k in 0..3 {
                let uv = Vec2::from(placement.scale) * uvs[order[k]] + Vec2::from(placement.offset);
                assert!(
                    (uv * page + top).distance(face.corners[k]) < 1e-3 * page.max_element() / 1024.0 + 1e-4
                );
            }
            count += 1;
        }
        assert_eq!(count, layout.faces.len());
    }
}

#[test]
fn chairs_share_a_layout() {
    let geometry = room();
    let sizes = [fixed(512, 512).size, fixed(900, 300).size, LightmapSize::TexelsPerMetre(60.0)];
    for (size, padding) in sizes.into_iter().flat_map(|s| [(s, 2), (s, 5)]) {
        let atlas = build(&geometry, &Lightmap { size, pages: 1, padding, ..Lightmap::default() }).unwrap();
        check(&geometry, &atlas, padding.into());
        check_placements(&geometry, &atlas);
        // The wide one has a layout of its own, that is, none that it shares.
        let layouts: Vec<_> = atlas.placements.iter().map(|p| p[0].layout).collect();
        assert_eq!(layouts, [None, Some(0), Some(0), Some(0), None, Some(0), None]);
        // One density for all, whatever their scale; the layout's scales go with the chairs'.
        let (low, high) = stretch(&geometry, &atlas);
        assert!(low > 0.999 && high < 1.001, "{low} … {high}");
        let scale = |i: usize| f64::from(atlas.placements[i][0].scale[0]);
        for (i, expected) in [(2, 1.0), (3, 0.5), (5, 2.0)] {
            assert!((scale(i) / scale(1) / expected - 1.0).abs() < 1e-5);
        }
    }
}

#[test]
fn density_scales_the_layout_too() {
    let mut geometry = room();
    geometry.instances[2].density = 1.5;
    let atlas = build(&geometry, &fixed(512, 512)).unwrap();
    check(&geometry, &atlas, 2);
    check_placements(&geometry, &atlas);
    let scale = |i: usize| atlas.placements[i][0].scale;
    assert!((scale(2)[1] / scale(1)[1] - 1.5).abs() < 1e-5);
    // A hundredfold scale would waste the page on padding: it shares with none.
    geometry.instances[5].density = 100.0;
    let atlas = build(&geometry, &fixed(512, 512)).unwrap();
    check(&geometry, &atlas, 2);
    check_placements(&geometry, &atlas);
    assert_eq!(atlas.placements[5][0].layout, None);
    assert_eq!(atlas.placements[2][0].layout, Some(0));
}

#[test]
fn equal_instances_are_equal_to_the_texel() {
    let mut geometry = Geometry::default();
    for i in 0..40 {
        place(&mut geometry, 0, &chair(), turn(0.0, f64::from(i), 0.0), DVec3::X * f64::from(i));
    }
    let atlas = build(&geometry, &fixed(512, 512)).unwrap();
    // Charts of layouts that nothing scales lie on blocks as all others do, and fill the page about as well.
    assert!(check(&geometry, &atlas, 2) > 0.3, "{}", atlas.utilisation);
    check_placements(&geometry, &atlas);
    let first = &atlas.faces[..geometry.instances[0].triangles.len()];
    for faces in atlas.faces.chunks_exact(first.len()) {
        let shift = faces[0].corners[0] - first[0].corners[0];
        assert!((shift / BLOCK as f32 - (shift / BLOCK as f32).round()).abs().max_element() < 1e-4);
        for (a, b) in faces.iter().zip(first) {
            assert!((0..3).all(|k| (a.corners[k] - b.corners[k]).distance(shift) < 1e-3));
        }
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = pool.install(|| build(&geometry, &fixed(512, 512)).unwrap());
    assert!(atlas.faces.iter().zip(&alone.faces).all(|(a, b)| a.corners == b.corners && a.chart == b.chart));
    assert_eq!(atlas.placements, alone.placements);
}

#[test]
fn small_pages_take_all_layouts() {
    let geometry = room();
    let triangles: usize = geometry.instances.iter().map(|i| i.triangles.len()).sum();
    for (width, height) in [(40, 40), (64, 40)] {
        let atlas = build(&geometry, &fixed(width, height)).unwrap();
        assert_eq!(atlas.faces.len() + atlas.degenerate, triangles);
        let inside = |c: &Vec2| c.min_element() > 0.0 && c.x < width as f32 && c.y < height as f32;
        assert!(atlas.faces.iter().flat_map(|face| &face.corners).all(inside));
    }
}
