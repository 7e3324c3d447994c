//! Where somebody outside sends a robot that goes to a goal.

use protocol::message::Goal;

use crate::roles::Role;

/// What was asked for, and what is in force.
#[derive(Debug, Default)]
pub(super) struct Sent {
    /// Until the next sample.
    asked: Option<Goal>,
    /// And since when of the run's time, ns; without, the brief's goal is.
    in_force: Option<(Goal, u64)>,
}

impl Sent {
    /// Takes a goal, unless it is no newer than what was asked for before.
    pub(super) fn ask(&mut self, goal: &Goal) {
        let newest = self.asked.or(self.in_force.map(|(goal, _)| goal));
        if goal.is_plausible() && newest.is_none_or(|newest| goal.stamp_ns > newest.stamp_ns) {
            self.asked = Some(*goal);
        }
    }

    /// At a sample of this run time, ns: what was asked for is in force if the role goes there. Whether it is.
    pub(super) fn apply(&mut self, role: &mut dyn Role, t_ns: u64) -> bool {
        let goal = self.asked.take().filter(|goal| role.go_to(goal.position()));
        let sent = goal.is_some();
        self.in_force = goal.map(|goal| (goal, t_ns)).or(self.in_force);
        sent
    }

    /// The goal in force and since when of the run's time, ns; all 0 if that is the brief's.
    pub(super) fn in_force(&self) -> (Goal, u64) {
        self.in_force.unwrap_or_default()
    }
}
