use crate::geometry::{self, Geometry, LightmapPlace};
use crate::scene::{self, Lightmap, LightmapSize, UvSource};
use crate::{Result, atlas};
use glam::Vec2;
use std::fmt::Write;

/// A scene of one OBJ with lightmap coordinates. Meshes are named; each has rectangles u0, v0, u1, v1 of the
/// page, v down, each of which is a square metre.
fn obj(meshes: &[(&str, &[[f64; 4]])]) -> String {
    let mut text = String::new();
    let mut z = 0.0;
    for (name, rectangles) in meshes {
        writeln!(text, "o {name}").unwrap();
        for [u0, v0, u1, v1] in *rectangles {
            z += 1.0;
            for (x, y, u, v) in [(0, 0, u0, v1), (1, 0, u1, v1), (1, 1, u1, v0), (0, 1, u0, v0)] {
                // v runs up in OBJ.
                writeln!(text, "v {x} {y} {z}\nvt {u} {}", 1.0 - v).unwrap();
            }
            text += "f -4/-4 -3/-3 -2/-2 -1/-1\n";
        }
    }
    text
}

fn load(obj: &str, keys: &str) -> Geometry {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.obj"), obj).unwrap();
    let text = format!("[[object]]\nfile = \"a.obj\"\n{keys}\n");
    std::fs::write(folder.path().join("scene.toml"), text).unwrap();
    geometry::load(&scene::load(&folder.path().join("scene.toml")).unwrap().0).unwrap().0
}

fn kept(width: u32, height: u32) -> Lightmap {
    let size = LightmapSize::Fixed { width, height };
    Lightmap { size, uv: UvSource::Keep, ..Lightmap::default() }
}

fn build(meshes: &[(&str, &[[f64; 4]])]) -> Result<atlas::Atlas> {
    atlas::build(&load(&obj(meshes), "vt = \"lightmap\""), &kept(64, 32))
}

/// The box around faces, in texels.
fn extent(faces: &[atlas::Face]) -> [f32; 4] {
    let corners = || faces.iter().flat_map(|f| f.corners);
    let low = corners().fold(Vec2::INFINITY, Vec2::min);
    let high = corners().fold(Vec2::NEG_INFINITY, Vec2::max);
    [low.x, low.y, high.x, high.y]
}

#[test]
fn coordinates_are_places_on_a_page_of_any_size() {
    let geometry = load(&obj(&[("a", &[[0.25, 0.5, 0.75, 1.0]])]), "vt = \"lightmap\"");
    for (width, height) in [(64, 32), (128, 64), (21, 21)] {
        let atlas = atlas::build(&geometry, &kept(width, height)).unwrap();
        let (w, h) = (width as f32, height as f32);
        assert_eq!(extent(&atlas.faces), [0.25 * w, 0.5 * h, 0.75 * w, h]);
        assert_eq!((atlas.width, atlas.height, atlas.pages, atlas.charts), (width, height, 1, 1));
        // The lower left corner of the surface, at its place: nothing is turned.
        let face = atlas.faces[0];
        let is_lower_left = |&k: &usize| {
            let p = geometry.corners(face.triangle as usize)[k];
            p.x < 0.0 && p.y < 0.0
        };
        let corner = (0..3).find(is_lower_left).unwrap();
        assert_eq!(face.corners[corner], Vec2::new(0.25 * w, h));
        // What ends at the page's edge lies on the page.
        assert!(atlas.faces.iter().all(|face| atlas.page_of(face) == 0));
        let per_metre = f64::from(width * height) / 4.0;
        assert!((atlas.texels_per_metre - per_metre.sqrt()).abs() < 1e-3);
        assert_eq!(atlas.warnings, [""; 0]);
    }
}

#[test]
fn the_first_of_triangles_that_overlap_has_the_texels() {
    let (first, second) = ([0.1, 0.1, 0.5, 0.5], [0.6, 0.1, 0.9, 0.5]);
    let atlas = build(&[("wall", &[first]), ("mirrored", &[first, second])]).unwrap();
    assert_eq!(atlas.faces.iter().map(|f| f.triangle).collect::<Vec<_>>(), [0, 1, 4, 5]);
    let [warning] = &atlas.warnings[..] else { panic!("{:?}", atlas.warnings) };
    assert!(
        warning.contains("2 triangles over others") && warning.contains("a.obj: mirrored: 2"),
        "{warning}"
    );
    assert!(warning.contains("u = 0.100, v = 0.100"), "{warning}");
    // Where they overlap a little, both have texels.
    let atlas = build(&[("wall", &[first]), ("beside", &[[0.45, 0.1, 0.9, 0.5]])]).unwrap();
    assert_eq!(atlas.faces.len(), 4);
    assert!(
        atlas.warnings.iter().any(|w| w.contains("partly over") && w.contains("beside")),
        "{:?}",
        atlas.warnings
    );
    // Side by side they do not overlap.
    let atlas = build(&[("wall", &[first, [0.5, 0.1, 0.9, 0.5]])]).unwrap();
    assert_eq!(atlas.faces.len(), 4);
    assert!(atlas.warnings.iter().all(|w| !w.contains("over others")), "{:?}", atlas.warnings);
}

