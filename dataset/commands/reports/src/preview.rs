//! The lightmaps at every hour, in a report.

use crate::Section;
use dataset::Result;
use dataset::format::Config;
use dataset::image::{Image, Mask};
use dataset::pictures::preview::{encode, exposure, is_lit, mask_png, reduce};
use dataset::store::Dataset;
use rayon::prelude::*;

/// Largest side of a picture in the section, in pixels; half of it where there are many pages.
const PREVIEW_SIDE: usize = 256;
/// A frame gets another exposure than brighter ones once its own is this many times theirs.
const MUCH_DARKER: f32 = 6.0;
/// The first section of every report: a table of the dataset, its masks, and a preview of every hour.
pub fn section(dataset: &Dataset) -> Result<Section> {
    let config = &dataset.config;
    let mut section = Section::new(&format!("Lightmaps of {}", config.scene));
    let masks = dataset.masks()?;
    section.table(&[], &summary(config, &masks));

    // Every frame of every page, reduced; (frame, page) in this order.
    let side = if config.pages.len() > 2 { PREVIEW_SIDE / 2 } else { PREVIEW_SIDE };
    let pairs: Vec<(usize, usize)> = (0..config.frames.len())
        .flat_map(|frame| (0..config.pages.len()).map(move |page| (frame, page)))
        .collect();
    let reduced = pairs.par_iter().map(|&(frame, page)| reduce(dataset, &masks[page], frame, page, side));
    let reduced: Vec<(Image, Mask)> = reduced.collect::<Result<_>>()?;

    section.subheading(if masks.len() == 1 { "Mask" } else { "Masks" });
    let pictures =
        masks.iter().enumerate().map(|(page, mask)| (page_name(config, page), mask_png(mask, side)));
    section.pictures(&pictures.collect::<Vec<_>>());

    // Day, twilight and night differ by factors of thousands: each group of like brightness has its exposure.
    let own = |(image, mask): &(Image, Mask)| is_lit(image).then(|| exposure(image, mask));
    let of_set = |pages: &[(Image, Mask)]| pages.iter().filter_map(own).min_by(f32::total_cmp);
    let groups = group_by_exposure(&reduced.chunks(masks.len().max(1)).map(of_set).collect::<Vec<_>>());
    if groups.len() > 1 {
        section
            .paragraph("Pictures under one heading share an exposure; ×N is N times that of the brightest.");
    }
    let brightest = groups.first().map_or(1.0, |(exposure, _)| *exposure);
    for (i, (exposure, frames)) in groups.iter().enumerate() {
        section.subheading(&match (i, exposure.is_finite()) {
            (_, false) => "Frames without light".to_owned(),
            (0, _) if groups.len() == 1 => "By hour, at one exposure".to_owned(),
            (0, _) => "By hour, the brightest frames".to_owned(),
            _ => format!("Darker frames, exposure ×{}", short(f64::from(*exposure) / f64::from(brightest))),
        });
        let exposure = if exposure.is_finite() { *exposure } else { 1.0 };
        let indices: Vec<usize> = (0..pairs.len()).filter(|&i| frames.contains(&pairs[i].0)).collect();
        let pictures = indices.par_iter().map(|&i| {
            let ((frame, page), (image, mask)) = (pairs[i], &reduced[i]);
            (caption(config, frame, page), encode(image, mask, exposure))
        });
        section.pictures(&pictures.collect::<Vec<_>>());
    }
    Ok(section)
}

/// Frames of like brightness, the brightest first: the exposure of each group's brightest, and which frames
/// are in it, ascending. Those without light come last, at an infinite exposure.
fn group_by_exposure(own: &[Option<f32>]) -> Vec<(f32, Vec<usize>)> {
    let mut frames: Vec<(f32, usize)> =
        own.iter().enumerate().map(|(frame, own)| (own.unwrap_or(f32::INFINITY), frame)).collect();
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut groups: Vec<(f32, Vec<usize>)> = Vec::new();
    for (exposure, frame) in frames {
        match groups.last_mut() {
            Some((first, frames)) if exposure < MUCH_DARKER * *first || !first.is_finite() => {
                frames.push(frame)
            }
            _ => groups.push((exposure, vec![frame])),
        }
    }
    groups.iter_mut().for_each(|(_, frames)| frames.sort_unstable());
    groups
}

