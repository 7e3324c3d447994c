//! What a law makes of a robot: where its front point is to be, and whether others turn and grow
//! with it. No I/O, no clock, no iceoryx2 in here.
//!
//! A role is one file, and the row that its laws name. `docs/add-a-role.md` shows how.

mod contained;
mod deputy;
mod formation;
mod goal;
mod leader;
mod nominal_frame;

use ::formation::Vec2;
use ::formation::desired::Target;
use ::formation::frame::LeaderFrame;
use ::formation::pose::Pose;
use protocol::brief::AgentBrief;

pub use self::contained::CONTAINED;
pub use self::formation::FORMATION;
pub use self::goal::GOAL;
pub use self::leader::LEADER;
use crate::UnfitBrief;
use crate::avoidance::Avoidance;
use crate::laws::situation::Heard;
use crate::neighborhood::Neighborhood;

/// One odometry sample as a role sees it.
pub struct Moment<'a> {
    /// When it was sensed, ns.
    pub stamp_ns: u64,
    /// Time since the run's start, s.
    pub t_s: f64,
    /// Own pose.
    pub pose: Pose,
    /// Those heard.
    pub neighborhood: &'a Neighborhood,
}

impl Moment<'_> {
    /// Fills `heard` for the law of a role that asks nobody where it is to be seen from them.
    fn recall_without_offsets(&self, heard: &mut Vec<Heard>) {
        self.neighborhood.recall(self.stamp_ns, |_| Target::still(Vec2::zeros()), heard);
    }

    /// The run's time at another stamp, s.
    fn t_of_s(&self, stamp_ns: u64) -> f64 {
        self.t_s - (self.stamp_ns as i64 - stamp_ns as i64) as f64 / 1e9
    }
}

/// C_ji(t) by the frame at a sample, and C'_ji by that half a period later.
fn offsets(frame: LeaderFrame, later: LeaderFrame) -> impl Fn(Vec2) -> Target {
    move |c_ji| Target {
        position: frame.offset(c_ji).position,
        velocity: later.offset(c_ji).velocity,
    }
}

/// A role.
pub trait Role: Send {
    /// alpha* at the sample, and alpha*' half a period later: the answer acts for a period, and
    /// what is known of the velocities to come is taken at its middle. `None`: nothing to go by, so
    /// stop. `heard` is filled for the law, see [`Neighborhood::recall`].
    fn target(&mut self, moment: &Moment<'_>, heard: &mut Vec<Heard>) -> Option<Target>;

    /// Somebody outside sends it to this place, m, from now on; whether it goes there. Only a role that goes to
    /// a goal does.
    fn go_to(&mut self, place: Vec2) -> bool {
        let _ = place;
        false
    }

    /// The frame that offsets turn and grow with, at the sample, if it is this robot's own. Without
    /// one the robot passes on what it hears.
    fn frame(&mut self, moment: &Moment<'_>, avoidance: &dyn Avoidance) -> Option<LeaderFrame> {
        let _ = (moment, avoidance);
        None
    }
}

/// The row of a role.
#[derive(Clone, Copy)]
pub struct RoleRow {
    /// What the supervisor may know of it.
    pub description: protocol::law::Role,
    /// Makes it of a brief.
    pub build: fn(&AgentBrief) -> Result<Box<dyn Role>, UnfitBrief>,
}

impl RoleRow {
    /// The role for the robot of this brief.
    pub fn make(&self, brief: &AgentBrief) -> Result<Box<dyn Role>, UnfitBrief> {
        (self.build)(brief)
    }
}

/// Every role there is.
pub const ROLES: &[RoleRow] = &[LEADER, FORMATION, CONTAINED, GOAL];

/// The row of the role that files call `name`.
pub fn row(name: &str) -> Result<RoleRow, UnfitBrief> {
    let found = ROLES.iter().find(|row| row.description.name == name);
    found.copied().ok_or_else(|| {
        let known: Vec<_> = ROLES.iter().map(|row| row.description.name).collect();
        UnfitBrief(format!("unknown role {name:?}, expected one of {}", known.join(", ")))
    })
}
