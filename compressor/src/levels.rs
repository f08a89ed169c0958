//! Coarser levels of a bundle, for virtual texturing: each has half the resolution of the one before and is a
//! separate bundle.
//!
//! The halved datasets are stored in the folder `<bundle>.levels/` until all levels are done, so that a
//! stopped run can continue.

use crate::compress::{Options, compress, folder_beside, info};
use crate::decode::Decoder;
use crate::evaluate::{Measures, evaluate};
use crate::model::PAYLOAD;
use crate::{Result, of_bundle};
use dataset::format::Page;
use dataset::halve::{halve, open};
use dataset::host::files::remove_folder;
use dataset::host::lock::{LOCK, lock};
use dataset::observe::Observer;
use dataset::store::Dataset;
use ndgi::Bundle;
use reports::Section;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};

/// A level that was written and evaluated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Level {
    /// How often the resolution was halved: from 1.
    pub level: u32,
    /// The bundle.
    pub bundle: PathBuf,
    /// Width and height of the pages in texels.
    pub pages: Vec<[u32; 2]>,
    /// The tiles of the bundle.
    pub tiles: usize,
    /// Its bytes.
    pub bytes: u64,
    /// Mean PSNR against the averaged light of full resolution.
    pub psnr_db: Option<f64>,
    /// The same from the mean squared error.
    pub psnr_pooled_db: Option<f64>,
    /// True if an earlier run had written it.
    pub up_to_date: bool,
}

/// How many levels there are beyond full resolution: until every page fits in one tile.
pub fn count(pages: &[Page]) -> u32 {
    let longest = pages.iter().map(|page| page.width.max(page.height)).max().unwrap_or(1);
    (0..).find(|level| sides(longest, *level) <= PAYLOAD as u32).unwrap_or(0)
}

/// A side of a page at a level.
fn sides(side: u32, level: u32) -> u32 {
    (0..level).fold(side, |side, _| side.div_ceil(2))
}

/// The name of a level's bundle: `yard.1.ndgi` for `yard.ndgi`.
pub fn name(bundle: &Path, level: u32) -> PathBuf {
    match level {
        0 => bundle.to_owned(),
        level => bundle.with_extension(format!("{level}.ndgi")),
    }
}

/// How a level is compressed: as full resolution is, with its share of the time by its texels.
pub fn options(options: &Options, pages: &[Page], level: u32) -> Options {
    let texels = |level: u32| -> f64 {
        let of = |page: &Page| [page.width, page.height].map(|side| f64::from(sides(side, level)));
        pages.iter().map(of).map(|[width, height]| width * height).sum()
    };
    let all: f64 = (0..=count(pages)).map(texels).sum();
    let time_limit = options.time_limit.map(|limit| limit.mul_f64(texels(level) / all));
    Options { time_limit, ..options.clone() }
}

/// Compresses and evaluates all coarser levels of the dataset in `root`, into the folder of the
/// full-resolution `bundle`.
///
/// # Errors
/// Those of [`halve`], [`compress`] and [`evaluate`]; [`crate::Error::Invalid`] where another run makes
/// these levels.
pub fn levels(root: &Path, of: &Options, bundle: &Path, console: &dyn Observer) -> Result<Vec<Level>> {
    let mut source = Dataset::open(root)?;
    let pages = source.config.pages.clone();
    let work = folder_beside(bundle, ".levels")?;
    let lock = lock(
        &work,
        "another run is writing the levels of this bundle",
        "wait until it ends, or choose another --out",
    )?;
    let mut done = Vec::new();
    for level in 1..=count(&pages) {
        let folder = work.join(level.to_string());
        let half = match open(&folder, &source.config) {
            Ok(kept) if kept.files().all(|file| kept.verified(file).is_ok()) => kept,
            _ => {
                remove_folder(&folder)?;
                halve(&source, &folder, console)?;
                open(&folder, &source.config)?
            }
        };
        let options = Options { out: Some(name(bundle, level)), ..options(of, &pages, level) };
        done.push(one(&half, level, &options, console)?);
        source = half;
    }
    // A failure to remove is harmless: the bundles are written.
    let folders = fs::read_dir(&work).into_iter().flatten().flatten();
    let is_level = |name: &str| name.bytes().all(|digit| digit.is_ascii_digit());
    for entry in folders.filter(|entry| entry.file_name().to_str().is_some_and(is_level)) {
        let _ = fs::remove_dir_all(entry.path());
    }
    let _ = fs::remove_file(work.join(LOCK));
    // (Its claim is in the folder, and on some networks an open file stays in its folder when it is removed.)
    drop(lock);
    let _ = fs::remove_dir(&work);
    Ok(done)
}

