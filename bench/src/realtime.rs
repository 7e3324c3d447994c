//! Real time at several sizes and rates, up to saturation: deadline misses, commands that expired at the
//! plant because no newer one arrived, and wake-up latencies; compared with processes that have the same
//! timers and use as much processor time, but do nothing.

use anyhow::Context as _;
use protocol::brief::Pace;
use protocol::stage::Stage;

use crate::quantiles::{QUANTILES, combined};
use crate::ring;
use crate::rounds::{Case, Setting};
use crate::run::Run;
use crate::timers::{self, Task};

/// Rates of the robots, Hz.
pub(crate) const RATES_HZ: [u64; 2] = [100, 1000];
/// Factor by which a run in real time lasts longer than one in lockstep, because misses are rare.
pub(crate) const LONGER: f64 = 3.0;
/// Name of the baseline.
const TIMERS: &str = "timers, as busy";

/// Returns a case for each rate and number of robots.
pub(crate) fn cases<'a>(setting: &'a Setting<'_>, robots: &[usize]) -> Vec<Case<'a>> {
    let priority = setting.realtime_priority.then_some("--realtime-priority");
    let case = |rate_hz: u64, robots: usize| {
        let (ticks, text) = ring::lasting(robots, rate_hz, LONGER * setting.seconds);
        Case::new(setting.realtime_case(robots, rate_hz), move |table| {
            let periods = (ticks * robots as u64) as f64;
            let summary =
                Run::start(setting, &text, Pace::Realtime, priority.as_slice())?.summary()?;
            let latest = combined(&summary.stage(Stage::Wake), f64::max).context("nobody woke")?;
            let busy_ns = (1e9 * summary.taken_s()?[0] / periods) as u64;
            let period_ns = 1_000_000_000 / rate_hz;
            let realtime_priority = setting.realtime_priority;
            let task = Task { period_ns, ticks, busy_ns, realtime_priority };
            let timers = timers::measure(setting, robots, task)?;

            let what = "deadlines missed, % of periods";
            table.run(what, 100.0 * summary.number("/deadline_misses")? / periods);
            table.baseline(what, TIMERS, 100.0 * timers.missed as f64 / periods);
            let expired = summary.number("/commands/expired")?;
            table.run("commands expired, % of periods", 100.0 * expired / periods);
            for ((_, name, _), (ours, timers)) in
                QUANTILES.iter().zip(latest.into_iter().zip(timers.latest_us))
            {
                let what = format!("wake lateness {name} of the latest, us");
                table.run(&what, ours);
                table.baseline(&what, TIMERS, timers);
            }
            Ok(())
        })
    };
    RATES_HZ.iter().flat_map(|&rate| robots.iter().map(move |&robots| case(rate, robots))).collect()
}
