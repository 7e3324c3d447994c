//! The errors of a run that is over, as vectors.

use formation::Vec2;
use formation::front_point::front_point;
use formation::pose::Pose;

use crate::metrics::frame::IdealFrame;
use crate::metrics::silence::Silent;
use crate::metrics::target::Targets;
use experiment::scenario::{Scenario, Silenced};

/// The errors of a run that is over, as vectors.
pub struct ErrorVectors {
    targets: Targets,
    frame: IdealFrame,
    front_points_m: Vec<f64>,
    silences: Vec<Silence>,
    silent: Silent,
    alphas: Vec<Vec2>,
}

/// What is silent from when until when, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Silence {
    /// From then on, s.
    pub from_s: f64,
    /// Until then, s.
    pub until_s: f64,
    /// Who or what.
    pub silenced: Silenced,
}

impl ErrorVectors {
    /// Of this scenario's robots, of whom these are silent for a while.
    pub fn new(scenario: &Scenario, silences: Vec<Silence>) -> ErrorVectors {
        ErrorVectors {
            targets: Targets::new(scenario),
            frame: IdealFrame::new(scenario),
            front_points_m: scenario.robots.iter().map(|robot| robot.front_point_m).collect(),
            silences,
            silent: Silent::new(scenario),
            alphas: vec![Vec2::zeros(); scenario.robots.len()],
        }
    }

    /// From the next time that is asked for, a robot that goes to goals is sent to this one, m.
    pub fn send(&mut self, robot: usize, goal: Vec2) {
        self.targets.send(robot, goal);
    }

    /// e_i of everybody, m, from where they were at that time, asked in order of time; `None` for one that has nothing to
    /// go by.
    pub fn at(&mut self, t_s: f64, poses: &[Pose]) -> impl Iterator<Item = Option<Vec2>> {
        self.silent.clear();
        for silence in self.silences.iter().filter(|s| (s.from_s..s.until_s).contains(&t_s)) {
            self.silent.count(silence.silenced, 1);
        }
        for ((alpha, pose), ell) in self.alphas.iter_mut().zip(poses).zip(&self.front_points_m) {
            *alpha = front_point(*pose, *ell);
        }
        let frame = self.frame.at(t_s, |i| poses[i].heading_rad, |_| true);
        (0..poses.len())
            .map(move |i| self.targets.error(i, t_s, &frame, &self.alphas, &self.silent))
    }
}
