//! Inputs of the work on a bundle: the dataset, checked, and what follows from it before the first tile.

use super::existing::{Existing, existing_bundle};
use super::options::{Options, Rate};
use super::outcome::Outcome;
use super::part::Part;
use super::shard;
use super::tiles::{Tiles, lit};
use super::{beside, default_bundle, digest, program};
use crate::bundle::{self, Header, MapCoding, Payload};
use crate::grid::{Grid, Place};
use crate::law::{Law, can_omit_sun, can_part_lamps, is_sun_apart};
use crate::model::Profile;
use crate::sunlight::Sunlight;
use crate::tile::Band;
use crate::time::{Coding, Timeline};
use crate::{Error, Result};
use dataset::digest::Digest;
use dataset::format::{Layer, Light, PageKind};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Mask;
use dataset::observe::Observer;
use dataset::store::Dataset;
use rayon::prelude::*;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::OnceLock;

/// Inputs of the work on a bundle, known before the first tile.
pub(super) struct Job<'a> {
    pub dataset: &'a Dataset,
    /// With the rate resolved.
    pub options: Options,
    pub out: PathBuf,
    pub masks: Vec<Mask>,
    pub law: Law,
    pub sunlight: Option<Sunlight<'a>>,
    pub trained_on: String,
    /// Digest of the light and the options that decide tiles, for notes of shards.
    pub recipe: String,
}

impl<'a> Job<'a> {
    pub(super) fn new(dataset: &'a Dataset, options: &Options, console: &dyn Observer) -> Result<Self> {
        if options.time_limit.is_some() && !matches!(options.rate, Rate::Usual | Rate::Profile(_)) {
            return Err(Error::unsupported(
                "time_limit",
                "a time limit is not supported with a target quality or size; omit one of them",
            ));
        }
        dataset.expect_day()?;
        let root = dataset.root.display();
        let config = &dataset.config;
        if options.without_sun && !can_omit_sun(config) {
            let layers = &config.layers;
            // In imported datasets the layer is one sum.
            if layers.is_empty() || layers.iter().any(Layer::is_whole_sun) {
                let what = "does not store the sun's direct light as a separate layer, so it cannot be omitted; drop --without-sun, or bake the dataset again";
                return Err(Error::invalid(root, what));
            }
            console.warn(format!("--without-sun has no effect: {root} has no direct light of the sun"));
        }
        let is_basis = options.coding == MapCoding::Basis;
        if is_basis && (options.time_limit.is_some() || matches!(options.rate, Rate::Profile(_))) {
            return Err(Error::unsupported(
                "coding",
                "the coding basis has no profiles and no training to limit; omit --profile and --time-limit, or use --coding neural",
            ));
        }
        let mut law = Law::new(dataset, is_sun_apart(config) || options.without_sun && can_omit_sun(config))?;
        if is_basis && can_part_lamps(config, law.is_apart) {
            law = law.without_lamps();
        }
        let usual = if law.is_apart { Profile::S } else { Profile::M };
        let rate = match options.rate {
            Rate::Usual if !is_basis => Rate::Profile(usual),
            rate => rate,
        };
        let sunlight = match options.without_sun {
            true => None,
            false => Sunlight::new(dataset, !options.still_shadows)?,
        };
        let trained_on = trained_on(dataset, &law);
        let Options { coding, iterations, passes, seed, without_sun, still_shadows, .. } = *options;
        let (coding, rate_name) = (format!("{coding:?}"), format!("{rate:?}"));
        let recipe =
            json!([trained_on, coding, rate_name, iterations, passes, seed, without_sun, still_shadows]);
        Ok(Job {
            recipe: digest(&recipe),
            out: options.out.clone().unwrap_or_else(|| default_bundle(dataset)),
            masks: dataset.masks()?,
            trained_on,
            options: Options { rate, ..options.clone() },
            dataset,
            law,
            sunlight,
        })
    }

    /// Reads all training data once, so that a bad texel or a truncated file stops the run before any
    /// training.
    pub(super) fn check(&self, console: &dyn Observer) -> Result<()> {
        check_texels(self.dataset, console)?;
        // (Curves, masks and what the sun's stream is made of are verified where they are read.)
        let mut seen = BTreeSet::new();
        let mut files = self.law.layers(&self.dataset.config).flat_map(Layer::files);
        files.try_for_each(|file| match seen.insert(&file.path) {
            true => self.dataset.verified(file).map(drop),
            false => Ok(()),
        })
    }

    /// Reads the training data of some tiles once, so that a bad texel or a truncated file stops the run
    /// before any training: only their rows, not whole files.
    pub(super) fn check_bands(&self, places: &[Place], console: &dyn Observer) -> Result<()> {
        let bands: BTreeSet<(usize, usize)> = places.iter().map(|place| (place.page, place.row)).collect();
        let progress = console.progress("checking", bands.len() as u64);
        for (page, row) in bands {
            stop_if_interrupted()?;
            drop(Band::load(self.dataset, &self.law, &self.masks[page], page, row)?);
            progress.advance(1);
        }
        Ok(())
    }