/// Bundles of coarser levels in the folder of `bundle` that were made from other light than the dataset's:
/// streaming readers would show them.
pub fn stale(dataset: &Dataset, bundle: &Path) -> Vec<PathBuf> {
    let light = dataset.config.digest_of_light();
    let is_other = |path: &PathBuf| {
        !Bundle::open(path).is_ok_and(|opened| info(&opened.header)["level_of"] == light.as_str())
    };
    (1..).map(|level| name(bundle, level)).take_while(|path| path.exists()).filter(is_other).collect()
}

/// Compresses and evaluates a level.
fn one(half: &Dataset, level: u32, options: &Options, console: &dyn Observer) -> Result<Level> {
    let pages: Vec<[u32; 2]> = half.config.pages.iter().map(|page| [page.width, page.height]).collect();
    let outcome = compress(&half.root, options, console)?;
    let decoder = Decoder::open(&outcome.bundle).map_err(of_bundle)?;
    let all = evaluate(half, &decoder, Measures::default(), console)?.all;
    let level = Level {
        level,
        pages,
        tiles: outcome.tiles,
        bytes: outcome.bytes,
        psnr_db: all.psnr_db,
        psnr_pooled_db: all.psnr_pooled_db,
        up_to_date: outcome.up_to_date,
        bundle: outcome.bundle,
    };
    console.say(level.in_words());
    Ok(level)
}

impl Level {
    fn sizes(&self) -> String {
        let sizes: Vec<String> =
            self.pages.iter().map(|[width, height]| format!("{width}×{height}")).collect();
        sizes.join(", ")
    }

    fn decibels(&self) -> String {
        self.psnr_db.map_or("–".to_owned(), |db| format!("{db:.2}"))
    }

    /// Such as `level 1, 256×256 texels: yard.1.ndgi, 61234 bytes, 41.20 dB`.
    fn in_words(&self) -> String {
        let Level { level, bundle, bytes, .. } = self;
        format!(
            "level {level}, {} texels: {}, {bytes} bytes, {} dB",
            self.sizes(),
            bundle.display(),
            self.decibels()
        )
    }
}

/// The levels, for the report.
pub fn section(levels: &[Level]) -> Section {
    let mut section = Section::new("Coarser levels");
    section.paragraph(
        "For virtual texturing: bundles at half the resolution, a quarter, and so on. A texel at level m is the mean of the valid texels \
         it covers; texel position p of a page is at p ÷ 2^m.",
    );
    let row = |level: &Level| {
        let name = level.bundle.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        let (tiles, bytes) = (level.tiles.to_string(), level.bytes.to_string());
        vec![level.level.to_string(), name, level.sizes(), tiles, bytes, level.decibels()]
    };
    let rows: Vec<Vec<String>> = levels.iter().map(row).collect();
    section.table(&["level", "bundle", "texels", "tiles", "bytes", "mean PSNR, dB"], &rows);
    section
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::digest::Digest;
    use dataset::format::FileRef;
    use std::time::Duration;

    fn pages(sizes: &[[u32; 2]]) -> Vec<Page> {
        let mask = FileRef { path: "mask.png".into(), bytes: 1, blake3: Digest::of(&[]) };
        sizes.iter().map(|[width, height]| Page::atlas(*width, *height, mask.clone())).collect()
    }

    #[test]
    fn levels_end_where_every_page_fits_in_one_tile() {
        for (size, expected) in
            [([1, 1], 0), ([126, 126], 0), ([127, 3], 1), ([252, 252], 1), ([253, 1], 2), ([512, 2048], 5)]
        {
            assert_eq!(count(&pages(&[size])), expected, "{size:?}");
        }
        assert_eq!(count(&pages(&[[1, 1], [3, 300]])), 2);
    }

    #[test]
    fn names_go_with_the_bundles() {
        let named = |bundle: &str, level| name(Path::new(bundle), level).display().to_string();
        assert_eq!(named("a/yard.ndgi", 0), "a/yard.ndgi");
        assert_eq!(named("a/yard.ndgi", 2), "a/yard.2.ndgi");
        assert_eq!(named("yard.v1.ndgi", 1), "yard.v1.1.ndgi");
    }

    #[test]
    fn levels_share_the_time_limit() {
        let (limit, pages) = (Duration::from_secs(210), pages(&[[512, 512]]));
        let limited = Options { time_limit: Some(limit), ..Options::default() };
        let shares: Vec<f64> =
            (0..4).map(|level| options(&limited, &pages, level).time_limit.unwrap().as_secs_f64()).collect();
        assert!((shares[0] / shares[1] - 4.0).abs() < 1e-6, "{shares:?}");
        assert!((shares.iter().sum::<f64>() - 210.0).abs() < 1e-6, "{shares:?}");
        assert_eq!(options(&Options::default(), &pages, 1).time_limit, None);
    }
}
