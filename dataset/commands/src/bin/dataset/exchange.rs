//! `dataset import` and `dataset export`.

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use commands::console::Console;
use dataset::exchange::{Origin, export, import};
use dataset::host::inputs::found;
use dataset::layout::{LAYOUTS, Layout, named};
use dataset::observe::count;
use dataset::store::Dataset;
use dataset::{Error, Result};
use serde_json::json;
use std::path::PathBuf;

/// Reads the name of a layout.
pub(crate) fn layout() -> impl TypedValueParser<Value = &'static dyn Layout> {
    let names = LAYOUTS.iter().map(|layout| PossibleValue::new(layout.name()).help(layout.about()));
    PossibleValuesParser::new(names).map(|name| named(&name).expect("one of the names"))
}

#[derive(Args)]
pub(crate) struct Import {
    /// The folder to read, or a TOML file that names EXR files.
    #[arg(value_name = "FROM")]
    from: PathBuf,
    /// The dataset to write: a new folder, whose name becomes the scene's.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The folder's layout.
    #[arg(long, conflicts_with = "pattern", value_parser = layout())]
    layout: Option<&'static dyn Layout>,
    /// The folder contains EXR files with names of this form; {hour} stands for 6, 06 or 5.9 (24 means 0).
    #[arg(long, value_name = "NAME")]
    pattern: Option<String>,
    /// Path of an image (PNG, JPEG, EXR) that is white where texels are valid [default: all are valid].
    #[arg(long, value_name = "FILE", requires = "pattern")]
    mask: Option<PathBuf>,
    /// The layer to read from EXR files with several, such as ViewLayer.Combined.
    #[arg(long, value_name = "NAME", requires = "pattern")]
    layer: Option<String>,
}

#[derive(Args)]
pub(crate) struct Export {
    /// The dataset: the folder with config.json.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The layout to write.
    #[arg(long, value_parser = layout())]
    layout: &'static dyn Layout,
    /// The new folder to write.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

impl Import {
    fn origin(&self) -> Result<Origin> {
        let from = || self.from.clone();
        if self.from.is_file() && (self.layout.is_some() || self.pattern.is_some()) {
            return Err(Error::invalid(
                self.from.display(),
                "is a file; expected a folder with --layout or --pattern, or a TOML file without them",
            ));
        }
        match (self.layout, &self.pattern) {
            (Some(layout), _) => Ok(Origin::Folder(layout, from())),
            (None, Some(pattern)) => Ok(Origin::Pattern {
                folder: from(),
                pattern: pattern.clone(),
                mask: self.mask.clone(),
                layer: self.layer.clone(),
            }),
            (None, None) if self.from.extension().is_some_and(|e| e == "toml") => Ok(Origin::Table(from())),
            (None, None) => {
                let names = LAYOUTS.iter().map(|layout| layout.name()).collect::<Vec<_>>().join(" or ");
                let what = match found(&self.from)? {
                    Some(_) => format!("expected --layout {names}, --pattern for EXR files, or a TOML file"),
                    None => format!(
                        "no such file or folder; expected a folder, with --layout {names} or with --pattern, or a TOML file"
                    ),
                };
                Err(Error::invalid(self.from.display(), what))
            }
        }
    }

