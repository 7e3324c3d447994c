//! The baseline of real time: as many processes with the same timers as the robots of a run, and each
//! on the processor for as long, but without samples, brains, plant and supervisor. What they wake
//! late and miss is the machine's doing.

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

/// What each process does.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct Task {
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

/// What one process saw of its timer, or all of theirs.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Seen {
    /// How late the latest woke. A wake-up that overslept deadlines counts for each of them.
    pub(crate) latest_us: Quantiles,
    /// Deadlines that passed before the work of the one before was done.
    pub(crate) missed: u64,
}

/// So many processes at once.
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

/// The process of one robot.
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
        // Whoever took longer once has less to do later.
        busy_until_ns += task.busy_ns;
        while busy_ns() < busy_until_ns {}
        missed += (clock::now_ns() - wake.due_ns) / period_ns;
    }
    let latest_us = quantiles_us(late_ns).unwrap_or_default();
    post.report(&Seen { latest_us, missed })
}

/// Time that this process has had on the processor, ns.
fn busy_ns() -> u64 {
    let busy = rustix::time::clock_gettime(ClockId::ThreadCPUTime);
    busy.tv_sec as u64 * 1_000_000_000 + busy.tv_nsec as u64
}
