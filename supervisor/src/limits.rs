//! Reason why the kernel refuses another process, thread or file: the limit, its usage, and the remedy.
//!
//! Must not raise a limit. Much of /proc is read only after a refusal, or if a limit may be reached.

use std::fmt;
use std::fs;
use std::io;
use std::path::Path;

use protocol::cgroup;
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

use crate::cores::topology::read_number;

const BYTES_PER_MIB: u64 = 1 << 20;

/// A limit on the number of processes and threads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProcessCountLimit {
    /// Name of the limit, and its owner.
    pub name: String,
    /// Maximum that the limit permits.
    pub maximum: u64,
    /// Number that counts towards the limit now.
    pub used: u64,
    /// How to raise or avoid the limit.
    pub remedy: String,
}

impl fmt::Display for ProcessCountLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} of {}", self.name, self.used, self.maximum)
    }
}

/// Returns the reason for a refusal, as a clause that follows on `cannot start ...:`.
pub(crate) fn explain_refusal(error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(libc::EAGAIN) => format_process_limits(error, &read_process_limits()),
        Some(libc::ENOMEM) => explain_out_of_memory(error),
        Some(libc::EMFILE) => {
            let maximum = getrlimit(Resource::Nofile).current.map_or("-".into(), |n| n.to_string());
            format!(
                "this process has reached its limit of {maximum} open files (RLIMIT_NOFILE); raise it by \
                 `ulimit -n`, or by nofile in /etc/security/limits.conf"
            )
        }
        Some(libc::ENFILE) => format!(
            "this machine has reached its limit of {} open files (fs.file-max); raise it by \
             `sysctl fs.file-max=...` as root",
            read_number("/proc/sys/fs/file-max").map_or("-".into(), |n| n.to_string())
        ),
        _ => error.to_string(),
    }
}

fn format_process_limits(error: &io::Error, limits: &[ProcessCountLimit]) -> String {
    let reached: Vec<&ProcessCountLimit> =
        limits.iter().filter(|limit| limit.used >= limit.maximum).collect();
    if reached.is_empty() {
        let limit_texts: Vec<String> = limits.iter().map(ProcessCountLimit::to_string).collect();
        return format!(
            "the kernel permits no further process or thread ({error}); none of the known limits \
             is reached ({})",
            limit_texts.join(", ")
        );
    }
    let clauses = reached.iter().map(|ProcessCountLimit { name, maximum, used, remedy }| {
        format!("{name} permits {maximum} processes and threads, and there are {used}; {remedy}")
    });
    clauses.collect::<Vec<_>>().join("; ")
}

/// Number of processes and threads that a run needs in addition to its robots: supervisor, its cleanup, plant, and a
/// reserve.
const PROCESSES_OF_A_RUN: u64 = 8;

/// Returns the number of processes and threads that a run with that number of robots needs, without programs of the
/// scenario.
pub fn needed_processes(robots: usize) -> u64 {
    PROCESSES_OF_A_RUN + robots as u64
}

/// Returns every limit on the number of processes and threads that applies to this process.
pub fn read_process_limits() -> Vec<ProcessCountLimit> {
    read_exceedable_limits(u64::MAX)
}

/// Returns the limits on the number of processes and threads that `needed` more might exceed.
fn read_exceedable_limits(needed: u64) -> Vec<ProcessCountLimit> {
    let running_tasks: Option<u64> = fs::read_to_string("/proc/loadavg").ok().and_then(|text| {
        let tasks = text.split_whitespace().nth(3)?;
        tasks.split_once('/')?.1.parse().ok()
    });
    let may_exceed =
        |maximum: u64| maximum.saturating_sub(running_tasks.unwrap_or(maximum)) < needed;
    let mut limits: Vec<ProcessCountLimit> = read_user_limit(may_exceed).into_iter().collect();
    let groups = cgroup::find_cgroup_folders(Path::new("/"), "pids");
    limits.extend(groups.iter().filter_map(|group| read_group_limit(&group.path)));
    for name in ["threads-max", "pid_max"] {
        if let (Some(maximum), Some(used)) =
            (read_number(format!("/proc/sys/kernel/{name}")), running_tasks)
        {
            let remedy = format!("raise it by `sysctl kernel.{name}=...` as root");
            limits.push(ProcessCountLimit {
                name: format!("kernel.{name}"),
                maximum,
                used,
                remedy,
            });
        }
    }
    limits
}

