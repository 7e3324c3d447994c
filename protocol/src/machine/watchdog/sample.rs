//! State of a process, as the kernel reports it in `/proc/PID/stat`.

use std::io;
use std::time::Duration;

use crate::machine::clock;

/// Scheduling state of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SchedulingState {
    /// Running, or waiting for a core.
    Runnable,
    /// Waiting for anything else.
    Blocked,
    /// Stopped, by SIGSTOP, Ctrl-Z or a debugger.
    Stopped,
    /// Exited, perhaps not reaped.
    Exited,
}

/// State of a process at one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProcessSample {
    /// Scheduling state of the first thread of the process.
    pub state: SchedulingState,
    /// CPU time used since the start.
    pub cpu_time: Duration,
    /// Time of the sample, CLOCK_MONOTONIC, ns.
    pub time_ns: u64,
    /// Start time of the process, in kernel ticks since boot: another process may get its id later.
    pub start_time_ticks: u64,
}

impl ProcessSample {
    /// Samples a process.
    ///
    /// # Errors
    ///
    /// There is no process with this id.
    pub fn read(pid: u32) -> io::Result<ProcessSample> {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat"))?;
        let ticks_per_s = clock::ticks_per_s();
        parse(&stat, ticks_per_s, clock::now_ns())
            .ok_or_else(|| io::Error::other(format!("/proc/{pid}/stat reads {stat:?}")))
    }
}

/// Parses a line of `stat`. The fields follow the name, which is in parentheses and may contain anything.
fn parse(stat: &str, ticks_per_s: u64, time_ns: u64) -> Option<ProcessSample> {
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_ascii_whitespace().collect();
    let number = |field: usize| fields.get(field)?.parse::<u64>().ok();
    let state = match *fields.first()? {
        "R" => SchedulingState::Runnable,
        "T" | "t" => SchedulingState::Stopped,
        "Z" | "X" | "x" => SchedulingState::Exited,
        _ => SchedulingState::Blocked,
    };
    // In user mode and in the kernel.
    let ticks = number(11)? + number(12)?;
    let cpu_time = Duration::from_millis(ticks * 1000 / ticks_per_s);
    Some(ProcessSample { state, cpu_time, time_ns, start_time_ticks: number(19)? })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::watchdog::{Activity, Watchdog};
    use std::process::{Child, Command};

    #[test]
    fn stat_line_is_parsed_with_any_process_name() {
        let line = "12 (a) R (b) S 1 12 12 0 -1 4194560 5 0 0 0 250 51 0 0 20 0 1 0 987 1 2";
        let sample = parse(line, 100, 5).unwrap();
        let cpu_time = Duration::from_millis(3010);
        assert_eq!(
            sample,
            ProcessSample {
                state: SchedulingState::Blocked,
                cpu_time,
                time_ns: 5,
                start_time_ticks: 987
            }
        );
        assert_eq!(parse("12 (a) S 1", 100, 5), None);
        assert_eq!(parse("", 100, 5), None);
    }

    #[test]
    fn own_process_can_be_sampled() {
        let sample = ProcessSample::read(std::process::id()).unwrap();
        assert!(matches!(sample.state, SchedulingState::Runnable | SchedulingState::Blocked));
        assert!(sample.start_time_ticks > 0);
        assert!(ProcessSample::read(u32::MAX).is_err());
    }

    /// Returns the activity that a watchdog reports for a shell script; `None` if it does not call it hung.
    fn watch_script(script: &str) -> Option<Activity> {
        struct KillOnDrop(Child);
        impl Drop for KillOnDrop {
            fn drop(&mut self) {
                let _ = self.0.kill();
                let _ = self.0.wait();
            }
        }
        let child = KillOnDrop(Command::new("sh").arg("-c").arg(script).spawn().unwrap());
        let mut watchdog = Watchdog::default();
        for _ in 0..500 {
            watchdog.add_sample(ProcessSample::read(child.0.id()).unwrap());
            if let Some(activity) = watchdog.hung_activity(Duration::from_millis(100)) {
                return Some(activity);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        None
    }

    #[test]
    fn spinning_waiting_and_stopped_processes_are_distinguished() {
        // On a busy machine a process may get little CPU time while it is sampled.
        let activity_of = |script| (0..20).find_map(|_| watch_script(script));
        assert_eq!(activity_of("while :; do :; done"), Some(Activity::Computing));
        assert_eq!(activity_of("exec sleep 1000"), Some(Activity::Waiting));
        assert_eq!(watch_script("kill -STOP $$"), None);
    }
}
