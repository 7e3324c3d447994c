//! Assignment of the processes of a lockstep run to cores: few robots on one core, many spread over all,
//! and no core idle.
//!
//! In lockstep all processes wait for the slowest at each tick. A wake-up of a process on another core, or
//! of an idle core, takes longer than a control cycle. Each robot is therefore pinned to a core, and a
//! process with idle priority keeps that core awake, unless many robots share it. This applies only while
//! the machine has no other work, because under other load the kernel balances better than a fixed
//! assignment. The supervisor works while the robots on its core wait for the plant, and requests long time
//! slices so that it does not delay them. Not used in real time, where processes wake at different times.

mod assignment;
mod core_count_tuner;
pub mod topology;

use std::path::Path;
use std::time::{Duration, Instant};

use protocol::clock;
use protocol::process::{TimeSlice, request_time_slice_of_all_threads};
use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use self::assignment::CoreAssignment;
use self::core_count_tuner::CoreCountTuner;
use self::topology::Topology;
use crate::child::{Child, describe_exit};
use crate::spawn::{Launcher, ProcessRole};
use outcome::results::usage::Usage;

/// Interval at which the load by other processes is sampled.
const LOAD_SAMPLE_INTERVAL: Duration = Duration::from_millis(100);
/// Processor usage by other processes, in cores, above which the assignment is released.
const OTHER_LOAD_CORES_MAX: f64 = 0.3;
/// Maximum number of robots per core with which cores are kept awake. With more, ticks are no faster, and with
/// 1,024 robots on two cores ticks after a death were measured to take seconds while cores are kept awake.
const AWAKE_ROBOTS_PER_CORE_MAX: usize = 32;
/// Maximum delay before a released assignment is tried again. The delay doubles up to this value.
const RETRY_DELAY_MAX: Duration = Duration::from_secs(5);

/// Cores of the robots and of the plant.
#[derive(Debug)]
pub(crate) struct Cores {
    usable_cpus: CpuSet,
    assignment: CoreAssignment,
    /// Whether a cgroup limits the processor time, so that none is spent on keeping cores awake.
    is_cpu_time_limited: bool,
    robots: usize,
}

impl Cores {
    /// Assigns the usable cores to `robots` robots, starting at core `first`, so that concurrent runs on a
    /// large machine start at different cores. Returns `None` with a single processor, or if the kernel
    /// does not report the topology.
    pub(crate) fn assign(robots: usize, first: usize) -> Option<Cores> {
        let usable_cpus = sched_getaffinity(None).ok()?;
        let topology = Topology::for_this_thread()?;
        let assignment = CoreAssignment::compute(&topology, robots, first)?;
        Some(Cores {
            usable_cpus,
            assignment,
            is_cpu_time_limited: topology.quota_cores.is_some(),
            robots,
        })
    }

    /// Returns the number of groups of robots.
    pub(crate) fn groups(&self) -> usize {
        self.assignment.group_processors.len()
    }
}

/// Pinning of the processes of one run to their cores, while no other process needs them.
#[derive(Debug)]
pub(crate) struct Placement {
    cores: Cores,
    launcher: Launcher,
    /// Start time of the current trial, and the number of ticks begun by then.
    trial_start: Option<(Instant, u32)>,
    tuner: CoreCountTuner,
    /// Time of the last sample of the load; `None` before the first.
    last_load_sample: Option<Instant>,
    /// Earliest time at which a released assignment is tried again.
    retry_at: Option<Instant>,
    /// Delay before the next attempt, after the next release of the assignment.
    retry_delay: Duration,
    last_busy_time_s: f64,
    own_cpu_time_s: f64,
    is_pinned: bool,
    /// Processes that keep the cores with robots awake, while the assignment is in force.
    awake_processes: Vec<(usize, Child)>,
    /// Killed processes that kept cores awake, until they are reaped. At idle priority they die late on a busy machine,
    /// and the run does not wait for them.
    killed_awake_processes: Vec<Child>,
    /// Whether no such processes are to be started, because they are not wanted or cannot be started.
    skips_awake_processes: bool,
    /// Resource usage of such processes that have exited.
    usage: Usage,
}

