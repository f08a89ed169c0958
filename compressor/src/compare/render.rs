//! Renders the scene with the light of some methods, measures temporal error over a day, and shows tiles
//! close up: the paper's figures.
//!
//! A method is rendered right after it is evaluated, from its decoded tiles, which are then dropped; 8-bit
//! pictures remain. `times`: which times are shown; `pages`: light of tiles as pages; `lapse`: a day in half
//! hours; `results`: numbers and pictures; `page`: the HTML page.

mod times;
mod pages;
mod lapse;
mod results;
mod page;
#[cfg(test)]
mod tests;

pub(super) use results::Rendered;

use super::method::Way;
use super::table::{Comparison, Row, Shown as ShownTiles};
use super::tiles::{Texels, TileSet};
use crate::compress::default_bundle;
use crate::decode::{Decoder, Lights};
use crate::evaluate::{expect_match, with_texels};
use crate::{Error, Result, of_bundle};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::{Image, Mask};
use dataset::observe::Observer;
use dataset::pictures::metrics::{PSNR_CAP_DB, compare_pictures};
use dataset::pictures::{Light, View};
use dataset::store::Dataset;
use lapse::Lapse;
use ndgi::Bundle;
use pages::Pages;
use reports::scene::PICTURE;
use results::Seen;
use std::borrow::Cow;
use times::Shown;

/// The methods that are rendered.
const SHOWN: [&str; 4] = ["NDGI M", "NTC L", "PRT, clustered PCA", "ASTC 12×12"];
/// The dataset's uncompressed frames: the error of linear interpolation alone.
pub(super) const FRAMES: &str = "frames, linear";
/// Their size as float16, in bits per texel and frame.
const FRAMES_BPP: f64 = 48.0;
/// Largest number of cameras.
const CAMERAS: usize = 3;

/// Pictures of a time by a camera: the dataset's, and how all are exposed.
struct Reference {
    codes: Vec<u8>,
    exposure: f64,
}

/// A picture of a row: of which time, by which camera, in whose light.
struct Picture {
    time: usize,
    view: usize,
    method: String,
    png: Vec<u8>,
}

/// State of the rendering.
pub(super) struct Stage<'a> {
    dataset: &'a Dataset,
    set: &'a TileSet,
    pages: Pages<'a>,
    views: Vec<View>,
    /// Per view, the pixels that show texels.
    judged: Vec<Mask>,
    times: Vec<Shown>,
    /// Per time and view.
    references: Vec<Vec<Reference>>,
    lapse: Lapse,
    pictures: Vec<Picture>,
    reported: Rendered,
}

/// A method to render: its name and bits, and whether it is also rendered at the frames' hours.
struct Part<'a> {
    method: &'a str,
    bpp: f64,
    bytes: f64,
    at_frames: bool,
}

impl<'a> Stage<'a> {
    /// Renders the scene with the dataset's own light, and with that of its bundle if there is one.
    ///
    /// # Errors
    /// [`Error::Invalid`] without geometry, or where nothing in it has texels.
    pub(super) fn new(dataset: &'a Dataset, set: &'a TileSet, console: &dyn Observer) -> Result<Self> {
        let views = View::each(dataset, PICTURE, CAMERAS)?;
        if views.is_empty() {
            let what = match &dataset.config.geometry {
                None => {
                    "has no geometry file, so nothing can be rendered; use a dataset made by `bake`, or omit --render"
                }
                Some(_) => "nothing in its geometry has texels, so nothing can be rendered; omit --render",
            };
            return Err(Error::invalid(dataset.root.display(), what));
        }
        let pages = Pages::new(dataset, set)?;
        let (times, mut skipped) = times::choose(dataset)?;
        let hours = lapse::hours(dataset)?;
        let progress = console.progress("the dataset's light", (times.len() + hours.len()) as u64);
        let judged = views.iter().map(with_texels).collect();
        let mut references = Vec::new();
        let mut pictures = Vec::new();
        for (i, time) in times.iter().enumerate() {
            stop_if_interrupted()?;
            let images = pages.of_dataset(time.hour, time.frame)?;
            let mut of_views = Vec::new();
            for (v, view) in views.iter().enumerate() {
                let light = lit(view, dataset, &images)?;
                let exposure = view.exposure(&light);
                let png = view.to_png(&light, exposure);
                of_views.push(Reference { codes: view.to_codes(&light, exposure), exposure });
                pictures.push(Picture { time: i, view: v, method: results::REFERENCE.to_owned(), png });
            }
            references.push(of_views);
            progress.advance(1);
        }
        let lapse = Lapse::new(dataset, &pages, hours, &progress)?;
        let bundle = bundle(dataset, &mut skipped)?;
        let reported = Rendered::new(dataset, &views, &times, skipped);
        let mut stage =
            Stage { dataset, set, pages, views, judged, times, references, lapse, pictures, reported };
        let bytes = FRAMES_BPP / 8.0 * set.values();
        let frames = Part { method: FRAMES, bpp: FRAMES_BPP, bytes, at_frames: false };
        stage.add(&frames, &|stage, hour| Ok(stage.pages.of_tiles(&stage.frames(hour))))?;
        if let Some(bundle) = bundle {
            stage.add_bundle(bundle)?;
        }
        Ok(stage)
    }

