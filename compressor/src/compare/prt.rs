//! Precomputed radiance transfer: what each spherical harmonic of sky light does to a texel, lit by each
//! time's sky and sun.
//!
//! A texel is a vector: the irradiance under each function, from the scene's transfer (`bake --transfer`),
//! and under each light group, from the dataset's layers. Its light at a time is linear in that vector, by
//! weights that all texels share: the coefficients of sky and sun, and 1 for the groups that are on. What the
//! functions cannot follow, shadows of the sun above all, no coding brings back.

mod cluster;
mod code;

use super::method::{CodedTile, CodedTiles, Method, Way, Ways, each_tile};
use super::tiles::{Tile, TileSet};
use crate::{Error, Result};
use dataset::format::{FileRef, Light, TILE, Transfer as Basis};
use dataset::image::Mask;
use dataset::observe::count;
use dataset::store::Dataset;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Bits per texel and frame of the compressed vectors.
const BPP: f64 = 1.0;

/// A dataset with its scene's transfer, which fits it.
pub(super) struct Transfer<'a> {
    dataset: &'a Dataset,
    transfer: &'a Dataset,
    basis: &'a Basis,
    /// Per page of the transfer.
    masks: Vec<Mask>,
    /// Per frame of the dataset, its time in the transfer's light.
    times: Vec<usize>,
}

/// The vectors of a tile's valid texels.
pub(super) struct Vectors {
    /// Functions and groups.
    sources: usize,
    /// Per valid texel and channel, a value per source; functions together, and each group, relative to their
    /// largest in the tile.
    rows: Vec<f64>,
    /// Per frame and channel, the weight of each source.
    weights: Vec<f64>,
    /// Largest values stored with the tile: one for the functions, one per group.
    scales: usize,
}

impl<'a> Transfer<'a> {
    /// Checks that a transfer is one, and of this dataset, before anything is compressed.
    pub(super) fn open(dataset: &'a Dataset, transfer: &'a Dataset, set: &TileSet) -> Result<Self> {
        let wrong = |what: String| Error::invalid(transfer.root.display(), what);
        let scene = &dataset.config.scene;
        let Some(basis) = &transfer.config.transfer else {
            return Err(wrong(format!(
                "is not a transfer; expected the output of `bake --transfer` of the scene {scene}"
            )));
        };
        if basis.scene != *scene {
            return Err(wrong(format!("is the transfer of {}; expected that of {scene}", basis.scene)));
        }
        let sizes = |set: &Dataset| -> Vec<String> {
            set.config.pages.iter().map(|page| format!("{}×{}", page.width, page.height)).collect()
        };
        let (found, expected) = (sizes(transfer), sizes(dataset));
        let there = dataset.root.display();
        if found != expected {
            let (found, expected) = (found.join(", "), expected.join(", "));
            return Err(wrong(format!(
                "pages of {found}; {there} has {expected}: bake both alike (--draft, --final)"
            )));
        }
        let time = |hour: f64| {
            let found = basis.light.iter().position(|light| (light.hour - hour).abs() < 1e-6);
            found.ok_or_else(|| {
                wrong(format!(
                    "has no light for {hour} h, of which {} has a frame; expected a dataset baked with --hours 0..24",
                    dataset.root.display()
                ))
            })
        };
        let times = dataset.config.frames.iter().map(|set| time(set.hour)).collect::<Result<Vec<_>>>()?;
        let mut groups = (0..).zip(&dataset.config.groups);
        let is_kept = |group: u32| dataset.config.layers_of(Light::Group, Some(group)).next().is_some();
        if let Some((_, group)) = groups.find(|(index, _)| !is_kept(*index)) {
            let what = format!(
                "has no layer of the light group {:?}; PRT needs the light of each group",
                group.name
            );
            return Err(Error::invalid(dataset.root.display(), what));
        }
        if basis.inputs != dataset.config.inputs {
            return Err(wrong(format!(
                "belongs to a different bake than {there}: scene file, models or settings differ; expected both from the same `bake` command, \
                 with and without --transfer, for --hours 0..24"
            )));
        }
        let masks = transfer.masks()?;
        let opened = Transfer { dataset, transfer, basis, masks, times };
        let pages: BTreeSet<usize> = set.tiles.iter().map(|tile| tile.place.page).collect();
        let images: Vec<_> = pages.into_iter().flat_map(|page| opened.images(page)).collect();
        images
            .par_iter()
            .try_for_each(|(set, files)| files.iter().try_for_each(|file| set.verified(file).map(drop)))?;
        Ok(opened)
    }

    /// The images of a page, each the sum of files: of the parts of the functions, then of the groups.
    fn images(&self, page: usize) -> Vec<(&'a Dataset, Vec<&'a FileRef>)> {
        let parts = self.transfer.config.frames.iter().map(|frame| (self.transfer, vec![&frame.maps[page]]));
        let config = &self.dataset.config;
        let groups = (0..config.groups.len() as u32)
            .map(|group| (self.dataset, config.files_of(Light::Group, Some(group), 0, page)));
        parts.chain(groups).collect()
    }

    fn functions(&self) -> usize {
        self.basis.light[0].coefficients.len()
    }