impl Placement {
    /// Creates a placement without pinned processes. `launcher` starts the processes that keep cores awake.
    pub(crate) fn new(cores: Cores, launcher: Launcher) -> Placement {
        let skips_awake_processes = cores.is_cpu_time_limited
            || !launcher.keeps_cores_awake()
            || cores.robots > AWAKE_ROBOTS_PER_CORE_MAX * cores.groups();
        Placement {
            tuner: CoreCountTuner::new(cores.robots, cores.groups()),
            trial_start: None,
            cores,
            launcher,
            last_load_sample: None,
            retry_at: None,
            retry_delay: LOAD_SAMPLE_INTERVAL,
            last_busy_time_s: 0.0,
            own_cpu_time_s: 0.0,
            is_pinned: false,
            awake_processes: Vec::new(),
            killed_awake_processes: Vec::new(),
            skips_awake_processes,
            usage: Usage::default(),
        }
    }

    /// Samples the load by other processes, if due, and pins the plant and the robots (by slot) to their
    /// cores or releases them. The first call pins without a sample. `ticks` is the number of ticks begun,
    /// and `log` the log of the processes that keep cores awake. Affects only the speed of a run, not its
    /// results.
    pub(crate) fn update<'a>(
        &mut self,
        plant: &Child,
        robots: impl Iterator<Item = (usize, &'a Child)> + Clone,
        ticks: u32,
        log: &Path,
    ) {
        if self.is_pinned && self.advance_trial(ticks) {
            self.pin_processes(plant, robots, log);
            return;
        }
        let elapsed = self.last_load_sample.map(|at| at.elapsed());
        if elapsed.is_some_and(|elapsed| elapsed < LOAD_SAMPLE_INTERVAL) {
            return;
        }
        let Some(busy_time_s) = read_busy_time_s(self.cores.assignment.assigned_processors())
        else {
            return;
        };
        let awake_children = self.awake_processes.iter().map(|(_, child)| child);
        let processes = robots.clone().map(|(_, child)| child).chain([plant]).chain(awake_children);
        let own_cpu_time_s = process_cpu_time_s()
            + self.usage.processor_time_s()
            + processes.flat_map(Child::worker_pids).map(cpu_time_of_process_s).sum::<f64>();
        // Two known errors: the time of a process that died since the last sample counts as time of others,
        // and the time of a released process on other cores is subtracted too.
        let other_cpu_time_s =
            (busy_time_s - self.last_busy_time_s) - (own_cpu_time_s - self.own_cpu_time_s).max(0.0);
        (self.last_load_sample, self.last_busy_time_s, self.own_cpu_time_s) =
            (Some(Instant::now()), busy_time_s, own_cpu_time_s);
        if elapsed
            .is_some_and(|elapsed| other_cpu_time_s > OTHER_LOAD_CORES_MAX * elapsed.as_secs_f64())
        {
            if self.is_pinned {
                self.unpin_all(plant, robots);
            }
            return;
        }
        if !self.is_pinned && self.retry_at.is_some_and(|at| Instant::now() < at) {
            return;
        }
        self.pin_processes(plant, robots, log);
    }

    /// Returns whether the trial has just changed the number of cores.
    fn advance_trial(&mut self, ticks: u32) -> bool {
        let &mut (start, start_ticks) = self.trial_start.get_or_insert((Instant::now(), ticks));
        self.tuner.advance_search(start.elapsed(), ticks.wrapping_sub(start_ticks).into()).is_some()
    }

    /// Pins all processes to cores. Repeated at each call, because replacements start elsewhere.
    fn pin_processes<'a>(
        &mut self,
        plant: &Child,
        robots: impl Iterator<Item = (usize, &'a Child)>,
        log: &Path,
    ) {
        if !std::mem::replace(&mut self.is_pinned, true) {
            request_time_slice_of_all_threads(TimeSlice::Long);
        }
        let core_count = self.tuner.cores();
        self.start_awake_processes(core_count, log);
        for (i, child) in robots {
            pin_all_processes(
                child,
                &single_core_set(self.cores.assignment.processor_of_robot(i, core_count)),
            );
        }
        pin_all_processes(plant, &single_core_set(self.cores.assignment.plant_processor));
        pin_process(0, &single_core_set(self.cores.assignment.supervisor_processor));
    }

