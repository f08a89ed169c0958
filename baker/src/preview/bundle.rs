//! A compressed bundle as the light to show.

use crate::{Error, Result};
pub(super) use dataset::error::of_bundle;
use dataset::format::Config;
use dataset::host::inputs::expect_file;
use dataset::store::Dataset;
use ndgi::decode::Decoder;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// An opened bundle.
pub(super) struct Compressed {
    /// Its file.
    pub path: PathBuf,
    /// Its light.
    pub decoder: Decoder,
    /// What its writer noted about it.
    info: Value,
}

impl Compressed {
    /// Opens a file.
    ///
    /// # Errors
    /// A file that is no bundle, or is damaged.
    pub(super) fn open(path: &Path) -> Result<Self> {
        expect_file(path, "a bundle, a .ndgi file, as `compress <dataset>` writes it")?;
        let decoder = Decoder::open(path).map_err(of_bundle)?;
        let info = serde_json::from_str(&decoder.bundle().header.info).unwrap_or_default();
        Ok(Compressed { path: path.to_owned(), decoder, info })
    }

    /// Whether the sun's direct light was left to the game.
    pub(super) fn lacks_sun(&self) -> bool {
        self.info["sun"] == "left out"
    }

    /// An error where it is a bundle of another scene, or has other pages than a dataset.
    pub(super) fn expect_of(&self, dataset: &Dataset) -> Result<()> {
        let (header, config) = (&self.decoder.bundle().header, &dataset.config);
        let refuse = |what: String| {
            let how = format!("`compress {}` makes one of this dataset", dataset.root.display());
            Err(Error::invalid(self.path.display(), format!("{what}; {how}")))
        };
        if header.scene != config.scene {
            let (found, expected) = (&header.scene, &config.scene);
            return refuse(format!("is a bundle of the scene {found:?}; expected one of {expected:?}"));
        }
        let text = |sizes: Vec<(usize, usize)>| {
            let of = |(width, height): &(usize, usize)| format!("{width} × {height}");
            sizes.iter().map(of).collect::<Vec<_>>().join(", ")
        };
        let found = text(header.pages.iter().map(|page| (page.width, page.height)).collect());
        let expected = text(config.pages.iter().map(|p| (p.width as usize, p.height as usize)).collect());
        match found == expected {
            true => Ok(()),
            false => {
                refuse(format!("has pages of {found} texels; expected those of the dataset, {expected}"))
            }
        }
    }

    /// What is to be said of its light at an hour; `moves`: daylight changes with the hour.
    pub(super) fn doubts(&self, config: &Config, hour: f64, moves: bool) -> Vec<String> {
        /// Frames this far apart, in hours, leave a part of the day that nobody baked.
        const FAR: f64 = 12.0;
        let (path, timeline) = (self.path.display(), &self.decoder.bundle().header.timeline);
        let blend = timeline.at(hour);
        let [from, to] = [blend.a, blend.b].map(|frame| timeline.hours[frame]);
        let mut doubts = Vec::new();
        if self.info["inputs"].as_str().is_some_and(|inputs| inputs != config.digest_of_light()) {
            doubts.push(format!(
                "{path} was made from another bake than this dataset's: its light may be another; `compress` makes it anew"
            ));
        }
        if self.lacks_sun() {
            doubts.push(format!(
                "{path} was written without the sun's direct light (--without-sun): the picture shows all other light, as a game gets it \
                 that draws the sun itself"
            ));
        }
        if moves && from != to && (to - from).rem_euclid(24.0) > FAR {
            doubts.push(format!(
                "{hour:.2} h is far from all frames of {path}, between those of {from:.2} h and {to:.2} h: the picture shows a mix of these"
            ));
        }
        if !timeline.shows(hour) {
            let frame = timeline.hours[blend.a];
            doubts.push(format!(
                "no frame of {path} has the lamps as they are at {hour:.2} h: the picture shows the light of {frame:.2} h"
            ));
        }
        doubts
    }
}
