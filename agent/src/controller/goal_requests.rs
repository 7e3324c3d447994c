//! Goals that external clients send to a robot with the goal role.

use protocol::message::Goal;

use crate::roles::Role;

/// The pending goal and the current goal.
#[derive(Debug, Default)]
pub(super) struct GoalRequests {
    /// Goal that takes effect at the next sample.
    pending_goal: Option<Goal>,
    /// Current goal and the run time at which it took effect, ns. `None` means the goal of the brief.
    goal_in_force: Option<(Goal, u64)>,
}

impl GoalRequests {
    /// Stores a goal, unless it is implausible or not newer than the previous one.
    pub(super) fn store_goal(&mut self, goal: &Goal) {
        let newest = self.pending_goal.or(self.goal_in_force.map(|(goal, _)| goal));
        if goal.is_plausible() && newest.is_none_or(|newest| goal.stamp_ns > newest.stamp_ns) {
            self.pending_goal = Some(*goal);
        }
    }

    /// Applies the pending goal at a sample with the run time `t_ns`, ns, if the role accepts it. Returns
    /// whether it was applied.
    pub(super) fn apply_pending_goal(&mut self, role: &mut dyn Role, t_ns: u64) -> bool {
        let goal = self.pending_goal.take().filter(|goal| role.set_goal(goal.position()));
        let applied = goal.is_some();
        self.goal_in_force = goal.map(|goal| (goal, t_ns)).or(self.goal_in_force);
        applied
    }

    /// Returns the current goal and the run time at which it took effect, ns. Both are 0 while no goal has
    /// replaced the one in the brief.
    pub(super) fn goal_in_force(&self) -> (Goal, u64) {
        self.goal_in_force.unwrap_or_default()
    }
}
