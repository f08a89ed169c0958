//! `dataset halve`.

use clap::Args;
use commands::console::Console;
use dataset::Result;
use dataset::halve::{extent, halve};
use dataset::observe::count;
use dataset::store::Dataset;
use serde_json::json;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Halve {
    /// The dataset: the folder with config.json.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The dataset to write: a new folder.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

impl Halve {
    pub(crate) fn run(&self, console: &Console) -> Result<()> {
        let start = std::time::Instant::now();
        let dataset = Dataset::open(&self.folder)?;
        let config = halve(&dataset, &self.out, console)?;
        let pages: Vec<[u32; 2]> = config.pages.iter().map(|page| [page.width, page.height]).collect();
        let sizes: Vec<String> = pages.iter().map(|[width, height]| format!("{width}×{height}")).collect();
        let (level, (files, bytes)) = (config.halved().map(|halved| halved.times), extent(&config));
        console.say(format!(
            "{}: level {}, pages of {} texels, {}, {:.1} MB",
            self.out.display(),
            level.unwrap_or_default(),
            sizes.join(", "),
            count(files, "file"),
            bytes as f64 / 1e6
        ));
        if dataset.config.noise.is_some() {
            console.say("omitted: noise, because the error of a mean of texels is not known");
        }
        console.result(&json!({
            "out": self.out,
            "scene": config.scene,
            "level": level,
            "pages": pages,
            "files": files,
            "bytes": bytes,
            "seconds": start.elapsed().as_secs_f64(),
        }))
    }
}
