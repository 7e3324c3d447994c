//! From the first process's start until everybody is ready: our agents and plant, against
//! processes of the same binary that read the same briefs and map one file.

use protocol::brief::Pace;

use crate::lockstep::PERIOD_S;
use crate::rounds::{Case, Setting};
use crate::run::Summary;
use crate::{bare_lockstep, ring};

/// As short a run as there may be.
const TICKS: u64 = 10;

/// A case for each number of robots.
pub(crate) fn cases<'a>(
    setting: &'a Setting<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<Case<'a>>> {
    let case = |&robots: &usize| {
        let text = ring::text(robots, TICKS, PERIOD_S);
        let scenario = ring::read(&text)?;
        Ok(Case::new(format!("{robots} robots"), move |table| {
            let summary = Summary::of(setting, &text, Pace::Lockstep, &[])?;
            table.run("ready, s", summary.number("/wall/startup_s")?);
            let bare = bare_lockstep::run(setting, &scenario)?;
            table.baseline("ready, s", "bare processes", bare.startup_s);
            Ok(())
        }))
    };
    robots.iter().map(case).collect()
}
