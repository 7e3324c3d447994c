//! What is worst towards the end of a run: over its last tenth, whether that end is known beforehand or not.

use std::collections::VecDeque;

use experiment::scenario::Scenario;

/// Final errors are the worst over this last share of the run.
pub(super) const FINAL_SHARE: f64 = 0.1;

/// Which values are final.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Window {
    /// Those from this run time on, ns.
    From(u64),
    /// Those of the last share of the time that the run will have reached, whenever that is.
    Share,
}

/// From when on values of a run that ends at `end_ns` are final, ns.
pub(super) fn final_from_ns(end_ns: u64) -> u64 {
    (end_ns as f64 * (1.0 - FINAL_SHARE)) as u64
}

impl Window {
    /// That of a scenario's runs.
    pub(super) fn of(scenario: &Scenario) -> Window {
        match scenario.end_after_converged_ns {
            None => Window::From(final_from_ns(scenario.duration_ns)),
            Some(_) => Window::Share,
        }
    }

    /// From when on values are final if the run ends at `end_ns`, ns.
    pub(super) fn begins_ns(self, end_ns: u64) -> u64 {
        match self {
            Window::From(from_ns) => from_ns,
            Window::Share => final_from_ns(end_ns),
        }
    }
}

/// The worst of one series of values.
#[derive(Debug, Clone)]
pub(super) struct Worst {
    window: Window,
    /// Values that may be the worst yet, with their times, ns: each less than the one before.
    candidates: VecDeque<(u64, f64)>,
}

impl Worst {
    /// Of no values yet.
    pub(super) fn new(window: Window) -> Worst {
        Worst { window, candidates: VecDeque::new() }
    }

    /// Takes in a value of this time, ns, after those of earlier times.
    pub(super) fn take(&mut self, t_ns: u64, value: f64) {
        let from_ns = self.window.begins_ns(t_ns);
        if t_ns < from_ns {
            return;
        }
        while self.candidates.back().is_some_and(|&(_, earlier)| earlier <= value) {
            self.candidates.pop_back();
        }
        while self.candidates.front().is_some_and(|&(then_ns, _)| then_ns < from_ns) {
            self.candidates.pop_front();
        }
        self.candidates.push_back((t_ns, value));
    }

    /// The worst, if the run ends at `end_ns`.
    pub(super) fn at(&self, end_ns: u64) -> Option<f64> {
        let from_ns = self.window.begins_ns(end_ns);
        let mut candidates = self.candidates.iter();
        candidates.find(|&&(t_ns, _)| t_ns >= from_ns).map(|&(_, value)| value)
    }
}

/// The worst errors of each robot.
#[derive(Debug, Clone)]
pub(super) struct Finals(Vec<Worst>);

impl Finals {
    /// Of so many robots; none yet.
    pub(super) fn new(robots: usize, window: Window) -> Finals {
        Finals(vec![Worst::new(window); robots])
    }

    /// Takes in the error of a living robot, m, at this time, ns.
    pub(super) fn take(&mut self, t_ns: u64, robot: usize, error_m: f64) {
        self.0[robot].take(t_ns, error_m);
    }

    /// By robot, m, if the run ends at `end_ns`.
    pub(super) fn by_robot_m(&self, end_ns: u64) -> Vec<Option<f64>> {
        self.0.iter().map(|worst| worst.at(end_ns)).collect()
    }

    /// The worst of all, m, if the run ends at `end_ns`.
    pub(super) fn max_m(&self, end_ns: u64) -> Option<f64> {
        self.by_robot_m(end_ns).into_iter().flatten().reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whenever the run ends, and whatever is missing: the largest value of its last tenth.
        #[test]
        fn the_worst_of_the_last_tenth_is_kept_wherever_the_end_is(
            values in proptest::collection::vec(proptest::option::of(0.0..1.0f64), 1..300),
            from in 0..300u64,
        ) {
            for window in [Window::Share, Window::From(from)] {
                let mut worst = Worst::new(window);
                for (t_ns, value) in (0..).zip(&values) {
                    if let Some(value) = value {
                        worst.take(t_ns, *value);
                    }
                    let from_ns = window.begins_ns(t_ns).min(t_ns + 1);
                    let last = &values[from_ns as usize..=t_ns as usize];
                    let expected = last.iter().flatten().copied().reduce(f64::max);
                    prop_assert_eq!(worst.at(t_ns), expected);
                }
            }
        }
    }
}
