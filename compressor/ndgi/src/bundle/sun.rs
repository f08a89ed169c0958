//! Reads a tile's visibility of the sun and decodes it at all times of visibility or at two.

use super::{Bundle, Entry, Section};
use crate::grid::Place;
use crate::sun::{Shadows, SunDecoder, TileSun};
use crate::{Error, Result};

/// A tile's encoded sections of the sun, a few kilobytes: for stepping from one time of visibility to the
/// next without reading the bundle again. Checksums were verified when they were read.
///
/// ```
/// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
/// use ndgi::grid::Place;
///
/// let place = Place { page: 0, column: 1, row: 0 };
/// if let Some(sections) = bundle.sun_sections(place)? {
///     let morning = sections.at(&bundle, [0, 1])?; // between the first two times
///     let noon = sections.at(&bundle, [3, 3])?; // at the fourth, and later
///     assert_eq!((morning.times, noon.times), (2, 1));
/// }
/// # Ok::<(), ndgi::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SunSections {
    place: Place,
    /// Stored texels across and down.
    size: [usize; 2],
    /// Number of times of visibility.
    times: usize,
    sun: Section,
    /// Empty where shadows do not move, or were not requested.
    shadows: Section,
}

impl SunSections {
    /// The tile.
    pub fn place(&self) -> Place {
        self.place
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        self.sun.bytes.len() + self.shadows.bytes.len()
    }

    /// The tile's visibility at two neighbouring times, as [`SunAt::times`](crate::at::SunAt::times) gives
    /// them, with moving shadows between; at one time if both are equal. Errors at other times are not found.
    /// `bundle` must be the one it was read from.
    ///
    /// # Errors
    /// [`Error::Invalid`] for times that the bundle does not have, or a damaged tile.
    pub fn at(&self, bundle: &Bundle, times: [usize; 2]) -> Result<TileSun> {
        let [first, last] = times;
        if last >= self.times || first > last || last - first > 1 {
            let what = format!("times {times:?}; expected two neighbours, or one, of {}", self.times);
            return Err(Error::invalid(bundle.name_of(self.place), what));
        }
        bundle.unpack(self, Some(&times[..if first == last { 1 } else { 2 }]))
    }

    /// Bytes of moving shadows in the interval that has most of them, as [`Shadows::most_bytes`], without
    /// decoding them.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a damaged section.
    pub fn most_bytes_of_shadows(&self, bundle: &Bundle) -> Result<usize> {
        if self.shadows.bytes.is_empty() {
            return Ok(0);
        }
        let channels = (self.sun.word & 3).max(1) as usize;
        Shadows::most_bytes_in(&self.shadows.bytes, channels, self.times - 1)
            .map_err(|what| Error::invalid(bundle.name_of(self.place), what))
    }
}

impl Bundle {
    /// Reads and decodes one tile's visibility of the sun; `None` if it sees nothing of the sun, or the sun
    /// is not a separate stream.
    ///
    /// # Errors
    /// As [`Bundle::tile`].
    pub fn sun(&self, place: Place) -> Result<Option<TileSun>> {
        self.sun_at(place, None)
    }

    /// Reads a tile's sections of the sun without decoding them; `None` if it sees nothing of the sun, or the
    /// sun is not a separate stream.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a place that the bundle does not have, or a checksum that differs;
    /// [`Error::Io`].
    pub fn sun_sections(&self, place: Place) -> Result<Option<SunSections>> {
        self.read_sun(place, true)
    }

    /// Largest number of bytes of memory for a tile's streams of the sun at one time, in a compact layout:
    /// levels of two times in 3 bits, normals as stored, and the moving shadows between. `ndgi-gpu` needs
    /// more. (All other times stay on disk, or as they are stored.)
    ///
    /// # Errors
    /// As [`Bundle::tile`].
    pub fn bytes_held_of_sun(&self, place: Place) -> Result<u64> {
        let Some((sections, sun)) = self.sun_sections(place)?.zip(self.header.sun.as_ref()) else {
            return Ok(0);
        };
        let tile = self.unpack(&sections, None)?;
        let decoder = self.sun_decoder.get_or_init(|| SunDecoder::new(sun));
        let held = decoder.held(&sections.sun.bytes, sections.sun.word, sections.size);
        Ok((held + tile.shadows.most_bytes(tile.channels())) as u64)
    }

    /// A tile's visibility of the sun at only some of the times of [`Sun::times`](crate::sun::Sun::times).
    pub(crate) fn sun_at(&self, place: Place, times: Option<&[usize]>) -> Result<Option<TileSun>> {
        // They move between two times, or between all.
        let sections = self.read_sun(place, times.is_none_or(|times| times.len() == 2))?;
        sections.map(|sections| self.unpack(&sections, times)).transpose()
    }

