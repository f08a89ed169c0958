//! The work on tiles of planes: all have one step. For a target it is found between steps that are tried,
//! where bytes and errors are geometric.

use super::Rate;
use super::stats::TileStats;
use super::tiles::{Tile, Tiles, of_tile};
use crate::basis::FittedTile;
use crate::bundle::{self, MapCoding, Payload};
use crate::clock::Clock;
use crate::grid::Place;
use crate::tile::{self, Band};
use crate::train::{TrainedTile, TrialFit};
use crate::{Error, Result};

/// Without a target: 2^(−3).
const USUAL: u8 = 24;
/// The steps that are tried, coarse to fine.
const TRIED: [u8; 8] = [4, 10, 16, 22, 28, 34, 42, 52];

/// The logarithm of a sum over all tiles, at a step between those that were tried.
fn at(trials: &[Vec<TrialFit>], step: u8, of: impl Fn(&TrialFit) -> f64) -> f64 {
    let sum = |i: usize| trials.iter().filter_map(|of_tile| of_tile.get(i)).map(&of).sum::<f64>();
    let after = TRIED.iter().position(|tried| *tried >= step).unwrap_or(TRIED.len() - 1).max(1);
    let [from, to] = [after - 1, after].map(|i| sum(i).max(1e-30).ln());
    let [first, second] = [TRIED[after - 1], TRIED[after]].map(f64::from);
    from + (to - from) * (f64::from(step) - first) / (second - first)
}

/// The finest step whose tiles take at most this many bytes; the coarsest if none does.
fn for_bytes(trials: &[Vec<TrialFit>], bytes: u64) -> u8 {
    let fits = |step: &u8| at(trials, *step, |trial| trial.bytes as f64) <= (bytes.max(1) as f64).ln();
    (TRIED[0]..=TRIED[TRIED.len() - 1]).rev().find(fits).unwrap_or(TRIED[0])
}

/// The coarsest step whose tiles together reach a pooled PSNR in dB; the finest if none does.
fn for_psnr(trials: &[Vec<TrialFit>], db: f64) -> u8 {
    let terms: u64 = trials.iter().filter_map(|of_tile| of_tile.first()).map(|trial| trial.terms).sum();
    let most = (terms.max(1) as f64).ln() - db / 10.0 * std::f64::consts::LN_10;
    let reaches = |step: &u8| at(trials, *step, |trial| trial.error) <= most;
    (TRIED[0]..=TRIED[TRIED.len() - 1]).find(reaches).unwrap_or(TRIED[TRIED.len() - 1])
}

impl Tiles<'_> {
    /// What is done to a tile, for progress.
    pub(super) fn doing(&self) -> &'static str {
        match self.options.coding {
            MapCoding::Neural => "training",
            MapCoding::Basis => "encoding",
        }
    }

    /// The step of all tiles' planes.
    pub(super) fn step(&self) -> u8 {
        self.step.get().copied().unwrap_or(USUAL)
    }

    /// The step that meets the target, by trials of all tiles.
    pub(super) fn step_for(&self, trials: &[Vec<TrialFit>]) -> Result<u8> {
        Ok(match self.options.rate {
            Rate::Psnr(db) => for_psnr(trials, db),
            Rate::Bpp(bpp) => for_bytes(trials, self.bytes_of_maps(bpp)?),
            Rate::Usual | Rate::Profile(_) => USUAL,
        })
    }

    /// What a tile takes at each step that is tried.
    pub(super) fn trials_of_steps(&self, place: Place, band: &Band) -> Result<Vec<TrialFit>> {
        FittedTile::new(band, place.column, self.law, self.header)
            .and_then(|tile| tile.trials(&TRIED))
            .map_err(|what| Error::invalid("tile", what))
    }

    /// Encodes a tile as planes.
    pub(super) fn encode(&self, place: Place, band: &Band) -> Result<Tile> {
        let clock = Clock::start();
        let faulty = |what| of_tile(place, Error::invalid("tile", what));
        let fitted = FittedTile::new(band, place.column, self.law, self.header).map_err(faulty)?;
        let tile = fitted.encoded(self.step()).map_err(faulty)?;
        let mut payload = Payload::default();
        let mut omitted = Vec::new();
        if tile.section.bytes.is_empty() {
            omitted.push("black in every frame".to_owned());
        } else {
            payload.resident = bundle::encode_brightness(&fitted.brightness).map_err(faulty)?;
            payload.maps = tile.section;
        }
        let trained = TrainedTile {
            psnr_db: tile.psnr_db,
            error: Some(tile.error.0),
            omitted,
            ..TrainedTile::default()
        };
        let texels = tile::valid_texels(&self.masks[place.page], place);
        Ok(Tile { payload, stats: TileStats { texels, trained, seconds: clock.seconds() }, resumed: false })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tiles whose bytes double and whose errors halve every eight steps.
    fn trials() -> Vec<Vec<TrialFit>> {
        let of_tile = |scale: f64| {
            let trial = |step: &u8| {
                let octaves = f64::from(*step) / 8.0;
                let bytes = (scale * 1e6 * octaves.exp2()) as u64;
                TrialFit { word: u32::from(*step), bytes, error: scale * (-octaves).exp2(), terms: 1000 }
            };
            TRIED.iter().map(trial).collect()
        };
        vec![of_tile(1.0), Vec::new(), of_tile(3.0)]
    }

    #[test]
    fn steps_between_those_tried_reach_targets_just() {
        // 4·10⁶ · 2^(step/8) bytes; an error of 4 · 2^(−step/8) in 2000 terms.
        for step in [4u8, 9, 20, 33, 51] {
            let bytes = 4e6 * (f64::from(step) / 8.0).exp2();
            assert_eq!(for_bytes(&trials(), (bytes * 1.01) as u64), step);
            assert_eq!(for_bytes(&trials(), (bytes * 0.99) as u64), step.saturating_sub(1).max(TRIED[0]));
            let db = -10.0 * (4.0 * (-f64::from(step) / 8.0).exp2() / 2000.0).log10();
            assert_eq!(for_psnr(&trials(), db - 0.01), step);
            assert_eq!(for_psnr(&trials(), db + 0.01), step + 1);
        }
        assert_eq!((for_bytes(&trials(), 0), for_bytes(&trials(), u64::MAX)), (4, 52));
        assert_eq!((for_psnr(&trials(), 0.0), for_psnr(&trials(), 1e3)), (4, 52));
        assert_eq!((for_bytes(&[], 10), for_psnr(&[], 40.0)), (52, 4));
    }
}
