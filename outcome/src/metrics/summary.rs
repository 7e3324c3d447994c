//! What came out of a run, as `summary.json` has it: the run writes it, its report reads it.
//!
//! Everything that depends on wall time is in the section `wall`. What is outside is, in lockstep, a
//! function of the run alone. A file of another version may lack keys or have more: what is missing
//! counts as not known.

mod by_name;

use std::ops::{Add, AddAssign, Sub};

use protocol::brief::Pace;
pub use protocol::stage::Cause;
use protocol::stage::Stage;
use serde::{Deserialize, Serialize};

use crate::metrics::clearance::Clearance;
use crate::metrics::expect::Expectation;
use crate::metrics::fault::FaultReport;
use crate::metrics::waits::Wait;

/// The content of `summary.json`. What never came about is `null`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Summary {
    /// The scenario's name.
    pub scenario: String,
    /// How time passed.
    pub pace: Pace,
    /// The exit code.
    pub exit: u8,
    /// A signal ended the run.
    pub interrupted: bool,
    /// How often somebody acted on it through the live view.
    pub acts_by_hand: u64,
    /// Run time reached, s.
    pub t_s: f64,
    /// It ended before `duration_s`: it had been converged for `end_after_converged_s`.
    pub ended_early: bool,
    /// Plant ticks.
    pub ticks: u64,
    /// In lockstep: equal if and only if two runs are the same bit by bit.
    pub trajectory_hash: Option<String>,
    /// In lockstep: entry k is the hash of the run before k + 1 s.
    #[serde(default)]
    pub hash_by_second: Vec<String>,
    /// Smallest distance of two front points at any tick, m.
    pub min_distance_m: Option<f64>,
    /// Between which two.
    pub min_distance_pair: Option<[String; 2]>,
    /// When, s.
    pub min_distance_t_s: Option<f64>,
    /// Ticks at which some pair was nearer than d.
    pub violations: u64,
    /// The smallest distance of a front point from a wall or obstacle, m, whose it was, from which, where and
    /// when.
    pub min_clearance: Option<Clearance>,
    /// Ticks at which some front point was nearer to one than the clearance.
    pub clearance_violations: u64,
    /// Worst error over the last 10 % of the run by robot, m.
    #[serde(with = "by_name")]
    pub final_error_m: Vec<(String, Option<f64>)>,
    /// The worst of these.
    pub final_error_m_max: Option<f64>,
    /// Worst error to the ideal formation over the last 10 % of the run by robot, m.
    #[serde(with = "by_name")]
    pub final_ideal_error_m: Vec<(String, Option<f64>)>,
    /// The worst of these.
    pub final_ideal_error_m_max: Option<f64>,
    /// The main leader's: how well its trajectory is tracked, m.
    pub tracking_error_m_max: Option<f64>,
    /// Integral of the error by robot over the time it lived, m s.
    #[serde(with = "by_name")]
    pub integrated_error_m_s: Vec<(String, Option<f64>)>,
    /// Largest distance of a contained robot from the leaders' hull over the last 10 %, m.
    pub hull_distance_m_max_final: Option<f64>,
    /// Since when all living errors stayed below the converged error, s.
    pub converged_at_s: Option<f64>,
    /// Since when each robot's error stayed below it, s.
    #[serde(with = "by_name")]
    pub arrived_at_s: Vec<(String, Option<f64>)>,
    /// How far each front point went until then, or in all, m.
    #[serde(with = "by_name")]
    pub path_m: Vec<(String, Option<f64>)>,
    /// Of all that arrived at goals: the lengths of their ways over those of straight lines there; `null` once
    /// somebody was sent to another goal.
    pub path_over_straight: Option<f64>,
    /// Who was not there at the end, and for whom it waits.
    pub waits: Vec<Wait>,
    /// Commands sent after their agent's next wake-up was due.
    pub deadline_misses: u64,
    /// What became of commands at the plant.
    pub commands: Commands,
    /// Beacons that each robot refused: not finite, not plausible, old or from the future.
    #[serde(with = "by_name")]
    pub beacons_refused: Vec<(String, u64)>,
    /// Who was alive at the newest truth.
    pub alive_at_end: Vec<String>,
    /// Truths that the supervisor did not get.
    pub truths_lost: u64,
    /// From when to when it got none for more than 0.1 s, s, in order.
    pub unseen_s: Vec<[f64; 2]>,
    /// How old beacons were, by stamps, when they were used, by edge: in lockstep simulated time.
    pub ages: Vec<StageLatency>,
    /// The information age of every edge: at every instant, now minus the stamp of the newest beacon
    /// heard, silence included. In lockstep simulated time.
    pub information_ages: Vec<InformationAge>,
    /// Restarts by robot.
    #[serde(with = "by_name")]
    pub restarts: Vec<(String, u64)>,
    /// What each fault did.
    pub faults: Vec<FaultReport>,
    /// What was expected, and what came.
    pub expectations: Vec<Expectation>,
    /// What depends on wall time.
    pub wall: Wall,
}

