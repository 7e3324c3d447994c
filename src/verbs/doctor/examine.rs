//! `phalanx doctor`: checks that this machine can run experiments.
//!
//! Tests the required kernel features with the same functions that a run uses. Must not leave anything
//! behind, or report an uncertain problem as an error.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use protocol::barrier::Barrier;
use protocol::clock::{Timer, now_ns, tighten_timer_slack};
use protocol::lateness::CounterReader;
use protocol::process::{
    Alarm, PriorityError, REALTIME_RUNTIME_PATH, check_realtime_priority, may_lock_memory,
    set_idle_priority,
};
use protocol::run_root::{self, RunRoot};
use protocol::stage::LatenessCause;
use rustix::fs::{Access, access};
use rustix::process::{Resource, getrlimit};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use super::super::dead_runs;
use outcome::results::manifest;
use supervisor::limits::{self, ProcessCountLimit};
use supervisor::shm_capacity::{AvailableSpace, RequiredSpace, SpaceError};
use supervisor::spawn::{Launcher, ProcessRole};
use supervisor::{cores, descriptors};

/// Assumed in-degree of each robot, larger than in most formations, because the graph is not known here.
const LINKS_PER_ROBOT: usize = 4;
/// Number of robots at 1 kHz that one core carried with fewer than 1 % deadline misses (measured: 64 on two cores).
const ROBOTS_PER_CORE_MAX: usize = 32;
/// Number of wake-ups measured, and the interval between them.
const MEASURED_WAKE_UPS: usize = 200;
const WAKE_UP_INTERVAL_NS: u64 = 1_000_000;
/// Median wake-up latency above which there is a warning. The default timer slack is 50 us, so a larger
/// median has another cause.
const MEDIAN_LATENESS_NS_MAX: u64 = 100_000;
/// Maximum time for a test process to start.
const CHILD_START_DURATION_MAX: Duration = Duration::from_secs(5);
/// Duration of the test wait, and the processor time above which a wait does not sleep.
const TEST_WAIT_DURATION: Duration = Duration::from_millis(10);
const SPIN_CPU_TIME_MIN: Duration = Duration::from_millis(5);

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingSeverity {
    /// Requirements are met.
    Fine,
    /// Runs work, but with limitations.
    WorthKnowing,
    /// Runs fail on this machine.
    Wrong,
}

impl FindingSeverity {
    fn keyword(self) -> &'static str {
        match self {
            FindingSeverity::Fine => "fine",
            FindingSeverity::WorthKnowing => "worth knowing",
            FindingSeverity::Wrong => "WRONG",
        }
    }
}

/// Result of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Subject of the check.
    pub topic: &'static str,
    /// Severity of the finding.
    pub verdict: FindingSeverity,
    /// State of the machine that the check found.
    pub found: String,
    /// Remedy; `null` if none is needed.
    pub advice: Option<String>,
}

impl Finding {
    fn good_finding(topic: &'static str, found: impl Into<String>) -> Finding {
        Finding { topic, verdict: FindingSeverity::Fine, found: found.into(), advice: None }
    }

    fn with_severity_if(
        self,
        verdict: FindingSeverity,
        is_bad: bool,
        advice: impl Into<String>,
    ) -> Finding {
        match is_bad {
            true => Finding { verdict, advice: Some(advice.into()), ..self },
            false => self,
        }
    }

    /// Adds a warning with a remedy if `is_bad`, for a feature that runs can do without.
    fn with_warning_if(self, is_bad: bool, advice: impl Into<String>) -> Finding {
        self.with_severity_if(FindingSeverity::WorthKnowing, is_bad, advice)
    }

    fn bad_finding(
        topic: &'static str,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> Finding {
        Finding::good_finding(topic, found).with_severity_if(FindingSeverity::Wrong, true, advice)
    }
}

