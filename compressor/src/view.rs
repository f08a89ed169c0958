//! A browser page that plays a bundle: [`Source`] finds its files, [`page()`] puts all into one file,
//! [`serve()`] serves it piece by piece. The page's sources are in `compressor/view/`.

mod glb;
mod serve;
mod source;

pub use serve::{Server, serve};
pub use source::{Options, Source};

use crate::{Error, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dataset::host::files::write_atomically;
use dataset::store::MANIFEST;
use serde_json::{Value, json};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Largest content of one page, in bytes before base64; `--serve` has no such bound.
pub const MOST_BYTES: u64 = 128 << 20;
/// Bytes for references in a page: 4 bytes a texel, as many frames as fit.
const REFERENCE_BYTES: u64 = 4 << 20;
/// The hours whose references are wanted first.
const WANTED: [f64; 8] = [12.0, 18.5, 21.0, 7.0, 15.0, 9.5, 0.0, 4.0];

/// Marker that identifies a page among other HTML files; it is in `shell.html`, within this many bytes.
const MARK: &str = "<meta name=\"generator\" content=\"compress view\">";
const MARK_WITHIN: u64 = 512;
/// A dataset's report, by its name.
const REPORT: &str = "report.html";

const SHELL: &str = include_str!("../view/shell.html");
const STYLE: &str = include_str!("../view/style.css");
const SCRIPTS: [&str; 7] = [
    include_str!("../view/bundle.js"),
    include_str!("../view/tile.js"),
    include_str!("../view/planes.js"),
    include_str!("../view/sun.js"),
    include_str!("../view/gpu.js"),
    include_str!("../view/scene.js"),
    include_str!("../view/page.js"),
];

/// The page with everything in it.
///
/// # Errors
/// `Unsupported` past [`MOST_BYTES`]; what cannot be read.
pub fn page(source: &Source) -> Result<String> {
    let frames = source.sets_within(REFERENCE_BYTES);
    let mut names = source.names(&frames);
    let bytes = names.iter().map(|name| source.len(name)).sum::<Result<u64>>()?;
    if bytes > MOST_BYTES {
        let what =
            format!("{bytes} bytes are too many for one page, which holds up to {MOST_BYTES}; use --serve");
        return Err(Error::unsupported(source.bundle.display(), what));
    }
    names.sort();
    let mut data = String::new();
    for name in names {
        data += &format!("<script type=\"text/plain\" id=\"data-{name}\">");
        STANDARD.encode_string(source.read(&name)?, &mut data);
        data += "</script>\n";
    }
    Ok(shell(source, &frames, &data))
}

/// Writes the page of a dataset's bundle into the dataset's folder and returns its path; `None` if it is too
/// large for one page.
///
/// # Errors
/// What [`Source::open`], [`expect_replaceable`] and writing say.
pub fn write_into_dataset(dataset: &Path, force: bool) -> Result<Option<PathBuf>> {
    let source = Source::open(dataset, &Options::default())?;
    let html = match page(&source) {
        Err(Error::Unsupported { .. }) => return Ok(None),
        html => html?,
    };
    let path = source.page_path();
    expect_replaceable(&path, force)?;
    write_atomically(&path, html.as_bytes())?;
    Ok(Some(path))
}

/// An error if an HTML file that is not a page of `compress view` would be replaced. `force` allows all but a
/// dataset's report.
///
/// # Errors
/// Such a file.
pub fn expect_replaceable(path: &Path, force: bool) -> Result<()> {
    let is_report = path.file_name().is_some_and(|name| name.eq_ignore_ascii_case(REPORT));
    if is_report && path.with_file_name(MANIFEST).exists() {
        return Err(Error::invalid(path.display(), "is a dataset's report; choose another file with --out"));
    }
    if force || !path.exists() || is_page(path) {
        return Ok(());
    }
    let what =
        "was not written by `compress view`; choose another file with --out, or replace it with --force";
    Err(Error::invalid(path.display(), what))
}

/// True if a file is a page, or empty, so it may be replaced.
fn is_page(path: &Path) -> bool {
    let mut first = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MARK_WITHIN).read_to_end(&mut first));
    read.is_ok() && (first.is_empty() || first.windows(MARK.len()).any(|bytes| bytes == MARK.as_bytes()))
}

/// The page that fetches its data from where it came from.
pub(crate) fn shell_of_server(source: &Source) -> String {
    let all: Vec<usize> = (0..source.frames()).collect();
    shell(source, &all, "")
}

fn shell(source: &Source, frames: &[usize], data: &str) -> String {
    // `<` starts no tag within the JSON.
    let meta = meta(source, frames).to_string().replace('<', "\\u003c");
    let title = escape(&format!("{}: the day", source.scene_name));
    let fields: [(&str, &str); 5] = [
        ("{{title}}", &title),
        ("{{style}}", STYLE),
        ("{{meta}}", &meta),
        ("{{data}}", data),
        ("{{scripts}}", &SCRIPTS.join("\n")),
    ];
    // Each field once, in order: inserted text is not searched again.
    let (mut page, mut rest) = (String::new(), SHELL);
    for (field, text) in fields {
        let (before, after) = rest.split_once(field).unwrap_or((rest, ""));
        page.extend([before, text]);
        rest = after;
    }
    page + rest
}

fn meta(source: &Source, frames: &[usize]) -> Value {
    let hours: Vec<f64> = frames.iter().map(|&frame| source.hour(frame)).collect();
    let note = match (frames.len(), &source.omitted) {
        (0, Some(why)) => format!("There is no reference: {why}."),
        (0, None) => {
            "There is no reference: the bundle is not in a dataset's folder, or the reference was omitted."
                .to_owned()
        }
        (n, _) => format!(
            "The reference is the dataset's lightmaps of {n} of {} frames, as RGB9E5 times a power of two for each page and frame: 9 bits per channel with \
             a common exponent, error at most 1/1024 of the power of two above the texel's brightest channel, down to 2⁻³⁰ of the page's. The dataset \
             itself has 32-bit floats. Reference views go by the stored hours. PSNR here is that of the bundle's tiles, which own 126² texels; \
             `compress evaluate` judges blocks of 128² texels, so that its numbers differ.",
            source.frames()
        ),
    };
    json!({
        "title": source.title(),
        "scene_file": source.scene.is_some(),
        "cameras": source.cameras,
        "reference": { "hours": hours, "sets": frames, "precision": "RGB9E5", "note": note },
    })
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_replaces_pages_alone() {
        assert!(SHELL.find(MARK).is_some_and(|at| at + MARK.len() < MARK_WITHIN as usize));
        let folder = tempfile::tempdir().unwrap();
        let [page, report] = ["day.html", REPORT].map(|name| folder.path().join(name));
        assert!(expect_replaceable(&page, false).is_ok());
        for (text, is_free) in [(SHELL, true), ("", true), ("<!doctype html><p>A diary", false)] {
            std::fs::write(&page, text).unwrap();
            assert_eq!(expect_replaceable(&page, false).is_ok(), is_free, "{text}");
            assert!(expect_replaceable(&page, true).is_ok());
        }
        assert!(expect_replaceable(&report, true).is_ok());
        std::fs::write(folder.path().join(MANIFEST), "{}").unwrap();
        assert!(expect_replaceable(&report, true).unwrap_err().to_string().contains("dataset's report"));
    }
}
