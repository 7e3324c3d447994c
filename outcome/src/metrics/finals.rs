//! Maxima over the last tenth of a run, whether or not its end is known beforehand.

use std::collections::VecDeque;

use experiment::scenario::Scenario;

/// Fraction of the run, at its end, over which final errors are maxima.
pub(super) const FINAL_FRACTION: f64 = 0.1;

/// Selection of the values that are final.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FinalWindow {
    /// Values from this run time on, ns.
    FromTime(u64),
    /// Values in the last [`FINAL_FRACTION`] of the run, whose end is not known beforehand.
    LastFraction,
}

/// Returns the time from which on values are final in a run that ends at `end_ns`, ns.
pub(super) fn final_from_ns(end_ns: u64) -> u64 {
    (end_ns as f64 * (1.0 - FINAL_FRACTION)) as u64
}

impl FinalWindow {
    /// Returns the selection for the runs of a scenario.
    pub(super) fn for_scenario(scenario: &Scenario) -> FinalWindow {
        match scenario.end_after_converged_ns {
            None => FinalWindow::FromTime(final_from_ns(scenario.duration_ns)),
            Some(_) => FinalWindow::LastFraction,
        }
    }

    /// Returns the time from which on values are final if the run ends at `end_ns`, ns.
    pub(super) fn start_ns(self, end_ns: u64) -> u64 {
        match self {
            FinalWindow::FromTime(from_ns) => from_ns,
            FinalWindow::LastFraction => final_from_ns(end_ns),
        }
    }
}

/// Sliding-window maximum of one series of values.
#[derive(Debug, Clone)]
pub(super) struct WindowMaximum {
    window: FinalWindow,
    /// Values that may still become the maximum, with their times, ns. Each is less than the one before.
    candidates: VecDeque<(u64, f64)>,
}

impl WindowMaximum {
    /// Creates the maximum of an empty series.
    pub(super) fn new(window: FinalWindow) -> WindowMaximum {
        WindowMaximum { window, candidates: VecDeque::new() }
    }

    /// Adds a value at time `t_ns`. Times must increase.
    pub(super) fn push(&mut self, t_ns: u64, value: f64) {
        let start_ns = self.window.start_ns(t_ns);
        if t_ns < start_ns {
            return;
        }
        while self.candidates.back().is_some_and(|&(_, earlier)| earlier <= value) {
            self.candidates.pop_back();
        }
        while self.candidates.front().is_some_and(|&(candidate_ns, _)| candidate_ns < start_ns) {
            self.candidates.pop_front();
        }
        self.candidates.push_back((t_ns, value));
    }

    /// Returns the maximum, if the run ends at `end_ns`; `None` without final values.
    pub(super) fn value_at_end(&self, end_ns: u64) -> Option<f64> {
        let start_ns = self.window.start_ns(end_ns);
        let mut candidates = self.candidates.iter();
        candidates.find(|&&(t_ns, _)| t_ns >= start_ns).map(|&(_, value)| value)
    }
}

/// Final errors of each robot.
#[derive(Debug, Clone)]
pub(super) struct FinalErrors(Vec<WindowMaximum>);

impl FinalErrors {
    /// Creates the final errors of `robots` robots, without values.
    pub(super) fn new(robots: usize, window: FinalWindow) -> FinalErrors {
        FinalErrors(vec![WindowMaximum::new(window); robots])
    }

    /// Adds the error of a living robot, m, at this time, ns.
    pub(super) fn push(&mut self, t_ns: u64, robot: usize, error_m: f64) {
        self.0[robot].push(t_ns, error_m);
    }

    /// Returns the final error of each robot, m, if the run ends at `end_ns`.
    pub(super) fn errors_by_robot_m(&self, end_ns: u64) -> Vec<Option<f64>> {
        self.0.iter().map(|worst| worst.value_at_end(end_ns)).collect()
    }

    /// Returns the largest final error of all robots, m, if the run ends at `end_ns`.
    pub(super) fn error_m_max(&self, end_ns: u64) -> Option<f64> {
        self.errors_by_robot_m(end_ns).into_iter().flatten().reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// For any end and any missing values, the result is the maximum of the last tenth.
        #[test]
        fn final_error_is_the_maximum_of_the_last_tenth(
            values in proptest::collection::vec(proptest::option::of(0.0..1.0f64), 1..300),
            from in 0..300u64,
        ) {
            for window in [FinalWindow::LastFraction, FinalWindow::FromTime(from)] {
                let mut worst = WindowMaximum::new(window);
                for (t_ns, value) in (0..).zip(&values) {
                    if let Some(value) = value {
                        worst.push(t_ns, *value);
                    }
                    let from_ns = window.start_ns(t_ns).min(t_ns + 1);
                    let last = &values[from_ns as usize..=t_ns as usize];
                    let expected = last.iter().flatten().copied().reduce(f64::max);
                    prop_assert_eq!(worst.value_at_end(t_ns), expected);
                }
            }
        }
    }
}
