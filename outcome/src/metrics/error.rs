//! Error of each robot: its distance from the target that its role gives it. Current, final and integrated errors,
//! and the time of convergence.

use formation::Vec2;
use formation::desired::Target;
use formation::frame::LeaderFrame;

use crate::metrics::finals::{FinalErrors, FinalWindow};
use crate::metrics::silence::SilenceState;
use crate::metrics::target::Targets;
use experiment::scenario::Scenario;
use formation::ns_to_seconds;

/// Errors of the robots. Dead robots are not included.
pub(super) struct FormationErrors {
    targets: Targets,
    leader: Option<usize>,
    converged_error_m: f64,
    /// Errors at the newest ground-truth sample, m.
    pub(super) current_errors_m: Vec<Option<f64>>,
    /// Error vectors at the newest ground-truth sample, m.
    pub(super) current_error_vectors: Vec<Option<Vec2>>,
    /// Integral of each robot's error over the time it was alive, m s.
    pub(super) error_integrals_m_s: Vec<Option<f64>>,
    pub(super) final_errors: FinalErrors,
    pub(super) converged_since_ns: Option<u64>,
    newest_t_ns: Option<u64>,
    /// Whether any robot had an error, or has a role by which it is evaluated.
    pub(super) is_evaluated: bool,
}

/// Replaces NaN by infinity, because a maximum ignores NaN and the run would count as converged.
pub(super) fn nan_to_infinity(error_m: f64) -> f64 {
    if error_m.is_nan() { f64::INFINITY } else { error_m }
}

impl FormationErrors {
    /// Creates the errors before the first sample. `window` selects the errors that are final.
    pub(super) fn new(scenario: &Scenario, window: FinalWindow) -> FormationErrors {
        let robots = scenario.robots.len();
        FormationErrors {
            targets: Targets::new(scenario),
            leader: scenario.leader(),
            converged_error_m: scenario.expectations.converged_error_m,
            current_errors_m: vec![None; robots],
            current_error_vectors: vec![None; robots],
            error_integrals_m_s: vec![None; robots],
            final_errors: FinalErrors::new(robots, window),
            converged_since_ns: None,
            newest_t_ns: None,
            is_evaluated: false,
        }
    }

    /// Sets a new goal, m, for a robot that goes to goals.
    pub(super) fn set_goal(&mut self, robot: usize, goal: Vec2) {
        self.targets.set_goal(robot, goal);
    }

    /// Sets the target that the law of a free robot named at its sample of run time `t_ns`, ns.
    pub(super) fn set_own_target(&mut self, robot: usize, t_ns: u64, target: Option<Target>) {
        self.targets.set_own_target(robot, t_ns, target);
    }

    /// Updates the errors with one sample. `frame` is the frame in which offsets rotate and scale. Returns the
    /// largest error of a living robot, m, or 0 if no robot is alive.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        frame: &LeaderFrame,
        alphas: &[Vec2],
        alive: &[bool],
        silence: &SilenceState,
    ) -> f64 {
        let t_s = ns_to_seconds(t_ns);
        let step_s = self
            .newest_t_ns
            .replace(t_ns)
            .map_or(0.0, |previous_ns| t_s - ns_to_seconds(previous_ns));
        let mut worst_m: Option<f64> = None;
        self.targets.drop_replaced_targets(t_ns);
        let transform = frame.offset_transform();
        for (i, &alive) in alive.iter().enumerate() {
            let error = self.targets.robot_error(i, t_s, &transform, alphas, silence);
            self.current_error_vectors[i] = error;
            let error = error.map(|error| nan_to_infinity(error.norm()));
            self.current_errors_m[i] = error;
            let Some(error) = error.filter(|_| alive) else { continue };
            *self.error_integrals_m_s[i].get_or_insert(0.0) += error * step_s;
            worst_m = Some(worst_m.map_or(error, |worst_m| worst_m.max(error)));
            self.final_errors.push(t_ns, i, error);
        }
        // If only robots are left that name no target, nothing is evaluated.
        let is_evaluated = worst_m.is_some() || (0..alive.len()).any(|i| !self.targets.is_free(i));
        let worst_m = worst_m.unwrap_or(0.0);
        // A formation without a living robot is not converged.
        let converged = is_evaluated && alive.contains(&true) && worst_m < self.converged_error_m;
        self.is_evaluated |= is_evaluated;
        if !converged {
            self.converged_since_ns = None;
        } else if self.converged_since_ns.is_none() {
            self.converged_since_ns = Some(t_ns);
        }
        worst_m
    }

    /// Returns the main leader's largest final error, m.
    pub(super) fn final_tracking_error_m_max(&self) -> Option<f64> {
        self.leader
            .and_then(|leader| self.final_errors.errors_by_robot_m(self.newest_t_ns?)[leader])
    }
}
