//! What was run, where and how: `manifest.json`.
//!
//! Must not: fail, or ask the source tree, which may have changed since the program was built.

use std::fs;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use protocol::brief::Pace;
use serde::Serialize;

use crate::results::programs::Listed;
use experiment::scenario::Scenario;
use formation::seconds;

/// When a run in lockstep began as far as its recording goes, ns since 1970: always the same, so that
/// the same run gives the same bytes. The first instant of the year 2000 in UTC, which nobody takes
/// for the real one, and not 0, which readers of ROS take for no time at all.
pub(crate) const LOCKSTEP_EPOCH_UNIX_NS: u64 = 946_684_800_000_000_000;

/// How this program was built. What was not known then is `None`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Build {
    /// Commit of the source tree.
    pub git_hash: Option<String>,
    /// Whether the sources differed from that commit.
    pub git_dirty: Option<bool>,
    /// The compiler and its version.
    pub rustc: Option<String>,
    /// `debug` or `release`.
    pub profile: Option<String>,
}

/// What was run, where and how.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Manifest {
    /// Version of this program.
    pub phalanx: &'static str,
    /// How it was built.
    #[serde(flatten)]
    pub build: Build,
    /// The scenario's name.
    pub scenario: String,
    /// The file it came from.
    pub scenario_path: String,
    /// The command line.
    pub command: Vec<String>,
    /// The files of the programs of its own that were run.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub programs: Vec<Listed>,
    /// Seed of everything random.
    pub seed: u64,
    /// How time passed.
    pub pace: Pace,
    /// T, s.
    pub period_s: f64,
    /// What became of `--realtime-priority`, if it was asked for: `granted`, or why not.
    pub realtime_priority: Option<String>,
    /// The C library, whose mathematical functions every trajectory depends on, and its version.
    pub libc: Option<String>,
    /// Operating system and version.
    pub kernel: String,
    /// Processor architecture.
    pub machine: String,
    /// The processor's model.
    pub processor: Option<String>,
    /// Cores that this process may use.
    pub cores: usize,
    /// Load averages over 1, 5 and 15 minutes when the run began.
    pub load_average: String,
    /// When the run began, ns since 1970, UTC.
    pub started_unix_ns: u64,
    /// The same in the stamps of the recording, where run time counts from: in lockstep a constant.
    pub epoch_unix_ns: u64,
}

impl Manifest {
    /// Looks around, and never fails for it.
    pub fn collect(scenario: &Scenario, path: &Path, pace: Pace, build: &Build) -> Manifest {
        let system = rustix::system::uname();
        let text = |part: &std::ffi::CStr| part.to_string_lossy().into_owned();
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let started_unix_ns = since_1970.as_nanos() as u64;
        Manifest {
            phalanx: env!("CARGO_PKG_VERSION"),
            build: build.clone(),
            scenario: scenario.name.clone(),
            scenario_path: path.display().to_string(),
            command: std::env::args_os().map(|arg| arg.to_string_lossy().into_owned()).collect(),
            programs: Vec::new(),
            seed: scenario.seed,
            pace,
            period_s: seconds(scenario.period_ns),
            realtime_priority: None,
            libc: libc_version(),
            kernel: format!("{} {}", text(system.sysname()), text(system.release())),
            machine: text(system.machine()),
            processor: processor(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            load_average: load_average(),
            started_unix_ns,
            epoch_unix_ns: match pace {
                Pace::Lockstep => LOCKSTEP_EPOCH_UNIX_NS,
                Pace::Realtime => started_unix_ns,
            },
        }
    }
}

#[cfg(target_env = "gnu")]
fn libc_version() -> Option<String> {
    // SAFETY: takes nothing, and returns a constant string that ends in 0.
    let version = unsafe { std::ffi::CStr::from_ptr(libc::gnu_get_libc_version()) };
    Some(format!("glibc {}", version.to_string_lossy()))
}

#[cfg(not(target_env = "gnu"))]
fn libc_version() -> Option<String> {
    None
}

/// Load averages over 1, 5 and 15 minutes; nothing where the kernel tells none.
pub fn load_average() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').take(3).collect::<Vec<_>>().join(" ")
}

/// The processor's model, if the kernel tells it.
pub fn processor() -> Option<String> {
    named_in(&fs::read_to_string("/proc/cpuinfo").unwrap_or_default())
}

/// The model that /proc/cpuinfo names; which line does depends on the architecture.
fn named_in(cpuinfo: &str) -> Option<String> {
    let value = |name: &str| {
        let mut lines = cpuinfo.lines().filter_map(|line| line.split_once(':'));
        let found = lines.find(|(key, value)| key.trim() == name && !value.trim().is_empty());
        found.map(|(_, value)| value.trim().to_owned())
    };
    // Processors of ARM are numbers there.
    let arm = || {
        let (implementer, part) = (value("CPU implementer")?, value("CPU part")?);
        Some(format!("ARM implementer {implementer}, part {part}"))
    };
    value("model name").or_else(|| value("Model")).or_else(arm)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_is_named_on_every_architecture() {
        let x86 = "processor\t: 0\nmodel\t\t: 85\nmodel name\t: Some CPU @ 2.60GHz\n";
        assert_eq!(named_in(x86).as_deref(), Some("Some CPU @ 2.60GHz"));
        let arm = "processor\t: 0\nCPU implementer\t: 0x41\nCPU part\t: 0xd0c\n";
        assert_eq!(named_in(arm).as_deref(), Some("ARM implementer 0x41, part 0xd0c"));
        assert_eq!(named_in("processor\t: 0\n"), None);
    }
}