/// Returns the limit RLIMIT_NPROC, or `None` if it is infinite, `may_exceed` rules out that it is reached, or this
/// process is exempt from it.
fn read_user_limit(may_exceed: impl Fn(u64) -> bool) -> Option<ProcessCountLimit> {
    let maximum = getrlimit(Resource::Nproc).current.filter(|&maximum| may_exceed(maximum))?;
    let exempt = CapabilitySet::SYS_RESOURCE | CapabilitySet::SYS_ADMIN;
    if capabilities(None).is_ok_and(|sets| sets.effective.intersects(exempt)) {
        return None;
    }
    let user = rustix::process::getuid().as_raw();
    let processes = fs::read_dir("/proc").ok()?.flatten();
    let used = processes.filter_map(|entry| count_threads(&entry.path(), user)).sum();
    Some(ProcessCountLimit {
        name: "RLIMIT_NPROC of this user".into(),
        maximum,
        used,
        remedy: "raise it by `ulimit -u`, or by nproc in /etc/security/limits.conf".into(),
    })
}

/// Returns the number of threads of a process, if it belongs to this user.
fn count_threads(process: &Path, user: u32) -> Option<u64> {
    let status = fs::read_to_string(process.join("status")).ok()?;
    let value = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse::<u64>().ok()
    };
    if value("Uid:")? == u64::from(user) { value("Threads:") } else { None }
}

fn read_group_limit(group: &Path) -> Option<ProcessCountLimit> {
    let maximum = read_number(group.join("pids.max"))?;
    let used = read_number(group.join("pids.current"))?;
    Some(ProcessCountLimit {
        name: format!("pids.max of the control group {}", group.display()),
        maximum,
        used,
        remedy: "raise it (of a container: --pids-limit; of a systemd unit: TasksMax=)".into(),
    })
}

/// Address space of the supervisor during a run, KiB, measured in real time with 3, 5, 12 and 64 robots and
/// rounded up.
const ADDRESS_KIB_OF_A_RUN: u64 = 32 << 10;
const ADDRESS_KIB_OF_A_ROBOT: u64 = 4608;

/// Limit of this process that is too low for a run.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum LimitTooLow {
    /// Address space, KiB.
    #[error(
        "{robots} robots need {needed} KiB of address space, and the limit is {maximum} KiB (RLIMIT_AS): raise it by \
         `ulimit -v {needed}`, or by as in /etc/security/limits.conf"
    )]
    AddressSpace {
        /// Number of robots.
        robots: usize,
        /// Address space that the run needs.
        needed: u64,
        /// Limit of the address space.
        maximum: u64,
    },
    /// Memory of a control group, MiB.
    #[error(
        "{robots} robots need about {needed} MiB of memory, and {name} leaves {available} of {maximum} MiB: raise it (of a \
         container: --memory; of a systemd unit: MemoryMax=), or run fewer robots"
    )]
    Memory {
        /// Number of robots.
        robots: usize,
        /// Memory that the run needs.
        needed: u64,
        /// Name of the limit.
        name: String,
        /// Free memory below the limit, page cache included.
        available: u64,
        /// Limit of the control group.
        maximum: u64,
    },
    /// Available memory of the machine, MiB.
    #[error(
        "{robots} robots need about {needed} MiB of memory, and {available} of {maximum} MiB of this machine are available: end \
         other programs, or run fewer robots"
    )]
    MachineMemory {
        /// Number of robots.
        robots: usize,
        /// Memory that the run needs.
        needed: u64,
        /// Available memory, page cache included.
        available: u64,
        /// Memory of the machine.
        maximum: u64,
    },
    /// Number of processes and threads.
    #[error(
        "{robots} robots need {needed} processes and threads, and {} permits {}, of which {} are in use: {}",
        limit.name, limit.maximum, limit.used, limit.remedy
    )]
    Processes {
        /// Number of robots.
        robots: usize,
        /// Number of processes and threads that the run needs.
        needed: u64,
        /// Limit that is too low.
        limit: ProcessCountLimit,
    },
    /// Queued signals, of which each timer takes one.
    #[error(
        "{robots} robots in lockstep need {needed} queued signals, one for each timer, and {used} of {maximum} are taken \
         (RLIMIT_SIGPENDING): raise it by `ulimit -i {}`, or by sigpending in /etc/security/limits.conf",
        used + needed
    )]
    QueuedSignals {
        /// Number of robots.
        robots: usize,
        /// Number of queued signals that the run needs.
        needed: u64,
        /// Number of signals that are queued for processes of this user.
        used: u64,
        /// Limit of queued signals.
        maximum: u64,
    },
}

