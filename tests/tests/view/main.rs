//! The page that `compress view` writes, in headless Chromium: its decoders, hostile bundles, and what it
//! draws.

mod browser;
mod bundles;

use baker::bake::run::{Options as BakeOptions, bake};
use baker::light::times::schedule::parse_hours;
use baker::preview::options::Options as PreviewOptions;
use baker::preview::run::preview;
use browser::{chromium, run};
use compressor::compress::{Options, compress};
use compressor::decode::Decoder;
use compressor::view::{self, Server, Source};
use dataset::observe::Silent;
use dataset::store::Dataset;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};

/// Sets; between sets; on both sides of a switch and at one; around midnight; by day and by night; on other
/// days.
const HOURS: [f64; 11] = [0.0, 12.0, 5.95, 6.0, 12.3, 18.05, 23.9, 9.77, 4.9, -3.0, 25.5];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// A page of a bundle alone.
fn page_of(bundle: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.ndgi");
    std::fs::write(&path, bundle).unwrap();
    view::page(&Source::open(&path, &view::Options::default()).unwrap()).unwrap()
}

/// All bundles, the codebook, and what the decoder makes of them: page by page at every hour, float32.
fn files() -> (BTreeMap<String, Vec<u8>>, Vec<String>) {
    let words = Path::new(env!("CARGO_MANIFEST_DIR")).join("../compressor/ndgi/src/sun/words.bin");
    let mut files = BTreeMap::from([("words".to_owned(), std::fs::read(words).unwrap())]);
    let mut names = Vec::new();
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in bundles::all() {
        let path = folder.path().join("x.ndgi");
        std::fs::write(&path, &bytes).unwrap();
        let decoder = Decoder::open(&path).unwrap();
        let mut light = Vec::new();
        for hour in HOURS {
            for page in 0..decoder.bundle().header.pages.len() {
                let image = decoder.decode_page(page, hour).unwrap();
                light.extend(image.texels.as_flattened().iter().flat_map(|e| e.to_le_bytes()));
            }
        }
        files.insert(format!("{name}.light"), light);
        files.insert(name.clone(), bytes);
        names.push(name);
    }
    (files, names)
}

/// What every script has: names and hours.
fn script(names: &[String], text: &str) -> String {
    format!(
        "const NAMES_OF_BUNDLES = {}, HOURS = {};\n{}\n{text}",
        json!(names),
        json!(HOURS),
        include_str!("common.js")
    )
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::INFINITY)
}

#[test]
fn scripts_and_shaders_decode_as_the_decoder_does() {
    let Some(browser) = chromium() else { return };
    let (files, names) = files();
    let html = page_of(&files["lamps"]);
    let found = run(&browser, &html, "", files, &script(&names, include_str!("decode.js")));
    println!("{found:#}");
    // Of max(E, mean/100), as FORMAT.md, section 6, has it for single precision; halves add 2⁻¹¹.
    assert!(number(&found["scalar"]) <= 3e-4, "{found:#}");
    assert!(number(&found["unpacked"]) <= 3e-4, "{found:#}");
    assert!(number(&found["half"]) <= 8e-4, "{found:#}");
    // SwiftShader has BC7; where a browser lacks it there is nothing to compare.
    assert!(found["bptc"].is_null() || number(&found["bptc"]) <= 3e-4, "{found:#}");
    assert!(found["same_bits"] != json!(false), "{found:#}");
    assert!(number(&found["texels"]) > 1e5 && found["gl_error"] == 0, "{found:#}");
}

#[test]
fn hostile_bundles_open_or_are_refused() {
    let Some(browser) = chromium() else { return };
    let (files, names) = files();
    let html = page_of(&files["lamps"]);
    let found = run(&browser, &html, "", files, &script(&names, include_str!("mutations.js")));
    println!("{found:#}");
    assert_eq!(number(&found["opened"]) + number(&found["refused"]), 2000.0, "{found:#}");
    assert!(number(&found["opened"]) > 100.0 && number(&found["refused"]) > 500.0, "{found:#}");
    // Nothing but the reader's own errors, and none of WebGL.
    assert!(found["strange"] == json!([]) && found["gl_error"] == 0, "{found:#}");
}

