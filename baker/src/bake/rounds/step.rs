//! One round, as a block sees it: what it goes for, and by what its samples are handed out.

use crate::bake::errors::UnconvergedCells;
use crate::bake::samples::Pivot;
use crate::bake::store::CELLS;
use crate::receivers::ReceiverBlock;
use std::time::Instant;

/// One round. It depends on nothing but the rounds before, so a block that was lost is brought through the
/// same steps again.
pub(super) struct Step {
    /// Counted from 1.
    pub round: u32,
    /// Samples per texel before it, both halves together.
    pub before: u32,
    /// Samples per texel, both halves together.
    pub target: u32,
    /// Samples per texel at which blocks stop on the way, the last of them the target
    /// ([`super::round::stops`]).
    pub stops: Vec<u32>,
    /// When to stop amid the round; none for a round that is traced again.
    pub deadline: Option<Instant>,
    /// Whose texels get as many samples as the target says, after the first round.
    pub pivot: Pivot,
    /// The mean light of every frame in the first round, once that is done: then shares are decided. Frames
    /// of mean 0 do not count; without a cache, deviations are relative to it.
    pub first_means: Option<Vec<f64>>,
    /// The cells that miss a target; without one, and in the first round, all get samples.
    pub unconverged: Option<UnconvergedCells>,
}

impl Step {
    /// Samples per texel at which a block looks at the clock. A round takes as long as all before it, and on
    /// a small page that is the time of one block: under a time limit it is traced in sixteen slices, which
    /// draw the same samples as the whole.
    pub(super) fn slices(&self) -> impl Iterator<Item = u32> + '_ {
        const SLICES: u32 = 16;
        let before = self.before;
        let is_cut = self.deadline.is_some() && self.target >= before + 2 * SLICES;
        let slices = if is_cut { SLICES } else { 0 };
        // (Even numbers, for both halves draw as many.)
        let step = (self.target - before) / SLICES / 2 * 2;
        let target = self.target;
        let cut = (1..=slices).map(move |slice| if slice == slices { target } else { before + slice * step });
        cut.chain(self.stops.iter().copied().filter(move |_| !is_cut))
    }

    /// Whether the round has samples for some cell of a block.
    pub(super) fn concerns(&self, receivers: &ReceiverBlock) -> bool {
        self.active(receivers).contains(&true)
    }

    /// The cells of a block that get samples.
    pub(super) fn active(&self, receivers: &ReceiverBlock) -> [bool; CELLS] {
        self.unconverged
            .as_ref()
            .map_or([true; CELLS], |unconverged| unconverged.of_block(receivers.x0, receivers.y0))
    }

    /// Whether the time of the round is over.
    pub(super) fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_end_at_the_target_and_there_is_one_without_a_deadline() {
        let slices = |before: u32, target: u32, deadline| {
            let pivot = Pivot::OfCell;
            let stops = vec![target];
            let step = Step {
                round: 2,
                before,
                target,
                stops,
                deadline,
                pivot,
                first_means: None,
                unconverged: None,
            };
            step.slices().collect::<Vec<u32>>()
        };
        assert_eq!(slices(1 << 15, 1 << 16, None), [1 << 16]);
        let now = Some(Instant::now());
        let many = slices(1 << 15, 1 << 16, now);
        assert_eq!((many.len(), many[0], many[15]), (16, (1 << 15) + (1 << 11), 1 << 16));
        assert!(many.windows(2).all(|pair| pair[0] < pair[1]) && many.iter().all(|n| n % 2 == 0));
        // A power of two need not lie between: what was asked for may be less than twice what was drawn.
        assert_eq!(slices(16, 32, now), [32]);
        assert_eq!(slices(0, 2, now), [2]);
    }
}
