//! One `phalanx run` as a child, as a user would start it, and its summary.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use protocol::brief::Pace;
use protocol::stage::Stage;
use serde_json::Value;
use supervisor::child::{Child, in_words};
use supervisor::spawn::{Launcher, Role};

use crate::quantiles::{QUANTILES, Quantiles};
use crate::rounds::Setting;
use crate::{LOG_LINES, MEASUREMENT_MAX, Place, write};

/// Maximum time for a terminated run to end its children and remove its files.
const END_MAX: Duration = Duration::from_secs(15);
/// Polling interval for signals.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Groups of processes that use processor time.
pub(crate) const TAKERS: [&str; 3] = ["robots", "plant", "supervisor"];

/// Run in progress.
pub(crate) struct Run<'a> {
    setting: &'a Setting<'a>,
    child: Child,
    place: Place,
}

impl<'a> Run<'a> {
    /// Starts `phalanx run` of this scenario, with additional arguments.
    pub(crate) fn start(
        setting: &'a Setting<'_>,
        scenario: &str,
        pace: Pace,
        more: &[&str],
    ) -> anyhow::Result<Run<'a>> {
        let place = Place::new(setting.root, "run")?;
        let (file, out) = (place.path().join("scenario.toml"), place.path().join("out"));
        write(&file, scenario)?;
        let mut words: Vec<OsString> = vec!["run".into(), file.into(), "--out".into(), out.into()];
        let all = ["--pace", pace.word(), "--output=json", "--no-report"];
        words.extend(all.iter().chain(more).map(OsString::from));
        let child = Launcher::of_this_executable()
            .spawn(Role::Bench { words: &words }, &place.path().join("log"))?;
        Ok(Run { setting, child, place })
    }

    /// Returns the path of the brief of a robot of the run.
    pub(crate) fn brief(&self, robot: &str) -> PathBuf {
        self.out().join(format!("briefs/{robot}.toml"))
    }

    /// Returns whether at least `count` events of this kind have been recorded.
    pub(crate) fn has_events(&self, kind: &str, count: usize) -> bool {
        self.events().lines().filter(|line| line.split(',').nth(1) == Some(kind)).count() >= count
    }

    /// Returns the contents of `events.csv` so far.
    pub(crate) fn events(&self) -> String {
        std::fs::read_to_string(self.out().join("events.csv")).unwrap_or_default()
    }

    fn out(&self) -> PathBuf {
        self.place.path().join("out")
    }

    /// Fails if the run has ended, or the bench is to end.
    pub(crate) fn check(&mut self) -> anyhow::Result<()> {
        self.setting.check_signals()?;
        match self.child.ended() {
            None => Ok(()),
            Some(status) => Err(self.broken(format!("the run ended ({})", in_words(status)))),
        }
    }

    /// Waits for the end of the run and returns its summary.
    pub(crate) fn summary(mut self) -> anyhow::Result<Summary> {
        self.end()?;
        let path = self.out().join("summary.json");
        let cannot = || format!("cannot read {}", path.display());
        let bytes = std::fs::read(&path).with_context(cannot)?;
        serde_json::from_slice(&bytes).map(Summary).with_context(cannot)
    }

    /// Waits for the end of the run. Fails if its exit code is not 0.
    pub(crate) fn end(&mut self) -> anyhow::Result<()> {
        let began = Instant::now();
        let status = loop {
            if let Some(status) = self.child.ended_within(POLL_INTERVAL) {
                break status;
            }
            self.setting.check_signals()?;
            if began.elapsed() > MEASUREMENT_MAX {
                return Err(self.broken("a run took more than 240 s".into()));
            }
        };
        if !status.success() {
            return Err(self.broken(format!("a run failed ({})", in_words(status))));
        }
        Ok(())
    }

    /// Returns an error with the run's own message if there is one, because the summary is printed after
    /// it; otherwise with the last lines of its log.
    fn broken(&self, what: String) -> anyhow::Error {
        let log = std::fs::read_to_string(self.place.path().join("log")).unwrap_or_default();
        match log.lines().rev().find_map(|line| line.strip_prefix("error: ")) {
            Some(complaint) => anyhow!("{what}: {complaint}"),
            None => dead(&what, &self.child),
        }
    }
}

