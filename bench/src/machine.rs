//! Description and load of the machine that runs the bench.

use std::fmt::Write as _;
use std::time::{SystemTime, UNIX_EPOCH};

use outcome::results::{date, manifest};
use serde::Serialize;

/// Maximum load average per core of an idle machine. A higher load makes the report warn that the results are doubtful.
const LOAD_PER_CORE_MAX: f64 = 0.25;
/// Steal time, in percent of the time of all cores, above which the report warns. Linux may subtract steal time from the
/// processor time of processes, also if the host reports it late: a measured processor time is then too small.
const STEAL_PERCENT_MAX: f64 = 1.0;

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
    /// Steal time during the bench, percent of the time of all cores: time in which the host of a virtual machine ran
    /// something else. `None` until the bench ends, or if unknown.
    steal_percent: Option<f64>,
    #[serde(skip)]
    processor_time_before: Option<ProcessorTime>,
}

/// Time of all cores since the machine started, in ticks of `/proc/stat`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ProcessorTime {
    steal: u64,
    total: u64,
}

impl ProcessorTime {
    /// Parses the text of `/proc/stat`.
    fn parse(text: &str) -> Option<ProcessorTime> {
        let line = text.lines().next()?.strip_prefix("cpu ")?;
        // User, nice, system, idle, iowait, irq, softirq, steal; what follows is part of user and nice.
        let fields: Vec<u64> =
            line.split_whitespace().take(8).map_while(|field| field.parse().ok()).collect();
        Some(ProcessorTime { steal: *fields.get(7)?, total: fields.iter().sum() })
    }

    fn read() -> Option<ProcessorTime> {
        ProcessorTime::parse(&std::fs::read_to_string("/proc/stat").ok()?)
    }

    /// Returns the steal time since `earlier`, percent.
    fn steal_percent_since(self, earlier: ProcessorTime) -> Option<f64> {
        let total = self.total.checked_sub(earlier.total).filter(|&total| total > 0)?;
        Some(100.0 * self.steal.saturating_sub(earlier.steal) as f64 / total as f64)
    }
}

impl Machine {
    /// Reads the description and the current load of the machine. A value that cannot be read becomes `unknown`, or 1
    /// for the number of cores.
    pub(crate) fn probe() -> Machine {
        let system = rustix::system::uname();
        let unix_time_s =
            SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let governor =
            std::fs::read_to_string("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
        let unknown = || "unknown".to_owned();
        Machine {
            date: date::format_for_file_name(unix_time_s),
            processor: manifest::processor_model().unwrap_or_else(unknown),
            kernel: [system.sysname(), system.release(), system.machine()]
                .map(|part| part.to_string_lossy())
                .join(" "),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            governor: governor.map_or_else(|_| unknown(), |text| text.trim().into()),
            load_before: manifest::load_average(),
            load_after: None,
            steal_percent: None,
            processor_time_before: ProcessorTime::read(),
        }
    }

    /// Records the load averages after the bench, and the steal time during it.
    pub(crate) fn update_load(&mut self) {
        self.load_after = Some(manifest::load_average());
        let times = ProcessorTime::read().zip(self.processor_time_before);
        self.steal_percent =
            times.and_then(|(current, earlier)| current.steal_percent_since(earlier));
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
        if let Some(steal) = self.steal_percent.filter(|&steal| steal > STEAL_PERCENT_MAX) {
            warnings.push(format!(
                "the host took {steal:.1} % of the time of this virtual machine during the bench (must be at most \
                 {STEAL_PERCENT_MAX} % for reliable results); repeat the bench"
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
        let load_after_text = self.load_after.as_deref().unwrap_or("-");
        let _ = writeln!(text, "{processor}, {cores} cores, governor {governor}");
        let _ = writeln!(text, "{kernel}, {date} UTC");
        let _ = write!(text, "load average {load_before} before, {load_after_text} after");
        let _ = match self.steal_percent {
            Some(steal) => writeln!(text, "; steal time {steal:.1} %"),
            None => writeln!(text),
        };
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steal_time_is_relative_to_the_time_of_all_cores() {
        let time = |text: &str| ProcessorTime::parse(text);
        let earlier = time("cpu  100 0 50 800 10 0 5 35 7 0\ncpu0 1 2 3\n").unwrap();
        assert_eq!(earlier, ProcessorTime { steal: 35, total: 1000 });
        let later = time("cpu  200 0 50 850 10 0 5 85 9 0\n").unwrap();
        assert_eq!(later.steal_percent_since(earlier), Some(25.0));
        assert_eq!(earlier.steal_percent_since(earlier), None);
        assert_eq!([time("cpu 1 2 3\n"), time("intr 1\n"), time("")], [None; 3]);
    }
}
