//! Pictures of bakes, pixel by pixel.

use super::Stage;
use super::scenes::{Obj, furnace, instances, outdoors};
use baker::bake::run::Preset;
use baker::preview::options::Options;
use baker::preview::run::preview;
use compressor::compress::{DRAFT, Options as CompressOptions, compress};
use dataset::image::Image;
use dataset::observe::Silent;
use dataset::pictures::View;
use glam::DVec3;
use image::{ImageFormat, Rgb, RgbImage, Rgba, RgbaImage};
use std::io::Cursor;
use std::path::PathBuf;

const SET: &str = "set";
const SAMPLES: &str = "[bake]\nsamples = 16\n";

impl Stage {
    /// Draws the dataset `set` of the scene that was baked last.
    fn draw(&self, options: Options) -> dataset::Result<(serde_json::Value, RgbImage)> {
        let out = self.path("picture.png");
        let options = Options { dataset: Some(self.path(SET)), out: Some(out.clone()), ..options };
        let told = preview(&self.path("case.toml"), &options, &Silent)?;
        Ok((told, image::open(&out).expect("a picture").into_rgb8()))
    }

    /// The message of a picture that must fail.
    #[track_caller]
    fn refusal(&self, options: Options) -> String {
        self.draw(options).expect_err("the preview was accepted").to_string()
    }
}

/// A small square picture from `camera` at `look_at`.
fn from(camera: &str, look_at: [f64; 3]) -> Options {
    Options {
        camera: Some(camera.to_owned()),
        look_at: Some(DVec3::from(look_at)),
        size: [40, 40],
        samples: 4,
        ..Options::new(12.0)
    }
}

/// A floor of albedo ½ under an even sky of 1 kcd/m²: its irradiance is π, its radiance ½.
const FLOOR: &str = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n\
    [[object]]\nfile = \"floor.obj\"\nalbedo = 0.5\n[lightmap]\nsize = 40\n";

fn floor() -> (&'static str, Vec<u8>) {
    ("floor.obj", Obj::default().mesh("floor").floor([-2.0, 0.0, -2.0], 4.0, 4.0).bytes())
}

#[test]
fn a_known_irradiance_shows_its_value() {
    let stage = Stage::new(&[floor()]);
    stage.bake(&format!("{FLOOR}{SAMPLES}"), SET, "12", |_| ());
    let middle = |exposure: Option<f64>| {
        let (told, picture) = stage.draw(Options { exposure, ..from("0,3,0.1", [0.0; 3]) }).unwrap();
        (told["exposure"].as_f64().unwrap(), *picture.get_pixel(20, 20))
    };
    // ½ · 2⁻¹ = ¼, whose sRGB is 0.5371; ½ · 2 = 1, which the curve takes to 0.8896 and sRGB to 0.9498.
    assert_eq!(middle(Some(-1.0)).1, Rgb([137; 3]));
    assert_eq!(middle(Some(1.0)).1, Rgb([242; 3]));
    // By itself it comes out middle grey: ½ · 2^EV = 0.18.
    let (exposure, pixel) = middle(None);
    assert!((exposure - 0.36f64.log2()).abs() < 0.01, "{exposure}");
    assert_eq!(pixel, Rgb([118; 3]));
}

#[test]
fn a_hole_shows_what_is_behind_it() {
    // Open on its left half, red on its right.
    let mut png = Cursor::new(Vec::new());
    let texel = |x: u32| if x < 4 { [255, 255, 255, 0] } else { [255, 0, 0, 255] };
    RgbaImage::from_fn(8, 1, |x, _| Rgba(texel(x))).write_to(&mut png, ImageFormat::Png).unwrap();
    let sheet = "mtllib sheet.mtl\nusemtl holed\nv -0.5 1 0.5\nvt 0 0\nv 0.5 1 0.5\nvt 1 0\nv 0.5 1 -0.5\nvt 1 1\nv -0.5 1 -0.5\n\
        vt 0 1\nf 1/1 2/2 3/3 4/4\n";
    let mtl = "newmtl holed\nKd 1 1 1\nmap_Kd holed.png\nmap_d holed.png\n";
    let stage = Stage::new(&[
        floor(),
        ("sheet.obj", sheet.into()),
        ("sheet.mtl", mtl.into()),
        ("holed.png", png.into_inner()),
    ]);
    let sheet = "[[object]]\nfile = \"sheet.obj\"\nlightmap = false\ntwo_sided = true\n";
    stage.bake(&format!("{FLOOR}{sheet}{SAMPLES}"), SET, "12", |_| ());
    // 1.15 m on either side of the middle at the sheet's height: its halves' middles are 4 pixels off.
    let (_, picture) = stage.draw(Options { exposure: Some(-1.0), ..from("0,3,0", [0.0; 3]) }).unwrap();
    let (hole, red) = (picture.get_pixel(15, 20).0, picture.get_pixel(24, 20).0);
    assert!(hole.iter().all(|c| (110..=137).contains(c)), "the floor, a little shaded: {hole:?}");
    assert!(red[0] > 150 && red[1] < 10, "{red:?}");
}

