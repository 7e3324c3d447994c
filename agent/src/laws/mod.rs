//! The control laws: plain values in, a velocity out. No I/O, no clock, no iceoryx2 in here.
//!
//! A law is one file and one row of [`LAWS`]; `docs/add-a-law.md` shows how.

mod formation_unit;
mod goal_unit;
pub mod situation;
mod tanh;

use std::collections::BTreeMap;

use formation::Vec2;
use formation::pose::Twist;
use formation::real;
use protocol::law::LawDescription;

pub use self::situation::{Heard, Situation};
use crate::UnfitBrief;
pub use crate::gains::Gains;
use crate::roles::{CONTAINED, FORMATION, GOAL, LEADER, RoleRow};

/// A control law: the nominal velocity gamma of the front point.
pub trait Law: Send {
    /// gamma, m/s, in `map`. Asked once for every odometry sample, in their order, but not while
    /// the robot has nothing to go by: a law may keep state.
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2;

    /// What the brain asks for, in the place of gamma: a controller, one level lower, answers a
    /// twist.
    fn wish(&mut self, situation: &Situation<'_>) -> Wish {
        Wish::Velocity(self.gamma(situation))
    }
}

/// What a law wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wish {
    /// gamma: a velocity of the front point, m/s, in `map`. Avoidance finds the way there.
    Velocity(Vec2),
    /// A twist. Avoidance only bounds it; what is published is the velocity that it gives the front
    /// point.
    Twist(Twist),
}

/// A row of [`LAWS`].
pub struct LawRow {
    /// Value of the key `law`.
    pub name: &'static str,
    /// What it makes of a robot: what the error is measured against.
    pub role: RoleRow,
    /// Which equation it is.
    pub source: &'static str,
    /// Keys of its gains, with unit suffixes. All must be given, and positive.
    pub gains: &'static [&'static str],
    /// Whether it uses alpha*', which a robot knows by the published velocities of those it hears.
    pub feed_forward: bool,
    /// Key of the gain, in m/s, that bounds each component of what it adds to alpha*' (or to 0,
    /// without feed-forward): k in Lemma 1, mu in Proposition 2. `None`: no gain bounds it.
    pub correction_max: Option<&'static str>,
    /// Makes the law of its gains (all present and positive).
    pub build: fn(&Gains<'_>) -> Box<dyn Law>,
}

impl LawRow {
    /// The law with these gains: exactly its own, and all of them positive.
    pub fn make(&self, gains: &BTreeMap<String, f64>) -> Result<Box<dyn Law>, UnfitBrief> {
        let of = format!("law {:?}", self.name);
        Ok((self.build)(&Gains::check(gains, &of, self.gains.iter().map(|&key| (key, true)))?))
    }

    /// What the supervisor may know of it.
    pub fn description(&self) -> LawDescription {
        let &LawRow { name, role, source, gains, feed_forward, correction_max, .. } = self;
        let role = role.description;
        LawDescription { name, role, source, gains, feed_forward, correction_max }
    }
}

/// Every law there is.
pub const LAWS: &[LawRow] = &[
    formation_unit::ROW,
    tanh::LEADER_TANH,
    tanh::FORMATION_TANH,
    tanh::FORMATION_ROBUST,
    tanh::CONTAINMENT_TANH,
    goal_unit::ROW,
    tanh::GOAL_TANH,
];

/// The row of the law called `name`.
pub fn row(name: &str) -> Result<&'static LawRow, UnfitBrief> {
    LAWS.iter().find(|row| row.name == name).ok_or_else(|| {
        let known: Vec<_> = LAWS.iter().map(|row| row.name).collect();
        UnfitBrief(format!("unknown law {name:?}, expected one of {}", known.join(", ")))
    })
}

/// tanh of each component. (8)
fn tanh(e: Vec2) -> Vec2 {
    e.map(real::tanh)
}