/// What depends on wall time: it differs from run to run in either pace.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Wall {
    /// Wall time from the start of the first process to t = 0, when all were ready, s.
    pub startup_s: Option<f64>,
    /// Wall time from t = 0 to the end, s.
    pub wall_s: f64,
    /// Plant ticks per second of wall time.
    pub ticks_per_s: f64,
    /// Run time per wall time.
    pub real_time_factor: f64,
    /// How late and how long everything was, by stage and by robot or edge.
    pub latency: Vec<StageLatency>,
    /// How late all robots together woke.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wake_of_all: Option<StageLatency>,
    /// Values that belong in there, or to the ages, and did not arrive.
    pub latencies_lost: u64,
    /// What each process took from the machine.
    pub processes: Vec<ProcessUsage>,
    /// Where there are several: each host.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub hosts: Vec<HostSummary>,
    /// Where robots take goals from outside: what became of those.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub goals: Option<GoalSummary>,
}

/// What became of goals from outside.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct GoalSummary {
    /// How many were taken; of those that come faster than they are handed on, only the newest counts.
    pub taken: u64,
    /// How many were refused, by reason.
    #[serde(with = "by_name")]
    pub refused: Vec<(String, u64)>,
}

/// One host of several.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct HostSummary {
    /// Its name.
    pub name: String,
    /// The robots that live there.
    pub robots: Vec<String>,
    /// Whether it was heard at the end.
    pub reachable: bool,
    /// How often it was out of reach.
    pub lost: u64,
    /// How often its bridge was started anew.
    pub bridge_restarts: u64,
    /// The round trip to the plant's host that was measured last, ns; `None` for that host itself.
    pub round_trip_ns: Option<u64>,
    /// By how much a stamp of the plant's host was read wrongly there at most, ns: half a round trip, and
    /// drift. Ages over edges between hosts are upper bounds, too large by at most twice this.
    pub stamp_error_ns_max: Option<u64>,
    /// Frames that its bridge sent to other hosts.
    pub sent: u64,
    /// Of these, odometry, commands and beacons.
    pub samples_sent: u64,
    /// Frames that its bridge took over from other hosts.
    pub taken: u64,
    /// What its robots told the supervisor, and was dropped because the plant's host was away too long.
    pub told_dropped: u64,
    /// Samples that its bridge dropped, and connections that it refused, by reason.
    #[serde(with = "by_name")]
    pub dropped: Vec<(String, u64)>,
}

impl HostSummary {
    /// All of that in one line.
    pub fn words(&self) -> String {
        let ms = |ns: u64| format!("{:.3} ms", ns as f64 / 1e6);
        let robots = if self.robots.is_empty() { "no robots" } else { &self.robots.join(" ") };
        let mut text = robots.to_owned();
        if let (Some(round_trip_ns), Some(error_ns)) = (self.round_trip_ns, self.stamp_error_ns_max)
        {
            text += &format!("; round trip {}, stamps within {}", ms(round_trip_ns), ms(error_ns));
        }
        text += &format!("; {} sent, {} taken", self.sent, self.taken);
        let dropped: Vec<String> =
            self.dropped.iter().map(|(why, count)| format!("{why} {count}")).collect();
        if !dropped.is_empty() {
            text += &format!("; dropped: {}", dropped.join(", "));
        }
        for (count, words) in [
            (self.lost, "times out of reach"),
            (self.bridge_restarts, "times a new bridge"),
            (self.told_dropped, "reports lost"),
        ] {
            if count > 0 {
                text += &format!("; {count} {words}");
            }
        }
        if !self.reachable {
            text += "; LOST at the end";
        }
        text
    }
}

