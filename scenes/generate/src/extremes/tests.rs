//! The stiff cases against their files: each is where the scene file expects it, and closed boxes are closed.

use super::*;
use crate::checks;
use std::sync::LazyLock;

static EXTREMES: LazyLock<Model> = LazyLock::new(model);

const SCENE: &str = include_str!("../../../extremes.toml");

/// The three numbers of a line `key = [a, b, c]` of the scene file, for every such line.
fn triples(key: &str) -> Vec<DVec3> {
    SCENE
        .lines()
        .filter_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='))
        .map(|value| {
            let n: Vec<f64> = value.split(['[', ']', ',', ' ']).filter_map(|n| n.parse().ok()).collect();
            DVec3::new(n[0], n[1], n[2])
        })
        .collect()
}

#[test]
fn the_committed_file_is_what_the_generator_writes() {
    checks::committed("extremes", &EXTREMES, 100_000);
}

#[test]
fn the_file_is_valid_gltf_with_a_node_per_case() {
    let gltf = checks::valid_gltf(&EXTREMES);
    let names: Vec<_> = gltf.nodes().filter_map(|n| n.name().map(str::to_owned)).collect();
    for case in [
        "keyhole_portal",
        "keyhole_bare",
        "mirror_wall",
        "black_wall",
        "bright_box",
        "dim_box",
        "blink_box",
        "dark_floor",
        "slivers",
        "tiny_emitter",
        "one_texel",
        "alpha_stack",
    ] {
        assert!(names.iter().any(|n| n == case), "no node `{case}`");
    }
}

#[test]
fn triangles_are_sound() {
    checks::sound_triangles(&EXTREMES, 4e-9);
}

#[test]
fn boxes_are_closed_and_keyholes_are_the_only_way_in() {
    for name in
        ["keyhole_portal", "keyhole_bare", "bright_box", "dim_box", "blink_box", "tiny_box", "mirror_box"]
    {
        // Inner faces end at the inner walls: from inside, every ray but one through the keyhole meets a
        // front.
        let centre = match name {
            "keyhole_portal" => KEYHOLE_PORTAL,
            "keyhole_bare" => KEYHOLE_BARE,
            "bright_box" => BRIGHT,
            "dim_box" => DIM,
            "blink_box" => BLINK,
            "tiny_box" => TINY,
            _ => MIRROR,
        };
        let hits = checks::no_backs_and_no_coinciding_faces(&EXTREMES, 400, |random| {
            DVec3::new(
                centre[0] + random.range(-0.8, 0.8),
                random.range(0.3, 1.9),
                centre[1] + random.range(-0.8, 0.8),
            )
        });
        assert_eq!(hits, 400, "{name} is open");
    }
}

#[test]
fn the_scene_files_portal_fills_one_keyhole() {
    let (corner, u, v) = (triples("corner"), triples("edge_u"), triples("edge_v"));
    assert_eq!((corner.len(), u[0], v[0]), (1, DVec3::X * KEYHOLE, DVec3::Y * KEYHOLE));
    let middle = corner[0] + (u[0] + v[0]) / 2.0;
    let hole =
        DVec3::new(KEYHOLE_PORTAL[0], KEYHOLE_HEIGHT + KEYHOLE / 2.0, KEYHOLE_PORTAL[1] + HALF + THIN / 2.0);
    assert!(middle.distance(hole) < 1e-9, "{middle} is not {hole}");
}

#[test]
fn lamps_hang_in_their_boxes_and_differ_by_ten_to_the_eighth() {
    let inside = |p: DVec3, [x, z]: [f64; 2]| {
        (p.x - x).abs() < HALF && (p.z - z).abs() < HALF && p.y > FLOOR && p.y < CEILING
    };
    let (points, spheres) = (triples("position"), triples("centre"));
    // Cameras come after the lamps.
    assert!(inside(points[0], BRIGHT) && inside(points[1], DIM), "{points:?}");
    assert!(inside(spheres[0], MIRROR) && inside(spheres[1], BLINK), "{spheres:?}");
    let intensities = triples("intensity");
    assert!((intensities[0] / intensities[1] / 1e8 - 1.0).length() < 1e-9, "{intensities:?}");
}
