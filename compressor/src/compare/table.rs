//! A comparison as table, CSV, JSON and report section.

use super::judge::{Judged, image};
use super::method::CodedTiles;
use super::tiles::{Texels, TileSet};
use super::{Effort, Options, Rendered};
use crate::evaluate::{aligned, cell};
use dataset::image::{Image, Mask};
use dataset::pictures::preview::{exposure, tone_mapped_png};
use reports::Section;
use reports::plot::Plot;
use serde::Serialize;

/// Quality of a method on all tiles of a run. Means as in [`crate::evaluate::Quality`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// Methods of one family make one line of the plot.
    pub family: &'static str,
    pub method: String,
    /// Bits per stored texel and frame.
    pub bpp: f64,
    pub psnr_db: Option<f64>,
    /// Mean PSNR, peak = largest − smallest.
    pub psnr_range_db: Option<f64>,
    pub psnr_pooled_db: Option<f64>,
    pub psnr_log_db: Option<f64>,
    /// Mean PSNR of the worst 1 %.
    pub psnr_worst_percent_db: Option<f64>,
    pub one_minus_ssim: Option<f64>,
    /// The same with a 7×7 box window.
    pub one_minus_ssim_uniform: Option<f64>,
    pub lpips: Option<f64>,
    pub flip: Option<f64>,
    /// Relative error in the darkest quarter of each frame.
    pub dark_relative_error: Option<f64>,
    /// Error of the change from frame to frame.
    pub step_error: Option<f64>,
    /// The same across switches.
    pub switch_error: Option<f64>,
    /// CPU seconds to encode a tile with all its frames.
    pub encode_seconds: Option<f64>,
    /// CPU milliseconds to decode 1024² texels of one frame.
    pub decode_milliseconds: Option<f64>,
    /// What was chosen.
    pub note: String,
}

/// The columns for people.
const HEADER: [&str; 11] = [
    "method",
    "bpp",
    "PSNR dB",
    "pooled dB",
    "log dB",
    "1 − SSIM",
    "LPIPS",
    "ꟻLIP",
    "step error",
    "encode s/tile",
    "decode ms/1024²",
];

const COLUMNS: &str = "family,method,bpp,psnr_db,psnr_range_db,psnr_pooled_db,psnr_log_db,psnr_worst_percent_db,one_minus_ssim,\
     one_minus_ssim_uniform,lpips,flip,dark_relative_error,step_error,switch_error,encode_seconds,decode_milliseconds,note";

/// Differences that the paper's table shows, in dB: the first method over the second.
const PAPER: [(&str, &str, f64); 6] = [
    ("NDGI M", "NTC L", 3.08),
    ("NDGI M", "BC7", 4.42),
    ("NDGI M", "BC6H", 2.38),
    ("hybrid, profile M", "2D maps alone", 2.8),
    ("hybrid, profile M", "3D map alone, 64²", 8.3),
    ("endpoints and weights, plain BC7", "texel by texel, plain BC7", 6.24),
];

/// A method's image of one frame of each tile, with its PSNR.
pub(super) struct Shown {
    pub method: String,
    pub images: Vec<(Texels, Option<f64>)>,
}

/// A caption and a PNG.
type Picture = (String, Vec<u8>);

/// A comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Tiles of 128×128 texels compared on.
    pub tiles: usize,
    /// Tiles with valid texels that the dataset has.
    pub tiles_of: usize,
    /// Frames.
    pub frames: usize,
    /// True with draft effort.
    pub draft: bool,
    /// True where the rows are the paper's ablations.
    pub ablations: bool,
    /// Mean noise ceiling in dB: what the bake's own sampling error allows.
    pub noise_ceiling_db: Option<f64>,
    /// Every method, by bits.
    pub rows: Vec<Row>,
    /// What was skipped, and why.
    pub skipped: Vec<String>,
    /// The scene in the light of some of the methods, where that was requested.
    pub rendered: Option<Rendered>,
    /// Tiles shown: what and the pictures.
    #[serde(skip)]
    pictures: Vec<(String, Vec<Picture>)>,
}

