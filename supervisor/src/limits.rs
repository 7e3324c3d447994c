//! Why the kernel refuses another process, thread or file: which limit, how much of it is used, and
//! what to do.
//!
//! Must not: raise a limit. Asked only once something was refused, for it reads much of /proc.

use std::fmt;
use std::fs;
use std::io;
use std::path::Path;

use protocol::cgroup;
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

use crate::cores::topology::number;

const MIB: u64 = 1 << 20;

/// A limit on the number of processes and threads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limit {
    /// Its name, and whose it is.
    pub what: String,
    /// How many it permits.
    pub most: u64,
    /// How many there are.
    pub used: u64,
    /// What to do about it.
    pub remedy: String,
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} of {}", self.what, self.used, self.most)
    }
}

/// Why this was refused, as a clause that follows on `cannot start ...:`.
pub(crate) fn why(error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(libc::EAGAIN) => of_processes_in_words(error, &of_processes()),
        Some(libc::ENOMEM) => out_of_memory(error),
        Some(libc::EMFILE) => {
            let most = getrlimit(Resource::Nofile).current.map_or("-".into(), |n| n.to_string());
            format!(
                "this process has all {most} files open that it may (RLIMIT_NOFILE); raise it by \
                 `ulimit -n`, or by nofile in /etc/security/limits.conf"
            )
        }
        Some(libc::ENFILE) => format!(
            "all {} files are open that this machine permits (fs.file-max); raise it by \
             `sysctl fs.file-max=...` as root",
            number("/proc/sys/fs/file-max").map_or("-".into(), |n| n.to_string())
        ),
        _ => error.to_string(),
    }
}

fn of_processes_in_words(error: &io::Error, limits: &[Limit]) -> String {
    let reached: Vec<&Limit> = limits.iter().filter(|limit| limit.used >= limit.most).collect();
    if reached.is_empty() {
        let known: Vec<String> = limits.iter().map(Limit::to_string).collect();
        return format!(
            "the kernel permits no further process or thread ({error}); of the limits known none \
             is reached ({})",
            known.join(", ")
        );
    }
    let clauses = reached.iter().map(|Limit { what, most, used, remedy }| {
        format!("{what} permits {most} processes and threads, and there are {used}; {remedy}")
    });
    clauses.collect::<Vec<_>>().join("; ")
}

/// Every limit on the number of processes and threads that holds for this process.
pub fn of_processes() -> Vec<Limit> {
    let mut limits = of_user().into_iter().collect::<Vec<_>>();
    let groups = cgroup::folders(Path::new("/"), "pids");
    limits.extend(groups.iter().filter_map(|group| of_group(&group.path)));
    let running = fs::read_to_string("/proc/loadavg").ok().and_then(|text| {
        let tasks = text.split_whitespace().nth(3)?;
        tasks.split_once('/')?.1.parse().ok()
    });
    for name in ["threads-max", "pid_max"] {
        if let (Some(most), Some(used)) = (number(format!("/proc/sys/kernel/{name}")), running) {
            let remedy = format!("raise it by `sysctl kernel.{name}=...` as root");
            limits.push(Limit { what: format!("kernel.{name}"), most, used, remedy });
        }
    }
    limits
}

/// RLIMIT_NPROC, if it holds for this process.
fn of_user() -> Option<Limit> {
    let most = getrlimit(Resource::Nproc).current?;
    let exempt = CapabilitySet::SYS_RESOURCE | CapabilitySet::SYS_ADMIN;
    if capabilities(None).is_ok_and(|sets| sets.effective.intersects(exempt)) {
        return None;
    }
    let user = rustix::process::getuid().as_raw();
    let processes = fs::read_dir("/proc").ok()?.flatten();
    let used = processes.filter_map(|entry| threads_of(&entry.path(), user)).sum();
    Some(Limit {
        what: "RLIMIT_NPROC of this user".into(),
        most,
        used,
        remedy: "raise it by `ulimit -u`, or by nproc in /etc/security/limits.conf".into(),
    })
}

/// How many threads a process has, if it is one of this user's.
fn threads_of(process: &Path, user: u32) -> Option<u64> {
    let status = fs::read_to_string(process.join("status")).ok()?;
    let value = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse::<u64>().ok()
    };
    if value("Uid:")? == u64::from(user) { value("Threads:") } else { None }
}

fn of_group(group: &Path) -> Option<Limit> {
    let most = number(group.join("pids.max"))?;
    let used = number(group.join("pids.current"))?;
    Some(Limit {
        what: format!("pids.max of the control group {}", group.display()),
        most,
        used,
        remedy: "raise it (of a container: --pids-limit; of a systemd unit: TasksMax=)".into(),
    })
}

fn out_of_memory(error: &io::Error) -> String {
    let text = fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let mib = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        let kib: u64 = line.trim_start_matches(':').split_whitespace().next()?.parse().ok()?;
        Some(kib / 1024)
    };
    let mut clauses = Vec::new();
    if let (Some(free), Some(all)) = (mib("MemAvailable"), mib("MemTotal")) {
        clauses.push(format!("{free} of {all} MiB are available"));
    }
    for cgroup::Folder { path: group, .. } in cgroup::folders(Path::new("/"), "memory") {
        let names =
            [("memory.max", "memory.current"), ("memory.limit_in_bytes", "memory.usage_in_bytes")];
        for (most, used) in names {
            // Version 1 writes an absurd number for none.
            if let (Some(bytes), Some(used)) = (number(group.join(most)), number(group.join(used)))
                && bytes < 1 << 60
            {
                let (used, bytes) = (used / MIB, bytes / MIB);
                clauses.push(format!("{most} of {}: {used} of {bytes} MiB", group.display()));
            }
        }
    }
    if let Some(bytes) = getrlimit(Resource::As).current {
        clauses.push(format!("RLIMIT_AS: {} MiB", bytes / MIB));
    }
    format!(
        "there is no memory for it ({error}; {}); end other programs, or run fewer robots",
        clauses.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(errno: i32) -> io::Error {
        io::Error::from_raw_os_error(errno)
    }

    fn limit(what: &str, most: u64, used: u64) -> Limit {
        Limit { what: what.into(), most, used, remedy: format!("raise {what}") }
    }

    #[test]
    fn a_limit_that_is_reached_is_named_with_what_to_do_and_else_all_are_told() {
        let words = |used| {
            let limits = [limit("RLIMIT_NPROC", 64, used), limit("pids.max", 100, 70)];
            of_processes_in_words(&refused(libc::EAGAIN), &limits)
        };
        assert_eq!(
            words(64),
            "RLIMIT_NPROC permits 64 processes and threads, and there are 64; raise RLIMIT_NPROC"
        );
        let text = words(6);
        assert!(text.contains("RLIMIT_NPROC: 6 of 64, pids.max: 70 of 100"), "{text}");
        assert!(text.contains("temporarily unavailable"), "{text}");
    }

    #[test]
    fn every_refusal_is_a_sentence_with_a_number() {
        for (errno, named) in [
            (libc::EAGAIN, "kernel.threads-max"),
            (libc::ENOMEM, "MiB are available"),
            (libc::EMFILE, "RLIMIT_NOFILE"),
            (libc::ENFILE, "fs.file-max"),
        ] {
            let text = why(&refused(errno));
            assert!(text.contains(named), "{text}");
            assert!(text.contains(|c: char| c.is_ascii_digit()), "{text}");
        }
    }
}