/// The dataset's properties, as rows of a table.
fn summary(config: &Config, masks: &[Mask]) -> Vec<Vec<String>> {
    let row = |name: &str, value: String| vec![name.to_owned(), value];
    let mut rows = vec![row("Scene", config.scene.clone()), row("Written by", config.generator.clone())];
    for (page, mask) in masks.iter().enumerate() {
        let share = 100.0 * mask.count() as f64 / mask.valid.len() as f64;
        let text = format!("{}×{} texels, {share:.1} % on surfaces", mask.width, mask.height);
        rows.push(row(&page_name(config, page), text));
    }
    let hours: Vec<String> = config.frames.iter().map(|frame| hour(frame.hour)).collect();
    rows.push(row("Frames", format!("{}: {} h", config.frames.len(), hours.join(", "))));
    for group in &config.groups {
        let on = group.on.iter().map(|[from, to]| match (*from, *to) {
            (0.0, 24.0) => "always".to_owned(),
            (from, to) => format!("{} to {} h", hour(from), hour(to)),
        });
        let on: Vec<String> = on.collect();
        let on = if on.is_empty() { "never on".to_owned() } else { format!("on {}", on.join(", ")) };
        rows.push(row(&format!("Lights “{}”", group.name), on));
    }
    rows.push(match &config.source {
        None => row("Samples per texel", config.samples.to_string()),
        Some(source) => row("Imported from the layout", source.layout.clone()),
    });
    rows.push(row("Unit", config.unit.clone()));
    let errors = config.frames.iter().filter_map(|frame| Some((frame.relative_error?, frame.hour)));
    if let Some((error, at)) = errors.max_by(|a, b| a.0.total_cmp(&b.0)) {
        rows.push(row(
            "Estimated error of a frame",
            format!(
                "at most {:.2} % (at {} h): the sampling's standard error, root mean square over the page, ÷ the page's mean light",
                100.0 * error,
                hour(at)
            ),
        ));
    }
    rows
}

fn page_name(config: &Config, page: usize) -> String {
    if config.pages.len() == 1 { "Page".to_owned() } else { format!("Page {page}") }
}

/// Such as `18.1 h · porch, garden on`.
fn caption(config: &Config, frame: usize, page: usize) -> String {
    let frame = &config.frames[frame];
    let on: Vec<&str> = config.names_on(frame).collect();
    let mut caption = format!("{} h", hour(frame.hour));
    if config.pages.len() > 1 {
        caption.push_str(&format!(" · page {page}"));
    }
    if !on.is_empty() {
        caption.push_str(&format!(" · {} on", on.join(", ")));
    }
    caption
}

/// An hour without needless digits.
fn hour(hour: f64) -> String {
    format!("{}", (hour * 1e4).round() / 1e4)
}

/// Two significant digits and no more.
fn short(value: f64) -> String {
    if !(0.1..1e15).contains(&value) {
        return format!("{value:.1e}");
    }
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    let rounded = (value / unit).round() * unit;
    if unit < 1.0 { format!("{rounded:.1}") } else { format!("{rounded:.0}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_like_brightness_share_an_exposure() {
        let day = [Some(1000.0), Some(2.0), Some(1.0), Some(5.9), None, Some(6.0), Some(900.0), None];
        let groups = group_by_exposure(&day);
        let expected =
            [(1.0, vec![1, 2, 3]), (6.0, vec![5]), (900.0, vec![0, 6]), (f32::INFINITY, vec![4, 7])];
        assert_eq!(groups, expected);
        assert!(group_by_exposure(&[]).is_empty());
    }
}
