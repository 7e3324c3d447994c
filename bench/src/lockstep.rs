//! Ticks per second and start-up time in lockstep.
//!
//! The speed of `phalanx run` is compared with the same controllers and plant without iceoryx2, which must produce the
//! same trajectory bit by bit, and with a run that neither measures nor records. The start-up time is compared with
//! processes of the same binary that read the same briefs and map one file.

use protocol::brief::Pace;

use crate::rounds::{BenchCase, BenchSettings};
use crate::run::RunProcess;
use crate::{bare_lockstep, ring};

/// Control period (T) in simulated time, s.
pub(crate) const PERIOD_S: f64 = 0.005;
/// Number of robots times ticks that a small machine computes in about one second.
const ROBOT_TICKS_PER_S: f64 = 80_000.0;
/// Minimum number of ticks. With fewer ticks the start-up would dominate the measurement.
const TICKS_MIN: u64 = 50;

/// Number of ticks of a run that measures the start-up only.
pub(crate) const START_TICKS: u64 = 10;
/// Name of the baseline without iceoryx2.
pub(crate) const MAPPING_BASELINE: &str = "mapping + futex";

/// Returns the number of ticks that a small idle machine computes for `robots` in about `seconds`; at least
/// [`TICKS_MIN`].
pub(crate) fn tick_count(robots: usize, seconds: f64) -> u64 {
    ((seconds * ROBOT_TICKS_PER_S / robots as f64) as u64).max(TICKS_MIN)
}

/// Returns a case for each number of robots that measures ticks per second.
pub(crate) fn speed_cases<'a>(
    settings: &'a BenchSettings<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<BenchCase<'a>>> {
    let case = |&robots: &usize| {
        let ticks = tick_count(robots, settings.duration_s);
        let text = ring::ring_scenario_text(robots, ticks, PERIOD_S);
        let scenario = ring::parse_scenario(&text)?;
        Ok(BenchCase::new(format!("{robots} robots"), move |table| {
            let quantity = "ticks/s";
            let summary =
                RunProcess::start(settings, &text, Pace::Lockstep, &[])?.wait_for_summary()?;
            table.record_run(quantity, summary.number_at("/wall/ticks_per_s")?);
            let hash = summary.0["trajectory_hash"].as_str().unwrap_or("none");
            table.record_trajectory(robots, ticks, "phalanx run", hash);
            let bare = bare_lockstep::run(settings, &scenario)?;
            table.record_baseline(quantity, MAPPING_BASELINE, bare.ticks_per_s);
            table.record_trajectory(robots, ticks, MAPPING_BASELINE, &bare.hash);
            let unmeasured = RunProcess::start(settings, &text, Pace::Lockstep, &["--unmeasured"])?
                .wait_for_summary()?;
            let ticks_per_s = unmeasured.number_at("/wall/ticks_per_s")?;
            table.record_baseline(quantity, "Phalanx, no metrics or recording", ticks_per_s);
            Ok(())
        }))
    };
    robots.iter().map(case).collect()
}

/// Returns a case for each number of robots that measures the start-up time.
pub(crate) fn startup_cases<'a>(
    settings: &'a BenchSettings<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<BenchCase<'a>>> {
    let case = |&robots: &usize| {
        let text = ring::ring_scenario_text(robots, START_TICKS, PERIOD_S);
        let scenario = ring::parse_scenario(&text)?;
        Ok(BenchCase::new(format!("{robots} robots"), move |table| {
            let summary =
                RunProcess::start(settings, &text, Pace::Lockstep, &[])?.wait_for_summary()?;
            table.record_run("ready, s", summary.number_at("/wall/startup_s")?);
            let bare = bare_lockstep::run(settings, &scenario)?;
            table.record_baseline("ready, s", "bare processes", bare.startup_s);
            Ok(())
        }))
    };
    robots.iter().map(case).collect()
}
