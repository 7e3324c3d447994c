//! Goals that external clients send to a robot with the goal role.

use protocol::message::Goal;

use crate::roles::Role;

/// The pending goal and the current goal.
#[derive(Debug, Default)]
pub(super) struct GoalRequests {
    /// Goal that takes effect at the next sample.
    pending: Option<Goal>,
    /// Current goal and the run time at which it took effect, ns. `None` means the goal of the brief.
    in_force: Option<(Goal, u64)>,
}

impl GoalRequests {
    /// Stores a goal, unless it is implausible or not newer than the previous one.
    pub(super) fn request(&mut self, goal: &Goal) {
        let newest = self.pending.or(self.in_force.map(|(goal, _)| goal));
        if goal.is_plausible() && newest.is_none_or(|newest| goal.stamp_ns > newest.stamp_ns) {
            self.pending = Some(*goal);
        }
    }

    /// Applies the pending goal at a sample with the run time `t_ns`, ns, if the role accepts it. Returns
    /// whether it was applied.
    pub(super) fn apply(&mut self, role: &mut dyn Role, t_ns: u64) -> bool {
        let goal = self.pending.take().filter(|goal| role.go_to(goal.position()));
        let applied = goal.is_some();
        self.in_force = goal.map(|goal| (goal, t_ns)).or(self.in_force);
        applied
    }

    /// Returns the current goal and the run time at which it took effect, ns. Both are 0 while no goal has
    /// replaced the one in the brief.
    pub(super) fn in_force(&self) -> (Goal, u64) {
        self.in_force.unwrap_or_default()
    }
}
