//! Reads and unpacks a tile's planes, and keeps those of the last tiles.

use super::{Bundle, MapCoding};
use crate::grid::Place;
use crate::planes::{PlaneSet, TilePlanes, decode_section, lit_frames};
use crate::{Error, Result};
use std::sync::Arc;

/// Memory that the unpacked planes of the last tiles may take: a page of 1024² with twenty planes a tile
/// takes 60 MB.
pub const UNPACKED_BYTES: usize = 96 << 20;

impl Bundle {
    /// Reads, checks and unpacks a tile's planes, or gives those of the last tiles asked for, at most
    /// [`UNPACKED_BYTES`]; `None` if it has none.
    ///
    /// # Errors
    /// As [`Bundle::tile`].
    pub fn planes(&self, place: Place) -> Result<Option<Arc<TilePlanes>>> {
        let position = self.position(place)?;
        if self.header.coding != MapCoding::Basis || self.index[position].maps.length == 0 {
            return Ok(None);
        }
        self.unpacked.get(position, || {
            let (timeline, brightness) = (&self.header.timeline, &self.brightness[position]);
            let size = self.header.pages[place.page].stored(place.column, place.row).into();
            Ok(Some(TilePlanes::new(&self.sets(place)?, size, timeline, brightness)))
        })
    }

    /// Reads and checks a tile's planes as they are stored; nothing if it has none.
    ///
    /// # Errors
    /// As [`Bundle::tile`].
    pub fn sets(&self, place: Place) -> Result<Vec<PlaneSet>> {
        let position = self.position(place)?;
        let part = &self.index[position].maps;
        if self.header.coding != MapCoding::Basis || part.length == 0 {
            return Ok(Vec::new());
        }
        let section = self.read(part, || self.name_of(place))?;
        let size = self.header.pages[place.page].stored(place.column, place.row).into();
        let (lit, _) = lit_frames(&self.header.timeline, &self.brightness[position]);
        let frames = |source: u16| match source.checked_sub(1) {
            None => (lit > 0).then_some(lit),
            Some(group) => self.header.lamp(usize::from(group)).map(|_| 1),
        };
        decode_section(&section, part.word, size, frames)
            .map_err(|what| Error::invalid(self.name_of(place), what))
    }
}
