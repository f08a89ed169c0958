//! Compares profiles and presets on some tiles of a dataset.

use crate::bundle::{checksum, encode_payload};
use crate::clock::Clock;
use crate::compress::{Preset, of_tile, seed, timeline};
use crate::decode::TileDecoder;
use crate::evaluate::{aligned, cell};
use crate::grid::{Grid, Place};
use crate::law::{Law, is_sun_apart};
use crate::mean::{mean, weighted_mean};
use crate::model::{Profile, TileParams};
use crate::tile::{Band, Coverage, TileSource, valid_texels};
use crate::time::Timeline;
use crate::train::{Aim, Recipe, TrainedTile, train};
use crate::{Error, Result, of_bundle};
use dataset::format::Rect;
use dataset::host::signals::stop_if_interrupted;
use dataset::image::{Image, Mask};
use dataset::observe::Observer;
use dataset::pictures::metrics;
use dataset::store::Dataset;
use rayon::prelude::*;
use reports::Section;
use reports::plot::Plot;
use serde::Serialize;

/// Options of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Tiles with valid texels, at most; the seed draws them.
    pub tiles: usize,
    /// Sizes of the representation.
    pub profiles: Vec<Profile>,
    /// Each is trained with each of these.
    pub presets: Vec<Preset>,
    /// Seed of all randomness.
    pub seed: u64,
}

/// Columns of the table, as the CSV names them.
const COLUMNS: [&str; 8] = [
    "profile",
    "preset",
    "bpp",
    "psnr_unquantised_db",
    "psnr_8bit_features_db",
    "psnr_bc7_db",
    "one_minus_ssim",
    "seconds",
];

/// The same for people.
const HEADER: [&str; 8] =
    ["profile", "preset", "bpp", "unquantised dB", "8-bit dB", "BC7 dB", "1 − SSIM", "CPU s per tile"];

/// What a profile reaches with a preset: means over tiles, weighted by their valid texels, of each tile over
/// its lit frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the profile.
    pub profile: &'static str,
    /// Name of the preset.
    pub preset: &'static str,
    /// Bits of the payloads per texel and frame.
    pub bpp: f64,
    /// PSNR of the float model; peak = the frame's largest valid value in the tile.
    pub psnr_unquantised_db: Option<f64>,
    /// The same with all its features rounded to 8 bits.
    pub psnr_8bit_features_db: Option<f64>,
    /// Of the stored tile, as it decodes.
    pub psnr_bc7_db: Option<f64>,
    /// 1 − structural similarity of the stored tile.
    pub one_minus_ssim: Option<f64>,
    /// CPU seconds a tile, all tiles alike.
    pub seconds: f64,
}

/// A comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sweep {
    /// Tiles trained.
    pub tiles: usize,
    /// Tiles with valid texels that there are.
    pub tiles_of: usize,
    /// Whether the sun's direct light is left to a separate stream.
    pub is_sun_apart: bool,
    /// Profile by profile, each preset by preset.
    pub rows: Vec<Row>,
}

/// One training's share of a row.
struct Measured {
    /// What it weighs: valid texels, its border with them.
    weight: usize,
    bits: f64,
    /// Texels the tile owns × frames.
    values: f64,
    unquantised: Option<f64>,
    of_8bit: Option<f64>,
    bc7: Option<f64>,
    one_minus_ssim: Option<f64>,
    seconds: f64,
}

