//! Results of the rendering: numbers and pictures.

use super::super::judge::image;
use super::super::table::{Comparison, Shown as ShownTiles, decibels, enlarged};
use super::super::tiles::{Texels, TileSet};
use super::lapse::Line;
use super::times::Shown;
use super::{Picture, SHOWN};
use dataset::pictures::View;
use dataset::pictures::preview::{exposure, tone_mapped_png};
use dataset::store::Dataset;
use serde::Serialize;

/// Name of the dataset's own light.
pub(super) const REFERENCE: &str = "reference";
/// The methods whose tiles are shown close up.
const NEAR: [&str; 4] = ["NDGI M", "NTC L", "ASTC 12×12", "BC7"];
/// Screen pixels of a texel, along a side.
const ZOOM: usize = 3;

/// A picture of the scene in the light of a method, against that in the dataset's, over the pixels that show
/// texels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Seen {
    pub camera: String,
    pub hour: f64,
    pub method: String,
    /// Its bits per texel and frame.
    pub bpp: f64,
    /// Its size over the whole day.
    pub bytes: f64,
    /// Of 8-bit sRGB codes, at the exposure of the dataset's picture.
    pub psnr_db: f64,
    /// The same pictures' structural similarity.
    pub ssim: f64,
    /// And their ꟻLIP.
    pub flip: f64,
}

/// A tile close up in the light of a method.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Crop {
    /// Which of the tiles it is.
    pub what: String,
    /// Its page, column and row.
    pub tile: [usize; 3],
    pub hour: f64,
    pub method: String,
    /// Of the linear light, as in the table.
    pub psnr_db: Option<f64>,
    /// What a tile takes over the whole day, on average.
    pub bytes: f64,
}

/// A row of pictures with its title.
type Pictures = (String, Vec<(String, Vec<u8>)>);

/// The scene in the light of some methods.
#[derive(Clone, Debug, Serialize)]
pub struct Rendered {
    pub(super) scene: String,
    pub cameras: Vec<String>,
    pub times: Vec<Shown>,
    pub views: Vec<Seen>,
    /// Tiles close up.
    pub crops: Vec<Crop>,
    /// The camera of the day in half hours.
    pub lapse_camera: String,
    /// Mean change of light from one half hour to the next, in shares of white as exposed.
    pub lapse_change: f64,
    /// Temporal error of each method.
    pub lapse: Vec<Line>,
    /// What was skipped, and why.
    pub skipped: Vec<String>,
    #[serde(skip)]
    pub(super) rows: Vec<Pictures>,
    #[serde(skip)]
    pub(super) near: Vec<Pictures>,
}

impl Rendered {
    pub(super) fn new(dataset: &Dataset, views: &[View], times: &[Shown], skipped: Vec<String>) -> Self {
        Rendered {
            scene: dataset.config.scene.clone(),
            cameras: views.iter().map(|view| view.camera.name.clone()).collect(),
            times: times.to_vec(),
            views: Vec::new(),
            crops: Vec::new(),
            lapse_camera: String::new(),
            lapse_change: 0.0,
            lapse: Vec::new(),
            skipped,
            rows: Vec::new(),
            near: Vec::new(),
        }
    }

    /// The pictures of each time and camera, the dataset's first.
    pub(super) fn add_rows(&mut self, views: &[View], times: &[Shown], pictures: Vec<Picture>) {
        for (i, time) in times.iter().enumerate() {
            for (v, view) in views.iter().enumerate() {
                let camera = &view.camera.name;
                let caption = |method: &str| {
                    let is_it = |seen: &&Seen| {
                        (seen.hour, &seen.camera, &*seen.method) == (time.hour, camera, method)
                    };
                    self.views.iter().find(is_it).map_or(method.to_owned(), Seen::caption)
                };
                let of = pictures.iter().filter(|picture| (picture.time, picture.view) == (i, v));
                let mut of: Vec<&Picture> = of.collect();
                of.sort_by_key(|picture| order(&picture.method));
                let of = of.iter().map(|picture| (caption(&picture.method), picture.png.clone()));
                self.rows.push((format!("{} h, {}: {camera}", short(time.hour), time.what), of.collect()));
            }
        }
        self.views.sort_by_key(|seen| order(&seen.method));
        self.lapse.sort_by_key(|line| order(&line.method));
    }

