//! How far each robot is from where its role wants it, from the truth about everybody.

use formation::Vec2;
use formation::desired::{Target, desired};
use formation::frame::LeaderFrame;
use formation::front_point::front_point;
use formation::graph::Edge;
use formation::pose::Pose;
use protocol::brief::LeadBrief;
use protocol::law::Role;

use super::Silent;
use experiment::scenario::{Scenario, Silenced};

/// What the errors of a scenario's robots are measured against.
pub(super) struct Errors {
    roles: Vec<Role>,
    /// For each robot, the edges that end in it, and their places in the graph.
    heard: Vec<Vec<(usize, Edge)>>,
    lead: Option<LeadBrief>,
    leader: Option<usize>,
}

impl Errors {
    pub(super) fn new(scenario: &Scenario) -> Errors {
        let edges = || scenario.graph.edges().iter().copied().enumerate();
        let heard = |i| edges().filter(|(_, edge)| edge.to == i).collect();
        Errors {
            roles: scenario.robots.iter().map(|robot| robot.role).collect(),
            heard: (0..scenario.robots.len()).map(heard).collect(),
            lead: scenario.lead.clone(),
            leader: scenario.leader(),
        }
    }

    /// Where the offsets turn and grow to at `t_s`, from the leader's true heading.
    pub(super) fn frame(&self, t_s: f64, heading_rad: impl Fn(usize) -> f64) -> LeaderFrame {
        let (Some(lead), Some(leader)) = (&self.lead, self.leader) else {
            return LeaderFrame::STILL;
        };
        let heading_rad = heading_rad(leader);
        LeaderFrame { heading_rad, scale: lead.scale.at(t_s).0, ..LeaderFrame::STILL }
    }

    /// alpha_i - alpha*_i, m: alpha* is m(t) for the leader (25), the mean of what all heard ask
    /// for in a formation (13) (24) (45), their mean for a contained robot (46); the silent have no
    /// say in it while anybody else is heard. `None` for one that has nothing to go by.
    pub(super) fn of(
        &self,
        robot: usize,
        t_s: f64,
        frame: &LeaderFrame,
        alphas: &[Vec2],
        silent: &Silent,
    ) -> Option<Vec2> {
        let target = match self.roles[robot] {
            Role::Leader => self.lead.as_ref().map(|lead| lead.trajectory.at(t_s)),
            Role::Formation => self.mean(robot, alphas, silent, |c_ji| frame.offset(c_ji)),
            Role::Contained => self.mean(robot, alphas, silent, |_| Target::still(Vec2::zeros())),
        };
        target.map(|target| alphas[robot] - target.position)
    }

    fn mean(
        &self,
        robot: usize,
        alphas: &[Vec2],
        silent: &Silent,
        offset: impl Fn(Vec2) -> Target,
    ) -> Option<Target> {
        let heard = &self.heard[robot];
        let speaks = |edge: usize, from: usize| silent.carries(edge, from);
        let nobody = !heard.iter().any(|(edge, ends)| speaks(*edge, ends.from));
        let counted = heard.iter().filter(|(edge, ends)| nobody || speaks(*edge, ends.from));
        let place = |ends: &Edge| Target::still(alphas[ends.from]);
        desired(counted.map(|(_, ends)| (place(ends), offset(ends.offset_m))))
    }
}

/// The errors of a run that is over, as vectors.
pub struct ErrorVectors {
    errors: Errors,
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
            errors: Errors::new(scenario),
            front_points_m: scenario.robots.iter().map(|robot| robot.front_point_m).collect(),
            silences,
            silent: Silent::new(scenario),
            alphas: vec![Vec2::zeros(); scenario.robots.len()],
        }
    }

    /// e_i of everybody, m, from where they were at that time; `None` for one that has nothing to
    /// go by.
    pub fn at(&mut self, t_s: f64, poses: &[Pose]) -> impl Iterator<Item = Option<Vec2>> {
        self.silent.robots.fill(0);
        self.silent.edges.fill(0);
        for silence in self.silences.iter().filter(|s| (s.from_s..s.until_s).contains(&t_s)) {
            self.silent.count(silence.silenced, 1);
        }
        for ((alpha, pose), ell) in self.alphas.iter_mut().zip(poses).zip(&self.front_points_m) {
            *alpha = front_point(*pose, *ell);
        }
        let frame = self.errors.frame(t_s, |leader| poses[leader].heading_rad);
        (0..poses.len()).map(move |i| self.errors.of(i, t_s, &frame, &self.alphas, &self.silent))
    }
}
