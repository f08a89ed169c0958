//! The baker's own `scene.glb` baked again in place.

use crate::Stage;
use crate::pages::case;
use crate::scenes::Obj;
use baker::bake::run::{Integrator, Options, prepare};
use baker::light::times::schedule::parse_hours;
use dataset::observe::Silent;
use glam::{DVec3, Vec2};

/// Per face, the corners in the world and on the virtual page; ordered by page coordinates.
fn faces(stage: &Stage, scene: &str) -> (Vec<[(DVec3, Vec2); 3]>, [u32; 3]) {
    let options = Options::new(parse_hours("12").expect("hours"));
    let prepared = prepare(&stage.path(scene), &options, &Silent).expect("a scene");
    let (atlas, _) = prepared.atlas().expect("an atlas");
    let geometry = &prepared.geometry;
    let of_face = |face: &baker::atlas::Face| {
        let corners = geometry.corners(face.triangle as usize).map(|p| p.as_dvec3() + geometry.origin);
        let mut both = [0, 1, 2].map(|k| (corners[k], face.corners[k]));
        // From the corner that comes first on the page, in the same sense: the front stays the front.
        let first = (0..3).min_by_key(|&k| (both[k].1 * 256.0).round().as_ivec2().to_array()).unwrap_or(0);
        both.rotate_left(first);
        both
    };
    let mut faces: Vec<_> = atlas.faces.iter().map(of_face).collect();
    faces.sort_by_key(|face| face.map(|(_, texel)| (texel * 256.0).round().as_ivec2().to_array()));
    (faces, [atlas.width, atlas.page_height, atlas.pages])
}

#[test]
fn the_geometry_of_a_dataset_is_baked_again_texel_by_texel() {
    let (stage, text) = case();
    // With undersides, which nobody can see.
    let (low, size) = ([-0.5, 0.0, -0.5], [1.0, 1.0, 1.0]);
    let block = Obj::default().mesh("block").block(low, size).quad(low, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    stage.write("block.obj", &block.bytes());
    let (first, dataset) = stage.bake(&text, "set", "12", |_| {});
    assert!(first.facts.iter().any(|fact| fact.starts_with("skipped: 6 of ")), "{:?}", first.facts);
    std::fs::copy(stage.path("set/scene.glb"), stage.path("again.glb")).expect("copied");
    // The same light, on the baked geometry alone.
    let head = text.split("[[object]]").next().expect("light");
    let again = format!(
        "{head}[[object]]\nfile = \"again.glb\"\n[lightmap]\nsize = [48, 40]\npages = 2\npadding = 2\nuv = \"keep\"\n\
         [bake]\nsamples = 2\n"
    );
    let (second, kept) = stage.bake(&again, "kept", "12", |_| {});
    assert_eq!((second.size, second.pages), (first.size, first.pages));
    stage.write("first.toml", text.as_bytes());
    stage.write("second.toml", again.as_bytes());
    let ((wanted, size), (found, same)) = (faces(&stage, "first.toml"), faces(&stage, "second.toml"));
    assert_eq!((wanted.len(), size), (found.len(), same));
    for (a, b) in wanted.iter().zip(&found) {
        for ((p, texel), (q, again)) in a.iter().zip(b) {
            assert!(p.distance(*q) < 1e-5 && texel.distance(*again) < 1e-3, "{a:?} {b:?}");
        }
    }
    // The same texels are valid, and as bright: but for the lamp, which is off at noon, all light is the
    // same.
    for page in 0..2 {
        let (a, b) = (dataset.mask(page).expect("a mask"), kept.mask(page).expect("a mask"));
        let differ = a.valid.iter().zip(&b.valid).filter(|(a, b)| a != b).count();
        assert!(100 * differ <= a.count(), "page {page}: {differ} of {}", a.count());
        let mean = |set: &dataset::store::Dataset| {
            let image = set.map(0, page).expect("a map");
            let lit = image.texels.iter().zip(&a.valid).filter(|(_, valid)| **valid);
            lit.map(|(texel, _)| f64::from(texel[1])).sum::<f64>() / a.count() as f64
        };
        let (a, b) = (mean(&dataset), mean(&kept));
        assert!((a / b - 1.0).abs() < 0.02, "page {page}: {a} {b}");
    }
    // A node on a page that is not asked for.
    stage.write("third.toml", again.replace("pages = 2\n", "").as_bytes());
    let options = Options::new(parse_hours("12").expect("hours"));
    let prepared = prepare(&stage.path("third.toml"), &options, &Silent).expect("a scene");
    let error = prepared.atlas().expect_err("an error").to_string();
    assert!(error.contains("lies on page 1 of its file: expected `pages = 2`"), "{error}");
}

#[test]
fn a_chart_that_ends_a_rounding_beyond_a_block_is_baked() {
    // The block beyond texel 64 holds surface and covers no texel.
    let u = 64.00001 / 128.0;
    let obj = format!(
        "v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nvt 0.1 0.9\nvt 0.1 0.1\nvt {u} 0.1\nvt {u} 0.9\nf 1/1 2/2 3/3 4/4\n"
    );
    let stage = Stage::new(&[("a.obj", obj.into_bytes())]);
    let text = "[sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n\
        [[object]]\nfile = \"a.obj\"\nalbedo = 0.5\nvt = \"lightmap\"\n\
        [lightmap]\nsize = [128, 64]\nuv = \"keep\"\n[bake]\nsamples = 2\n";
    for (integrator, set) in [(Integrator::Cached, "cached"), (Integrator::Path, "path")] {
        let (outcome, dataset) = stage.bake(text, set, "12", |options| options.integrator = integrator);
        assert!(outcome.texels > 2000, "{} texels", outcome.texels);
        assert!(dataset.verify(|| {}).faults.is_empty());
    }
}
