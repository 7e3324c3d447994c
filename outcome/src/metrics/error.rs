//! How far each robot is from where its role wants it: now, at last, in all, and since when no
//! longer.

use formation::Vec2;
use formation::frame::LeaderFrame;

use crate::metrics::finals::{Finals, Window};
use crate::metrics::silence::Silent;
use crate::metrics::target::Targets;
use experiment::scenario::Scenario;
use formation::seconds;

/// The errors so far. Those of the dead count for nothing.
pub(super) struct Errors {
    targets: Targets,
    leader: Option<usize>,
    converged_error_m: f64,
    /// At the newest truth.
    pub(super) now_m: Vec<Option<f64>>,
    /// The same as vectors.
    pub(super) now: Vec<Option<Vec2>>,
    /// Integral of each robot's error over the time it lived, m s.
    pub(super) integrated_m_s: Vec<Option<f64>>,
    pub(super) finals: Finals,
    pub(super) converged_since_ns: Option<u64>,
    newest_t_ns: Option<u64>,
}

/// NaN would disappear in any maximum and pass as converged.
pub(super) fn or_infinite(error_m: f64) -> f64 {
    if error_m.is_nan() { f64::INFINITY } else { error_m }
}

impl Errors {
    /// Nothing measured yet. `window`: which errors are final.
    pub(super) fn new(scenario: &Scenario, window: Window) -> Errors {
        let robots = scenario.robots.len();
        Errors {
            targets: Targets::new(scenario),
            leader: scenario.leader(),
            converged_error_m: scenario.expect.converged_error_m,
            now_m: vec![None; robots],
            now: vec![None; robots],
            integrated_m_s: vec![None; robots],
            finals: Finals::new(robots, window),
            converged_since_ns: None,
            newest_t_ns: None,
        }
    }

    /// A robot that goes to goals was sent to another one, m.
    pub(super) fn send(&mut self, robot: usize, goal: Vec2) {
        self.targets.send(robot, goal);
    }

    /// Takes in where everybody is now, and the frame that offsets turn and grow with; the worst
    /// error of the living, m.
    pub(super) fn truth(
        &mut self,
        t_ns: u64,
        frame: &LeaderFrame,
        alphas: &[Vec2],
        alive: &[bool],
        silent: &Silent,
    ) -> f64 {
        let t_s = seconds(t_ns);
        let since_s = self.newest_t_ns.replace(t_ns).map_or(0.0, |then_ns| t_s - seconds(then_ns));
        let mut worst: Option<f64> = None;
        for (i, &alive) in alive.iter().enumerate() {
            let error = self.targets.error(i, t_s, frame, alphas, silent);
            self.now[i] = error;
            let error = error.map(|error| or_infinite(error.norm()));
            self.now_m[i] = error;
            let Some(error) = error.filter(|_| alive) else { continue };
            *self.integrated_m_s[i].get_or_insert(0.0) += error * since_s;
            worst = Some(worst.map_or(error, |worst| worst.max(error)));
            self.finals.take(t_ns, i, error);
        }
        let worst = worst.unwrap_or(0.0);
        // Of a formation in which nobody lives there is nothing to say.
        let converged = alive.contains(&true) && worst < self.converged_error_m;
        if !converged {
            self.converged_since_ns = None;
        } else if self.converged_since_ns.is_none() {
            self.converged_since_ns = Some(t_ns);
        }
        worst
    }

    /// The main leader's.
    pub(super) fn tracking_m_max(&self) -> Option<f64> {
        self.leader.and_then(|leader| self.finals.by_robot_m(self.newest_t_ns?)[leader])
    }
}
