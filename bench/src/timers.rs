//! The floor of real time: as many processes with the same timers as the robots of a run, and each
//! on the processor for as long, but without samples, brains, plant and supervisor. What they wake
//! late and miss is the machine's doing.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use agent::golden_phase;
use protocol::clock::{self, Timer};
use protocol::lateness::{Late, Witness};
use protocol::process::{self, Stop, Turns};
use protocol::run_root::RunRoot;
use rustix::thread::ClockId;
use serde::{Deserialize, Serialize};

use crate::peers::{self, Peers};
use crate::quantiles::{Quantiles, quantiles_us};
use crate::whose::ByCause;
use crate::{BenchError, Place};

/// What each process does.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct Task {
    /// T, ns.
    pub(crate) period_ns: u64,
    /// How many periods.
    pub(crate) ticks: u64,
    /// Time on the processor in each of them, ns, waking up included.
    pub(crate) busy_ns: u64,
    /// It runs before every ordinary process.
    #[arg(long)]
    pub(crate) realtime_priority: bool,
}

/// What one process saw of its timer.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Seen {
    /// How late it woke. A wake-up that overslept deadlines counts for each of them.
    pub(crate) late_us: Quantiles,
    /// Deadlines that passed before the work of the one before was done.
    pub(crate) missed: u64,
    /// Late wake-ups, told as a robot tells them.
    pub(crate) causes: ByCause,
}

/// So many processes at once; what each saw.
pub(crate) fn measure(
    root: &RunRoot,
    stop: &Stop,
    robots: usize,
    task: Task,
) -> Result<Vec<Seen>, BenchError> {
    let place = Place::new(root, "timers")?;
    let results: Vec<PathBuf> =
        (1..=robots).map(|index| place.path().join(format!("result-{index}.json"))).collect();
    let words = results.iter().zip(1..).map(|(result, index): (_, usize)| {
        let numbers = [index as u64, task.period_ns, task.ticks, task.busy_ns];
        let words = ["peer", "timer"].map(OsString::from).into_iter();
        let words = words.chain(numbers.map(|n| n.to_string().into())).chain([result.into()]);
        words.chain(task.realtime_priority.then(|| "--realtime-priority".into())).collect()
    });
    let peers = Peers::start(place.path(), stop, words)?;
    peers.go()?;
    results.iter().map(|result| peers.told(result)).collect()
}

/// The process of robot `index`, from 1.
pub(crate) fn peer(index: usize, task: Task, result: &Path) -> Result<(), BenchError> {
    if task.realtime_priority {
        process::hurry();
    }
    clock::tighten_timer_slack();
    process::take_turns(Turns::Short);
    peers::await_go(result.parent().unwrap_or(result), index - 1)?;
    let period_ns = task.period_ns;
    let mut late_ns = Vec::with_capacity(task.ticks as usize);
    let (mut missed, mut busy_until_ns) = (0, busy_ns());
    let mut timer = Timer::new(period_ns, (golden_phase(index) * period_ns as f64) as u64);
    let mut witness = Witness::new(period_ns);
    let mut causes = ByCause::default();
    let (mut awake_ns, mut rested_ns, mut misses) = (clock::now_ns(), clock::now_ns(), 0);
    while (late_ns.len() as u64) < task.ticks {
        let Some(wake) = timer.wait() else { continue };
        for overslept in 0..=wake.lateness_ns / period_ns {
            late_ns.push(wake.lateness_ns - overslept * period_ns);
        }
        if !witness.on_time(wake.lateness_ns, misses > 0) {
            let cause = witness.cause_of(Late::of(&wake, awake_ns, rested_ns));
            causes[cause as usize].add(wake.lateness_ns);
        }
        awake_ns = wake.due_ns + wake.lateness_ns;
        // Whoever took longer once has less to do later.
        busy_until_ns += task.busy_ns;
        while busy_ns() < busy_until_ns {}
        rested_ns = clock::now_ns();
        misses = (rested_ns - wake.due_ns) / period_ns;
        missed += misses;
    }
    let late_us = quantiles_us(late_ns).unwrap_or_default();
    peers::tell(result, &Seen { late_us, missed, causes })
}

/// Time that this process has had on the processor, ns.
fn busy_ns() -> u64 {
    let busy = rustix::time::clock_gettime(ClockId::ThreadCPUTime);
    busy.tv_sec as u64 * 1_000_000_000 + busy.tv_nsec as u64
}
