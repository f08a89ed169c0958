//! How many samples of indirect light a texel gets: in proportion to how much the samples of the texels
//! around it differ, relative to the local light ([`crate::bake::errors::local_light`]) or, without a cache,
//! to the page's.
//!
//! The first round decides it for all later ones. A texel's own samples have no say in it: were they asked,
//! those that met a rare bright path would be given other numbers than those that did not, and the mean would
//! be wrong. (By the pivot it has a say of the order of one in all texels: so few of them have none.)

use crate::Rgb;
use crate::bake::store::{BlockState, CELLS, Parts, cell_of};
use crate::receivers::ReceiverBlock;
use crate::trace::sources::Lights;

/// Texels so far to every side are asked. (Three find more of what is local, 5 % of the squared error in the
/// yard and the room; but where bright paths are rare and nothing is local, chance then decides: 1.8 times
/// the squared error of even samples, with six 1.3.)
const NEIGHBOUR_REACH: usize = 6;
/// log₂ of the least share of samples, relative to the mean: what differs little is sampled too.
const LEAST_LOG2_SHARE: i32 = -1;
/// log₂ of the greatest.
const MOST_LOG2_SHARE: i32 = 4;
/// Classes of deviation per doubling.
const STEPS_PER_OCTAVE: i32 = 32;
/// Deviations beyond 2^±this are in the outermost classes.
const OCTAVES: i32 = 32;
/// The outermost class.
const LAST_CLASS: i32 = STEPS_PER_OCTAVE * OCTAVES;

/// How much samples differ around a texel: the logarithm of their standard deviation in steps; `None` where
/// nobody could be asked, or nothing differed: there the next path may be the first.
pub(crate) type Class = Option<i16>;

/// How many texels are of which class.
#[derive(Clone, Debug)]
pub(crate) struct Histogram(Vec<u64>);

impl Default for Histogram {
    /// Of no texels.
    fn default() -> Self {
        Histogram(vec![0; 2 * LAST_CLASS as usize + 1])
    }
}

impl Histogram {
    /// Adds texels.
    pub(crate) fn add(&mut self, classes: impl IntoIterator<Item = Class>) {
        classes.into_iter().flatten().for_each(|class| self.0[(i32::from(class) + LAST_CLASS) as usize] += 1);
    }

    /// Adds the texels of another.
    pub(crate) fn merge(&mut self, other: &Histogram) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, n)| *sum += n);
    }

    /// The class that gets the mean number of samples: the lowest for which no more are drawn than if every
    /// texel got as many. `None` where texels are so few that each would decide by it how many it gets
    /// itself.
    pub(crate) fn pivot(&self) -> Option<i16> {
        /// Texels from which on there is one.
        const ENOUGH: u64 = 64;
        let classes: Vec<(i16, u64)> = (-LAST_CLASS..)
            .zip(&self.0)
            .filter(|(_, n)| **n > 0)
            .map(|(class, &n)| (class as i16, n))
            .collect();
        let texels: u64 = self.0.iter().sum();
        // In units of the least share. The higher the pivot, the fewer.
        let drawn = |pivot: i16| -> u64 {
            classes
                .iter()
                .map(|&(class, n)| n << (i32::from(log2_share(Some(class), Some(pivot))) - LEAST_LOG2_SHARE))
                .sum()
        };
        let (mut low, mut high) = (-LAST_CLASS as i16, LAST_CLASS as i16);
        while low < high {
            let middle = (low + high).div_euclid(2);
            match drawn(middle) <= texels << -LEAST_LOG2_SHARE {
                true => high = middle,
                false => low = middle + 1,
            }
        }
        (texels >= ENOUGH).then_some(high)
    }
}

/// Whose mean is the mean number of samples.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Pivot {
    /// The page's, with its pivot.
    OfPage(Option<i16>),
    /// Every cell's, which finds its own: towards a target each stops by itself.
    OfCell,
}

/// log₂ of how many times the mean number of samples the texels of a class get.
fn log2_share(class: Class, pivot: Option<i16>) -> i8 {
    let (Some(class), Some(pivot)) = (class, pivot) else { return 0 };
    let steps = i32::from(class) - i32::from(pivot);
    (steps + STEPS_PER_OCTAVE / 2).div_euclid(STEPS_PER_OCTAVE).clamp(LEAST_LOG2_SHARE, MOST_LOG2_SHARE) as i8
}

/// log₂ of the share of each covered texel, by its class.
pub(crate) fn log2_shares(classes: &[Class], receivers: &ReceiverBlock, pivot: Pivot) -> Vec<i8> {
    let cells: Vec<usize> = receivers.covered().map(|in_block| cell_of(receivers, in_block)).collect();
    let pivots: Vec<Option<i16>> = match pivot {
        Pivot::OfPage(pivot) => vec![pivot; CELLS],
        Pivot::OfCell => {
            let mut of_cells = vec![Histogram::default(); CELLS];
            cells.iter().zip(classes).for_each(|(&cell, &class)| of_cells[cell].add([class]));
            of_cells.iter().map(Histogram::pivot).collect()
        }
    };
    classes.iter().zip(cells).map(|(&class, cell)| log2_share(class, pivots[cell])).collect()
}

