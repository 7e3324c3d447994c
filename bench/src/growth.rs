//! Growth of the processor time per tick with the number of robots, measured on rings in lockstep.
//!
//! The processor time of a run of the same ring with a few ticks is subtracted from each run, because starting many
//! processes is expensive and would dominate the cost of a small number of ticks. The idle-priority spinners that keep
//! cores awake must not be counted: they only use idle processor time.
//!
//! The time of the robots is compared with that of processes with the same controllers but without iceoryx2, and with
//! that of processes that are woken at each tick and do nothing: many processes cost more because of cold caches, also
//! without Phalanx.

use protocol::brief::Pace;

use formation::portable_math;

use crate::lockstep::{self, MAPPING_BASELINE, PERIOD_S, START_TICKS};
use crate::rounds::{BenchCase, BenchSettings};
use crate::run::{CPU_CONSUMERS, RunProcess, Summary};
use crate::{bare_lockstep, ring};

/// Explanation of the rows, printed below the table.
pub(crate) const NOTES: [&str; 5] = [
    "growth: processes, edges and samples grow with the number of robots of the ring; the number of",
    "  neighbors (4, or all others in rings of fewer than 5) and their distance do not. Processor time",
    "  excludes start-up, shutdown and idle-priority spinners; it is the difference of two runs and",
    "  scatters with many robots. Exponent 1: the time per tick is proportional to the robots",
    "  woken without work: as many processes, which the same barrier wakes at each tick",
];

/// Factor on the duration of a run, so that the cost of its ticks stands out from that of starting 256 processes.
const DURATION_FACTOR: f64 = 3.0;
/// Minimum number of ticks. With fewer ticks of 256 robots, the variation of the start-up time would exceed their cost.
const TICKS_MIN: u64 = 500;

/// Returns a case for each number of robots, in increasing order.
pub(crate) fn cases<'a>(
    settings: &'a BenchSettings<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<BenchCase<'a>>> {
    let mut robots = robots.to_vec();
    robots.sort_unstable();
    robots.dedup();
    let predecessors = std::iter::once(None).chain(robots.iter().copied().map(Some));
    let case = |(&robots, predecessor): (&usize, Option<usize>)| {
        let ticks = tick_count(robots, settings);
        let texts =
            [START_TICKS, ticks].map(|ticks| ring::ring_scenario_text(robots, ticks, PERIOD_S));
        let [short_scenario, full_scenario] =
            texts.each_ref().map(|text| ring::parse_scenario(text));
        let (short_scenario, full_scenario) = (short_scenario?, full_scenario?);
        Ok(BenchCase::new(format!("{robots} robots"), move |table| {
            let run_ring =
                |text| RunProcess::start(settings, text, Pace::Lockstep, &[])?.wait_for_summary();
            let (short_run, full_run) = (run_ring(&texts[0])?, run_ring(&texts[1])?);
            let parts_us =
                processor_time_per_tick_us(&short_run, &full_run)?.map(|us| us / robots as f64);
            let total_us: f64 = parts_us.iter().sum();
            let quantity = "processor time per robot and tick, us";
            table.record_run("ticks/s", full_run.number_at("/wall/ticks_per_s")?);
            table.record_run(quantity, total_us);
            for (name, us) in CPU_CONSUMERS.iter().zip(parts_us) {
                table.record_run(&format!("processor time of {name} per robot and tick, us"), us);
            }
            let per_robot_and_tick_us = |short_run_s: f64, full_run_s: f64| {
                1e6 * (full_run_s - short_run_s) / ((ticks - START_TICKS) * robots as u64) as f64
            };
            let mapping_s =
                |scenario| bare_lockstep::run(settings, scenario).map(|run| run.agents_cpu_s);
            let no_work_s = |ticks| bare_lockstep::run_without_work(settings, robots, ticks);
            let mapping_us =
                per_robot_and_tick_us(mapping_s(&short_scenario)?, mapping_s(&full_scenario)?);
            let no_work_us = per_robot_and_tick_us(no_work_s(START_TICKS)?, no_work_s(ticks)?);
            let robots_quantity = "processor time of robots per robot and tick, us";
            table.record_baseline(robots_quantity, MAPPING_BASELINE, mapping_us);
            table.record_baseline(robots_quantity, "woken without work", no_work_us);
            table.record_run("ready, s", full_run.number_at("/wall/startup_s")?);
            if let Some(fewer) = predecessor
                && let Some(fewer_us) = table.last_value(&format!("{fewer} robots, {quantity}"))
                && let Some(exponent) = growth_exponent((fewer, fewer_us), (robots, total_us))
            {
                table.record_run(&format!("exponent of the time per tick, from {fewer}"), exponent);
            }
            Ok(())
        }))
    };
    robots.iter().zip(predecessors).map(case).collect()
}

/// Returns the number of ticks of a run whose processor time per tick is measured.
pub(crate) fn tick_count(robots: usize, settings: &BenchSettings<'_>) -> u64 {
    lockstep::tick_count(robots, DURATION_FACTOR * settings.duration_s).max(TICKS_MIN)
}

/// Returns the exponent p of the growth of the processor time per tick, proportional to N^p for N robots. Takes the
/// number of robots and the time per robot and tick of two runs. `None` if a time is not positive, which happens when
/// a short run cannot be distinguished from its start-up.
fn growth_exponent((few, few_us): (usize, f64), (many, many_us): (usize, f64)) -> Option<f64> {
    let (few, many) = (few as f64, many as f64);
    let exponent =
        portable_math::ln(many * many_us / (few * few_us)) / portable_math::ln(many / few);
    Some(exponent).filter(|exponent| exponent.is_finite())
}

/// Returns the processor time per tick of each of [`CPU_CONSUMERS`], us, from the differences of the two runs in
/// processor time and in ticks.
pub(crate) fn processor_time_per_tick_us(
    short_run: &Summary,
    full_run: &Summary,
) -> anyhow::Result<[f64; CPU_CONSUMERS.len()]> {
    let ticks = full_run.number_at("/ticks")? - short_run.number_at("/ticks")?;
    let (short_run_s, full_run_s) = (short_run.cpu_time_s()?, full_run.cpu_time_s()?);
    Ok(std::array::from_fn(|consumer| 1e6 * (full_run_s[consumer] - short_run_s[consumer]) / ticks))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn per_tick_time_excludes_the_start_up() {
        let summary = |ticks: u64, user_s: f64| {
            let process = serde_json::json!({ "name": "plant", "user_s": user_s });
            Summary(serde_json::json!({ "ticks": ticks, "wall": { "processes": [process] } }))
        };
        let times_us =
            processor_time_per_tick_us(&summary(10, 0.125), &summary(260, 0.375)).unwrap();
        assert_eq!(times_us, [0.0, 1000.0, 0.0]);
    }

    #[test]
    fn exponent_of_linear_growth_is_1_and_of_pairs_is_2() {
        let is_close = |few, many, expected: f64| {
            (growth_exponent(few, many).unwrap() - expected).abs() < 1e-12
        };
        assert!(is_close((3, 7.0), (8, 7.0), 1.0));
        assert!(is_close((16, 7.0), (32, 14.0), 2.0));
        assert!(is_close((64, 8.0), (128, 4.0), 0.0));
        assert_eq!(growth_exponent((3, -1.0), (8, 7.0)), None);
    }
}