/// Checks everything that a run of `robots` robots depends on.
pub fn examine(robots: usize) -> Vec<Finding> {
    let base = run_root::base_directory();
    let mut findings = vec![
        check_child_processes(),
        check_futex_waits(&base),
        check_cores(robots),
        check_core_scheduling(),
        check_load(),
    ];
    findings.extend([check_wake_up_latency(), check_lateness_causes(), check_alarm_timer()]);
    findings.extend(check_governor());
    findings.push(check_descriptor_limit(robots));
    findings.push(check_process_limit(robots));
    findings.push(examine_realtime_priority());
    findings.push(check_locked_memory());
    findings.push(check_directory("run root", base.parent().unwrap_or(Path::new("/")), robots));
    findings.push(check_run_root_privacy(&base));
    findings.push(check_dead_runs(&base));
    findings
}

/// Returns whether a finding means that runs fail.
pub fn has_error_finding(findings: &[Finding]) -> bool {
    findings.iter().any(|finding| finding.verdict == FindingSeverity::Wrong)
}

/// Formats the findings as text for one screen.
pub fn format_findings(findings: &[Finding]) -> String {
    let mut text = String::new();
    for Finding { topic, verdict, found, advice } in findings {
        let _ = writeln!(text, "{:<13}  {topic:<17} {found}", verdict.keyword());
        if let Some(advice) = advice {
            let _ = writeln!(text, "{:33}-> {advice}", "");
        }
    }
    text
}

/// Returns a finding about a feature that every run needs.
fn required_feature_finding(
    topic: &'static str,
    result: Result<String, String>,
    advice: &str,
) -> Finding {
    match result {
        Ok(found) => Finding::good_finding(topic, found),
        Err(found) => Finding::bad_finding(topic, found, advice),
    }
}

/// Checks that a process can be started, watched, killed and reaped like a robot, and that it exits with its parent.
fn check_child_processes() -> Finding {
    let release = rustix::system::uname().release().to_string_lossy().into_owned();
    let test = || {
        let log = Path::new("/dev/null");
        let child = Launcher::for_this_executable().spawn(ProcessRole::KeepCoreAwake, log);
        let mut child = child.map_err(|error| error.to_string())?;
        // The child sets its name after it has tied its lifetime to its parent's and closed inherited descriptors.
        let comm = PathBuf::from(format!("/proc/{}/comm", child.pid()));
        let start = Instant::now();
        while !fs::read_to_string(&comm).is_ok_and(|name| name.starts_with("phalanx-")) {
            if let Some(status) = child.try_reap() {
                return Err(format!(
                    "a child ends at once ({status}): prctl(PR_SET_PDEATHSIG) or close_range is refused"
                ));
            }
            if start.elapsed() > CHILD_START_DURATION_MAX {
                return Err(format!(
                    "a child does not begin within {} s",
                    CHILD_START_DURATION_MAX.as_secs()
                ));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        match child.kill_and_wait() {
            Some(status) if status.signal().is_some() => {
                Ok(format!("Linux {release}; children can be started, watched and ended"))
            }
            Some(status) => Err(format!("a child that was killed ended otherwise: {status}")),
            None => Err("a child cannot be ended: pidfd_send_signal or waitid is refused".into()),
        }
    };
    let advice =
        "Linux 5.11 or newer is needed; in a container, its seccomp profile must allow these calls";
    required_feature_finding(
        "kernel",
        test().map_err(|error| format!("Linux {release}: {error}")),
        advice,
    )
}

/// Checks that a run root can be created and locked, and that a wait on a barrier in it sleeps.
fn check_futex_waits(base: &Path) -> Finding {
    let test = || {
        let root = RunRoot::create(base).map_err(|error| error.to_string())?;
        let barrier = Barrier::create(&root.barrier_path(), 1, 1, TEST_WAIT_DURATION);
        let barrier = barrier.map_err(|error| error.to_string())?;
        let thread_cpu_time = || {
            let time = clock_gettime(ClockId::ThreadCPUTime);
            Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
        };
        let start_time = thread_cpu_time();
        barrier.wait_for_attention(TEST_WAIT_DURATION);
        let used_time = thread_cpu_time() - start_time;
        root.remove().map_err(|error| format!("{}: {error}", base.display()))?;
        match used_time > SPIN_CPU_TIME_MIN {
            true => Err("a wait on shared memory (futex) does not sleep".to_owned()),
            false => Ok("run roots can be made and locked, and waits on them sleep".to_owned()),
        }
    };
    let advice = "every run fails: the file system must permit flock, rename and shared mappings";
    required_feature_finding("shared files", test(), advice)
}

/// Runs a check on its own thread, because the check changes thread attributes.
fn run_on_thread<T: Send>(check: impl FnOnce() -> io::Result<T> + Send) -> io::Result<T> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().spawn_scoped(scope, check)?;
        thread.join().expect("it does not panic")
    })
}