    /// Renders a method if it is one of [`SHOWN`].
    pub(super) fn show(&mut self, row: &Row, way: &Way) -> Result<()> {
        if !SHOWN.contains(&&*row.method) {
            return Ok(());
        }
        let part = Part { method: &row.method, bpp: row.bpp, bytes: way.coded.bits / 8.0, at_frames: true };
        self.add(&part, &|stage, hour| {
            let tiles = match &way.at_hour {
                Some(at_hour) => at_hour(hour)?,
                None => between(stage.set, hour, |tile, k| &way.coded.decoded[tile][k]),
            };
            Ok(stage.pages.of_tiles(&tiles))
        })
    }

    /// The numbers and pictures of all that was shown, and tiles close up as `shown` has them, each at the
    /// frame `of_tiles`.
    pub(super) fn finish(
        mut self,
        comparison: &Comparison,
        of_tiles: &[usize],
        shown: &[ShownTiles],
    ) -> Result<Rendered> {
        self.reported.lapse = self.lapse.lines;
        self.reported.lapse_camera = self.lapse.view.camera.name.clone();
        self.reported.lapse_change = self.lapse.change;
        self.reported.add_rows(&self.views, &self.times, self.pictures);
        self.reported.add_crops(self.set, comparison, of_tiles, shown);
        Ok(self.reported)
    }

    /// The dataset's frames as methods code them, linear between the hours.
    fn frames(&self, hour: f64) -> Vec<Texels> {
        between(self.set, hour, |tile, k| &self.set.tiles[tile].source.frames[k])
    }

    fn add_bundle(&mut self, decoder: Decoder) -> Result<()> {
        let bundle = decoder.bundle();
        let bytes = bundle.bytes as f64;
        let config = &self.dataset.config;
        let texels: f64 =
            config.pages.iter().map(|page| f64::from(page.width) * f64::from(page.height)).sum();
        let bpp = 8.0 * bytes / (texels * config.frames.len() as f64);
        let method = match bundle.header.sun {
            Some(_) => "bundle, separate sun",
            None => "bundle",
        };
        self.add(&Part { method, bpp, bytes, at_frames: true }, &|stage, hour| {
            let page = |page: usize| {
                let rows = 0..stage.dataset.config.pages[page].height as usize;
                let image = crate::evaluate::decode(&decoder, Lights::All, page, hour, &rows)?;
                Ok(stage.pages.filled(page, image))
            };
            (0..stage.dataset.config.pages.len()).map(page).collect()
        })
    }

    /// Renders light at every time from every camera, and over the day.
    fn add(&mut self, part: &Part, at_hour: &dyn Fn(&Stage, f64) -> Result<Vec<Image>>) -> Result<()> {
        for (i, time) in self.times.iter().enumerate() {
            if time.frame.is_some() && !part.at_frames {
                continue;
            }
            stop_if_interrupted()?;
            let images = at_hour(self, time.hour)?;
            for (v, view) in self.views.iter().enumerate() {
                let light = lit(view, self.dataset, &images)?;
                let Reference { codes, exposure } = &self.references[i][v];
                let quality = compare_pictures(&view.to_codes(&light, *exposure), codes, &self.judged[v]);
                self.reported.views.push(Seen {
                    camera: view.camera.name.clone(),
                    hour: time.hour,
                    method: part.method.to_owned(),
                    bpp: part.bpp,
                    bytes: part.bytes,
                    psnr_db: quality.map_or(PSNR_CAP_DB, |quality| quality.psnr_db),
                    ssim: quality.map_or(1.0, |quality| quality.ssim),
                    flip: quality.map_or(0.0, |quality| quality.flip),
                });
                let png = view.to_png(&light, *exposure);
                self.pictures.push(Picture { time: i, view: v, method: part.method.to_owned(), png });
            }
        }
        let line = self.lapse.line(self.dataset, part.method, |hour| at_hour(self, hour))?;
        self.lapse.lines.extend(line);
        Ok(())
    }
}

/// Tiles at an hour: of a frame, or linear between two if no light group switches.
fn between<'t>(set: &TileSet, hour: f64, of: impl Fn(usize, usize) -> &'t Texels) -> Vec<Texels> {
    let time = set.timeline.at(hour);
    let share = time.fraction as f32;
    let mix = |a: &[f32; 3], b: &[f32; 3]| [0, 1, 2].map(|c| (1.0 - share) * a[c] + share * b[c]);
    let tile = |i: usize| match time.a == time.b {
        true => of(i, time.a).clone(),
        false => of(i, time.a).iter().zip(of(i, time.b)).map(|(a, b)| mix(a, b)).collect(),
    };
    (0..set.tiles.len()).map(tile).collect()
}

/// The light of pages on a view.
fn lit(view: &View, dataset: &Dataset, images: &[Image]) -> Result<Light> {
    view.light(&dataset.config, |page, rows| {
        let image = &images[page];
        let texels = image.texels[rows.start * image.width..rows.end * image.width].to_vec();
        Ok(Image { width: image.width, height: rows.len(), texels })
    })
}

/// The dataset's bundle, where there is one of this light.
fn bundle(dataset: &Dataset, skipped: &mut Vec<String>) -> Result<Option<Decoder>> {
    let path = default_bundle(dataset);
    if !path.exists() {
        let how = format!("its own bundle: {} does not exist; `compress` writes it", name(&path));
        skipped.push(how);
        return Ok(None);
    }
    let decoder = Decoder::new(Bundle::open(&path).map_err(of_bundle)?);
    match expect_match(dataset, &decoder) {
        Ok(()) => Ok(Some(decoder)),
        Err(error) => {
            skipped.push(format!("its own bundle, {}: {error}", name(&path)));
            Ok(None)
        }
    }
}

fn name(path: &std::path::Path) -> Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}