pub(super) fn decibels(db: Option<f64>) -> String {
    cell(db, 2)
}

impl Row {
    pub(super) fn new(
        set: &TileSet,
        family: &'static str,
        method: &str,
        coded: &CodedTiles,
        judged: &Judged,
    ) -> Self {
        let q = &judged.quality;
        Row {
            family,
            method: method.to_owned(),
            bpp: coded.bits / set.values(),
            psnr_db: q.psnr_db,
            psnr_range_db: q.psnr_range_db,
            psnr_pooled_db: q.psnr_pooled_db,
            psnr_log_db: q.psnr_log_db,
            psnr_worst_percent_db: q.psnr_worst_percent_db,
            one_minus_ssim: q.one_minus_ssim,
            one_minus_ssim_uniform: q.one_minus_ssim_uniform,
            lpips: q.lpips,
            flip: q.flip,
            dark_relative_error: q.dark_relative_error,
            step_error: judged.steps.smooth,
            switch_error: judged.steps.switch,
            encode_seconds: Some(coded.encode_seconds / set.tiles.len() as f64),
            decode_milliseconds: Some(1e3 * coded.decode_seconds / set.values() * f64::from(1 << 20)),
            note: String::new(),
        }
    }

    /// A row of which only the bits and the PSNR are known.
    pub(super) fn bare(family: &'static str, method: &str, bpp: f64, psnr_db: Option<f64>) -> Self {
        Row {
            family,
            method: method.to_owned(),
            bpp,
            psnr_db,
            note: "stored bits without headers; the trainer's own PSNR".to_owned(),
            ..Row::default()
        }
    }

    fn cells(&self) -> Vec<String> {
        vec![
            self.method.clone(),
            format!("{:.2}", self.bpp),
            decibels(self.psnr_db),
            decibels(self.psnr_pooled_db),
            decibels(self.psnr_log_db),
            cell(self.one_minus_ssim, 4),
            cell(self.lpips, 4),
            cell(self.flip, 4),
            cell(self.step_error, 3),
            cell(self.encode_seconds, 2),
            cell(self.decode_milliseconds, 1),
        ]
    }

    fn csv(&self) -> String {
        let numbers = [
            Some(self.bpp),
            self.psnr_db,
            self.psnr_range_db,
            self.psnr_pooled_db,
            self.psnr_log_db,
            self.psnr_worst_percent_db,
            self.one_minus_ssim,
            self.one_minus_ssim_uniform,
            self.lpips,
            self.flip,
            self.dark_relative_error,
            self.step_error,
            self.switch_error,
            self.encode_seconds,
            self.decode_milliseconds,
        ];
        let numbers = numbers.map(|value| value.map_or(String::new(), |value| value.to_string())).join(",");
        format!("{},\"{}\",{numbers},\"{}\"\n", self.family, self.method, self.note)
    }
}

impl Comparison {
    pub(super) fn new(set: &TileSet, options: &Options) -> Self {
        Comparison {
            tiles: set.tiles.len(),
            tiles_of: set.of,
            frames: set.timeline.hours.len(),
            draft: options.effort == Effort::Draft,
            ablations: options.ablations,
            noise_ceiling_db: None,
            rows: Vec::new(),
            skipped: Vec::new(),
            rendered: None,
            pictures: Vec::new(),
        }
    }