/// Trains the chosen tiles of a dataset by every profile and preset. Writes nothing.
///
/// # Errors
/// As [`crate::compress::compress`].
pub fn sweep(dataset: &Dataset, options: &Options, console: &dyn Observer) -> Result<Sweep> {
    dataset.expect_day()?;
    let masks = dataset.masks()?;
    let (places, of) = choose(&masks, options);
    let timeline = timeline(dataset);
    let law = Law::new(dataset, is_sun_apart(&dataset.config))?;
    let kinds: Vec<(&Profile, &Preset)> = options
        .profiles
        .iter()
        .flat_map(|profile| options.presets.iter().map(move |preset| (profile, preset)))
        .collect();
    let progress = console.progress("sweeping", (places.len() * kinds.len()) as u64);
    let mut measured: Vec<Vec<Measured>> = kinds.iter().map(|_| Vec::new()).collect();
    for row in places.chunk_by(|a, b| (a.page, a.row) == (b.page, b.row)) {
        let Place { page, row: of_page, .. } = row[0];
        let band = Band::load(dataset, &law, &masks[page], page, of_page)?;
        let sources: Vec<(Place, TileSource)> =
            row.iter().map(|&place| (place, band.tile(place.column))).collect();
        let work: Vec<_> =
            (0..kinds.len()).flat_map(|kind| sources.iter().map(move |source| (kind, source))).collect();
        let done: Vec<Result<(usize, Option<Measured>)>> = work
            .into_par_iter()
            .with_max_len(1)
            .map(|(kind, (place, source))| {
                stop_if_interrupted()?;
                let (profile, preset) = kinds[kind];
                let (iterations, passes) = (preset.iterations, preset.passes);
                let seed = seed(options.seed, *place);
                let recipe = Recipe { iterations, passes, paper: false, seed, aim: Aim::MeanPsnr };
                let clock = Clock::start();
                let trained = train(source, profile, &recipe).map_err(|error| of_tile(*place, error))?;
                let seconds = clock.seconds();
                let grid = Grid { width: masks[page].width, height: masks[page].height };
                let (width, height) = grid.payload(place.column, place.row);
                let weight = valid_texels(&masks[page], *place);
                let measured = measure(source, &trained, &timeline, [weight, width * height], seconds)?;
                progress.advance(1);
                Ok((kind, measured))
            })
            .collect();
        for done in done {
            let (kind, tile) = done?;
            measured[kind].extend(tile);
        }
    }
    let rows = kinds.iter().zip(&measured).map(|((profile, preset), tiles)| {
        let of = |value: fn(&Measured) -> Option<f64>| {
            weighted_mean(tiles.iter().filter_map(|tile| Some((value(tile)?, tile.weight))))
        };
        let sum = |value: &dyn Fn(&Measured) -> f64| tiles.iter().map(value).sum::<f64>();
        Row {
            profile: profile.name,
            preset: preset.name,
            bpp: sum(&|tile| tile.bits) / sum(&|tile| tile.values).max(1.0),
            psnr_unquantised_db: of(|tile| tile.unquantised),
            psnr_8bit_features_db: of(|tile| tile.of_8bit),
            psnr_bc7_db: of(|tile| tile.bc7),
            one_minus_ssim: of(|tile| tile.one_minus_ssim),
            seconds: sum(&|tile| tile.seconds) / tiles.len().max(1) as f64,
        }
    });
    Ok(Sweep { tiles: places.len(), tiles_of: of, is_sun_apart: law.is_apart, rows: rows.collect() })
}

/// The tiles to train, in the order of pages and rows, and of how many they were drawn.
fn choose(masks: &[Mask], options: &Options) -> (Vec<Place>, usize) {
    let grid = |(page, mask): (usize, &Mask)| Grid { width: mask.width, height: mask.height }.places(page);
    let places = masks.iter().enumerate().flat_map(grid);
    let mut places: Vec<Place> =
        places.filter(|place| valid_texels(&masks[place.page], *place) > 0).collect();
    let of = places.len();
    // The order of their digests is as good as random.
    places.sort_by_key(|place| checksum(&[b"sweep", &seed(options.seed, *place).to_le_bytes()]));
    places.truncate(options.tiles);
    places.sort_by_key(|place| (place.page, place.row, place.column));
    (places, of)
}

/// What a trained tile is, of its weight and the texels it owns; nothing for one without light.
fn measure(
    source: &TileSource,
    trained: &TrainedTile,
    timeline: &Timeline,
    [weight, own]: [usize; 2],
    seconds: f64,
) -> Result<Option<Measured>> {
    let Some(params) = &trained.params else { return Ok(None) };
    let payload = encode_payload(params).map_err(|what| Error::invalid("payload", what))?;
    let qualities = qualities(source, params, timeline)?;
    Ok(Some(Measured {
        weight,
        bits: 8.0 * payload.bytes() as f64,
        values: (own * source.frames.len()) as f64,
        unquantised: trained.psnr_unquantised_db,
        of_8bit: trained.psnr_8bit_features_db,
        bc7: mean(qualities.iter().filter_map(|quality| quality.psnr_db)),
        one_minus_ssim: mean(qualities.iter().filter_map(|quality| quality.ssim)).map(|ssim| 1.0 - ssim),
        seconds,
    }))
}