/// Checks the timer that bounds waits in lockstep.
fn check_alarm_timer() -> Finding {
    let result = run_on_thread(|| Alarm::start().map(drop)).map(|()| "can be set".to_owned());
    let advice = "lockstep needs it; in a container, its seccomp profile must allow timer_create";
    required_feature_finding(
        "alarm",
        result.map_err(|error| format!("timer_create is refused: {error}")),
        advice,
    )
}

/// Checks the optional scheduling features that make lockstep faster.
fn check_core_scheduling() -> Finding {
    let idle_result =
        run_on_thread(set_idle_priority).map_err(|error| format!("SCHED_IDLE: {error}"));
    match cores::check_pinning_support().and(idle_result) {
        Ok(()) => Finding::good_finding(
            "keeping cores",
            "processes can be kept on cores, and cores awake",
        ),
        Err(reason) => Finding::good_finding("keeping cores", format!("not permitted ({reason})"))
            .with_warning_if(true, "lockstep is slower"),
    }
}

fn check_cores(robots: usize) -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let robots_max = cores * ROBOTS_PER_CORE_MAX;
    let found = format!("{cores}, enough for about {robots_max} robots in real time at 1 kHz");
    let advice = format!(
        "{robots} robots need a longer period_s, or --pace lockstep, which any number of cores can do"
    );
    Finding::good_finding("cores", found).with_warning_if(robots > robots_max, advice)
}

fn check_load() -> Finding {
    let text = manifest::load_average();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let Some(load) = text.split(' ').next().and_then(|number| number.parse::<f64>().ok()) else {
        return Finding::good_finding("load", "not readable");
    };
    Finding::good_finding("load", format!("{load:.2} over the last minute")).with_warning_if(load > cores as f64,
        "other processes want all cores: real time will miss deadlines; wait, or try --realtime-priority",
    )
}

/// Measures the wake-up latency of the timer that agents use.
fn check_wake_up_latency() -> Finding {
    let measure = || {
        tighten_timer_slack();
        let slack_ns = rustix::thread::current_timer_slack().unwrap_or(0);
        let mut timer = Timer::new(WAKE_UP_INTERVAL_NS, now_ns() % WAKE_UP_INTERVAL_NS);
        let wakes = (0..MEASURED_WAKE_UPS).filter_map(|_| timer.wait());
        let mut lateness_ns: Vec<u64> = wakes.map(|wake| wake.lateness_ns).collect();
        lateness_ns.sort_unstable();
        Ok((slack_ns, lateness_ns))
    };
    let (slack_ns, lateness_ns) = match run_on_thread(measure) {
        Ok(lateness) => lateness,
        Err(error) => {
            let advice = "the user's processes, or the control group's, are at their limit";
            return Finding::bad_finding(
                "timer",
                format!("cannot start a thread: {error}"),
                advice,
            );
        }
    };
    let [Some(median_ns), Some(worst_ns)] =
        [lateness_ns.get(lateness_ns.len() / 2), lateness_ns.last()]
    else {
        return Finding::good_finding("timer", "not measured");
    };
    let to_us = |ns: &u64| ns / 1000;
    let (median_us, worst_us) = (to_us(median_ns), to_us(worst_ns));
    Finding::good_finding(
        "timer",
        format!("wakes up {median_us} us late, at worst {worst_us} us of {MEASURED_WAKE_UPS}"),
    )
    .with_warning_if(
        slack_ns > 1 || *median_ns > MEDIAN_LATENESS_NS_MAX,
        format!(
            "timer slack is {slack_ns} ns; a virtual machine, power saving or load may add more"
        ),
    )
}

