//! Main leader: follows the trajectory m(t), which it alone knows. Formations rotate and scale with it.
//! (20)-(23) (25)

use formation::desired::Target;
use formation::drive::Drive;
use formation::frame::LeaderFrame;
use protocol::brief::{AgentBrief, LeadBrief};

use super::nominal_frame::NominalFrameGenerator;
use super::{Role, RoleInput, RoleRow};
use crate::UnfitBrief;
use crate::avoidance::Avoidance;
use crate::laws::situation::NeighborEstimate;

/// Row of the leader role.
pub const LEADER_ROLE: RoleRow = RoleRow {
    description: protocol::law::Role::LEADER,
    build: |brief: &AgentBrief| {
        let why = || format!("{} leads, but its brief has no [lead] with a trajectory", brief.name);
        Ok(Box::new(LeaderRole {
            lead_brief: brief.lead.clone().ok_or_else(|| UnfitBrief(why()))?,
            period_s: brief.period_ns as f64 / 1e9,
            has_deputies: !brief.spares.is_empty(),
            drive: brief.drive(),
            frame_generator: NominalFrameGenerator::new(
                brief.period_ns as f64 / 1e9,
                brief.drive(),
            ),
        }))
    },
};

struct LeaderRole {
    lead_brief: LeadBrief,
    /// Control period (T), s.
    period_s: f64,
    /// Whether the leader has deputies. After a restart it receives from them before it leads again.
    has_deputies: bool,
    drive: Drive,
    frame_generator: NominalFrameGenerator,
}

impl Role for LeaderRole {
    fn target(
        &mut self,
        input: &RoleInput<'_>,
        estimates: &mut Vec<NeighborEstimate>,
    ) -> Option<Target> {
        input.estimate_without_offsets(estimates);
        let Target { position, .. } = self.lead_brief.trajectory.target_at(input.t_s);
        let Target { velocity, .. } =
            self.lead_brief.trajectory.target_at(input.t_s + 0.5 * self.period_s);
        Some(Target { position, velocity })
    }

    fn formation_frame(
        &mut self,
        input: &RoleInput<'_>,
        avoidance: &dyn Avoidance,
    ) -> Option<LeaderFrame> {
        if input.neighborhood.is_resuming_lead() {
            return None;
        }
        // A restarted leader continues the frame of its deputies.
        if self.has_deputies
            && !self.frame_generator.has_begun()
            && let Some(received) = input.neighborhood.frame_in_force(input.stamp_ns)
        {
            let t_s = input.run_time_s(received.stamp_ns);
            self.frame_generator = NominalFrameGenerator::continue_from(
                self.period_s,
                self.drive,
                t_s,
                received.frame,
            );
        }
        Some(self.frame_generator.advance(
            input.t_s,
            input.pose.heading_rad,
            &self.lead_brief,
            avoidance,
        ))
    }
}
