//! NDGI itself: the trainer of `compress`, on these tiles.

use super::method::{CodedTile, CodedTiles, timed, together};
use super::tiles::{Texels, Tile, TileSet};
use crate::bundle::encode_payload;
use crate::compress::{Preset, of_tile, seed};
use crate::decode::TileDecoder;
use crate::model::{PAYLOAD, Profile, STORED, TileParams};
use crate::tile::TileSource;
use crate::time::Timeline;
use crate::train::{Aim, Recipe, TrainedTile, train};
use crate::{Error, Result, of_bundle};
use dataset::host::signals::stop_if_interrupted;
use rayon::prelude::*;

/// A bundle's tiles overlap by their border: this many more texels are stored than there are.
const BORDERS: f64 = (STORED * STORED) as f64 / (PAYLOAD * PAYLOAD) as f64;

/// What a tile is trained with.
pub(super) fn recipe(preset: &Preset, of_seed: u64, tile: &Tile) -> Recipe {
    let (iterations, passes) = (preset.iterations, preset.passes);
    Recipe { iterations, passes, paper: false, seed: seed(of_seed, tile.place), aim: Aim::MeanPsnr }
}

/// Every tile by a profile and preset: decoded, and as stored.
pub(super) fn code(
    set: &TileSet,
    profile: &Profile,
    preset: &Preset,
    of_seed: u64,
) -> Result<(CodedTiles, Vec<Option<TileParams>>)> {
    let tiles: Vec<(CodedTile, Option<TileParams>)> = set
        .tiles
        .par_iter()
        .with_max_len(1)
        .map(|tile| {
            stop_if_interrupted()?;
            trained(tile, &set.timeline, |source| train(source, profile, &recipe(preset, of_seed, tile)))
        })
        .collect::<Result<_>>()?;
    let (coded, params): (Vec<_>, Vec<_>) = tiles.into_iter().unzip();
    Ok((together(coded), params))
}

/// All tiles at any hour, as stored ones decode.
pub(super) fn at_hour(set: &TileSet, params: &[Option<TileParams>], hour: f64) -> Result<Vec<Texels>> {
    let tiles = set.tiles.par_iter().zip(params);
    tiles
        .map(|(tile, params)| {
            decode(tile, &[hour], &set.timeline, params.as_ref()).map(|mut images| images.remove(0))
        })
        .collect()
}

/// A tile as some training stores it, decoded and as stored.
pub(super) fn trained(
    tile: &Tile,
    timeline: &Timeline,
    train: impl FnOnce(&TileSource) -> Result<TrainedTile>,
) -> Result<(CodedTile, Option<TileParams>)> {
    let mut stored = None;
    let encode = || {
        let params = train(&tile.source).map_err(|error| of_tile(tile.place, error))?.params;
        let bits = match &params {
            None => 0.0,
            Some(params) => {
                let payload = encode_payload(params).map_err(|what| Error::invalid("payload", what))?;
                8.0 * payload.bytes() as f64 * BORDERS
            }
        };
        Ok((params, bits, Vec::new()))
    };
    let coded = timed(encode, |params: &Option<TileParams>| {
        stored.clone_from(params);
        decode(tile, &tile.source.hours, timeline, params.as_ref())
    })?;
    Ok((coded, stored))
}

fn decode(
    tile: &Tile,
    hours: &[f64],
    timeline: &Timeline,
    params: Option<&TileParams>,
) -> Result<Vec<Texels>> {
    let Some(params) = params else {
        return Ok(vec![vec![[0.0; 3]; tile.texels()]; hours.len()]);
    };
    let decoder = TileDecoder::new(params, timeline).map_err(of_bundle)?;
    Ok(hours.iter().map(|hour| decoder.decode_tile(&timeline.at(*hour))).collect())
}
