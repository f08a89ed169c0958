//! EXR files, one per hour: found by a pattern of their names, or listed in a TOML file.

use super::incoming::{Incoming, IncomingFrame, IncomingPage, Light, MaskFile};
use crate::format::{Baked, Group};
use crate::host::inputs::{expect_file, expect_folder};
use crate::image::find_channels;
use crate::layout::EXR;
use crate::{Error, Result};
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// The placeholder of the hour in a pattern.
const HOUR: &str = "{hour}";
/// The unit of light without `unit`.
pub(super) const UNKNOWN_UNIT: &str = "unknown";

/// The files of `folder` whose names match a pattern such as `light_{hour}.exr`, where the hour is 6, 06 or
/// 5.9; 24 is 0. Gives also the names of other EXR files.
pub(super) fn by_pattern(
    folder: &Path,
    pattern: &str,
    mask: Option<&Path>,
    layer: Option<&str>,
) -> Result<(Incoming, Vec<String>)> {
    let wrong = |what: String| Error::invalid(format!("--pattern {pattern}"), what);
    let (before, after) = pattern
        .split_once(HOUR)
        .filter(|(before, after)| !after.contains(HOUR) && !before.contains('/') && !after.contains('/'))
        .ok_or_else(|| {
            wrong(format!("expected the name of a file with {HOUR} once, such as light_{HOUR}.exr"))
        })?;
    expect_folder(folder, "a folder of EXR files")?;
    mask.map_or(Ok(()), |mask| expect_file(mask, "the mask: a PNG, JPEG or EXR image"))?;
    let mut names: Vec<String> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        names.extend(entry.file_name().into_string().ok());
    }
    names.sort();
    let (mut found, mut others): (Vec<(f64, String)>, _) = (Vec::new(), Vec::new());
    for name in names {
        let middle = name.strip_prefix(before).and_then(|rest| rest.strip_suffix(after));
        match middle.and_then(number) {
            Some(hour) if hour <= 24.0 => found.push((hour % 24.0, name)),
            Some(hour) => {
                let what =
                    format!("hour {hour}; expected 0 to 24 (for other names, give the hours in a TOML file)");
                return Err(Error::invalid(folder.join(name).display(), what));
            }
            None if name.to_ascii_lowercase().ends_with(".exr") => others.push(name),
            None => {}
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    if found.is_empty() {
        return Err(wrong(format!("no file in {} matches", folder.display())));
    }
    if let Some(pair) = found.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(wrong(format!(
            "{} and {} both name {} h; expected one file per hour",
            pair[0].1, pair[1].1, pair[0].0
        )));
    }
    let mask = mask.map(|mask| MaskFile::Picture(mask.to_owned()));
    others.retain(|name| !matches!(&mask, Some(MaskFile::Picture(path)) if path.ends_with(name)));
    let frames = found.iter().map(|(_, name)| vec![folder.join(name)]).collect();
    let incoming = Incoming {
        layout: EXR,
        config: None,
        unit: UNKNOWN_UNIT.to_owned(),
        hours: found.iter().map(|(hour, _)| *hour).collect(),
        groups: Vec::new(),
        pages: pages(frames, vec![mask], layer)?,
    };
    Ok((incoming, others))
}

