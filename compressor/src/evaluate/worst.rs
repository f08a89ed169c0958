//! Which hour and which tile are worst to look at.

use super::quality::Quality;
use super::sample::Sample;
use crate::seen::CELL;
use dataset::format::Rect;

/// Darkest mean light that counts as visible, in lux: half a full moon's. With an unknown unit, any light
/// counts.
pub const VISIBLE_LUX: f64 = 0.1;

/// The tile whose errors are seen most: of the largest local error at 95 % of its texels, of tiles with as
/// many valid texels as a cell has (of all, if none has), at hours of visible light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorstTile {
    /// Index of its frame.
    pub frame: usize,
    /// Page.
    pub page: usize,
    /// Its texels.
    pub rect: Rect,
    /// 95 % of its texels have at most this local error.
    pub local_p95: f64,
}

/// The frame with the largest local error at 95 % of its texels: of frames that are visible, of equal ones
/// the first.
pub(super) fn worst_hour(by_hour: &[(f64, Quality)], is_visible: impl Fn(usize) -> bool) -> Option<usize> {
    let errors = by_hour.iter().enumerate().filter(|(frame, _)| is_visible(*frame));
    let errors = errors.filter_map(|(frame, (_, quality))| Some((frame, quality.seen.local?.p95)));
    errors.rev().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(frame, _)| frame)
}

/// The worst tile, likewise.
pub(super) fn worst_tile(samples: &[Sample], is_visible: impl Fn(usize) -> bool) -> Option<WorstTile> {
    let tiles = samples.iter().filter(|sample| is_visible(sample.frame));
    let tiles = tiles.filter_map(|sample| Some((sample, sample.seen.local?.p95)));
    let is_large = |sample: &Sample| sample.quality.texels >= CELL * CELL;
    let worst = tiles.rev().max_by(|a, b| is_large(a.0).cmp(&is_large(b.0)).then(a.1.total_cmp(&b.1)));
    worst.map(|(&Sample { frame, page, rect, .. }, local_p95)| WorstTile { frame, page, rect, local_p95 })
}
