//! From the first process's start until everybody is ready: our agents and plant, against
//! processes of the same binary that read the same briefs and map one file.

use protocol::brief::Pace;

use crate::child::{self, number};
use crate::floor::{self, Carrier};
use crate::ring;
use crate::table::Row;
use crate::{Measured, Setting};

/// T, s.
const PERIOD_S: f64 = 0.005;
/// As short a run as there may be.
const TICKS: u64 = 10;

/// Measures in turns.
pub(crate) fn measure(setting: &Setting<'_>, robots: &[usize]) -> Measured {
    let &Setting { root, stop, rounds, .. } = setting;
    let mut rows = Vec::new();
    for &robots in robots {
        let text = ring::text(robots, TICKS, PERIOD_S);
        let scenario = ring::read(&text)?;
        let (mut ours, mut floor) = (Vec::new(), Vec::new());
        for round in 1..=rounds {
            setting.progress(&format!("start-up, {robots} robots, round {round}"));
            let summary = child::run(root, stop, &text, Pace::Lockstep)?;
            ours.push(number(&summary, "/wall/startup_s")?);
            floor.push(floor::run(root, stop, &scenario, Carrier::Mapping)?.startup_s);
        }
        let what = format!("{robots} robots ready, s");
        rows.push(Row::against("startup", &what, "bare processes", ours, floor));
    }
    Ok(rows)
}