/// A stored tile against its light, at every frame.
fn qualities(
    source: &TileSource,
    params: &TileParams,
    timeline: &Timeline,
) -> Result<Vec<metrics::TileQuality>> {
    let (width, height) = (source.width, source.height);
    let decoder = TileDecoder::new(params, timeline).map_err(of_bundle)?;
    let valid = source.coverage.iter().map(|coverage| *coverage == Coverage::Valid).collect();
    let mask = Mask { width, height, valid };
    let all = Rect { x0: 0, y0: 0, x1: width, y1: height };
    let quality = |(hour, frame): (&f64, &Vec<[f32; 3]>)| {
        let decoded = Image { width, height, texels: decoder.decode_tile(&timeline.at(*hour)) };
        let reference = Image { width, height, texels: frame.clone() };
        metrics::compare(&decoded, &reference, &mask, all)
    };
    Ok(source.hours.iter().zip(&source.frames).map(quality).collect())
}

impl Sweep {
    /// The table's rows.
    fn rows(&self) -> Vec<Vec<String>> {
        let row = |row: &Row| {
            vec![
                row.profile.to_owned(),
                row.preset.to_owned(),
                format!("{:.3}", row.bpp),
                cell(row.psnr_unquantised_db, 2),
                cell(row.psnr_8bit_features_db, 2),
                cell(row.psnr_bc7_db, 2),
                cell(row.one_minus_ssim, 5),
                format!("{:.2}", row.seconds),
            ]
        };
        self.rows.iter().map(row).collect()
    }

    /// The table as lines of text, with its number of tiles.
    pub fn table(&self) -> Vec<String> {
        let mut lines = aligned(&HEADER, &self.rows());
        lines.push(format!(
            "{} of {} tiles with valid texels, weighted by these; only their texels count in bpp. BC7 may exceed \
             unquantised, because training continues on its blocks",
            self.tiles, self.tiles_of
        ));
        if self.is_sun_apart {
            lines.push(
                "the sun's direct light, a separate stream in bundles, is not in these maps".to_owned(),
            );
        }
        lines
    }

    /// Comma-separated values, to full precision.
    pub fn csv(&self) -> String {
        let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
        let line = |row: &Row| {
            let psnr =
                [row.psnr_unquantised_db, row.psnr_8bit_features_db, row.psnr_bc7_db, row.one_minus_ssim]
                    .map(number);
            format!("{},{},{},{},{}\n", row.profile, row.preset, row.bpp, psnr.join(","), row.seconds)
        };
        let lines: String = self.rows.iter().map(line).collect();
        format!("{}\n{lines}", COLUMNS.join(","))
    }

    /// The report's section: the table, and quality against seconds.
    pub fn section(&self) -> Section {
        let mut section = Section::new("Profiles and presets");
        section.paragraph(&format!(
            "{} of {} tiles with valid texels, each trained with every profile and preset. PSNR: mean over tiles weighted by their \
             valid texels and over frames, peak = the frame's largest valid value; of the float model, with its \
             features rounded to 8 bits, and of the decoded BC7 tile, which may exceed both, because training continues \
             on its blocks. Bits of the tiles' payloads per texel of these tiles. CPU seconds per tile, quantisation included.",
            self.tiles, self.tiles_of
        ));
        section.table(&HEADER, &self.rows());
        let points =
            |rows: &[Row]| rows.iter().filter_map(|row| Some((row.seconds, row.psnr_bc7_db?))).collect();
        let lines = self.rows.chunk_by(|a, b| a.profile == b.profile);
        section.plot(&Plot {
            title: "Quality against training time".to_owned(),
            x: "CPU seconds per tile".to_owned(),
            y: "PSNR in dB, as stored".to_owned(),
            log_x: true,
            log_y: false,
            lines: lines.map(|rows| (rows[0].profile.to_owned(), points(rows))).collect(),
        });
        section
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compress::DRAFT;
    use crate::model::PROFILES;

    #[test]
    fn tiles_are_drawn_by_the_seed_among_those_with_valid_texels() {
        let mask = |width: usize, height: usize| Mask {
            width,
            height,
            // Nothing on the left.
            valid: (0..width * height).map(|i| i % width > 140).collect(),
        };
        let masks = [mask(1000, 500), mask(300, 100)];
        let options =
            |tiles, seed| Options { tiles, profiles: PROFILES.to_vec(), presets: vec![DRAFT], seed };
        let (all, of) = choose(&masks, &options(99, 1));
        // Columns 1 to 7 of four rows, and two tiles of the other page.
        assert_eq!((all.len(), of), (30, 30));
        assert!(all.is_sorted_by_key(|place| (place.page, place.row, place.column)));
        let (some, of) = choose(&masks, &options(5, 1));
        assert_eq!((some.len(), of), (5, 30));
        assert!(some.iter().all(|place| all.contains(place)));
        assert_eq!(some, choose(&masks, &options(5, 1)).0);
        assert_ne!(some, choose(&masks, &options(5, 2)).0);
    }
}
