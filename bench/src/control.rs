//! How late all robots of a run wake, against the bare timer of the same run: what this machine does to
//! anybody is in both. Where the scheduler may be traced, the notes tell who held the cores of the late.

use serde_json::Value;
use supervisor::scheduler;

use crate::child;
use crate::quantiles::QUANTILES;
use crate::ring;
use crate::table::Row;
use crate::{BenchError, Setting};

/// Robots, and their rate in Hz.
const CASES: [(usize, u64); 2] = [(8, 1000), (64, 100)];
/// Who held cores, at most so many of them.
const HOLDERS: usize = 6;

/// Measures runs of `seconds` each. Also returns notes: who held the cores.
pub(crate) fn measure(
    setting: &Setting<'_>,
    seconds: f64,
) -> Result<(Vec<Row>, Vec<String>), BenchError> {
    let (mut rows, mut notes) = (Vec::new(), Vec::new());
    let traced: &[&str] = match scheduler::available() {
        Ok(()) => &["--trace-scheduler"],
        Err(error) => {
            notes.push(format!("control: {error}"));
            &[]
        }
    };
    for (robots, rate_hz) in CASES {
        let case = setting.realtime_case(robots, rate_hz);
        let mut ours = QUANTILES.map(|_| Vec::new());
        let mut timer = QUANTILES.map(|_| Vec::new());
        for round in 1..=setting.rounds {
            setting.progress(&format!("control, {case}, round {round}"));
            let (_, text) = ring::lasting(robots, rate_hz, seconds);
            let summary = child::run_realtime(setting, &text, traced)?;
            let machine = machine(&summary)?;
            for (place, (key, ..)) in QUANTILES.iter().enumerate() {
                let us = |line: &Value| {
                    Ok::<_, BenchError>(child::number(line, &format!("/{key}"))? / 1e3)
                };
                ours[place].push(us(&summary["wall"]["wake_of_all"])?);
                timer[place].push(us(machine)?);
            }
            let held = held_by(&summary);
            notes.extend(held.map(|held| format!("control: {case}, round {round}: {held}")));
        }
        for ((_, name, _), (ours, timer)) in QUANTILES.iter().zip(ours.into_iter().zip(timer)) {
            let what = format!("{case}, wake lateness {name} of all, us");
            rows.push(Row::against("control", &what, "a bare timer in the same run", ours, timer));
        }
    }
    Ok((rows, notes))
}

/// The line of the control timer.
fn machine(summary: &Value) -> Result<&Value, BenchError> {
    let lines = summary["wall"]["latency"].as_array();
    let machine = lines.and_then(|lines| lines.iter().find(|line| line["stage"] == "machine"));
    machine.ok_or_else(|| BenchError::Wrong("a run without a control timer".into()))
}

/// Who held the cores of the late, in words.
pub(crate) fn held_by(summary: &Value) -> Option<String> {
    let trace = summary["wall"].get("scheduler")?;
    let holders = trace["held_by"].as_array()?.iter().take(HOLDERS);
    let holders = holders.map(|holder| {
        let held_ms = 1e3 * holder["held_s"].as_f64().unwrap_or_default();
        format!(
            "{} {} ({held_ms:.1} ms)",
            holder["who"].as_str().unwrap_or_default(),
            holder["late"]
        )
    });
    let holders: Vec<String> = holders.collect();
    Some(match holders.is_empty() {
        true => "nobody late".into(),
        false => format!("{} late, cores held by {}", trace["late"], holders.join(", ")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_held_cores_is_told_in_words_if_it_was_traced() {
        let holder = |who: &str, late: u64| serde_json::json!({ "who": who, "late": late, "held_s": 0.0123 });
        let trace = serde_json::json!({ "late": 5, "held_by": [holder("rustc", 4), holder("the plant", 1)] });
        let summary = serde_json::json!({ "wall": { "scheduler": trace } });
        let expected = "5 late, cores held by rustc 4 (12.3 ms), the plant 1 (12.3 ms)";
        assert_eq!(held_by(&summary).as_deref(), Some(expected));
        assert_eq!(held_by(&serde_json::json!({ "wall": {} })), None);
        let on_time = serde_json::json!({ "wall": { "scheduler": { "late": 0, "held_by": [] } } });
        assert_eq!(held_by(&on_time).as_deref(), Some("nobody late"));
        assert!(machine(&serde_json::json!({})).is_err());
    }
}