#[test]
fn what_has_no_texels_looks_like_what_has() {
    // All of radiance 1 in the furnace: ½ emitted, and ½ of an irradiance of π.
    let case = furnace();
    let block = Obj::default().mesh("block").block([-0.3, -0.05, -0.3], [0.6, 0.65, 0.6]);
    case.stage.write("block.obj", &block.bytes());
    let block = "[[object]]\nfile = \"block.obj\"\nalbedo = 0.5\nemission = [0.5, 0.5, 0.5]\ngroup = \"walls\"\nlightmap = false\n";
    case.stage.bake(&format!("{block}{}[bake]\nsamples = 64\n", case.text), SET, "12", |_| ());
    let view = Options {
        exposure: Some(-2.0),
        samples: 16,
        fov: Some(90.0),
        ..from("-0.8,1.4,0.8", [0.0, 0.4, 0.0])
    };
    let (_, picture) = case.stage.draw(view).unwrap();
    // ¼ is 137; a code more or less is a hundredth of the light.
    for (name, x, y) in [("block", 20, 20), ("block", 21, 24), ("wall", 2, 2), ("floor", 20, 38)] {
        let pixel = picture.get_pixel(x, y).0;
        assert!(pixel.iter().all(|c| (134..=140).contains(c)), "{name}: {pixel:?}");
    }
    // Without the half that it is lit by, the block would show ⅛.
    let mean = picture.pixels().map(|p| f64::from(p.0[1])).sum::<f64>() / 1600.0;
    assert!((mean - 137.0).abs() < 1.5, "{mean}");
}

/// What has no texels is black and does not count for the exposure; a back shows its front's texels.
#[test]
fn as_game_shows_nothing_but_texels() {
    let block = Obj::default().mesh("block").block([-0.5, 0.1, -0.5], [1.0, 0.2, 1.0]);
    let sheet = Obj::default().mesh("sheet").floor([1.0, 1.0, -0.5], 1.0, 1.0);
    let stage = Stage::new(&[floor(), ("block.obj", block.bytes()), ("sheet.obj", sheet.bytes())]);
    let objects = "[[object]]\nfile = \"block.obj\"\nalbedo = 0.5\nlightmap = false\n\
                   [[object]]\nfile = \"sheet.obj\"\nalbedo = 0.5\ntwo_sided = true\n";
    stage.bake(&format!("{objects}{FLOOR}{SAMPLES}"), SET, "12", |_| ());
    let bundle = stage.compress(|_| ());
    let above = |as_game, exposure, bundle| {
        let view = from("0,3,0.1", [0.0; 3]);
        stage.draw(Options { as_game, exposure, bundle, ..view }).unwrap()
    };
    let pixels = |picture: &RgbImage| [picture.get_pixel(20, 20).0, picture.get_pixel(4, 20).0];
    let near = |pixel: [u8; 3], code: u8, off: u8| pixel.iter().all(|c| c.abs_diff(code) <= off);
    let (told, picture) = above(false, Some(-1.0), None);
    let [top, ground] = pixels(&picture);
    assert!(near(top, 137, 12) && near(ground, 137, 3) && told["unlit"].is_null(), "{top:?} {ground:?}");
    for bundle in [None, Some(bundle)] {
        let (told, picture) = above(true, Some(-1.0), bundle.clone());
        let [top, ground] = pixels(&picture);
        assert!(top == [0; 3] && near(ground, 137, 8), "{bundle:?}: {top:?} {ground:?}");
        // The block's top is 1 m of a view 3.1 m wide at its height.
        let unlit = told["unlit"].as_f64().unwrap();
        assert!((0.08..0.15).contains(&unlit), "{unlit}");
        let (told, _) = above(true, None, bundle);
        // As the floor's ½ becomes middle grey.
        let exposure = told["exposure"].as_f64().unwrap();
        assert!((exposure - 0.36f64.log2()).abs() < 0.1, "{exposure}");
    }
    let below = |as_game| {
        let view = Options { as_game, exposure: Some(-1.0), ..from("1.5,0.3,0.1", [1.5, 1.0, 0.0]) };
        stage.draw(view).unwrap().1.get_pixel(20, 20).0
    };
    assert!(near(below(true), 137, 4) && below(false)[1] < 120, "{:?} {:?}", below(true), below(false));
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let case = instances();
    case.stage.bake(&format!("{}{SAMPLES}", case.text), SET, case.hours, |_| ());
    let of_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| case.stage.draw(from("-1,2,2.5", [0.0, 0.3, 0.0]))).unwrap();
        std::fs::read(case.stage.path("picture.png")).unwrap()
    };
    assert!(of_threads(1) == of_threads(3));
}

