//! Follower of containment control: moves to the mean of its in-neighbors, and so into the convex hull of the
//! leaders. (46) As the deputy of a failed leader it keeps that leader's slot, like a formation robot (an
//! addition to the chapter).

use formation::desired::Target;
use protocol::brief::AgentBrief;

use super::{Role, RoleInput, RoleRow, offset_function};
use crate::laws::situation::NeighborEstimate;

/// Row of the follower role.
pub const CONTAINED_ROLE: RoleRow = RoleRow {
    description: protocol::law::Role::CONTAINED,
    build: |brief: &AgentBrief| {
        Ok(Box::new(ContainedRole { period_s: brief.period_ns as f64 / 1e9 }))
    },
};

struct ContainedRole {
    /// Control period (T), s.
    period_s: f64,
}

impl Role for ContainedRole {
    fn target(
        &mut self,
        input: &RoleInput<'_>,
        estimates: &mut Vec<NeighborEstimate>,
    ) -> Option<Target> {
        let RoleInput { stamp_ns, neighborhood, .. } = *input;
        if neighborhood.keeps_leader_slot() {
            let frame = neighborhood.frame_at(stamp_ns)?;
            let later = frame.extrapolate(0.5 * self.period_s);
            neighborhood.estimate_neighbors(stamp_ns, offset_function(frame, later), estimates);
        } else {
            input.estimate_without_offsets(estimates);
        }
        neighborhood.desired_target(estimates)
    }
}
