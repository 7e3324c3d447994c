//! One `phalanx run` as a child, as a user would start it, and its summary.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use protocol::brief::Pace;
use protocol::process::Stop;
use protocol::run_root::RunRoot;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde_json::Value;
use supervisor::child::{Child, in_words};
use supervisor::spawn::{Launcher, Role};

use crate::{BenchError, Place, Setting, failed};

/// No run of a bench takes this long, even on a machine that is busy with other things.
const LIMIT: Duration = Duration::from_secs(240);
/// A run asked to end has ended its children and removed its files within this.
const END_MAX: Duration = Duration::from_secs(15);
/// How often signals are looked for.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
const LOG_LINES: usize = 8;

/// Who takes processor time.
pub(crate) const TAKERS: [&str; 3] = ["robots", "plant", "supervisor"];

/// A run under way.
pub(crate) struct Running<'a> {
    stop: &'a Stop,
    run: Child,
    place: Place,
}

impl Running<'_> {
    /// Starts `phalanx run` of this scenario.
    pub(crate) fn start<'a>(
        root: &RunRoot,
        stop: &'a Stop,
        scenario: &str,
        pace: Pace,
    ) -> Result<Running<'a>, BenchError> {
        Running::start_with(root, stop, scenario, pace, &[])
    }

    /// The same with more words on its command line.
    pub(crate) fn start_with<'a>(
        root: &RunRoot,
        stop: &'a Stop,
        scenario: &str,
        pace: Pace,
        more: &[&str],
    ) -> Result<Running<'a>, BenchError> {
        let place = Place::new(root, "child")?;
        let file = place.path().join("scenario.toml");
        std::fs::write(&file, scenario).map_err(failed("write", &file))?;
        let mut words: Vec<OsString> = vec![
            "run".into(),
            file.into(),
            "--pace".into(),
            pace.word().into(),
            "--output=json".into(),
            "--no-report".into(),
            "--out".into(),
            place.path().join("run").into(),
        ];
        words.extend(more.iter().map(OsString::from));
        let run = Launcher::of_this_executable()
            .spawn(Role::Bench { words: &words }, &place.path().join("log"))?;
        Ok(Running { stop, run, place })
    }

    /// What a robot of the run is told.
    pub(crate) fn brief(&self, robot: &str) -> PathBuf {
        self.run_dir().join(format!("briefs/{robot}.toml"))
    }

    /// Whether at least so many events of this kind were written down.
    pub(crate) fn has_events(&self, kind: &str, count: usize) -> bool {
        let events = std::fs::read_to_string(self.run_dir().join("events.csv"));
        let events = events.unwrap_or_default();
        events.lines().filter(|line| line.split(',').nth(1) == Some(kind)).count() >= count
    }

    fn run_dir(&self) -> PathBuf {
        self.place.path().join("run")
    }

    /// Waits for the rest of a line that it says and that begins so.
    pub(crate) fn said(&mut self, begins: &str) -> Result<String, BenchError> {
        let log = self.place.path().join("log");
        loop {
            let text = std::fs::read_to_string(&log).map_err(failed("read", &log))?;
            let whole = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
            if let Some(rest) = whole.filter_map(|line| line.strip_prefix(begins)).next() {
                return Ok(rest.trim_end().to_owned());
            }
            self.check()?;
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Fails if the run has ended, or the bench is to end.
    pub(crate) fn check(&mut self) -> Result<(), BenchError> {
        if self.stop.requested() {
            return Err(BenchError::Interrupted);
        }
        match self.run.ended() {
            None => Ok(()),
            Some(status) => Err(self.broken(format!("the run ended ({})", in_words(status)))),
        }
    }

    /// Waits for its end; its summary.
    pub(crate) fn summary(mut self) -> Result<Value, BenchError> {
        let began = Instant::now();
        let status = loop {
            // An interruption is a turn without news.
            let _ =
                poll(&mut [PollFd::from_borrowed_fd(self.run.pidfd(), PollFlags::IN)], Some(&LOOK));
            if let Some(status) = self.run.ended() {
                break status;
            }
            if self.stop.requested() {
                return Err(BenchError::Interrupted);
            }
            if began.elapsed() > LIMIT {
                return Err(self.broken(format!("a run took more than {} s", LIMIT.as_secs())));
            }
        };
        if !status.success() {
            return Err(self.broken(format!("a run failed ({})", in_words(status))));
        }
        let path = self.run_dir().join("summary.json");
        let bytes = std::fs::read(&path).map_err(failed("read", &path))?;
        serde_json::from_slice(&bytes)
            .map_err(|error| BenchError::Wrong(format!("{}: {error}", path.display())))
    }

    /// With its own complaint if there is one, for its summary comes after that; else with the last
    /// lines of its log.
    fn broken(&self, what: String) -> BenchError {
        let log = std::fs::read_to_string(self.place.path().join("log")).unwrap_or_default();
        match log.lines().rev().find_map(|line| line.strip_prefix("error: ")) {
            Some(complaint) => BenchError::Wrong(format!("{what}: {complaint}")),
            None => BenchError::Peer { what, log: self.run.last_lines(LOG_LINES) },
        }
    }
}

impl Drop for Running<'_> {
    /// Lets it end its children and remove what they shared; a run that is killed cannot.
    fn drop(&mut self) {
        if self.run.ended().is_none() {
            self.run.terminate();
            let began = Instant::now();
            while self.run.ended().is_none() && began.elapsed() < END_MAX {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    }
}

/// Runs a scenario to its end.
pub(crate) fn run(
    root: &RunRoot,
    stop: &Stop,
    scenario: &str,
    pace: Pace,
) -> Result<Value, BenchError> {
    Running::start(root, stop, scenario, pace)?.summary()
}

/// Runs a scenario in real time to its end, with the priority of this setting and these words more.
pub(crate) fn run_realtime(
    setting: &Setting<'_>,
    scenario: &str,
    more: &[&str],
) -> Result<Value, BenchError> {
    let mut words = more.to_vec();
    words.extend(setting.realtime_priority.then_some("--realtime-priority"));
    let &Setting { root, stop, .. } = setting;
    Running::start_with(root, stop, scenario, Pace::Realtime, &words)?.summary()
}

/// A number of a summary.
pub(crate) fn number(summary: &Value, pointer: &str) -> Result<f64, BenchError> {
    let found = summary.pointer(pointer).and_then(Value::as_f64);
    found.ok_or_else(|| BenchError::Wrong(format!("summary.json has no number at {pointer}")))
}

/// Processor time by [`TAKERS`], s, from the first process to the last one's end.
pub(crate) fn taken_s(summary: &Value) -> Result<[f64; TAKERS.len()], BenchError> {
    let processes = summary["wall"]["processes"].as_array();
    let processes = processes
        .ok_or_else(|| BenchError::Wrong("summary.json has no list at /wall/processes".into()))?;
    let mut taken_s = [0.0; TAKERS.len()];
    for process in processes {
        let taker = match process["name"].as_str() {
            Some("plant") => 1,
            Some("supervisor") => 2,
            Some("awake") => continue,
            _ => 0,
        };
        taken_s[taker] += number(process, "/user_s")? + number(process, "/system_s")?;
    }
    Ok(taken_s)
}

/// The largest of the robots' figures of this name of how late they woke, us; `None` where the
/// summary tells nothing of it.
pub(crate) fn latest_wake_us(summary: &Value, key: &str) -> Option<f64> {
    let stages = summary["wall"]["latency"].as_array()?;
    let robots = stages.iter().filter(|row| row["stage"] == "wake" && row["robot"] != "plant");
    robots.filter_map(|row| row[key].as_f64()).reduce(f64::max).map(|ns| ns / 1e3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_robot_counts_and_the_plant_does_not() {
        let row = |stage: &str, robot: &str, p50_ns: u64| serde_json::json!({ "stage": stage, "robot": robot, "p50_ns": p50_ns });
        let rows = [
            row("wake", "plant", 9000),
            row("wake", "r1", 1000),
            row("wake", "r2", 2500),
            row("compute", "r1", 8000),
        ];
        let summary = serde_json::json!({ "wall": { "latency": rows } });
        assert_eq!(latest_wake_us(&summary, "p50_ns"), Some(2.5));
        assert_eq!(latest_wake_us(&serde_json::json!({}), "p50_ns"), None);
    }
}