/// So many samples, or what a share makes of them.
pub(crate) fn shared(samples: u32, log2_share: i8) -> u32 {
    /// More of them are too many for sums in single precision.
    const MOST_SAMPLES: u32 = 1 << 19;
    let many = match log2_share {
        ..0 => u64::from(samples >> -log2_share),
        _ => u64::from(samples) << log2_share,
    };
    many.clamp(1, u64::from(samples.max(MOST_SAMPLES))) as u32
}

/// The frames that differ: of equal ones (as by night), the first.
pub(crate) fn distinct(frames: &[Parts]) -> Vec<usize> {
    (0..frames.len()).filter(|&frame| !frames[..frame].contains(&frames[frame])).collect()
}

/// The classes of the covered texels of a block after its first round. A deviation is the root of the sum
/// over the frames of (difference of the half-buffers ÷ `unit`)². `unit(place, texel)` is the light in klx,
/// above 0, that errors of `frames[place]` are relative to at a covered texel.
pub(crate) fn classes(
    frames: &[&Parts],
    unit: impl Fn(usize, usize) -> f64,
    lights: &Lights,
    receivers: &ReceiverBlock,
    state: &BlockState,
) -> Vec<Class> {
    let layers = lights.layers();
    let mut difference = vec![Rgb::ZERO; layers];
    // Per texel of the block.
    let mut squares = vec![None; receivers.width * receivers.height];
    for (texel, in_block) in receivers.covered().enumerate() {
        let taken = state.taken[texel];
        if !state.is_usable(texel) || taken.contains(&0) {
            continue;
        }
        let [a, b] = [0, 1].map(|half| &state.sums[(2 * texel + half) * layers..][..layers]);
        let [a_scale, b_scale] = taken.map(|n| 1.0 / n as f32);
        difference.iter_mut().zip(a.iter().zip(b)).for_each(|(d, (a, b))| *d = *a * a_scale - *b * b_scale);
        let square = |(place, parts): (usize, &&Parts)| {
            let of_frame = parts.iter().map(|&(layer, scale)| difference[layer] * scale).sum::<Rgb>();
            (of_frame.as_dvec3() / unit(place, texel)).length_squared()
        };
        squares[in_block] = Some(frames.iter().enumerate().map(square).sum());
    }
    // (What is no usable surface does not count in any frame.)
    let class = |in_block: usize| {
        squares[in_block].and_then(|_| class_of(mean_around(&squares, receivers.width, in_block)?))
    };
    receivers.covered().map(class).collect()
}

/// The mean over the texels about one, without itself and without the greatest: one bright path is luck, two
/// are a place.
fn mean_around(squares: &[Option<f64>], width: usize, in_block: usize) -> Option<f64> {
    let (x, y) = (in_block % width, in_block / width);
    let columns = x.saturating_sub(NEIGHBOUR_REACH)..(x + NEIGHBOUR_REACH + 1).min(width);
    let rows = y.saturating_sub(NEIGHBOUR_REACH)..(y + NEIGHBOUR_REACH + 1).min(squares.len() / width);
    let around = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
    let known = around.filter(|&p| p != in_block).filter_map(|p| squares[p]);
    let (mut sum, mut n, mut greatest) = (0.0, 0.0, 0.0);
    for square in known {
        sum += f64::min(square, greatest);
        greatest = f64::max(square, greatest);
        n += 1.0;
    }
    (n > 1.0).then(|| sum / (n - 1.0))
}

