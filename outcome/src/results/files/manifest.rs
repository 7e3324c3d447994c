//! Manifest of a run, `manifest.json`: what was run, where and how.
//!
//! Must not: fail, or read the source tree, which may have changed since the program was built.

use std::fs;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use protocol::brief::Pace;
use serde::Serialize;

use crate::results::files::programs::ManifestFile;
use experiment::scenario::Scenario;
use formation::ns_to_seconds;

/// Start of every lockstep run in its recording, ns since 1970: a constant, so that equal runs give equal bytes. It
/// is the first instant of the year 2000 in UTC, an obvious placeholder, and not 0, which ROS tools treat as no
/// time.
pub(crate) const LOCKSTEP_EPOCH_UNIX_NS: u64 = 946_684_800_000_000_000;

/// Build information of this program. Unknown values are `None`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct BuildInfo {
    /// Commit of the source tree.
    pub git_hash: Option<String>,
    /// Whether the sources differed from that commit.
    pub git_dirty: Option<bool>,
    /// Compiler and its version.
    pub rustc: Option<String>,
    /// Build profile: `debug` or `release`.
    pub profile: Option<String>,
}

/// Manifest: what was run, where and how.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Manifest {
    /// Version of this program.
    pub phalanx: &'static str,
    /// Build information.
    #[serde(flatten)]
    pub build: BuildInfo,
    /// Name of the scenario.
    pub scenario: String,
    /// Path of the scenario file.
    pub scenario_path: String,
    /// Command line.
    pub command: Vec<String>,
    /// Files of the external programs that were run.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub programs: Vec<ManifestFile>,
    /// Seed of the random number generator.
    pub seed: u64,
    /// Time mode (lockstep or real time).
    pub pace: Pace,
    /// Control period T, s.
    pub period_s: f64,
    /// Result of `--realtime-priority`, if requested: `granted`, or the reason of the refusal.
    pub realtime_priority: Option<String>,
    /// C library and its version. Trajectories depend on its mathematical functions.
    pub libc: Option<String>,
    /// Operating system and version.
    pub kernel: String,
    /// Processor architecture.
    pub machine: String,
    /// Processor model.
    pub processor: Option<String>,
    /// Number of cores that this process may use.
    pub cores: usize,
    /// Load averages over 1, 5 and 15 minutes at the start.
    pub load_average: String,
    /// Start of the run, ns since 1970, UTC.
    pub started_unix_ns: u64,
    /// Start of the run in the stamps of the recording, ns since 1970: a constant in lockstep.
    pub epoch_unix_ns: u64,
}

impl Manifest {
    /// Collects the manifest. Values that cannot be determined are left empty.
    pub fn collect(scenario: &Scenario, path: &Path, pace: Pace, build: &BuildInfo) -> Manifest {
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
            period_s: ns_to_seconds(scenario.period_ns),
            realtime_priority: None,
            libc: libc_version(),
            kernel: format!("{} {}", text(system.sysname()), text(system.release())),
            machine: text(system.machine()),
            processor: processor_model(),
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

/// Returns the load averages over 1, 5 and 15 minutes; empty if the kernel does not report them.
pub fn load_average() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').take(3).collect::<Vec<_>>().join(" ")
}

/// Returns the processor model, if the kernel reports it.
pub fn processor_model() -> Option<String> {
    parse_processor_model(&fs::read_to_string("/proc/cpuinfo").unwrap_or_default())
}

/// Returns the processor model in the text of /proc/cpuinfo, whose keys depend on the architecture.
fn parse_processor_model(cpuinfo: &str) -> Option<String> {
    let value = |name: &str| {
        let mut lines = cpuinfo.lines().filter_map(|line| line.split_once(':'));
        let found = lines.find(|(key, value)| key.trim() == name && !value.trim().is_empty());
        found.map(|(_, value)| value.trim().to_owned())
    };
    // /proc/cpuinfo identifies ARM processors by numbers.
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
    fn processor_name_is_read_on_every_architecture() {
        let x86 = "processor\t: 0\nmodel\t\t: 85\nmodel name\t: Some CPU @ 2.60GHz\n";
        assert_eq!(parse_processor_model(x86).as_deref(), Some("Some CPU @ 2.60GHz"));
        let arm = "processor\t: 0\nCPU implementer\t: 0x41\nCPU part\t: 0xd0c\n";
        assert_eq!(parse_processor_model(arm).as_deref(), Some("ARM implementer 0x41, part 0xd0c"));
        assert_eq!(parse_processor_model("processor\t: 0\n"), None);
    }
}
