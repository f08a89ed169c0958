//! `compress --shard` and `compress status`.

use commands::console::Console;
use compressor::Result;
use compressor::compress::{Options, Shard, Sharded, default_bundle, status as of_shards, train_shard};
use dataset::observe::count;
use dataset::store::Dataset;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Trains a shard and prints the next step.
pub(crate) fn train(root: &Path, options: &Options, shard: Shard, console: &Console) -> Result<()> {
    let start = Instant::now();
    let done = train_shard(root, options, shard, console)?;
    let (stage, note) = match &done {
        Sharded::UpToDate(bundle) => {
            console.say(format!("{} is up to date (--force retrains it)", bundle.display()));
            ("up to date", None)
        }
        Sharded::TrialFits(note) => {
            let tiles = count(note.tiles, "tile");
            console.say(format!(
                "shard {shard}: trial fits of {tiles} are done; once all shards are, run --merge to choose configurations, then the shards again"
            ));
            ("trials", Some(note))
        }
        Sharded::Trained(note) => {
            let tiles = count(note.tiles, "tile");
            let resumed = match note.resumed {
                0 => String::new(),
                n => format!(", {n} of them reused from an earlier run"),
            };
            console.say(format!("shard {shard}: {tiles} trained{resumed}; once all shards are, run --merge"));
            ("training", Some(note))
        }
    };
    console.result(&json!({
        "shard": shard.number,
        "of": shard.of,
        "stage": stage,
        "tiles": note.map(|note| note.tiles),
        "tiles_resumed": note.map(|note| note.resumed),
        "psnr_db": note.and_then(|note| note.psnr_db),
        "seconds": start.elapsed().as_secs_f64(),
    }))
}

/// Prints the progress of the shards of a dataset's bundle.
pub(crate) fn status(root: &Path, out: Option<PathBuf>, console: &Console) -> Result<()> {
    let bundle = match out {
        Some(out) => out,
        None => default_bundle(&Dataset::open_manifest(root)?),
    };
    let status = of_shards(&bundle);
    let line = match &status {
        Some(status) => status.line(),
        None if bundle.exists() => "no shard is running; the bundle exists".to_owned(),
        None => "no shard has started; there is no bundle".to_owned(),
    };
    console.print(format!("{}: {line}", bundle.display()));
    let mut object = json!(status);
    if !object.is_object() {
        object = json!({});
    }
    (object["bundle"], object["working"]) = (json!(bundle), json!(status.is_some()));
    console.result(&object)
}