/// Memory of a run and of each of its robots in lockstep, KiB, charged to the control group in addition to
/// the supervisor's memory before it starts the first process; measured with 3, 12 and 64 robots.
const MEMORY_KIB_IN_LOCKSTEP: [u64; 2] = [5 << 10, 2350];
/// Memory of a run and of each of its robots in real time, KiB, where queues are longer.
const MEMORY_KIB_IN_REAL_TIME: [u64; 2] = [4 << 10, 3450];
/// Number of robots up to which these figures hold, and additional memory of each further robot, KiB; measured with
/// 1,024 robots, whose latencies, and so the histograms of them, have a wider range.
const FURTHER_ROBOT_MEMORY_KIB: (u64, u64) = (128, 2100);

/// Returns the memory that a run needs, bytes, shared memory included.
pub fn needed_memory_bytes(robots: usize, in_lockstep: bool) -> u64 {
    let [run_kib, robot_kib] =
        if in_lockstep { MEMORY_KIB_IN_LOCKSTEP } else { MEMORY_KIB_IN_REAL_TIME };
    let (small_count, further_robot_kib) = FURTHER_ROBOT_MEMORY_KIB;
    let further_robots = (robots as u64).saturating_sub(small_count);
    1024 * (run_kib + robot_kib * robots as u64 + further_robot_kib * further_robots)
}

/// Checks that processes, memory, address space and, in lockstep, queued signals suffice for a run.
///
/// # Errors
/// The first limit that is too low.
pub fn check(robots: usize, in_lockstep: bool) -> Result<(), LimitTooLow> {
    let needed = needed_processes(robots);
    let mut limits = read_exceedable_limits(needed).into_iter();
    if let Some(limit) = limits.find(|limit| limit.maximum.saturating_sub(limit.used) < needed) {
        return Err(LimitTooLow::Processes { robots, needed, limit });
    }
    let needed = needed_memory_bytes(robots, in_lockstep);
    let [available, maximum] = ["MemAvailable", "MemTotal"].map(read_machine_memory_mib);
    if let (Some(available), Some(maximum)) = (available, maximum)
        && available < needed.div_ceil(BYTES_PER_MIB)
    {
        return Err(LimitTooLow::MachineMemory {
            robots,
            needed: needed.div_ceil(BYTES_PER_MIB),
            available,
            maximum,
        });
    }
    for MemoryLimit { name, max_bytes: maximum, used_bytes, reclaimable_bytes } in
        read_memory_limits()
    {
        let available = maximum.saturating_sub(used_bytes.saturating_sub(reclaimable_bytes));
        if available < needed {
            let [needed, available, maximum] = [
                needed.div_ceil(BYTES_PER_MIB),
                available / BYTES_PER_MIB,
                maximum / BYTES_PER_MIB,
            ];
            return Err(LimitTooLow::Memory { robots, needed, name, available, maximum });
        }
    }
    let page_count = fs::read_to_string("/proc/self/statm").ok();
    let page_count =
        page_count.and_then(|text| text.split_whitespace().next()?.parse::<u64>().ok());
    if let (Some(bytes), Some(page_count)) = (getrlimit(Resource::As).current, page_count) {
        let used_kib = page_count * rustix::param::page_size() as u64 / 1024;
        let needed = used_kib + ADDRESS_KIB_OF_A_RUN + ADDRESS_KIB_OF_A_ROBOT * robots as u64;
        if bytes / 1024 < needed {
            return Err(LimitTooLow::AddressSpace { robots, needed, maximum: bytes / 1024 });
        }
    }
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    match parse_queued_signals(&status) {
        // The plant has a timer too.
        Some((used, maximum)) if in_lockstep && used + robots as u64 + 1 > maximum => {
            Err(LimitTooLow::QueuedSignals { robots, needed: robots as u64 + 1, used, maximum })
        }
        _ => Ok(()),
    }
}

