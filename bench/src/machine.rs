//! Description of the machine and its load.

use std::fmt::Write as _;
use std::time::{SystemTime, UNIX_EPOCH};

use outcome::results::{date, manifest};
use serde::Serialize;

/// Load per core above which a warning says that the baselines are not those of an idle machine.
const LOAD_PER_CORE_MAX: f64 = 0.25;

/// The machine, and its load.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Machine {
    /// Start time of the bench, UTC.
    date: String,
    /// Model of the processor.
    processor: String,
    /// Operating system, version and architecture.
    kernel: String,
    /// Number of cores that this process may use.
    cores: usize,
    /// Frequency governor of the first core; `unknown` in most virtual machines.
    governor: String,
    /// Load averages over 1, 5 and 15 minutes, before the measurements.
    load_before: String,
    /// Load averages after the measurements, which include the bench's own load.
    load_after: Option<String>,
}

impl Machine {
    /// Reads the description. Never fails: missing values are `unknown`.
    pub(crate) fn read() -> Machine {
        let system = rustix::system::uname();
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let governor =
            std::fs::read_to_string("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
        let unknown = || "unknown".to_owned();
        Machine {
            date: date::format_for_name(seconds),
            processor: manifest::processor().unwrap_or_else(unknown),
            kernel: [system.sysname(), system.release(), system.machine()]
                .map(|part| part.to_string_lossy())
                .join(" "),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            governor: governor.map_or_else(|_| unknown(), |text| text.trim().into()),
            load_before: manifest::load_average(),
            load_after: None,
        }
    }

    /// Reads the load after the measurements.
    pub(crate) fn read_load_after(&mut self) {
        self.load_after = Some(manifest::load_average());
    }

    /// Returns warnings about conditions that make the values doubtful.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let last_minute: f64 =
            self.load_before.split(' ').next().and_then(|word| word.parse().ok()).unwrap_or(0.0);
        let (limit, cores) = (LOAD_PER_CORE_MAX * self.cores as f64, self.cores);
        if last_minute > limit {
            warnings.push(format!(
                "the load was {last_minute} on {cores} cores before the bench began (should be at \
                 most {limit}): the values are those of a busy machine, and say little"
            ));
        }
        if cfg!(debug_assertions) {
            warnings.push("this is a debug build: runs are slower than in release".into());
        }
        if self.governor != "unknown" && self.governor != "performance" {
            warnings.push(format!(
                "the frequency governor is {} (should be performance): baselines that sleep appear slow",
                self.governor
            ));
        }
        warnings
    }

    pub(crate) fn screen(&self) -> String {
        let mut text = String::new();
        let Machine { date, processor, kernel, cores, governor, load_before, .. } = self;
        let after = self.load_after.as_deref().unwrap_or("-");
        let _ = writeln!(text, "{processor}, {cores} cores, governor {governor}");
        let _ = writeln!(text, "{kernel}, {date} UTC");
        let _ = writeln!(text, "load average {load_before} before, {after} after");
        text
    }
}
