//! The paper's ablations on the same tiles: choice of maps, block-aware training, quantisation.

use super::Options;
use super::method::{CodedTiles, Method, Way, each_tile};
use super::ndgi::{recipe, trained};
use super::table::Row;
use super::tiles::{Tile, TileSet};
use crate::Result;
use crate::compress::of_tile;
use crate::mean::mean;
use crate::model::{Contents, Profile, Shape};
use crate::time::{Coding, Timeline};
use crate::train::{Coded, Recipe, train, train_ablated};
use dataset::host::signals::stop_if_interrupted;
use rayon::prelude::*;

/// What all are changed from.
const M: Profile = Profile::M;

/// A change of the maps; tiles that never change have F_uv alone whatever it is.
type Edit = fn(Contents) -> Contents;

/// Maps at like bits, twice: at those of planes alone, and at those of profile M.
const STRUCTURES: [(&str, Edit); 5] = [
    ("2D maps alone", |all| Contents { uvt: 0, slices: 0, ..all }),
    ("3D map alone, 32²", |all| Contents { uvt: 32, slices: 2 * all.slices, ..space(all) }),
    ("3D map alone, 64²", |all| Contents { uvt: 64, slices: (3 * all.slices).div_ceil(4), ..space(all) }),
    ("hybrid, 3D map 8²", |all| Contents { uvt: 8, ..all }),
    ("hybrid, profile M", |all| all),
];

/// Without the planes.
fn space(all: Contents) -> Contents {
    Contents { uv: false, ut: false, vt: false, rows: 0, ..all }
}

const CODINGS: [(&str, Coded); 3] = [
    ("texel by texel, plain BC7", Coded::TexelByTexel),
    ("endpoints and weights, plain BC7", Coded::Plainly),
    ("endpoints and weights, BC7 on the loss", Coded::OnTheLoss),
];

/// The rows that a decoder stands behind.
pub(super) fn methods<'a>(set: &'a TileSet, options: &'a Options) -> Vec<Method<'a>> {
    let structure = |&(name, edit): &(&str, Edit)| {
        let edit = move |all: Contents| if all.uvt == 0 { all } else { edit(all) };
        (
            "maps",
            name.to_owned(),
            Box::new(edit) as Box<dyn Fn(Contents) -> Contents + Sync>,
            Coded::OnTheLoss,
        )
    };
    let coding = |&(name, coded): &(&str, Coded)| {
        let edit = Box::new(|all: Contents| all) as Box<dyn Fn(Contents) -> Contents + Sync>;
        ("blocks", name.to_owned(), edit, coded)
    };
    let literal = Method {
        family: "recipe",
        name: "the paper's, literally".to_owned(),
        run: Box::new(move || Ok(vec![Way::new(literal(set, options)?, String::new())])),
    };
    let all = STRUCTURES.iter().map(structure).chain(CODINGS.iter().map(coding));
    all.map(|(family, name, edit, coded)| Method {
        family,
        name,
        run: Box::new(move || Ok(vec![Way::new(code(set, options, &edit, coded)?, String::new())])),
    })
    .chain([literal])
    .collect()
}

/// Profile M by the paper's literal recipe and coding, with as many steps: the hour as the time axis, γ on πτ
/// and 2πτ, the power 2.2, constant rate, no gates, blocks that training does not know of.
fn literal(set: &TileSet, options: &Options) -> Result<CodedTiles> {
    let preset = options.effort.preset();
    let timeline = Timeline { coding: Coding::Paper, ..set.timeline.clone() };
    each_tile(set, |tile| {
        let recipe = Recipe { paper: true, ..recipe(&preset, options.seed, tile) };
        Ok(trained(tile, &timeline, |source| train(source, &M, &recipe))?.0)
    })
}

fn code(
    set: &TileSet,
    options: &Options,
    edit: &(dyn Fn(Contents) -> Contents + Sync),
    coded: Coded,
) -> Result<CodedTiles> {
    let preset = options.effort.preset();
    each_tile(set, |tile| {
        let recipe = recipe(&preset, options.seed, tile);
        Ok(trained(tile, &set.timeline, |source| train_ablated(source, &M, edit, coded, &recipe))?.0)
    })
}

/// Bits of a tile, and its PSNR.
type Stage = (f64, Option<f64>);

/// What each step of quantisation of profile M saves and costs: float32, 8 bits, BC7. PSNRs are the trainer's
/// own.
pub(super) fn sizes(set: &TileSet, options: &Options) -> Result<Vec<Row>> {
    let preset = options.effort.preset();
    let tile = |tile: &Tile| -> Result<Option<[Stage; 3]>> {
        stop_if_interrupted()?;
        let recipe = recipe(&preset, options.seed, tile);
        let trained = train_ablated(&tile.source, &M, |all| all, Coded::OnTheLoss, &recipe)
            .map_err(|error| of_tile(tile.place, error))?;
        let Some(params) = &trained.params else { return Ok(None) };
        let shape = Shape::new(
            &params.shape.contents,
            tile.source.width,
            tile.source.height,
            tile.source.frames.len(),
            Coding::Standard,
        );
        let [uv, uvt, ut, vt] = shape.counts();
        // Values of the block maps, of the planes, of the decoder; bits of the means, which are alike in all
        // three.
        let (blocks, planes) = ((64 * (uv + uvt)) as f64, (2 * (ut + vt)) as f64);
        let (decoder, means) = (params.mlp.len() as f64, (64 * params.knots.len()) as f64);
        Ok(Some([
            (32.0 * (blocks + planes + decoder) + means, trained.psnr_unquantised_db),
            (8.0 * (blocks + planes) + 16.0 * decoder + means, trained.psnr_8bit_features_db),
            (2.0 * blocks + 8.0 * planes + 16.0 * decoder + means, trained.psnr_db),
        ]))
    };
    let tiles: Vec<_> = set.tiles.par_iter().with_max_len(1).map(tile).collect::<Result<_>>()?;
    let names = ["profile M, float32", "profile M, 8-bit maps", "profile M, 8-bit planes and BC7"];
    let row = |(i, name): (usize, &str)| {
        let of = || tiles.iter().flatten().map(|steps| steps[i]);
        let bpp = of().map(|(bits, _)| bits).sum::<f64>() / set.values();
        Row::bare("sizes", name, bpp, mean(of().filter_map(|(_, db)| db)))
    };
    Ok(names.into_iter().enumerate().map(row).collect())
}
