//! How many samples of indirect light a texel gets: in proportion to how much those of the texels around it differ.
//!
//! The first round decides it for all later ones. A texel's own samples have no say in it: were they asked, those that met a rare
//! bright path would be given more and thin it out, the others would be let be, and the mean would be too dark.

use super::errors::{Parts, cell_of};
use super::state::{BlockState, CELLS};
use crate::Rgb;
use crate::surface::BlockSurface;
use crate::trace::lights::Lights;

/// Texels so far to every side are asked.
const REACH: usize = 3;
/// log₂ of the least number of samples, relative to the mean: the dark, which differs little, is to be looked at too.
const LEAST: i32 = -1;
/// log₂ of the greatest.
const MOST: i32 = 4;
/// Classes of deviation per doubling.
const STEPS: i32 = 32;
/// Deviations beyond 2^±this are in the outermost classes.
const OCTAVES: i32 = 32;
/// The outermost class.
const LAST: i32 = STEPS * OCTAVES;

/// How much samples differ around a texel: the logarithm of their standard deviation in steps; `None` where nobody could be asked.
pub type Class = Option<i16>;

/// How many texels are of which class.
#[derive(Clone, Debug)]
pub struct Histogram(Vec<u64>);

impl Default for Histogram {
    /// Of no texels.
    fn default() -> Self {
        Histogram(vec![0; 2 * LAST as usize + 1])
    }
}

impl Histogram {
    /// Adds texels.
    pub fn add(&mut self, classes: impl IntoIterator<Item = Class>) {
        classes.into_iter().flatten().for_each(|class| self.0[(i32::from(class) + LAST) as usize] += 1);
    }

    /// Adds the texels of another.
    pub fn merge(&mut self, other: &Histogram) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, n)| *sum += n);
    }

    /// The class that gets the mean number of samples: the lowest for which no more are drawn than if every texel got as many.
    pub fn pivot(&self) -> i16 {
        let texels: u64 = self.0.iter().sum();
        // In units of the least share.
        let drawn = |pivot: i16| -> u64 {
            let classes = (-LAST..).zip(&self.0).filter(|(_, n)| **n > 0);
            classes.map(|(class, n)| n << (i32::from(log2_share(Some(class as i16), pivot)) - LEAST)).sum()
        };
        let last = LAST as i16;
        (-last..last).find(|&pivot| drawn(pivot) <= texels << -LEAST).unwrap_or(last)
    }
}

/// log₂ of how many times the mean number of samples the texels of a class get.
fn log2_share(class: Class, pivot: i16) -> i8 {
    let Some(class) = class else { return 0 };
    let steps = i32::from(class) - i32::from(pivot);
    (steps + STEPS / 2).div_euclid(STEPS).clamp(LEAST, MOST) as i8
}

/// log₂ of the share of each covered texel, by its class: with the page's pivot, or, where that is none, with its cell's own.
pub fn log2_shares(classes: &[Class], surface: &BlockSurface, pivot: Option<i16>) -> Vec<i8> {
    let cells: Vec<usize> = surface.covered().map(|place| cell_of(surface, place)).collect();
    let pivots: Vec<i16> = match pivot {
        Some(pivot) => vec![pivot; CELLS],
        None => {
            let mut of_cells = vec![Histogram::default(); CELLS];
            cells.iter().zip(classes).for_each(|(&cell, &class)| of_cells[cell].add([class]));
            of_cells.iter().map(Histogram::pivot).collect()
        }
    };
    classes.iter().zip(cells).map(|(&class, cell)| log2_share(class, pivots[cell])).collect()
}

/// So many samples, or what a share makes of them.
pub fn shared(samples: u32, log2_share: i8) -> u32 {
    /// Doublings stop here.
    const MOST: u64 = 1 << 30;
    let samples = u64::from(samples);
    let samples = if log2_share < 0 { samples >> -log2_share } else { samples << log2_share };
    samples.clamp(1, MOST) as u32
}

/// The sets with light that differ, each with its mean over the page: of equal ones (as by night), one.
pub fn distinct<'a>(sets: &'a [Parts], means: &[f64]) -> Vec<(&'a Parts, f64)> {
    let is_new = |set: &usize| means[*set] > 0.0 && !sets[..*set].contains(&sets[*set]);
    (0..sets.len()).filter(is_new).map(|set| (&sets[set], means[set])).collect()
}

/// The classes of the covered texels of a block after its first round. Deviations are those of the sets' light, each in units of its
/// mean, summed in squares over the sets.
pub fn classes(
    sets: &[(&Parts, f64)],
    lights: &Lights,
    surface: &BlockSurface,
    state: &BlockState,
) -> Vec<Class> {
    let layers = lights.layers();
    let mut difference = vec![Rgb::ZERO; layers];
    // Per place in the block.
    let mut squares = vec![None; surface.width * surface.height];
    for (texel, place) in surface.covered().enumerate() {
        let taken = state.taken[texel];
        if !state.is_exposed(texel) || taken.contains(&0) {
            continue;
        }
        let [a, b] = [0, 1].map(|half| &state.sums[(2 * texel + half) * layers..][..layers]);
        let [a_scale, b_scale] = taken.map(|n| 1.0 / n as f32);
        difference.iter_mut().zip(a.iter().zip(b)).for_each(|(d, (a, b))| *d = *a * a_scale - *b * b_scale);
        let square = |(parts, mean): &(&Parts, f64)| {
            let of_set = parts.iter().map(|&(layer, scale)| difference[layer] * scale).sum::<Rgb>();
            (of_set.as_dvec3() / *mean).length_squared()
        };
        squares[place] = Some(sets.iter().map(square).sum());
    }
    surface.covered().map(|place| mean_around(&squares, surface.width, place).map(class_of)).collect()
}

