//! A tile's data in the form that a pool uploads, read and prepared on any thread.

use crate::load::Data;
use crate::request::Options;
use crate::sun::{Held, Seen};
use crate::tile::Maps;
use crate::{Error, Result};
use ndgi::Bundle;
use ndgi::bundle::{Entry, SunSections};
use ndgi::grid::Place;
use std::sync::Arc;

/// A tile's data in the form that a [`Pool`](crate::Pool) uploads, read and prepared on any thread.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let options = ndgi_gpu::Options::default();
/// use ndgi::grid::Place;
/// use ndgi_gpu::Features;
///
/// let bundle = ndgi::Bundle::open("yard.ndgi".as_ref())?;
/// let features = Features::read(&bundle, Place { page: 0, column: 1, row: 0 }, &options)?;
/// if let Some(sun) = bundle.at(12.3)?.sun() {
///     let interval = features.interval(&bundle, sun.times)?;
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Features {
    pub(crate) known: Arc<Known>,
    pub(crate) data: Data,
}

/// What is known of a tile beside the data that are uploaded: what stays in memory while it is on a device.
#[derive(Debug)]
pub(crate) struct Known {
    pub place: Place,
    /// The tile's line of its bundle's index.
    pub entry: Entry,
    pub maps: Option<Maps>,
    pub sun: Option<OfSun>,
}

/// What is known of a tile's sun.
#[derive(Debug)]
pub(crate) struct OfSun {
    pub seen: Seen,
    sections: SunSections,
}

impl Features {
    /// Reads and prepares a tile: its maps, and its sections of the sun, which stay compressed in memory.
    /// `options` are those of the pool, as [`Pool::options`](crate::Pool::options) has them.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a place that the bundle does not have, or a damaged tile. Damage to what it sees
    /// of the sun at some times is found by [`Features::interval`].
    pub fn read(bundle: &Bundle, place: Place, options: &Options) -> Result<Self> {
        let mut data = Data::default();
        let maps = bundle.tile(place)?.map(|params| data.maps(params, options.unpacks)).transpose()?;
        let sun = match bundle.sun_sections(place)? {
            Some(sections) => {
                // Normals are the same at all times.
                let tile = sections.at(bundle, [0, 0])?;
                let seen = Seen::new(&tile, sections.most_bytes_of_shadows(bundle)?, &mut data.words);
                Some(OfSun { seen, sections })
            }
            None => None,
        };
        let entry = bundle.header.position(place).map(|position| bundle.index[position]).unwrap_or_default();
        Ok(Features { known: Arc::new(Known { place, entry, maps, sun }), data })
    }

    /// The tile.
    pub fn place(&self) -> Place {
        self.known.place
    }

    /// Bytes that the tile takes on a device: its maps, its part of the resident buffer, and that of the
    /// interval's.
    pub fn bytes(&self) -> u64 {
        self.data.picture.bytes()
            + 4 * (self.data.words.len() as u64 + u64::from(self.known.interval_words()))
    }

    /// True if the tile has maps.
    pub fn has_maps(&self) -> bool {
        self.known.maps.is_some()
    }

    /// True if the tile sees the sun at any time.
    pub fn has_sun(&self) -> bool {
        self.known.sun.is_some()
    }

    /// The part that [`Features::interval`] needs, a few kilobytes: keep it when the rest is dropped after
    /// loading into a pool.
    pub fn sunlight(&self) -> Sunlight {
        Sunlight { known: Arc::clone(&self.known) }
    }

    /// The tile's visibility of the sun in an interval: two neighbouring times, or twice the same, as
    /// [`SunAt::times`](ndgi::at::SunAt::times) gives them. Nothing is read; `bundle` is the tile's.
    ///
    /// # Errors
    /// [`Error::Bundle`] for times that the bundle does not have, or a damaged tile.
    pub fn interval(&self, bundle: &Bundle, times: [usize; 2]) -> Result<Interval> {
        self.sunlight().interval(bundle, times)
    }
}

impl Known {
    /// Words of its part of the interval's buffer.
    pub(crate) fn interval_words(&self) -> u32 {
        self.sun.as_ref().map_or(0, |sun| sun.seen.words)
    }

    /// Whether it was read from a bundle, or one that does not differ in what is looked up by the tile.
    ///
    /// # Errors
    /// [`Error::Invalid`] if it was not.
    pub(crate) fn check(&self, bundle: &Bundle) -> Result<()> {
        let header = &bundle.header;
        let entry = header.position(self.place).and_then(|position| bundle.index.get(position));
        let has_shape = |maps: &Maps| {
            let gates = maps.last_gate().is_none_or(|last| usize::from(last) < header.groups.len());
            let shape = header.shape(self.place, &maps.shape().contents);
            *maps.shape() == shape && maps.knots() == header.knots() && gates
        };
        if entry == Some(&self.entry) && self.maps.as_ref().is_none_or(has_shape) {
            return Ok(());
        }
        Err(Error::Invalid(format!("features of {:?} were read from another bundle", self.place)))
    }
}

/// A tile's sun data that [`Sunlight::interval`] needs; cheap to clone.
#[derive(Clone, Debug)]
pub struct Sunlight {
    known: Arc<Known>,
}

impl Sunlight {
    /// The tile.
    pub fn place(&self) -> Place {
        self.known.place
    }

    /// As [`Features::interval`].
    ///
    /// # Errors
    /// As [`Features::interval`].
    pub fn interval(&self, bundle: &Bundle, times: [usize; 2]) -> Result<Interval> {
        let Known { place, entry, sun, .. } = &*self.known;
        let (held, words) = match sun {
            Some(sun) => sun.seen.part(&sun.sections.at(bundle, times)?, times),
            None => (Held::Dark, Vec::new()),
        };
        Ok(Interval { place: *place, entry: *entry, times, held, words })
    }
}

/// A tile's visibility of the sun in an interval, in the form that a [`Pool`](crate::Pool) uploads.
#[derive(Clone, Debug)]
pub struct Interval {
    place: Place,
    /// The tile's line of its bundle's index: the same place of another bundle, as of a mip level, has
    /// another.
    pub(crate) entry: Entry,
    pub(crate) times: [usize; 2],
    pub(crate) held: Held,
    pub(crate) words: Vec<u32>,
}

impl Interval {
    /// The tile.
    pub fn place(&self) -> Place {
        self.place
    }

    /// The times of visibility at its ends, as indices of [`Sun::times`](ndgi::sun::Sun::times).
    pub fn times(&self) -> [usize; 2] {
        self.times
    }

    /// Bytes to upload; 0 if the sun is not seen.
    pub fn bytes(&self) -> u64 {
        if self.held == Held::Dark { 0 } else { 4 * self.words.len() as u64 }
    }
}
