//! The datasheet of a scene: content, method and known limits.

use super::{Archive, LAYERS, READER, SUMS};
use crate::format::Config;
use crate::observe::count;
use std::fmt::Write;

/// The datasheet's content besides the manifest: names and lengths of the files.
pub(super) struct Files<'a> {
    pub archives: &'a [(Archive, u64)],
    pub bundles: &'a [(String, u64)],
    pub previews: &'a [String],
    /// What the layouts of exchange omit.
    pub omitted: &'a [String],
    /// True if the dataset is released under CC0.
    pub cc0: bool,
}

pub(super) fn datasheet(config: &Config, files: &Files) -> String {
    let mut text = format!("# {}\n\n", plain(&config.scene));
    let (frames, pages) = (count(config.frames.len(), "frame"), count(config.pages.len(), "page"));
    let _ = match &config.transfer {
        None => writeln!(
            text,
            "A dataset of temporal lightmaps: the light that arrives at the surfaces of one scene, {frames} over one day, \
             {pages}, as float32 images.\n"
        ),
        Some(transfer) => writeln!(
            text,
            "The transfer of the scene {}: the light that arrives at its surfaces under spherical harmonics as the sky, {frames}, \
             {pages}, as float32 images. Their hours are not times of day: `transfer` in `config.json` says which part of \
             which function each frame is, and with which coefficients they add up to the scene's daylight.\n",
            plain(&transfer.scene)
        ),
    };
    for name in files.previews {
        let _ = writeln!(text, "![{}]({})", plain(name), link(name));
    }
    text.push_str(
        "\nPictures are tone-mapped, each hour with its own exposure; grey texels lie on no surface.\n",
    );
    contents(&mut text, config, files);
    how_made(&mut text, config);
    frames_table(&mut text, config);
    limits(&mut text, config);
    text.push_str("\n## Licence\n\n");
    text.push_str(match (files.cc0, &config.source) {
        (true, _) => {
            "CC0 1.0: to the extent possible under law, all rights are waived \
             (https://creativecommons.org/publicdomain/zero/1.0/).\n"
        }
        (false, None) => "Not stated; ask the publisher.\n",
        (false, Some(_)) => "That of the imported dataset; this release grants no other.\n",
    });
    text
}

fn contents(text: &mut String, config: &Config, files: &Files) {
    text.push_str("\n## Files\n\n| file | what | MB | unpacked, MB |\n|---|---|---|---|\n");
    let more = [
        (config.noise.is_some(), ", sampling error"),
        (config.geometry.is_some(), ", geometry with lightmap coordinates"),
        (config.visibility.is_some(), ", the sun's visibility as a function of time"),
    ];
    let more: String = more.into_iter().filter(|(there, _)| *there).map(|(_, what)| what).collect();
    let frames = format!("config.json, masks, the lightmaps of all frames{more}");
    for (archive, bytes) in files.archives {
        let what = match &*archive.holds {
            "sets" => &*frames,
            "sun" => "the sun's share of each lightmap",
            "sky" => "the sky's share of each lightmap",
            "lamps" => "the light of each light group",
            _ => "the lightmaps in a layout of raw files",
        };
        let unpacked: u64 = archive.files.iter().map(|file| file.bytes).sum();
        let _ = writeln!(text, "| {} | {what} | {} | {} |", plain(&archive.name), mb(*bytes), mb(unpacked));
    }
    for (name, bytes) in files.bundles {
        let _ = writeln!(
            text,
            "| {} | compressed lightmaps (NDGI), from the dataset's folder | {} | |",
            plain(name),
            mb(*bytes)
        );
    }
    for what in files.omitted {
        let _ = writeln!(text, "\nOmitted from {}", plain(what));
    }
    let layered =
        files.archives.iter().any(|(archive, _)| ["sun", "sky", "lamps"].contains(&&*archive.holds));
    let _ = writeln!(
        text,
        "\n`sha256sum -c --ignore-missing {SUMS}` verifies the downloaded files; `zstd -dc FILE | tar -x` or `tar --zstd -xf FILE` \
         unpacks an archive. The archive of lightmaps can be used alone, for example with `{READER}` \
         and `blake3_numpy.py` (Python with numpy and OpenEXR)."
    );
    if layered {
        let _ = writeln!(
            text,
            "The archives of layers unpack into the same folder. `config.json` lists only the lightmaps, `{LAYERS}` also the layers: \
             once all are unpacked, replace `config.json` with it."
        );
    }
}

