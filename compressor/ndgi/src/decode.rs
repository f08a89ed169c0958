//! Decoding: a stored tile, or a complete bundle, at any (u, v, t).
//!
//! Four ways to the same values; none ever returns a NaN or an infinity:
//! - [`texel`] follows the formulae of [`crate::model`] literally for one texel of a tile's maps, reading
//!   only the blocks it needs. The others are tested against it.
//! - [`TileDecoder`] decodes all texels of one tile's maps fast, at any time: for tiles that are not in a
//!   bundle yet.
//! - [`Decoder`] returns samples and pages of a bundle at any hour, with the sun: for tools.
//! - [`At`](crate::at::At) is a bundle at one time, where everything that depends only on time is computed
//!   once per tile: for games, and for the pages of [`Decoder`].

mod kernel;
mod prepared;
mod texel;
mod tile;

pub(crate) use prepared::Prepared;
pub use texel::texel;
pub use tile::TileDecoder;

use crate::bundle::{Bundle, MapCoding};
use crate::grid::Place;
use crate::model::{BORDER, PAYLOAD, TileParams, Y_MAX};
use crate::recent::Recent;
use crate::sun::TileSun;
use crate::time::{self, Coding, TimePoint, Timeline};
use crate::{Error, Result};
#[cfg(feature = "rayon")]
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// The two texels around a coordinate in [0, 1] on an axis of `n` texels with centres at (i + ½)/n, clamped
/// at the ends, and the share of the second.
#[inline]
fn clamped(u: f32, n: usize) -> (usize, usize, f32) {
    let p = (u * n as f32 - 0.5).clamp(0.0, (n - 1) as f32);
    let i = p as usize;
    (i, (i + 1).min(n - 1), p - i as f32)
}

/// The same on a periodic axis.
#[inline]
fn periodic(tau: f64, n: usize) -> (usize, usize, f32) {
    // In double precision: the integer part of τ · n costs the fraction precision.
    let p = tau * n as f64 - 0.5;
    let floor = p.floor();
    let i = (floor as isize).rem_euclid(n as isize) as usize;
    (i, (i + 1) % n, (p - floor) as f32)
}

/// `(1 − s) a + s b`.
#[inline]
fn lerp(a: f32, b: f32, s: f32) -> f32 {
    a * (1.0 - s) + b * s
}

/// A value among four texels, `at(0, 0)` to `at(1, 1)`.
pub(crate) fn bilinear(at: impl Fn(usize, usize) -> [f32; 3], [s, t]: [f32; 2]) -> [f32; 3] {
    let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
    std::array::from_fn(|i| lerp(lerp(a[i], b[i], s), lerp(c[i], d[i], s), t))
}

/// The means at a time.
fn means_at(tile: &TileParams, point: &TimePoint) -> [f32; 3] {
    let [a, b] = point.knots.map(|knot| tile.knots[knot].mean);
    let [of_a, of_b] = [1.0 - point.fraction, point.fraction];
    std::array::from_fn(|c| (of_a * f64::from(a[c]) + of_b * f64::from(b[c])) as f32)
}

/// A tile's time coordinate at a time.
fn tau_at(tile: &TileParams, timeline: &Timeline, point: &TimePoint) -> f64 {
    let taus = timeline.coding.taus(&timeline.hours, &tile.axis);
    let brightness = |knot: usize| match timeline.coding {
        Coding::Standard => time::brightness(&tile.knots[knot].mean),
        Coding::Paper => 1.0,
    };
    point.tau(&taus, brightness, |knot| f64::from(tile.knots[knot].share))
}

/// A tile's decoder inputs at one time, except for its maps: for decoding elsewhere, as in shaders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// The time coordinate: where the maps are read along τ.
    pub tau: f64,
    /// The means of red, green and blue; all of them 0 where the tile is black.
    pub means: [f32; 3],
    /// γ(τ).
    pub gamma: [f32; 4],
}

impl Inputs {
    /// The inputs of a tile at a position on its bundle's timeline.
    ///
    /// ```no_run
    /// # let bundle = ndgi::Bundle::open("yard.ndgi".as_ref())?;
    /// use ndgi::{decode::{Inputs, along_tau}, grid::Place};
    ///
    /// let (timeline, place) = (&bundle.header.timeline, Place { page: 0, column: 0, row: 0 });
    /// if let Some(tile) = bundle.tile(place)? {
    ///     let inputs = Inputs::at(&tile, timeline, &timeline.at(18.05));
    ///     let (_first, _second, _share_of_second) = along_tau(inputs.tau, tile.shape.uvt[2]);
    /// }
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    pub fn at(tile: &TileParams, timeline: &Timeline, point: &TimePoint) -> Self {
        let tau = tau_at(tile, timeline, point);
        Inputs { tau, means: means_at(tile, point), gamma: timeline.coding.gamma(tau) }
    }
}

