//! Free robot: its control law alone decides where it goes. The law may name a target at each sample, from which
//! the metrics and the avoidance method derive whether the robot has arrived.

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
    /// Returns the robot's own front point, so that the law is called at every sample, and its error is 0 until it has
    /// named a target.
    fn target(
        &mut self,
        input: &RoleInput<'_>,
        estimates: &mut Vec<NeighborEstimate>,
    ) -> Option<Target> {
        let offset = |c_ji: Vec2| Target::at_rest(c_ji);
        input.neighborhood.estimate_neighbors(input.stamp_ns, offset, estimates);
        Some(Target::at_rest(front_point(input.pose, self.front_point_m)))
    }

    fn asks_law_for_target(&self) -> bool {
        true
    }
}
