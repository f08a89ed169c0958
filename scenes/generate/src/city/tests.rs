//! The city against its files, its budget, and the eye: nobody in the streets, under the arcade or above the
//! roofs sees the back of a face or two faces that coincide.

use super::*;
use crate::checks;
use crate::mesh::Mesh;
use glam::DVec3;
use std::sync::LazyLock;

static CITY: LazyLock<Model> = LazyLock::new(model);

/// Whether the scene file gives a mesh texels, by its name.
fn is_lit(name: &str) -> bool {
    !name.contains("_detail") && !name.contains("_occluder") && !name.starts_with("leaves")
}

/// The groups of the scene file: name, lines up to the next group.
fn groups() -> Vec<(&'static str, &'static str)> {
    let file = include_str!("../../../city.toml");
    let parts = file.split("[[group]]\nname = \"").skip(1);
    parts.map(|part| part.split_once('"').expect("a quoted name")).collect()
}

/// The numbers of every line `key = …` of a group, in order.
fn points(group: &str, key: &str) -> Vec<DVec3> {
    let (_, lines) = groups().into_iter().find(|(name, _)| *name == group).expect("the group");
    lines
        .lines()
        .filter_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='))
        .map(|value| {
            let n: Vec<f64> = value.split(['[', ']', ',', ' ']).filter_map(|n| n.parse().ok()).collect();
            DVec3::new(n[0], n[1], n[2])
        })
        .collect()
}

/// Whether the places are the same up to rounding, in whatever order.
fn same_places(a: &[DVec3], b: &[DVec3]) -> bool {
    a.len() == b.len() && a.iter().all(|p| b.iter().any(|q| p.distance(*q) < 2e-3))
}

#[test]
fn the_committed_file_is_what_the_generator_writes() {
    checks::committed("city", &CITY, 12_000_000);
}

#[test]
fn the_file_is_valid_gltf() {
    checks::valid_gltf(&CITY);
}

#[test]
fn triangles_and_lit_area_keep_to_the_budget() {
    let placed = CITY.placed();
    let triangles: usize = placed.iter().map(|(_, _, mesh)| mesh.triangles.len()).sum();
    assert!((300_000..=700_000).contains(&triangles), "{triangles} triangles");
    let lit: f64 = placed.iter().filter(|(name, ..)| is_lit(name)).map(|(_, _, mesh)| mesh.area()).sum();
    assert!((8_000.0..16_000.0).contains(&lit), "{lit} m² with texels");
}

#[test]
fn triangles_are_sound() {
    checks::sound_triangles(&CITY, 1e-9);
}

#[test]
fn albedos_are_plausible() {
    checks::plausible_albedos(&CITY, 0.03, 0.85);
}

#[test]
fn bodies_of_several_meshes_are_closed() {
    let body = |prefix: &str, material: &str| {
        let all = CITY.meshes.iter().filter(|m| m.name.starts_with(prefix)).flat_map(|m| &m.primitives);
        all.filter(|(m, _)| CITY.materials[*m].name == material)
            .fold(Mesh::default(), |body, (_, mesh)| body.with(mesh.clone()))
    };
    // Their lit and their thin faces stand in different meshes.
    for (prefix, material) in [("balcony", "stucco"), ("bench", "oak"), ("shop_fashion", "green_wood")] {
        let body = body(prefix, material);
        assert!(body.volume() > 0.0, "{prefix} is missing or inside out");
        // A sign's front is in a mesh of its own.
        assert_eq!(body.is_closed(), prefix != "shop_fashion", "{prefix}");
    }
}

#[test]
fn the_streets_air_sees_no_backs_and_no_coinciding_faces() {
    // Over the avenue and the street between the parked cars, in the arcade, and above the roofs.
    for (low, high, rays, least) in [
        (DVec3::new(-3.2, 1.0, -40.0), DVec3::new(3.2, 12.0, 40.0), 6000, 3400),
        (DVec3::new(-40.0, 1.0, -3.6), DVec3::new(40.0, 8.0, 1.8), 6000, 3600),
        (DVec3::new(-43.0, 1.0, -10.4), DVec3::new(-21.0, 2.4, -9.0), 4000, 3870),
        (DVec3::new(-40.0, 26.0, -40.0), DVec3::new(40.0, 40.0, 40.0), 5000, 2000),
    ] {
        let hits = checks::no_backs_and_no_coinciding_faces(&CITY, rays, |random| {
            DVec3::new(random.range(low.x, high.x), random.range(low.y, high.y), random.range(low.z, high.z))
        });
        assert!(hits > least, "{hits} of {rays} hit");
    }
}

#[test]
fn the_scene_files_lamps_hang_in_the_lamps() {
    let [avenue, street] = lamps::places();
    assert_eq!((avenue.len(), street.len()), (12, 12));
    assert!(same_places(&points("street-dusk", "position"), &avenue));
    assert!(same_places(&points("street-evening", "centre"), &street));
    let arcade = points("street-dusk", "centre");
    assert_eq!(arcade.len(), 2 * arcade::BAYS);
    let placed = CITY.placed();
    for centre in [avenue, street, arcade].concat() {
        // A lantern or a bell is near, and nothing touches the lamp.
        let near = |limit: f64| {
            placed
                .iter()
                .filter(|(name, ..)| !name.starts_with("leaves"))
                .flat_map(|(_, _, mesh)| &mesh.positions)
                .any(|p| p.distance(centre) < limit)
        };
        assert!(near(0.4), "the lamp at {centre} hangs in the air");
        assert!(!near(0.1), "something touches the lamp at {centre}");
    }
}

#[test]
fn the_scene_files_shops_are_lit_in_their_windows() {
    let names: Vec<&str> = groups().iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["street-dusk", "street-evening", "bakeries", "displays", "cafes", "homes"]);
    let lamps = ["bakeries", "displays", "cafes"].map(|g| points(g, "corner").len());
    let alcove = CITY.meshes.iter().position(|m| m.name == "alcove").expect("alcoves");
    let alcoves: Vec<DVec3> = CITY.nodes.iter().filter(|n| n.mesh == alcove).map(|n| n.translation).collect();
    assert_eq!(lamps.iter().sum::<usize>(), alcoves.len());
    for group in ["bakeries", "displays", "cafes"] {
        let corners =
            points(group, "corner").into_iter().zip(points(group, "edge_u")).zip(points(group, "edge_v"));
        for ((corner, u), v) in corners {
            let middle = corner + (u + v) / 2.0;
            let near = alcoves.iter().any(|a| DVec3::new(middle.x - a.x, 0.0, middle.z - a.z).length() < 0.5);
            assert!(near, "{group}: no shop at {middle}");
            assert!(u.cross(v).y < 0.0, "{group}: the lamp at {middle} shines up");
        }
    }
}
