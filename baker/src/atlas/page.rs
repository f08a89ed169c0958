//! The free texels of a page while it is being packed, as sorted gaps per row.

use super::footprint::{BLOCK, Footprint};

/// The texels further charts may touch.
#[derive(Clone)]
pub struct Page {
    width: usize,
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
    pub fn new(width: usize, height: usize) -> Self {
        let free = vec![vec![(0, width)]; height];
        Page { width, free, longest: vec![width; height], used: 0, columns: Vec::new(), narrowed: Vec::new() }
    }

    /// Rows down to half a texel past the lowest chart.
    pub fn used(&self) -> usize {
        self.used
    }

    /// The first row from `from` to `limit` with a place for the footprint, and the leftmost column there; if there is none,
    /// the first row not searched.
    pub fn find(&mut self, footprint: &Footprint, from: usize, limit: usize) -> (usize, Option<usize>) {
        let mut y = from;
        while y <= limit {
            if let Some(x) = self.first_column(footprint, y) {
                return (y, Some(x));
            }
            y += BLOCK;
        }
        (y, None)
    }

    /// The first column on the block grid at which the footprint, starting in row `y`, meets only free texels.
    fn first_column(&mut self, footprint: &Footprint, y: usize) -> Option<usize> {
        self.columns.clear();
        self.columns.push((0, footprint.last.0));
        for run in &footprint.runs {
            let row = y + run.row;
            if self.longest[row] < run.length {
                return None;
            }
            // Columns at which this run lies in a gap: those from `gap.0 − start` to `gap.1 − start − length`.
            let gaps = &self.free[row];
            self.narrowed.clear();
            for &(low, high) in &self.columns {
                let first = gaps.partition_point(|gap| gap.1 < low + run.start + run.length);
                for gap in gaps[first..].iter().take_while(|gap| gap.0 <= high + run.start) {
                    if gap.1 - gap.0 >= run.length && gap.1 >= run.start + run.length {
                        let from = low.max(gap.0.saturating_sub(run.start)).next_multiple_of(BLOCK);
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

    /// Takes the footprint's texels at column `x`, row `y` and all within `padding` of them.
    pub fn take(&mut self, footprint: &Footprint, x: usize, y: usize, padding: usize) {
        for run in &footprint.runs {
            let from = (x + run.start).saturating_sub(padding);
            let to = (x + run.start + run.length + padding).min(self.width);
            let row = y + run.row;
            for row in row.saturating_sub(padding)..(row + padding + 1).min(self.free.len()) {
                cut(&mut self.free[row], from, to);
            }
        }
        let height = footprint.runs.iter().map(|run| run.row + 1).max().unwrap_or(0);
        for row in y.saturating_sub(padding)..(y + height + padding).min(self.free.len()) {
            self.longest[row] = self.free[row].iter().map(|gap| gap.1 - gap.0).max().unwrap_or(0);
        }
        self.used = self.used.max(y + footprint.rows.max(height));
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