    /// Sorts the rows and draws the two tiles at which the methods differ most; `of_tiles` is each tile's
    /// frame that is shown.
    pub(super) fn finish(&mut self, set: &TileSet, of_tiles: &[usize], shown: Vec<Shown>) {
        let near = self.method("NDGI M").map(|row| row.bpp);
        let equal = near.and_then(|bpp| self.no_fewer("SVD", bpp));
        let wanted: Vec<String> = [
            "hybrid, profile M",
            "2D maps alone",
            "3D map alone, 64²",
            "texel by texel, plain BC7",
            "NDGI M",
            "NTC L",
            "PRT, clustered PCA",
            "ASTC 12×12",
            "8 frames, ASTC 8×8",
            "BC7",
            "BC6H",
        ]
        .map(str::to_owned)
        .into_iter()
        .chain(equal)
        .collect();
        let shown: Vec<&Shown> =
            wanted.iter().filter_map(|name| shown.iter().find(|s| s.method == *name)).collect();
        let spread = |i: usize| {
            let of = shown.iter().filter_map(|shown| shown.images[i].1);
            let (low, high) =
                of.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), db| (l.min(db), h.max(db)));
            high - low
        };
        let mut tiles: Vec<usize> = (0..set.tiles.len()).filter(|&i| spread(i) >= 0.0).collect();
        tiles.sort_by(|&a, &b| spread(b).total_cmp(&spread(a)));
        tiles.truncate(2);
        self.pictures = tiles.into_iter().map(|i| pictures(set, i, of_tiles[i], &shown)).collect();
        self.rows.sort_by(|a, b| a.bpp.total_cmp(&b.bpp));
    }

    pub(super) fn method(&self, name: &str) -> Option<&Row> {
        self.rows.iter().find(|row| row.method == name)
    }

    /// The name of a family's row of the fewest bits that are no fewer than some; of the most where all are
    /// fewer.
    fn no_fewer(&self, family: &str, bpp: f64) -> Option<String> {
        let of = || self.rows.iter().filter(|row| row.family == family);
        let enough = of().filter(|row| row.bpp >= bpp).min_by(|a, b| a.bpp.total_cmp(&b.bpp));
        enough.or_else(|| of().max_by(|a, b| a.bpp.total_cmp(&b.bpp))).map(|row| row.method.clone())
    }

    /// The table as lines of text, and what belongs to it.
    pub fn table(&self) -> Vec<String> {
        let rows: Vec<Vec<String>> = self.rows.iter().map(Row::cells).collect();
        let mut lines = aligned(&HEADER, &rows);
        lines.push(self.basis());
        lines.extend(self.remarks());
        lines
    }

    fn basis(&self) -> String {
        let effort = if self.draft { "draft effort" } else { "full effort" };
        let unless = |of: fn(&Row) -> Option<f64>, name: &'static str| {
            self.rows.iter().all(|row| of(row).is_none()).then_some(name)
        };
        let missing = [unless(|row| row.lpips, "LPIPS"), unless(|row| row.flip, "ꟻLIP")];
        let missing = missing.into_iter().flatten().collect::<Vec<_>>();
        let missing = match missing.len() {
            0 => String::new(),
            n => format!("; {} {} not measured", missing.join(" and "), if n == 1 { "is" } else { "are" }),
        };
        format!(
            "{} of {} tiles with valid texels, {} frames, {effort}; noise ceiling {} dB{missing}",
            self.tiles,
            self.tiles_of,
            self.frames,
            decibels(self.noise_ceiling_db)
        )
    }

    /// Differences compared with the paper's, the linear control at equal bits, and what was skipped.
    fn remarks(&self) -> Vec<String> {
        let gap = |a: &str, b: &str| {
            let of = |name: &str| self.method(name).and_then(|row| row.psnr_db);
            Some((of(a)? - of(b)?, a.to_owned(), b.to_owned()))
        };
        let paper = PAPER.iter().filter_map(|(a, b, paper)| {
            let (db, a, b) = gap(a, b)?;
            Some(format!("{a} − {b}: {db:+.2} dB (the paper, on its data: {paper:+.2})"))
        });
        let m = self.method("NDGI M").map(|row| row.bpp);
        let control = m.and_then(|bpp| {
            let (db, a, b) = gap("NDGI M", &self.no_fewer("SVD", bpp)?)?;
            Some(format!("{a} − {b}, the next larger: {db:+.2} dB"))
        });
        paper.chain(control).chain(self.skipped.iter().map(|what| format!("not run: {what}"))).collect()
    }

    /// Comma-separated values, to full precision.
    pub fn csv(&self) -> String {
        format!("{COLUMNS}\n{}", self.rows.iter().map(Row::csv).collect::<String>())
    }

    /// The report's section: table, plot, pictures.
    pub fn section(&self) -> Section {
        let mut section = Section::new(if self.ablations { "Ablations" } else { "Methods" });
        section.paragraph(&format!(
            "{}. All methods compress the same tiles of 128×128 texels. PSNR: mean over tiles and frames, valid texels, linear RGB, peak = \
             the tile's largest valid value; pooled: from the mean squared error relative to the peak; log: of ln(1 + E/ε), ε a \
             thousandth of the frame's mean. Step error: of the change of light between frames with the same light groups on, relative to that change. \
             Bits: all that a decoder needs, per texel of the tile and frame; NDGI's with the border of a bundle's tiles. Seconds of one \
             processor core.",
            self.basis()
        ));
        let header: Vec<&str> = HEADER.into_iter().chain(["chosen"]).collect();
        let cells = |row: &Row| {
            let mut cells = row.cells();
            for (i, value) in [(6, row.lpips), (7, row.flip)] {
                cells[i] = value.map_or("not measured".to_owned(), |value| format!("{value:.4}"));
            }
            cells.push(row.note.clone());
            cells
        };
        section.table(&header, &self.rows.iter().map(cells).collect::<Vec<_>>());
        section.list(&self.remarks());
        section.plot(&self.plot("PSNR in dB", |row| row.psnr_db));
        section.plot(&self.plot("1 − SSIM", |row| row.one_minus_ssim));
        for (what, pictures) in &self.pictures {
            section.subheading(what);
            section.pictures(pictures);
        }
        section
    }

    fn plot(&self, y: &str, value: impl Fn(&Row) -> Option<f64>) -> Plot {
        let mut families: Vec<&str> = Vec::new();
        for row in &self.rows {
            if !families.contains(&row.family) {
                families.push(row.family);
            }
        }
        let line = |family: &str| {
            let of = self.rows.iter().filter(|row| row.family == family);
            (family.to_owned(), of.filter_map(|row| Some((row.bpp, value(row)?))).collect())
        };
        Plot {
            title: "Rate and distortion".to_owned(),
            x: "bits per texel and frame".to_owned(),
            y: y.to_owned(),
            log_x: true,
            log_y: y.starts_with('1'),
            lines: families.into_iter().map(line).collect(),
        }
    }
}

