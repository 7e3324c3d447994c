//! How far each robot is from where its role wants it, from the truth about everybody.

use formation::Vec2;
use formation::desired::{Target, desired};
use formation::frame::LeaderFrame;
use formation::graph::Edge;
use protocol::brief::LeadBrief;
use protocol::law::Role;
use protocol::message::TruthRow;

use crate::scenario::Scenario;

/// What the errors of a scenario's robots are measured against.
pub(super) struct Errors {
    roles: Vec<Role>,
    /// For each robot, the edges that end in it.
    heard: Vec<Vec<Edge>>,
    lead: Option<LeadBrief>,
    leader: Option<usize>,
}

impl Errors {
    pub(super) fn new(scenario: &Scenario) -> Errors {
        let heard = |i| scenario.graph.heard_by(i).copied().collect();
        Errors {
            roles: scenario.robots.iter().map(|robot| robot.role).collect(),
            heard: (0..scenario.robots.len()).map(heard).collect(),
            lead: scenario.lead.clone(),
            leader: scenario.leader(),
        }
    }

    /// Where the offsets turn and grow to at `t_s`, from the leader's true heading.
    pub(super) fn frame(&self, t_s: f64, rows: &[TruthRow]) -> LeaderFrame {
        let (Some(lead), Some(leader)) = (&self.lead, self.leader) else {
            return LeaderFrame::STILL;
        };
        let heading_rad = rows[leader].heading_rad;
        LeaderFrame { heading_rad, scale: lead.scale.at(t_s).0, ..LeaderFrame::STILL }
    }

    /// |alpha_i - alpha*_i|, m: alpha* is m(t) for the leader (25), the mean of what all heard ask
    /// for in a formation (13) (24) (45), their mean for a contained robot (46). `None` for one
    /// that has nothing to go by.
    pub(super) fn of(
        &self,
        robot: usize,
        t_s: f64,
        frame: &LeaderFrame,
        alphas: &[Vec2],
    ) -> Option<f64> {
        let target = match self.roles[robot] {
            Role::Leader => self.lead.as_ref().map(|lead| lead.trajectory.at(t_s)),
            Role::Formation => self.mean(robot, alphas, |c_ji| frame.offset(c_ji)),
            Role::Contained => self.mean(robot, alphas, |_| Target::still(Vec2::zeros())),
        };
        target.map(|target| (alphas[robot] - target.position).norm())
    }

    fn mean(
        &self,
        robot: usize,
        alphas: &[Vec2],
        offset: impl Fn(Vec2) -> Target,
    ) -> Option<Target> {
        let heard = self.heard[robot].iter();
        desired(heard.map(|edge| (Target::still(alphas[edge.from]), offset(edge.offset_m))))
    }
}