/// The two slices or rows around τ of a map that has `n` of them, and the share of the second.
pub fn along_tau(tau: f64, n: usize) -> (usize, usize, f32) {
    periodic(tau, n)
}

/// Irradiance from the decoder's output: `mean · clamp(y, 0, Y_MAX)^p`, finite.
#[inline(always)]
fn irradiance(y: f32, mean: f32, coding: Coding) -> f32 {
    // What is not a number counts as zero.
    let y = if y > 0.0 { y.min(Y_MAX) } else { 0.0 };
    let curve = if coding == Coding::Standard { y * y } else { y.powf(coding.exponent()) };
    (mean * curve).min(f32::MAX)
}

/// Decoded texels: linear Rec. 709 irradiance, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Texels across.
    pub width: usize,
    /// Texels down.
    pub height: usize,
    /// Red, green, blue.
    pub texels: Vec<[f32; 3]>,
}

/// Which light of a bundle is decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lights {
    /// All of it.
    All,
    /// The light of the maps: without the sun's direct light, if that is a separate stream.
    Baked,
    /// Only the sun's direct light, if it is a separate stream.
    Sun,
}

/// Tiles kept for random access.
const CACHED: usize = 64;
/// Byte limit of the cache of sun data, which grows with the number of visibility times; the newest tile is
/// always kept.
const CACHED_BYTES: usize = 64 << 20;

/// Random access to a bundle.
///
/// ```no_run
/// use ndgi::decode::Decoder;
///
/// let decoder = Decoder::open("yard.ndgi".as_ref())?;
/// // In the middle of page 0 at a quarter past six in the evening: red, green, blue.
/// let [r, g, b] = decoder.sample(0, 0.5, 0.5, 18.25)?;
/// # Ok::<(), ndgi::Error>(())
/// ```
#[derive(Debug)]
pub struct Decoder {
    bundle: Bundle,
    /// Most recently read tiles by their place in the index, newest first.
    recent: Recent<TileParams>,
    /// The same for their visibility of the sun.
    recent_sun: Recent<TileSun>,
}

impl Decoder {
    /// Opens a bundle file. Errors as [`Bundle::open`].
    #[cfg(all(feature = "file", any(unix, windows)))]
    pub fn open(path: &std::path::Path) -> Result<Self> {
        Bundle::open(path).map(Self::new)
    }

    /// A decoder of an opened bundle.
    pub fn new(bundle: Bundle) -> Self {
        let recent = Recent::new(CACHED, usize::MAX, |_| 0);
        Decoder { bundle, recent, recent_sun: Recent::new(CACHED, CACHED_BYTES, TileSun::bytes) }
    }

    /// The bundle.
    pub fn bundle(&self) -> &Bundle {
        &self.bundle
    }

    /// Irradiance at (u, v) in [0, 1]² of a page, v downwards, at `hour` (decimal; periodic in 24 h);
    /// bilinear between texel centres, beyond the page as at its edge.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a page that does not exist, an hour that is not a finite number, coordinates
    /// that are not numbers, or a damaged tile; [`Error::Io`].
    pub fn sample(&self, page: usize, u: f64, v: f64, hour: f64) -> Result<[f32; 3]> {
        let grid = self.bundle.grid(page)?;
        time::check_hour(hour)?;
        let (place, [x, y], [s, t]) = grid.around(page, [u, v])?;
        let point = self.bundle.header.timeline.at(hour);
        let is_basis = self.bundle.header.coding == MapCoding::Basis;
        let planes = is_basis.then(|| self.bundle.at(hour)?.only(Lights::Baked).tile(place)).transpose()?;
        let features = if is_basis { None } else { self.tile(place)? };
        let lit = self.sun(place)?;
        let (width, _) = grid.stored(place.column, place.row);
        let at = |dx, dy| {
            let baked = match (&planes, &features) {
                (Some(tile), _) => Some(tile.stored_texel(x + dx, y + dy)),
                (_, tile) => tile
                    .as_ref()
                    .map(|tile| texel(tile, &self.bundle.header.timeline, &point, x + dx, y + dy)),
            };
            let lit = self.bundle.header.sun.as_ref().zip(lit.as_ref());
            let direct =
                lit.map(|(sun, tile)| tile.texel(sun, time::fold_hour(hour), (y + dy) * width + x + dx));
            let [baked, direct] = [baked, direct].map(Option::unwrap_or_default);
            [0, 1, 2].map(|c| (baked[c] + direct[c]).min(f32::MAX))
        };
        Ok(bilinear(at, [s, t]))
    }

    /// The parameters of a tile, from memory where it was read lately; `None` for a black one. Errors as
    /// [`Bundle::tile`].
    pub fn tile(&self, place: Place) -> Result<Option<Arc<TileParams>>> {
        let position = self.bundle.header.position(place).unwrap_or(usize::MAX);
        self.recent.get(position, || self.bundle.tile(place))
    }

