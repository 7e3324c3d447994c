//! Ticks per second in lockstep: `phalanx run` compared with the same controllers and plant without
//! iceoryx2, which must give the same trajectory bit by bit; and with itself without measuring and
//! recording. Also the start-up time, compared with processes of the same binary that read the same briefs
//! and map one file.

use protocol::brief::Pace;

use crate::rounds::{Case, Setting};
use crate::run::Run;
use crate::{bare_lockstep, ring};

/// Period (T), s, of simulated time.
pub(crate) const PERIOD_S: f64 = 0.005;
/// Number of robots times ticks that a small machine computes in about one second.
const ROBOT_TICKS_PER_S: f64 = 80_000.0;
/// Minimum number of ticks; fewer would mostly measure the start.
const TICKS_MIN: u64 = 50;

/// Number of ticks of a run that measures mostly the start.
pub(crate) const TICKS_OF_A_START: u64 = 10;
/// Name of the baseline without iceoryx2.
const MAPPING: &str = "mapping + futex";

/// Returns the number of ticks that this many robots compute in about `seconds` on a small idle machine.
pub(crate) fn ticks(robots: usize, seconds: f64) -> u64 {
    ((seconds * ROBOT_TICKS_PER_S / robots as f64) as u64).max(TICKS_MIN)
}

/// Returns a case for each number of robots: ticks per second.
pub(crate) fn speed<'a>(
    setting: &'a Setting<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<Case<'a>>> {
    let case = |&robots: &usize| {
        let ticks = ticks(robots, setting.seconds);
        let text = ring::text(robots, ticks, PERIOD_S);
        let scenario = ring::read(&text)?;
        Ok(Case::new(format!("{robots} robots"), move |table| {
            let what = "ticks/s";
            let summary = Run::start(setting, &text, Pace::Lockstep, &[])?.summary()?;
            table.run(what, summary.number("/wall/ticks_per_s")?);
            let hash = summary.0["trajectory_hash"].as_str().unwrap_or("none");
            table.trajectory(robots, ticks, "phalanx run", hash);
            let bare = bare_lockstep::run(setting, &scenario)?;
            table.baseline(what, MAPPING, bare.ticks_per_s);
            table.trajectory(robots, ticks, MAPPING, &bare.hash);
            let unmeasured =
                Run::start(setting, &text, Pace::Lockstep, &["--unmeasured"])?.summary()?;
            let ticks_per_s = unmeasured.number("/wall/ticks_per_s")?;
            table.baseline(what, "ours, not measured or recorded", ticks_per_s);
            Ok(())
        }))
    };
    robots.iter().map(case).collect()
}

/// Returns a case for each number of robots: start-up time.
pub(crate) fn startup<'a>(
    setting: &'a Setting<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<Case<'a>>> {
    let case = |&robots: &usize| {
        let text = ring::text(robots, TICKS_OF_A_START, PERIOD_S);
        let scenario = ring::read(&text)?;
        Ok(Case::new(format!("{robots} robots"), move |table| {
            let summary = Run::start(setting, &text, Pace::Lockstep, &[])?.summary()?;
            table.run("ready, s", summary.number("/wall/startup_s")?);
            let bare = bare_lockstep::run(setting, &scenario)?;
            table.baseline("ready, s", "bare processes", bare.startup_s);
            Ok(())
        }))
    };
    robots.iter().map(case).collect()
}