/// Checks which causes of late wake-ups can be determined here.
fn check_lateness_causes() -> Finding {
    let undetectable = CounterReader::new().undetectable_causes();
    let format_causes = |causes: Vec<LatenessCause>| {
        causes.into_iter().map(LatenessCause::text).collect::<Vec<_>>().join(", ")
    };
    let detectable: Vec<LatenessCause> =
        LatenessCause::ALL.into_iter().filter(|cause| !undetectable.contains(cause)).collect();
    Finding::good_finding(
        "causes",
        format!(
            "causes of late wake-ups that this machine can report: {}",
            format_causes(detectable)
        ),
    )
    .with_warning_if(
        !undetectable.is_empty(),
        format!("late wake-ups of these causes count as unknown: {}", format_causes(undetectable)),
    )
}

fn check_governor() -> Option<Finding> {
    let mut governors: Vec<String> = (0..4096)
        .map_while(|cpu| {
            let file = format!("/sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor");
            fs::read_to_string(file).ok()
        })
        .map(|text| text.trim().to_owned())
        .collect();
    governors.sort();
    governors.dedup();
    let may_be_slow = governors.iter().any(|governor| governor != "performance");
    (!governors.is_empty()).then(|| {
        Finding::good_finding("cpu frequency", format!("governor {}", governors.join(", ")))
            .with_warning_if(
                may_be_slow,
                "a core that was asleep is slow at first: cpupower frequency-set -g performance",
            )
    })
}

fn check_descriptor_limit(robots: usize) -> Finding {
    let needed = descriptors::needed_descriptors(robots);
    let limit = descriptors::read_limit();
    let found = format!("{} (RLIMIT_NOFILE), {robots} robots need {needed}", format_limit(limit));
    let advice = format!("ulimit -n {needed} as root, or nofile in /etc/security/limits.conf");
    Finding::good_finding("open files", found).with_severity_if(
        FindingSeverity::Wrong,
        limit.is_some_and(|n| n < needed),
        advice,
    )
}

/// Checks how many more processes may be started, under the tightest limit.
fn check_process_limit(robots: usize) -> Finding {
    let remaining = |limit: &ProcessCountLimit| limit.maximum.saturating_sub(limit.used);
    let tightest = limits::read_process_limits().into_iter().min_by_key(remaining);
    let Some(limit) = tightest else { return Finding::good_finding("processes", "unlimited") };
    let (needed, remaining) = (limits::needed_processes(robots), remaining(&limit));
    let ProcessCountLimit { name, maximum, remedy, .. } = limit;
    let found = format!("{remaining} of {maximum} left ({name}), {robots} robots need {needed}");
    Finding::good_finding("processes", found).with_severity_if(
        FindingSeverity::Wrong,
        remaining < needed,
        remedy,
    )
}

fn format_limit(limit: Option<u64>) -> String {
    limit.map_or("unlimited".into(), |limit| limit.to_string())
}

fn examine_realtime_priority() -> Finding {
    let limit = format_limit(getrlimit(Resource::Rtprio).current);
    match check_realtime_priority() {
        Ok(()) => {
            let runtime = fs::read_to_string(REALTIME_RUNTIME_PATH).unwrap_or_default();
            let runtime = runtime.trim();
            let found = format!("SCHED_FIFO is permitted, for {runtime} us of each second");
            Finding::good_finding("real-time prio", found)
        }
        Err(error) => {
            let found = match error {
                PriorityError::NoRuntimeLimit(_) => {
                    "real-time processes are not limited".to_owned()
                }
                PriorityError::Refused(_) => format!("not permitted (RLIMIT_RTPRIO {limit})"),
            };
            let advice = format!("--realtime-priority has no effect: {error}");
            Finding::good_finding("real-time prio", found).with_warning_if(true, advice)
        }
    }
}

fn check_locked_memory() -> Finding {
    let bytes = getrlimit(Resource::Memlock).current;
    let found = match (may_lock_memory(), bytes) {
        (true, _) => "may be locked".to_owned(),
        (false, bytes) => {
            format!("may not be locked (RLIMIT_MEMLOCK {} bytes)", format_limit(bytes))
        }
    };
    let advice = "--realtime-priority will not lock memory: ulimit -l unlimited, or CAP_IPC_LOCK";
    Finding::good_finding("memory", found).with_warning_if(!may_lock_memory(), advice)
}

