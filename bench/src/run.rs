//! One `phalanx run` as a child process, started as a user would start it, and its summary.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use protocol::brief::Pace;
use protocol::stage::Stage;
use serde_json::Value;
use supervisor::child::{Child, describe_exit};
use supervisor::spawn::{Launcher, ProcessRole};

use crate::quantiles::{QUANTILES, Quantiles};
use crate::rounds::BenchSettings;
use crate::{MEASUREMENT_DURATION_MAX, SHOWN_LOG_LINES, WorkDir, write_file};

/// Maximum time for a run to end its child processes and remove its files after a termination request.
const SHUTDOWN_DURATION_MAX: Duration = Duration::from_secs(15);
/// Polling interval for signals.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Names of the consumers of processor time in the table.
pub(crate) const CPU_CONSUMERS: [&str; 3] = ["robots", "plant", "supervisor"];

/// A run in progress. Dropping it ends the run.
pub(crate) struct RunProcess<'a> {
    settings: &'a BenchSettings<'a>,
    child: Child,
    work_dir: WorkDir,
}

impl<'a> RunProcess<'a> {
    /// Starts `phalanx run` of this scenario text, with additional arguments.
    pub(crate) fn start(
        settings: &'a BenchSettings<'_>,
        scenario: &str,
        pace: Pace,
        arguments: &[&str],
    ) -> anyhow::Result<RunProcess<'a>> {
        let work_dir = WorkDir::new(settings.root, "run")?;
        let (file, out) = (work_dir.path().join("scenario.toml"), work_dir.path().join("out"));
        write_file(&file, scenario)?;
        let mut command_line: Vec<OsString> =
            vec!["run".into(), file.into(), "--out".into(), out.into()];
        let run_options = ["--pace", pace.keyword(), "--output=json", "--no-report"];
        command_line.extend(run_options.iter().chain(arguments).map(OsString::from));
        let child = Launcher::for_this_executable()
            .spawn(ProcessRole::Bench { arguments: &command_line }, &work_dir.path().join("log"))?;
        Ok(RunProcess { settings, child, work_dir })
    }

    /// Returns the path of a robot's brief.
    pub(crate) fn brief_path(&self, robot: &str) -> PathBuf {
        self.out_dir().join(format!("briefs/{robot}.toml"))
    }

    /// Returns whether `events.csv` has at least `count` events of this kind.
    pub(crate) fn has_events(&self, kind: &str, count: usize) -> bool {
        self.read_events().lines().filter(|line| line.split(',').nth(1) == Some(kind)).count()
            >= count
    }

    /// Returns the text of `events.csv` written so far; empty if the file cannot be read.
    pub(crate) fn read_events(&self) -> String {
        std::fs::read_to_string(self.out_dir().join("events.csv")).unwrap_or_default()
    }

    /// Returns the output directory of the run.
    fn out_dir(&self) -> PathBuf {
        self.work_dir.path().join("out")
    }

    /// Returns an error if the run has ended or a signal has interrupted the bench.
    pub(crate) fn check_running(&mut self) -> anyhow::Result<()> {
        self.settings.check_interrupted()?;
        match self.child.try_reap() {
            None => Ok(()),
            Some(status) => {
                Err(self.error_with_log(format!("the run ended early ({})", describe_exit(status))))
            }
        }
    }

    /// Waits for the end of the run and returns its summary.
    ///
    /// # Errors
    /// If the run fails or its `summary.json` cannot be read.
    pub(crate) fn wait_for_summary(mut self) -> anyhow::Result<Summary> {
        self.wait_for_exit()?;
        let path = self.out_dir().join("summary.json");
        let error_context = || format!("cannot read {}", path.display());
        let bytes = std::fs::read(&path).with_context(error_context)?;
        serde_json::from_slice(&bytes).map(Summary).with_context(error_context)
    }

    /// Waits for the end of the run.
    ///
    /// # Errors
    /// If the run fails or takes more than [`MEASUREMENT_DURATION_MAX`], or if a signal interrupts the bench.
    pub(crate) fn wait_for_exit(&mut self) -> anyhow::Result<()> {
        let start = Instant::now();
        let status = loop {
            if let Some(status) = self.child.wait_timeout(POLL_INTERVAL) {
                break status;
            }
            self.settings.check_interrupted()?;
            if start.elapsed() > MEASUREMENT_DURATION_MAX {
                let limit_s = MEASUREMENT_DURATION_MAX.as_secs();
                return Err(self.error_with_log(format!("a run took more than {limit_s} s")));
            }
        };
        if !status.success() {
            return Err(self.error_with_log(format!("a run failed ({})", describe_exit(status))));
        }
        Ok(())
    }

    /// Returns an error with the last error line of the run's log, or with the last lines of the log if it has none.
    /// The last lines alone would not do, because a run prints its summary after its error.
    fn error_with_log(&self, message: String) -> anyhow::Error {
        let log = std::fs::read_to_string(self.work_dir.path().join("log")).unwrap_or_default();
        match log.lines().rev().find_map(|line| line.strip_prefix("error: ")) {
            Some(error) => anyhow!("{message}: {error}"),
            None => exit_error(&message, &self.child),
        }
    }
}

