//! `compress --shard` and `compress status`.

use super::open;
use commands::console::Console;
use compressor::bundle::begins_like_one;
use compressor::compress::{Options, Shard, Sharded, default_bundle, status as of_shards, train_shard};
use compressor::{Error, Result, of_bundle, printable};
use dataset::host::inputs::found;
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
    let is_there = found(&bundle)?.is_some();
    // (While shards train, it is the one that they replace.)
    let fault = if is_there && status.is_none() { fault_of(&bundle) } else { None };
    let line = match (&status, &fault) {
        (Some(status), _) => status.line(),
        (None, Some(fault)) => format!("no shard is running; the bundle cannot be read: {fault}"),
        (None, None) if is_there => "no shard is running; the bundle exists".to_owned(),
        (None, None) => "no shard has started; there is no bundle".to_owned(),
    };
    console.print(format!("{}: {line}", bundle.display()));
    let mut object = json!(status);
    if !object.is_object() {
        object = json!({});
    }
    (object["bundle"], object["working"]) = (json!(bundle), json!(status.is_some()));
    object["fault"] = json!(fault);
    console.result(&object)
}

/// Why what stands there is no whole bundle of this version, with what to do; without the path itself.
fn fault_of(bundle: &Path) -> Option<String> {
    let error = open(bundle).and_then(|opened| opened.verify().map_err(of_bundle)).err()?;
    let how = match &error {
        Error::Invalid { .. } if bundle.is_dir() => "",
        Error::Invalid { .. } if begins_like_one(bundle) => "; run `compress` to make it again",
        Error::Invalid { .. } => "; remove it, or give another name with --out",
        _ => "",
    };
    let text = error.to_string();
    let what = text.strip_prefix(&bundle.display().to_string()).unwrap_or(&text);
    Some(printable(what.trim_start_matches([':', ',', ' '])) + how)
}
