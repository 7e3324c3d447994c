//! What breaks when, in words: on the command line, `kill r2 @10 restart 2`, and in reports.
//!
//! Here only the words are read. Whether there is such a robot, and whether it is alive then, is
//! asked where faults of the file are read too: both become the same `[[fault]]` tables.

use protocol::fault::{LinkFaultKind, Sensor, SensorFaultKind, WheelFaultKind};
use toml_edit::{Table, value};

use super::{Fault, FaultKind, Scenario, seconds as in_seconds};
use crate::metrics::fault::Struck;

/// How a fault is written on the command line.
pub const GRAMMAR: &str = "kill ROBOT @SECONDS [restart SECONDS]";

impl Fault {
    /// What it is and for how long, in words.
    pub fn words(&self, scenario: &Scenario) -> String {
        let (what, _) = self.kind.struck(scenario);
        let lasts = |ns| format!("{} s", in_seconds(ns));
        match (&self.kind, self.for_ns) {
            (FaultKind::KillPlant, _) => what,
            (FaultKind::Kill { restart_after_ns: None, .. }, _) => format!("{what}, for good"),
            (FaultKind::Kill { restart_after_ns: Some(after_ns), .. }, _) => {
                format!("{what}, back after {}", lasts(*after_ns))
            }
            (_, None) => format!("{what}, to the end"),
            (_, Some(for_ns)) => format!("{what}, for {}", lasts(for_ns)),
        }
    }
}

impl FaultKind {
    /// What it is, in words, and whom it strikes.
    pub fn struck(&self, scenario: &Scenario) -> (String, Struck) {
        let name = |robot: usize| scenario.robots[robot].name.as_str();
        let silent = |robot| Struck { robot: Some(robot), hearer: None };
        match *self {
            FaultKind::Kill { robot, .. } => (format!("kill {}", name(robot)), silent(robot)),
            FaultKind::KillPlant => ("kill plant".to_owned(), Struck::default()),
            FaultKind::Freeze { robot } => (format!("freeze {}", name(robot)), silent(robot)),
            FaultKind::Slow { robot, delay_ns } => {
                (format!("slow {} by {}", name(robot), in_seconds(delay_ns)), silent(robot))
            }
            FaultKind::Link { edge, ref kind } => {
                let edge = scenario.graph.edges()[edge];
                let link = format!("{}->{}", name(edge.from), name(edge.to));
                let what = match *kind {
                    LinkFaultKind::Cut => format!("cut {link}"),
                    LinkFaultKind::Loss { probability, burst: 1 } => {
                        format!("loss {link} of {probability}")
                    }
                    LinkFaultKind::Loss { probability, burst } => {
                        format!("loss {link} of {probability} burst {burst}")
                    }
                    LinkFaultKind::Delay { delay_ns, jitter_ns: 0 } => {
                        format!("delay {link} by {}", in_seconds(delay_ns))
                    }
                    LinkFaultKind::Delay { delay_ns, jitter_ns } => {
                        let (by_s, jitter_s) = (in_seconds(delay_ns), in_seconds(jitter_ns));
                        format!("delay {link} by {by_s} jitter {jitter_s}")
                    }
                };
                (what, Struck { robot: Some(edge.from), hearer: Some(edge.to) })
            }
            FaultKind::Sensor { robot, sensor, kind } => {
                let sensor = match sensor {
                    Sensor::Odometry => "odometry",
                    Sensor::Proximity => "proximity",
                };
                let what = match kind {
                    SensorFaultKind::Blackout => format!("blackout {} {sensor}", name(robot)),
                    SensorFaultKind::Noise { bound_m } => {
                        format!("noise {} {sensor} by {bound_m}", name(robot))
                    }
                };
                (what, silent(robot))
            }
            FaultKind::Wheels { robot, kind } => {
                let what = match kind {
                    WheelFaultKind::Stuck => format!("wheels {} stuck", name(robot)),
                    WheelFaultKind::Limit { speed_max_m_s } => {
                        format!("wheels {} limit {speed_max_m_s}", name(robot))
                    }
                };
                (what, silent(robot))
            }
            FaultKind::Load { processes } => (format!("load {processes}"), Struck::default()),
        }
    }