    /// Reads the vectors of a tile.
    fn vectors(&self, tile: &Tile) -> Result<Vectors> {
        let page = tile.place.page;
        let (left, top) = (tile.place.column * TILE, tile.place.row * TILE);
        let mask = &self.masks[page];
        // Places on the rows of the page that hold the tile.
        let bottom = (top + TILE).min(mask.height);
        let (functions, groups) = (self.functions(), self.dataset.config.groups.len());
        let sources = functions + groups;
        let place = |i: usize| left + i % tile.source.width + i / tile.source.width * mask.width;
        let places: Vec<usize> = tile.valid().map(place).collect();
        let mut rows = vec![0.0; 3 * sources * places.len()];
        // The functions' is known when their parts are together.
        let mut scales = vec![0.0];
        for (i, (set, files)) in self.images(page).into_iter().enumerate() {
            let image = set.sum_rows(&files, page, top, bottom)?;
            let part = self.basis.parts.get(i);
            let source = part.map_or(functions + i - self.basis.parts.len(), |part| part.function as usize);
            let factor = match part {
                Some(part) if part.negative => -1.0,
                Some(_) => 1.0,
                None => {
                    let values = places.iter().flat_map(|&place| image[place]);
                    let peak = f64::from(values.fold(0.0, f32::max));
                    scales.push(peak);
                    if peak > 0.0 { peak.recip() } else { 0.0 }
                }
            };
            for (row, &place) in rows.chunks_exact_mut(3 * sources).zip(&places) {
                // Where no function's light arrives, the transfer holds what dilation put there.
                if part.is_none() || mask.valid[top * mask.width + place] {
                    (0..3).for_each(|c| row[c * sources + source] += factor * f64::from(image[place][c]));
                }
            }
        }
        let is_function = |i: usize| i % sources < functions;
        let of_functions = rows.iter().enumerate().filter(|(i, _)| is_function(*i)).map(|(_, x)| x.abs());
        scales[0] = of_functions.fold(0.0, f64::max);
        if scales[0] > 0.0 {
            rows.iter_mut().enumerate().filter(|(i, _)| is_function(*i)).for_each(|(_, x)| *x /= scales[0]);
        }
        Ok(Vectors { sources, rows, weights: self.weights(&scales), scales: scales.len() })
    }

    /// Per frame and channel, the weight of each source; `scales` are that of the functions and those of the
    /// groups.
    fn weights(&self, scales: &[f64]) -> Vec<f64> {
        let mut weights = Vec::new();
        for (set, &time) in self.dataset.config.frames.iter().zip(&self.times) {
            for c in 0..3 {
                let functions = self.basis.light[time].coefficients.iter();
                weights.extend(functions.map(|rgb| rgb[c] * scales[0]));
                weights.extend(
                    set.groups_on.iter().zip(&scales[1..]).map(|(on, scale)| if *on { *scale } else { 0.0 }),
                );
            }
        }
        weights
    }
}

impl Vectors {
    /// Numbers of a vector.
    fn numbers(&self) -> usize {
        3 * self.sources
    }

    /// The light of a vector, or of anything that light goes linearly with: 3 values a frame.
    fn light(&self, vector: &[f64]) -> Vec<f64> {
        let of = |(i, weights): (usize, &[f64])| {
            let channel = &vector[i % 3 * self.sources..][..self.sources];
            weights.iter().zip(channel).map(|(weight, x)| weight * x).sum()
        };
        self.weights.chunks_exact(self.sources).enumerate().map(of).collect()
    }
}

/// The rows of the table: the vectors as they are, and compressed.
pub(super) fn methods<'a>(set: &'a TileSet, transfer: &'a Transfer) -> Vec<Method<'a>> {
    let note = move |what: &str| {
        let functions = count(transfer.functions(), "function");
        format!("{functions}; {what}; coefficients of sky and sun are not counted")
    };
    let method = |name: &str, run: Box<dyn Fn() -> Result<Ways<'a>> + 'a>| Method {
        family: "PRT",
        name: name.to_owned(),
        run,
    };
    vec![
        method(
            "PRT, no codec",
            Box::new(move || {
                let coded = each(set, transfer, |tile, vectors, _| code::plain(tile, vectors))?;
                Ok(vec![Way::new(coded, note("float16"))])
            }),
        ),
        method(
            "PRT, clustered PCA",
            Box::new(move || {
                let coded = each(set, transfer, code::clustered)?;
                let what = "per tile the best clusters and components at these bits";
                Ok(vec![Way::new(coded, note(what))])
            }),
        ),
    ]
}

/// Every tile by its vectors, and the bits that it may take: in proportion to its valid texels.
fn each(
    set: &TileSet,
    transfer: &Transfer,
    code: impl Fn(&Tile, &Vectors, f64) -> Result<CodedTile> + Sync,
) -> Result<CodedTiles> {
    let valid: usize = set.tiles.iter().map(|tile| tile.valid().count()).sum();
    let each_valid = BPP * set.values() / valid as f64;
    each_tile(set, |tile| code(tile, &transfer.vectors(tile)?, each_valid * tile.valid().count() as f64))
}
