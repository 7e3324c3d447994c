//! Speed of lockstep runs within one process, as campaigns, hunts and training compute them, measured on rings.
//!
//! The runs are measured like any other run, but nothing is recorded. The processor time of a run with a few ticks is
//! subtracted, so that neither reading the scenario nor the first tick counts.

use outcome::results::usage;
use run::in_process::measured::{self, create_controller};

use crate::lockstep::{self, PERIOD_S, START_TICKS};
use crate::ring;
use crate::rounds::{BenchCase, BenchSettings};

/// Minimum number of ticks.
const TICKS_MIN: u64 = 100;

/// Returns a case for each number of robots, in increasing order.
pub(crate) fn cases<'a>(settings: &BenchSettings<'_>, robots: &[usize]) -> Vec<BenchCase<'a>> {
    let mut robots = robots.to_vec();
    robots.sort_unstable();
    robots.dedup();
    let robots_min = robots.first().copied().unwrap_or_default();
    let seconds = settings.duration_s;
    let case = |robots: usize| {
        let ticks = lockstep::tick_count(robots, seconds).max(TICKS_MIN);
        BenchCase::new(format!("{robots} robots"), move |table| {
            let used_s = processor_time_s(robots, ticks)? - processor_time_s(robots, START_TICKS)?;
            let us = 1e6 * used_s / (ticks - START_TICKS) as f64 / robots as f64;
            let quantity = "processor time per robot and tick, us";
            table.record_run("robot ticks/s and core", 1e6 / us);
            table.record_run(quantity, us);
            if robots > robots_min
                && let Some(robots_min_us) =
                    table.last_value(&format!("{robots_min} robots, {quantity}"))
            {
                table.record_run(
                    &format!("time per robot and tick / that of {robots_min}"),
                    us / robots_min_us,
                );
            }
            Ok(())
        })
    };
    robots.into_iter().map(case).collect()
}

/// Returns the processor time of a run of the ring with this number of ticks, s.
fn processor_time_s(robots: usize, ticks: u64) -> anyhow::Result<f64> {
    let scenario = ring::parse_scenario(&ring::ring_scenario_text(robots, ticks, PERIOD_S))?;
    let earlier_usage = usage::read_this_thread();
    measured::measure_run(&scenario, Box::new(create_controller), &mut |_, _, _| true);
    Ok(usage::read_this_thread().usage_since(&earlier_usage).processor_time_s())
}
