//! On which cores the processes of a lockstep run are: few on one core, many dealt to all, no core
//! asleep.
//!
//! In lockstep everybody waits for the slowest, again and again. Whoever wakes a process on another
//! core, or a core that fell asleep, waits longer than a robot thinks; so each robot is kept on a
//! core, and a process that gives way to everybody keeps that core awake. Only while the machine
//! has nothing else to do: beside other work the kernel balances better than any fixed deal. The
//! supervisor shall work while the robots on its core wait for the plant, and not hold them up: it
//! asks for long turns. Not for real time, where everybody wakes at a time of his own.

mod deal;
pub mod topology;
mod trial;

use std::path::Path;
use std::time::{Duration, Instant};

use protocol::clock;
use protocol::process::{Turns, take_turns_of_all};
use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use self::deal::Deal;
use self::topology::Topology;
use self::trial::Trial;
use crate::child::{Child, in_words};
use crate::spawn::{Launcher, Role};
use outcome::results::usage::Usage;

/// How often it is looked at what others want of the cores.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Others want the cores if they take more of them than this, in cores.
const OTHERS_MAX: f64 = 0.3;
/// After it had to let go it tries again later and later, at most after this long.
const TRY_AGAIN_MAX: Duration = Duration::from_secs(5);

/// Which core is whose.
#[derive(Debug)]
pub(crate) struct Cores {
    usable: CpuSet,
    deal: Deal,
    /// The cgroups permit only so much processor time: none of it is for keeping cores awake.
    limited: bool,
    robots: usize,
}

impl Cores {
    /// Deals the usable cores to so many robots, beginning with any: runs side by side on a large
    /// machine shall not all begin with the first. `None` with a single processor, or if the kernel
    /// does not say.
    pub(crate) fn deal(robots: usize, first: usize) -> Option<Cores> {
        let usable = sched_getaffinity(None).ok()?;
        let topology = Topology::of_this_thread()?;
        let deal = Deal::of(&topology, robots, first)?;
        Some(Cores { usable, deal, limited: topology.quota.is_some(), robots })
    }

    /// Into how many groups the robots are dealt, in turns.
    pub(crate) fn groups(&self) -> usize {
        self.deal.groups.len()
    }
}

/// The placement of the processes of one run on their cores, while nobody else wants them.
#[derive(Debug)]
pub(crate) struct Placement {
    cores: Cores,
    launcher: Launcher,
    /// Since when the trial goes on, how many ticks had been begun then, and the trial.
    began: Option<(Instant, u32)>,
    trial: Trial,
    /// When it was last looked around; `None` before the first time.
    looked: Option<Instant>,
    /// When it may try again, and how long it waits the next time it has to let go.
    try_again: Option<Instant>,
    patience: Duration,
    busy_s: f64,
    ours_s: f64,
    placed: bool,
    /// While they are placed, one process for each core with robots that keeps it awake.
    awake: Vec<(usize, Child)>,
    /// One of those could not be started, or there are to be none.
    without_awake: bool,
    /// What those took that are gone.
    usage: Usage,
}

impl Placement {
    /// Nobody is placed yet. `launcher`: of those that keep cores awake.
    pub(crate) fn new(cores: Cores, launcher: Launcher) -> Placement {
        let without_awake = cores.limited || !launcher.keeps_awake();
        Placement {
            trial: Trial::new(cores.robots, cores.groups()),
            began: None,
            cores,
            launcher,
            looked: None,
            try_again: None,
            patience: LOOK_EVERY,
            busy_s: 0.0,
            ours_s: 0.0,
            placed: false,
            awake: Vec::new(),
            without_awake,
            usage: Usage::default(),
        }
    }

