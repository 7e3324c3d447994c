//! Roles: the desired position of the front point, and whether other robots' offsets rotate and scale with the
//! robot. No I/O, no clock.
//!
//! A role is one file, and the row that its control laws name. See `docs/add-a-role.md`.

mod contained;
mod deputy;
mod formation;
mod free;
mod goal;
mod leader;
mod nominal_frame;

use ::formation::Vec2;
use ::formation::desired::Target;
use ::formation::frame::LeaderFrame;
use ::formation::pose::Pose;
use protocol::brief::AgentBrief;

pub use self::contained::CONTAINED_ROLE;
pub use self::formation::FORMATION_ROLE;
pub use self::free::FREE_ROLE;
pub use self::goal::GOAL_ROLE;
pub use self::leader::LEADER_ROLE;
use crate::UnfitBrief;
use crate::avoidance::Avoidance;
use crate::laws::situation::NeighborEstimate;
use crate::neighborhood::Neighborhood;

/// Input of a role, from one odometry sample.
pub struct RoleInput<'a> {
    /// Stamp of the sample, ns.
    pub stamp_ns: u64,
    /// Time since the start of the run, s.
    pub t_s: f64,
    /// Own pose at the stamp.
    pub pose: Pose,
    /// In-neighbors with their communication states.
    pub neighborhood: &'a Neighborhood,
}

impl RoleInput<'_> {
    /// Fills `estimates` for the control law of a role that uses no offsets.
    fn estimate_without_offsets(&self, estimates: &mut Vec<NeighborEstimate>) {
        self.neighborhood.estimate_neighbors(
            self.stamp_ns,
            |_| Target::at_rest(Vec2::zeros()),
            estimates,
        );
    }

    /// Returns the run time at another stamp, s.
    fn run_time_s(&self, stamp_ns: u64) -> f64 {
        self.t_s - (self.stamp_ns as i64 - stamp_ns as i64) as f64 / 1e9
    }
}

/// Returns a function that maps c_ji to C_ji(t) by the frame at a sample, and to C'_ji by the frame half a
/// period later.
fn offset_function(frame: LeaderFrame, later: LeaderFrame) -> impl Fn(Vec2) -> Target {
    let (frame, later) = (frame.offset_transform(), later.offset_transform());
    move |c_ji| Target {
        position: frame.apply(c_ji).position,
        velocity: later.apply(c_ji).velocity,
    }
}

/// A role of a robot.
pub trait Role: Send {
    /// Returns alpha* at the sample, and alpha*' half a period later, because the answer acts for one period
    /// and the velocity at its middle is the best constant approximation. Returns `None` if the robot has no
    /// desired position and has to stop. `estimates` is filled for the control law, see
    /// [`Neighborhood::estimate_neighbors`].
    fn target(
        &mut self,
        input: &RoleInput<'_>,
        estimates: &mut Vec<NeighborEstimate>,
    ) -> Option<Target>;

    /// Sends the robot to `goal`, m, from now on. Returns whether it goes there. Only the goal role does.
    fn set_goal(&mut self, goal: Vec2) -> bool {
        let _ = goal;
        false
    }

    /// Returns whether the control law names the target, see [`crate::laws::Law::target`], in place of this role.
    fn asks_law_for_target(&self) -> bool {
        false
    }

    /// Returns the frame with which offsets rotate and scale, at the sample, if it is this robot's own.
    /// Otherwise the robot relays the frame that it receives.
    fn formation_frame(
        &mut self,
        input: &RoleInput<'_>,
        avoidance: &dyn Avoidance,
    ) -> Option<LeaderFrame> {
        let _ = (input, avoidance);
        None
    }
}

/// One row of [`ROLES`].
#[derive(Clone, Copy)]
pub struct RoleRow {
    /// Description that is published to the supervisor.
    pub description: protocol::law::Role,
    /// Creates the role from a brief.
    pub build: fn(&AgentBrief) -> Result<Box<dyn Role>, UnfitBrief>,
}

impl RoleRow {
    /// Creates the role for the robot of this brief. Returns an error if the brief does not contain a value
    /// that the role needs.
    pub fn make(&self, brief: &AgentBrief) -> Result<Box<dyn Role>, UnfitBrief> {
        (self.build)(brief)
    }
}

/// Table of all roles.
pub const ROLES: &[RoleRow] = &[LEADER_ROLE, FORMATION_ROLE, CONTAINED_ROLE, GOAL_ROLE, FREE_ROLE];

/// Returns the row of the role `name`, or an error that lists the known names.
pub fn find_row(name: &str) -> Result<RoleRow, UnfitBrief> {
    let found = ROLES.iter().find(|row| row.description.name == name);
    found.copied().ok_or_else(|| {
        let known: Vec<_> = ROLES.iter().map(|row| row.description.name).collect();
        UnfitBrief(format!("unknown role {name:?}, expected one of {}", known.join(", ")))
    })
}
