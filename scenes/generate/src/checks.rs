//! What the tests of every scene ask: the committed file, valid glTF, sound triangles, plausible albedos, and
//! that the eye sees neither the back of a face nor two faces that coincide.

use crate::model::Model;
use crate::random::Random;
use glam::DVec3;
use std::path::Path;

/// The committed file is what the generator writes, below `limit` bytes.
pub fn committed(name: &str, model: &Model, limit: usize) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../{name}.glb"));
    let committed = std::fs::read(&path).expect("the scene's GLB");
    let written = crate::glb::write(model);
    let same = committed.iter().zip(&written).take_while(|(a, b)| a == b).count();
    assert!(
        committed == written,
        "scenes/{name}.glb differs from byte {same} on: run `cargo run --release --manifest-path \
         scenes/generate/Cargo.toml -- {name}`"
    );
    assert!(written.len() < limit, "{} bytes", written.len());
}

/// A glTF reader finds the model's nodes, triangles and images. Returns what it read.
pub fn valid_gltf(model: &Model) -> gltf::Gltf {
    let gltf = gltf::Gltf::from_slice(&crate::glb::write(model)).expect("a valid GLB");
    assert_eq!(gltf.nodes().len(), model.nodes.len());
    let triangles: usize = gltf
        .nodes()
        .filter_map(|node| node.mesh())
        .flat_map(|mesh| mesh.primitives())
        .map(|p| p.indices().expect("indexed").count() / 3)
        .sum();
    let placed: usize = model.placed().iter().map(|(_, _, mesh)| mesh.triangles.len()).sum();
    assert_eq!(triangles, placed);
    let blob = gltf.blob.as_deref().expect("a binary chunk");
    for image in gltf.images() {
        let gltf::image::Source::View { view, .. } = image.source() else { panic!("an embedded image") };
        let bytes = &blob[view.offset()..view.offset() + view.length()];
        let pixels = image::load_from_memory(bytes).expect("a PNG").to_rgba8();
        assert_eq!(pixels.len(), 4 * model.textures[image.index()].rgba.len());
    }
    gltf
}

/// Everything is finite, no triangle is degenerate (below `area` m²), and normals agree with the winding.
pub fn sound_triangles(model: &Model, area: f64) {
    for (name, material, mesh) in model.placed() {
        assert!(mesh.positions.iter().all(|p| p.is_finite()), "{name}");
        assert!(mesh.uvs.iter().all(|uv| uv.is_finite()), "{name}");
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-9), "{name}");
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let n = (b - a).cross(c - a);
            assert!(n.length() > 2.0 * area, "{name}: a triangle of {} m² at {a}", n.length() / 2.0);
            for &i in t {
                let cosine = mesh.normals[i as usize].dot(n) / n.length();
                assert!(cosine > 0.0, "{name} ({}): normal at {a}", model.materials[material].name);
            }
        }
    }
}

/// Mean linear albedos keep to what materials have.
pub fn plausible_albedos(model: &Model, low: f64, high: f64) {
    let linear = |v: u8| {
        let c = v as f64 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    for material in &model.materials {
        let mut mean = DVec3::from(material.albedo);
        if let Some((texture, _)) = material.texture {
            let solid: Vec<_> = model.textures[texture].rgba.iter().filter(|p| p[3] == 255).collect();
            let sum: DVec3 = solid.iter().map(|p| DVec3::new(linear(p[0]), linear(p[1]), linear(p[2]))).sum();
            mean *= sum / solid.len() as f64;
        }
        assert!(mean.min_element() > low && mean.max_element() < high, "{}: {mean}", material.name);
    }
}

/// A triangle and its node.
struct Face<'a> {
    corners: [DVec3; 3],
    normal: DVec3,
    name: &'a str,
}

/// Faces with a ball around them.
struct Cluster<'a> {
    centre: DVec3,
    radius: f64,
    faces: Vec<Face<'a>>,
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

/// The model's one-sided faces, placed primitive by placed primitive in runs of 200 triangles.
fn clusters(model: &Model) -> Vec<Cluster<'_>> {
    let mut out = Vec::new();
    for (name, material, mesh) in model.placed() {
        if model.materials[material].double_sided {
            continue;
        }
        let corners: Vec<[DVec3; 3]> = mesh.corners().collect();
        for run in corners.chunks(200) {
            let points = || run.iter().flatten();
            let centre = points().sum::<DVec3>() / (3 * run.len()) as f64;
            let radius = points().map(|p| p.distance(centre)).fold(0.0, f64::max);
            let face = |&corners: &[DVec3; 3]| {
                let [a, b, c] = corners;
                Face { corners, normal: (b - a).cross(c - a).normalize(), name }
            };
            out.push(Cluster { centre, radius, faces: run.iter().map(face).collect() });
        }
    }
    out
}

/// Casts `rays` rays from random origins in all directions. The face met first must show its front, and no
/// face of another node may lie in its plane within 1 mm, looking the same way. Returns how many rays met a
/// face.
pub fn no_backs_and_no_coinciding_faces(
    model: &Model,
    rays: usize,
    mut origin: impl FnMut(&mut Random) -> DVec3,
) -> usize {
    let clusters = clusters(model);
    let mut random = Random::new(1);
    let (mut hits, mut backs, mut pairs) = (0, Vec::new(), Vec::new());
    for _ in 0..rays {
        let origin = origin(&mut random);
        let direction = random.direction();
        let near = |c: &&Cluster| (c.centre - origin).cross(direction).length() <= c.radius * (1.0 + 1e-9);
        let mut met: Vec<(f64, bool, &Face)> = clusters
            .iter()
            .filter(near)
            .flat_map(|c| &c.faces)
            .filter_map(|f| meet(origin, direction, f.corners).map(|(t, front)| (t, front, f)))
            .collect();
        met.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(&(t, front, face)) = met.first() else { continue };
        hits += 1;
        let at = origin + direction * t;
        if !front {
            backs.push(format!("{} at {at}", face.name));
        }
        for &(other_t, other_front, other) in &met[1..] {
            let apart = (other_t - t) * face.normal.dot(direction).abs();
            let coincide = other_front && face.normal.dot(other.normal) > 0.999 && apart < 1e-3;
            if coincide && face.name != other.name {
                pairs.push(format!("{} and {} at {at}", face.name, other.name));
            }
        }
    }
    assert!(backs.is_empty(), "{} backs seen: {backs:#?}", backs.len());
    assert!(pairs.is_empty(), "{} coinciding faces: {pairs:#?}", pairs.len());
    hits
}