    pub(crate) fn run(&self, console: &Console) -> Result<()> {
        let start = std::time::Instant::now();
        let config = import(&self.origin()?, &self.out, console)?;
        let source = config.source.as_ref();
        let replaced = source.map_or(0, |source| source.replaced_values);
        if replaced > 0 {
            let found = count(replaced as usize, "value");
            console.warn(format!("{found} outside the masks were negative or not finite and are now 0"));
        }
        let layers = !config.layers.is_empty();
        let out = self.out.display();
        let (pages, frames) = (count(config.pages.len(), "page"), count(config.frames.len(), "frame"));
        let hours: Vec<f64> = config.frames.iter().map(|frame| frame.hour).collect();
        console
            .say(format!("{out}: {pages}, {frames}, layers {}", if layers { "stored" } else { "unknown" }));
        console.say(format!("hours: {}", spacing(&hours)));
        match &*config.groups {
            [] => console.say("no light group: light is interpolated between all neighbouring frames"),
            groups => groups.iter().for_each(|group| {
                console.say(format!("light group {:?}: on {:?} h", group.name, group.on));
            }),
        }
        console.result(&json!({
            "out": self.out,
            "layout": source.map(|source| &source.layout),
            "scene": config.scene,
            "pages": config.pages.len(),
            "hours": hours,
            "groups": config.groups.iter().map(|group| &group.name).collect::<Vec<_>>(),
            "layers": layers,
            "replaced_values": replaced,
            "seconds": start.elapsed().as_secs_f64(),
        }))
    }
}

/// The spacing of ascending hours around the day, as text.
fn spacing(hours: &[f64]) -> String {
    let (Some(&first), Some(&last)) = (hours.first(), hours.last()) else { return "none".to_owned() };
    let next = hours.iter().skip(1).copied().chain([first + 24.0]);
    let gaps: Vec<(f64, f64)> = hours.iter().zip(next).map(|(&hour, next)| (next - hour, hour)).collect();
    let widest = gaps.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
    let narrowest = gaps.iter().map(|gap| gap.0).fold(24.0, f64::min);
    let rounded = |hours: f64| (hours * 1000.0).round() / 1000.0;
    let apart = |hours: f64| (hours - widest.0).abs() < 1e-6;
    if hours.len() == 1 {
        return format!("{first} only, so light never changes");
    }
    if apart(narrowest) {
        return format!("{first} to {last}, {} h apart", rounded(widest.0));
    }
    let alone = gaps.iter().filter(|gap| apart(gap.0)).count() == 1;
    let begins = if alone { format!(", the widest gap after {} h", widest.1) } else { String::new() };
    format!("{first} to {last}, {} to {} h apart{begins}", rounded(narrowest), rounded(widest.0))
}

impl Export {
    pub(crate) fn run(&self, console: &Console) -> Result<()> {
        let start = std::time::Instant::now();
        let dataset = Dataset::open(&self.folder)?;
        let exported = export(&dataset, self.layout, &self.out, console)?;
        for what in &exported.omitted {
            console.say(format!("omitted: {what}"));
        }
        let (files, hours) = (count(exported.files, "file"), count(exported.hours.len(), "hour"));
        let size = exported.bytes as f64 / 1e6;
        let pages = count(dataset.config.pages.len(), "lightmap");
        console.say(format!("{}: {pages}, {hours}, {files}, {size:.1} MB", self.out.display()));
        console.result(&json!({
            "out": self.out,
            "layout": self.layout.name(),
            "lightmaps": dataset.config.pages.len(),
            "hours": exported.hours,
            "omitted": exported.omitted,
            "files": exported.files,
            "bytes": exported.bytes,
            "seconds": start.elapsed().as_secs_f64(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::spacing;

    #[test]
    fn spacing_of_hours_in_words() {
        let day: Vec<f64> = (0..24).map(f64::from).collect();
        assert_eq!(spacing(&day), "0 to 23, 1 h apart");
        assert_eq!(spacing(&[6.0]), "6 only, so light never changes");
        let gap: Vec<f64> = day.iter().copied().filter(|&hour| hour != 6.0).collect();
        assert_eq!(spacing(&gap), "0 to 23, 1 to 2 h apart, the widest gap after 5 h");
        assert_eq!(spacing(&[6.0, 18.1, 18.3]), "6 to 18.3, 0.2 to 12.1 h apart, the widest gap after 6 h");
        assert_eq!(
            spacing(&[0.0, 1.0, 12.5, 13.5]),
            "0 to 13.5, 1 to 11.5 h apart, the widest gap after 1 h"
        );
        assert_eq!(spacing(&[0.0, 1.0, 12.0, 13.0]), "0 to 13, 1 to 11 h apart");
    }
}
