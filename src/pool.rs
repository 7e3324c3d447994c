//! The missing runs of a campaign, several at once. How one is tried is a [`Way`]: by `processes`, or
//! whatever whoever calls this has.
//!
//! Must not: start robots, or judge a run. A run whose machinery failed is tried again, as often as
//! [`ATTEMPTS_MAX`] says.

pub mod processes;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use outcome::results::usage;
use protocol::brief::Pace;
use protocol::process::Stop;
use rustix::thread::{CpuSet, sched_setaffinity};
use supervisor::cores::topology::Topology;

use experiment::campaign::cells::Cell;
use experiment::campaign::file::Campaign;
use outcome::campaign::folder::{ATTEMPTS_MAX, Folder, append_failure, failed_attempts};

/// How far it is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Progress {
    /// Runs that have a result now, or were given up.
    pub done: usize,
    /// Attempts whose machinery failed.
    pub failures: usize,
}

/// How it ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ended {
    /// A signal ended it.
    pub interrupted: bool,
    /// Wall time, s.
    pub wall_s: f64,
    /// How many runs went at once.
    pub jobs: usize,
    /// Cores that they used.
    pub cores: usize,
    /// Processor time of all of them, s.
    pub processor_s: f64,
}

/// A way to try a run.
pub trait Way: Sync {
    /// Tries a run once.
    fn attempt(&self, cell: &Cell) -> Tried;

    /// Whether a run has cores of its own, on which all that it starts stays.
    fn has_own_cores(&self) -> bool {
        true
    }
}

/// What became of an attempt.
#[derive(Debug, Clone, PartialEq)]
pub enum Tried {
    /// The run has a result.
    Done,
    /// A signal ended it, and nothing is left of it.
    Stopped,
    /// Its machinery failed, for this reason.
    Failed(String),
    /// It can never be run, though it had been found sound: nor can others.
    Refused(String),
}

/// How many runs go at once, and the logical processors of each; none: all of them. In lockstep a run
/// has whole cores, as many go at once as there are of these, or as the quota of a container pays for.
fn deal(topology: &Topology, pace: Pace, missing: usize, jobs: Option<usize>) -> Vec<Vec<usize>> {
    if pace == Pace::Realtime {
        return vec![Vec::new()];
    }
    let jobs = jobs.unwrap_or(topology.whole_cores()).clamp(1, missing.max(1));
    let cores = &topology.cores;
    if cores.is_empty() {
        return vec![Vec::new(); jobs];
    }
    let each = (cores.len() / jobs).max(1);
    let threads = |i: usize| cores[i % cores.len()].threads.iter().copied();
    (0..jobs).map(|job| (job * each..(job + 1) * each).flat_map(threads).collect()).collect()
}

/// Runs what is missing. `told` hears of each end. Fails with the reason for which a run was refused that the
/// campaign had found sound, or could not be started at all.
pub fn run(
    campaign: &Campaign,
    missing: &[&Cell],
    folder: &Folder,
    way: &dyn Way,
    stop: &Stop,
    jobs: Option<usize>,
    mut told: impl FnMut(Progress),
) -> Result<Ended, String> {
    let (began, before_s) = (Instant::now(), processor_s());
    let topology = Topology::of_this_thread().unwrap_or_default();
    let shares = deal(&topology, campaign.pace, missing.len(), jobs);
    let (jobs, cores) = (shares.len(), topology.threads().count().max(1));
    let (next, failed) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for share in shares {
            let sender = sender.clone();
            let (next, failed) = (&next, &failed);
            scope.spawn(move || {
                if way.has_own_cores() {
                    // Inherited by the run and all its processes.
                    keep_on(&share);
                }
                while let Some(cell) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if stop.requested() || failed.load(Ordering::Relaxed) > 0 {
                        return;
                    }
                    let result = to_its_end(cell, folder, way, stop, &sender);
                    failed.fetch_add(usize::from(result.is_err()), Ordering::Relaxed);
                    // Nobody listens once it has failed elsewhere.
                    let _ = sender.send(News::End(result));
                }
            });
        }
        drop(sender);
        let mut progress = Progress::default();
        let mut broken = None;
        for news in receiver {
            match news {
                News::Failure => progress.failures += 1,
                News::End(Ok(done)) => progress.done += usize::from(done),
                News::End(Err(error)) => broken = broken.or(Some(error)),
            }
            told(progress);
        }
        let wall_s = began.elapsed().as_secs_f64();
        match broken {
            Some(why) => Err(format!("a run failed: {why}")),
            None => Ok(Ended {
                interrupted: stop.requested(),
                wall_s,
                jobs,
                cores,
                processor_s: processor_s() - before_s,
            }),
        }
    })
}

