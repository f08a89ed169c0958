//! Counts of values by their size, from which quantiles are read: memory does not grow with the values, and
//! histograms of parts add up to that of the whole, in any order.

/// Bins of an octave, as a power of two: a bin is 1.6 % wide at most, and its middle is within 0.8 % of it.
const BITS: u32 = 6;
/// Octaves, from 2⁻²⁰ on: 10⁻⁶ to 4096.
const FIRST_EXPONENT: i32 = -20;
const OCTAVES: usize = 32;
/// Bits of an f64 that tell a bin.
const SHIFT: u32 = 52 - BITS;
/// Those of the least value that has a bin of its own.
const FIRST: u64 = ((1023 + FIRST_EXPONENT) as u64) << BITS;
/// With one for what is less, and one for what is more.
const BINS: usize = (OCTAVES << BITS) + 2;

/// Counts of values from 0 on.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    bins: Vec<u64>,
    count: u64,
    /// Of the counted values.
    least: f64,
    largest: f64,
}

/// Values that this share of all does not exceed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quantiles {
    /// Half.
    pub median: f64,
    /// 95 %.
    pub p95: f64,
    /// 99 %.
    pub p99: f64,
}

impl Default for Histogram {
    fn default() -> Self {
        Histogram { bins: vec![0; BINS], count: 0, least: f64::INFINITY, largest: 0.0 }
    }
}

impl Histogram {
    /// Counts a value, which is 0 or more. What is not a number counts as infinite.
    pub fn add(&mut self, value: f64) {
        let value = if value.is_nan() { f64::INFINITY } else { value };
        self.bins[bin(value)] += 1;
        self.count += 1;
        self.least = self.least.min(value);
        self.largest = self.largest.max(value);
    }

    /// Adds the counts of another.
    pub fn merge(&mut self, other: &Histogram) {
        self.bins.iter_mut().zip(&other.bins).for_each(|(bin, other)| *bin += other);
        self.count += other.count;
        self.least = self.least.min(other.least);
        self.largest = self.largest.max(other.largest);
    }

    /// Number of counted values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The least value that at least this share (0 to 1) of all does not exceed, within 0.8 %; exact where
    /// all are equal. Below 10⁻⁶ it is the least of all values, above 4096 the largest. `None` without
    /// values.
    pub fn quantile(&self, share: f64) -> Option<f64> {
        let wanted = ((share * self.count as f64).ceil() as u64).max(1);
        let mut below = 0;
        let found = self.bins.iter().position(|bin| {
            below += bin;
            below >= wanted
        })?;
        Some(middle(found).clamp(self.least, self.largest))
    }

    /// Median, 95 % and 99 %; `None` without values.
    pub fn quantiles(&self) -> Option<Quantiles> {
        let [median, p95, p99] = [0.5, 0.95, 0.99].map(|share| self.quantile(share));
        Some(Quantiles { median: median?, p95: p95?, p99: p99? })
    }
}

/// The bin of a value. Exponent and first bits of the fraction, no logarithm: the same on all machines.
fn bin(value: f64) -> usize {
    let steps = (value.to_bits() >> SHIFT).saturating_sub(FIRST - 1);
    usize::try_from(steps).map_or(BINS - 1, |steps| steps.min(BINS - 1))
}

/// The middle of a bin.
fn middle(bin: usize) -> f64 {
    match bin {
        0 => 0.0,
        _ if bin == BINS - 1 => f64::INFINITY,
        _ => f64::from_bits(((FIRST + bin as u64 - 1) << SHIFT) | (1 << (SHIFT - 1))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values spread over seven decades, in no order.
    fn values(n: u64) -> Vec<f64> {
        let random = |i: u64| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) as f64 / (1u64 << 53) as f64;
        (0..n).map(|i| 10f64.powf(7.0 * random(i + 1) - 5.0)).collect()
    }

    fn of(values: &[f64]) -> Histogram {
        let mut histogram = Histogram::default();
        values.iter().for_each(|&value| histogram.add(value));
        histogram
    }

    #[test]
    fn quantiles_are_those_of_sorted_values_within_their_bin() {
        for n in [1, 2, 3, 99, 100, 10_000] {
            let mut sorted = values(n);
            let histogram = of(&sorted);
            sorted.sort_by(f64::total_cmp);
            for share in [0.01, 0.5, 0.95, 0.99, 1.0] {
                let exact = sorted[((share * n as f64).ceil() as usize).max(1) - 1];
                let found = histogram.quantile(share).unwrap();
                assert!((found / exact - 1.0).abs() < 0.008, "{n} values, {share}: {found}, {exact}");
            }
        }
        assert_eq!(Histogram::default().quantiles(), None);
    }

    #[test]
    fn equal_values_are_exact_and_so_are_the_ends() {
        for value in [0.0, 1e-9, 0.1, 1.0, 4095.9, 1e9, f64::INFINITY] {
            let all = of(&[value; 7]).quantiles();
            assert_eq!(all, Some(Quantiles { median: value, p95: value, p99: value }));
        }
        assert_eq!(of(&[f64::NAN]).quantile(0.5), Some(f64::INFINITY));
        // Every bin is narrow, and its middle lies in it.
        for i in 1..BINS - 1 {
            assert_eq!(bin(middle(i)), i);
        }
        assert_eq!([0.0, 9e-7, 1e-6, 4096.0].map(bin), [0, 0, 4, BINS - 1]);
    }

    #[test]
    fn parts_add_up_in_any_order() {
        let values = values(1000);
        let whole = of(&values);
        let parts: Vec<Histogram> = values.chunks(77).map(of).collect();
        let (mut forwards, mut backwards) = (Histogram::default(), Histogram::default());
        parts.iter().for_each(|part| forwards.merge(part));
        parts.iter().rev().for_each(|part| backwards.merge(part));
        assert_eq!((&forwards, &backwards, whole.count()), (&whole, &whole, 1000));
    }
}