    /// The worst, the median and the best tile of NDGI M (of the first method without it), each at the frame
    /// that is shown of it.
    pub(super) fn add_crops(
        &mut self,
        set: &TileSet,
        comparison: &Comparison,
        of_tiles: &[usize],
        shown: &[ShownTiles],
    ) {
        let Some(by) = shown.iter().find(|shown| shown.method == NEAR[0]).or(shown.first()) else { return };
        let decibels_of = |i: usize| by.images[i].1;
        let mut tiles: Vec<usize> = (0..set.tiles.len()).filter(|&i| decibels_of(i).is_some()).collect();
        tiles.sort_by(|&a, &b| decibels_of(a).partial_cmp(&decibels_of(b)).unwrap_or(a.cmp(&b)));
        let n = tiles.len();
        let mut chosen: Vec<(&str, usize)> = Vec::new();
        for (which, at) in [("worst", 0), ("median", n / 2), ("best", n.saturating_sub(1))] {
            if let Some(&i) = tiles.get(at).filter(|i| chosen.iter().all(|(_, chosen)| chosen != *i)) {
                chosen.push((which, i));
            }
        }
        for (which, i) in chosen {
            let (tile, k) = (&set.tiles[i], of_tiles[i]);
            let (hour, place) = (set.timeline.hours[k], &tile.place);
            let reference = image(tile, &tile.source.frames[k]);
            let bright = exposure(&reference, &tile.mask);
            let png = |texels: &Texels| {
                let (image, mask) = enlarged(&image(tile, texels), &tile.mask, ZOOM);
                tone_mapped_png(&image, &mask, bright, image.width.max(image.height))
            };
            let mut pictures = vec![(REFERENCE.to_owned(), png(&tile.source.frames[k]))];
            for name in NEAR {
                let Some(shown) = shown.iter().find(|shown| shown.method == name) else { continue };
                let (texels, db) = &shown.images[i];
                let bpp = comparison.method(name).map_or(0.0, |row| row.bpp);
                let bytes = bpp / 8.0 * (tile.texels() * set.timeline.hours.len()) as f64;
                pictures.push((format!("{name}: {} dB, {}", decibels(*db), size(bytes)), png(texels)));
                self.crops.push(Crop {
                    what: which.to_owned(),
                    tile: [place.page, place.column, place.row],
                    hour,
                    method: name.to_owned(),
                    psnr_db: *db,
                    bytes,
                });
            }
            let title = format!(
                "The {which} tile of {}: page {}, tile ({}, {}) at {} h",
                by.method,
                place.page,
                place.column,
                place.row,
                short(hour)
            );
            self.near.push((title, pictures));
        }
    }
}

impl Seen {
    fn caption(&self) -> String {
        format!(
            "{}: {:.1} dB, SSIM {:.4}, ꟻLIP {:.4}; {:.2} bpp, {}",
            self.method,
            self.psnr_db,
            self.ssim,
            self.flip,
            self.bpp,
            size(self.bytes)
        )
    }
}

/// The dataset's light first, then the methods as [`SHOWN`] has them, then the others.
fn order(method: &str) -> usize {
    if method == REFERENCE {
        return 0;
    }
    SHOWN.iter().position(|shown| *shown == method).map_or(SHOWN.len() + 1, |i| i + 1)
}

/// An hour without needless digits.
pub(super) fn short(hour: f64) -> String {
    format!("{}", (hour * 1e3).round() / 1e3)
}

/// Such as `653 kB`.
pub(super) fn size(bytes: f64) -> String {
    match bytes {
        0.0..1e6 => format!("{:.1} kB", bytes / 1e3),
        _ => format!("{:.2} MB", bytes / 1e6),
    }
}