    /// Looks, if it is time, at what others take of these cores, and keeps the plant and the robots
    /// (by slot) on theirs, or lets them go. At first nothing is known of others, and everybody is
    /// placed. `ticks`: how many were begun; `log`: of those that keep cores awake; a run is right without
    /// them, only slower.
    pub(crate) fn look<'a>(
        &mut self,
        plant: &Child,
        robots: impl Iterator<Item = (usize, &'a Child)> + Clone,
        ticks: u32,
        log: &Path,
    ) {
        if self.placed && self.tried(ticks) {
            self.place(plant, robots, log);
            return;
        }
        let passed = self.looked.map(|at| at.elapsed());
        if passed.is_some_and(|passed| passed < LOOK_EVERY) {
            return;
        }
        let Some(busy_s) = busy_s(self.cores.deal.used()) else { return };
        let awake = self.awake.iter().map(|(_, child)| child);
        let processes = robots.clone().map(|(_, child)| child).chain([plant]).chain(awake);
        let ended_s = self.usage.user_s + self.usage.system_s;
        let ours_s =
            own_time_s() + ended_s + processes.flat_map(Child::workers).map(time_s).sum::<f64>();
        // A process of ours that died takes its time with it: others seem to have had it. One that
        // was let go takes some of its time elsewhere: others seem to have had less.
        let others_s = (busy_s - self.busy_s) - (ours_s - self.ours_s).max(0.0);
        (self.looked, self.busy_s, self.ours_s) = (Some(Instant::now()), busy_s, ours_s);
        if passed.is_some_and(|passed| others_s > OTHERS_MAX * passed.as_secs_f64()) {
            if self.placed {
                self.let_go(plant, robots);
            }
            return;
        }
        if !self.placed && self.try_again.is_some_and(|at| Instant::now() < at) {
            return;
        }
        self.place(plant, robots, log);
    }

    /// Whether the trial has just come to another number of cores.
    fn tried(&mut self, ticks: u32) -> bool {
        let &mut (began, before) = self.began.get_or_insert((Instant::now(), ticks));
        self.trial.passed(began.elapsed(), ticks.wrapping_sub(before).into()).is_some()
    }

    /// Keeps everybody on a core. Each time anew: replacements are somewhere else.
    fn place<'a>(
        &mut self,
        plant: &Child,
        robots: impl Iterator<Item = (usize, &'a Child)>,
        log: &Path,
    ) {
        if !std::mem::replace(&mut self.placed, true) {
            take_turns_of_all(Turns::Long);
        }
        let used = self.trial.cores();
        self.keep_awake(used, log);
        for (i, child) in robots {
            keep_all_on(child, &alone(self.cores.deal.of_robot(i, used)));
        }
        keep_all_on(plant, &alone(self.cores.deal.plant));
        keep_on(0, &alone(self.cores.deal.supervisor));
    }

    fn keep_awake(&mut self, used: usize, log: &Path) {
        let cores = self.cores.deal.used_for_robots(used).to_vec();
        let (stay, go) = std::mem::take(&mut self.awake)
            .into_iter()
            .partition(|(core, child)| cores.contains(core) && !child.is_dead());
        self.awake = stay;
        self.end_awake(go);
        for core in cores {
            if self.without_awake || self.awake.iter().any(|&(kept, _)| kept == core) {
                continue;
            }
            match self.launcher.spawn(Role::Awake, log) {
                Ok(child) => {
                    keep_on(child.pid(), &alone(core));
                    self.awake.push((core, child));
                }
                Err(error) => {
                    tracing::warn!("{error}; the run is slower without it, and no less right");
                    self.without_awake = true;
                    return;
                }
            }
        }
    }

