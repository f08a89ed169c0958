//! `generate NAME` writes `NAME.glb` beside the scene files and prints what it holds.
//!
//! Geometry is authored in code, in metres, +Y up, south towards +Z; the same source writes the same bytes everywhere.

#[cfg(test)]
mod checks;
mod city;
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

fn main() -> ExitCode {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let [name] = names.as_slice() else {
        eprintln!("usage: generate city|room|yard\nWrites the geometry of a scene to scenes/NAME.glb.");
        return ExitCode::from(2);
    };
    let model = match name.as_str() {
        "city" => city::model(),
        "room" => room::model(),
        "yard" => yard::model(),
        _ => {
            eprintln!("generate: no scene `{name}`, expected `city`, `room` or `yard`");
            return ExitCode::from(2);
        }
    };
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
