//! The yard against its file, its budget, and the eye: nobody in the yard sees the back of a face or two
//! faces that coincide.

use super::*;
use crate::checks;
use crate::mesh::Mesh;
use glam::DVec3;
use std::sync::LazyLock;

static YARD: LazyLock<Model> = LazyLock::new(model);

/// Whether the scene file gives a mesh texels, by its name.
fn is_lit(name: &str) -> bool {
    !name.contains("_detail") && !name.contains("_occluder") && !name.starts_with("leaves")
}

#[test]
fn the_committed_file_is_what_the_generator_writes() {
    checks::committed("yard", &YARD, 3_000_000);
}

#[test]
fn the_file_is_valid_gltf() {
    let gltf = checks::valid_gltf(&YARD);
    let leaves =
        gltf.materials().find(|m| m.alpha_mode() == gltf::material::AlphaMode::Mask).expect("leaves");
    assert!(leaves.double_sided() && leaves.alpha_cutoff() == Some(0.5));
}

#[test]
fn triangles_and_lit_area_keep_to_the_budget() {
    let placed = YARD.placed();
    let triangles: usize = placed.iter().map(|(_, _, mesh)| mesh.triangles.len()).sum();
    assert!((20_000..=40_000).contains(&triangles), "{triangles} triangles");
    let lit: f64 = placed.iter().filter(|(name, ..)| is_lit(name)).map(|(_, _, mesh)| mesh.area()).sum();
    assert!((300.0..700.0).contains(&lit), "{lit} m² with texels");
}

#[test]
fn names_are_unique() {
    for names in [
        YARD.meshes.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(),
        YARD.nodes.iter().map(|n| n.name.as_str()).collect(),
        YARD.materials.iter().map(|m| m.name).collect(),
    ] {
        let mut sorted = names.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), names.len());
    }
}

#[test]
fn triangles_are_sound() {
    checks::sound_triangles(&YARD, 5e-8);
}

#[test]
fn bodies_of_several_meshes_are_closed() {
    // Their faces towards the light, the street and the ground stand in different meshes.
    for parts in [
        &["fence_bay", "fence_bay_detail", "fence_bay_occluder"][..],
        &["fence_end", "fence_end_detail", "fence_end_occluder"],
        &["garden_gate", "garden_gate_detail", "garden_gate_occluder"],
        &["drive_gate", "drive_gate_detail", "drive_gate_occluder"],
        &["coping", "coping_detail"],
        &["swing_seat", "swing_seat_detail"],
        &["bench", "bench_detail"],
        &["chair", "chair_detail"],
        &["swing_detail"],
    ] {
        let all = YARD.meshes.iter().filter(|m| parts.contains(&m.name.as_str()));
        let body =
            all.flat_map(|m| &m.primitives).fold(Mesh::default(), |body, (_, mesh)| body.with(mesh.clone()));
        assert!(body.is_closed() && body.volume() > 0.0, "{parts:?}");
    }
}

#[test]
fn albedos_are_plausible() {
    checks::plausible_albedos(&YARD, 0.03, 0.85);
}

#[test]
fn the_yards_air_sees_no_backs_and_no_coinciding_faces() {
    // From points above everything that stands around.
    let hits = checks::no_backs_and_no_coinciding_faces(&YARD, 1500, |random| {
        DVec3::new(random.range(-2.4, 3.0), random.range(2.2, 3.4), random.range(-2.0, 5.0))
    });
    assert!(hits > 700, "{hits} hits");
}

#[test]
fn lamps_hang_free_in_their_lanterns() {
    // The scene file puts a ball of 6 cm at this height in every lantern.
    let faces: Vec<_> = YARD.placed();
    for [x, z] in garden::LANTERNS {
        let centre = DVec3::new(x, 1.76, z);
        for (name, _, mesh) in &faces {
            for p in &mesh.positions {
                assert!((*p - centre).length() > 0.1, "{name} touches the lamp at {centre}");
            }
        }
    }
}
