//! Which texels a triangle touches (conservative) and which texel centres it covers, as bit rows.

use glam::DVec2;
use std::ops::Range;

/// Texels: everything nearer to a triangle than this counts as touched, so that rounding corners to `f32` on
/// pages up to 16384 texels (half an ulp is 2⁻¹¹) never touches a texel that was not counted. Taller virtual
/// pages need more.
pub(crate) const TOLERANCE: f64 = 1.0 / 1024.0;

/// A bit per texel, rows of 64-bit words, the lowest bit leftmost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Bits {
    /// Texels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 64-bit words per row.
    pub stride: usize,
    /// `height × stride` words; bits beyond `width` are zero.
    pub words: Vec<u64>,
}

impl Bits {
    /// All zero.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let stride = width.div_ceil(64);
        Bits { width, height, stride, words: vec![0; stride * height] }
    }

    /// The first column from `from` on whose bit in row `y` is `one`.
    pub(crate) fn next(&self, y: usize, from: usize, one: bool) -> Option<usize> {
        let row = &self.words[y * self.stride..][..self.stride];
        let flip = if one { 0 } else { u64::MAX };
        let mut mask = u64::MAX << (from % 64);
        for (i, &word) in row.iter().enumerate().skip(from / 64) {
            let bits = (word ^ flip) & mask;
            if bits != 0 {
                let column = i * 64 + bits.trailing_zeros() as usize;
                return (column < self.width).then_some(column);
            }
            mask = u64::MAX;
        }
        None
    }

    /// Whether the texel of this column and row is one.
    pub(crate) fn is_set(&self, x: usize, y: usize) -> bool {
        self.words[y * self.stride + x / 64] >> (x % 64) & 1 != 0
    }

    /// Number of ones.
    pub(crate) fn count(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// Sets texels `from..to` of row `y`; returns whether one was set already.
    pub(crate) fn set_span(&mut self, y: usize, from: usize, to: usize) -> bool {
        let mut met = 0;
        for word in from / 64..to.div_ceil(64) {
            let low = from.saturating_sub(word * 64);
            let high = (to - word * 64).min(64);
            let mask = (u64::MAX >> (64 - (high - low))) << low;
            let bits = &mut self.words[y * self.stride + word];
            met |= *bits & mask;
            *bits |= mask;
        }
        met != 0
    }

    /// Sets every texel whose closed square comes within `tolerance` of the triangle; what lies outside is
    /// clipped.
    pub(crate) fn touch(&mut self, triangle: [DVec2; 3], tolerance: f64) {
        for (y, columns) in touched(triangle, tolerance, self.width, self.height) {
            self.set_span(y, columns.start, columns.end);
        }
    }

    /// Sets every texel whose centre lies inside the triangle by more than a thousandth of a texel along both
    /// axes; returns whether one was set already, that is, whether the triangle overlaps one drawn before.
    pub(crate) fn cover(&mut self, triangle: [DVec2; 3]) -> bool {
        let rows = covered(triangle, self.width, self.height);
        rows.fold(false, |overlaps, (y, columns)| self.set_span(y, columns.start, columns.end) || overlaps)
    }

    /// Number of ones among texels `from..to` of row `y`.
    pub(crate) fn count_span(&self, y: usize, from: usize, to: usize) -> usize {
        let row = &self.words[y * self.stride..][..self.stride];
        let in_word = |word: usize| {
            let low = from.saturating_sub(word * 64);
            let high = (to - word * 64).min(64);
            let mask = (u64::MAX >> (64 - (high - low))) << low;
            (row[word] & mask).count_ones() as usize
        };
        (from / 64..to.div_ceil(64)).map(in_word).sum()
    }
}

/// The rows of a page and their columns, none empty, whose texels' closed squares come within `tolerance` of
/// the triangle.
pub(crate) fn touched(
    triangle: [DVec2; 3],
    tolerance: f64,
    width: usize,
    height: usize,
) -> impl Iterator<Item = (usize, Range<usize>)> {
    let (low, high) = bounds(triangle);
    span(low.y - tolerance, high.y + tolerance, height).filter_map(move |y| {
        // The triangle within the row's band is convex, so the texels it touches are those its x-interval
        // touches.
        let band = (y as f64 - tolerance, (y + 1) as f64 + tolerance);
        let (x0, x1) = x_interval(triangle, band)?;
        let columns = span(x0 - tolerance, x1 + tolerance, width);
        (!columns.is_empty()).then_some((y, columns))
    })
}

/// The rows of a page and their columns, none empty, whose texels' centres lie inside the triangle by more
/// than a thousandth of a texel along both axes.
pub(crate) fn covered(
    triangle: [DVec2; 3],
    width: usize,
    height: usize,
) -> impl Iterator<Item = (usize, Range<usize>)> {
    const INSET: f64 = 1e-3;
    let (low, high) = bounds(triangle);
    span(low.y - 0.5, high.y + 0.5, height).filter_map(move |y| {
        // What is inside just above and just below the row of centres is inside on it.
        let at = |y: f64| x_interval(triangle, (y, y));
        let centre = y as f64 + 0.5;
        let (above, below) = (at(centre - INSET)?, at(centre + INSET)?);
        let from = (above.0.max(below.0) + INSET - 0.5).ceil().max(0.0);
        let to = (above.1.min(below.1) - INSET - 0.5).floor().min(width as f64 - 1.0);
        (from <= to).then_some((y, from as usize..to as usize + 1))
    })
}

/// Corner-wise minimum and maximum.
pub(crate) fn bounds(triangle: [DVec2; 3]) -> (DVec2, DVec2) {
    let [a, b, c] = triangle;
    (a.min(b).min(c), a.max(b).max(c))
}

/// Cells of `0..n` that the closed interval meets.
fn span(low: f64, high: f64, n: usize) -> Range<usize> {
    let from = low.floor().clamp(0.0, n as f64) as usize;
    let to = (high.floor() + 1.0).clamp(0.0, n as f64) as usize;
    from..to.max(from)
}

/// The x-interval of a triangle within a horizontal band.
pub(crate) fn x_interval(triangle: [DVec2; 3], (y0, y1): (f64, f64)) -> Option<(f64, f64)> {
    let mut low = f64::INFINITY;
    let mut high = f64::NEG_INFINITY;
    let mut add = |x: f64| {
        low = low.min(x);
        high = high.max(x);
    };
    for i in 0..3 {
        let (mut a, mut b) = (triangle[i], triangle[(i + 1) % 3]);
        // The corners inside the band, and where each edge crosses its borders; upwards, so that both sides
        // of a shared edge compute the same crossing.
        if (y0..=y1).contains(&a.y) {
            add(a.x);
        }
        if b.y < a.y {
            std::mem::swap(&mut a, &mut b);
        }
        for y in [y0, y1] {
            if a.y < y && y < b.y {
                add(a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)));
            }
        }
    }
    (low <= high).then_some((low, high))
}
