//! A bundle at one time of day: tiles are prepared once, then sampled without allocation or locks.
//!
//! ```no_run
//! let bundle = ndgi::Bundle::open("yard.ndgi".as_ref())?;
//! let mut page = bundle.at(18.05)?.page(0)?;
//! let [r, g, b] = page.sample(0.25, 0.75)?;
//! # Ok::<(), ndgi::Error>(())
//! ```

use crate::bundle::{Bundle, MapCoding};
use crate::decode::{Lights, Prepared, bilinear};
use crate::grid::{Grid, Place};
use crate::model::{BORDER, PAYLOAD};
use crate::pack;
use crate::planes::PlanesAt;
use crate::sun::{Sun, TileSun, add_shares, around};
use crate::time::{TimePoint, check_hour, fold_hour};
use crate::{Error, Result};

/// Default number of tiles that a [`Page`] caches: about 40 MB of full tiles with a sun, twice that behind
/// coloured glass.
const KEPT: usize = 256;

/// A bundle at one time of day.
#[derive(Clone, Debug)]
pub struct At<'a> {
    bundle: &'a Bundle,
    lights: Lights,
    hour: f64,
    point: TimePoint,
    /// Where the sun is up: the indices of the surrounding visibility times, and a copy of the sun restricted
    /// to them.
    sun: Option<(Vec<usize>, Sun)>,
}

impl Bundle {
    /// This bundle at a time of day, in decimal hours (18.5 is half past six in the evening; periodic in 24
    /// h): all its light.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// let evening = bundle.at(18.05)?;
    /// let also = bundle.at(18.05 - 24.0)?;
    /// assert!(bundle.at(f64::NAN).is_err());
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] for an hour that is not a finite number.
    pub fn at(&self, hour: f64) -> Result<At<'_>> {
        check_hour(hour)?;
        let (point, hour) = (self.maps_timeline().at(hour), fold_hour(hour));
        let is_up = |sun: &&Sun| sun.path.at(hour).is_some_and(|(_, irradiance)| irradiance != [0.0; 3]);
        let sun = self.header.sun.as_ref().filter(is_up).map(|sun| sun.near(hour));
        Ok(At { bundle: self, lights: Lights::All, hour, point, sun })
    }
}

impl<'a> At<'a> {
    /// The same time, but only some of the light.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// use ndgi::decode::Lights;
    ///
    /// // The sun is drawn by the game.
    /// let rest = bundle.at(12.3)?.only(Lights::Baked).page(0)?.sample(0.5, 0.5)?;
    /// let all = bundle.at(12.3)?.page(0)?.sample(0.5, 0.5)?;
    /// assert!(rest.iter().zip(&all).all(|(rest, all)| rest <= all));
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    pub fn only(self, lights: Lights) -> Self {
        At { lights, ..self }
    }

