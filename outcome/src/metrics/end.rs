//! Early end of a run: the run has been converged for as long as the scenario requires and over its last tenth, to
//! which final errors refer, and no event of the plan is left.
//!
//! The decision depends on the ground truth alone, so that a lockstep run always ends at the same tick.

use experiment::scenario::Scenario;

use crate::metrics::finals::FINAL_FRACTION;

#[derive(Default)]
pub(super) struct EarlyEndCondition {
    /// Required time of convergence, and time after which no planned event is left, both ns; `None` if the run
    /// lasts for `duration_s`.
    required_times_ns: Option<(u64, u64)>,
    duration_ns: u64,
    converged_since_ns: Option<u64>,
    pub(super) newest_t_ns: u64,
}

impl EarlyEndCondition {
    pub(super) fn for_scenario(scenario: &Scenario) -> EarlyEndCondition {
        EarlyEndCondition {
            required_times_ns: scenario.end_after_converged_ns.zip(scenario.plan_end_ns()),
            duration_ns: scenario.duration_ns,
            ..EarlyEndCondition::default()
        }
    }

    /// Updates the state with one sample. `converged_since_ns` is the time since which all errors of living robots
    /// are below the bound.
    pub(super) fn add_truth(&mut self, t_ns: u64, converged_since_ns: Option<u64>) {
        self.newest_t_ns = t_ns;
        self.converged_since_ns = converged_since_ns;
    }

    pub(super) fn is_reached(&self) -> bool {
        self.converged_since_ns.is_some()
            && self.newest_t_ns < self.duration_ns
            && self.earliest_end_ns().is_some_and(|end_ns| end_ns <= self.newest_t_ns)
    }

    /// Returns the earliest run time, ns, at which the run may end early. A run that is not converged now may be
    /// converged at the next sample.
    pub(super) fn earliest_end_ns(&self) -> Option<u64> {
        let (hold_ns, plan_end_ns) = self.required_times_ns?;
        let since_ns = self.converged_since_ns.unwrap_or(self.newest_t_ns);
        let final_ns = (since_ns as f64 / (1.0 - FINAL_FRACTION)).ceil() as u64;
        Some(since_ns.max(plan_end_ns).saturating_add(hold_ns).max(final_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn early_end_condition(hold_ns: u64, plan_end_ns: u64) -> EarlyEndCondition {
        let required_times_ns = Some((hold_ns, plan_end_ns));
        EarlyEndCondition {
            required_times_ns,
            duration_ns: 1000,
            converged_since_ns: None,
            newest_t_ns: 0,
        }
    }

    #[test]
    fn early_end_needs_convergence_for_the_hold_time_after_the_plan() {
        let mut end = early_end_condition(20, 100);
        for (t_ns, since_ns, expected) in [
            (50, Some(10), false),
            (119, Some(10), false),
            (120, Some(10), true),
            (130, None, false),
            (150, Some(140), false),
            (159, Some(140), false),
            (160, Some(140), true),
            (500, None, false),
            (899, Some(810), false),
            (900, Some(810), true),
            (1000, Some(140), false),
        ] {
            end.add_truth(t_ns, since_ns);
            assert_eq!(end.is_reached(), expected, "{t_ns}");
        }
    }
}
