//! The farm against its file, its budget, and the eye: nobody in the yard, the fields or the barn sees the
//! back of a face or two faces that coincide, and nothing floats.

use super::*;
use crate::checks;
use crate::mesh::Mesh;
use glam::DVec3;
use std::sync::LazyLock;

static FARM: LazyLock<Model> = LazyLock::new(model);

/// Whether the scene file gives a mesh texels, by its name.
fn is_lit(name: &str) -> bool {
    let cards = ["leaves_", "crops_", "tufts_"].iter().any(|cards| name.starts_with(cards));
    !name.contains("_detail") && !name.contains("_occluder") && !cards
}

#[test]
fn the_committed_file_is_what_the_generator_writes() {
    checks::committed("farmland", &FARM, 8_000_000);
}

#[test]
fn the_file_is_valid_gltf() {
    let gltf = checks::valid_gltf(&FARM);
    let cut_out: Vec<_> =
        gltf.materials().filter(|m| m.alpha_mode() == gltf::material::AlphaMode::Mask).collect();
    assert_eq!(cut_out.len(), 8);
    assert!(cut_out.iter().all(|m| m.double_sided() && m.alpha_cutoff() == Some(0.5)));
}

#[test]
fn triangles_and_lit_area_keep_to_the_budget() {
    let placed = FARM.placed();
    let triangles: usize = placed.iter().map(|(_, _, mesh)| mesh.triangles.len()).sum();
    assert!((200_000..=600_000).contains(&triangles), "{triangles} triangles");
    let lit: f64 = placed.iter().filter(|(name, ..)| is_lit(name)).map(|(_, _, mesh)| mesh.area()).sum();
    assert!((17_000.0..21_000.0).contains(&lit), "{lit} m² with texels");
}

#[test]
fn the_scene_file_has_no_lamps() {
    let scene = include_str!("../../../farmland.toml");
    assert!(!scene.contains("group"), "a group in farmland.toml");
    assert!(scene.contains("[sun]") && scene.contains("hosek-wilkie"));
}

#[test]
fn names_are_unique() {
    for names in [
        FARM.meshes.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(),
        FARM.nodes.iter().map(|n| n.name.as_str()).collect(),
        FARM.materials.iter().map(|m| m.name).collect(),
    ] {
        let mut sorted = names.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), names.len());
    }
}

#[test]
fn triangles_are_sound() {
    checks::sound_triangles(&FARM, 1e-9);
}

#[test]
fn albedos_are_plausible() {
    checks::plausible_albedos(&FARM, 0.05, 0.85);
}

#[test]
fn bodies_of_several_meshes_are_closed() {
    for parts in
        [&["bale_round"][..], &["gate_detail"], &["pallet_detail"], &["fences_detail"], &["stone_1_detail"]]
    {
        let all = FARM.meshes.iter().filter(|m| parts.contains(&m.name.as_str()));
        let body =
            all.flat_map(|m| &m.primitives).fold(Mesh::default(), |body, (_, mesh)| body.with(mesh.clone()));
        assert!(body.is_closed() && body.volume() > 0.0, "{parts:?}");
    }
}

#[test]
fn what_is_placed_many_times_reaches_into_the_ground() {
    let mut seen = 0;
    for (name, _, mesh) in FARM.placed() {
        let strewn = [
            "bale_round",
            "hedge_",
            "bush_",
            "oak_detail",
            "apple_",
            "poplar_",
            "birch_",
            "stone_",
            "crops_",
            "tufts_",
        ];
        // Another's name begins like a stone's.
        if !strewn.iter().any(|s| name.starts_with(s)) || name.starts_with("stone_wall") {
            continue;
        }
        let low = mesh.positions.iter().copied().min_by(|a, b| a.y.total_cmp(&b.y)).expect("a vertex");
        // The ground's bumps reach 10 cm above the hills.
        let above = low.y - terrain::hills(low.x, low.z);
        assert!(above < 0.1, "{name} floats {above} m above {low}");
        seen += 1;
    }
    assert!(seen > 1000, "{seen} things");
}

#[test]
fn the_farms_air_sees_no_backs_and_no_coinciding_faces() {
    // The yard, the fields from a tree's height, and the barn's inside.
    for (low, high, rays) in [
        (DVec3::new(-6.0, 3.4, -1.0), DVec3::new(6.0, 6.0, 20.0), 1500),
        (DVec3::new(-60.0, 16.0, -60.0), DVec3::new(60.0, 20.0, 60.0), 1000),
        (DVec3::new(-16.5, 1.9, -9.0), DVec3::new(-10.5, 3.4, -4.0), 1000),
    ] {
        let hits = checks::no_backs_and_no_coinciding_faces(&FARM, rays, |random| {
            DVec3::new(random.range(low.x, high.x), random.range(low.y, high.y), random.range(low.z, high.z))
        });
        assert!(hits > rays * 2 / 5, "{hits} hits of {rays}");
    }
}
