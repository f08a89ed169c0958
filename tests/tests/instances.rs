//! Instances of one mesh: what the manifest and the geometry say about their places leads to their light.

use baker::bake::run::{Options, bake};
use baker::light::times::schedule::parse_hours;
use dataset::observe::Silent;
use dataset::store::Dataset;
use pipeline_tests::Probe;
use std::path::Path;

#[test]
fn each_instance_has_light_of_its_own() {
    each_has_its_light("crates", 1);
}

#[test]
fn so_it_has_on_two_pages() {
    each_has_its_light("crates-pages", 2);
}

fn each_has_its_light(name: &str, pages: usize) {
    let dir = tempfile::tempdir().unwrap();
    let options = Options { out: Some(dir.path().join(name)), ..Options::new(parse_hours("12").unwrap()) };
    let console = Silent;
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name).with_extension("toml");
    bake(&scene, &options, &console).unwrap();
    let dataset = Dataset::open(&dir.path().join(name)).unwrap();

    assert!(dataset.verify(|| {}).faults.is_empty());
    assert_eq!(dataset.config.pages.len(), pages);
    for page in 0..pages {
        assert!(dataset.config.instances.iter().any(|i| i.page as usize == page));
        assert!(dataset.mask(page).unwrap().count() > 0);
    }

    // The manifest and the nodes of the geometry say the same.
    let file = dataset.path(dataset.config.geometry.as_ref().unwrap());
    let glb = gltf::Gltf::from_slice(&std::fs::read(file).unwrap()).unwrap();
    let placed: Vec<_> = glb
        .document
        .nodes()
        .filter(|n| n.extras().as_ref().is_some_and(|e| e.get().contains("lightmapPage")))
        .collect();
    assert_eq!((dataset.config.instances.len(), glb.document.meshes().count()), (4, 2));
    assert_eq!(placed.len(), 4);
    for (node, instance) in placed.iter().zip(&dataset.config.instances) {
        assert_eq!(node.name(), Some(&instance.name[..]));
        let extras: serde_json::Value = serde_json::from_str(node.extras().as_ref().unwrap().get()).unwrap();
        assert_eq!(extras["lightmapPage"], instance.page);
        for (key, value) in [("lightmapScale", instance.scale), ("lightmapOffset", instance.offset)] {
            assert_eq!([0, 1].map(|c| extras[key][c].as_f64().unwrap() as f32), value);
        }
    }

    // The tops see all of the sky and the sun; the side to the south sees half of it, the north side no sun.
    let noon: Vec<_> = (0..pages).map(|page| dataset.map(0, page).unwrap()).collect();
    let light = |at, normal| {
        let probe = Probe::new(&dataset, at, normal, 0.3);
        probe.mean(&noon[probe.page])
    };
    let up = [0.0, 1.0, 0.0];
    let tops =
        [[0.0, 1.0, 0.0], [50.0, 1.0, 0.0], [0.0, 2.0, 50.0], [50.0, 3.0, 50.0]].map(|at| light(at, up));
    assert!(tops.iter().all(|top| (top / tops[0] - 1.0).abs() < 0.02), "{tops:?}");
    // A crate turned by an angle about Y has sides that face ±(sin, 0, cos) of it; 200° gives the same sides
    // as 20°.
    for (centre, degrees, size) in
        [([0.0, 0.0], 0.0f32, 1.0), ([50.0, 0.0], 30.0, 1.0), ([0.0, 50.0], 20.0, 2.0)]
    {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let side = |sign: f32| {
            let normal = [sign * sin, 0.0, sign * cos];
            let at = |c: f32, n: f32| c + 0.5 * size * n;
            light([at(centre[0], normal[0]), 0.5 * size, at(centre[1], normal[2])], normal)
        };
        let (south, north) = (side(1.0), side(-1.0));
        assert!(south > 4.0 * north && south < 1.5 * tops[0], "{south} {north} {tops:?}");
    }
}