/// Errors are shown this much brighter than the light.
const ERROR_GAIN: f32 = 16.0;
/// Screen pixels of a texel, along a side.
const ZOOM: usize = 2;

/// A tile at a frame: the reference, and each method with its error.
fn pictures(set: &TileSet, i: usize, k: usize, shown: &[&Shown]) -> (String, Vec<Picture>) {
    let tile = &set.tiles[i];
    let reference = image(tile, &tile.source.frames[k]);
    let bright = exposure(&reference, &tile.mask);
    let png = |image: &Image, gain: f32| {
        let (image, mask) = enlarged(image, &tile.mask, ZOOM);
        tone_mapped_png(&image, &mask, gain * bright, image.width.max(image.height))
    };
    let mut pictures = vec![("reference".to_owned(), png(&reference, 1.0))];
    for shown in shown {
        let (texels, db) = &shown.images[i];
        let decoded = image(tile, texels);
        let error = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (a[c] - b[c]).abs());
        let error =
            Image { texels: texels.iter().zip(&reference.texels).map(error).collect(), ..reference.clone() };
        pictures.push((format!("{}, {} dB", shown.method, decibels(*db)), png(&decoded, 1.0)));
        pictures.push((format!("its error × {ERROR_GAIN}"), png(&error, ERROR_GAIN)));
    }
    let place = tile.place;
    let hour = set.timeline.hours[k];
    (format!("Page {}, tile ({}, {}) at {hour} h", place.page, place.column, place.row), pictures)
}

/// Each texel as a square of `zoom`² pixels.
pub(super) fn enlarged(image: &Image, mask: &Mask, zoom: usize) -> (Image, Mask) {
    let (width, height) = (zoom * image.width, zoom * image.height);
    let from = |i: usize| i / width / zoom * image.width + i % width / zoom;
    let texels = (0..width * height).map(|i| image.texels[from(i)]).collect();
    let valid = (0..width * height).map(|i| mask.valid[from(i)]).collect();
    (Image { width, height, texels }, Mask { width, height, valid })
}