/// The scene `court` with its lamp out at midnight, which is moonless, baked and compressed: the scene file
/// and the dataset.
fn court(folder: &Path) -> (PathBuf, PathBuf) {
    let (scene, root) = (folder.join("court.toml"), folder.join("court"));
    std::fs::copy(fixture("court.obj"), folder.join("court.obj")).unwrap();
    let text = std::fs::read_to_string(fixture("court.toml")).unwrap();
    let dark = text.replace(r#"on = [["18:00", "06:00"]]"#, r#"on = [["18:00", "23:00"]]"#);
    assert_ne!(dark, text);
    std::fs::write(&scene, dark).unwrap();
    let options = BakeOptions {
        out: Some(root.clone()),
        extra_times: 0,
        ..BakeOptions::new(parse_hours("0,6,9,12,15,20").unwrap())
    };
    bake(&scene, &options, &Silent).unwrap();
    compress(&root, &Options { iterations: 1500, ..Options::default() }, &Silent).unwrap();
    (scene, root)
}

#[test]
fn the_page_shows_the_light_of_the_dataset() {
    let Some(browser) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (scene, root) = court(folder.path());
    let source = Source::open(&root, &view::Options::default()).unwrap();
    let html = view::page(&source).unwrap();
    assert!(html.len() < 1 << 20 && !html.contains("https://"), "{}", html.len());
    no_other_scene_is_taken_for_it(&root);
    looks_like_its_preview(&browser, &html, &scene, &root);
    works(&browser, &html, &root, &source.bundle);
}

fn no_other_scene_is_taken_for_it(root: &Path) {
    let other = root.join("other.ndgi");
    std::fs::write(&other, bundles::all().swap_remove(0).1).unwrap();
    let open = |input: &Path, options: view::Options| Source::open(input, &options);
    let beside = open(&other, view::Options::default());
    let named = open(root, view::Options { bundle: Some(other.clone()), ..view::Options::default() });
    for refused in [beside, named] {
        let error = refused.unwrap_err().to_string();
        assert!(
            error.contains("is a bundle of scene") && error.contains("expected one of \"court\""),
            "{error}"
        );
    }
    let scene = Some(root.join("scene.glb"));
    let source = open(&other, view::Options { scene, ..view::Options::default() }).unwrap();
    assert!(source.doubts[0].contains("a dataset that the bundle was not made from"), "{:?}", source.doubts);
    assert!(source.cameras.is_empty() && source.frames() == 0 && source.omitted.is_some());
    std::fs::remove_file(other).unwrap();
}

#[test]
fn a_damaged_bundle_becomes_no_page() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.ndgi");
    let (_, mut bytes) = bundles::all().into_iter().find(|(name, _)| name == "lamps").unwrap();
    let at = bytes.len() - 5;
    bytes[at] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    Source::open(&path, &view::Options::default()).unwrap_err();
}

fn looks_like_its_preview(browser: &str, html: &str, scene: &Path, root: &Path) {
    let png = root.with_extension("png");
    let shown = |hour: f64| {
        let options = PreviewOptions {
            dataset: Some(root.to_owned()),
            out: Some(png.clone()),
            camera: Some("5,4,6".to_owned()),
            size: [320, 180],
            ..PreviewOptions::new(hour)
        };
        preview(scene, &options, &Silent).unwrap()
    };
    let (by_night, shown) = (shown(0.0), shown(12.0));
    let files = BTreeMap::from([("preview".to_owned(), std::fs::read(&png).unwrap())]);
    let script = format!("const SHOWN = {shown}, SHOWN_BY_NIGHT = {by_night};\n{}", include_str!("scene.js"));
    let found = run(browser, html, "#hour=12", files, &script);
    println!("{found:#}");
    // In codes of 255, over pixels whose surroundings are one surface: of the dataset's own texels, and of
    // what is decoded.
    assert!(number(&found["pixels"]) > 10_000.0, "{found:#}");
    assert!(
        number(&found["reference"]["mean"]) < 1.0 && number(&found["reference"]["p99"]) <= 6.0,
        "{found:#}"
    );
    assert!(number(&found["decoded"]["mean"]) < 4.0 && number(&found["decoded"]["p99"]) <= 40.0, "{found:#}");
    assert!(number(&found["exposure_off"]) < 0.15, "{found:#}");
    assert!(number(&found["exposure_off_by_night"]) < 0.15, "{found:#}");
    assert!(number(&found["exposure_off_in_black"]) < 0.15, "{found:#}");
    assert_eq!(found["gl_error"], 0, "{found:#}");
}

/// What the page tells and shows is so, and its keys and buttons do what they say.
fn works(browser: &str, html: &str, root: &Path, bundle: &Path) {
    let dataset = Dataset::open_manifest(root).unwrap();
    let sets = dataset.config.frames.len();
    let maps = (0..sets).map(|set| dataset.map(set, 0).unwrap());
    let light: Vec<u8> =
        maps.flat_map(|map| map.texels.into_flattened()).flat_map(|e| e.to_le_bytes()).collect();
    let [page] = &dataset.config.pages[..] else { panic!("{:?}", dataset.config.pages) };
    let bits = 8 * std::fs::metadata(bundle).unwrap().len();
    let bits = bits as f64 / f64::from(page.width * page.height) / sets as f64;
    let files = BTreeMap::from([("light".to_owned(), light)]);
    let found = run(browser, html, "#hour=12", files, include_str!("page.js"));
    println!("{found:#}");
    for key in [
        "opens",
        "bits",
        "snaps",
        "steps_by_references",
        "plays_by_references",
        "waits",
        "late",
        "keeps",
        "steps",
        "plays",
        "pauses",
        "atlas",
        "picks",
        "as_game",
        "hashes",
        "follows",
        "bare",
        "closes",
        "tabs",
        "misses",
        "pins",
        "fits_a_phone",
    ] {
        assert_eq!(found[key], json!(true), "{key}: {found:#}");
    }
    for (view, off) in found["views"].as_object().unwrap() {
        // In codes of 255. A difference is of the reference as RGB9E5 has it.
        let most = if view.contains("difference") { 1.0 } else { 0.5 };
        assert!(number(off) < most, "{view}: {found:#}");
    }
    // (Beside what is unlit other surfaces are seen when it is away.)
    assert!(number(&found["exposure_as_game"]) < 1.0, "{found:#}");
    let says = |key: &str, what: &str| assert!(found[key].as_str().unwrap().contains(what), "{found:#}");
    says("texel", "PSNR");
    says("facts", "no texels");
    says("facts", &format!(" {bits:.3} bits per texel and frame"));
    assert_eq!(found["gl_error"], 0, "{found:#}");
}