/// Returns the error for a process of a measurement that exited, with the end of its log.
pub(crate) fn dead(what: &str, child: &Child) -> anyhow::Error {
    anyhow!("{what}; the last lines of its log:\n{}", child.last_lines(LOG_LINES))
}

impl Drop for Run<'_> {
    /// Terminates the run, so that it ends its children and removes the shared files, which a killed run cannot.
    fn drop(&mut self) {
        if self.child.ended().is_none() {
            self.child.terminate();
            self.child.ended_within(END_MAX);
        }
    }
}

/// The `summary.json` of a run.
pub(crate) struct Summary(pub(crate) Value);

impl Summary {
    /// Returns the number at a JSON pointer. Fails if there is none.
    pub(crate) fn number(&self, pointer: &str) -> anyhow::Result<f64> {
        let found = self.0.pointer(pointer).and_then(Value::as_f64);
        found.with_context(|| format!("summary.json has no number at {pointer}"))
    }

    /// Returns the processor time by [`TAKERS`], s, from the first process to the exit of the last.
    pub(crate) fn taken_s(&self) -> anyhow::Result<[f64; TAKERS.len()]> {
        let Some(processes) = self.0["wall"]["processes"].as_array() else {
            bail!("summary.json has no list at /wall/processes");
        };
        let mut taken_s = [0.0; TAKERS.len()];
        for process in processes {
            let taker = match process["name"].as_str() {
                Some("plant") => 1,
                Some("supervisor") => 2,
                Some("awake") => continue,
                _ => 0,
            };
            for key in ["user_s", "system_s"] {
                taken_s[taker] += process[key].as_f64().unwrap_or_default();
            }
        }
        Ok(taken_s)
    }

    /// Returns the latencies of each robot, or of each edge, at this stage, without the plant's.
    pub(crate) fn stage(&self, stage: Stage) -> Vec<Quantiles> {
        let rows = self.0["wall"]["latency"].as_array().into_iter().flatten();
        let rows = rows.filter(|row| row["stage"] == stage.word() && row["robot"] != "plant");
        let us = |row: &Value, key: &str| row[key].as_f64().unwrap_or(f64::NAN) / 1e3;
        rows.map(|row| QUANTILES.map(|(key, ..)| us(row, key))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_robots_and_edges_measured_is_found_and_the_plant_does_not_count() {
        let row = |stage: &str, robot: &str, p50_ns: u64| {
            serde_json::json!({ "stage": stage, "robot": robot, "p50_ns": p50_ns,
                "p99_ns": 2 * p50_ns, "p99.9_ns": 3 * p50_ns })
        };
        let rows =
            [row("wake", "plant", 9000), row("wake", "r1", 1000), row("compute", "r1", 8000)];
        let summary = Summary(serde_json::json!({ "wall": { "latency": rows } }));
        assert_eq!(summary.stage(Stage::Wake), [[1.0, 2.0, 3.0]]);
        assert_eq!(summary.stage(Stage::BeaconDelivery), [] as [Quantiles; 0]);
        assert!(summary.number("/ticks").is_err() && summary.taken_s().is_err());
    }

    #[test]
    fn robots_take_time_together_and_those_that_keep_cores_awake_do_not_count() {
        fn process(&(name, user_s, system_s): &(&str, f64, f64)) -> Value {
            serde_json::json!({ "name": name, "user_s": user_s, "system_s": system_s })
        }
        let taken = [("supervisor", 0.75, 0.5), ("plant", 0.125, 0.25), ("r1", 0.5, 0.5)];
        let processes = taken.iter().chain(&[("r2", 0.25, 0.25), ("awake", 64.0, 8.0)]);
        let processes: Vec<Value> = processes.map(process).collect();
        let summary = Summary(serde_json::json!({ "wall": { "processes": processes } }));
        assert_eq!(summary.taken_s().unwrap(), [1.5, 0.375, 1.25]);
    }
}