    /// Reads and prepares a tile: about 75 µs, plus 300 µs where the sun is a separate stream and above the
    /// horizon.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// use ndgi::grid::Place;
    ///
    /// let noon = bundle.at(12.0)?;
    /// for place in bundle.header.places() {
    ///     let tile = noon.tile(place)?;
    ///     println!("{place:?}: {} × {}, {}", tile.width(), tile.height(), if tile.is_black() { "black" } else { "lit" });
    /// }
    /// assert!(noon.tile(Place { page: 9, column: 0, row: 0 }).is_err());
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] for a place that the bundle does not have, or a damaged tile; [`Error::Io`].
    pub fn tile(&self, place: Place) -> Result<Tile> {
        // A place that the bundle does not have is refused here.
        self.bundle.knots(place)?;
        let grid = self.bundle.header.pages[place.page];
        let maps = match self.lights {
            Lights::Sun => None,
            _ => self.maps(place)?,
        };
        let lit = match self.sun.as_ref().filter(|_| self.lights != Lights::Baked) {
            Some((times, sun)) => {
                let tile = self.bundle.sun_at(place, Some(times))?;
                let irradiance = sun.path.at(self.hour).map_or([0.0; 3], |(_, irradiance)| irradiance);
                tile.map(|tile| Lit { shares: tile.shares(sun, self.hour), irradiance })
            }
            None => None,
        };
        Ok(Tile {
            size: grid.payload(place.column, place.row),
            stored: grid.stored(place.column, place.row),
            maps,
            lit,
        })
    }

    /// What a tile's maps hold, without the sun's stream; `None` if it is black.
    fn maps(&self, place: Place) -> Result<Option<Maps>> {
        let header = &self.bundle.header;
        if header.coding == MapCoding::Neural {
            let Some(tile) = self.bundle.tile(place)? else { return Ok(None) };
            let prepared = Prepared::new(&tile, &header.timeline, &self.point)?;
            return Ok(prepared.map(|prepared| Maps::Neural(Box::new(prepared))));
        }
        let Some(planes) = self.bundle.planes(place)? else { return Ok(None) };
        let groups: Vec<usize> = (0..header.groups.len()).filter(|group| header.apart[*group]).collect();
        let weight = |at: usize| f32::from(u8::from(header.timeline.is_on(groups[at], self.hour)));
        let at = planes.at(&self.point, |group| header.lamp(usize::from(group)), weight);
        Ok((!at.is_black()).then_some(Maps::Planes(at)))
    }

    /// The position on the bundle's timeline.
    pub fn point(&self) -> &TimePoint {
        &self.point
    }

    /// The sun, if it is a separate stream, above the horizon and requested.
    pub fn sun(&self) -> Option<SunAt> {
        let (times, sun) = self.sun.as_ref().filter(|_| self.lights != Lights::Baked)?;
        let (direction, irradiance) = sun.path.at(self.hour)?;
        let (first, last) = (*times.first()?, *times.last()?);
        let (.., part) = around(&sun.times, self.hour);
        Some(SunAt { times: [first, last], part, direction, irradiance })
    }

    /// A tile's visibility of the sun at the times of [`SunAt::times`], with moving shadows between them;
    /// `None` if it sees nothing of the sun, or the sun is down.
    ///
    /// # Errors
    /// As [`At::tile`].
    pub fn sun_of(&self, place: Place) -> Result<Option<TileSun>> {
        match self.sun.as_ref().filter(|_| self.lights != Lights::Baked) {
            Some((times, _)) => self.bundle.sun_at(place, Some(times)),
            None => Ok(None),
        }
    }

    /// A page that prepares its tiles on demand and caches them.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// let mut page = bundle.at(12.0)?.page(0)?.keeping(1000);
    /// let [red, green, blue] = page.sample(0.25, 0.75)?;
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] for a page that does not exist.
    pub fn page(&self, page: usize) -> Result<Page<'a>> {
        let grid = self.bundle.grid(page)?;
        Ok(Page { at: self.clone(), page, grid, tiles: Vec::new(), most: KEPT, now: 0 })
    }
}

/// The sun at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunAt {
    /// The surrounding times of visibility, as indices of [`Sun::times`]; equal outside their range.
    pub times: [usize; 2],
    /// How far it is from the first to the second.
    pub part: f32,
    /// Mean direction towards the visible part of its disc, as [`crate::sun::SunPath::direction`].
    pub direction: [f32; 3],
    /// Irradiance of a surface that faces it.
    pub irradiance: [f32; 3],
}

/// What a tile's maps hold at one time.
#[derive(Clone, Debug)]
enum Maps {
    Neural(Box<Prepared>),
    Planes(PlanesAt),
}

impl Maps {
    fn texel(&self, x: usize, y: usize) -> [f32; 3] {
        match self {
            Maps::Neural(prepared) => prepared.texel(x, y),
            Maps::Planes(planes) => planes.texel(x, y),
        }
    }

    fn decode_into(&self, out: &mut [[f32; 3]]) {
        match self {
            Maps::Neural(prepared) => prepared.decode_into(out),
            Maps::Planes(planes) => planes.decode_into(out),
        }
    }
}

/// A tile's direct light of the sun at one time.
#[derive(Clone, Debug)]
struct Lit {
    /// By channel (one or three), the share of the sun's irradiance on each stored texel.
    shares: Vec<Vec<f32>>,
    irradiance: [f32; 3],
}

/// A tile at one time of day, ready for sampling; it borrows nothing.
///
/// Texels are those of its own part, its *payload*, (0, 0) the upper left one: [`Tile::width`] across,
/// [`Tile::height`] down. Light is linear Rec. 709 irradiance, red, green, blue, in the bundle's unit, never
/// a NaN and never infinite.
#[derive(Clone, Debug)]
pub struct Tile {
    size: (usize, usize),
    stored: (usize, usize),
    maps: Option<Maps>,
    lit: Option<Lit>,
}

impl Tile {
    /// Texels across.
    pub fn width(&self) -> usize {
        self.size.0
    }

    /// Texels down.
    pub fn height(&self) -> usize {
        self.size.1
    }

    /// True if every texel is black at this time.
    pub fn is_black(&self) -> bool {
        self.maps.is_none() && self.lit.is_none()
    }

    /// One texel.
    ///
    /// # Panics
    /// For a texel outside the tile.
    pub fn texel(&self, x: usize, y: usize) -> [f32; 3] {
        assert!(x < self.size.0 && y < self.size.1, "texel ({x}, {y}) of {:?}", self.size);
        self.stored_texel(x + BORDER, y + BORDER)
    }

