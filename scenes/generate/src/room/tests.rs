//! The room against its files, its budget, and the eye: nobody in the room sees the back of a face, which
//! includes the outer walls' backs through a gap, or two faces that coincide.

use super::*;
use crate::checks;
use crate::mesh::Mesh;
use glam::DVec3;
use std::sync::LazyLock;

static ROOM: LazyLock<Model> = LazyLock::new(model);

/// Whether the scene file gives a mesh texels, by its name.
fn is_lit(name: &str) -> bool {
    !name.contains("_detail") && !name.contains("_occluder") && !name.starts_with("leaves")
}

/// The numbers of every line `key = …` of the scene file, in order.
fn numbers(key: &str) -> Vec<Vec<f64>> {
    include_str!("../../../room.toml")
        .lines()
        .filter_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='))
        .map(|value| value.split(['[', ']', ',', ' ']).filter_map(|n| n.parse().ok()).collect())
        .collect()
}

#[test]
fn the_committed_file_is_what_the_generator_writes() {
    checks::committed("room", &ROOM, 8_000_000);
}

#[test]
fn the_file_is_valid_gltf() {
    checks::valid_gltf(&ROOM);
}

#[test]
fn triangles_and_lit_area_keep_to_the_budget() {
    let placed = ROOM.placed();
    let triangles: usize = placed.iter().map(|(_, _, mesh)| mesh.triangles.len()).sum();
    assert!((60_000..=250_000).contains(&triangles), "{triangles} triangles");
    let lit: f64 = placed.iter().filter(|(name, ..)| is_lit(name)).map(|(_, _, mesh)| mesh.area()).sum();
    assert!((120.0..220.0).contains(&lit), "{lit} m² with texels");
}

#[test]
fn triangles_are_sound() {
    checks::sound_triangles(&ROOM, 1e-9);
}

#[test]
fn albedos_are_plausible() {
    checks::plausible_albedos(&ROOM, 0.03, 0.85);
}

#[test]
fn bodies_of_several_meshes_are_closed() {
    for parts in [
        &["curtains", "curtains_detail"][..],
        &["sofa", "sofa_detail"],
        &["pillows"],
        &["armchair", "armchair_detail"],
        &["table", "table_detail"],
        &["bookcase", "bookcase_detail"],
        &["sills", "sills_detail"],
        &["shades"],
        &["cup_detail"],
        &["plate_detail"],
        &["cover_red_detail"],
    ] {
        let all = ROOM.meshes.iter().filter(|m| parts.contains(&m.name.as_str()));
        let body =
            all.flat_map(|m| &m.primitives).fold(Mesh::default(), |body, (_, mesh)| body.with(mesh.clone()));
        // Tubes without caps end inside something else.
        assert!(parts[0] == "cup_detail" || body.is_closed(), "{parts:?} is open");
        assert!(body.volume() > 0.0, "{parts:?} is inside out");
    }
}

#[test]
fn the_rooms_air_sees_no_backs_and_no_coinciding_faces() {
    // From above the furniture, and from between it.
    for (low, high) in [
        (DVec3::new(-2.5, 1.95, -1.5), DVec3::new(2.5, 2.5, 1.7)),
        (DVec3::new(-0.2, 0.2, -1.4), DVec3::new(0.6, 1.8, 0.7)),
    ] {
        let hits = checks::no_backs_and_no_coinciding_faces(&ROOM, 2000, |random| {
            DVec3::new(random.range(low.x, high.x), random.range(low.y, high.y), random.range(low.z, high.z))
        });
        // All but what leaves through the windows.
        assert!(hits > 1900, "{hits} hits");
    }
}

#[test]
fn the_scene_files_portals_fill_the_windows() {
    let windows = windows::SOUTH_WINDOWS.map(|w| (walls::SOUTH, w)).into_iter();
    let windows: Vec<_> = windows.chain(windows::WEST_WINDOWS.map(|w| (walls::WEST, w))).collect();
    let (corners, us, vs) = (numbers("corner"), numbers("edge_u"), numbers("edge_v"));
    assert_eq!((corners.len(), us.len(), vs.len()), (windows.len(), windows.len(), windows.len()));
    let point = |n: &[f64]| DVec3::new(n[0], n[1], n[2]);
    for k in 0..windows.len() {
        let (a, u, v) = (point(&corners[k]), point(&us[k]), point(&vs[k]));
        let found = windows.iter().any(|(wall, [u0, v0, u1, v1])| {
            let (p, q) = (wall.at(*u0, *v0, THICK), wall.at(*u1, *v1, THICK));
            a.distance(p.min(q)) < 1e-9 && (a + u + v).distance(p.max(q)) < 1e-9
        });
        assert!(found, "no window fits the portal at {a}");
    }
}

#[test]
fn lamps_hang_free_in_their_shades() {
    let centres: Vec<DVec3> = numbers("centre").iter().map(|n| DVec3::new(n[0], n[1], n[2])).collect();
    assert_eq!(centres, lamps::LAMPS);
    for (name, _, mesh) in ROOM.placed() {
        for p in &mesh.positions {
            for centre in lamps::LAMPS {
                assert!(p.distance(centre) > 0.06, "{name} touches the lamp at {centre}");
            }
        }
    }
}