    /// A tile's visibility of the sun, cached in the same way; `None` if it sees nothing of the sun, or the
    /// sun is not a separate stream.
    pub fn sun(&self, place: Place) -> Result<Option<Arc<TileSun>>> {
        let position = self.bundle.header.position(place).unwrap_or(usize::MAX);
        self.recent_sun.get(position, || self.bundle.sun(place))
    }

    /// A whole page at `hour`, its rows of tiles in parallel with the feature `rayon`.
    ///
    /// # Errors
    /// As [`Decoder::sample`]; [`Error::Unsupported`] where the page does not fit into memory.
    pub fn decode_page(&self, page: usize, hour: f64) -> Result<Image> {
        let height = self.bundle.grid(page)?.height;
        self.decode_rows(page, hour, 0..height)
    }

    /// Some of the light of a whole page; otherwise as [`Decoder::decode_page`].
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// use ndgi::decode::{Decoder, Lights};
    ///
    /// let decoder = Decoder::new(bundle);
    /// let sun = decoder.decode_page_of(Lights::Sun, 0, 12.3)?;
    /// assert_eq!(sun.texels.len(), sun.width * sun.height);
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Decoder::decode_page`].
    pub fn decode_page_of(&self, lights: Lights, page: usize, hour: f64) -> Result<Image> {
        let height = self.bundle.grid(page)?.height;
        self.decode_rows_of(lights, page, hour, 0..height)
    }

    /// Some rows of a page; otherwise as [`Decoder::decode_page`].
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// # use ndgi::decode::Decoder;
    /// // A page that does not fit into memory, by bands of one row of tiles.
    /// let decoder = Decoder::new(bundle);
    /// let height = decoder.bundle().header.pages[0].height;
    /// for top in (0..height).step_by(126) {
    ///     let band = decoder.decode_rows(0, 12.3, top..(top + 126).min(height))?;
    /// }
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Decoder::decode_page`]; [`Error::Invalid`] for rows that the page does not have.
    pub fn decode_rows(&self, page: usize, hour: f64, rows: Range<usize>) -> Result<Image> {
        self.decode_rows_of(Lights::All, page, hour, rows)
    }

    /// Some of the light of some rows of a page; otherwise as [`Decoder::decode_rows`].
    ///
    /// # Errors
    /// As [`Decoder::decode_rows`].
    pub fn decode_rows_of(
        &self,
        lights: Lights,
        page: usize,
        hour: f64,
        rows: Range<usize>,
    ) -> Result<Image> {
        let grid = self.bundle.grid(page)?;
        if rows.start > rows.end || rows.end > grid.height {
            let what = format!("rows {}..{} requested, but it has {}", rows.start, rows.end, grid.height);
            return Err(Error::invalid(format!("page {page}"), what));
        }
        let at = self.bundle.at(hour)?.only(lights);
        // A few bytes of a bundle may tell of pages that no memory holds.
        let (mut texels, count) = (Vec::new(), grid.width * rows.len());
        texels.try_reserve_exact(count).map_err(|_| {
            let size = format!("{} × {} texels do not fit into memory", grid.width, rows.len());
            Error::unsupported(format!("page {page}"), size)
        })?;
        texels.resize(count, [0.0; 3]);
        let mut image = Image { width: grid.width, height: rows.len(), texels };
        // One band of tiles is one run of whole rows of the page.
        let mut bands = Vec::new();
        let mut rest = &mut image.texels[..];
        let mut y = rows.start;
        while y < rows.end {
            let end = ((y / PAYLOAD + 1) * PAYLOAD).min(rows.end);
            let (band, tail) = rest.split_at_mut((end - y) * grid.width);
            bands.push((y, band));
            (rest, y) = (tail, end);
        }
        let decode = |(first, band): (usize, &mut [[f32; 3]])| {
            let row = first / PAYLOAD;
            let mut decoded = Vec::new();
            for column in 0..grid.columns() {
                // Past the memory of recent tiles: a page may have more than it holds, and needs each once.
                let place = Place { page, column, row };
                let tile = at.tile(place)?;
                if tile.is_black() {
                    continue;
                }
                let (own_width, _) = grid.payload(column, row);
                let (width, _) = grid.stored(column, row);
                tile.stored_light(&mut decoded);
                for (y, line) in band.chunks_exact_mut(grid.width).enumerate() {
                    let from = (first + y - row * PAYLOAD + BORDER) * width + BORDER;
                    let to = column * PAYLOAD;
                    line[to..to + own_width].copy_from_slice(&decoded[from..from + own_width]);
                }
            }
            Ok::<(), Error>(())
        };
        #[cfg(feature = "rayon")]
        bands.into_par_iter().try_for_each(decode)?;
        #[cfg(not(feature = "rayon"))]
        bands.into_iter().try_for_each(decode)?;
        Ok(image)
    }
}

#[cfg(test)]
mod tests;
