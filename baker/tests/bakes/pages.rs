//! Several pages from end to end.

use crate::scenes::Obj;
use crate::{Stage, assert_same};
use baker::bake::errors::CellMap;
use baker::bake::finish::{Assembled, Assembler, BakedParts};
use baker::bake::layers::Layers;
use baker::bake::run::{Denoise, Integrator, Options, prepare};
use baker::light::times::schedule::parse_hours;
use baker::receivers::SurfaceTexels;
use baker::scene::Baked;
use dataset::format::Light;
use dataset::observe::Silent;
use dataset::store::Writer;
use std::f64::consts::TAU;

/// Blocks that one page of this size is too small for, at the density of two.
pub fn case() -> (Stage, String) {
    let block = Obj::default().mesh("block").block([-0.5, 0.0, -0.5], [1.0, 1.0, 1.0]).bytes();
    let ground = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 6.0, 4.0).bytes();
    let text = "[sun]\ntrack = [{ hour = 12, direction = [0.3, 1, 0.2], irradiance = [50, 48, 45] }]\n\
        [sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n[[object]]\nfile = \"ground.obj\"\nalbedo = 0.5\n\
        [[object]]\nfile = \"block.obj\"\nalbedo = 0.5\ninstances = [{ translate = [-1, 0, 0] }, { translate = [1, 0, 0] }, { translate = [3, 0, 0] }]\n\
        [[group]]\nname = \"lamp\"\non = [[18, 6]]\n[[group.sphere]]\ncentre = [0, 0.8, 0.3]\nradius = 0.1\nradiance = [8, 6, 4]\n\
        [lightmap]\nsize = [48, 40]\npages = 2\npadding = 2\n[bake]\nsamples = 2\n";
    (Stage::new(&[("block.obj", block), ("ground.obj", ground)]), text.to_owned())
}

#[test]
fn two_pages_are_baked_opened_and_verified() {
    let (stage, text) = case();
    for integrator in [Integrator::Cached, Integrator::Path] {
        let set = format!("{integrator:?}");
        let (outcome, dataset) = stage.bake(&text, &set, "12,21", |o| o.integrator = integrator);
        assert_eq!((outcome.pages, outcome.size), (2, [48, 40]));
        let config = &dataset.config;
        assert_eq!(config.pages.len(), 2);
        // Every page holds surface, light in every set, and the group's light.
        let mut texels = 0;
        for page in 0..2 {
            let mask = dataset.mask(page).expect("a mask");
            assert_eq!((mask.width, mask.height), (48, 40));
            texels += mask.count();
            let lit = |image: &dataset::image::Image| {
                let both = image.texels.iter().zip(&mask.valid);
                both.filter(|(texel, valid)| **valid && texel[1] > 0.0).count()
            };
            for set in 0..config.frames.len() {
                let lit = lit(&dataset.map(set, page).expect("a map"));
                assert!(lit * 2 > mask.count(), "page {page}, set {set}: {lit} lit");
            }
            assert!(lit(&dataset.light(Light::Group, Some(0), 0, page).expect("a layer")) > 0);
            assert!(config.instances.iter().any(|i| i.page == page as u32), "no instance on page {page}");
        }
        assert_eq!(texels, outcome.texels);
        // Every checksum, finite light, and each set the sum of its parts bit for bit.
        let found = dataset.verify(|| {});
        assert!(found.faults.is_empty(), "{:?}", found.faults);
        assert_eq!(found.dead_texels, [Some(0), Some(0)]);
    }
}

#[test]
fn two_pages_are_lit_again_without_a_ray() {
    let (stage, text) = case();
    stage.bake(&text, "set", "12,21", |_| {});
    let text = text.replace("[8, 6, 4]", "[1, 2, 3]").replace("[[18, 6]]", "[[19, 5]]");
    let (outcome, dataset) = stage.bake(&text, "set", "12,21", |_| {});
    assert_eq!((outcome.layers.traced, outcome.rays.rays()), (0, 0));
    let (_, fresh) = stage.bake(&text, "fresh", "12,21", |_| {});
    assert_same(&dataset, &fresh);
    assert!(dataset.verify(|| {}).faults.is_empty());
}

#[test]
fn bands_of_any_height_give_the_same_images() {
    // A closed ring of smooth facets, which charts must cut somewhere, on two pages of four bands each.
    let sides = 48;
    let floor = Obj::default().mesh("floor").floor([-4.0, 0.0, -4.0], 8.0, 8.0);
    let mut ring = floor.mesh("ring");
    for i in 0..sides {
        let (sin, cos) = (f64::from(i) / f64::from(sides) * TAU).sin_cos();
        ring = ring.line(&format!("vn {cos} 0 {sin}"));
        ring = ring.line(&format!("v {} 0 {}\nv {} 2 {}", 2.0 * cos, 2.0 * sin, 2.0 * cos, 2.0 * sin));
    }
    for i in 0..sides {
        // (The floor has the first four vertices.)
        let corner = |i: i32, top: i32| format!("{}//{}", 5 + 2 * (i % sides) + top, 1 + i % sides);
        let [a, b, c, d] = [corner(i, 0), corner(i, 1), corner(i + 1, 1), corner(i + 1, 0)];
        ring = ring.line(&format!("f {a} {b} {c} {d}"));
    }
    let (stage, text) = case();
    stage.write("ground.obj", &ring.bytes());
    let text = text.replace("size = [48, 40]", "size = [80, 256]");
    stage.bake(&text, "set", "12,21", |options| options.denoise = Denoise::Own);
    let options = Options {
        out: Some(stage.path("set")),
        denoise: Denoise::Own,
        ..Options::new(parse_hours("12,21").unwrap())
    };
    let prepared = prepare(&stage.path("case.toml"), &options, &Silent).unwrap();
    let (atlas, _) = prepared.atlas().unwrap();
    let layers = Layers::new(&stage.path("set"));
    let cell_map = CellMap::seeing_nothing(&SurfaceTexels::new(&atlas));
    let baked = BakedParts { sun: Baked::All, sky: Baked::All, groups: vec![Baked::All] };
    let stored = |band: usize| {
        let texels = layers.texels(&prepared.base()).expect("the layers' texels");
        let (plan, folder) = (&prepared.plan, (&layers, &prepared.digests[..]));
        let assembler =
            Assembler::with_bands(plan, &prepared.geometry, &atlas, folder, texels, &cell_map, (2, band))
                .unwrap();
        let out = tempfile::tempdir().unwrap();
        assembler.store(&mut Writer::create(out.path()).unwrap(), &baked, || {}).unwrap()
    };
    let (whole, bands) = (stored(usize::MAX / 2), stored(1));
    assert!(whole.seams.is_some_and(|(edges, ..)| edges > 0), "no seams: {:?}", whole.seams);
    assert!(whole.frames.len() >= 2 && whole.pages.len() == 2);
    let images = |stored: &Assembled| (stored.frames.clone(), stored.daylight.clone(), stored.groups.clone());
    assert_eq!(images(&whole), images(&bands));
    assert_eq!(format!("{:?}", whole.seams), format!("{:?}", bands.seams));
}