/// Returns an error about a process that exited, with the last lines of its log.
pub(crate) fn exit_error(message: &str, child: &Child) -> anyhow::Error {
    anyhow!("{message}; the last lines of its log:\n{}", child.last_lines(SHOWN_LOG_LINES))
}

impl Drop for RunProcess<'_> {
    /// Terminates the run, so that it ends its child processes and removes their shared resources. A killed run cannot.
    fn drop(&mut self) {
        if self.child.try_reap().is_none() {
            self.child.terminate();
            self.child.wait_timeout(SHUTDOWN_DURATION_MAX);
        }
    }
}

/// Content of a run's `summary.json`.
pub(crate) struct Summary(pub(crate) Value);

impl Summary {
    /// Returns the number at a JSON pointer.
    ///
    /// # Errors
    /// If there is no number at the pointer.
    pub(crate) fn number_at(&self, pointer: &str) -> anyhow::Result<f64> {
        let number = self.0.pointer(pointer).and_then(Value::as_f64);
        number.with_context(|| format!("summary.json has no number at {pointer}"))
    }

    /// Returns the total processor time of each of [`CPU_CONSUMERS`], s, over the lifetime of the processes.
    ///
    /// # Errors
    /// If the summary has no list of processes.
    pub(crate) fn cpu_time_s(&self) -> anyhow::Result<[f64; CPU_CONSUMERS.len()]> {
        let Some(processes) = self.0["wall"]["processes"].as_array() else {
            bail!("summary.json has no list at /wall/processes");
        };
        let mut cpu_time_s = [0.0; CPU_CONSUMERS.len()];
        for process in processes {
            let consumer = match process["name"].as_str() {
                Some("plant") => 1,
                Some("supervisor") => 2,
                Some("awake") => continue,
                _ => 0,
            };
            for key in ["user_s", "system_s"] {
                cpu_time_s[consumer] += process[key].as_f64().unwrap_or_default();
            }
        }
        Ok(cpu_time_s)
    }

    /// Returns the latency quantiles of a stage, us, for each robot or each edge, without those of the plant. A missing
    /// quantile is NaN.
    pub(crate) fn stage_quantiles(&self, stage: Stage) -> Vec<Quantiles> {
        let rows = self.0["wall"]["latency"].as_array().into_iter().flatten();
        let rows = rows.filter(|row| row["stage"] == stage.keyword() && row["robot"] != "plant");
        let to_us = |row: &Value, key: &str| row[key].as_f64().unwrap_or(f64::NAN) / 1e3;
        rows.map(|row| QUANTILES.map(|(key, ..)| to_us(row, key))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stage_quantiles_exclude_the_plant() {
        let row = |stage: &str, robot: &str, p50_ns: u64| {
            serde_json::json!({ "stage": stage, "robot": robot, "p50_ns": p50_ns,
                "p99_ns": 2 * p50_ns, "p99.9_ns": 3 * p50_ns })
        };
        let rows =
            [row("wake", "plant", 9000), row("wake", "r1", 1000), row("compute", "r1", 8000)];
        let summary = Summary(serde_json::json!({ "wall": { "latency": rows } }));
        assert_eq!(summary.stage_quantiles(Stage::Wake), [[1.0, 2.0, 3.0]]);
        assert_eq!(summary.stage_quantiles(Stage::BeaconDelivery), [] as [Quantiles; 0]);
        assert!(summary.number_at("/ticks").is_err() && summary.cpu_time_s().is_err());
    }

    #[test]
    fn cpu_time_sums_robots_and_excludes_idle_spinners() {
        fn process(&(name, user_s, system_s): &(&str, f64, f64)) -> Value {
            serde_json::json!({ "name": name, "user_s": user_s, "system_s": system_s })
        }
        let counted = [("supervisor", 0.75, 0.5), ("plant", 0.125, 0.25), ("r1", 0.5, 0.5)];
        let processes = counted.iter().chain(&[("r2", 0.25, 0.25), ("awake", 64.0, 8.0)]);
        let processes: Vec<Value> = processes.map(process).collect();
        let summary = Summary(serde_json::json!({ "wall": { "processes": processes } }));
        assert_eq!(summary.cpu_time_s().unwrap(), [1.5, 0.375, 1.25]);
    }
}