    fn start_awake_processes(&mut self, core_count: usize, log: &Path) {
        let cores = self.cores.assignment.robot_processors(core_count).to_vec();
        let (kept_processes, removed_processes) = std::mem::take(&mut self.awake_processes)
            .into_iter()
            .partition(|(core, child)| cores.contains(core) && !child.is_dead());
        self.awake_processes = kept_processes;
        self.kill_awake_processes(removed_processes);
        for core in cores {
            if self.skips_awake_processes
                || self.awake_processes.iter().any(|&(awake_core, _)| awake_core == core)
            {
                continue;
            }
            match self.launcher.spawn(ProcessRole::KeepCoreAwake, log) {
                Ok(child) => {
                    pin_process(child.pid(), &single_core_set(core));
                    self.awake_processes.push((core, child));
                }
                Err(error) => {
                    tracing::warn!("{error}; the run is slower without it, with the same results");
                    self.skips_awake_processes = true;
                    return;
                }
            }
        }
    }

    fn unpin_all<'a>(&mut self, plant: &Child, robots: impl Iterator<Item = (usize, &'a Child)>) {
        self.release_cores();
        self.is_pinned = false;
        // Ticks counted under other load are not comparable.
        (self.trial_start, self.tuner) =
            (None, CoreCountTuner::new(self.cores.robots, self.cores.groups()));
        // If there are other cores, the load of the assigned cores shows little about them, so an attempt is made.
        if self.cores.assignment.assigned_processors().count()
            < self.cores.usable_cpus.count() as usize
        {
            self.retry_at = Some(Instant::now() + self.retry_delay);
            self.retry_delay = (2 * self.retry_delay).min(RETRY_DELAY_MAX);
        }
        for child in robots.map(|(_, child)| child).chain([plant]) {
            pin_all_processes(child, &self.cores.usable_cpus);
        }
    }

    /// Ends the processes that keep cores awake and releases the calling thread. Returns the resource usage
    /// of those processes.
    pub(crate) fn end_placement(&mut self) -> Usage {
        self.release_cores();
        for mut child in std::mem::take(&mut self.killed_awake_processes) {
            child.kill_and_wait();
            self.usage += child.usage().unwrap_or_default();
        }
        self.usage
    }

    /// Kills the processes that keep cores awake and releases the calling thread.
    fn release_cores(&mut self) {
        pin_process(0, &self.cores.usable_cpus);
        request_time_slice_of_all_threads(TimeSlice::KernelDefault);
        let awake_processes = std::mem::take(&mut self.awake_processes);
        self.kill_awake_processes(awake_processes);
    }

    /// Kills these processes that keep cores awake, and reaps the processes killed before that have exited. Warns of a
    /// process that had died before.
    fn kill_awake_processes(&mut self, mut processes: Vec<(usize, Child)>) {
        for (core, child) in &mut processes {
            match child.try_reap() {
                Some(status) => tracing::warn!(
                    "the process that kept core {core} awake died ({}); the run is slower without it, with the same results",
                    describe_exit(status)
                ),
                None => drop(child.kill()),
            }
        }
        self.killed_awake_processes.extend(processes.into_iter().map(|(_, child)| child));
        let usage = &mut self.usage;
        self.killed_awake_processes.retain_mut(|child| {
            let has_exited = child.try_reap().is_some();
            if has_exited {
                *usage += child.usage().unwrap_or_default();
            }
            !has_exited
        });
    }
}

fn single_core_set(core: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(core);
    set
}

/// Pins all processes of a child to these cores.
fn pin_all_processes(child: &Child, cores: &CpuSet) {
    child.worker_pids().into_iter().for_each(|pid| pin_process(pid, cores));
}

/// Pins a process, or for 0 the calling thread, to these cores. If the kernel refuses, the process stays
/// where it is, which affects only the speed.
fn pin_process(pid: u32, cores: &CpuSet) {
    if let Err(error) = sched_setaffinity(Pid::from_raw(pid as i32), cores) {
        tracing::debug!(pid, %error, "cannot be pinned to its core");
    }
}

