//! The step of planes, for a target: between the steps that were tried, bytes and errors are geometric.

use crate::train::TrialFit;

/// Without a target: 2^(−3).
pub(super) const USUAL: u8 = 24;
/// The steps that are tried, coarse to fine.
pub(super) const TRIED: [u8; 8] = [4, 10, 16, 22, 28, 34, 42, 52];

/// The logarithm of a sum over all tiles, at a step between those that were tried.
fn at(trials: &[Vec<TrialFit>], step: u8, of: impl Fn(&TrialFit) -> f64) -> f64 {
    let sum = |i: usize| trials.iter().filter_map(|of_tile| of_tile.get(i)).map(&of).sum::<f64>();
    let after = TRIED.iter().position(|tried| *tried >= step).unwrap_or(TRIED.len() - 1).max(1);
    let [from, to] = [after - 1, after].map(|i| sum(i).max(1e-30).ln());
    let [first, second] = [TRIED[after - 1], TRIED[after]].map(f64::from);
    from + (to - from) * (f64::from(step) - first) / (second - first)
}

/// The finest step whose tiles take at most this many bytes; the coarsest if none does.
pub(super) fn for_bytes(trials: &[Vec<TrialFit>], bytes: u64) -> u8 {
    let fits = |step: &u8| at(trials, *step, |trial| trial.bytes as f64) <= (bytes.max(1) as f64).ln();
    (TRIED[0]..=TRIED[TRIED.len() - 1]).rev().find(fits).unwrap_or(TRIED[0])
}

/// The coarsest step whose tiles together reach a pooled PSNR in dB; the finest if none does.
pub(super) fn for_psnr(trials: &[Vec<TrialFit>], db: f64) -> u8 {
    let terms: u64 = trials.iter().filter_map(|of_tile| of_tile.first()).map(|trial| trial.terms).sum();
    let most = (terms.max(1) as f64).ln() - db / 10.0 * std::f64::consts::LN_10;
    let reaches = |step: &u8| at(trials, *step, |trial| trial.error) <= most;
    (TRIED[0]..=TRIED[TRIED.len() - 1]).find(reaches).unwrap_or(TRIED[TRIED.len() - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tiles whose bytes double and whose errors halve every eight steps.
    fn trials() -> Vec<Vec<TrialFit>> {
        let of_tile = |scale: f64| {
            let trial = |step: &u8| {
                let octaves = f64::from(*step) / 8.0;
                let bytes = (scale * 1e6 * octaves.exp2()) as u64;
                TrialFit { word: u32::from(*step), bytes, error: scale * (-octaves).exp2(), terms: 1000 }
            };
            TRIED.iter().map(trial).collect()
        };
        vec![of_tile(1.0), Vec::new(), of_tile(3.0)]
    }

    #[test]
    fn steps_between_those_tried_reach_targets_just() {
        // 4·10⁶ · 2^(step/8) bytes; an error of 4 · 2^(−step/8) in 2000 terms.
        for step in [4u8, 9, 20, 33, 51] {
            let bytes = 4e6 * (f64::from(step) / 8.0).exp2();
            assert_eq!(for_bytes(&trials(), (bytes * 1.01) as u64), step);
            assert_eq!(for_bytes(&trials(), (bytes * 0.99) as u64), step.saturating_sub(1).max(TRIED[0]));
            let db = -10.0 * (4.0 * (-f64::from(step) / 8.0).exp2() / 2000.0).log10();
            assert_eq!(for_psnr(&trials(), db - 0.01), step);
            assert_eq!(for_psnr(&trials(), db + 0.01), step + 1);
        }
        assert_eq!((for_bytes(&trials(), 0), for_bytes(&trials(), u64::MAX)), (4, 52));
        assert_eq!((for_psnr(&trials(), 0.0), for_psnr(&trials(), 1e3)), (4, 52));
        assert_eq!((for_bytes(&[], 10), for_psnr(&[], 40.0)), (52, 4));
    }
}