/// What became of commands at the plant.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Commands {
    /// Refused: dead on arrival, or from the future.
    pub late: u64,
    /// Refused: a newer one had been accepted.
    pub old: u64,
    /// Refused: not finite, or not plausible.
    pub not_finite: u64,
    /// Scaled down to the speed limit.
    pub scaled: u64,
    /// Died with no successor: the wheels stopped.
    pub expired: u64,
    /// The greatest age of one that moved a robot, from the stamp of the sample that it answers, ns: the command
    /// lifetime at most.
    pub age_ns_max: u64,
    /// In real time: samples too old for an answer, which got none.
    pub unanswered: u64,
    /// In real time: a newer one came before the plant had taken them.
    pub lost: u64,
}

/// How the values of one stage at one robot or edge are spread: a line of `latency.csv`, and an
/// entry of the summary's `ages` or of `latency` in its section `wall`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct StageLatency {
    /// A stage, in its word.
    pub stage: String,
    /// The robot it is measured at, or whose loop it is; or `plant`.
    pub robot: String,
    /// Of an edge: whom the robot hears.
    pub from: Option<String>,
    /// How many values.
    pub count: u64,
    /// The smallest, ns.
    pub min_ns: u64,
    /// Half of the values are at most this, ns.
    pub p50_ns: u64,
    /// 90 % of them.
    pub p90_ns: u64,
    /// 99 % of them.
    pub p99_ns: u64,
    /// 99.9 % of them.
    #[serde(rename = "p99.9_ns")]
    pub p99_9_ns: u64,
    /// 99.99 % of them.
    #[serde(rename = "p99.99_ns")]
    pub p99_99_ns: u64,
    /// The largest, ns.
    pub max_ns: u64,
    /// Their mean, ns.
    pub mean_ns: f64,
}

/// The values of one stage at one robot or edge that reached the supervisor in one stretch of run time: a line
/// of `latency_over_time.csv`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Stretch {
    /// The middle of the stretch, s.
    pub t_s: f64,
    /// A stage, in its word.
    pub stage: String,
    /// The robot it is measured at, or whose loop it is; or `plant`.
    pub robot: String,
    /// Of an edge: whom the robot hears.
    pub from: Option<String>,
    /// How many values.
    pub count: u64,
    /// Half of the values are at most this, ns.
    pub p50_ns: u64,
    /// 99 % of them.
    pub p99_ns: u64,
    /// The largest, ns.
    pub max_ns: u64,
}

/// The information age of one edge, from the first beacon heard over it to the last that its hearer
/// told; while the hearer is dead there is none.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct InformationAge {
    /// Who hears.
    pub robot: String,
    /// Who is heard.
    pub from: String,
    /// How many beacons were heard.
    pub heard: u64,
    /// Over how long, ns.
    pub over_ns: u64,
    /// The mean over that time, ns.
    pub mean_ns: f64,
    /// The largest age, ns.
    pub peak_ns: u64,
}

impl StageLatency {
    /// The robot, or the edge as `r1 -> r2`.
    pub fn edge(&self) -> String {
        match &self.from {
            Some(from) => format!("{from} -> {}", self.robot),
            None => self.robot.clone(),
        }
    }
}

/// What one process took from the machine, over all its incarnations.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ProcessUsage {
    /// `supervisor`, `plant`, or the robot.
    pub name: String,
    /// How often it was started.
    pub starts: u64,
    /// What it took.
    #[serde(flatten)]
    pub usage: Usage,
}

/// What a process took from the machine, or several one after the other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Usage {
    /// Processor time in user mode, s.
    pub user_s: f64,
    /// Processor time in the kernel, s.
    pub system_s: f64,
    /// How often it waited for something.
    pub voluntary_switches: u64,
    /// How often its processor was taken away.
    pub involuntary_switches: u64,
    /// Page faults met without reading a disk.
    pub minor_faults: u64,
    /// Page faults that read a disk.
    pub major_faults: u64,
}

impl AddAssign for Usage {
    fn add_assign(&mut self, other: Usage) {
        *self = self.with(&other, Add::add, Add::add);
    }
}

impl Usage {
    /// What was taken since `earlier`.
    pub fn since(&self, earlier: &Usage) -> Usage {
        self.with(earlier, Sub::sub, Sub::sub)
    }

    fn with(&self, other: &Usage, s: fn(f64, f64) -> f64, n: fn(u64, u64) -> u64) -> Usage {
        Usage {
            user_s: s(self.user_s, other.user_s),
            system_s: s(self.system_s, other.system_s),
            voluntary_switches: n(self.voluntary_switches, other.voluntary_switches),
            involuntary_switches: n(self.involuntary_switches, other.involuntary_switches),
            minor_faults: n(self.minor_faults, other.minor_faults),
            major_faults: n(self.major_faults, other.major_faults),
        }
    }
}

