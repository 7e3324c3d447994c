//! Free robot: its control law alone decides where it goes. The law may name a target at each sample, by which the
//! robot is judged and avoidance knows that it has arrived.

use formation::Vec2;
use formation::desired::Target;
use formation::front_point::front_point;
use protocol::brief::AgentBrief;

use super::{Role, RoleInput, RoleRow};
use crate::laws::situation::NeighborEstimate;

/// Row of the free role.
pub const FREE_ROLE: RoleRow = RoleRow {
    description: protocol::law::Role::FREE,
    build: |brief: &AgentBrief| Ok(Box::new(FreeRole { front_point_m: brief.front_point_m })),
};

struct FreeRole {
    front_point_m: f64,
}

impl Role for FreeRole {
    /// Returns the robot's own front point, so that the law is asked at every sample, and sees no error until it has
    /// named a target.
    fn target(
        &mut self,
        moment: &RoleInput<'_>,
        heard: &mut Vec<NeighborEstimate>,
    ) -> Option<Target> {
        let offset = |c_ji: Vec2| Target::at_rest(c_ji);
        moment.neighborhood.estimate_neighbors(moment.stamp_ns, offset, heard);
        Some(Target::at_rest(front_point(moment.pose, self.front_point_m)))
    }

    fn asks_law_for_target(&self) -> bool {
        true
    }
}