    fn let_go<'a>(&mut self, plant: &Child, robots: impl Iterator<Item = (usize, &'a Child)>) {
        self.end();
        self.placed = false;
        // What was counted beside others says nothing.
        (self.began, self.trial) = (None, Trial::new(self.cores.robots, self.cores.groups()));
        // Where there are other cores, what is left on these says little: it is tried.
        if self.cores.deal.used().count() < self.cores.usable.count() as usize {
            self.try_again = Some(Instant::now() + self.patience);
            self.patience = (2 * self.patience).min(TRY_AGAIN_MAX);
        }
        for child in robots.map(|(_, child)| child).chain([plant]) {
            keep_all_on(child, &self.cores.usable);
        }
    }

    /// Ends those that keep cores awake, and lets the calling thread go: what all of them took.
    pub(crate) fn end(&mut self) -> Usage {
        keep_on(0, &self.cores.usable);
        take_turns_of_all(Turns::Usual);
        let awake = std::mem::take(&mut self.awake);
        self.end_awake(awake);
        self.usage
    }

    /// Ends these processes that keep cores awake: all at once, then each is reaped. Warns of one that has died before.
    fn end_awake(&mut self, mut awake: Vec<(usize, Child)>) {
        for (core, child) in &mut awake {
            match child.ended() {
                Some(status) => tracing::warn!(
                    "the process that kept core {core} awake died ({}); the run is slower without it, and no less right",
                    in_words(status)
                ),
                None => drop(child.kill()),
            }
        }
        for (_, mut child) in awake {
            child.end();
            self.usage += child.usage().unwrap_or_default();
        }
    }
}

fn alone(core: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(core);
    set
}

/// Keeps all processes of a child on these cores.
fn keep_all_on(child: &Child, cores: &CpuSet) {
    child.workers().into_iter().for_each(|pid| keep_on(pid, cores));
}

/// Keeps a process, or as 0 the calling thread, on these cores. Whoever may not stays where it may
/// be: slower, and no less right.
fn keep_on(pid: u32, cores: &CpuSet) {
    if let Err(error) = sched_setaffinity(Pid::from_raw(pid as i32), cores) {
        tracing::debug!(pid, %error, "not kept on its core");
    }
}

/// Whether processes can be kept on cores, and it can be seen what others want of them: tried on
/// the calling thread, which stays where it is.
pub fn try_to_keep() -> Result<(), String> {
    let refused = |error| format!("sched_setaffinity: {error}");
    let usable = sched_getaffinity(None).map_err(refused)?;
    sched_setaffinity(None, &usable).map_err(refused)?;
    let first = (0..CpuSet::MAX_CPU).find(|&processor| usable.is_set(processor));
    let busy_s = busy_s(first.into_iter());
    busy_s.map(|_| ()).ok_or_else(|| "/proc/stat is not readable".into())
}

/// Processor time that all processes took on these processors since the machine started, s.
fn busy_s(processors: impl Iterator<Item = usize>) -> Option<f64> {
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

/// Processor time that a process took so far, s; 0 if it is gone.
fn time_s(pid: u32) -> f64 {
    let mut clock = 0;
    // SAFETY: a plain call that writes `clock`.
    let known = unsafe { libc::clock_getcpuclockid(pid as i32, &mut clock) } == 0;
    if known { clock_s(clock) } else { 0.0 }
}

/// Processor time that this process took so far, s.
fn own_time_s() -> f64 {
    clock_s(libc::CLOCK_PROCESS_CPUTIME_ID)
}

fn clock_s(clock: libc::clockid_t) -> f64 {
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
    fn without_what_keeps_cores_awake_the_others_are_placed_all_the_same() {
        let Some(cores) = Cores::deal(1, 0) else { return };
        let plants_core = cores.deal.plant;
        let sleep = Command::new("sleep").arg("1000").spawn().unwrap();
        let plant = Child::watch(sleep, Path::new("/dev/null")).unwrap();
        let mut placement = Placement::new(cores, Launcher::of("/no/such/executable"));
        placement.look(&plant, std::iter::empty(), 0, Path::new("/dev/null"));
        assert!(placement.awake.is_empty() && placement.without_awake);
        let placed = sched_getaffinity(Pid::from_raw(plant.pid() as i32)).unwrap();
        assert_eq!((placed.count(), placed.is_set(plants_core)), (1, true));
        placement.end();
    }

    #[test]
    fn the_time_of_this_process_is_part_of_what_the_machine_took() {
        let own = own_time_s();
        assert!(own > 0.0 && time_s(std::process::id()) >= own);
        assert!(busy_s(std::iter::once(0)).is_none_or(|busy_s| busy_s > 0.0));
    }
}
