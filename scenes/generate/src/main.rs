//! `generate NAME [FILE]` writes a scene's geometry and prints what it holds: to `NAME.glb` beside the scene
//! files, or to FILE. `generate big DIR [COPIES]` writes the city many times over, as a scene of its own,
//! into a folder.

use generate::{SCENES, STRESS};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The folder that holds the scene files.
fn scenes_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [big, folder, copies @ ..] = &arguments[..]
        && big == "big"
    {
        let copies = match copies {
            [] => Some(COPIES),
            [copies] => copies.parse().ok().filter(|n| *n > 0),
            _ => None,
        };
        return copies.map_or_else(usage, |copies| write_big(Path::new(folder), copies));
    }
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

/// Copies of the city that make ten million triangles.
const COPIES: usize = 17;
/// Side of the big scene's page in texels.
const PAGE: u32 = 4096;

/// Writes the city many times over into a folder.
fn write_big(folder: &Path, copies: usize) -> ExitCode {
    let Some(big) = generate::big("city", copies, PAGE) else { return usage() };
    let written = std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(folder.join("city.glb"), &big.glb))
        .and_then(|()| std::fs::write(folder.join("big.toml"), &big.toml));
    if let Err(error) = written {
        eprintln!("generate: {}: {error}", folder.display());
        return ExitCode::FAILURE;
    }
    println!("{}: the city {copies} times, on a page of {PAGE}²", folder.join("big.toml").display());
    ExitCode::SUCCESS
}

fn usage() -> ExitCode {
    eprintln!(
        "usage: generate {}\n       generate NAME FILE, where NAME may also be {}\n       \
         generate big FOLDER [COPIES]\n\
         Writes the geometry of a scene to scenes/NAME.glb, or to FILE; with `big`, a scene of many copies of the city to FOLDER.",
        SCENES.join("|"),
        STRESS.join(" or ")
    );
    ExitCode::from(2)
}
