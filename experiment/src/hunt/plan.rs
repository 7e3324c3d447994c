//! One run of a hunt as text: start poses, faults and gains.

use std::collections::BTreeSet;
use std::fmt::{self, Display};

use formation::pose::Pose;
use formation::seconds;

use crate::campaign::starts::start_assignment;
use crate::scenario::Scenario;
use crate::scenario::read::Overrides;

/// Name that stands for all robots.
pub(super) const EVERY: &str = "*";

/// Changes that turn a scenario into a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// Indices and start poses of the robots with changed starts.
    pub starts: Vec<(usize, Pose)>,
    /// Injected faults.
    pub faults: Vec<PlannedFault>,
    /// Changed gains, with keys in the syntax of `--set`.
    pub gains: Vec<(String, f64)>,
}

/// A planned fault, split into the parts that `--fault` takes.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedFault {
    /// Kind, the first word.
    pub kind: &'static str,
    /// Names of the affected robot, or of the sender and the receiver of a link. `*` stands for all robots.
    pub who: Vec<String>,
    /// Affected stream or sensor of the robot, or "".
    pub what: &'static str,
    /// Further keywords of the fault, each with its number.
    pub amounts: Vec<(&'static str, Option<f64>)>,
    /// Start time, ns.
    pub at_ns: u64,
    /// Duration, ns; for a kill, the time until the restart. `None`: until the end of the run, or no restart.
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
    /// Returns the overrides that turn the scenario into this run.
    pub fn overrides(&self, scenario: &Scenario) -> Overrides {
        let start =
            |&(robot, pose): &(usize, Pose)| start_assignment(&scenario.robots[robot].name, pose);
        let gain = |(key, value): &(String, f64)| format!("{key}={value:?}");
        Overrides {
            set: self.starts.iter().map(start).chain(self.gains.iter().map(gain)).collect(),
            faults: self.faults.iter().map(ToString::to_string).collect(),
            seed: None,
        }
    }

    /// Returns the plan with only the faults that match one of `kept` in kind and affected component.
    pub fn with_only(mut self, kept: &[PlannedFault]) -> Plan {
        let what = |fault: &PlannedFault| (fault.kind, fault.who.clone(), fault.what);
        let mut left: Vec<_> = kept.iter().map(what).collect();
        self.faults.retain(|fault| {
            let place = left.iter().position(|kept| *kept == what(fault));
            place.map(|place| left.remove(place)).is_some()
        });
        self
    }

    /// Returns the robot names in its faults, including `*`.
    pub(super) fn faulty_robot_names(&self) -> BTreeSet<&str> {
        self.faults.iter().flat_map(|fault| &fault.who).map(String::as_str).collect()
    }
}

/// Rounds a number to `digits` significant digits.
pub(super) fn round_to_digits(number: f64, digits: usize) -> f64 {
    format!("{number:.*e}", digits.saturating_sub(1)).parse().expect("a number")
}
