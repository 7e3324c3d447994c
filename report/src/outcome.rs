//! What a run's `summary.json` says, as far as the report shows it.
//!
//! A file of another version may lack keys or have more: what is missing counts as not known.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Map, Value};

/// The content of `summary.json`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Outcome {
    /// The exit code.
    pub exit: u8,
    /// A signal ended the run.
    pub interrupted: bool,
    /// Run time reached, s.
    pub t_s: f64,
    /// Plant ticks.
    pub ticks: u64,
    /// Wall time from t = 0 to the end, s.
    pub wall_s: f64,
    /// Run time per wall time.
    pub real_time_factor: f64,
    /// In lockstep.
    pub trajectory_hash: Option<String>,
    /// Smallest distance of two front points at any tick, m.
    pub min_distance_m: Option<f64>,
    /// Between which two.
    pub min_distance_pair: Option<[String; 2]>,
    /// When, s.
    pub min_distance_t_s: Option<f64>,
    /// Ticks at which some pair was nearer than d.
    pub violations: u64,
    /// Worst error over the last 10 % of the run by robot, m.
    pub final_error_m: Map<String, Value>,
    /// The worst of these.
    pub final_error_m_max: Option<f64>,
    /// The main leader's, m.
    pub tracking_error_m_max: Option<f64>,
    /// Integral of the error by robot, m s.
    pub integrated_error_m_s: Map<String, Value>,
    /// Largest distance of a contained robot from the leaders' hull over the last 10 %, m.
    pub hull_distance_m_max_final: Option<f64>,
    /// Since when all living errors stayed below the converged error, s.
    pub converged_at_s: Option<f64>,
    /// Commands sent after their agent's next wake-up was due.
    pub deadline_misses: u64,
    /// What became of commands at the plant, by word.
    pub commands: BTreeMap<String, u64>,
    /// Truths that the supervisor did not get.
    pub truths_lost: u64,
    /// How late, how long and how old everything was.
    pub latency: Vec<Stage>,
    /// Values that belong in there and did not arrive.
    pub latencies_lost: u64,
    /// What each process took from the machine.
    pub processes: Vec<Process>,
    /// What each fault did.
    pub faults: Vec<Fault>,
    /// What was expected, and what came.
    pub expectations: Vec<Expectation>,
}

/// One stage at one robot or edge.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Stage {
    /// Its word.
    pub stage: String,
    /// The robot, or `plant`.
    pub robot: String,
    /// Of an edge: whom the robot hears.
    pub from: Option<String>,
    /// How many values.
    pub count: u64,
    /// Half of the values are at most this, ns.
    pub p50_ns: u64,
    /// 99 % of them.
    pub p99_ns: u64,
    /// 99.9 % of them.
    #[serde(rename = "p99.9_ns")]
    pub p99_9_ns: u64,
    /// The largest, ns.
    pub max_ns: u64,
}

/// What one process took from the machine.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Process {
    /// `supervisor`, `plant`, or the robot.
    pub name: String,
    /// How often it was started.
    pub starts: u64,
    /// Processor time in user mode, s.
    pub user_s: f64,
    /// Processor time in the kernel, s.
    pub system_s: f64,
    /// How often its processor was taken away.
    pub involuntary_switches: u64,
    /// Page faults that read a disk.
    pub major_faults: u64,
}

/// What one fault did.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Fault {
    /// When it began, s.
    pub t_s: f64,
    /// What it was.
    pub what: String,
    /// Whom it struck.
    pub robot: Option<String>,
    /// Who breaks, by theory.
    pub predicted: Vec<String>,
    /// Who was seen to break.
    pub affected: Vec<String>,
    /// From its beginning until it was whole again, s.
    pub lasted_s: Option<f64>,
    /// Until the first neighbor called the robot stale, s.
    pub stale_after_s: Option<f64>,
    /// Until the first neighbor called the robot lost, s.
    pub lost_after_s: Option<f64>,
    /// Worst error of a living robot until the recovery, m.
    pub peak_error_m: f64,
    /// Smallest distance over the same time, m.
    pub min_distance_m: Option<f64>,
    /// From its end until all living errors were small for good, s.
    pub recovered_after_s: Option<f64>,
}

/// One expectation and how it came out.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Expectation {
    /// Its key in the scenario.
    pub name: String,
    /// What was measured; `None`: it never came about.
    pub value: Option<f64>,
    /// What was asked for.
    pub bound: f64,
    /// Whether it held.
    pub held: bool,
}

impl Outcome {
    /// The expectation of this name, if the scenario has it.
    pub fn expected(&self, name: &str) -> Option<&Expectation> {
        self.expectations.iter().find(|expectation| expectation.name == name)
    }
}

/// A bound as it was asked for: at most four significant digits, and none that says nothing.
pub fn asked(value: f64) -> String {
    let text = digits(value);
    let plain = text.contains('.') && !text.contains('e');
    if plain { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// A number in few characters: four significant digits.
pub fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !size.is_finite() => value.to_string(),
        size if !(1e-3..1e5).contains(&size) => format!("{value:.1e}"),
        size => {
            let before = size.log10().floor() as i32;
            format!("{value:.*}", (3 - before).max(0) as usize)
        }
    }
}
