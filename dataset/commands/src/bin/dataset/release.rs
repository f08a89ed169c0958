//! `dataset release` and `dataset verify`.

use super::exchange::layout;
use clap::Args;
use commands::console::Console;
use dataset::Result;
use dataset::layout::Layout;
use dataset::observe::count;
use dataset::release::{release, verify};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Args)]
pub(crate) struct Release {
    /// The datasets: folders with config.json.
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,
    /// The new folder to write.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Add an archive of the lightmaps in this layout; repeatable.
    #[arg(long, value_parser = layout())]
    layout: Vec<&'static dyn Layout>,
    /// State in the datasheets that the datasets are released under CC0 1.0; without it they state no
    /// licence.
    #[arg(long)]
    cc0: bool,
}

impl Release {
    pub(crate) fn run(&self, console: &Console) -> Result<()> {
        let start = std::time::Instant::now();
        let mut layouts: Vec<&dyn Layout> = Vec::new();
        for &layout in &self.layout {
            if layouts.iter().all(|other| other.name() != layout.name()) {
                layouts.push(layout);
            }
        }
        let packaged = release(&self.folders, &layouts, self.cc0, &self.out, console)?;
        for what in &packaged.omitted {
            console.say(format!("omitted from {what}"));
        }
        let (scenes, files) = (count(packaged.scenes.len(), "scene"), count(packaged.files, "file"));
        let size = packaged.bytes as f64 / 1e6;
        console.say(format!("{}: {scenes}, {files}, {size:.1} MB", self.out.display()));
        console.result(&json!({
            "out": self.out,
            "scenes": packaged.scenes,
            "omitted": packaged.omitted,
            "files": packaged.files,
            "bytes": packaged.bytes,
            "seconds": start.elapsed().as_secs_f64(),
        }))
    }
}

/// `dataset verify` of a release folder.
pub(crate) fn verify_release(console: &Console, folder: &Path) -> Result<ExitCode> {
    let start = std::time::Instant::now();
    let verified = verify(folder, console)?;
    for fault in &verified.faults {
        console.error(fault);
    }
    let faults: Vec<String> = verified.faults.iter().map(ToString::to_string).collect();
    let ok = faults.is_empty();
    let found = match ok {
        true => {
            let (scenes, files) = (count(verified.scenes.len(), "scene"), count(verified.files, "file"));
            format!("{scenes}, {files} of SHA256SUMS: no fault")
        }
        false => count(faults.len(), "fault"),
    };
    console.say(format!("{}: {found}", folder.display()));
    console.result(&json!({
        "ok": ok,
        "faults": faults,
        "scenes": verified.scenes,
        "files": verified.files,
        "bytes": verified.bytes,
        "seconds": start.elapsed().as_secs_f64(),
    }))?;
    Ok(super::exit_code(&verified.faults))
}
