//! Real time at several sizes and rates, up to saturation: deadlines missed, and commands that
//! died at the plant because none came after them.

use protocol::brief::Pace;
use protocol::process::Stop;
use protocol::run_root::RunRoot;

use crate::BenchError;
use crate::flown::{self, number};
use crate::ring;
use crate::table::Row;

/// Rates of the robots, Hz.
const RATES_HZ: [u64; 2] = [100, 1000];

/// Measures runs of `seconds` each.
pub(crate) fn measure(
    root: &RunRoot,
    stop: &Stop,
    robots: &[usize],
    rounds: usize,
    seconds: f64,
    mut progress: impl FnMut(&str),
) -> Result<Vec<Row>, BenchError> {
    let cases: Vec<(usize, u64)> = RATES_HZ
        .iter()
        .flat_map(|&rate| robots.iter().map(move |&robots| (robots, rate)))
        .collect();
    let mut missed = vec![Vec::new(); cases.len()];
    let mut expired = vec![Vec::new(); cases.len()];
    for round in 1..=rounds {
        for (case, &(robots, rate_hz)) in cases.iter().enumerate() {
            progress(&format!("real time, {robots} robots at {rate_hz} Hz, round {round}"));
            let ticks = ((seconds * rate_hz as f64) as u64).max(1);
            let text = ring::text(robots, ticks, 1.0 / rate_hz as f64);
            let summary = flown::fly(root, stop, &text, Pace::Realtime)?;
            let percent = |pointer| -> Result<f64, BenchError> {
                Ok(100.0 * number(&summary, pointer)? / (ticks * robots as u64) as f64)
            };
            missed[case].push(percent("/deadline_misses")?);
            expired[case].push(percent("/commands/expired")?);
        }
    }
    let mut rows = Vec::new();
    for ((robots, rate_hz), (missed, expired)) in
        cases.into_iter().zip(missed.into_iter().zip(expired))
    {
        let what = |of: &str| format!("{robots} robots at {rate_hz} Hz, {of}, % of periods");
        rows.push(Row::alone("realtime", &what("deadlines missed"), missed));
        rows.push(Row::alone("realtime", &what("commands expired"), expired));
    }
    Ok(rows)
}