/// The class of a squared deviation.
fn class_of(square: f64) -> Class {
    let last = f64::from(LAST_CLASS);
    (square > 0.0)
        .then(|| (square.log2() * 0.5 * f64::from(STEPS_PER_OCTAVE)).round().clamp(-last, last) as i16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::paths::{Sequence, SequenceKind};

    fn histogram(classes: &[(i16, u64)]) -> Histogram {
        let mut histogram = Histogram::default();
        classes.iter().for_each(|&(class, n)| histogram.add((0..n).map(|_| Some(class))));
        histogram
    }

    #[test]
    fn where_all_differ_alike_all_get_the_same() {
        for class in [-1024, -31, 0, 7, 1024] {
            let pivot = histogram(&[(class, 100)]).pivot();
            assert_eq!(log2_share(Some(class), pivot), 0, "{class}");
        }
        assert_eq!(log2_share(None, Some(100)), 0);
        assert_eq!(histogram(&[(0, 40), (300, 23)]).pivot(), None);
        assert_eq!(log2_share(Some(300), None), 0);
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
                (0..9).map(|i| ((seed * (i * i + 3) % 397) as i16 - 198, 20 + seed * (i + 1) % 13)).collect();
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
        assert_eq!([1 << 18, 1 << 20].map(|samples| shared(samples, 4)), [1 << 19, 1 << 20]);
    }

    #[test]
    fn a_texel_has_no_say_in_its_own_number() {
        // Every texel of a block of 9 × 9 in turn; of one nothing is known.
        let mut squares = vec![Some(2.0); 81];
        squares[3] = None;
        for texel in 0..81 {
            // Another texel's is the greatest, which is left out.
            let other = if texel % 9 > 0 { texel - 1 } else { texel + 1 };
            let before = [texel, other].map(|p| squares[p]);
            (squares[texel], squares[other]) = (Some(1e9), Some(1e12));
            assert_eq!(mean_around(&squares, 9, texel), Some(2.0));
            [squares[texel], squares[other]] = before;
        }
        assert_eq!(mean_around(&[Some(1.0), Some(1.0), None], 3, 1), None);
    }

    #[test]
    fn one_bright_path_does_not_count_and_two_do() {
        // A block of 17 × 17, one at its middle and one to the right of that.
        let at = |x: usize, y: usize| 17 * y + x;
        let mut squares = vec![Some(0.0); 17 * 17];
        squares[at(8, 8)] = Some(44.0);
        assert_eq!(mean_around(&squares, 17, at(7, 7)), Some(0.0));
        squares[at(9, 8)] = Some(69.0);
        // What is reached of the first alone, and of both: 10 × 9 places without the texel itself and without
        // the greatest.
        assert_eq!(mean_around(&squares, 17, at(2, 2)), Some(0.0));
        assert_eq!(mean_around(&squares, 17, at(3, 2)), Some(44.0 / 88.0));
        // Neither.
        assert_eq!(mean_around(&squares, 17, at(4, 1)), Some(0.0));
    }

    #[test]
    fn equal_frames_count_once() {
        let frames: Vec<Parts> = [0, 1, 0, 2].map(|layer| vec![(layer, Rgb::ONE)]).into();
        assert_eq!(distinct(&frames), [0, 1, 3]);
    }

    #[test]
    fn classes_are_parts_of_octaves_of_the_deviation() {
        let classes = [1.0, 2.0, 4.0, 0.25, 1e-300, f64::MAX, f64::INFINITY].map(class_of);
        assert_eq!(classes, [0, 16, 32, -32, -1024, 1024, 1024].map(Some));
        assert_eq!([0.0, f64::NAN].map(class_of), [None, None]);
    }

    /// The mean, and the covariance of two halves, over pages of 16 × 16 texels of light 1 that comes by
    /// paths of one in `rare`, where every texel draws four samples a half, and is then brought to eight
    /// times as many, times its share; `counts`: the mean of which squares decides.
    fn simulated(rare: u32, counts: impl Fn(&[Option<f64>], usize) -> Option<f64>) -> (f64, f64) {
        const PAGES: u32 = 600;
        let draw = |texel: u32, half: u32, from: u32, to: u32| -> f64 {
            // A sequence a sample: independent ones.
            let sequence = |i: u32| Sequence::new(u64::from(i), SequenceKind::Texel, texel, half);
            let hit = |i: u32| sequence(i).sample(0).number(0) * rare as f32 <= 1.0;
            (from..to).filter(|&i| hit(i)).count() as f64 * f64::from(rare)
        };
        let (mut mean, mut covariance) = (0.0, 0.0);
        for page in 0..PAGES {
            let first: Vec<[f64; 2]> =
                (0..256).map(|t| [0, 1].map(|half| draw(256 * page + t, half, 0, 4))).collect();
            let squares: Vec<Option<f64>> =
                first.iter().map(|[a, b]| Some(((a - b) / 4.0).powi(2))).collect();
            let classes: Vec<Class> =
                (0..256).map(|texel| counts(&squares, texel).and_then(class_of)).collect();
            let mut histogram = Histogram::default();
            histogram.add(classes.iter().copied());
            let pivot = histogram.pivot();
            for (texel, class) in classes.iter().enumerate() {
                let samples = shared(32, log2_share(*class, pivot));
                let [a, b] = [0, 1].map(|half| {
                    let more = draw(256 * page + texel as u32, half as u32, 4, samples);
                    (first[texel][half] + more) / f64::from(samples)
                });
                mean += (a + b) / 2.0;
                covariance += (a - 1.0) * (b - 1.0);
            }
        }
        let texels = f64::from(256 * PAGES);
        (mean / texels, covariance / texels)
    }

    #[test]
    fn rare_bright_paths_keep_their_light() {
        // 153,600 texels of relative variance 10 ÷ 64 or a little more: the mean is known to 0.001, at 30 to
        // 0.002.
        for rare in [10, 30] {
            let (mean, covariance) = simulated(rare, |squares, texel| mean_around(squares, 16, texel));
            assert!((mean - 1.0).abs() < 0.008 && covariance.abs() < 0.01, "{rare}: {mean} {covariance}");
        }
        // Who asks the texel itself gets the mean wrong.
        let (mean, _) = simulated(10, |squares, texel| squares[texel]);
        assert!((mean - 1.0).abs() > 0.012, "{mean}");
    }
}
