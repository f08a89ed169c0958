//! The stress models hold what their names say.

use crate::stress::{BITS, SLIVERS, charts, rounded, slivers};
use crate::{glass, glow, packed};

#[test]
fn both_are_valid_gltf_and_the_same_each_time() {
    for build in [slivers, charts] {
        let model = build();
        let glb = crate::glb::write(&model);
        let gltf = gltf::Gltf::from_slice(&glb).expect("a valid GLB");
        let primitives = gltf.meshes().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>());
        let triangles: usize = primitives.map(|p| p.indices().expect("indexed").count() / 3).sum();
        let expected: usize = model.placed().iter().map(|(_, _, mesh)| mesh.triangles.len()).sum();
        assert_eq!((gltf.nodes().len(), triangles), (model.nodes.len(), expected));
        assert!(glb == crate::glb::write(&build()));
    }
}

#[test]
fn slivers_reach_from_visible_ones_to_none_at_all() {
    let model = slivers();
    // Heights over the longest edge, of what the file holds.
    let mut heights = Vec::new();
    for (_, _, mesh) in model.placed() {
        for corners in mesh.corners() {
            let [a, b, c] = corners.map(rounded);
            let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
            heights.push((b - a).cross(c - a).length() / longest);
        }
    }
    assert!(heights.iter().all(|height| height.is_finite()));
    let count = |low: f64, high: f64| heights.iter().filter(|&&h| h > low && h <= high).count();
    assert!(heights.iter().filter(|&&height| height == 0.0).count() >= SLIVERS, "exactly collinear");
    assert!(count(0.0, 1e-7) > 100 && count(1e-7, 1e-4) > 100 && count(1e-4, 1e-2) > 50);
}

#[test]
fn charts_share_no_vertex() {
    let model = charts();
    let placed = model.placed();
    let (_, _, bits) = placed.iter().find(|(name, ..)| *name == "bits").expect("a mesh");
    assert_eq!(bits.positions.len(), BITS * BITS * 7 / 2);
    assert_eq!(bits.triangles.len(), BITS * BITS * 3 / 2);
    let mut places: Vec<[u64; 3]> =
        bits.positions.iter().map(|p| rounded(*p).to_array().map(f64::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    assert_eq!(places.len(), bits.positions.len());
}

#[test]
fn files_of_glass_and_of_light_are_valid_and_the_same_each_time() {
    for (build, materials, lamps) in [(glass::glb as fn() -> Vec<u8>, 4, 0), (glow::glb, 4, 3)] {
        let glb = build();
        assert!(glb == build());
        let gltf = gltf::Gltf::from_slice(&glb).expect("a valid GLB");
        assert_eq!((gltf.materials().len(), gltf.lights().map_or(0, Iterator::count)), (materials, lamps));
    }
}

#[test]
fn the_packed_file_is_the_same_each_time_and_smaller_than_what_it_holds() {
    let glb = packed::glb();
    assert!(glb == packed::glb());
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let root: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let bytes = |buffer: usize| root["buffers"][buffer]["byteLength"].as_u64().expect("a length");
    assert!(bytes(0) < bytes(1) && glb.len() as u64 >= bytes(0) + length as u64);
    assert!(root["bufferViews"].as_array().expect("views").iter().all(|v| v["extensions"].is_object()));
}