#[test]
fn triangles_off_the_page_get_no_texels() {
    let inside = [0.1, 0.1, 0.5, 0.5];
    let atlas =
        build(&[("wall", &[inside, [0.6, 0.1, 1.2, 0.5]]), ("tiled", &[[0.0, -3.0, 1.0, 4.0]])]).unwrap();
    assert_eq!(atlas.faces.len(), 2);
    let [warning] = &atlas.warnings[..] else { panic!("{:?}", atlas.warnings) };
    for part in
        ["4 triangles outside the page", "a.obj: wall: 2 (the first at u = 0.600, v = 0.100)", "tiled: 2"]
    {
        assert!(warning.contains(part), "{warning}");
    }
    // Rounding is none: less than half a texel.
    let atlas = build(&[("wall", &[[-1e-3, 0.0, 1.001, 0.5]])]).unwrap();
    assert_eq!(extent(&atlas.faces), [0.0, 0.0, 64.0, 16.0]);
    // One without area on the page; and nothing on it.
    let atlas = build(&[("wall", &[inside]), ("point", &[[0.7, 0.7, 0.7, 0.7]])]).unwrap();
    assert!(atlas.notes[1].contains("without area on the page") && atlas.notes[1].contains("point"));
    let error = build(&[("tiled", &[[2.0, 0.0, 3.0, 1.0]])]).unwrap_err().to_string();
    assert!(error.contains("no triangle lies on the page") && error.contains("uv = \"auto\""), "{error}");
}

#[test]
fn islands_that_bilinear_filtering_mixes_are_told() {
    // On 64 × 32 texels: the first ends at column 16 and row 8, up to which the texels there are read for it.
    let first = [0.0, 0.0, 0.25, 0.25];
    let close = |second: [f64; 4]| {
        let atlas = build(&[("first", &[first]), ("second", &[second])]).unwrap();
        assert_eq!((atlas.faces.len(), atlas.charts), (4, 2));
        let told = atlas.warnings.iter().find(|w| w.contains("2 islands so near another"));
        assert!(
            told.is_none_or(|w| w.contains("a.obj: first: 1") && w.contains("a.obj: second: 1")),
            "{told:?}"
        );
        told.is_some()
    };
    let (texel, row) = (|x: f64| x / 64.0, |y: f64| y / 32.0);
    assert!(close([0.25, 0.0, 0.5, 0.25]));
    assert!(close([texel(16.6), 0.0, 0.5, 0.25]));
    assert!(close([texel(17.4), 0.0, 0.5, 0.25]));
    // From half a texel further on, as the baker's own charts lie.
    assert!(!close([texel(17.5), 0.0, 0.5, 0.25]));
    assert!(!close([texel(18.2), 0.0, 0.5, 0.25]));
    assert!(close([0.0, row(9.4), 0.25, 0.6]));
    assert!(!close([0.0, row(9.5), 0.25, 0.6]));
    // Across a corner.
    assert!(close([texel(17.4), row(9.4), 0.5, 0.6]));
    assert!(!close([texel(17.5), row(9.4), 0.5, 0.6]));
}

#[test]
fn placements_of_one_mesh_are_islands_of_their_own_though_they_meet_in_space() {
    // Two squares that share an edge, with equal coordinates along it.
    let square = |name: &str, x: [f64; 2], u: [f64; 2]| {
        let [[x0, x1], [u0, u1]] = [x, u];
        let corners = [(x0, 0, u0, 0), (x1, 0, u1, 0), (x1, 1, u1, 1), (x0, 1, u0, 1)];
        let corners = corners.map(|(x, y, u, v)| format!("v {x} {y} 0\nvt {u} {v}\n")).concat();
        format!("o {name}\n{corners}f -4/-4 -3/-3 -2/-2 -1/-1\n")
    };
    let text = square("left", [0.0, 1.0], [0.0, 1.0]) + &square("right", [1.0, 2.0], [1.0, 0.0]);
    let mut geometry = load(&text, "vt = \"lightmap\"");
    let charts = |geometry: &Geometry| atlas::build(geometry, &kept(64, 32)).unwrap().charts;
    for (instance, offset) in geometry.instances.iter_mut().zip([[0.0, 0.0], [0.5, 0.0]]) {
        instance.lightmap_place = LightmapPlace::At { page: 0, scale: [0.4, 0.8], offset };
    }
    assert_eq!(charts(&geometry), 2);
    // Where the edge lies at one place, they are one island.
    let mirrored = LightmapPlace::At { page: 0, scale: [-0.4, 0.8], offset: [0.8, 0.0] };
    geometry.instances[1].lightmap_place = mirrored;
    assert_eq!(charts(&geometry), 1);
}

#[test]
fn meshes_without_coordinates_are_all_listed() {
    let mut text = obj(&[("wall", &[[0.1, 0.1, 0.5, 0.5]])]);
    text += "o lamp\nv 0 0 9\nv 1 0 9\nv 0 1 9\nf -3 -2 -1\no vase\nv 0 0 9\nv 1 0 9\nv 0 1 9\nf -3 -2 -1\n";
    let error = atlas::build(&load(&text, "vt = \"lightmap\""), &kept(64, 64)).unwrap_err().to_string();
    for part in [
        "2 meshes have no lightmap coordinates",
        "a.obj: lamp, a.obj: vase;",
        "lightmap = false",
        "uv = \"auto\"",
    ] {
        assert!(error.contains(part), "{error}");
    }
    assert!(!error.contains("wall"), "{error}");
    // The remedy.
    let parts = "vt = \"lightmap\"\n[[object.part]]\nname = \"lamp\"\nlightmap = false\n\
                 [[object.part]]\nname = \"vase\"\nlightmap = false";
    assert_eq!(atlas::build(&load(&text, parts), &kept(64, 64)).unwrap().faces.len(), 2);
    // Without `vt`, all of them.
    let error = atlas::build(&load(&text, ""), &kept(64, 64)).unwrap_err().to_string();
    assert!(error.contains("3 meshes have no") && error.contains("a.obj: wall"), "{error}");
}