/// Digits, and perhaps a fraction.
fn number(text: &str) -> Option<f64> {
    let plain = text.starts_with(|c: char| c.is_ascii_digit())
        && text.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    text.parse().ok().filter(|_| plain)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    unit: Option<String>,
    layer: Option<String>,
    #[serde(default)]
    page: Vec<TablePage>,
    frame: Vec<TableFrame>,
    #[serde(default)]
    group: Vec<TableGroup>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TablePage {
    mask: Option<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TableFrame {
    hour: Spanned<f64>,
    files: Vec<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TableGroup {
    name: String,
    on: Spanned<Vec<[f64; 2]>>,
}

/// The files that a TOML file names, relative to it.
pub(super) fn by_table(path: &Path) -> Result<Incoming> {
    expect_file(path, "a TOML file that names EXR files")?;
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    // What is wrong, with the line of its place in the text.
    let wrong = |at: Option<Range<usize>>, what: &str| {
        let before = at.and_then(|span| text.get(..span.start));
        let line = before.map_or(String::new(), |before| format!(":{}", 1 + before.matches('\n').count()));
        Error::invalid(format!("{}{line}", path.display()), what)
    };
    let table: Table = toml::from_str(&text).map_err(|error| wrong(error.span(), error.message()))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut frames = table.frame;
    frames.sort_by(|a, b| a.hour.as_ref().total_cmp(b.hour.as_ref()));
    let Some(first) = frames.first() else { return Err(wrong(None, "no [[frame]]; expected one per hour")) };
    let pages_told = if table.page.is_empty() { first.files.len() } else { table.page.len() };
    for frame in &frames {
        let (hour, span) = (frame.hour.as_ref(), Some(frame.hour.span()));
        if !(0.0..24.0).contains(hour) {
            let what = format!("frame of hour {hour}: expected an hour from 0 to below 24");
            return Err(wrong(span, &what));
        }
        if frame.files.len() != pages_told || pages_told == 0 {
            let expected = format!("expected one for each page: {}", pages_told.max(1));
            let what = format!("frame of hour {hour}: {} files; {expected}", frame.files.len());
            return Err(wrong(span, &what));
        }
    }
    if let Some(pair) = frames.windows(2).find(|pair| pair[0].hour.as_ref() == pair[1].hour.as_ref()) {
        let what =
            format!("hour {} occurs twice; expected one file or [[frame]] per hour", pair[1].hour.as_ref());
        return Err(wrong(Some(pair[1].hour.span()), &what));
    }
    let mut groups = Vec::with_capacity(table.group.len());
    for TableGroup { name, on } in table.group {
        let span = on.span();
        let group = Group { name, on: on.into_inner(), baked: Baked::All };
        if let Some(what) = group.faults_of_schedule().next() {
            return Err(wrong(Some(span), &what));
        }
        groups.push(group);
    }
    let masks: Vec<Option<PathBuf>> =
        (0..pages_told).map(|page| Some(folder.join(table.page.get(page)?.mask.as_ref()?))).collect();
    for mask in masks.iter().flatten() {
        expect_file(mask, &format!("a PNG, JPEG or EXR image: {} names it as a mask", path.display()))?;
    }
    let files: Vec<Vec<PathBuf>> =
        frames.iter().map(|frame| frame.files.iter().map(|file| folder.join(file)).collect()).collect();
    for file in files.iter().flatten() {
        expect_file(file, &format!("an EXR image: {} names it in a [[frame]]", path.display()))?;
    }
    let masks = masks.into_iter().map(|mask| mask.map(MaskFile::Picture)).collect();
    Ok(Incoming {
        layout: EXR,
        config: None,
        unit: table.unit.unwrap_or_else(|| UNKNOWN_UNIT.to_owned()),
        hours: frames.iter().map(|frame| *frame.hour.as_ref()).collect(),
        groups,
        pages: pages(files, masks, table.layer.as_deref())?,
    })
}

/// Pages of the size of their first file; `frames[frame][page]` are the files.
fn pages(
    frames: Vec<Vec<PathBuf>>,
    masks: Vec<Option<MaskFile>>,
    layer: Option<&str>,
) -> Result<Vec<IncomingPage>> {
    let page = |(index, mask): (usize, Option<MaskFile>)| {
        let mut size = None;
        let mut own = Vec::with_capacity(frames.len());
        for frame in &frames {
            let path = frame[index].clone();
            let (channels, found) = find_channels(&path, layer)?;
            let (first, expected) = size.get_or_insert_with(|| (path.clone(), found));
            if found != *expected {
                let what = format!(
                    "size {}×{}; expected that of {}, {}×{}",
                    found.0,
                    found.1,
                    first.display(),
                    expected.0,
                    expected.1
                );
                return Err(Error::invalid(path.display(), what));
            }
            own.push(IncomingFrame { whole: Light::Exr(path, channels), shares: None });
        }
        let (width, height) = size.map_or((0, 0), |(_, size)| size);
        Ok(IncomingPage { width, height, masks: mask.into_iter().collect(), frames: own })
    };
    masks.into_iter().enumerate().map(page).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_are_plain_numbers() {
        assert_eq!(["6", "06", "5.9", "18.50"].map(number), [6.0, 6.0, 5.9, 18.5].map(Some));
        for wrong in ["", "-6", "+6", "1e1", "6h", ".5", "inf", "5.9.1", " 6"] {
            assert_eq!(number(wrong), None, "{wrong:?}");
        }
    }
}
