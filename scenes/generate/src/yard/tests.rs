//! The yard against its file, its budget, and the eye: nobody in the yard sees the back of a face or two faces that
//! coincide.

use super::*;
use crate::mesh::Mesh;
use crate::random::Random;
use glam::DVec3;
use std::path::Path;
use std::sync::LazyLock;

static YARD: LazyLock<Model> = LazyLock::new(model);

/// Whether the scene file gives a mesh texels, by its name.
fn is_lit(name: &str) -> bool {
    !name.contains("_detail") && !name.contains("_occluder") && !name.starts_with("leaves")
}

#[test]
fn the_committed_file_is_what_the_generator_writes() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../yard.glb");
    let committed = std::fs::read(&path).expect("scenes/yard.glb");
    let written = crate::glb::write(&YARD);
    let same = committed.iter().zip(&written).take_while(|(a, b)| a == b).count();
    assert!(
        committed == written,
        "scenes/yard.glb differs from byte {same} on: run `cargo run -p generate -- yard`"
    );
    assert!(written.len() < 3_000_000, "{} bytes", written.len());
}

#[test]
fn the_file_is_valid_gltf() {
    let gltf = gltf::Gltf::from_slice(&crate::glb::write(&YARD)).expect("a valid GLB");
    assert_eq!(gltf.nodes().len(), YARD.nodes.len());
    let triangles: usize = gltf
        .nodes()
        .filter_map(|node| node.mesh())
        .flat_map(|mesh| mesh.primitives())
        .map(|p| p.indices().expect("indexed").count() / 3)
        .sum();
    let placed: usize = YARD.placed().iter().map(|(_, _, mesh)| mesh.triangles.len()).sum();
    assert_eq!(triangles, placed);
    let blob = gltf.blob.as_deref().expect("a binary chunk");
    for image in gltf.images() {
        let gltf::image::Source::View { view, .. } = image.source() else { panic!("an embedded image") };
        let bytes = &blob[view.offset()..view.offset() + view.length()];
        let pixels = image::load_from_memory(bytes).expect("a PNG").to_rgba8();
        assert_eq!(pixels.len(), 4 * YARD.textures[image.index()].rgba.len());
    }
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
fn vertices_are_finite_and_normals_agree_with_the_winding() {
    for (name, material, mesh) in YARD.placed() {
        assert!(mesh.positions.iter().all(|p| p.is_finite()), "{name}");
        assert!(mesh.uvs.iter().all(|uv| uv.is_finite()), "{name}");
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-9), "{name}");
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let n = (b - a).cross(c - a);
            assert!(n.length() > 1e-7, "{name}: a triangle of {} m² at {a}", n.length() / 2.0);
            for &i in t {
                let cosine = mesh.normals[i as usize].dot(n) / n.length();
                assert!(cosine > 0.0, "{name} ({}): normal at {a}", YARD.materials[material].name);
            }
        }
    }
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
    let linear = |v: u8| {
        let c = v as f64 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    for material in &YARD.materials {
        let mut mean = DVec3::from(material.albedo);
        if let Some((texture, _)) = material.texture {
            let solid: Vec<_> = YARD.textures[texture].rgba.iter().filter(|p| p[3] == 255).collect();
            let sum: DVec3 = solid.iter().map(|p| DVec3::new(linear(p[0]), linear(p[1]), linear(p[2]))).sum();
            mean *= sum / solid.len() as f64;
        }
        assert!(mean.min_element() > 0.03 && mean.max_element() < 0.85, "{}: {mean}", material.name);
    }
}

/// A triangle, its node, and whether its back may be seen.
struct Face {
    corners: [DVec3; 3],
    name: String,
    two_sided: bool,
}

/// Distance along a ray to a triangle, and whether its front is hit (Möller & Trumbore 1997).
fn meet(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<(f64, bool)> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    let s = origin - a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = direction.dot(q) / det;
    let t = e2.dot(q) / det;
    (det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some((t, det > 0.0))
}

#[test]
fn the_yards_air_sees_no_backs_and_no_coinciding_faces() {
    let mut faces = Vec::new();
    for (name, material, mesh) in YARD.placed() {
        for corners in mesh.corners() {
            let two_sided = YARD.materials[material].double_sided;
            faces.push(Face { corners, name: name.into(), two_sided });
        }
    }
    // From points above everything that stands around, in all directions.
    let mut random = Random::new(1);
    let (mut hits, mut backs, mut pairs) = (0, Vec::new(), Vec::new());
    for _ in 0..1500 {
        let origin = DVec3::new(random.range(-2.4, 3.0), random.range(2.2, 3.4), random.range(-2.0, 5.0));
        let direction = random.direction();
        let mut met: Vec<(f64, bool, usize)> = (0..faces.len())
            .filter_map(|k| meet(origin, direction, faces[k].corners).map(|(t, front)| (t, front, k)))
            .filter(|&(_, _, k)| !faces[k].two_sided)
            .collect();
        met.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(&(t, front, k)) = met.first() else { continue };
        hits += 1;
        if !front {
            backs.push(format!("{} at {}", faces[k].name, origin + direction * t));
        }
        for &(other_t, other_front, other) in &met[1..] {
            let normal = |k: usize| {
                let [a, b, c] = faces[k].corners;
                (b - a).cross(c - a).normalize()
            };
            let apart = (other_t - t) * normal(k).dot(direction).abs();
            if other_front
                && normal(k).dot(normal(other)) > 0.999
                && apart < 1e-3
                && faces[k].name != faces[other].name
            {
                pairs.push(format!(
                    "{} and {} at {}",
                    faces[k].name,
                    faces[other].name,
                    origin + direction * t
                ));
            }
        }
    }
    assert!(hits > 700, "{hits} hits");
    assert!(backs.is_empty(), "backs seen: {backs:#?}");
    assert!(pairs.is_empty(), "coinciding faces: {pairs:#?}");
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