    /// Light by bilinear filtering; texel centres are at halves. Positions up to a texel beyond the payload
    /// read the border; a NaN counts as 0.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// # let tile = bundle.at(12.0)?.tile(ndgi::grid::Place { page: 0, column: 0, row: 0 })?;
    /// // The centre of texel (3, 5) is at halves.
    /// let at_centre = tile.sample(3.5, 5.5);
    /// let texel = tile.texel(3, 5);
    /// assert!(at_centre.iter().zip(texel).all(|(a, b)| (a - b).abs() <= 1e-4 * b));
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    pub fn sample(&self, x: f32, y: f32) -> [f32; 3] {
        let axis = |at: f32, stored: usize| {
            let p = (at + (BORDER as f32 - 0.5)).clamp(0.0, (stored - 1) as f32);
            let p = if p.is_nan() { 0.0 } else { p };
            let i = (p as usize).min(stored - 2);
            (i, p - i as f32)
        };
        let ((x, s), (y, t)) = (axis(x, self.stored.0), axis(y, self.stored.1));
        self.bilinear([x, y], [s, t])
    }

    fn bilinear(&self, [x, y]: [usize; 2], shares: [f32; 2]) -> [f32; 3] {
        bilinear(|dx, dy| self.stored_texel(x + dx, y + dy), shares)
    }

    pub(crate) fn stored_texel(&self, x: usize, y: usize) -> [f32; 3] {
        let light = self.maps.as_ref().map_or([0.0; 3], |maps| maps.texel(x, y));
        let Some(Lit { shares, irradiance }) = &self.lit else { return light };
        let i = y * self.stored.0 + x;
        std::array::from_fn(|c| (light[c] + shares[c.min(shares.len() - 1)][i] * irradiance[c]).min(f32::MAX))
    }

    /// All texels, row by row.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// # let tile = bundle.at(12.0)?.tile(ndgi::grid::Place { page: 0, column: 0, row: 0 })?;
    /// let mut light = vec![[0.0f32; 3]; tile.width() * tile.height()];
    /// tile.decode_into(&mut light);
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Panics
    /// Unless `out` has as many texels as the tile.
    pub fn decode_into(&self, out: &mut [[f32; 3]]) {
        self.decode_as(out, |light| light);
    }

    /// All texels as RGBA of 16-bit floats: light times `exposure`, and 1; values above 65504 are clamped. An
    /// exposure of 256, which the material divides by, reaches 255 kilolux (twice full daylight) and holds 11
    /// bits down to a quarter of a millilux. Lux (1000) cut daylight at 65.5 kilolux; kilolux (1) lose bits
    /// below 61 millilux.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// # let tile = bundle.at(12.0)?.tile(ndgi::grid::Place { page: 0, column: 0, row: 0 })?;
    /// let mut halves = vec![[0u16; 4]; tile.width() * tile.height()];
    /// tile.decode_rgba16f(256.0, &mut halves);
    /// // In a shader: E = texel / 256. On the CPU:
    /// let red = ndgi::half::F16::from_bits(halves[0][0]).to_f32() / 256.0;
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Panics
    /// As [`Tile::decode_into`].
    pub fn decode_rgba16f(&self, exposure: f32, out: &mut [[u16; 4]]) {
        self.decode_as(out, |light| pack::rgba16f(light, exposure));
    }

    /// All texels as RGB of 9 bits with one exponent of 5 bits (DXGI's R9G9B9E5, Vulkan's E5B9G9R9): light
    /// times `exposure`, at most 65408.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// # let tile = bundle.at(12.0)?.tile(ndgi::grid::Place { page: 0, column: 0, row: 0 })?;
    /// let mut packed = vec![0u32; tile.width() * tile.height()];
    /// tile.decode_rgb9e5(1.0, &mut packed);
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Panics
    /// As [`Tile::decode_into`].
    pub fn decode_rgb9e5(&self, exposure: f32, out: &mut [u32]) {
        self.decode_as(out, |light| pack::rgb9e5(light, exposure));
    }

    /// All texels as RGBA of 8 bits: √(light / peak), clamped to 1, and 255. [`Bundle::knots`] has the peaks
    /// of a tile's maps.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// # let tile = bundle.at(12.0)?.tile(ndgi::grid::Place { page: 0, column: 0, row: 0 })?;
    /// let mut bytes = vec![[0u8; 4]; tile.width() * tile.height()];
    /// tile.decode_rgba8(120.0, &mut bytes);
    /// // In a shader: E = 120 · texel².
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Panics
    /// As [`Tile::decode_into`].
    pub fn decode_rgba8(&self, peak: f32, out: &mut [[u8; 4]]) {
        self.decode_as(out, |light| pack::rgba8(light, peak));
    }

