//! `generate NAME` writes `NAME.glb` beside the scene files and prints what it holds.
//!
//! Geometry is authored in code, in metres, +Y up, south towards +Z; the same source writes the same bytes everywhere.

#[cfg(test)]
mod checks;
mod city;
mod extremes;
mod farmland;
mod foliage;
mod glb;
mod mesh;
mod model;
mod random;
mod relief;
mod room;
mod shapes;
mod soft;
mod textures;
mod yard;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The folder that holds the scene files.
fn scenes_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A scene's name, and what builds it.
type Scene = (&'static str, fn() -> model::Model);

fn main() -> ExitCode {
    const SCENES: [Scene; 5] = [
        ("city", city::model),
        ("extremes", extremes::model),
        ("farmland", farmland::model),
        ("room", room::model),
        ("yard", yard::model),
    ];
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let known = |name: &str| SCENES.iter().find(|(known, _)| *known == name);
    let [Some((name, build))] = arguments.iter().map(|name| known(name)).collect::<Vec<_>>()[..] else {
        let names: Vec<&str> = SCENES.iter().map(|(name, _)| *name).collect();
        eprintln!("usage: generate {}\nWrites the geometry of a scene to scenes/NAME.glb.", names.join("|"));
        return ExitCode::from(2);
    };
    let model = build();
    let path = scenes_folder().join(format!("{name}.glb"));
    let bytes = glb::write(&model);
    if let Err(error) = std::fs::write(&path, &bytes) {
        eprintln!("generate: {}: {error}", path.display());
        return ExitCode::FAILURE;
    }
    print!("{}", model.table());
    println!("{}: {} bytes", path.display(), bytes.len());
    ExitCode::SUCCESS
}
