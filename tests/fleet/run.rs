//! A run on several hosts, and its results.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use protocol::brief::{self, AgentBrief, PlantBrief};
use serde_json::Value;
use tempfile::TempDir;

use crate::hosts::{Hosts, NAMES, children_of};

/// Deadline for the end of a run on all hosts. Only a hang reaches it.
const DEADLINE: Duration = Duration::from_secs(240);

/// A run in progress on all hosts.
pub struct Run {
    folder: TempDir,
    hosts: Vec<Child>,
}

/// Results of a run that has ended.
pub struct FinishedFleetRun {
    folder: TempDir,
    /// Exit codes by host. `None` for a host whose supervisor was killed.
    pub codes: Vec<Option<i32>>,
    /// Contents of `summary.json` on the plant's host.
    pub summary: Value,
}

impl Run {
    /// Starts a shipped scenario on all hosts, with these options.
    pub fn start(hosts: &Hosts, scenario: &str, fleet: &str, options: &[&str]) -> Run {
        let scenario = format!("{}/scenarios/{scenario}.toml", env!("CARGO_MANIFEST_DIR"));
        Run::start_file(hosts, Path::new(&scenario), fleet, options)
    }

    /// Starts the scenario of a file on all hosts, with these options.
    pub fn start_file(hosts: &Hosts, scenario: &Path, fleet: &str, options: &[&str]) -> Run {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("fleet.toml");
        std::fs::write(&file, fleet).unwrap();
        let count = fleet.matches("[[host]]").count();
        let has_keys = fleet.contains("certificates = ");
        if has_keys {
            let mut keys = Command::new(env!("CARGO_BIN_EXE_phalanx"));
            let made = keys.args(["fleet", "keys"]).arg(&file).output().unwrap();
            assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        }
        let start = |host: usize| {
            let name = NAMES[host];
            let log = std::fs::File::create(folder.path().join(format!("{name}.log"))).unwrap();
            let mut command = hosts.on(host, env!("CARGO_BIN_EXE_phalanx"));
            command.arg("run").arg(scenario);
            command.arg("--fleet").arg(&file).args(["--host", name, "--no-report"]);
            if !has_keys {
                command.arg("--insecure");
            }
            // Independent of the load of the machine.
            command.arg("--realtime-priority");
            command.arg("--out").arg(folder.path().join(name)).args(options);
            command.stdin(Stdio::null());
            command.stdout(log.try_clone().unwrap()).stderr(log);
            command.spawn().unwrap()
        };
        // The order is not significant: the plant's host starts last.
        let mut started: Vec<Child> = (0..count).rev().map(start).collect();
        started.reverse();
        Run { folder, hosts: started }
    }

