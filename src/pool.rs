//! Executes the missing runs of a campaign, several at once. A [`RunExecutor`] is the method of execution:
//! `processes`, or one given by the caller.
//!
//! Must not start robots or evaluate a run. A run with an infrastructure failure is repeated up to
//! [`ATTEMPTS_MAX`] times.

pub mod processes;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use outcome::results::usage;
use protocol::brief::Pace;
use protocol::process::StopFlag;
use rustix::thread::{CpuSet, sched_setaffinity};
use supervisor::cores::topology::Topology;

use experiment::campaign::cells::CampaignRun;
use experiment::campaign::file::Campaign;
use outcome::campaign::folder::{
    ATTEMPTS_MAX, CampaignFolder, append_failure, read_failed_attempts,
};

/// Progress of the campaign.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CampaignProgress {
    /// Number of runs that have a result now, or were given up.
    pub finished_runs: usize,
    /// Number of attempts with an infrastructure failure.
    pub failed_attempts: usize,
}

/// Result of executing a campaign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CampaignResult {
    /// Whether a signal ended the campaign.
    pub was_interrupted: bool,
    /// Wall time, s.
    pub wall_time_s: f64,
    /// Number of concurrent runs.
    pub jobs: usize,
    /// Number of cores used.
    pub cores: usize,
    /// Processor time of all runs, s.
    pub processor_time_s: f64,
}

/// Method of executing a run.
pub trait RunExecutor: Sync {
    /// Executes a run once.
    fn attempt(&self, cell: &CampaignRun) -> AttemptResult;

    /// Returns whether a run and all processes that it starts are pinned to cores of their own.
    fn has_own_cores(&self) -> bool {
        true
    }
}

/// Result of an attempt.
#[derive(Debug, Clone, PartialEq)]
pub enum AttemptResult {
    /// The run has a result.
    Done,
    /// A signal ended the attempt, and its files have been removed.
    Stopped,
    /// Infrastructure failure, with the reason.
    Failed(String),
    /// The run was rejected although the campaign had found it valid. Ends the campaign, because other runs
    /// would be rejected too.
    Refused(String),
}

/// Returns the logical processors of each concurrent run; an empty list means all of them. In lockstep each
/// run has whole cores; the default number of runs is the number of cores, limited by the CPU quota of a
/// container.
fn assign_cores(
    topology: &Topology,
    pace: Pace,
    run_count: usize,
    jobs: Option<usize>,
) -> Vec<Vec<usize>> {
    if pace == Pace::Realtime {
        return vec![Vec::new()];
    }
    let jobs = jobs.unwrap_or(topology.whole_cores()).clamp(1, run_count.max(1));
    let cores = &topology.cores;
    if cores.is_empty() {
        return vec![Vec::new(); jobs];
    }
    let cores_per_job = (cores.len() / jobs).max(1);
    let threads = |i: usize| cores[i % cores.len()].threads.iter().copied();
    (0..jobs)
        .map(|job| (job * cores_per_job..(job + 1) * cores_per_job).flat_map(threads).collect())
        .collect()
}

/// Executes the missing runs. Calls `on_progress` after each attempt. Fails if a run is rejected that the campaign
/// had found valid, or cannot be started.
pub fn execute_runs(
    campaign: &Campaign,
    missing: &[&CampaignRun],
    folder: &CampaignFolder,
    executor: &dyn RunExecutor,
    stop: &StopFlag,
    jobs: Option<usize>,
    mut on_progress: impl FnMut(CampaignProgress),
) -> Result<CampaignResult, String> {
    let (start, start_cpu_time_s) = (Instant::now(), children_cpu_time_s());
    let topology = Topology::for_this_thread().unwrap_or_default();
    let core_sets = assign_cores(&topology, campaign.pace, missing.len(), jobs);
    let (jobs, cores) = (core_sets.len(), topology.threads().count().max(1));
    let (next_index, failure_count) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for core_set in core_sets {
            let sender = sender.clone();
            let (next_index, failure_count) = (&next_index, &failure_count);
            scope.spawn(move || {
                if executor.has_own_cores() {
                    // Inherited by the run and all its processes.
                    pin_to(&core_set);
                }
                while let Some(cell) = missing.get(next_index.fetch_add(1, Ordering::Relaxed)) {
                    if stop.is_requested() || failure_count.load(Ordering::Relaxed) > 0 {
                        return;
                    }
                    let result = attempt_until_done(cell, folder, executor, stop, &sender);
                    failure_count.fetch_add(usize::from(result.is_err()), Ordering::Relaxed);
                    // The receiver is gone if another run failed.
                    let _ = sender.send(WorkerMessage::RunEnded(result));
                }
            });
        }
        drop(sender);
        let mut progress = CampaignProgress::default();
        let mut first_error = None;
        for message in receiver {
            match message {
                WorkerMessage::AttemptFailed => progress.failed_attempts += 1,
                WorkerMessage::RunEnded(Ok(is_done)) => {
                    progress.finished_runs += usize::from(is_done)
                }
                WorkerMessage::RunEnded(Err(error)) => first_error = first_error.or(Some(error)),
            }
            on_progress(progress);
        }
        let wall_time_s = start.elapsed().as_secs_f64();
        match first_error {
            Some(error) => Err(format!("a run failed: {error}")),
            None => Ok(CampaignResult {
                was_interrupted: stop.is_requested(),
                wall_time_s,
                jobs,
                cores,
                processor_time_s: children_cpu_time_s() - start_cpu_time_s,
            }),
        }
    })
}