fn how_made(text: &mut String, config: &Config) {
    text.push_str("\n## How it was made\n\n");
    let _ = match &config.source {
        None => writeln!(
            text,
            "Path traced by {}, up to {} samples per texel and layer, seed {}. Texels hold {}.",
            plain(&config.generator),
            config.samples,
            config.seed,
            plain(&config.unit)
        ),
        Some(source) => writeln!(
            text,
            "Imported from the layout {} by {}. Unit: {}. {} outside the masks were negative or not finite and are 0.",
            source.layout,
            plain(&config.generator),
            plain(&config.unit),
            count(source.replaced_values as usize, "value")
        ),
    };
    text.push('\n');
    for (index, page) in config.pages.iter().enumerate() {
        let _ = writeln!(text, "- page {index}: {}×{} texels", page.width, page.height);
    }
    for group in &config.groups {
        let on: Vec<String> = group.on.iter().map(|[from, to]| format!("{from} to {to} h")).collect();
        let on = if on.is_empty() { "never on".to_owned() } else { format!("on {}", on.join(", ")) };
        let _ = writeln!(text, "- light group “{}”: {on}", plain(&group.name));
    }
    if config.settings.as_object().is_some_and(|settings| !settings.is_empty())
        && let Ok(settings) = serde_json::to_string_pretty(&config.settings)
    {
        let _ = writeln!(text, "\nAll settings:\n\n```json\n{settings}\n```");
    }
}

fn frames_table(text: &mut String, config: &Config) {
    text.push_str("\n## Estimated error by the hour\n\n");
    text.push_str(
        "The standard error of sampling, root mean square over surfaces, ÷ their mean light. Errors by tile are in the file that \
         `noise` of `config.json` names.\n\n| hour | light groups on | error, % |\n|---|---|---|\n",
    );
    for frame in &config.frames {
        let on: Vec<String> = config.names_on(frame).map(plain).collect();
        let error =
            frame.relative_error.map_or("not known".to_owned(), |error| format!("{:.2}", 100.0 * error));
        let _ = writeln!(text, "| {} | {} | {error} |", frame.hour, on.join(", "));
    }
}

fn limits(text: &mut String, config: &Config) {
    text.push_str("\n## Known limits\n\n");
    if config.source.is_none() {
        text.push_str(
            "- The error above is only that of sampling. It includes neither the bias of the method (light is cached in texels and patches \
             unless the settings say `path`) nor thin shadows that all pilot samples missed.\n\
             - Surfaces are diffuse; a texel stores irradiance without direction.\n\
             - One day at one place; no weather.\n",
        );
    }
    text.push_str(
        "- Texels outside the masks are copies of their neighbours or undefined; exclude them from metrics.\n\
         - Interpolate lightmaps between two frames only where the same light groups are on. Layers say how their light changes between frames.\n\
         - The quality of a bundle was not measured against this dataset.\n",
    );
}

fn mb(bytes: u64) -> String {
    format!("{:.2}", bytes as f64 / 1e6)
}

/// A text of others that Markdown does not read as its own.
fn plain(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\\' | '`' | '*' | '_' | '[' | ']' | '<' | '>' | '#' | '|' | '&' => out.extend(['\\', c]),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// A file's name as the target of a link.
fn link(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for byte in name.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'.' | b'-' | b'_' => out.push(byte.into()),
            byte => _ = write!(out, "%{byte:02X}"),
        }
    }
    out
}
