//! The control laws: plain values in, a velocity out. No I/O, no clock, no iceoryx2 in here.
//!
//! A law is one file and one row of [`LAWS`].

mod containment_tanh;
mod formation_tanh;
mod formation_unit;
mod leader_tanh;

use std::collections::BTreeMap;

use formation::Vec2;
use protocol::law::{LawDescription, Role};

/// What a law sees of the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Situation {
    /// e = alpha - alpha*, m, in `map`; alpha* is m(t) for a leader. (13) (32)
    pub error: Vec2,
    /// alpha*', m/s, in `map`.
    pub desired_velocity: Vec2,
    /// T, s.
    pub period_s: f64,
    /// a: how many periods old a neighbour's sample may normally be.
    pub age_periods: f64,
}

/// A control law: the nominal velocity gamma of the front point.
pub trait Law: Send {
    /// gamma, m/s, in `map`.
    fn gamma(&self, situation: &Situation) -> Vec2;
}

/// A row of [`LAWS`].
pub struct LawRow {
    /// Name, source and gains, as the supervisor may know them.
    pub description: LawDescription,
    /// Makes the law of its gains (all present and positive).
    pub build: fn(&Gains<'_>) -> Box<dyn Law>,
}

impl LawRow {
    /// The law with these gains: exactly its own, and all of them positive.
    pub fn make(&self, gains: &BTreeMap<String, f64>) -> Result<Box<dyn Law>, LawError> {
        let law = || self.description.name.to_owned();
        let mut expected: Vec<String> =
            self.description.gains.iter().map(|&key| key.into()).collect();
        expected.sort();
        if !gains.keys().eq(expected.iter()) {
            let found = gains.keys().cloned().collect();
            return Err(LawError::Gains { law: law(), expected, found });
        }
        if let Some((key, &value)) = gains.iter().find(|(_, v)| !(v.is_finite() && **v > 0.0)) {
            return Err(LawError::NotPositive { law: law(), key: key.clone(), value });
        }
        Ok((self.build)(&Gains(gains)))
    }
}

/// Every law there is.
pub const LAWS: &[LawRow] =
    &[formation_unit::ROW, leader_tanh::ROW, formation_tanh::ROW, containment_tanh::ROW];

/// Descriptions of every law, for the supervisor's diagnostics.
pub fn descriptions() -> Vec<LawDescription> {
    LAWS.iter().map(|row| row.description).collect()
}

/// The gains of a law by key.
pub struct Gains<'a>(&'a BTreeMap<String, f64>);

impl Gains<'_> {
    /// The gain called `key`. Panics if it was not checked to be there, see [`LawRow::make`].
    pub fn get(&self, key: &str) -> f64 {
        self.0[key]
    }
}

/// Why a law could not be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LawError {
    /// No row has this name.
    #[error("unknown law {name:?}, expected one of {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The gains are not exactly the law's.
    #[error("law {law:?} takes exactly the gains {expected:?}, got {found:?}")]
    Gains {
        /// Which law.
        law: String,
        /// Its gains.
        expected: Vec<String>,
        /// The gains given.
        found: Vec<String>,
    },
    /// A gain is not a positive number.
    #[error("gain {key} = {value} of law {law:?} must be positive")]
    NotPositive {
        /// Which law.
        law: String,
        /// Which gain.
        key: String,
        /// Its value.
        value: f64,
    },
}

/// The law called `name` with these gains.
pub fn build(name: &str, gains: &BTreeMap<String, f64>) -> Result<Box<dyn Law>, LawError> {
    let row = LAWS.iter().find(|row| row.description.name == name).ok_or_else(|| {
        let known: Vec<_> = LAWS.iter().map(|row| row.description.name).collect();
        LawError::Unknown { name: name.into(), known: known.join(", ") }
    })?;
    row.make(gains)
}

/// What the law called `name` makes of a robot. Panics for a name that [`build`] refuses.
pub fn role(name: &str) -> Role {
    let row = LAWS.iter().find(|row| row.description.name == name);
    row.expect("a law that was built").description.role
}

/// tanh of each component. (8)
fn tanh(e: Vec2) -> Vec2 {
    e.map(f64::tanh)
}
