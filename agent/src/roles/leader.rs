//! The main leader: follows the trajectory m(t), which it alone knows; formations turn and grow with
//! it. (20)-(23) (25)

use formation::Vec2;
use formation::desired::Target;
use formation::frame::LeaderFrame;
use protocol::brief::{AgentBrief, LeadBrief};

use super::{Moment, Role, RoleError, RoleRow};
use crate::avoidance::Avoidance;
use crate::laws::situation::Heard;

/// The leader's row.
pub const LEADER: RoleRow = RoleRow {
    description: protocol::law::Role::LEADER,
    build: |brief: &AgentBrief| {
        let lead = brief.lead.clone();
        Ok(Box::new(Leader {
            lead: lead.ok_or_else(|| RoleError::NothingToLead(brief.name.clone()))?,
            period_s: brief.period_ns as f64 / 1e9,
            turned: None,
        }))
    },
};

struct Leader {
    lead: LeadBrief,
    /// T, s.
    period_s: f64,
    /// The previous sample's stamp, ns, and turn rate, rad/s.
    turned: Option<(u64, f64)>,
}

impl Role for Leader {
    fn target(&mut self, moment: &Moment<'_>, heard: &mut Vec<Heard>) -> Option<Target> {
        let nowhere = Target::still(Vec2::zeros());
        moment.neighborhood.recall(moment.stamp_ns, |_| nowhere, heard);
        let Target { position, .. } = self.lead.trajectory.at(moment.t_s);
        let Target { velocity, .. } = self.lead.trajectory.at(moment.t_s + 0.5 * self.period_s);
        Some(Target { position, velocity })
    }

    fn frame(
        &mut self,
        moment: &Moment<'_>,
        gamma: Vec2,
        avoidance: &dyn Avoidance,
    ) -> Option<LeaderFrame> {
        let (scale, scale_rate_per_s) = self.lead.scale.at(moment.t_s);
        // Free of avoidance: beta turns the leader, and must not turn the formation.
        let held = avoidance.follow(moment.pose.heading_rad, gamma).w_rad_s;
        let before = self.turned.replace((moment.stamp_ns, held));
        let acceleration = before.map_or(0.0, |(then_ns, was)| {
            (held - was) / (moment.stamp_ns.saturating_sub(then_ns).max(1) as f64 / 1e9)
        });
        Some(LeaderFrame {
            heading_rad: moment.pose.heading_rad,
            // What is held for a period is the rate at its middle.
            turn_rate_rad_s: held - 0.5 * self.period_s * acceleration,
            turn_acceleration_rad_s2: acceleration,
            scale,
            scale_rate_per_s,
        })
    }
}
