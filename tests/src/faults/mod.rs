//! Programs in a world where they are killed, the power fails, or the disk is a network's: run under a
//! library (`faults.c`) that stands between them and the file system.

mod damage;
mod sweep;
mod tree;

pub use damage::{Damage, Loss};
pub use sweep::{Sweep, Swept};
pub use tree::{Tree, copy, differences};

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// The library, and a folder for what runs under it.
#[derive(Debug)]
pub struct Faults {
    folder: TempDir,
    root: PathBuf,
    library: PathBuf,
}

impl Faults {
    /// Compiles the library.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder for temporaries");
        let root = folder.path().canonicalize().expect("it is there");
        let (source, library) = (root.join("faults.c"), root.join("faults.so"));
        std::fs::write(&source, include_str!("faults.c")).expect("writable");
        let arguments =
            ["-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC", "-pthread", "-o"];
        let built =
            Command::new("cc").args(arguments).args([&library, &source]).output().expect("a C compiler");
        assert!(built.status.success(), "{}", text(&built));
        Faults { folder, root, library }
    }

    /// A folder below which all takes place, by its canonical path.
    pub fn root(&self) -> &Path {
        debug_assert!(self.folder.path().exists());
        &self.root
    }

    /// The library.
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// Lets a command run under the library, which looks at what happens below `under`.
    pub fn over<'a>(&self, command: &'a mut Command, under: &Path) -> &'a mut Command {
        command.env("LD_PRELOAD", &self.library).env("FAULTS_ROOT", under)
    }
}

impl Default for Faults {
    fn default() -> Self {
        Faults::new()
    }
}

/// A program of the workspace, with one thread. It lies beside this test.
///
/// # Panics
/// If it is not there, or older than its sources: `cargo test` builds a test's own programs alone.
pub fn program(name: &str) -> Command {
    let test = std::env::current_exe().expect("this test is a file");
    let folder = test.ancestors().nth(2).expect("target/<profile>/deps");
    let (file, sources) = (folder.join(name), folder.join(format!("{name}.d")));
    let advice = "`cargo build --workspace` with the flags of this test builds it";
    let age = |path: &Path| std::fs::metadata(path).and_then(|found| found.modified()).ok();
    let built = age(&file).unwrap_or_else(|| panic!("{} is not there: {advice}", file.display()));
    // (`cargo build` lists them; `cargo test` of the whole workspace has just built what is there.)
    let list = std::fs::read_to_string(&sources).unwrap_or_default();
    let list = list.split_once(": ").map_or("", |(_, list)| list).replace("\\ ", "\0");
    for source in list.split_whitespace().map(|source| source.replace('\0', " ")) {
        let is_older = age(Path::new(&source)).is_none_or(|changed| changed <= built);
        assert!(is_older, "{} is older than {source}: {advice}", file.display());
    }
    let mut command = Command::new(file);
    command.env("RAYON_NUM_THREADS", "1");
    command
}

/// Writes a scene that is baked in no time and has all kinds of light at noon: the court under a plain sky,
/// with sun and a lamp. Gives its file. `side`: texels of the page's sides.
pub fn court(folder: &Path, side: usize, lumens: u32) -> PathBuf {
    let object = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/court.obj");
    std::fs::create_dir_all(folder).expect("writable");
    std::fs::copy(object, folder.join("court.obj")).expect("writable");
    let scene = folder.join("court.toml");
    let words = format!(
        "[place]\nlatitude = 48.0\nlongitude = 16.0\nutc_offset = 1.0\ndate = \"2026-03-21\"\n[sun]\n\
         [sky]\nmodel = \"constant\"\nradiance = [1.0, 1.1, 1.3]\n[[object]]\nfile = \"court.obj\"\n\
         [[group]]\nname = \"lamp\"\non = [[\"10:00\", \"14:00\"]]\n\
         [[group.sphere]]\ncentre = [2.5, 1.5, 2.5]\nradius = 0.1\nlumens = {lumens}\nkelvin = 3000\n\
         [lightmap]\nsize = {side}\npadding = 2\n[bake]\nsamples = 16\n"
    );
    std::fs::write(&scene, words).expect("writable");
    scene
}

/// What a program said.
pub fn text(output: &Output) -> String {
    format!(
        "{}: {}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}