    /// Whether it acts in agents or plant by their briefs, with nobody doing anything.
    pub fn acts_by_brief(&self) -> bool {
        match self {
            FaultKind::Slow { .. }
            | FaultKind::Link { .. }
            | FaultKind::Sensor { .. }
            | FaultKind::Wheels { .. } => true,
            FaultKind::Kill { .. }
            | FaultKind::KillPlant
            | FaultKind::Freeze { .. }
            | FaultKind::Load { .. } => false,
        }
    }
}

/// Why an argument is no fault.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct FaultError {
    reason: String,
}

/// The keys of the `[[fault]]` table that `argument` stands for.
pub fn parse(argument: &str) -> Result<Table, FaultError> {
    let words: Vec<&str> = argument.split_whitespace().collect();
    let (robot, at, restart) = match words[..] {
        ["kill", robot, at] => (robot, at, None),
        ["kill", robot, at, "restart", after] => (robot, at, Some(after)),
        ["kill", _, _, "restart"] => return Err(wrong("`restart` needs seconds after it")),
        ["kill", _, _, word, ..] if word != "restart" => {
            return Err(wrong(format!("`{word}` stands where only `restart` may")));
        }
        ["kill", _, _, _, _, word, ..] => {
            return Err(wrong(format!("`{word}` is one word too many")));
        }
        ["kill", ..] => return Err(wrong("`kill` needs a robot and a time")),
        [word, ..] => return Err(wrong(format!("there is no fault `{word}`"))),
        [] => return Err(wrong("it is empty")),
    };
    let at_s = at
        .strip_prefix('@')
        .ok_or_else(|| wrong(format!("the time `{at}` does not begin with `@`")))?;
    let mut table = Table::new();
    table["at_s"] = value(seconds(at_s)?);
    table["kind"] = value("kill");
    table["robot"] = value(robot);
    if let Some(after) = restart {
        table["restart_after_s"] = value(seconds(after)?);
    }
    Ok(table)
}

/// A number of seconds, written as Rust writes one.
fn seconds(word: &str) -> Result<f64, FaultError> {
    match word.parse::<f64>() {
        Ok(number) if number.is_finite() && number >= 0.0 => Ok(number),
        _ => Err(wrong(format!("`{word}` is not a number of seconds from 0"))),
    }
}

fn wrong(reason: impl Into<String>) -> FaultError {
    FaultError { reason: reason.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kill_becomes_the_table_that_a_file_would_hold() {
        let with = parse("kill r2 @10 restart 2").unwrap().to_string();
        assert_eq!(with, "at_s = 10.0\nkind = \"kill\"\nrobot = \"r2\"\nrestart_after_s = 2.0\n");
        let without = parse("  kill r2   @0.5").unwrap().to_string();
        assert_eq!(without, "at_s = 0.5\nkind = \"kill\"\nrobot = \"r2\"\n");
    }

    #[test]
    fn each_mistake_is_named() {
        for (argument, word) in [
            ("", "empty"),
            ("explode r2 @1", "no fault `explode`"),
            ("kill", "needs a robot"),
            ("kill r2", "needs a robot"),
            ("kill r2 10", "`10` does not begin with `@`"),
            ("kill r2 @ten", "`ten` is not a number"),
            ("kill r2 @inf", "`inf` is not a number"),
            ("kill r2 @-1", "`-1` is not a number"),
            ("kill r2 @1 restart", "needs seconds"),
            ("kill r2 @1 again 2", "`again` stands where"),
            ("kill r2 @1 restart 2 3", "`3` is one word too many"),
        ] {
            let error = parse(argument).unwrap_err().to_string();
            assert!(error.contains(word), "{argument}: {error}");
        }
    }
}
