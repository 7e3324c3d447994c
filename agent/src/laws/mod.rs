//! The control laws: plain values in, a velocity out, without I/O and clock.
//!
//! A control law is one file and one row of [`LAWS`]. See `docs/add-a-law.md`.

mod formation_unit;
mod goal_unit;
pub mod situation;
mod tanh;

use std::collections::BTreeMap;

use formation::Vec2;
use formation::desired::Target;
use formation::portable_math;
use formation::pose::Twist;
use protocol::law::LawDescription;
pub use protocol::law_message::{MessageArray, MessageFormat, ReceivedMessage, SendDecision};
pub use protocol::signals::SignalValues;

pub use self::situation::{NeighborEstimate, Situation};
use crate::UnfitBrief;
pub use crate::gains::Gains;
use crate::roles::{CONTAINED_ROLE, FORMATION_ROLE, GOAL_ROLE, LEADER_ROLE, RoleRow};

/// A control law, which computes the nominal velocity (gamma) of the front point.
pub trait Law: Send {
    /// Returns the nominal velocity (gamma), m/s, in `map`. Called once for every odometry sample, in order,
    /// except while the robot has no desired position. A control law may keep state.
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2;

    /// Returns the output for the controller. The default is gamma. A low-level controller returns a twist
    /// instead.
    fn output(&mut self, situation: &Situation<'_>) -> LawOutput {
        LawOutput::Velocity(self.gamma(situation))
    }

    /// Returns the target of a free robot at this sample: desired position and velocity; `None` if it has
    /// no target. Called once after each [`Law::output`]; other roles ignore it.
    fn target(&mut self) -> Option<Target> {
        None
    }

    /// Returns what leaves to the out-neighbors with the answer just computed: the beacon, the beacon with a message,
    /// or nothing. Called once after each [`Law::output`]. A message must have the format that the row declares.
    fn send_decision(&mut self) -> SendDecision {
        SendDecision::Beacon
    }

    /// Returns the signals that the law records with the answer just computed, in the order of the row's `signals`.
    /// Called once after each [`Law::output`] if the row declares any.
    fn signals(&mut self) -> SignalValues {
        SignalValues::NONE
    }
}

/// Output of a control law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LawOutput {
    /// Velocity of the front point (gamma), m/s, in `map`. Avoidance steers around others.
    Velocity(Vec2),
    /// Twist of the body. Avoidance only bounds it, and the resulting velocity of the front point is published.
    Twist(Twist),
}

/// One row of [`LAWS`].
pub struct LawRow {
    /// Value of the scenario key `law`.
    pub name: &'static str,
    /// Role of a robot with this control law, which defines the desired position.
    pub role: RoleRow,
    /// Equation number in the chapter.
    pub source: &'static str,
    /// Keys of the gains, with unit suffixes. All of them are required and must be positive.
    pub gain_keys: &'static [&'static str],
    /// `true` if the law uses alpha*', which is computed from the published velocities of the in-neighbors.
    pub feed_forward: bool,
    /// Key of the gain, in m/s, that bounds each component of the correction added to alpha*' (or to 0 without
    /// feed-forward): k in Lemma 1, mu in Proposition 2. `None` if no gain bounds it.
    pub correction_max: Option<&'static str>,
    /// Format of the messages that the law sends with its beacons; `None` if it sends none.
    pub message_format: Option<&'static MessageFormat>,
    /// Whether the law may withhold its beacon, see [`Law::send_decision`].
    pub may_withhold_beacon: bool,
    /// Names of the signals that the law records, with the unit as suffix; at most [`SIGNALS_MAX`].
    ///
    /// [`SIGNALS_MAX`]: protocol::signals::SIGNALS_MAX
    pub signals: &'static [&'static str],
    /// Creates the law from its gains, which are all present and positive.
    pub build: fn(&Gains<'_>) -> Box<dyn Law>,
}

impl LawRow {
    /// Creates the law with these gains. Returns an error if a gain is missing, unknown or not positive.
    pub fn make(&self, gains: &BTreeMap<String, f64>) -> Result<Box<dyn Law>, UnfitBrief> {
        let of = format!("law {:?}", self.name);
        Ok((self.build)(&Gains::check(gains, &of, self.gain_keys.iter().copied())?))
    }

    /// Returns the part of the row that is published to the supervisor.
    pub fn description(&self) -> LawDescription {
        let &LawRow { name, role, source, gain_keys: gains, feed_forward, correction_max, .. } =
            self;
        let (role, message, withholds) =
            (role.description, self.message_format, self.may_withhold_beacon);
        let signals = self.signals;
        LawDescription {
            name,
            role,
            source,
            gain_keys: gains,
            feed_forward,
            correction_max,
            gain_ranges: &[],
            queued_messages_max: 0,
            params: None,
            message_format: message,
            may_withhold_beacon: withholds,
            signals,
        }
    }
}

/// All control laws.
pub const LAWS: &[LawRow] = &[
    formation_unit::LAW,
    tanh::LEADER_TANH,
    tanh::FORMATION_TANH,
    tanh::FORMATION_ROBUST,
    tanh::CONTAINMENT_TANH,
    goal_unit::LAW,
    tanh::GOAL_TANH,
];

/// Returns the row of the built-in control law `name`, or an error that lists the known names.
pub fn find_row(name: &str) -> Result<&'static LawRow, UnfitBrief> {
    find_row_with(name, &[])
}

/// Returns the row of the control law `name` among the built-in ones and `added`, or an error that lists the known
/// names.
pub fn find_row_with<'a>(name: &str, added: &'a [LawRow]) -> Result<&'a LawRow, UnfitBrief> {
    let rows = || LAWS.iter().chain(added);
    rows().find(|row| row.name == name).ok_or_else(|| {
        let known: Vec<_> = rows().map(|row| row.name).collect();
        UnfitBrief(format!("unknown law {name:?}, expected one of {}", known.join(", ")))
    })
}

/// Returns tanh of each component. (8)
fn tanh(e: Vec2) -> Vec2 {
    e.map(portable_math::tanh)
}