impl Summary {
    /// The expectation of this name, if the scenario has it.
    pub fn expected(&self, name: &str) -> Option<&Expectation> {
        self.expectations.iter().find(|expectation| expectation.name == name)
    }

    /// How late all robots together woke, beside the control timer, if both are known.
    pub fn beside_the_machine(&self) -> Option<[&StageLatency; 2]> {
        let machine = Stage::Machine.word();
        let machine = self.wall.latency.iter().find(|line| line.stage == machine)?;
        Some([self.wall.wake_of_all.as_ref()?, machine])
    }

    /// Latencies and ages, stage by stage.
    pub fn latencies(&self) -> impl Iterator<Item = &StageLatency> {
        self.wall.latency.iter().chain(&self.ages)
    }

    /// The edge whose information grew oldest, if anything was heard over any.
    pub fn oldest(&self) -> Option<&InformationAge> {
        self.information_ages.iter().max_by_key(|age| age.peak_ns)
    }

    /// How many wake-ups and answers of robots were late, for each cause that there was.
    pub fn late_by_cause(&self) -> Vec<(Cause, u64)> {
        let count = |cause: Cause| {
            let lines = self.latencies().filter(|line| line.stage == cause.stage().word());
            (cause, lines.map(|line| line.count).sum())
        };
        Cause::ALL.map(count).into_iter().filter(|&(_, count)| count > 0).collect()
    }

    /// For each stage, the robot or edge that fares worst: by p99.9, then by the largest value. What
    /// was late by cause is elsewhere.
    pub fn worst_latencies(&self) -> Vec<&StageLatency> {
        let mut worst: Vec<&StageLatency> = Vec::new();
        let by_cause = Cause::ALL.map(|cause| cause.stage().word());
        for line in self.latencies().filter(|line| !by_cause.contains(&line.stage.as_str())) {
            let size = |line: &StageLatency| (line.p99_9_ns, line.max_ns);
            match worst.iter_mut().find(|known| known.stage == line.stage) {
                Some(known) if size(known) <= size(line) => *known = line,
                Some(_) => {}
                None => worst.push(line),
            }
        }
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(stage: &str, robot: &str, p99_9_ns: u64, max_ns: u64) -> StageLatency {
        let (stage, robot) = (stage.into(), robot.into());
        StageLatency { stage, robot, p99_9_ns, max_ns, ..StageLatency::default() }
    }

    #[test]
    fn what_is_written_is_read_again_with_robots_in_order_and_infinite_errors() {
        let summary = Summary {
            scenario: "row".into(),
            pace: Pace::Lockstep,
            min_distance_m: Some(0.1 + 0.2),
            final_error_m: ["r2", "r10", "r1"].map(|robot| (robot.into(), None)).into(),
            restarts: vec![("r10".into(), 3), ("r1".into(), 0)],
            ages: vec![line("beacon_age", "r1", 1, 2)],
            faults: vec![FaultReport { peak_error_m: f64::INFINITY, ..FaultReport::default() }],
            wall: Wall { startup_s: Some(0.25), wall_s: 3.0, ..Wall::default() },
            ..Summary::default()
        };
        let text = serde_json::to_string(&summary).unwrap();
        assert_eq!(serde_json::from_str::<Summary>(&text).unwrap(), summary);
    }

    #[test]
    fn a_summary_of_another_version_counts_as_not_known_where_it_lacks_something() {
        let summary: Summary = serde_json::from_str(r#"{ "t_s": 2.0, "novelty": [1] }"#).unwrap();
        assert_eq!(summary, Summary { t_s: 2.0, ..Summary::default() });
    }

    #[test]
    fn the_worst_of_a_stage_is_the_one_with_the_longest_tail() {
        let summary = Summary {
            ages: vec![line("beacon_age", "r1", 5, 5)],
            wall: Wall {
                latency: vec![
                    line("wake", "r1", 1, 9),
                    line("wake", "r2", 3, 3),
                    line("wake", "r3", 3, 4),
                    line("compute", "r1", 0, 0),
                ],
                ..Wall::default()
            },
            ..Summary::default()
        };
        let worst: Vec<String> = summary
            .worst_latencies()
            .iter()
            .map(|line| format!("{} {}", line.stage, line.robot))
            .collect();
        assert_eq!(worst, ["wake r3", "compute r1", "beacon_age r1"]);
    }
}
