//! Samples some of many light groups: each with a chance of its own, and whatever comes of it counts for 1 ÷
//! that chance. No layer's mean depends on the chances, only its noise and the number of rays.
//!
//! Which ones are sampled is a systematic sample (Madow 1949): the chances lie end to end on a line, and one
//! random number sets marks of unit spacing over it. So the number of those sampled differs by one at most,
//! and random numbers that are spread evenly over the samples of a texel sample every group its share of
//! times.

/// Up to this many light groups, all are sampled.
pub(crate) const FEW_GROUPS: usize = 8;

/// Turns the `worth` of each (0: never sampled) into its chance: in proportion, as far as none is above 1.
/// Their sum is `selected`, or the number of those that are worth anything where that is less.
pub(crate) fn chances(worth: &mut [f32], selected: usize) {
    let able = worth.iter().filter(|w| **w > 0.0).count();
    if able <= selected {
        return worth.iter_mut().for_each(|w| *w = if *w > 0.0 { 1.0 } else { 0.0 });
    }
    let sum = |values: &mut dyn Iterator<Item = f32>| values.map(f64::from).sum::<f64>();
    let mut scale = selected as f64 / sum(&mut worth.iter().copied());
    // What would get more than 1 is certain, and the others share the rest: by that, more of them may become
    // certain.
    let mut certain = f32::INFINITY;
    loop {
        let new = worth.iter().copied().filter(|w| *w < certain && f64::from(*w) * scale >= 1.0);
        let Some(least) = new.min_by(f32::total_cmp) else { break };
        certain = least;
        let left = selected - worth.iter().filter(|w| **w >= certain).count().min(selected);
        scale = left as f64 / sum(&mut worth.iter().copied().filter(|w| *w < certain)).max(f64::MIN_POSITIVE);
    }
    for w in worth {
        *w = if *w >= certain { 1.0 } else { (f64::from(*w) * scale).min(1.0) as f32 };
    }
}

/// Tells of one sample which are sampled, one after the other.
pub(crate) struct SystematicSampler {
    /// Where on the line the next one begins; the marks stand at whole numbers.
    at: f64,
}

impl SystematicSampler {
    /// Marks set by a uniform number in [0, 1).
    pub(crate) fn new(u: f32) -> Self {
        SystematicSampler { at: f64::from(u) }
    }

    /// Whether the next one, whose chance this is, is sampled.
    #[inline]
    pub(crate) fn selects(&mut self, chance: f32) -> bool {
        if chance >= 1.0 {
            return true;
        }
        let before = self.at as u32;
        self.at += f64::from(chance);
        self.at as u32 > before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::paths::{Sequence, SequenceKind};

    #[test]
    fn chances_are_in_proportion_and_sum_to_what_is_asked() {
        for selected in 1..9 {
            for seed in 0..200u32 {
                let sequence = Sequence::new(u64::from(seed), SequenceKind::Texel, 0, 0);
                // Over up to ten decades; some are worth nothing.
                let worth = |i: u32| match sequence.sample(i).pair(0) {
                    u if u.x < 0.1 => 0.0,
                    u => 10f32.powf(u.y * (seed % 11) as f32),
                };
                let worth: Vec<f32> = (0..9 + seed % 40).map(worth).collect();
                let mut c = worth.clone();
                chances(&mut c, selected);
                let able = worth.iter().filter(|w| **w > 0.0).count();
                let sum: f64 = c.iter().map(|c| f64::from(*c)).sum();
                assert!((sum - able.min(selected) as f64).abs() < 1e-4, "{sum} of {selected}: {worth:?}");
                for (c, w) in c.iter().zip(&worth) {
                    assert!((0.0..=1.0).contains(c) && (*c > 0.0) == (*w > 0.0));
                }
                // Of two that are not certain, chances are as worths; what is certain is worth no less.
                for (i, j) in (0..c.len()).flat_map(|i| (0..c.len()).map(move |j| (i, j))) {
                    if c[i].min(c[j]) > 0.0 && c[i].max(c[j]) < 1.0 {
                        assert!((c[i] / c[j] / (worth[i] / worth[j]) - 1.0).abs() < 1e-3);
                    }
                    assert!(c[i] < 1.0 || worth[i] >= worth[j] || c[j] >= 1.0);
                }
            }
        }
        // All alike, and nothing at all.
        let mut alike = [3e-30; 16];
        chances(&mut alike, 4);
        assert_eq!(alike, [0.25; 16]);
        let mut none = [0.0; 16];
        chances(&mut none, 4);
        assert_eq!(none, [0.0; 16]);
    }

    #[test]
    fn each_is_asked_as_often_as_its_chance_says() {
        let c = [0.5, 0.03, 1.0, 0.0, 0.25, 0.9, 0.32, 1.0];
        let n = 1 << 14;
        let mut selected = [0u32; 8];
        for i in 0..n {
            let u = Sequence::new(5, SequenceKind::Texel, i / 64, 0).sample(i % 64).number(0);
            let mut sampler = SystematicSampler::new(u);
            let now: Vec<bool> = c.iter().map(|c| sampler.selects(*c)).collect();
            selected.iter_mut().zip(&now).for_each(|(n, now)| *n += u32::from(*now));
            // Sum of the chances: 4.
            assert_eq!(now.iter().filter(|n| **n).count(), 4);
        }
        for (selected, c) in selected.iter().zip(c) {
            // Evenly spread numbers stray by less than independent ones do, whose 5 σ this is.
            let sigma = (f64::from(n) * f64::from(c * (1.0 - c))).sqrt();
            assert!(
                (f64::from(*selected) - f64::from(n) * f64::from(c)).abs() <= 5.0 * sigma,
                "{selected} of {c}"
            );
        }
    }
}
