//! Real time at several rates and numbers of robots, up to saturation: deadline misses, commands that expired at the
//! plant because no newer one arrived, and the wake-up latency of the robots. The baseline is processes with the same
//! timers and processor usage but without work.

use anyhow::Context as _;
use protocol::brief::Pace;
use protocol::stage::Stage;

use crate::quantiles::{QUANTILES, reduce_quantiles};
use crate::ring;
use crate::rounds::{BenchCase, BenchSettings};
use crate::run::RunProcess;
use crate::timers::{self, TimerTask};

/// Rates of the robots, Hz.
pub(crate) const RATES_HZ: [u64; 2] = [100, 1000];
/// Factor on the duration of a run in real time compared with one in lockstep, because deadline misses are rare.
pub(crate) const DURATION_FACTOR: f64 = 3.0;
/// Name of the baseline.
const TIMERS_BASELINE: &str = "timers, equally busy";

/// Returns a case for each rate and number of robots.
pub(crate) fn cases<'a>(settings: &'a BenchSettings<'_>, robots: &[usize]) -> Vec<BenchCase<'a>> {
    let priority = settings.realtime_priority.then_some("--realtime-priority");
    let case = |rate_hz: u64, robots: usize| {
        let (ticks, text) =
            ring::ring_text_for_duration(robots, rate_hz, DURATION_FACTOR * settings.duration_s);
        BenchCase::new(settings.format_realtime_case(robots, rate_hz), move |table| {
            let periods = (ticks * robots as u64) as f64;
            let summary = RunProcess::start(settings, &text, Pace::Realtime, priority.as_slice())?
                .wait_for_summary()?;
            let worst_us = reduce_quantiles(&summary.stage_quantiles(Stage::Wake), f64::max)
                .context("summary.json has no wake-up latency of any robot")?;
            let busy_ns = (1e9 * summary.cpu_time_s()?[0] / periods) as u64;
            let period_ns = 1_000_000_000 / rate_hz;
            let realtime_priority = settings.realtime_priority;
            let task = TimerTask { period_ns, ticks, busy_ns, realtime_priority };
            let timers = timers::measure(settings, robots, task)?;

            let quantity = "deadlines missed, % of periods";
            table.record_run(quantity, 100.0 * summary.number_at("/deadline_misses")? / periods);
            table.record_baseline(
                quantity,
                TIMERS_BASELINE,
                100.0 * timers.missed as f64 / periods,
            );
            let expired = summary.number_at("/commands/expired")?;
            table.record_run("commands expired, % of periods", 100.0 * expired / periods);
            for ((_, name, _), (run_us, timers_us)) in
                QUANTILES.iter().zip(worst_us.into_iter().zip(timers.latency_us))
            {
                let quantity = format!("wake-up latency {name}, worst robot, us");
                table.record_run(&quantity, run_us);
                table.record_baseline(&quantity, TIMERS_BASELINE, timers_us);
            }
            Ok(())
        })
    };
    RATES_HZ.iter().flat_map(|&rate| robots.iter().map(move |&robots| case(rate, robots))).collect()
}
