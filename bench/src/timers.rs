//! Baseline of the part realtime: one process for each robot of the run, with the same timer and the same processor
//! time per period, but without samples, controllers, plant and supervisor. Their wake-up latency and deadline misses
//! are caused by the machine alone.

use std::ffi::OsString;

use anyhow::Context as _;
use protocol::clock::{self, Timer};
use protocol::process::{self, TimeSlice};
use protocol::wake::golden_phase_ns;
use rustix::thread::ClockId;
use serde::{Deserialize, Serialize};

use crate::WorkDir;
use crate::peers::{PeerAddress, Peers};
use crate::quantiles::{Quantiles, quantiles_us, reduce_quantiles};
use crate::rounds::BenchSettings;

/// Task of each process.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct TimerTask {
    /// Period (T), ns.
    pub(crate) period_ns: u64,
    /// Number of periods.
    pub(crate) ticks: u64,
    /// Processor time in each period, ns, including the wake-up.
    pub(crate) busy_ns: u64,
    /// Run with SCHED_FIFO priority and locked memory.
    #[arg(long)]
    pub(crate) realtime_priority: bool,
}

/// Wake-up latency and deadline misses of one process, or of all processes together.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct TimerResult {
    /// Quantiles of the wake-up latency, us; of several processes the maximum of each quantile. A wake-up that slept
    /// through several deadlines counts once for each of them.
    pub(crate) latency_us: Quantiles,
    /// Number of deadlines that passed before the work of the previous period was done.
    pub(crate) missed: u64,
}

/// Runs one process for each robot at the same time and returns their combined result.
pub(crate) fn measure(
    settings: &BenchSettings<'_>,
    robots: usize,
    task: TimerTask,
) -> anyhow::Result<TimerResult> {
    let work_dir = WorkDir::new(settings.root, "timers")?;
    let numbers =
        [task.period_ns, task.ticks, task.busy_ns].map(|number| number.to_string().into());
    let mut arguments: Vec<OsString> = numbers.into();
    arguments.extend(task.realtime_priority.then(|| "--realtime-priority".into()));
    let peers = Peers::start(work_dir.path(), settings.stop, robots, "timer", &arguments)?;
    let results: Vec<TimerResult> = peers.wait_for_results()?;
    let latencies: Vec<Quantiles> = results.iter().map(|result| result.latency_us).collect();
    let latency_us =
        reduce_quantiles(&latencies, f64::max).context("there are no timer processes")?;
    Ok(TimerResult { latency_us, missed: results.iter().map(|result| result.missed).sum() })
}

/// Runs the timer process of one robot and reports its result.
pub(crate) fn run_peer(address: &PeerAddress, task: TimerTask) -> anyhow::Result<()> {
    if task.realtime_priority {
        process::apply_realtime_priority();
    }
    clock::tighten_timer_slack();
    process::request_time_slice(TimeSlice::Short);
    address.wait_for_start()?;
    let period_ns = task.period_ns;
    let mut lateness_ns = Vec::with_capacity(task.ticks as usize);
    let (mut missed, mut busy_until_ns) = (0, thread_cpu_time_ns());
    let mut timer = Timer::new(period_ns, golden_phase_ns(address.index + 1, period_ns));
    while (lateness_ns.len() as u64) < task.ticks {
        let Some(wake) = timer.wait() else { continue };
        for missed_periods in 0..=wake.lateness_ns / period_ns {
            lateness_ns.push(wake.lateness_ns - missed_periods * period_ns);
        }
        // The processor time is cumulative: a period that used more leaves less for the next ones.
        busy_until_ns += task.busy_ns;
        while thread_cpu_time_ns() < busy_until_ns {}
        missed += (clock::now_ns() - wake.due_ns) / period_ns;
    }
    let latency_us = quantiles_us(lateness_ns).unwrap_or_default();
    address.report_result(&TimerResult { latency_us, missed })
}

/// Returns the processor time of the calling thread, ns.
fn thread_cpu_time_ns() -> u64 {
    let time = rustix::time::clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}