/// Checks a directory for shared memory: writable, with enough free space, and on tmpfs.
fn check_directory(topic: &'static str, directory: &Path, robots: usize) -> Finding {
    let path = directory.display();
    let bad_finding = |found: String, advice: &str| Finding::bad_finding(topic, found, advice);
    if let Err(error) = access(directory, Access::WRITE_OK | Access::EXEC_OK) {
        let advice = "create it and make it writable for this user, or set PHALANX_RUN_ROOT to another directory";
        return bad_finding(format!("{path} cannot be written to: {error}"), advice);
    }
    let space = match AvailableSpace::of_file_system(directory) {
        Ok(space) => space,
        Err(error) => return bad_finding(format!("{path}: {error}"), "see PHALANX_RUN_ROOT"),
    };
    let need = RequiredSpace::without_messages(robots, LINKS_PER_ROBOT * robots);
    if !space.covers(&need) {
        return bad_finding(
            SpaceError::TooSmall { need, available: space }.to_string(),
            "every such run is refused",
        );
    }
    Finding::good_finding(topic, format!("{path}: {space}")).with_warning_if(
        !space.is_tmpfs(),
        "it is not on tmpfs: starting takes twice as long; see PHALANX_RUN_ROOT",
    )
}

fn check_run_root_privacy(base: &Path) -> Finding {
    let path = base.display();
    match run_root::find_unusable_reason(base) {
        None => Finding::good_finding("privacy", format!("{path} is this user's alone")),
        Some(flaw) => Finding::bad_finding(
            "privacy",
            format!("{path}: {flaw}"),
            "every run rejects it: remove it, or set PHALANX_RUN_ROOT to another folder",
        ),
    }
}

fn check_dead_runs(base: &Path) -> Finding {
    let dead_roots: Vec<_> = run_root::lock_dead_roots(base).collect();
    let descriptions: Vec<String> = dead_roots.iter().map(dead_runs::describe_dead_root).collect();
    let found = match &descriptions[..] {
        [] => "no dead run left anything".to_owned(),
        descriptions => descriptions.join("; "),
    };
    Finding::good_finding("dead runs", found)
        .with_warning_if(!descriptions.is_empty(), "phalanx clean")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doctor_warns_of_a_million_robots() {
        let findings = examine(1_000_000);
        let finding = |topic| findings.iter().find(|finding| finding.topic == topic).unwrap();
        assert_eq!(finding("cores").verdict, FindingSeverity::WorthKnowing);
        let limit = descriptors::read_limit();
        let is_limit_too_low = limit.is_some_and(|limit| limit < 18_000_040);
        assert_eq!(
            finding("open files").verdict == FindingSeverity::Wrong,
            is_limit_too_low,
            "{findings:?}"
        );
        assert!(finding("open files").found.contains("need 18000040"));
        assert!(is_limit_too_low <= has_error_finding(&findings));
        assert!(format_findings(&findings).contains("1000000 robots need a longer period_s"));
    }

    #[test]
    fn missing_shm_folder_is_bad_and_folder_on_disk_is_a_warning() {
        let finding = check_directory("run root", Path::new("/nowhere/at/all"), 3);
        assert_eq!(finding.verdict, FindingSeverity::Wrong);
        assert!(finding.found.contains("/nowhere/at/all"), "{finding:?}");
        // procfs is not a tmpfs and cannot hold files.
        assert_ne!(
            check_directory("run root", Path::new("/proc"), 3).verdict,
            FindingSeverity::Fine
        );
        assert_eq!(
            check_directory("run root", Path::new("/dev/shm"), 3).verdict,
            FindingSeverity::Fine
        );
    }

    #[test]
    fn world_writable_base_is_refused() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        for (mode, verdict) in [(0o700, FindingSeverity::Fine), (0o711, FindingSeverity::Wrong)] {
            fs::set_permissions(folder.path(), fs::Permissions::from_mode(mode)).unwrap();
            assert_eq!(check_run_root_privacy(folder.path()).verdict, verdict);
        }
        assert_eq!(
            check_run_root_privacy(&folder.path().join("not-yet")).verdict,
            FindingSeverity::Fine
        );
    }
}