    /// Waits until the run has reached this run time.
    pub fn wait_for_run_time(&mut self, t_s: f64) {
        let samples = self.folder.path().join("a/samples.csv");
        let start = Instant::now();
        loop {
            let text = std::fs::read_to_string(&samples).unwrap_or_default();
            // The last line may be incomplete.
            let last = text.lines().rev().nth(1).and_then(|line| line.split(',').next());
            if last.and_then(|t| t.parse::<f64>().ok()).is_some_and(|t| t >= t_s) {
                return;
            }
            let ended = self.hosts[0].try_wait().unwrap();
            assert!(ended.is_none() && start.elapsed() < DEADLINE, "{}", self.logs());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Returns the process id of a host's supervisor.
    pub fn pid(&self, host: usize) -> u32 {
        self.hosts[host].id()
    }

    /// Waits until `events.csv` of the plant's host has an event of this kind.
    pub fn wait_for_event(&mut self, kind: &str) {
        let events = self.folder.path().join("a/events.csv");
        let start = Instant::now();
        loop {
            let text = std::fs::read_to_string(&events).unwrap_or_default();
            if text.lines().any(|line| line.split(',').nth(1) == Some(kind)) {
                return;
            }
            let ended = self.hosts[0].try_wait().unwrap();
            assert!(ended.is_none() && start.elapsed() < DEADLINE, "no {kind}: {}", self.logs());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits until the supervisor of a host has ended.
    pub fn wait_for_host(&mut self, host: usize) {
        let start = Instant::now();
        while self.hosts[host].try_wait().unwrap().is_none() {
            assert!(start.elapsed() < DEADLINE, "host {host} does not end: {}", self.logs());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Kills a process of a host by its name.
    pub fn kill_child(&self, host: usize, name: &str) {
        self.signal_child(host, name, libc::SIGKILL);
    }

    /// Sends a signal to a process of a host, by its name.
    pub fn signal_child(&self, host: usize, name: &str, signal: i32) {
        let found = children_of(self.hosts[host].id());
        let (pid, _) =
            found.iter().find(|(_, comm)| comm == name).unwrap_or_else(|| panic!("{found:?}"));
        // SAFETY: a plain system call about a process of this test.
        unsafe { libc::kill(*pid as i32, signal) };
    }

    /// Sends a signal to the supervisor of a host.
    pub fn signal_host(&self, host: usize, signal: i32) {
        // SAFETY: a plain system call about a process of this test.
        unsafe { libc::kill(self.hosts[host].id() as i32, signal) };
    }

    /// Kills a host's supervisor, and with it all of its processes.
    pub fn kill_host(&mut self, host: usize) {
        self.hosts[host].kill().unwrap();
    }

    /// Waits for all hosts.
    pub fn end(mut self) -> FinishedFleetRun {
        let start = Instant::now();
        let mut codes = Vec::new();
        for (host, name) in NAMES.iter().enumerate().take(self.hosts.len()) {
            let status = loop {
                if let Some(status) = self.hosts[host].try_wait().unwrap() {
                    break status;
                }
                assert!(start.elapsed() < DEADLINE, "{name} does not end: {}", self.logs());
                std::thread::sleep(Duration::from_millis(20));
            };
            codes.push(status.code());
        }
        let path = self.folder.path().join("a/summary.json");
        // Of a plant's host that was killed there is none.
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let summary = serde_json::from_str(text.trim()).unwrap_or(Value::Null);
        let folder = std::mem::replace(&mut self.folder, tempfile::tempdir().unwrap());
        FinishedFleetRun { folder, codes, summary }
    }

    /// Returns the output of all hosts so far.
    pub fn logs(&self) -> String {
        logs(self.folder.path())
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        for host in &mut self.hosts {
            let _ = host.kill();
            let _ = host.wait();
        }
    }
}

fn logs(folder: &Path) -> String {
    let read = |name: String| std::fs::read_to_string(folder.join(name)).unwrap_or_default();
    let of = |name: &str| {
        let (screen, bridge) =
            (read(format!("{name}.log")), read(format!("{name}/logs/bridge.jsonl")));
        format!("--- {name}:\n{screen}\n--- {name}, its bridge:\n{bridge}")
    };
    NAMES.map(of).join("\n")
}

impl FinishedFleetRun {
    /// Returns the output of all hosts, and the logs of their bridges.
    pub fn logs(&self) -> String {
        logs(self.folder.path())
    }

    /// Returns the output of one host.
    pub fn log(&self, host: usize) -> String {
        let path: PathBuf = self.folder.path().join(format!("{}.log", NAMES[host]));
        std::fs::read_to_string(path).unwrap_or_default()
    }

    /// Returns the events of a kind: time (s), robot and detail.
    pub fn events(&self, kind: &str) -> Vec<(f64, String, String)> {
        let text = std::fs::read_to_string(self.folder.path().join("a/events.csv")).unwrap();
        let lines = text.lines().skip(1).filter_map(|line| {
            let mut fields = line.splitn(4, ',');
            let t_s = fields.next()?.parse().ok()?;
            let (found, robot, rest) = (fields.next()?, fields.next()?, fields.next()?);
            let detail = match rest.strip_prefix('"') {
                Some(quoted) => quoted.split_once("\",")?.0,
                None => rest.split(',').next()?,
            };
            (found == kind).then(|| (t_s, robot.to_owned(), detail.to_owned()))
        });
        lines.collect()
    }

    /// Returns the number at a JSON pointer of the summary.
    pub fn number(&self, pointer: &str) -> Option<f64> {
        self.summary.pointer(pointer)?.as_f64()
    }

    /// Returns the number of messages that all bridges dropped for this reason.
    pub fn dropped_count(&self, why: &str) -> u64 {
        let hosts = self.summary["wall"]["hosts"].as_array().unwrap();
        hosts.iter().filter_map(|host| host["dropped"][why].as_u64()).sum()
    }

    /// Checks that no two front points came closer than d, and that no message was used beyond its maximum age:
    /// commands by the plant's clock, beacons and odometry by the clock of the robot that used them.
    pub fn assert_safe(&self) {
        assert_eq!(self.summary["violations"], 0, "{}", self.logs());
        let brief = |name: &str| self.folder.path().join(format!("a/briefs/{name}.toml"));
        let plant: PlantBrief = brief::read(&brief("plant")).unwrap();
        let lifetime_ns = plant.command_lifetime_ns as f64;
        let command_ns = self.number("/commands/age_ns_max").unwrap();
        assert!(0.0 < command_ns && command_ns <= lifetime_ns, "{command_ns} ns");
        let robot: AgentBrief = brief::read(&brief(&plant.robots[0].name)).unwrap();
        // The age of a beacon is relative to the stamp of a sample, which is younger than the lifetime when it is used.
        let beacon_ns_max = robot.silence.lost_after_ns as f64 + lifetime_ns;
        let ages = self.summary["ages"].as_array().unwrap();
        assert!(!ages.is_empty(), "{}", self.logs());
        for edge in ages {
            assert!(edge["max_ns"].as_f64().unwrap() < beacon_ns_max, "{edge}");
        }
        eprintln!(
            "oldest used: commands {:.1} of {:.1} ms, beacons {:.1} of {:.1} ms; {} samples unanswered, {} commands late",
            command_ns / 1e6,
            lifetime_ns / 1e6,
            ages.iter().filter_map(|edge| edge["max_ns"].as_f64()).fold(0.0, f64::max) / 1e6,
            beacon_ns_max / 1e6,
            self.summary["commands"]["unanswered"],
            self.summary["commands"]["late"],
        );
    }

    /// Returns the maximum age of the newest beacon that a robot had of another one, s.
    pub fn peak_s(&self, robot: &str, from: &str) -> f64 {
        let edges = self.summary["information_ages"].as_array().unwrap();
        let edge = edges.iter().find(|edge| edge["robot"] == robot && edge["from"] == from);
        edge.unwrap_or_else(|| panic!("{edges:?}"))["peak_ns"].as_f64().unwrap() / 1e9
    }

    /// Checks that these robots of one host never lost each other.
    pub fn assert_undisturbed(&self, robots: &[&str]) {
        for (t_s, robot, what) in self.events("contact") {
            let of_them = |name: &str| robots.contains(&name);
            let lost = what.strip_prefix("lost ").is_some_and(of_them);
            assert!(!(lost && of_them(&robot)), "{robot} {what} at {t_s} s\n{}", self.logs());
        }
    }

    /// Checks that the run was safe, and that it passed on every host. If other programs occupied the cores, as the
    /// plant's host reports, robots stopped for lack of commands: errors and times may then miss their expectations,
    /// but the robots must still come near their goals.
    pub fn assert_passed(&self) {
        let has_passed = self.codes.iter().all(|code| *code == Some(0));
        let only_late = self.codes[0] == Some(1)
            && self.codes[1..].iter().all(|code| *code == Some(0))
            && self.log(0).contains("other programs occupied the cores");
        assert!(has_passed || only_late, "{:?}\n{}", self.codes, self.logs());
        for expectation in self.summary["expectations"].as_array().unwrap() {
            let name = expectation["name"].as_str().unwrap();
            let is_timed = ["error", "hull", "converged"].iter().any(|word| name.contains(word));
            assert!(expectation["held"] == true || (only_late && is_timed), "{}", self.logs());
        }
        let final_error_m = self.number("/final_error_m_max");
        assert!(
            has_passed || final_error_m.is_some_and(|error_m| error_m <= 0.1),
            "{}",
            self.logs()
        );
        self.assert_safe();
    }
}
