//! Whose the lateness is: the causes that robots and bare timers give of their late wake-ups, and who held
//! the cores meanwhile.

use protocol::stage::Cause;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use supervisor::scheduler;

use crate::child::{self, latest_wake_us};
use crate::control::held_by;
use crate::{BenchError, Setting};

/// Late wake-ups by one cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tally {
    count: u64,
    /// How late they were together, ns.
    ns: f64,
}

impl Tally {
    /// One more.
    pub(crate) fn add(&mut self, late_ns: u64) {
        self.count += 1;
        self.ns += late_ns as f64;
    }
}

/// By [`Cause::ALL`].
pub(crate) type ByCause = [Tally; Cause::ALL.len()];

/// Late wake-ups of some runs.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Causes {
    robots: ByCause,
    /// Of the robot of each run whose p99 was the largest.
    latest: ByCause,
    timers: ByCause,
}

impl Causes {
    /// Adds what the summary of a run has.
    pub(crate) fn add_run(&mut self, summary: &Value) {
        let lines = || summary["wall"]["latency"].as_array().into_iter().flatten();
        let robots = || lines().filter(|line| line["robot"] != "plant");
        let wakes = robots().filter(|line| line["stage"] == "wake");
        let latest = wakes.max_by_key(|line| line["p99_ns"].as_u64()).map(|line| &line["robot"]);
        for line in robots() {
            let cause = Cause::ALL.iter().position(|of| line["stage"] == of.stage().word());
            let Some(cause) = cause else { continue };
            let count = line["count"].as_u64().unwrap_or_default();
            let ns = count as f64 * line["mean_ns"].as_f64().unwrap_or_default();
            for of in [
                Some(&mut self.robots),
                (latest == Some(&line["robot"])).then_some(&mut self.latest),
            ] {
                if let Some(tally) = of.map(|of| &mut of[cause]) {
                    tally.count += count;
                    tally.ns += ns;
                }
            }
        }
    }

    /// Adds what a bare timer told.
    pub(crate) fn add_timer(&mut self, told: &ByCause) {
        for (sum, of) in self.timers.iter_mut().zip(told) {
            sum.count += of.count;
            sum.ns += of.ns;
        }
    }

    /// A line for each group.
    pub(crate) fn words(&self) -> [String; 3] {
        [
            ("all robots", &self.robots),
            ("the latest robot", &self.latest),
            ("all timers", &self.timers),
        ]
        .map(|(whose, causes)| format!("late wake-ups of {whose}: {}", words(causes)))
    }
}

/// Most first.
fn words(causes: &ByCause) -> String {
    let mut told: Vec<(Cause, Tally)> = Cause::ALL.into_iter().zip(*causes).collect();
    told.retain(|(_, tally)| tally.count > 0);
    told.sort_by(|(_, a), (_, b)| b.ns.total_cmp(&a.ns));
    let words: Vec<String> = told
        .into_iter()
        .map(|(cause, Tally { count, ns })| {
            format!("{} {count} ({:.0} ms)", cause.words(), ns / 1e6)
        })
        .collect();
    if words.is_empty() { "none".into() } else { words.join(", ") }
}

/// One more run of this scenario with the kernel's scheduler traced: who held the cores of the late.
pub(crate) fn traced(setting: &Setting<'_>, text: &str) -> Result<String, BenchError> {
    if let Err(error) = scheduler::available() {
        return Ok(format!("who held the cores is not known: {error}"));
    }
    let summary = child::run_realtime(setting, text, &["--trace-scheduler"])?;
    let p99_us = latest_wake_us(&summary, "p99_ns").unwrap_or_default();
    let held = held_by(&summary).unwrap_or_else(|| "nothing was traced".into());
    Ok(format!("in a run more (p99 of the latest {p99_us:.0} us) {held}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_summed_over_runs_and_told_of_all_robots_the_latest_and_the_timers() {
        let line = |stage: &str, robot: &str, count: u64, p99_ns: u64, mean_ns: f64| {
            serde_json::json!({ "stage": stage, "robot": robot, "count": count, "p99_ns": p99_ns,
                "mean_ns": mean_ns })
        };
        let lines = [
            line("wake", "r1", 100, 5_000, 1e3),
            line("wake", "r2", 100, 90_000, 1e3),
            line("wake", "plant", 100, 900_000, 1e3),
            line("late_core", "r1", 2, 0, 1e6),
            line("late_core", "r2", 3, 0, 2e6),
            line("late_work", "r2", 1, 0, 9e6),
            line("late_work", "plant", 50, 0, 9e6),
        ];
        let summary = serde_json::json!({ "wall": { "latency": lines } });
        let mut causes = Causes::default();
        causes.add_run(&summary);
        causes.add_run(&summary);
        let mut timer = ByCause::default();
        timer[Cause::Core as usize].add(3_000_000);
        causes.add_timer(&timer);
        assert_eq!(
            causes.words(),
            [
                "late wake-ups of all robots: own work 2 (18 ms), waited for a core 10 (16 ms)",
                "late wake-ups of the latest robot: own work 2 (18 ms), waited for a core 6 (12 ms)",
                "late wake-ups of all timers: waited for a core 1 (3 ms)",
            ]
        );
        assert_eq!(Causes::default().words()[0], "late wake-ups of all robots: none");
    }
}