/// The mean over the places about one, without itself and without the greatest: one bright path is luck, two are a place.
fn mean_around(squares: &[Option<f64>], width: usize, place: usize) -> Option<f64> {
    let (x, y) = (place % width, place / width);
    let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(width);
    let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(squares.len() / width);
    let places = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
    let known = places.filter(|&p| p != place).filter_map(|p| squares[p]);
    let (mut sum, mut n, mut greatest) = (0.0, 0.0, 0.0);
    for square in known {
        sum += f64::min(square, greatest);
        greatest = f64::max(square, greatest);
        n += 1.0;
    }
    (n > 1.0).then(|| sum / (n - 1.0))
}

/// The class of a squared deviation.
fn class_of(square: f64) -> i16 {
    let last = f64::from(LAST);
    (square.log2() * 0.5 * f64::from(STEPS)).round().clamp(-last, last) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn histogram(classes: &[(i16, u64)]) -> Histogram {
        let mut histogram = Histogram::default();
        classes.iter().for_each(|&(class, n)| histogram.add((0..n).map(|_| Some(class))));
        histogram
    }

    #[test]
    fn where_all_differ_alike_all_get_the_same() {
        for class in [-1024, -31, 0, 7, 1024] {
            let pivot = histogram(&[(class, 10)]).pivot();
            assert_eq!(log2_share(Some(class), pivot), 0, "{class}");
        }
        assert_eq!(log2_share(None, 100), 0);
        assert_eq!(log2_share(Some(12), Histogram::default().pivot()), MOST as i8);
    }

    #[test]
    fn samples_follow_the_deviation_and_are_no_more_than_asked_for() {
        // Half of the texels deviate four times as much as the other half.
        let pivot = histogram(&[(0, 100), (64, 100)]).pivot();
        assert_eq!([0, 64].map(|class| log2_share(Some(class), pivot)), [-1, 0]);
        // One in a hundred 2^10 times as much.
        let pivot = histogram(&[(0, 990), (320, 10)]).pivot();
        assert_eq!([0, 320].map(|class| log2_share(Some(class), pivot)), [-1, 4]);
        // Any mixture at all: what is drawn is at most the mean, and more than half of it.
        for seed in 1..50u64 {
            let classes: Vec<(i16, u64)> =
                (0..9).map(|i| ((seed * (i * i + 3) % 397) as i16 - 198, 1 + seed * (i + 1) % 13)).collect();
            let pivot = histogram(&classes).pivot();
            let drawn = classes.iter().map(|&(c, n)| n as f64 * f64::from(log2_share(Some(c), pivot)).exp2());
            let (drawn, all): (f64, f64) = (drawn.sum(), classes.iter().map(|c| c.1 as f64).sum());
            assert!(drawn <= all && drawn > 0.5 * all, "{seed}: {drawn} of {all}");
        }
    }

    #[test]
    fn shares_double_and_halve() {
        assert_eq!([-1, 0, 1, 4].map(|share| shared(8, share)), [4, 8, 16, 128]);
        assert_eq!(shared(1, -1), 1);
        assert_eq!(shared(u32::MAX, 4), 1 << 30);
    }

    #[test]
    fn a_texel_has_no_say_in_its_own_number() {
        // Every place of a block of 9 × 9 in turn; of one nothing is known.
        let mut squares = vec![Some(2.0); 81];
        squares[3] = None;
        for place in 0..81 {
            let before = squares[place].replace(1e9);
            assert_eq!(mean_around(&squares, 9, place), Some(2.0));
            squares[place] = before;
        }
        assert_eq!(mean_around(&[Some(1.0), Some(1.0), None], 3, 1), None);
    }

    #[test]
    fn one_bright_path_does_not_count_and_two_do() {
        let mut squares = vec![Some(0.0); 81];
        squares[40] = Some(46.0);
        assert_eq!(mean_around(&squares, 9, 31), Some(0.0));
        squares[41] = Some(69.0);
        // 5 × 5 places that the border leaves, without itself and without the greatest.
        assert_eq!(mean_around(&squares, 9, 10), Some(0.0));
        assert_eq!(mean_around(&squares, 9, 11), Some(46.0 / 28.0));
        // Out of reach.
        assert_eq!(mean_around(&squares, 9, 4), Some(0.0));
    }

    #[test]
    fn equal_sets_count_once_and_dark_ones_not() {
        let sets: Vec<Parts> = [0, 1, 0, 2].map(|layer| vec![(layer, Rgb::ONE)]).into();
        let distinct: Vec<usize> =
            distinct(&sets, &[1.0, 0.0, 1.0, 3.0]).iter().map(|(set, _)| set[0].0).collect();
        assert_eq!(distinct, [0, 2]);
    }

    #[test]
    fn classes_are_parts_of_octaves_of_the_deviation() {
        assert_eq!([1.0, 4.0, 0.25, 0.0, f64::MAX].map(class_of), [0, 32, -32, -1024, 1024]);
        assert_eq!([2.0, f64::INFINITY].map(class_of), [16, 1024]);
    }
}
