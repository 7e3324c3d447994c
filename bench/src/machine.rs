//! On what it was measured, and whether it was busy.

use std::fmt::Write as _;
use std::time::{SystemTime, UNIX_EPOCH};

use outcome::results::{date, manifest};
use serde::Serialize;

/// More load than this for each core, and the floors are those of a crowd.
const LOAD_PER_CORE_MAX: f64 = 0.25;

/// The machine, and how busy it was.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Machine {
    /// When the bench began, UTC.
    date: String,
    /// Model of the processor.
    processor: String,
    /// Operating system, version and architecture.
    kernel: String,
    /// Cores that this process may use.
    cores: usize,
    /// Frequency governor of the first core; `unknown` in most virtual machines.
    governor: String,
    /// Load averages over 1, 5 and 15 minutes, before.
    load_before: String,
    /// The same afterwards: the bench's own load included.
    load_after: Option<String>,
}

impl Machine {
    /// Looks around, and never fails for it.
    pub(crate) fn look() -> Machine {
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

    /// Looks at the load again.
    pub(crate) fn look_again(&mut self) {
        self.load_after = Some(manifest::load_average());
    }

    /// What makes figures from here doubtful.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let last_minute: f64 =
            self.load_before.split(' ').next().and_then(|word| word.parse().ok()).unwrap_or(0.0);
        let (limit, cores) = (LOAD_PER_CORE_MAX * self.cores as f64, self.cores);
        if last_minute > limit {
            warnings.push(format!(
                "the load was {last_minute} on {cores} cores before the bench began (expected at \
                 most {limit}): the figures are those of a busy machine, and mean little"
            ));
        }
        if cfg!(debug_assertions) {
            warnings.push("this is a debug build: ours is slower than it need be".into());
        }
        if self.governor != "unknown" && self.governor != "performance" {
            warnings.push(format!(
                "the frequency governor is {} (expected performance): baselines that sleep look slow",
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