    fn decode_as<T>(&self, out: &mut [T], pack: impl Fn([f32; 3]) -> T) {
        let (width, height) = self.size;
        assert_eq!(out.len(), width * height, "texels of the tile");
        let mut texels = Vec::new();
        self.stored_light(&mut texels);
        for (y, line) in out.chunks_exact_mut(width).enumerate() {
            let from = (y + BORDER) * self.stored.0 + BORDER;
            line.iter_mut().zip(&texels[from..]).for_each(|(to, light)| *to = pack(*light));
        }
    }

    /// Overwrites `out` with all stored texels, the border included.
    pub(crate) fn stored_light(&self, out: &mut Vec<[f32; 3]>) {
        out.clear();
        out.resize(self.stored.0 * self.stored.1, [0.0; 3]);
        if let Some(maps) = &self.maps {
            maps.decode_into(out);
        }
        if let Some(Lit { shares, irradiance }) = &self.lit {
            add_shares(shares, *irradiance, out);
        }
    }
}

/// A page at one time of day; tiles are prepared on demand and the most recently used are cached.
#[derive(Clone, Debug)]
pub struct Page<'a> {
    at: At<'a>,
    page: usize,
    grid: Grid,
    /// Column and row, time of the last use, and the tile.
    tiles: Vec<([usize; 2], u64, Tile)>,
    most: usize,
    now: u64,
}

impl Page<'_> {
    /// Sets the largest number of cached tiles; at least one.
    pub fn keeping(self, tiles: usize) -> Self {
        Page { most: tiles.max(1), ..self }
    }

    /// Texels across.
    pub fn width(&self) -> usize {
        self.grid.width
    }

    /// Texels down.
    pub fn height(&self) -> usize {
        self.grid.height
    }

    /// Light at (u, v) in [0, 1]², v downwards, bilinear between texel centres; beyond the page as at its
    /// edge.
    ///
    /// # Errors
    /// [`Error::Invalid`] for coordinates that are not numbers, or a damaged tile; [`Error::Io`].
    pub fn sample(&mut self, u: f32, v: f32) -> Result<[f32; 3]> {
        let (Place { column, row, .. }, texel, shares) = self.grid.around(self.page, [u.into(), v.into()])?;
        Ok(self.tile([column, row])?.bilinear(texel, shares))
    }

    /// One texel of the page.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a texel that the page does not have, or a damaged tile; [`Error::Io`].
    pub fn texel(&mut self, x: usize, y: usize) -> Result<[f32; 3]> {
        if x >= self.grid.width || y >= self.grid.height {
            let size = format!("the page has {} × {} texels", self.grid.width, self.grid.height);
            return Err(Error::invalid(format!("texel ({x}, {y})"), size));
        }
        Ok(self.tile([x / PAYLOAD, y / PAYLOAD])?.texel(x % PAYLOAD, y % PAYLOAD))
    }

    fn tile(&mut self, place: [usize; 2]) -> Result<&Tile> {
        self.now += 1;
        let at = match self.tiles.iter().position(|(of, ..)| *of == place) {
            Some(at) => at,
            None => {
                let [column, row] = place;
                let tile = self.at.tile(Place { page: self.page, column, row })?;
                if self.tiles.len() >= self.most {
                    let oldest = (0..self.tiles.len()).min_by_key(|&i| self.tiles[i].1);
                    oldest.map(|i| self.tiles.swap_remove(i));
                }
                self.tiles.push((place, 0, tile));
                self.tiles.len() - 1
            }
        };
        // The most recently used tile is found first.
        self.tiles.swap(0, at);
        self.tiles[0].1 = self.now;
        Ok(&self.tiles[0].2)
    }
}

#[cfg(test)]
mod tests {
    use crate::decode::Decoder;
    use crate::testing;

    #[test]
    fn pages_of_one_row_and_black_tiles_are_sampled_to_their_edges() {
        let decoder = Decoder::new(crate::Bundle::from_bytes(testing::bundle().2).unwrap());
        let mut black = 0;
        for page in 0..2 {
            let mut ready = decoder.bundle().at(6.0).unwrap().page(page).unwrap().keeping(1);
            for i in 0..=64 {
                for v in [0.0, 0.3, 1.0] {
                    let u = i as f32 / 64.0;
                    let found = ready.sample(u, v).unwrap();
                    let expected = decoder.sample(page, u.into(), v.into(), 6.0).unwrap();
                    black += usize::from(expected == [0.0; 3]);
                    for c in 0..3 {
                        let bound = 1e-4 * expected[c].max(0.05);
                        assert!(
                            (found[c] - expected[c]).abs() <= bound,
                            "{page} ({u}, {v}): {found:?} {expected:?}"
                        );
                    }
                }
            }
        }
        assert!((1..390).contains(&black), "{black}");
    }
}
