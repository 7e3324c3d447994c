//! How the cost of a tick grows with the number of robots: the ring in lockstep, larger and larger.
//!
//! From each run's processor time that of a run of the same ring is taken off that hardly moves:
//! the start of many processes is dear, and would be most of what few ticks seem to cost. Must
//! not: count those that keep cores awake. They take what nobody else wanted.

use protocol::brief::Pace;
use serde_json::Value;

use crate::child::{self, TAKERS, number, taken_s};
use crate::lockstep::{self, PERIOD_S};
use crate::ring;
use crate::table::Row;
use crate::{BenchError, Measured, Setting};

/// What grows, and how to read the rows.
pub(crate) const NOTES: [&str; 4] = [
    "growth: the robots of the ring grow in number, and with them processes, edges and samples;",
    "  not what a robot hears (the next four; all others of fewer than five), nor how near they are.",
    "  Processor time is without start and end, and without what keeps cores awake; a difference of",
    "  two runs, it scatters with many robots. Exponent 1: per tick it grows as the robots do",
];

/// Ticks of a run that hardly moves.
const TICKS_START: u64 = 10;
/// Fewer ticks of 256 robots take less than what their start takes more or less from run to run.
const TICKS_MIN: u64 = 500;

/// One size of the ring, round by round.
#[derive(Default)]
struct Size {
    robots: usize,
    ticks_per_s: Vec<f64>,
    ready_s: Vec<f64>,
    /// Of all, per robot and tick.
    all_us: Vec<f64>,
    /// The same by [`TAKERS`].
    by_us: [Vec<f64>; TAKERS.len()],
}

/// Measures in turns, each run for about `seconds` on a small and quiet machine.
pub(crate) fn measure(setting: &Setting<'_>, robots: &[usize], seconds: f64) -> Measured {
    let &Setting { root, stop, rounds, .. } = setting;
    let mut robots = robots.to_vec();
    robots.sort_unstable();
    robots.dedup();
    let sized = |robots| Size { robots, ..Size::default() };
    let mut sizes: Vec<Size> = robots.into_iter().map(sized).collect();
    for round in 1..=rounds {
        for size in &mut sizes {
            setting.progress(&format!("growth, {} robots, round {round}", size.robots));
            let ticks = lockstep::ticks(size.robots, seconds).max(TICKS_MIN);
            let run = |ticks| {
                let text = ring::text(size.robots, ticks, PERIOD_S);
                child::run(root, stop, &text, Pace::Lockstep)
            };
            let (start, whole) = (run(TICKS_START)?, run(ticks)?);
            let by_us = per_tick_us(&start, &whole)?.map(|us| us / size.robots as f64);
            size.ticks_per_s.push(number(&whole, "/wall/ticks_per_s")?);
            size.ready_s.push(number(&whole, "/wall/startup_s")?);
            size.all_us.push(by_us.iter().sum());
            for (rounds, us) in size.by_us.iter_mut().zip(by_us) {
                rounds.push(us);
            }
        }
    }
    Ok(rows(&sizes))
}

/// Figure by figure, so that each is seen to grow.
fn rows(sizes: &[Size]) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut row = |robots: &dyn std::fmt::Display, what: &str, figures: Vec<f64>| {
        rows.push(Row::alone("growth", &format!("{robots} robots, {what}"), figures));
    };
    for size in sizes {
        row(&size.robots, "ticks/s", size.ticks_per_s.clone());
    }
    for size in sizes {
        row(&size.robots, "processor time per robot and tick, us", size.all_us.clone());
    }
    for (taker, name) in TAKERS.iter().enumerate() {
        for size in sizes {
            row(&size.robots, &format!("of it {name}, us"), size.by_us[taker].clone());
        }
    }
    for size in sizes {
        row(&size.robots, "ready, s", size.ready_s.clone());
    }
    for pair in sizes.windows(2) {
        let [few, many] = pair else { continue };
        let exponents: Vec<f64> = (few.all_us.iter().zip(&many.all_us))
            .map(|(&few_us, &many_us)| exponent((few.robots, few_us), (many.robots, many_us)))
            .filter(|exponent| exponent.is_finite())
            .collect();
        // A round may have none: a short run takes nothing that can be told from its start.
        if !exponents.is_empty() {
            let what = "exponent of the processor time per tick";
            row(&format!("{} to {}", few.robots, many.robots), what, exponents);
        }
    }
    rows
}

/// The power of the number of robots by which the processor time per tick grows, from the times
/// per robot and tick; not finite unless both are above 0.
fn exponent((few, few_us): (usize, f64), (many, many_us): (usize, f64)) -> f64 {
    let (few, many) = (few as f64, many as f64);
    (many * many_us / (few * few_us)).ln() / (many / few).ln()
}

/// Processor time per tick by [`TAKERS`], us, of the ticks that the second run made beyond the
/// first.
fn per_tick_us(start: &Value, whole: &Value) -> Result<[f64; TAKERS.len()], BenchError> {
    let ticks = number(whole, "/ticks")? - number(start, "/ticks")?;
    let (start_s, whole_s) = (taken_s(start)?, taken_s(whole)?);
    Ok(std::array::from_fn(|taker| 1e6 * (whole_s[taker] - start_s[taker]) / ticks))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(ticks: u64, processes: &[(&str, f64, f64)]) -> Value {
        let process = |&(name, user_s, system_s): &(&str, f64, f64)| serde_json::json!({ "name": name, "user_s": user_s, "system_s": system_s });
        let processes: Vec<Value> = processes.iter().map(process).collect();
        serde_json::json!({ "ticks": ticks, "wall": { "processes": processes } })
    }

    #[test]
    fn robots_count_together_their_start_and_those_that_keep_cores_awake_do_not() {
        let start = [
            ("supervisor", 0.5, 0.25),
            ("plant", 0.125, 0.0),
            ("r1", 0.25, 0.0),
            ("r2", 0.25, 0.0),
            ("awake", 8.0, 0.0),
        ];
        let whole = [
            ("supervisor", 0.75, 0.5),
            ("plant", 0.125, 0.25),
            ("r1", 0.5, 0.5),
            ("r2", 0.25, 0.25),
            ("awake", 64.0, 8.0),
        ];
        let taken = per_tick_us(&summary(10, &start), &summary(260, &whole)).unwrap();
        assert_eq!(taken, [4000.0, 1000.0, 2000.0]);
        assert!(per_tick_us(&summary(10, &start), &serde_json::json!({ "ticks": 260 })).is_err());
    }

    #[test]
    fn robots_that_each_take_the_same_make_a_tick_grow_as_they_do_and_pairs_by_the_square() {
        let close = |exponent: f64, wanted: f64| (exponent - wanted).abs() < 1e-12;
        assert!(close(exponent((3, 7.0), (8, 7.0)), 1.0));
        assert!(close(exponent((16, 7.0), (32, 14.0)), 2.0));
        assert!(close(exponent((64, 8.0), (128, 4.0)), 0.0));
        assert!(!exponent((3, -1.0), (8, 7.0)).is_finite());
    }
}
