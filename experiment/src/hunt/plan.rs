//! One run of a hunt as people read it: who starts where, what breaks, with which gains.

use std::collections::BTreeSet;
use std::fmt::{self, Display};

use formation::pose::Pose;
use formation::seconds;

use crate::campaign::starts::starts_at;
use crate::scenario::Scenario;
use crate::scenario::read::Overrides;

/// In place of a robot's name: every one.
pub(super) const EVERY: &str = "*";

/// What makes a run of a scenario.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// Robots that start elsewhere, by their places, and where.
    pub starts: Vec<(usize, Pose)>,
    /// What breaks.
    pub faults: Vec<PlannedFault>,
    /// Gains that are others: keys as `--set` has them.
    pub gains: Vec<(String, f64)>,
}

/// A fault, as `--fault` has it.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedFault {
    /// Its first word.
    pub kind: &'static str,
    /// Whom it strikes: a robot, or who is heard and who hears; `*` for each.
    pub who: Vec<String>,
    /// Which stream or sensor of a robot; "" for none.
    pub what: &'static str,
    /// Words and their numbers.
    pub amounts: Vec<(&'static str, Option<f64>)>,
    /// When it begins, ns.
    pub at_ns: u64,
    /// How long it lasts, ns; `None`: to the end, or, of a kill, it has no length.
    pub for_ns: Option<u64>,
}

impl Display for PlannedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.kind, self.who.join("->"))?;
        if !self.what.is_empty() {
            write!(f, " {}", self.what)?;
        }
        for (word, amount) in &self.amounts {
            write!(f, " {word}")?;
            amount.map_or(Ok(()), |amount| write!(f, " {amount}"))?;
        }
        write!(f, " @{}", seconds(self.at_ns))?;
        let word = if self.kind == "kill" { "restart" } else { "for" };
        self.for_ns.map_or(Ok(()), |for_ns| write!(f, " {word} {}", seconds(for_ns)))
    }
}

impl Plan {
    /// What makes it of the scenario.
    pub fn overrides(&self, scenario: &Scenario) -> Overrides {
        let start = |&(robot, pose): &(usize, Pose)| starts_at(&scenario.robots[robot].name, pose);
        let gain = |(key, value): &(String, f64)| format!("{key}={value:?}");
        Overrides {
            set: self.starts.iter().map(start).chain(self.gains.iter().map(gain)).collect(),
            faults: self.faults.iter().map(ToString::to_string).collect(),
            seed: None,
        }
    }

    /// The same with those faults alone whose kind, and whom and what it strikes, is that of one of these.
    pub fn with_only(mut self, kept: &[PlannedFault]) -> Plan {
        let what = |fault: &PlannedFault| (fault.kind, fault.who.clone(), fault.what);
        let mut left: Vec<_> = kept.iter().map(what).collect();
        self.faults.retain(|fault| {
            let place = left.iter().position(|kept| *kept == what(fault));
            place.map(|place| left.remove(place)).is_some()
        });
        self
    }

    /// The names in its faults; `*` is one.
    pub(super) fn struck(&self) -> BTreeSet<&str> {
        self.faults.iter().flat_map(|fault| &fault.who).map(String::as_str).collect()
    }
}

/// A number cut to so many significant digits.
pub(super) fn rounded(number: f64, digits: usize) -> f64 {
    format!("{number:.*e}", digits.saturating_sub(1)).parse().expect("a number")
}
