//! Releases of datasets: a folder of archives, bundles, pictures and datasheets, with checksums. Once in
//! place, it is complete; its bytes do not depend on the day, the machine or the number of threads.

mod sums;
mod archive;
mod bundle;
mod datasheet;
mod parts;
mod package;
mod verify;

use crate::format::FileRef;
use serde::{Deserialize, Serialize};

pub use package::{Packaged, release};
pub use parts::LAYERS;
pub use verify::{Verified, verify};

/// The name of the manifest of a release.
pub const MANIFEST: &str = "release.json";
/// The checksums of all other files, as `sha256sum -c` reads them.
pub const SUMS: &str = "SHA256SUMS";
/// The reader that comes with a release.
pub const READER: &str = "read_dataset.py";
/// It, and what it verifies checksums with.
const READERS: [(&str, &[u8]); 2] = [
    (READER, include_bytes!("../../python/read_dataset.py")),
    ("blake3_numpy.py", include_bytes!("../../python/blake3_numpy.py")),
];
/// The value of [`Manifest::format`].
const FORMAT: &str = "temporal-lightmap-release";
/// The version of the manifest that is written, and the largest that is read.
const VERSION: u32 = 1;
/// Largest manifest, list of checksums or `config.json` that is read.
const MAX_TEXT_BYTES: u64 = 64 << 20;

/// `release.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: String,
    version: u32,
    /// What wrote it.
    generator: String,
    scenes: Vec<Scene>,
}

/// The files of a scene; names are relative to the manifest's folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Scene {
    scene: String,
    datasheet: String,
    archives: Vec<Archive>,
    bundles: Vec<String>,
    previews: Vec<String>,
}

/// A `.tar.zst`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Archive {
    name: String,
    /// `sets` (all but the layers), `sun`, `sky`, `lamps`, or a layout of exchange.
    holds: String,
    /// In the archive's order, with the folder that they unpack to.
    files: Vec<FileRef>,
}