/// What `work` makes of each item, in their order, by so many threads at once; one for each core unless it is said.
pub fn on_all_cores<I: Sync, T: Send>(
    items: &[I],
    jobs: Option<usize>,
    work: impl Fn(&I) -> T + Sync,
) -> Vec<T> {
    let cores = || Topology::of_this_thread().unwrap_or_default().whole_cores();
    let jobs = jobs.unwrap_or_else(cores).clamp(1, items.len().max(1));
    let next = AtomicUsize::new(0);
    let work_off = || {
        let mut done = Vec::new();
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(place) else { return done };
            done.push((place, work(item)));
        }
    };
    let mut done: Vec<(usize, T)> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..jobs).map(|_| scope.spawn(work_off)).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("work does not panic")).collect()
    });
    done.sort_by_key(|(place, _)| *place);
    done.into_iter().map(|(_, made)| made).collect()
}

/// Processor time of this process, of all children that have ended, and of theirs, s.
fn processor_s() -> f64 {
    let usages = [usage::read_this_process(), usage::read_reaped_children()];
    usages.iter().map(|usage| usage.user_s + usage.system_s).sum()
}

enum News {
    /// The machinery of an attempt failed.
    Failure,
    /// Whether a run is done.
    End(Result<bool, String>),
}

fn keep_on(cores: &[usize]) {
    if cores.is_empty() {
        return;
    }
    let mut set = CpuSet::new();
    cores.iter().for_each(|&core| set.set(core));
    if let Err(error) = sched_setaffinity(None, &set) {
        tracing::debug!(%error, "runs have no cores of their own");
    }
}

/// Whether it has a result in the end, or was given up; not if all are to stop.
fn to_its_end(
    cell: &Cell,
    folder: &Folder,
    way: &dyn Way,
    stop: &Stop,
    news: &mpsc::Sender<News>,
) -> Result<bool, String> {
    let run = folder.run(&cell.id);
    loop {
        let failed_before = failed_attempts(&run).len();
        if failed_before >= ATTEMPTS_MAX {
            return Ok(true);
        }
        if stop.requested() {
            return Ok(false);
        }
        let why = match way.attempt(cell) {
            Tried::Done => return Ok(true),
            Tried::Stopped => return Ok(false),
            Tried::Refused(why) => return Err(why),
            Tried::Failed(why) => why,
        };
        let _ = news.send(News::Failure);
        // A run that could say why has done so.
        if failed_attempts(&run).len() == failed_before {
            append_failure(&run, &why).map_err(|error| error.to_string())?;
        }
    }
}

#[cfg(test)]
mod tests {
    use supervisor::cores::topology::Core;

    use super::*;

    #[test]
    fn runs_in_lockstep_share_no_core_while_there_are_enough_and_in_real_time_go_alone() {
        let core =
            |threads: &[usize]| Core { threads: threads.into(), cache: 0, node: 0, speed: 1024 };
        let deal =
            |topology: &Topology, missing, jobs| deal(topology, Pace::Lockstep, missing, jobs);
        let single = Topology { cores: [2, 3, 5, 7].map(|cpu| core(&[cpu])).into(), quota: None };
        assert_eq!(deal(&single, 100, None), [[2], [3], [5], [7]]);
        assert_eq!(deal(&single, 2, None), [[2, 3], [5, 7]], "few runs have more cores each");
        assert_eq!(deal(&single, 100, Some(1)), [[2, 3, 5, 7]]);
        assert_eq!(deal(&single, 100, Some(6)).len(), 6);
        assert_eq!(super::deal(&single, Pace::Realtime, 100, Some(4)), [[0; 0]]);
        let double = Topology { cores: vec![core(&[0, 2]), core(&[1, 3])], quota: None };
        assert_eq!(deal(&double, 100, None), [[0, 2], [1, 3]], "no core has two runs");
        let paid = Topology { quota: Some(1.5), ..double };
        assert_eq!(deal(&paid, 100, None), [[0, 2, 1, 3]], "more would only be held up");
        assert_eq!(deal(&Topology::default(), 100, None), [[0; 0]], "the kernel says nothing");
    }
}
