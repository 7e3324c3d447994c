//! Description and load of the machine that runs the bench.

use std::fmt::Write as _;
use std::time::{SystemTime, UNIX_EPOCH};

use outcome::results::{date, manifest};
use serde::Serialize;

/// Maximum load average per core of an idle machine. A higher load makes the report warn that the results are doubtful.
const LOAD_PER_CORE_MAX: f64 = 0.25;

/// Description of the machine and its load before and after the bench.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Machine {
    /// Start time of the bench, UTC.
    date: String,
    /// Processor model.
    processor: String,
    /// Operating system, version and architecture.
    kernel: String,
    /// Number of cores available to this process.
    cores: usize,
    /// CPU frequency governor of the first core; `unknown` in most virtual machines.
    governor: String,
    /// Load averages over 1, 5 and 15 minutes before the bench.
    load_before: String,
    /// Load averages over 1, 5 and 15 minutes after the bench, including its own load; `None` until it ends.
    load_after: Option<String>,
}

impl Machine {
    /// Reads the description and the current load of the machine. A value that cannot be read becomes `unknown`, or 1
    /// for the number of cores.
    pub(crate) fn probe() -> Machine {
        let system = rustix::system::uname();
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let governor =
            std::fs::read_to_string("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
        let unknown = || "unknown".to_owned();
        Machine {
            date: date::format_for_file_name(seconds),
            processor: manifest::processor_model().unwrap_or_else(unknown),
            kernel: [system.sysname(), system.release(), system.machine()]
                .map(|part| part.to_string_lossy())
                .join(" "),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            governor: governor.map_or_else(|_| unknown(), |text| text.trim().into()),
            load_before: manifest::load_average(),
            load_after: None,
        }
    }

    /// Records the load averages after the bench.
    pub(crate) fn update_load(&mut self) {
        self.load_after = Some(manifest::load_average());
    }

    /// Returns the conditions of this machine that make its results doubtful.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let last_minute: f64 =
            self.load_before.split(' ').next().and_then(|text| text.parse().ok()).unwrap_or(0.0);
        let (limit, cores) = (LOAD_PER_CORE_MAX * self.cores as f64, self.cores);
        if last_minute > limit {
            warnings.push(format!(
                "the load average was {last_minute} on {cores} cores before the bench (must be at \
                 most {limit} for reliable results); stop other programs and repeat the bench"
            ));
        }
        if cfg!(debug_assertions) {
            warnings
                .push("this is a debug build, so Phalanx is slower; use a release build".into());
        }
        if self.governor != "unknown" && self.governor != "performance" {
            warnings.push(format!(
                "the frequency governor is {} (must be performance for reliable results): baselines \
                 that sleep appear slow",
                self.governor
            ));
        }
        warnings
    }

    /// Returns the description as text for the report.
    pub(crate) fn to_text(&self) -> String {
        let mut text = String::new();
        let Machine { date, processor, kernel, cores, governor, load_before, .. } = self;
        let after = self.load_after.as_deref().unwrap_or("-");
        let _ = writeln!(text, "{processor}, {cores} cores, governor {governor}");
        let _ = writeln!(text, "{kernel}, {date} UTC");
        let _ = writeln!(text, "load average {load_before} before, {after} after");
        text
    }
}
