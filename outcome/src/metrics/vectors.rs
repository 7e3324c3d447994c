//! Error vectors of a finished run.

use formation::Vec2;
use formation::front_point::front_point;
use formation::pose::Pose;

use crate::metrics::frame::IdealFrame;
use crate::metrics::silence::SilenceState;
use crate::metrics::target::Targets;
use experiment::scenario::{Scenario, Silenced};

/// Computes the error vectors of a finished run.
pub struct ErrorVectors {
    targets: Targets,
    frame: IdealFrame,
    front_points_m: Vec<f64>,
    silences: Vec<Silence>,
    silent: SilenceState,
    alphas: Vec<Vec2>,
}

/// Period in which a robot or an edge is silent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Silence {
    /// Start, s.
    pub from_s: f64,
    /// End, s.
    pub until_s: f64,
    /// Silent robot or edge.
    pub silenced: Silenced,
}

impl ErrorVectors {
    /// Creates the computation for the robots of a scenario and these periods of silence.
    pub fn new(scenario: &Scenario, silences: Vec<Silence>) -> ErrorVectors {
        ErrorVectors {
            targets: Targets::new(scenario),
            frame: IdealFrame::new(scenario),
            front_points_m: scenario.robots.iter().map(|robot| robot.front_point_m).collect(),
            silences,
            silent: SilenceState::new(scenario),
            alphas: vec![Vec2::zeros(); scenario.robots.len()],
        }
    }

    /// Sets a new goal, m, for a robot that goes to goals. It holds from the next requested time on.
    pub fn set_goal(&mut self, robot: usize, goal: Vec2) {
        self.targets.set_goal(robot, goal);
    }

    /// Returns the error vectors e_i of all robots, m, at time `t_s`, from their poses. Times must be requested in
    /// increasing order. The vector is `None` for a robot without a reference.
    pub fn errors_at(&mut self, t_s: f64, poses: &[Pose]) -> impl Iterator<Item = Option<Vec2>> {
        self.silent.clear();
        for silence in self.silences.iter().filter(|s| (s.from_s..s.until_s).contains(&t_s)) {
            self.silent.add_silence(silence.silenced, 1);
        }
        for ((alpha, pose), ell) in self.alphas.iter_mut().zip(poses).zip(&self.front_points_m) {
            *alpha = front_point(*pose, *ell);
        }
        let frame = self.frame.frame_at(t_s, |i| poses[i].heading_rad, |_| true);
        (0..poses.len())
            .map(move |i| self.targets.error(i, t_s, &frame, &self.alphas, &self.silent))
    }
}
