//! The free blocks of a page while it is being packed, as sorted gaps per row.

use super::footprint::Footprint;
use std::ops::Range;

/// The blocks that nothing owns yet.
#[derive(Clone)]
pub(super) struct Page {
    /// Per row, its free intervals `from..to`, ascending.
    free: Vec<Vec<(usize, usize)>>,
    /// Per row, the length of its longest free interval.
    longest: Vec<usize>,
    used: usize,
    /// Column offsets still possible in the row under test, as closed intervals, and room for the next ones.
    columns: Vec<(usize, usize)>,
    narrowed: Vec<(usize, usize)>,
}

impl Page {
    /// All free.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let free = vec![vec![(0, width)]; height];
        Page { free, longest: vec![width; height], used: 0, columns: Vec::new(), narrowed: Vec::new() }
    }

    /// Rows down to the lowest owned block.
    pub(super) fn used(&self) -> usize {
        self.used
    }

    /// Free blocks in a window.
    pub(super) fn free(&self, columns: &Range<usize>, rows: Range<usize>) -> usize {
        let inside = |gap: &(usize, usize)| gap.1.min(columns.end).saturating_sub(gap.0.max(columns.start));
        self.free[rows].iter().flatten().map(inside).sum()
    }

    /// The first row from `from` to `limit` with a place for the footprint that starts in one of the columns,
    /// and the leftmost column there; if there is none, the first row not searched.
    pub(super) fn find(
        &mut self,
        footprint: &Footprint,
        columns: &Range<usize>,
        from: usize,
        limit: usize,
    ) -> (usize, Option<usize>) {
        let mut y = from;
        while y <= limit {
            if let Some(x) = self.first_column(footprint, columns, y) {
                return (y, Some(x));
            }
            y += 1;
        }
        (y, None)
    }

    /// The first of the columns at which the footprint, starting in row `y`, meets only free blocks.
    fn first_column(&mut self, footprint: &Footprint, columns: &Range<usize>, y: usize) -> Option<usize> {
        let last = footprint.last.0.min(columns.end.checked_sub(1)?);
        if columns.start > last {
            return None;
        }
        self.columns.clear();
        self.columns.push((columns.start, last));
        for run in &footprint.runs {
            let row = y + run.row;
            if self.longest[row] < run.length {
                return None;
            }
            // Columns at which this run lies in a gap: those from `gap.0 − start` to
            // `gap.1 − start − length`.
            let gaps = &self.free[row];
            self.narrowed.clear();
            for &(low, high) in &self.columns {
                let first = gaps.partition_point(|gap| gap.1 < low + run.start + run.length);
                for gap in gaps[first..].iter().take_while(|gap| gap.0 <= high + run.start) {
                    if gap.1 - gap.0 >= run.length && gap.1 >= run.start + run.length {
                        let from = low.max(gap.0.saturating_sub(run.start));
                        let to = high.min(gap.1 - run.start - run.length);
                        if from <= to {
                            self.narrowed.push((from, to));
                        }
                    }
                }
            }
            std::mem::swap(&mut self.columns, &mut self.narrowed);
            if self.columns.is_empty() {
                return None;
            }
        }
        self.columns.first().map(|c| c.0)
    }

    /// Takes the footprint's blocks at column `x`, row `y`.
    pub(super) fn take(&mut self, footprint: &Footprint, x: usize, y: usize) {
        for run in &footprint.runs {
            cut(&mut self.free[y + run.row], x + run.start, x + run.start + run.length);
        }
        let bottom = y + footprint.bits.height;
        for row in y..bottom {
            self.longest[row] = self.free[row].iter().map(|gap| gap.1 - gap.0).max().unwrap_or(0);
        }
        self.used = self.used.max(bottom);
    }
}

/// Removes `from..to` from sorted, disjoint gaps.
fn cut(gaps: &mut Vec<(usize, usize)>, from: usize, to: usize) {
    // The gaps that meet the interval, and what is left of the first and the last one.
    let first = gaps.partition_point(|gap| gap.1 <= from);
    let last = first + gaps[first..].partition_point(|gap| gap.0 < to);
    if first == last {
        return;
    }
    let left = (gaps[first].0, from);
    let right = (to, gaps[last - 1].1);
    let rest = [left, right];
    gaps.splice(first..last, rest.into_iter().filter(|gap| gap.0 < gap.1));
}