/// The guide's module for three.js, with the library of the folder that `NDGI_THREE` names.
#[test]
fn three_js_shows_the_light_of_the_guide() {
    let Some(browser) = chromium() else { return };
    let Some(three) = std::env::var_os("NDGI_THREE").map(PathBuf::from) else {
        eprintln!("skipped: NDGI_THREE names no folder with three.module.js");
        return;
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../compressor");
    let text = |path: &str| std::fs::read_to_string(root.join(path)).unwrap();
    let guide = text("INTEGRATION.md");
    let (module, _) = guide.split_once("```js\n").unwrap().1.split_once("```").unwrap();
    let scripts = ["view/bundle.js", "view/tile.js", "view/planes.js", "view/sun.js"];
    let scripts: String = scripts.map(text).concat();
    let html = format!(
        "<!doctype html><html><head><link rel=icon href='data:,'></head><body><script>{scripts}</script>\
         <script type=importmap>{{\"imports\":{{\"three\":\"/file/three.module.js\"}}}}</script>\
         <script type=module>{module}{}</script></body></html>",
        include_str!("three.js")
    );
    let (name, bundle) = bundles::all().into_iter().find(|(name, _)| name == "sunny").unwrap();
    let path = tempfile::tempdir().unwrap().keep().join(name);
    std::fs::write(&path, &bundle).unwrap();
    let light = Decoder::open(&path).unwrap().sample(0, 75.5 / 300.0, 105.5 / 140.0, 9.3).unwrap();
    std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
    let mut files = BTreeMap::from([("bundle".to_owned(), bundle)]);
    files.insert("words".to_owned(), std::fs::read(root.join("ndgi/src/sun/words.bin")).unwrap());
    for file in ["three.module.js", "three.core.js"] {
        files.insert(file.to_owned(), std::fs::read(three.join(file)).unwrap());
    }
    let found = run(&browser, &html, "", files, "");
    println!("{found:#}, {light:?}");
    for (c, light) in light.iter().enumerate() {
        // Albedo 0.5, exposure 1/64. Hardware filters in steps of 1/256.
        let expected = f64::from(*light) * 0.5 / std::f64::consts::PI / 64.0;
        let shown = number(&found["shown"][c]);
        assert!((shown - expected).abs() <= 0.02 * expected + 1e-4, "{c}: {shown}, expected {expected}");
    }
    assert!(light[0] > 0.1, "{light:?}");
}

/// Status and body of a request, the host as told.
fn ask(address: &str, request: &str, host: &str, more: &str) -> (String, Vec<u8>) {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "{request} HTTP/1.1\r\nHost: {host}\r\n{more}\r\n").unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
    (String::from_utf8_lossy(&answer[..end]).into_owned(), answer[end + 4..].to_vec())
}

#[test]
fn the_server_gives_the_page_and_ranges_to_this_machine_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.ndgi");
    let (_, bytes) = bundles::all().swap_remove(0);
    std::fs::write(&path, &bytes).unwrap();
    let source = Source::open(&path, &view::Options::default()).unwrap();
    let server = Server::bind(0).unwrap();
    let url = server.url();
    let address = url.trim_start_matches("http://").trim_end_matches('/').to_owned();
    std::thread::spawn(move || view::serve(&server, source));
    let (status, page) = ask(&address, "GET /", &address, "");
    assert!(status.contains("200 OK") && String::from_utf8_lossy(&page).contains("<canvas"), "{status}");
    let (status, _) = ask(&address, "GET /?hour=12", &address, "");
    assert!(status.contains("200 OK"), "{status}");
    let (_, body) = ask(&address, "GET /data/bundle", "localhost", "");
    assert_eq!(body, bytes);
    let (status, body) = ask(&address, "GET /data/bundle", "localhost", "Range: bytes=8-11\r\n");
    assert!(status.contains("206") && status.contains("bytes 8-11/") && body == bytes[8..12], "{status}");
    let (status, body) = ask(&address, "HEAD /data/bundle", "localhost", "");
    assert!(status.contains(&format!("Content-Length: {}", bytes.len())) && body.is_empty(), "{status}");
    for (request, host, code) in [
        ("GET /data/bundle", "evil.example", "403"),
        ("GET /data/../../etc/passwd", "localhost", "404"),
        ("GET /data/reference-0-0", "localhost", "404"),
        ("POST /", "localhost", "405"),
    ] {
        let (status, _) = ask(&address, request, host, "");
        assert!(status.contains(code), "{request} {host}: {status}");
    }
}
