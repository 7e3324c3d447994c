//! Robot with a goal: moves to a fixed position in `map`, independent of its in-neighbors. An addition to the
//! chapter, used by the scenes that compare avoidance methods.

use formation::Vec2;
use formation::desired::Target;
use protocol::brief::AgentBrief;

use super::{Role, RoleInput, RoleRow};
use crate::UnfitBrief;
use crate::laws::situation::NeighborEstimate;

/// Row of the goal role.
pub const GOAL_ROLE: RoleRow = RoleRow {
    description: protocol::law::Role::GOAL,
    build: |brief: &AgentBrief| {
        let why = || format!("{} goes to a goal, but its brief has no goal_m", brief.name);
        let goal_m = brief.goal_m.ok_or_else(|| UnfitBrief(why()))?;
        Ok(Box::new(GoalRole { goal: goal_m.into() }))
    },
};

struct GoalRole {
    /// Goal position in `map`, m.
    goal: Vec2,
}

impl Role for GoalRole {
    fn target(
        &mut self,
        input: &RoleInput<'_>,
        estimates: &mut Vec<NeighborEstimate>,
    ) -> Option<Target> {
        input.estimate_without_offsets(estimates);
        Some(Target::at_rest(self.goal))
    }

    fn set_goal(&mut self, goal: Vec2) -> bool {
        self.goal = goal;
        true
    }
}
