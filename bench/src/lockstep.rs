//! Ticks per second in lockstep: `phalanx run`, against the same brains and world without
//! iceoryx2, all of which must move the robots along one trajectory, bit by bit; and against itself with nothing
//! measured or recorded.

use protocol::brief::Pace;

use crate::child::{self, Running, number};
use crate::floor::{self, Carrier};
use crate::ring;
use crate::table::{Row, Trajectory};
use crate::{BenchError, Setting};

/// T, s. Simulated.
pub(crate) const PERIOD_S: f64 = 0.005;
/// Robots times ticks that a small machine computes in about a second.
const ROBOT_TICKS_PER_S: f64 = 80_000.0;
/// Fewer ticks than this measure the start.
const TICKS_MIN: u64 = 50;

/// As many ticks as so many robots take in about `seconds` on a small and quiet machine.
pub(crate) fn ticks(robots: usize, seconds: f64) -> u64 {
    ((seconds * ROBOT_TICKS_PER_S / robots as f64) as u64).max(TICKS_MIN)
}

/// Measures in turns, each for about `seconds` on a small and quiet machine.
pub(crate) fn measure(
    setting: &Setting<'_>,
    robots: &[usize],
    seconds: f64,
) -> Result<(Vec<Row>, Vec<Trajectory>), BenchError> {
    let &Setting { root, stop, rounds, .. } = setting;
    let mut rows = Vec::new();
    let mut trajectories = Vec::new();
    for &robots in robots {
        let ticks = ticks(robots, seconds);
        let text = ring::text(robots, ticks, PERIOD_S);
        let scenario = ring::read(&text)?;
        let mut ours = Vec::new();
        let mut floors = Carrier::ALL.map(|_| Vec::new());
        let mut unmeasured = Vec::new();
        let mut hashes: Vec<(String, String)> = Vec::new();
        let mut hashed_by = |means: &str, hash: String| {
            let hashed = (means.to_owned(), hash);
            if !hashes.contains(&hashed) {
                hashes.push(hashed);
            }
        };
        for round in 1..=rounds {
            setting.progress(&format!("lockstep, {robots} robots, ours, round {round}"));
            let summary = child::run(root, stop, &text, Pace::Lockstep)?;
            ours.push(number(&summary, "/wall/ticks_per_s")?);
            hashed_by("phalanx run", summary["trajectory_hash"].as_str().unwrap_or("none").into());
            for (carrier, floor) in Carrier::ALL.into_iter().zip(&mut floors) {
                let name = carrier.name();
                setting.progress(&format!("lockstep, {robots} robots, {name}, round {round}"));
                let floor_run = floor::run(root, stop, &scenario, carrier)?;
                floor.push(floor_run.ticks_per_s);
                hashed_by(name, floor_run.hash);
            }
            setting.progress(&format!("lockstep, {robots} robots, ours unmeasured, round {round}"));
            let running =
                Running::start_with(root, stop, &text, Pace::Lockstep, &["--unmeasured"])?;
            unmeasured.push(number(&running.summary()?, "/wall/ticks_per_s")?);
        }
        let floors = Carrier::ALL.map(Carrier::name).into_iter().zip(floors);
        for (name, floor) in floors.chain([("ours, not measured or recorded", unmeasured)]) {
            let what = format!("{robots} robots, ticks/s");
            rows.push(Row::against("lockstep", &what, name, ours.clone(), floor));
        }
        trajectories.push(Trajectory { robots, ticks, hashes });
    }
    Ok((rows, trajectories))
}
