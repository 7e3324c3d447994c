//! Real time at several sizes and rates, up to saturation: deadlines missed, commands that died at
//! the plant because none came after them, and how late the robots wake; against processes that
//! have the same timers and take as much of the processor, and do nothing.

use protocol::brief::Pace;
use serde_json::Value;

use crate::child::{self, number};
use crate::quantiles::QUANTILES;
use crate::ring;
use crate::table::Row;
use crate::timers::{self, Task};
use crate::{BenchError, Measured, Setting};

/// Rates of the robots, Hz.
const RATES_HZ: [u64; 2] = [100, 1000];

/// Measures runs of `seconds` each.
pub(crate) fn measure(setting: &Setting<'_>, robots: &[usize], seconds: f64) -> Measured {
    let &Setting { root, stop, rounds, .. } = setting;
    let cases: Vec<(usize, u64)> = RATES_HZ
        .iter()
        .flat_map(|&rate| robots.iter().map(move |&robots| (robots, rate)))
        .collect();
    let mut missed = vec![Vec::new(); cases.len()];
    let mut expired = vec![Vec::new(); cases.len()];
    let mut late_us = vec![QUANTILES.map(|_| Vec::new()); cases.len()];
    let mut timers_missed = vec![Vec::new(); cases.len()];
    let mut timers_late_us = vec![QUANTILES.map(|_| Vec::new()); cases.len()];
    for round in 1..=rounds {
        for (case, &(robots, rate_hz)) in cases.iter().enumerate() {
            setting.progress(&format!("real time, {robots} robots at {rate_hz} Hz, round {round}"));
            let ticks = ((seconds * rate_hz as f64) as u64).max(1);
            let text = ring::text(robots, ticks, 1.0 / rate_hz as f64);
            let summary = child::run(root, stop, &text, Pace::Realtime)?;
            let percent = |pointer| -> Result<f64, BenchError> {
                Ok(100.0 * number(&summary, pointer)? / (ticks * robots as u64) as f64)
            };
            missed[case].push(percent("/deadline_misses")?);
            expired[case].push(percent("/commands/expired")?);
            for ((key, ..), late_us) in QUANTILES.iter().zip(&mut late_us[case]) {
                let nobody = || BenchError::Wrong(format!("{robots} robots: nobody woke"));
                late_us.push(latest_wake_us(&summary, key).ok_or_else(nobody)?);
            }
            setting.progress(&format!("real time, {robots} timers at {rate_hz} Hz, round {round}"));
            let (periods, period_ns) = ((ticks * robots as u64) as f64, 1_000_000_000 / rate_hz);
            let busy_ns = (1e9 * child::taken_s(&summary)?[0] / periods) as u64;
            let seen = timers::measure(root, stop, robots, Task { period_ns, ticks, busy_ns })?;
            let missed = seen.iter().map(|seen| seen.missed).sum::<u64>() as f64;
            timers_missed[case].push(100.0 * missed / periods);
            for (place, late_us) in timers_late_us[case].iter_mut().enumerate() {
                late_us.push(seen.iter().map(|seen| seen.late_us[place]).fold(0.0, f64::max));
            }
        }
    }
    let mut rows = Vec::new();
    let ours = missed.into_iter().zip(expired).zip(late_us);
    let timers = timers_missed.into_iter().zip(timers_late_us);
    for (((robots, rate_hz), ours), (timers_missed, timers_late_us)) in
        cases.into_iter().zip(ours).zip(timers)
    {
        let ((missed, expired), late_us) = ours;
        let what = |of: &str| format!("{robots} robots at {rate_hz} Hz, {of}");
        let against = |of: &str, ours, timers| {
            Row::against("realtime", &what(of), "timers, as busy", ours, timers)
        };
        rows.push(against("deadlines missed, % of periods", missed, timers_missed));
        rows.push(Row::alone("realtime", &what("commands expired, % of periods"), expired));
        for ((_, name, _), (ours, timers)) in
            QUANTILES.iter().zip(late_us.into_iter().zip(timers_late_us))
        {
            rows.push(against(&format!("wake lateness {name} of the latest, us"), ours, timers));
        }
    }
    Ok(rows)
}

/// The largest of the robots' figures of this name of how late they woke, us; `None` where the
/// summary tells nothing of it.
pub(crate) fn latest_wake_us(summary: &Value, key: &str) -> Option<f64> {
    let stages = summary["wall"]["latency"].as_array()?;
    let robots = stages.iter().filter(|row| row["stage"] == "wake" && row["robot"] != "plant");
    robots.filter_map(|row| row[key].as_f64()).reduce(f64::max).map(|ns| ns / 1e3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_robot_counts_and_the_plant_does_not() {
        let row = |stage: &str, robot: &str, p50_ns: u64| serde_json::json!({ "stage": stage, "robot": robot, "p50_ns": p50_ns });
        let rows = [
            row("wake", "plant", 9000),
            row("wake", "r1", 1000),
            row("wake", "r2", 2500),
            row("compute", "r1", 8000),
        ];
        let summary = serde_json::json!({ "wall": { "latency": rows } });
        assert_eq!(latest_wake_us(&summary, "p50_ns"), Some(2.5));
        assert_eq!(latest_wake_us(&serde_json::json!({}), "p50_ns"), None);
    }
}
