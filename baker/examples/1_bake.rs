//! Bakes a scene file: `cargo run --release -p baker --example 1_bake -- scenes/yard.toml /data/yard`.

use baker::bake::run::{Options, Preset, bake};
use baker::light::times::schedule::parse_hours;
use dataset::observe::{Message, Meter, Observer, Silent};
use dataset::store::Dataset;

/// Prints warnings; a program with a window would show information and progress, too.
struct Warnings;

impl Observer for Warnings {
    fn message(&self, kind: Message, text: &str) {
        if kind == Message::Warning {
            eprintln!("warning: {text}");
        }
    }

    fn meter(&self, task: &str, total: u64) -> Box<dyn Meter> {
        Silent.meter(task, total)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, out] = &arguments[..] else {
        return Err("expected a scene file and a folder to write".into());
    };
    // Four hours, quickly: half the side and a quarter of the samples. The defaults of all else are those of
    // the command `bake`.
    let options = Options {
        preset: Preset::Draft,
        extra_times: 0,
        out: Some(out.into()),
        ..Options::new(parse_hours("6,12,18,21")?)
    };
    // What is there already and of these options is not traced again.
    let outcome = bake(scene.as_ref(), &options, &Warnings)?;
    println!(
        "{}: {} texels, {} layers traced and {} reused in {:.1} s",
        outcome.scene, outcome.texels, outcome.layers.traced, outcome.layers.reused, outcome.seconds
    );
    for (hour, local) in outcome.hours.iter().zip(&outcome.local.frames) {
        let error = local.map_or("no light".to_owned(), |local| format!("{:.1} %", 100.0 * local.median));
        println!("  {hour:5.2} h: median local error {error}");
    }
    // What was written is a dataset like any other; see the examples of the crate `dataset`.
    let dataset = Dataset::open(&outcome.dataset)?;
    println!("{}: {} frames", outcome.dataset.display(), dataset.config.frames.len());
    Ok(())
}
