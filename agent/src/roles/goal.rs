//! Goes to a place of its own in `map`, whomever it hears. Not in the paper: the scenes by which
//! avoidance methods are compared ask for it.

use formation::Vec2;
use formation::desired::Target;
use protocol::brief::AgentBrief;

use super::{Moment, Role, RoleRow};
use crate::UnfitBrief;
use crate::laws::situation::Heard;

/// The row of those that go to goals.
pub const GOAL: RoleRow = RoleRow {
    description: protocol::law::Role::GOAL,
    build: |brief: &AgentBrief| {
        let why = || format!("{} goes to a goal, but its brief has no goal_m", brief.name);
        let goal_m = brief.goal_m.ok_or_else(|| UnfitBrief(why()))?;
        Ok(Box::new(Goal { goal: goal_m.into() }))
    },
};

struct Goal {
    /// m, in `map`.
    goal: Vec2,
}

impl Role for Goal {
    fn target(&mut self, moment: &Moment<'_>, heard: &mut Vec<Heard>) -> Option<Target> {
        moment.recall_without_offsets(heard);
        Some(Target::still(self.goal))
    }

    fn go_to(&mut self, place: Vec2) -> bool {
        self.goal = place;
        true
    }
}