    /// For a merge: an error unless shards have finished what comes next. Nothing is written, and shards go
    /// on meanwhile.
    pub(super) fn expect_shards(&self) -> Result<()> {
        let folder = beside(&self.out, ".part");
        if !folder.is_dir() {
            let lit = lit(&header(self, Vec::new()), &self.masks);
            let what = match self.options.rate {
                Rate::Usual | Rate::Profile(_) => shard::TRAINED,
                _ => shard::TRIED,
            };
            return Err(shard::missing(&folder, &self.recipe, what, &lit, lit.len()));
        }
        let part = Part::share(&self.out)?;
        let header = header(self, self.hours_of_shards(&part)?);
        self.tiles(&header, &part).expect_shards()
    }

    /// The times between frames at which means are stored: [`Law::hours`].
    pub(super) fn hours(&self) -> Result<Vec<f64>> {
        let header = header(self, Vec::new());
        self.law.hours(self.dataset, &self.masks, &header.maps_timeline())
    }

    /// The times between frames ([`Job::hours`]) as kept in the work folder, or computed if they are not
    /// there. They depend on the light of all pages; so only the first of many shards reads all pages.
    pub(super) fn hours_of_shards(&self, part: &Part) -> Result<Vec<f64>> {
        match part.read::<Vec<f64>>(&self.hours_key()) {
            Some(kept) if self.law.has_curves() => Ok(kept.result),
            _ => self.hours(),
        }
    }

    /// The times between frames ([`Job::hours_of_shards`]); keeps them in the work folder.
    pub(super) fn keep_hours(&self, part: &Part) -> Result<Vec<f64>> {
        let between = self.hours_of_shards(part)?;
        if self.law.has_curves() && part.read::<Vec<f64>>(&self.hours_key()).is_none() {
            part.write(&self.hours_key(), &Payload::default(), &between, None)?;
        }
        Ok(between)
    }

    /// Once checksums are verified: corrects the kept times between frames, with an error, if they were
    /// computed from other light.
    pub(super) fn expect_hours(&self, part: &Part, header: &Header) -> Result<()> {
        let between = self.hours()?;
        if between == header.timeline.between {
            return Ok(());
        }
        part.write(&self.hours_key(), &Payload::default(), &between, None)?;
        let what = "the times between frames were computed from a file that was damaged or has been replaced since; they are corrected: run the shards \
                    again, then this command";
        Err(Error::unready(part.folder().display(), what))
    }

    pub(super) fn hours_key(&self) -> String {
        digest(&json!(["hours", program(), self.trained_on, self.law.is_apart, self.law.are_lamps_apart]))
    }

    /// The bundle's header with the sun's stream; `between`: [`Law::hours`].
    pub(super) fn header_with_sun(&self, between: Vec<f64>, console: &dyn Observer) -> Result<Header> {
        let sun = self.sunlight.as_ref().map(|sunlight| sunlight.coded(&self.masks, console)).transpose()?;
        if self.options.still_shadows && sun.is_none() {
            console.warn(format!(
                "--still-shadows has no effect: {} has no shadows of the sun",
                self.dataset.root.display()
            ));
        }
        let shadows = self.sunlight.as_ref().is_some_and(Sunlight::moves);
        Ok(Header { sun, shadows, ..header(self, between) })
    }

    /// The existing bundle if it is up to date, with the tiles of it that are damaged; an error if it must
    /// not be replaced.
    pub(super) fn existing(
        &self,
        header: &Header,
        console: &dyn Observer,
    ) -> Result<Option<(Outcome, Vec<Place>)>> {
        if self.options.force {
            return Ok(None);
        }
        match existing_bundle(&self.out, header) {
            Existing::Same(outcome) => return Ok(Some((*outcome, Vec::new()))),
            Existing::Damaged(outcome, tiles) => return Ok(Some((*outcome, tiles))),
            Existing::Protected(what) => {
                return Err(Error::invalid(
                    self.out.display(),
                    format!("{what}; choose another file with --out, or replace it with --force"),
                ));
            }
            Existing::Other(what) => console.say(format!("replacing {}: {what}", self.out.display())),
            Existing::None => {}
        }
        Ok(None)
    }

    /// The work on tiles, without the sun's stream and without a deadline.
    pub(super) fn tiles<'b>(&'b self, header: &'b Header, part: &'b Part) -> Tiles<'b> {
        Tiles {
            bytes_of_sun: 0,
            dataset: self.dataset,
            law: &self.law,
            masks: &self.masks,
            options: &self.options,
            header,
            part,
            trained_on: &self.trained_on,
            recipe: &self.recipe,
            step: OnceLock::new(),
            is_verified: false,
            deadline: None,
        }
    }
}