/// Checks on the calling thread whether processes can be pinned and the load by other processes can be
/// read. Leaves the thread's affinity unchanged. Fails with the reason.
pub fn check_pinning_support() -> Result<(), String> {
    let affinity_error = |error| format!("sched_setaffinity: {error}");
    let usable_cpus = sched_getaffinity(None).map_err(affinity_error)?;
    sched_setaffinity(None, &usable_cpus).map_err(affinity_error)?;
    let first = (0..CpuSet::MAX_CPU).find(|&processor| usable_cpus.is_set(processor));
    let busy_time_s = read_busy_time_s(first.into_iter());
    busy_time_s.map(|_| ()).ok_or_else(|| "/proc/stat is not readable".into())
}

/// Returns the processor time used on these processors since the machine started, s. `None` if it cannot be read.
fn read_busy_time_s(processors: impl Iterator<Item = usize>) -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/stat").ok()?;
    let mut ticks = 0.0;
    for processor in processors {
        let line = stat.lines().find_map(|line| {
            let rest = line.strip_prefix("cpu")?.strip_prefix(&processor.to_string())?;
            rest.strip_prefix(' ')
        })?;
        let mut times = line.split_whitespace().map(str::parse::<f64>);
        let mut next = || times.next()?.ok();
        let (user, nice, system) = (next()?, next()?, next()?);
        ticks += user + nice + system;
    }
    Some(ticks / clock::ticks_per_s() as f64)
}

/// Returns the processor time that a process has used, s; 0 if it has exited.
fn cpu_time_of_process_s(pid: u32) -> f64 {
    let mut clock = 0;
    // SAFETY: a plain call that writes `clock`.
    let is_known = unsafe { libc::clock_getcpuclockid(pid as i32, &mut clock) } == 0;
    if is_known { read_clock_s(clock) } else { 0.0 }
}

/// Returns the processor time that this process has used, s.
fn process_cpu_time_s() -> f64 {
    read_clock_s(libc::CLOCK_PROCESS_CPUTIME_ID)
}

fn read_clock_s(clock: libc::clockid_t) -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: a plain call that writes `time`.
    match unsafe { libc::clock_gettime(clock, &mut time) } {
        0 => time.tv_sec as f64 + time.tv_nsec as f64 / 1e9,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn processes_are_pinned_without_awake_processes() {
        let Some(cores) = Cores::assign(1, 0) else { return };
        let plant_core = cores.assignment.plant_processor;
        let sleep = Command::new("sleep").arg("1000").spawn().unwrap();
        let plant = Child::watch(sleep, Path::new("/dev/null")).unwrap();
        let mut placement = Placement::new(cores, Launcher::new("/no/such/executable"));
        placement.update(&plant, std::iter::empty(), 0, Path::new("/dev/null"));
        assert!(placement.awake_processes.is_empty() && placement.skips_awake_processes);
        let affinity = sched_getaffinity(Pid::from_raw(plant.pid() as i32)).unwrap();
        assert_eq!((affinity.count(), affinity.is_set(plant_core)), (1, true));
        placement.end_placement();
    }

    #[test]
    fn cores_with_many_robots_are_not_kept_awake() {
        let skips = |robots| {
            let cores = Cores::assign(robots, 0)?;
            let is_limited = cores.is_cpu_time_limited;
            let placement = Placement::new(cores, Launcher::new("/no/such/executable"));
            Some((is_limited, placement.skips_awake_processes))
        };
        let Some((is_limited, one_robot)) = skips(1) else { return };
        assert_eq!(one_robot, is_limited);
        let processors = std::thread::available_parallelism().unwrap().get();
        assert!(skips(AWAKE_ROBOTS_PER_CORE_MAX * processors + 1).unwrap().1);
    }

    #[test]
    fn busy_time_of_the_machine_includes_this_process() {
        let own_time_s = process_cpu_time_s();
        assert!(own_time_s > 0.0 && cpu_time_of_process_s(std::process::id()) >= own_time_s);
        assert!(read_busy_time_s(std::iter::once(0)).is_none_or(|busy_s| busy_s > 0.0));
    }
}
