//! Real time at several sizes and rates, up to saturation: deadlines missed, commands that died at
//! the plant because none came after them, and how late the robots wake; against processes that
//! have the same timers and take as much of the processor, and do nothing.
//!
//! Where the latest robot is much later than the latest timer, the notes tell why: the causes that both
//! give, and who held the cores in one more run, with the scheduler traced where that is allowed.

use crate::child::{self, latest_wake_us, number};
use crate::quantiles::QUANTILES;
use crate::ring;
use crate::table::Row;
use crate::timers::{self, Task};
use crate::whose::{self, Causes};
use crate::{BenchError, Setting};

/// Rates of the robots, Hz.
const RATES_HZ: [u64; 2] = [100, 1000];
/// If the latest robot's quantile is more than this many times the latest timer's, it is told why.
const RATIO_MAX: f64 = 1.5;

/// Measures runs of `seconds` each. Also returns notes: whose lateness it is.
pub(crate) fn measure(
    setting: &Setting<'_>,
    robots: &[usize],
    seconds: f64,
) -> Result<(Vec<Row>, Vec<String>), BenchError> {
    let &Setting { root, stop, rounds, realtime_priority, .. } = setting;
    let cases: Vec<(usize, u64)> = RATES_HZ
        .iter()
        .flat_map(|&rate| robots.iter().map(move |&robots| (robots, rate)))
        .collect();
    let mut missed = vec![Vec::new(); cases.len()];
    let mut expired = vec![Vec::new(); cases.len()];
    let mut late_us = vec![QUANTILES.map(|_| Vec::new()); cases.len()];
    let mut timers_missed = vec![Vec::new(); cases.len()];
    let mut timers_late_us = vec![QUANTILES.map(|_| Vec::new()); cases.len()];
    let mut causes = vec![Causes::default(); cases.len()];
    for round in 1..=rounds {
        for (case, &(robots, rate_hz)) in cases.iter().enumerate() {
            let name = setting.realtime_case(robots, rate_hz);
            setting.progress(&format!("real time, {name}, round {round}"));
            let (ticks, text) = ring::lasting(robots, rate_hz, seconds);
            let summary = child::run_realtime(setting, &text, &[])?;
            let percent = |pointer| -> Result<f64, BenchError> {
                Ok(100.0 * number(&summary, pointer)? / (ticks * robots as u64) as f64)
            };
            missed[case].push(percent("/deadline_misses")?);
            expired[case].push(percent("/commands/expired")?);
            for ((key, ..), late_us) in QUANTILES.iter().zip(&mut late_us[case]) {
                let nobody = || BenchError::Wrong(format!("{robots} robots: nobody woke"));
                late_us.push(latest_wake_us(&summary, key).ok_or_else(nobody)?);
            }
            causes[case].add_run(&summary);
            setting.progress(&format!("real time, timers as busy as {name}, round {round}"));
            let (periods, period_ns) = ((ticks * robots as u64) as f64, 1_000_000_000 / rate_hz);
            let busy_ns = (1e9 * child::taken_s(&summary)?[0] / periods) as u64;
            let task = Task { period_ns, ticks, busy_ns, realtime_priority };
            let seen = timers::measure(root, stop, robots, task)?;
            seen.iter().for_each(|seen| causes[case].add_timer(&seen.causes));
            let missed = seen.iter().map(|seen| seen.missed).sum::<u64>() as f64;
            timers_missed[case].push(100.0 * missed / periods);
            for (place, late_us) in timers_late_us[case].iter_mut().enumerate() {
                late_us.push(seen.iter().map(|seen| seen.late_us[place]).fold(0.0, f64::max));
            }
        }
    }
    let (mut rows, mut notes) = (Vec::new(), Vec::new());
    let ours = missed.into_iter().zip(expired).zip(late_us);
    let timers = timers_missed.into_iter().zip(timers_late_us);
    for ((((robots, rate_hz), causes), ours), (timers_missed, timers_late_us)) in
        cases.into_iter().zip(causes).zip(ours).zip(timers)
    {
        let ((missed, expired), late_us) = ours;
        let name = setting.realtime_case(robots, rate_hz);
        let what = |of: &str| format!("{name}, {of}");
        let against = |of: &str, ours, timers| {
            Row::against("realtime", &what(of), "timers, as busy", ours, timers)
        };
        rows.push(against("deadlines missed, % of periods", missed, timers_missed));
        rows.push(Row::alone("realtime", &what("commands expired, % of periods"), expired));
        let mut much_later = Vec::new();
        for ((_, quantile, _), (ours, timers)) in
            QUANTILES.iter().zip(late_us.into_iter().zip(timers_late_us))
        {
            let row = against(&format!("wake lateness {quantile} of the latest, us"), ours, timers);
            much_later.extend(
                row.ratio_median()
                    .filter(|&ratio| ratio > RATIO_MAX)
                    .map(|ratio| format!("{quantile} {ratio:.1}")),
            );
            rows.push(row);
        }
        if !much_later.is_empty() {
            let case = format!("realtime: {name}");
            let ratios = much_later.join(", ");
            notes.push(format!(
                "{case}: the latest robot is later than the latest timer, {ratios} times"
            ));
            notes.extend(causes.words().map(|words| format!("{case}: {words}")));
            setting.progress(&format!("real time, {name}, traced, 1"));
            let (_, text) = ring::lasting(robots, rate_hz, seconds);
            let traced = whose::traced(setting, &text)?;
            notes.push(format!("{case}: {traced}"));
        }
    }
    Ok((rows, notes))
}
