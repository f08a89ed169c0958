//! `generate NAME [FILE]` writes a scene's geometry and prints what it holds: to `NAME.glb` beside the scene files, or to FILE.

use generate::{SCENES, STRESS};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The folder that holds the scene files.
fn scenes_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (name, path) = match &arguments[..] {
        [name] if SCENES.contains(&&name[..]) => (name, scenes_folder().join(format!("{name}.glb"))),
        [name, file] => (name, PathBuf::from(file)),
        _ => return usage(),
    };
    let Some(made) = generate::generate(name) else { return usage() };
    if let Err(error) = std::fs::write(&path, &made.glb) {
        eprintln!("generate: {}: {error}", path.display());
        return ExitCode::FAILURE;
    }
    print!("{}", made.table);
    println!("{}: {} bytes", path.display(), made.glb.len());
    ExitCode::SUCCESS
}

fn usage() -> ExitCode {
    eprintln!(
        "usage: generate {}\n       generate NAME FILE, where NAME may also be {}\n\
         Writes the geometry of a scene to scenes/NAME.glb, or to FILE.",
        SCENES.join("|"),
        STRESS.join(" or ")
    );
    ExitCode::from(2)
}
