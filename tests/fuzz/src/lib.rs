//! The fuzz targets, for libFuzzer.

pub mod readers;
pub mod soup;

pub use libfuzzer_sys;

use std::path::Path;
use std::sync::LazyLock;

/// A folder for the targets that read files.
pub fn scratch() -> &'static Path {
    static FOLDER: LazyLock<tempfile::TempDir> =
        LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));
    FOLDER.path()
}

/// A target by its name in [`readers`], or with its module. Panics that a reader catches itself are none of
/// libFuzzer's business: its hook would end the process; one that gets out is reported all the same.
#[macro_export]
macro_rules! fuzz {
    ($target:ident) => {
        $crate::fuzz!(readers::$target);
    };
    ($module:ident::$target:ident) => {
        $crate::libfuzzer_sys::fuzz_target!(
            init: { drop(std::panic::take_hook()); },
            |bytes: &[u8]| { $crate::$module::$target($crate::scratch(), bytes); }
        );
    };
}