/// Reads every lightmap once, band by band, so that a bad texel or a truncated file stops the run before any
/// training.
fn check_texels(dataset: &Dataset, console: &dyn Observer) -> Result<()> {
    let frames = &dataset.config.frames;
    let mut seen = BTreeSet::new();
    let maps: Vec<(usize, usize)> = (0..frames.len())
        .flat_map(|frame| (0..dataset.config.pages.len()).map(move |page| (frame, page)))
        .filter(|&(frame, page)| seen.insert(&frames[frame].maps[page].path))
        .collect();
    let progress = console.progress("checking", maps.len() as u64);
    let faults: Vec<Result<()>> = maps
        .par_iter()
        .map(|&(frame, page)| {
            stop_if_interrupted()?;
            let height = dataset.config.pages[page].height as usize;
            for y in (0..height).step_by(crate::model::STORED) {
                dataset.map_rows(frame, page, y, (y + crate::model::STORED).min(height))?;
            }
            progress.advance(1);
            Ok(())
        })
        .collect();
    // The first fault in the dataset's order, whichever thread met one first.
    faults.into_iter().collect()
}

/// The bundle's header without the sun's stream; `between`: [`Law::hours`].
pub(super) fn header(job: &Job, between: Vec<f64>) -> Header {
    let Job { dataset, law, options, .. } = job;
    let config = &dataset.config;
    let is_neural = options.coding == MapCoding::Neural;
    let mut info = json!({
        "generator": concat!("compress ", env!("CARGO_PKG_VERSION")),
        "inputs": dataset.config.digest_of_light(),
        "trained_on": job.trained_on,
        "unit": config.unit,
        "profile": match options.rate {
            Rate::Profile(profile) => json!(profile.name),
            _ => json!(null),
        },
        "target_psnr_db": match options.rate {
            Rate::Psnr(target) => json!(target),
            _ => json!(null),
        },
        "target_bpp": match options.rate {
            Rate::Bpp(target) => json!(target),
            _ => json!(null),
        },
        "coding": match options.coding {
            MapCoding::Neural => "neural",
            MapCoding::Basis => "basis",
        },
        "iterations": is_neural.then_some(options.iterations),
        "passes": is_neural.then_some(options.passes),
        "time_limit_secs": options.time_limit.map(|limit| limit.as_secs_f64()),
        "seed": options.seed,
        "sun": law.is_apart.then_some(if options.without_sun { "left out" } else { "apart" }),
    });
    // A coarser level names its level and the light it was made from.
    if let Some(halved) = config.halved() {
        (info["level"], info["level_of"]) = (json!(halved.times), json!(halved.light));
    }
    let grid =
        |page: &dataset::format::Page| Grid { width: page.width as usize, height: page.height as usize };
    Header {
        scene: config.scene.clone(),
        info: info.to_string(),
        pages: config.pages.iter().map(grid).collect(),
        kinds: config
            .pages
            .iter()
            .map(|page| match page.kind {
                PageKind::Atlas => bundle::PageKind::Atlas,
            })
            .collect(),
        sun: None,
        shadows: false,
        groups: config.groups.iter().map(|group| group.name.clone()).collect(),
        apart: vec![law.are_lamps_apart; config.groups.len()],
        coding: options.coding,
        timeline: Timeline { between, ..timeline(dataset) },
    }
}

/// The dataset's hours, schedules and states.
pub(crate) fn timeline(dataset: &Dataset) -> Timeline {
    let config = &dataset.config;
    Timeline {
        hours: config.frames.iter().map(|frame| frame.hour).collect(),
        intervals: config.groups.iter().map(|group| group.on.clone()).collect(),
        states: config.frames.iter().map(|frame| frame.groups_on.clone()).collect(),
        between: vec![],
        coding: Coding::Standard,
    }
}

/// Digest of everything that decides a tile's training: the light, and the layers, which show which groups
/// light a tile.
fn trained_on(dataset: &Dataset, law: &Law) -> String {
    let config = &dataset.config;
    let files = |group: u32| {
        let layers = config.layers_of(Light::Group, Some(group));
        layers.flat_map(Layer::files).map(|file| file.blake3).collect::<Vec<_>>()
    };
    let mut layers: Vec<_> = (0..config.groups.len() as u32).map(files).collect();
    // With a separate sun, maps hold the sum of layers.
    if law.is_apart || law.are_lamps_apart {
        layers.push(config.layers.iter().flat_map(Layer::files).map(|file| file.blake3).collect());
    }
    // With curves, their layers' shares of the light decide means.
    if law.has_curves() {
        let files = |layer: &'_ Layer| -> Vec<Digest> {
            layer.files().chain(&layer.curve).map(|file| file.blake3).collect()
        };
        layers.push(law.layers(config).flat_map(files).collect());
    }
    blake3::hash(json!([dataset.config.digest_of_light(), layers]).to_string().as_bytes())
        .to_hex()
        .to_string()
}