#[test]
fn a_camera_is_chosen_by_name_and_changes_no_bake() {
    let case = outdoors();
    let scene = format!("{}{SAMPLES}", case.text);
    case.stage.bake(&scene, SET, case.hours, |_| ());
    let message = case.stage.refusal(Options { camera: Some("gate".into()), ..Options::new(8.0) });
    assert!(message.contains("\"gate\": expected") && message.contains("the scene has none"), "{message}");

    let camera = "[[camera]]\nname = \"gate\"\nposition = [1, 2, 3]\nlook_at = [0, 0.5, 0]\nfov = 40\n";
    let (outcome, dataset) = case.stage.bake(&format!("{scene}{camera}"), SET, case.hours, |_| ());
    assert!(outcome.up_to_date);
    // Reports show the scene by it.
    assert_eq!(dataset.config.settings["cameras"][0]["name"], "gate");
    let small = || Options { size: [16, 9], ..Options::new(9.0) };
    for camera in [None, Some("gate".to_owned())] {
        let (told, picture) = case.stage.draw(Options { camera, ..small() }).unwrap();
        assert_eq!(told["camera"]["name"], "gate");
        assert_eq!(
            (told["camera"]["position"][2].as_f64(), told["camera"]["fov"].as_f64()),
            (Some(3.0), Some(40.0))
        );
        // A quarter of the way from 8 to 12.
        assert_eq!(told["frames"].to_string(), r#"[{"hour":8.0,"weight":0.75},{"hour":12.0,"weight":0.25}]"#);
        assert_eq!(told["warnings"].as_array().map(Vec::len), Some(0), "{told}");
        assert_eq!(picture.dimensions(), (16, 9));
    }
    let message = case.stage.refusal(Options { camera: Some("moon".into()), ..Options::new(8.0) });
    assert!(message.contains("\"moon\": expected") && message.contains("(\"gate\")"), "{message}");
    let message = case.stage.refusal(from("0,0,0", [0.0; 3]));
    assert!(message.contains("--look-at: expected another point"), "{message}");
}

#[test]
fn only_a_finished_dataset_of_this_scene_is_shown() {
    let case = outdoors();
    case.stage.write("case.toml", format!("{}{SAMPLES}", case.text).as_bytes());
    let message = case.stage.refusal(Options::new(8.0));
    assert!(message.contains("no finished dataset; expected one of the scene \"case\""), "{message}");
    let work = case.stage.path(SET).join(".bake");
    std::fs::create_dir_all(&work).unwrap();
    let message = case.stage.refusal(Options::new(8.0));
    assert!(message.contains("not finished; the same `bake` command continues it"), "{message}");
    std::fs::remove_dir(&work).unwrap();
    let jpeg = Options { out: Some("a.jpg".into()), ..Options::new(8.0) };
    let message = preview(&case.stage.path("case.toml"), &jpeg, &Silent).unwrap_err().to_string();
    assert!(message.contains("a.jpg: expected a name that ends in .png"), "{message}");
    // A draft lays out other pages than the scene asks for; it is shown as it is.
    case.stage
        .bake(&format!("{}{SAMPLES}", case.text), SET, case.hours, |options| options.preset = Preset::Draft);
    let small = || Options { size: [16, 9], ..Options::new(8.0) };
    case.stage.draw(small()).unwrap();
    let changed = |from: &str, to: &str| {
        assert!(case.text.contains(from));
        case.stage.write("case.toml", format!("{}{SAMPLES}", case.text.replace(from, to)).as_bytes());
    };
    changed("2026-06-21", "2026-07-21");
    let (told, _) = case.stage.draw(small()).unwrap();
    assert!(told["warnings"][0].as_str().is_some_and(|w| w.contains("(place)")), "{told}");
    // The scene with another material: what was baked is shown on the dataset's own geometry.
    changed("[0.6, 0.5, 0.3]", "[0.6, 0.5, 0.4]");
    let (told, other) = case.stage.draw(small()).unwrap();
    let [warning] = told["warnings"].as_array().unwrap().as_slice() else { panic!("{told}") };
    assert!(warning.as_str().is_some_and(|w| w.contains("the dataset's own geometry file")), "{warning}");
    changed("2026-06-21", "2026-06-21");
    let (told, same) = case.stage.draw(small()).unwrap();
    assert_eq!(told["warnings"].as_array().map(Vec::len), Some(0), "{told}");
    let differs = |(a, b): (&Rgb<u8>, &Rgb<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 2);
    // (Its positions are rounded otherwise, so a pixel at an edge may show the other side.)
    let differing = same.pixels().zip(other.pixels()).filter(|pair| differs(*pair)).count();
    assert!(differing <= 3, "{differing} of 144 pixels");
    // Another scene altogether is refused.
    let renamed = case.text.replace("[0.6, 0.5, 0.3]", "[0.6, 0.5, 0.4]");
    case.stage.write("case.toml", format!("name = \"other\"\n{renamed}{SAMPLES}").as_bytes());
    let message = case.stage.refusal(small());
    assert!(
        message.contains("of the scene \"case\"") && message.contains("made of the scene \"other\""),
        "{message}"
    );
}

impl Stage {
    /// Compresses the dataset `set`, briefly.
    fn compress(&self, change: impl FnOnce(&mut CompressOptions)) -> PathBuf {
        let mut options = CompressOptions { iterations: 300, force: true, ..CompressOptions::of(DRAFT) };
        change(&mut options);
        compress(&self.path(SET), &options, &Silent).unwrap_or_else(|e| panic!("{e}")).bundle
    }
}

#[test]
fn a_bundle_is_drawn_at_any_hour_in_place_of_the_lightmaps() {
    let stage = Stage::new(&[floor()]);
    stage.bake(&format!("{FLOOR}{SAMPLES}"), SET, "8,12", |_| ());
    let bundle = stage.compress(|_| ());
    let view = Options { bundle: Some(bundle.clone()), exposure: Some(-1.0), ..from("0,3,0.1", [0.0; 3]) };
    let (told, picture) = stage.draw(Options { hour: 9.3, ..view }).unwrap();
    assert_eq!((&told["bundle"], &told["frames"]), (&serde_json::json!(bundle), &serde_json::json!([])));
    assert_eq!(told["warnings"].as_array().map(Vec::len), Some(0), "{told}");
    // As in `a_known_irradiance_shows_its_value`; 3 codes are 5 % of the light.
    let pixel = picture.get_pixel(20, 20).0;
    assert!(pixel.iter().all(|c| c.abs_diff(137) <= 3), "{pixel:?}");

    // It is of another bake now, and of other pages, and of another scene.
    let with = || Options { bundle: Some(bundle.clone()), ..from("0,3,0.1", [0.0; 3]) };
    stage.bake(&format!("{FLOOR}{SAMPLES}").replace("[1, 1, 1]", "[2, 2, 2]"), SET, "8,12", |_| ());
    let (told, _) = stage.draw(with()).unwrap();
    assert!(told["warnings"][0].as_str().is_some_and(|w| w.contains("made from another bake")), "{told}");
    stage.bake(&format!("{FLOOR}{SAMPLES}").replace("size = 40", "size = 48"), SET, "8,12", |_| ());
    let message = stage.refusal(with());
    assert!(
        message.contains("has pages of 40 × 40 texels; expected those of the dataset, 48 × 48"),
        "{message}"
    );
    stage.bake(&format!("name = \"other\"\n{FLOOR}{SAMPLES}"), SET, "12", |options| options.force = true);
    let message = stage.refusal(with());
    assert!(message.contains("is a bundle of the scene \"case\"; expected one of \"other\""), "{message}");
    let message = stage.refusal(Options { bundle: Some(stage.path("case.toml")), ..with() });
    assert!(message.contains("case.toml: does not begin with"), "{message}");
}

#[test]
fn a_bundle_without_the_sun_shows_the_rest_and_says_so() {
    let case = outdoors();
    let scene = format!("{}{SAMPLES}", case.text);
    case.stage.bake(&scene, SET, case.hours, |_| ());
    let [whole, rest] = [false, true].map(|without_sun| {
        let out = Some(case.stage.path(&format!("{without_sun}.ndgi")));
        let bundle =
            Some(case.stage.compress(|options| (options.without_sun, options.out) = (without_sun, out)));
        case.stage.draw(Options { bundle, exposure: Some(-4.0), ..from("3,4,3", [0.0; 3]) }).unwrap()
    });
    assert_eq!(whole.0["warnings"].as_array().map(Vec::len), Some(0), "{}", whole.0);
    let warning = rest.0["warnings"][0].as_str().unwrap_or_default();
    assert!(warning.contains("written without the sun's direct light"), "{}", rest.0);
    let mean = |picture: &RgbImage| picture.pixels().map(|p| f64::from(p.0[1])).sum::<f64>() / 1600.0;
    assert!(mean(&rest.1) + 20.0 < mean(&whole.1), "{} {}", mean(&rest.1), mean(&whole.1));
}

#[test]
fn reports_show_what_the_preview_shows() {
    // Textured, with holes, at an hour of sun: what reports draw by a depth buffer is what the preview
    // traces.
    let mut png = Cursor::new(Vec::new());
    let texel = |x: u32, y: u32| {
        let alpha = if (x + y).is_multiple_of(3) { 0 } else { 255 };
        Rgba([200, 60 + 20 * x as u8, 40 + 20 * y as u8, alpha])
    };
    RgbaImage::from_fn(8, 8, texel).write_to(&mut png, ImageFormat::Png).unwrap();
    let sheet = "mtllib sheet.mtl\nusemtl holed\nv -1.5 0 1\nvt 0 0\nv 1 0 1.5\nvt 2 0\nv 1 1.2 1.5\nvt 2 1\nv -1.5 1.2 1\n\
        vt 0 1\nf 1/1 2/2 3/3 4/4\n";
    let mtl = "newmtl holed\nKd 0.8 1 1\nmap_Kd holed.png\nmap_d holed.png\n";
    let case = outdoors();
    let files = [("sheet.obj", sheet.into()), ("sheet.mtl", mtl.into()), ("holed.png", png.into_inner())];
    files.iter().for_each(|(name, bytes)| case.stage.write(name, bytes));
    let sheet = "[[object]]\nfile = \"sheet.obj\"\n";
    let camera = "[[camera]]\nname = \"gate\"\nposition = [2, 1.5, 3]\nlook_at = [0, 0.5, 0]\nfov = 70\n";
    let scene = format!("{}{sheet}{camera}{SAMPLES}", case.text);
    let (_, dataset) = case.stage.bake(&scene, SET, "12", |_| ());

    let size = [96, 54];
    let view = View::of(&dataset, size).unwrap().unwrap();
    assert_eq!(view.camera.name, "gate");
    let light = view.light(&dataset.config, |page, rows| {
        let texels = dataset.map_rows(0, page, rows.start, rows.end)?;
        Ok(Image { width: dataset.config.pages[page].width as usize, height: rows.len(), texels })
    });
    let light = light.unwrap();
    let exposure = view.exposure(&light);
    let report = image::load_from_memory(&view.to_png(&light, exposure)).unwrap().into_rgb8();
    let options =
        Options { size: size.map(|side| side as u32), exposure: Some(exposure), ..Options::new(12.0) };
    let (told, preview) = case.stage.draw(options).unwrap();
    assert_eq!(told["camera"]["name"], "gate");

    // Where all of a pixel has texels. The preview has four times as many samples of it, elsewhere in it: at
    // edges they differ.
    let lit: Vec<bool> = view.with_texels().iter().map(|share| *share == 1.0).collect();
    let pairs = report.pixels().zip(preview.pixels()).zip(&lit).filter(|(_, lit)| **lit);
    let apart: Vec<u8> =
        pairs.map(|((a, b), _)| (0..3).map(|c| a.0[c].abs_diff(b.0[c])).max().unwrap()).collect();
    assert!(apart.len() * 3 > lit.len(), "{} of {} pixels have texels", apart.len(), lit.len());
    let far = apart.iter().filter(|apart| **apart > 8).count();
    let mean = apart.iter().map(|apart| f64::from(*apart)).sum::<f64>() / apart.len() as f64;
    assert!(far * 10 < apart.len() && mean < 3.0, "{far} of {}, {mean}", apart.len());
}
