//! Rate allocation: chooses one trial fit per tile so that all tiles gain equally from their last bits.

use crate::train::TrialFit;

/// The target of all tiles together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Goal {
    Bytes(u64),
    /// At most this sum of the trial fits' errors.
    Error(f64),
}

/// A tile's step to the next larger trial fit on its lower convex hull.
struct Step {
    tile: usize,
    to: usize,
    bytes: u64,
    gain: f64,
}

/// Chooses a trial fit for every tile that has any: starting from the smallest, the step with the largest
/// gain per byte comes next, until the error is reached or no step fits the bytes. If even the smallest
/// exceed the bytes, they are chosen.
pub(super) fn choose(tiles: &[Vec<TrialFit>], goal: Goal) -> Vec<Option<usize>> {
    let hulls: Vec<Vec<usize>> = tiles.iter().map(|trials| hull(trials)).collect();
    let mut chosen: Vec<Option<usize>> = hulls.iter().map(|hull| hull.first().copied()).collect();
    let first = || tiles.iter().zip(&chosen).filter_map(|(trials, at)| at.map(|at| &trials[at]));
    let (mut bytes, mut error) =
        (first().map(|t| t.bytes).sum::<u64>(), first().map(|t| t.error).sum::<f64>());
    let mut steps: Vec<Step> = Vec::new();
    for (tile, (trials, hull)) in tiles.iter().zip(&hulls).enumerate() {
        steps.extend(hull.windows(2).map(|w| {
            let (from, to) = (&trials[w[0]], &trials[w[1]]);
            Step { tile, to: w[1], bytes: to.bytes - from.bytes, gain: from.error - to.error }
        }));
    }
    // Along a hull gains per byte fall, and the sort is stable: a tile's steps stay in order.
    steps.sort_by(|a, b| (b.gain / b.bytes as f64).total_cmp(&(a.gain / a.bytes as f64)));
    let mut closed = vec![false; tiles.len()];
    for step in steps {
        let fits = match goal {
            Goal::Bytes(most) => bytes + step.bytes <= most,
            Goal::Error(most) => error > most,
        };
        if !fits || closed[step.tile] {
            closed[step.tile] = true;
            continue;
        }
        chosen[step.tile] = Some(step.to);
        bytes += step.bytes;
        error -= step.gain;
    }
    chosen
}

/// The trial fits on the lower convex hull of error over bytes, cheapest first; those that are not better
/// than a cheaper one are not on it.
fn hull(trials: &[TrialFit]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..trials.len()).collect();
    let of = |i: usize| (trials[i].bytes as f64, trials[i].error);
    order.sort_by(|&a, &b| of(a).0.total_cmp(&of(b).0).then(of(a).1.total_cmp(&of(b).1)));
    let mut hull: Vec<usize> = Vec::new();
    for i in order {
        let (x, y) = of(i);
        if hull.last().is_some_and(|&last| of(last).1 <= y) {
            continue;
        }
        // The last one lies above the line from the one before it to this one.
        while let [.., a, b] = hull[..]
            && (of(b).1 - of(a).1) * (x - of(a).0) >= (y - of(a).1) * (of(b).0 - of(a).0)
        {
            hull.pop();
        }
        hull.push(i);
    }
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(points: &[(u64, f64)]) -> Vec<TrialFit> {
        points.iter().map(|&(bytes, error)| TrialFit { word: 0, bytes, error, terms: 1 }).collect()
    }

    /// Easy at once; hard; nothing to store; a dear trial that is worse than a cheap one.
    fn tiles() -> Vec<Vec<TrialFit>> {
        vec![
            tile(&[(10, 1.0), (30, 0.5), (100, 0.4)]),
            tile(&[(100, 20.0), (10, 90.0), (50, 60.0), (200, 5.0)]),
            vec![],
            tile(&[(10, 3.0), (40, 3.5), (30, 2.9)]),
        ]
    }

    #[test]
    fn bytes_go_where_they_gain_most() {
        let choose = |bytes| choose(&tiles(), Goal::Bytes(bytes));
        // Too little for anything: the cheapest.
        assert_eq!(choose(0), [Some(0), Some(1), None, Some(0)]);
        assert_eq!(choose(49), [Some(0), Some(1), None, Some(0)]);
        // What gains most does not fit: what comes next.
        assert_eq!(choose(119), [Some(1), Some(1), None, Some(2)]);
        // (50, 60.0) lies above the line from 10 to 100 bytes.
        assert_eq!(choose(120), [Some(0), Some(0), None, Some(0)]);
        assert_eq!(choose(139), [Some(0), Some(0), None, Some(0)]);
        assert_eq!(choose(220), [Some(0), Some(3), None, Some(0)]);
        assert_eq!(choose(240), [Some(1), Some(3), None, Some(0)]);
        assert_eq!(choose(1000), [Some(2), Some(3), None, Some(2)]);
    }

    #[test]
    fn an_error_is_reached_with_the_fewest_steps() {
        let choose = |error| choose(&tiles(), Goal::Error(error));
        assert_eq!(choose(94.0), [Some(0), Some(1), None, Some(0)]);
        assert_eq!(choose(93.9), [Some(0), Some(0), None, Some(0)]);
        assert_eq!(choose(23.9), [Some(0), Some(3), None, Some(0)]);
        assert_eq!(choose(0.0), [Some(2), Some(3), None, Some(2)]);
    }

    #[test]
    fn no_other_choice_of_as_many_bytes_is_better() {
        let tiles = tiles();
        let total = |choice: &[Option<usize>], of: &dyn Fn(&TrialFit) -> f64| -> f64 {
            tiles.iter().zip(choice).filter_map(|(t, c)| c.map(|c| of(&t[c]))).sum()
        };
        // Where the steps use up the bytes.
        for bytes in [30, 120, 220, 240, 260, 330] {
            let chosen = choose(&tiles, Goal::Bytes(bytes));
            let (error, used) = (total(&chosen, &|t| t.error), total(&chosen, &|t| t.bytes as f64));
            assert!(used <= bytes as f64);
            for a in 0..3 {
                for b in 0..4 {
                    for c in 0..3 {
                        let other = [Some(a), Some(b), None, Some(c)];
                        if total(&other, &|t| t.bytes as f64) <= used {
                            assert!(total(&other, &|t| t.error) >= error - 1e-9, "{bytes}: {other:?}");
                        }
                    }
                }
            }
        }
    }
}
