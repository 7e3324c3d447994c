//! Baseline of real time: as many processes with the same timers as the robots of a run, each with the same
//! processor time per period, but without samples, controllers, plant and supervisor. Their wake-up
//! latencies and deadline misses are those of the machine.

use std::ffi::OsString;

use agent::golden_phase;
use anyhow::Context as _;
use protocol::clock::{self, Timer};
use protocol::process::{self, TimeSlice};
use rustix::thread::ClockId;
use serde::{Deserialize, Serialize};

use crate::Place;
use crate::peers::{Peers, Post};
use crate::quantiles::{Quantiles, combined, quantiles_us};
use crate::rounds::Setting;

/// Task of each process.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct Task {
    /// Period (T), ns.
    pub(crate) period_ns: u64,
    /// Number of periods.
    pub(crate) ticks: u64,
    /// Processor time per period, ns, including the wake-up.
    pub(crate) busy_ns: u64,
    /// Whether it runs with real-time priority.
    #[arg(long)]
    pub(crate) realtime_priority: bool,
}

/// Timer statistics of one process, or of all together.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Seen {
    /// Wake-up latencies. A wake-up that missed several deadlines counts for each of them.
    pub(crate) latest_us: Quantiles,
    /// Number of deadlines that passed before the previous work was done.
    pub(crate) missed: u64,
}

/// Measures this many processes concurrently.
pub(crate) fn measure(setting: &Setting<'_>, robots: usize, task: Task) -> anyhow::Result<Seen> {
    let place = Place::new(setting.root, "timers")?;
    let numbers =
        [task.period_ns, task.ticks, task.busy_ns].map(|number| number.to_string().into());
    let mut words: Vec<OsString> = numbers.into();
    words.extend(task.realtime_priority.then(|| "--realtime-priority".into()));
    let peers = Peers::start(place.path(), setting.stop, robots, "timer", &words)?;
    let seen: Vec<Seen> = peers.results()?;
    let latest: Vec<Quantiles> = seen.iter().map(|seen| seen.latest_us).collect();
    let latest_us = combined(&latest, f64::max).context("no timers")?;
    Ok(Seen { latest_us, missed: seen.iter().map(|seen| seen.missed).sum() })
}

/// Runs the process of one robot.
pub(crate) fn peer(post: &Post, task: Task) -> anyhow::Result<()> {
    if task.realtime_priority {
        process::apply_realtime_priority();
    }
    clock::tighten_timer_slack();
    process::request_time_slice(TimeSlice::Short);
    post.wait_for_all()?;
    let period_ns = task.period_ns;
    let mut late_ns = Vec::with_capacity(task.ticks as usize);
    let (mut missed, mut busy_until_ns) = (0, busy_ns());
    let phase_ns = (golden_phase(post.index + 1) * period_ns as f64) as u64;
    let mut timer = Timer::new(period_ns, phase_ns);
    while (late_ns.len() as u64) < task.ticks {
        let Some(wake) = timer.wait() else { continue };
        for overslept in 0..=wake.lateness_ns / period_ns {
            late_ns.push(wake.lateness_ns - overslept * period_ns);
        }
        // A period that took longer leaves less to do in later ones.
        busy_until_ns += task.busy_ns;
        while busy_ns() < busy_until_ns {}
        missed += (clock::now_ns() - wake.due_ns) / period_ns;
    }
    let latest_us = quantiles_us(late_ns).unwrap_or_default();
    post.report(&Seen { latest_us, missed })
}

/// Returns the processor time of this process, ns.
fn busy_ns() -> u64 {
    let busy = rustix::time::clock_gettime(ClockId::ThreadCPUTime);
    busy.tv_sec as u64 * 1_000_000_000 + busy.tv_nsec as u64
}
