//! The geometry files of datasets under Khronos' glTF validator. It needs node and the npm package
//! `gltf-validator`, in the folder that `NDGI_GLTF_VALIDATOR` names, where it must work; without the variable
//! the test says that it was skipped.

use baker::bake::finish::to_glb;
use baker::bake::run::{Options, prepare};
use baker::light::times::schedule::parse_hours;
use dataset::observe::Silent;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Writes what a bake of a scene file would write as its geometry.
fn geometry(scene: &Path, to: PathBuf) -> PathBuf {
    let prepared = prepare(scene, &Options::new(parse_hours("12").unwrap()), &Silent).unwrap();
    let (atlas, _) = prepared.atlas().unwrap();
    std::fs::write(&to, to_glb(&prepared.geometry, &atlas).unwrap().glb).unwrap();
    to
}

#[test]
fn geometry_files_are_valid_gltf() {
    let Ok(folder) = std::env::var("NDGI_GLTF_VALIDATOR") else {
        eprintln!("skipped: NDGI_GLTF_VALIDATOR names no folder with the npm package gltf-validator");
        return;
    };
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let dir = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for name in ["court", "crates", "crates-pages"] {
        let scene = here.join("fixtures").join(name).with_extension("toml");
        files.push(geometry(&scene, dir.path().join(format!("{name}.out.glb"))));
    }
    let head = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[lightmap]\nsize = 256\n[[object]]\n";
    for name in ["packed", "slivers", "glass", "glow", "yard"] {
        let glb = match models::generate(name) {
            Some(generated) => generated.glb,
            None => std::fs::read(here.join(format!("../scenes/{name}.glb"))).unwrap(),
        };
        std::fs::write(dir.path().join(format!("{name}.glb")), glb).unwrap();
        let scene = dir.path().join(format!("{name}.toml"));
        // Placed twice, once sheared and mirrored, and far from zero.
        let places =
            "instances = [{ translate = [1e6, 0, 0] }, { translate = [1e6, 9, 0], rotate = [5, 9, 2] }]";
        let text = format!("{head}file = \"{name}.glb\"\nscale = [1, 1, -1.5]\n{places}\n");
        std::fs::write(
            &scene,
            if name == "packed" { text } else { format!("{head}file = \"{name}.glb\"\n") },
        )
        .unwrap();
        files.push(geometry(&scene, dir.path().join(format!("{name}.out.glb"))));
    }
    // Colours and emission of the scene file, on vertices that have colours of their own.
    let scene = dir.path().join("looks.toml");
    let look = "albedo = [0.5, 0.25, 0.125]\nemission = [4, 2, 1]\ngroup = \"all\"\n[[group]]\nname = \"all\"\non = \"always\"\n";
    std::fs::write(&scene, format!("{head}file = \"packed.glb\"\n{look}")).unwrap();
    files.push(geometry(&scene, dir.path().join("looks.out.glb")));
    let script = here.join("gltf/validate.mjs");
    let output = Command::new("node").arg(script).arg(&folder).args(&files).output();
    let output = output.expect("node runs, since NDGI_GLTF_VALIDATOR is set");
    let told = String::from_utf8_lossy(&output.stdout);
    eprintln!("{told}");
    assert!(output.status.success(), "{told}{}", String::from_utf8_lossy(&output.stderr));
    assert!(told.contains("9 files, 0 errors"), "{told}");
    // A file that breaks a rule does not pass.
    let broken = dir.path().join("broken.gltf");
    std::fs::write(&broken, "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"mesh\":0}]}").unwrap();
    let output =
        Command::new("node").arg(here.join("gltf/validate.mjs")).arg(&folder).arg(&broken).output().unwrap();
    assert!(!output.status.success());
}
