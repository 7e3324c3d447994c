//! One run of a hunt as text: start poses, faults and gains.

use std::collections::BTreeSet;
use std::fmt::{self, Display};

use formation::ns_to_seconds;
use formation::pose::Pose;

use crate::campaign::starts::start_assignment;
use crate::scenario::Scenario;
use crate::scenario::read::Overrides;

/// Name that stands for all robots.
pub(super) const ALL_ROBOTS: &str = "*";

/// Component of a `lie` that changes the numbers of messages. The words of the fault name it on the command line.
pub(super) const MESSAGE_NUMBERS: &str = "message numbers";

/// Component of a `lie` that inverts bits of messages.
pub(super) const MESSAGE_BITS: &str = "message bits";

/// Changes that turn a scenario into a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunPlan {
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
    pub target_names: Vec<String>,
    /// Affected stream or sensor of the robot, or part of the messages that a `lie` changes. Empty for a fault of the
    /// whole target.
    pub target_component: &'static str,
    /// Further keywords of the fault, each with its number.
    pub parameters: Vec<(&'static str, Option<f64>)>,
    /// Start time, ns.
    pub start_ns: u64,
    /// Duration, ns; for a kill, the time until the restart. `None`: until the end of the run, or no restart.
    pub duration_ns: Option<u64>,
}

impl Display for PlannedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.kind, self.target_names.join("->"))?;
        if !["", MESSAGE_NUMBERS, MESSAGE_BITS].contains(&self.target_component) {
            write!(f, " {}", self.target_component)?;
        }
        for (word, amount) in &self.parameters {
            write!(f, " {word}")?;
            amount.map_or(Ok(()), |amount| write!(f, " {amount}"))?;
        }
        write!(f, " @{}", ns_to_seconds(self.start_ns))?;
        let word = if self.kind == "kill" { "restart" } else { "for" };
        self.duration_ns
            .map_or(Ok(()), |duration_ns| write!(f, " {word} {}", ns_to_seconds(duration_ns)))
    }
}

impl RunPlan {
    /// Returns the overrides that turn the scenario into this run.
    pub fn overrides(&self, scenario: &Scenario) -> Overrides {
        let start =
            |&(robot, pose): &(usize, Pose)| start_assignment(&scenario.robots[robot].name, pose);
        let gain = |(key, value): &(String, f64)| format!("{key}={value:?}");
        Overrides {
            assignments: self.starts.iter().map(start).chain(self.gains.iter().map(gain)).collect(),
            faults: self.faults.iter().map(ToString::to_string).collect(),
            seed: None,
        }
    }

    /// Returns the plan with only the faults that match one of `allowed` in kind, target and affected component.
    pub fn with_only_faults(mut self, allowed: &[PlannedFault]) -> RunPlan {
        let signature =
            |fault: &PlannedFault| (fault.kind, fault.target_names.clone(), fault.target_component);
        let mut remaining: Vec<_> = allowed.iter().map(signature).collect();
        self.faults.retain(|fault| {
            let index = remaining.iter().position(|other| *other == signature(fault));
            index.map(|index| remaining.remove(index)).is_some()
        });
        self
    }

    /// Returns the robot names in its faults, including `*`.
    pub(super) fn faulty_robot_names(&self) -> BTreeSet<&str> {
        self.faults.iter().flat_map(|fault| &fault.target_names).map(String::as_str).collect()
    }
}

/// Rounds a number to `digits` significant digits.
pub(super) fn round_to_digits(number: f64, digits: usize) -> f64 {
    format!("{number:.*e}", digits.saturating_sub(1)).parse().expect("a number")
}