/// Returns the number of queued signals of this user and its limit, from a `status` file of /proc.
fn parse_queued_signals(status: &str) -> Option<(u64, u64)> {
    let line = status.lines().find_map(|line| line.strip_prefix("SigQ:"))?;
    let (used, maximum) = line.trim().split_once('/')?;
    Some((used.parse().ok()?, maximum.parse().ok()?))
}

/// Counter of processes that the kernel killed for lack of memory, to identify that cause of a death.
#[derive(Debug)]
pub(crate) struct OutOfMemoryCounter {
    last_kill_count: Option<u64>,
}

impl OutOfMemoryCounter {
    /// Starts to count now.
    pub(crate) fn start() -> OutOfMemoryCounter {
        OutOfMemoryCounter { last_kill_count: read_out_of_memory_kills() }
    }

    /// Returns the cause of a SIGKILL that this process has not sent, if the kernel has killed a process for lack of
    /// memory since the last call.
    pub(crate) fn find_kill_cause(&mut self) -> Option<String> {
        let previous_count =
            std::mem::replace(&mut self.last_kill_count, read_out_of_memory_kills())?;
        (self.last_kill_count? > previous_count).then(|| {
            let limits = read_memory_limits().into_iter().map(|limit| format!("; {limit}"));
            format!("killed by the kernel for lack of memory{}", limits.collect::<String>())
        })
    }
}

/// Returns how many processes of this machine the kernel has killed for lack of memory. Linux before 4.13 does not
/// count them.
fn read_out_of_memory_kills() -> Option<u64> {
    let text = fs::read_to_string("/proc/vmstat").ok()?;
    text.lines().find_map(|line| line.strip_prefix("oom_kill "))?.trim().parse().ok()
}

/// The memory limit of a control group, bytes.
struct MemoryLimit {
    /// Name of the file that sets the limit, and of the control group.
    name: String,
    max_bytes: u64,
    used_bytes: u64,
    /// Part of `used_bytes` that is page cache, which the kernel drops when memory runs out.
    reclaimable_bytes: u64,
}

impl fmt::Display for MemoryLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {} of {} MiB",
            self.name,
            self.used_bytes / BYTES_PER_MIB,
            self.max_bytes / BYTES_PER_MIB
        )
    }
}

/// Returns the memory limits of the control groups of this process.
fn read_memory_limits() -> Vec<MemoryLimit> {
    let mut limits = Vec::new();
    for cgroup::CgroupFolder { path: folder, .. } in
        cgroup::find_cgroup_folders(Path::new("/"), "memory")
    {
        let names =
            [("memory.max", "memory.current"), ("memory.limit_in_bytes", "memory.usage_in_bytes")];
        for (max_file, used_file) in names {
            // Version 1 represents no limit by a very large number.
            if let (Some(max_bytes), Some(used_bytes)) =
                (read_number(folder.join(max_file)), read_number(folder.join(used_file)))
                && max_bytes < 1 << 60
            {
                let stat = fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
                let name = format!("{max_file} of {}", folder.display());
                let reclaimable_bytes = parse_page_cache_bytes(&stat);
                limits.push(MemoryLimit { name, max_bytes, used_bytes, reclaimable_bytes });
            }
        }
    }
    limits
}

