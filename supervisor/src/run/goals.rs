//! Counts of goals from outside, over all incarnations of the processes that received them. Pure.

use outcome::metrics::summary::GoalSummary;
use protocol::message::GoalCounts;

/// Counts over all processes.
#[derive(Debug, Default)]
pub(super) struct GoalCounter {
    /// Sum over processes that have exited.
    earlier_counts: GoalCounts,
    /// Counts of the process that reported last.
    newest_counts: GoalCounts,
}

impl GoalCounter {
    /// Adds the cumulative counts of a process.
    pub(super) fn add_counts(&mut self, counts: GoalCounts) {
        if counts.began_ns != self.newest_counts.began_ns {
            self.earlier_counts = self.total();
        }
        self.newest_counts = counts;
    }

    fn total(&self) -> GoalCounts {
        let GoalCounter { earlier_counts: earlier, newest_counts: newest } = self;
        GoalCounts {
            began_ns: 0,
            taken: earlier.taken + newest.taken,
            refused: std::array::from_fn(|i| earlier.refused[i] + newest.refused[i]),
        }
    }

    /// Returns the sum of all counts.
    pub(super) fn summary(&self) -> GoalSummary {
        let sum = self.total();
        let refused = sum.refused_counts().map(|(reason, count)| (reason.to_owned(), count));
        GoalSummary { taken: sum.taken, refused: refused.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::goal::RefusalReason;

    #[test]
    fn counts_include_those_of_replaced_processes() {
        let mut goals = GoalCounter::default();
        let counts = |began_ns, taken, frame: u64| {
            let mut counts = GoalCounts { began_ns, taken, ..GoalCounts::default() };
            (0..frame).for_each(|_| counts.count_refusal(RefusalReason::WrongFrame));
            counts
        };
        for reported_counts in [counts(7, 1, 0), counts(7, 2, 1), counts(9, 0, 0), counts(9, 3, 2)]
        {
            goals.add_counts(reported_counts);
        }
        let refused = vec![("frame".to_owned(), 3)];
        assert_eq!(goals.summary(), GoalSummary { taken: 5, refused });
    }
}
