//! How late everything was from stretch to stretch of run time.
//!
//! A value belongs to the stretch in which it reached the supervisor: up to 0.1 s of wall time after
//! it was measured, in lockstep up to a few hundred ticks.

use formation::seconds;
use protocol::stage::Stage;

use crate::metrics::summary::Stretch;

/// A run has about so many stretches,
const STRETCHES: u64 = 100;
/// of which none is shorter than this, ns, unless the run has fewer than `STRETCHES_MIN` then,
const LENGTH_NS_MIN: u64 = 1_000_000_000;
const STRETCHES_MIN: u64 = 20;
/// nor longer, so that the values of one have room.
const LENGTH_NS_MAX: u64 = 10_000_000_000;

/// Everything up to the stretch at hand.
#[derive(Debug, Clone, Default)]
pub(super) struct Stretches {
    duration_ns: u64,
    length_ns: u64,
    at_hand: u64,
    pub(super) closed: Vec<Stretch>,
}

impl Stretches {
    pub(super) fn new(duration_ns: u64) -> Stretches {
        let length_ns = (duration_ns / STRETCHES).clamp(LENGTH_NS_MIN, LENGTH_NS_MAX);
        let length_ns = length_ns.min(duration_ns / STRETCHES_MIN).max(1);
        Stretches { duration_ns, length_ns, at_hand: 0, closed: Vec::new() }
    }

    /// If another stretch than the one at hand begins, the middle of that one, s.
    pub(super) fn begin(&mut self, t_ns: u64) -> Option<f64> {
        let stretch = t_ns / self.length_ns.max(1);
        let before = std::mem::replace(&mut self.at_hand, stretch);
        (before != stretch).then(|| self.middle_s(before))
    }

    /// The middle of the stretch at hand, which is the last one, s.
    pub(super) fn end(&self) -> f64 {
        self.middle_s(self.at_hand)
    }

    fn middle_s(&self, stretch: u64) -> f64 {
        let middle_ns = stretch * self.length_ns + self.length_ns / 2;
        seconds(middle_ns.min(self.duration_ns))
    }

    /// Sums up what somebody measured in a stretch, and forgets the values.
    pub(super) fn add(
        &mut self,
        middle_s: f64,
        stage: Stage,
        robot: &str,
        from: Option<&str>,
        values_ns: &mut Vec<u64>,
    ) {
        let count = values_ns.len();
        // The smallest value that this share of all is not above.
        let rank = |percent: usize| (count * percent).div_ceil(100).saturating_sub(1);
        if count == 0 {
            return;
        }
        let (below, &mut p99_ns, above) = values_ns.select_nth_unstable(rank(99));
        let max_ns = above.iter().copied().max().unwrap_or(p99_ns);
        let half = rank(50);
        let p50_ns = if half < below.len() { *below.select_nth_unstable(half).1 } else { p99_ns };
        self.closed.push(Stretch {
            t_s: middle_s,
            stage: stage.word().to_owned(),
            robot: robot.to_owned(),
            from: from.map(str::to_owned),
            count: count as u64,
            p50_ns,
            p99_ns,
            max_ns,
        });
        values_ns.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_stretch_is_summed_up_as_if_its_values_were_sorted(
            values_ns in prop::collection::vec(0..1000u64, 1..300),
        ) {
            let mut stretches = Stretches::new(30_000_000_000);
            stretches.add(0.5, Stage::Wake, "plant", None, &mut values_ns.clone());
            let mut sorted = values_ns;
            sorted.sort_unstable();
            let rank = |share: f64| sorted[(sorted.len() as f64 * share).ceil() as usize - 1];
            let line = &stretches.closed[0];
            let summed_up = (line.count as usize, line.p50_ns, line.p99_ns, line.max_ns);
            let expected = (sorted.len(), rank(0.5), rank(0.99), sorted[sorted.len() - 1]);
            prop_assert_eq!(summed_up, expected);
        }
    }
}