/// Returns the page cache without shared memory, bytes, as a `memory.stat` of version 1 or 2 has it.
fn parse_page_cache_bytes(stat: &str) -> u64 {
    let value = |names: [&str; 2]| {
        let mut fields = stat.lines().filter_map(|line| line.split_once(' '));
        let found = fields.rfind(|(name, _)| names.contains(name));
        found.and_then(|(_, number)| number.trim().parse().ok()).unwrap_or(0)
    };
    let cached: u64 = value(["file", "total_cache"]);
    cached.saturating_sub(value(["shmem", "total_shmem"]))
}

/// Returns a field of `/proc/meminfo`, MiB.
fn read_machine_memory_mib(name: &str) -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim_start_matches(':').split_whitespace().next()?.parse().ok()?;
    Some(kib / 1024)
}

fn explain_out_of_memory(error: &io::Error) -> String {
    let mut clauses = Vec::new();
    let [available, total] = ["MemAvailable", "MemTotal"].map(read_machine_memory_mib);
    if let (Some(available), Some(total)) = (available, total) {
        clauses.push(format!("{available} of {total} MiB are available"));
    }
    clauses.extend(read_memory_limits().iter().map(MemoryLimit::to_string));
    if let Some(bytes) = getrlimit(Resource::As).current {
        clauses.push(format!("RLIMIT_AS: {} MiB", bytes / BYTES_PER_MIB));
    }
    format!(
        "out of memory ({error}; {}); end other programs, or run fewer robots",
        clauses.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limit_error(errno: i32) -> io::Error {
        io::Error::from_raw_os_error(errno)
    }

    fn limit(name: &str, maximum: u64, used: u64) -> ProcessCountLimit {
        ProcessCountLimit { name: name.into(), maximum, used, remedy: format!("raise {name}") }
    }

    #[test]
    fn reached_limit_is_named_with_a_remedy_else_all_limits_are() {
        let message = |used| {
            let limits = [limit("RLIMIT_NPROC", 64, used), limit("pids.max", 100, 70)];
            format_process_limits(&limit_error(libc::EAGAIN), &limits)
        };
        assert_eq!(
            message(64),
            "RLIMIT_NPROC permits 64 processes and threads, and there are 64; raise RLIMIT_NPROC"
        );
        let text = message(6);
        assert!(text.contains("RLIMIT_NPROC: 6 of 64, pids.max: 70 of 100"), "{text}");
        assert!(text.contains("temporarily unavailable"), "{text}");
    }

    #[test]
    fn group_page_cache_excludes_shared_memory() {
        assert_eq!(parse_page_cache_bytes("anon 5\nfile 300\nkernel 1\nshmem 100\n"), 200);
        let version_1 = "cache 7\nshmem 0\ntotal_cache 300\ntotal_shmem 50\n";
        assert_eq!(parse_page_cache_bytes(version_1), 250);
        assert_eq!(parse_page_cache_bytes(""), 0);
    }

    #[test]
    fn queued_signals_are_read_from_the_status() {
        let status = "Threads:\t1\nSigQ:\t6/96365\nSigPnd:\t0000\n";
        assert_eq!(parse_queued_signals(status), Some((6, 96365)));
        assert_eq!(parse_queued_signals("Threads:\t1\n"), None);
        let limit = limit("pids.max", 500, 100);
        let error = LimitTooLow::Processes { robots: 1024, needed: 1032, limit }.to_string();
        assert!(error.starts_with("1024 robots need 1032 processes"), "{error}");
        assert!(error.contains("permits 500, of which 100 are in use: raise pids.max"), "{error}");
        let error =
            LimitTooLow::QueuedSignals { robots: 3, needed: 4, used: 1, maximum: 2 }.to_string();
        assert!(error.contains("1 of 2 are taken") && error.contains("`ulimit -i 5`"), "{error}");
    }

    #[test]
    fn every_limit_error_names_the_number() {
        for (errno, part) in [
            (libc::EAGAIN, "kernel.threads-max"),
            (libc::ENOMEM, "MiB are available"),
            (libc::EMFILE, "RLIMIT_NOFILE"),
            (libc::ENFILE, "fs.file-max"),
        ] {
            let text = explain_refusal(&limit_error(errno));
            assert!(text.contains(part), "{text}");
            assert!(text.contains(|c: char| c.is_ascii_digit()), "{text}");
        }
    }
}