/// Returns the number of concurrent runs: the given one, by default the number of cores.
pub fn concurrent_run_count(jobs: Option<usize>) -> usize {
    let cores = || Topology::for_this_thread().unwrap_or_default().whole_cores();
    jobs.unwrap_or_else(cores).max(1)
}

/// Applies `work` to each item in `jobs` threads, by default one for each core. With `has_own_cores`, each thread is
/// pinned to cores of its own, and so are the processes that it starts. Returns the results in the order of the items.
/// Panics if `work` panics.
pub fn map_on_all_cores<I: Sync, T: Send>(
    items: &[I],
    jobs: Option<usize>,
    has_own_cores: bool,
    work: impl Fn(&I) -> T + Sync,
) -> Vec<T> {
    let topology = Topology::for_this_thread().unwrap_or_default();
    let core_sets = assign_cores(&topology, Pace::Lockstep, items.len(), jobs);
    let next_index = AtomicUsize::new(0);
    let process_items = |core_set: &[usize]| {
        if has_own_cores {
            pin_to(core_set);
        }
        let mut results = Vec::new();
        loop {
            let index = next_index.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(index) else { return results };
            results.push((index, work(item)));
        }
    };
    let mut results: Vec<(usize, T)> = std::thread::scope(|scope| {
        let process_items = &process_items;
        let threads: Vec<_> =
            core_sets.iter().map(|core_set| scope.spawn(move || process_items(core_set))).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("work does not panic")).collect()
    });
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Returns the processor time of this process, of all children that have exited, and of their children, s.
fn children_cpu_time_s() -> f64 {
    let usages = [usage::read_this_process(), usage::read_reaped_children()];
    usages.iter().map(usage::Usage::processor_time_s).sum()
}

enum WorkerMessage {
    /// Infrastructure failure of an attempt.
    AttemptFailed,
    /// End of a run: whether it is done, or why it was rejected.
    RunEnded(Result<bool, String>),
}

fn pin_to(cores: &[usize]) {
    if cores.is_empty() {
        return;
    }
    let mut cpu_set = CpuSet::new();
    cores.iter().for_each(|&core| cpu_set.set(core));
    if let Err(error) = sched_setaffinity(None, &cpu_set) {
        tracing::debug!(%error, "runs have no cores of their own");
    }
}

/// Repeats a run until it has a result or is given up. Returns `false` if the campaign is to stop. Fails if
/// the run is rejected.
fn attempt_until_done(
    cell: &CampaignRun,
    folder: &CampaignFolder,
    executor: &dyn RunExecutor,
    stop: &StopFlag,
    sender: &mpsc::Sender<WorkerMessage>,
) -> Result<bool, String> {
    let run_path = folder.run_path(&cell.id);
    loop {
        let failed_before = read_failed_attempts(&run_path).len();
        if failed_before >= ATTEMPTS_MAX {
            return Ok(true);
        }
        if stop.is_requested() {
            return Ok(false);
        }
        let reason = match executor.attempt(cell) {
            AttemptResult::Done => return Ok(true),
            AttemptResult::Stopped => return Ok(false),
            AttemptResult::Refused(reason) => return Err(reason),
            AttemptResult::Failed(reason) => reason,
        };
        let _ = sender.send(WorkerMessage::AttemptFailed);
        // A run that could determine the reason has recorded it.
        if read_failed_attempts(&run_path).len() == failed_before {
            append_failure(&run_path, &reason).map_err(|error| error.to_string())?;
        }
    }
}

#[cfg(test)]
mod tests {
    use supervisor::cores::topology::Core;

    use super::*;

    #[test]
    fn lockstep_runs_share_no_core_and_realtime_runs_go_alone() {
        let core = |threads: &[usize]| Core {
            threads: threads.into(),
            cache_id: 0,
            numa_node: 0,
            speed: 1024,
        };
        let assign_cores = |topology: &Topology, missing, jobs| {
            assign_cores(topology, Pace::Lockstep, missing, jobs)
        };
        let single =
            Topology { cores: [2, 3, 5, 7].map(|cpu| core(&[cpu])).into(), quota_cores: None };
        assert_eq!(assign_cores(&single, 100, None), [[2], [3], [5], [7]]);
        assert_eq!(
            assign_cores(&single, 2, None),
            [[2, 3], [5, 7]],
            "few runs have more cores each"
        );
        assert_eq!(assign_cores(&single, 100, Some(1)), [[2, 3, 5, 7]]);
        assert_eq!(assign_cores(&single, 100, Some(6)).len(), 6);
        assert_eq!(super::assign_cores(&single, Pace::Realtime, 100, Some(4)), [[0; 0]]);
        let double = Topology { cores: vec![core(&[0, 2]), core(&[1, 3])], quota_cores: None };
        assert_eq!(assign_cores(&double, 100, None), [[0, 2], [1, 3]], "no core has two runs");
        let limited = Topology { quota_cores: Some(1.5), ..double };
        assert_eq!(assign_cores(&limited, 100, None), [[0, 2, 1, 3]], "more would only be held up");
        assert_eq!(
            assign_cores(&Topology::default(), 100, None),
            [[0; 0]],
            "the kernel says nothing"
        );
    }
}