    /// Reads a tile's sections of the sun, with or without moving shadows.
    fn read_sun(&self, place: Place, has_shadows: bool) -> Result<Option<SunSections>> {
        let Entry { sun: part, shadows, .. } = &self.index[self.position(place)?];
        let (Some(sun), 1..) = (&self.header.sun, part.length) else { return Ok(None) };
        let read = |part| self.read(part, || self.name_of(place));
        let mut sections = SunSections {
            place,
            size: self.header.pages[place.page].stored(place.column, place.row).into(),
            times: sun.times.len(),
            sun: Section { word: part.word, bytes: read(part)? },
            shadows: Section::default(),
        };
        if has_shadows && shadows.length > 0 {
            sections.shadows = Section { word: shadows.word, bytes: read(shadows)? };
        }
        Ok(Some(sections))
    }

    /// Decodes sections at some times, or at all.
    fn unpack(&self, sections: &SunSections, times: Option<&[usize]>) -> Result<TileSun> {
        let SunSections { place, size, sun: Section { word, bytes }, shadows, .. } = sections;
        let wrong = |what| Error::invalid(self.name_of(*place), what);
        let sun = self.header.sun.as_ref().ok_or_else(|| wrong("a bundle without a sun".to_owned()))?;
        let decoder = self.sun_decoder.get_or_init(|| SunDecoder::new(sun));
        let mut tile = match times {
            Some(times) => decoder.tile_at(bytes, *word, *size, times),
            None => decoder.tile(bytes, *word, *size),
        }
        .map_err(wrong)?;
        if !shadows.bytes.is_empty() && times.is_none_or(|times| times.len() == 2) {
            let only = times.and_then(|times| times.first().copied());
            let section = (shadows.word, &shadows.bytes[..]);
            tile.shadows =
                Shadows::decode(section, *size, tile.channels(), sections.times - 1, only).map_err(wrong)?;
        }
        Ok(tile)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn sections_give_at_two_times_what_the_tile_has_at_all() {
        let bundle = Bundle::from_bytes(testing::sunny_bundle()).unwrap();
        let (mut lit, mut moving) = (0, 0);
        for place in bundle.header.places() {
            let (all, sections) = (bundle.sun(place).unwrap(), bundle.sun_sections(place).unwrap());
            assert_eq!(all.is_some(), sections.is_some());
            let Some((all, sections)) = all.zip(sections) else { continue };
            let (channels, texels) = (all.channels(), all.width * all.height);
            let entry = bundle.index[bundle.header.position(place).unwrap()];
            assert_eq!(
                (sections.place(), sections.bytes() as u64),
                (place, entry.bytes() - u64::from(entry.maps.length))
            );
            assert_eq!(sections.most_bytes_of_shadows(&bundle).unwrap(), all.shadows.most_bytes(channels));
            let levels = |tile: &TileSun, channel: usize, time: usize| {
                tile.levels[(channel * tile.times + time) * texels..][..texels].to_vec()
            };
            for times in [[0, 1], [1, 2], [2, 3], [0, 0], [3, 3]] {
                let tile = sections.at(&bundle, times).unwrap();
                assert_eq!(tile.times, times[1] - times[0] + 1);
                assert_eq!(tile.normals, all.normals);
                for channel in 0..channels {
                    assert_eq!(levels(&tile, channel, 0), levels(&all, channel, times[0]));
                    assert_eq!(levels(&tile, channel, tile.times - 1), levels(&all, channel, times[1]));
                    if times[0] < times[1] {
                        let size = [all.width, all.height];
                        let found = tile.shadows.blocks((channels, channel, 0), size);
                        moving += found.len();
                        assert_eq!(found, all.shadows.blocks((channels, channel, times[0]), size));
                    }
                }
            }
            for times in [[0, 2], [1, 0], [3, 4], [4, 4], [usize::MAX, 0]] {
                assert!(sections.at(&bundle, times).is_err(), "{times:?}");
            }
            lit += 1;
        }
        assert!(lit == 5 && moving > 100, "{lit} {moving}");
        assert!(bundle.sun_sections(Place { page: 2, column: 0, row: 0 }).is_err());
        let without = Bundle::from_bytes(testing::bundle().2).unwrap();
        assert_eq!(without.sun_sections(Place { page: 0, column: 0, row: 0 }).unwrap(), None);
    }
}
