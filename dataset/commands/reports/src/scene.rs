//! Pictures of the scene at a few hours, at the top of a report.

use crate::Section;
use dataset::Result;
use dataset::format::Config;
use dataset::image::Image;
use dataset::pictures::View;
use dataset::store::Dataset;

/// Hours whose nearest frames are shown: morning, noon, right after an evening switch, midnight.
const SHOWN_HOURS: [f64; 4] = [6.0, 12.0, 18.1, 0.0];
/// Width and height of a picture in pixels.
pub const PICTURE: [usize; 2] = [480, 270];

/// The frames to show, each once.
pub fn shown_frames(config: &Config) -> Vec<usize> {
    let mut shown: Vec<usize> = Vec::new();
    for wanted in SHOWN_HOURS {
        let nearest = config.nearest_frame(wanted);
        shown.extend(nearest.filter(|k| !shown.contains(k)));
    }
    shown
}

/// The caption of a view's pictures: the camera, and what they omit.
pub fn remark(view: &View) -> String {
    let with_texels = view.with_texels();
    let plain = match with_texels.iter().all(|share| *share == 1.0) {
        true => "",
        false => {
            " Surfaces without texels are lit evenly, without shadows; panes, glowing lamps and the sky's appearance are omitted."
        }
    };
    format!("From the camera “{}”, each hour with its own exposure.{plain}", view.camera.name)
}

/// The scene in a dataset's light. `None` without a geometry file, and for the transfer of a scene, which is
/// not the light of a day. If the geometry file is damaged, the section says so.
///
/// # Errors
/// As reading the lightmaps.
pub fn section(dataset: &Dataset) -> Result<Option<Section>> {
    if dataset.config.transfer.is_some() {
        return Ok(None);
    }
    let mut section = Section::new("The scene");
    let view = match View::of(dataset, PICTURE) {
        Ok(None) => return Ok(None),
        Ok(Some(view)) => view,
        Err(error) => {
            section.paragraph(&format!("The scene is not shown: {error}."));
            return Ok(Some(section));
        }
    };
    let config = &dataset.config;
    let picture = |frame: usize| {
        let light = view.light(config, |page, rows| {
            let width = config.pages[page].width as usize;
            let texels = dataset.map_rows(frame, page, rows.start, rows.end)?;
            Ok(Image { width, height: rows.len(), texels })
        })?;
        let png = view.to_png(&light, view.exposure(&light));
        Ok((format!("{} h", config.frames[frame].hour), vec![png]))
    };
    let pictures: Vec<_> = shown_frames(config).into_iter().map(picture).collect::<Result<_>>()?;
    section.row(&pictures).paragraph(&remark(&view));
    Ok(Some(section))
}
