//! Growth of the cost of a tick with the number of robots, for rings of increasing size in lockstep.
//!
//! The processor time of a very short run of the same ring is subtracted from that of each run: the start
//! of many processes is expensive, and would dominate the cost of few ticks. Must not include the processes
//! that keep cores awake, which use only idle time.

use protocol::brief::Pace;

use formation::portable_math;

use crate::lockstep::{self, PERIOD_S, TICKS_OF_A_START};
use crate::ring;
use crate::rounds::{Case, Setting};
use crate::run::{Run, Summary, TAKERS};

/// Notes for the reader of the rows.
pub(crate) const NOTES: [&str; 4] = [
    "growth: the number of robots in the ring increases, and with it that of processes, edges and samples;",
    "  the in-degree (four; all others with fewer than five robots) and the spacing stay constant.",
    "  Processor time excludes start, end and the processes that keep cores awake. As a difference of",
    "  two runs, it varies with many robots. Exponent 1: the time per tick is proportional to the number",
];

/// Factor by which these runs last longer, so that their cost can be distinguished from the start of 256 processes.
const LONGER: f64 = 3.0;
/// Minimum number of ticks. With 256 robots, fewer ticks cost less than the variation of their start.
const TICKS_MIN: u64 = 500;

/// Returns a case for each number of robots, in increasing order.
pub(crate) fn cases<'a>(setting: &'a Setting<'_>, robots: &[usize]) -> Vec<Case<'a>> {
    let mut robots = robots.to_vec();
    robots.sort_unstable();
    robots.dedup();
    let fewer = std::iter::once(None).chain(robots.iter().copied().map(Some));
    let case = |(&robots, fewer): (&usize, Option<usize>)| {
        let ticks = lockstep::ticks(robots, LONGER * setting.seconds).max(TICKS_MIN);
        Case::new(format!("{robots} robots"), move |table| {
            let run = |ticks| {
                let text = ring::text(robots, ticks, PERIOD_S);
                Run::start(setting, &text, Pace::Lockstep, &[])?.summary()
            };
            let (start, whole) = (run(TICKS_OF_A_START)?, run(ticks)?);
            let by_us = per_tick_us(&start, &whole)?.map(|us| us / robots as f64);
            let all_us: f64 = by_us.iter().sum();
            let what = "processor time per robot and tick, us";
            table.run("ticks/s", whole.number("/wall/ticks_per_s")?);
            table.run(what, all_us);
            for (name, us) in TAKERS.iter().zip(by_us) {
                table.run(&format!("of it {name}, us"), us);
            }
            table.run("ready, s", whole.number("/wall/startup_s")?);
            if let Some(few) = fewer
                && let Some(few_us) = table.last(&format!("{few} robots, {what}"))
                && let Some(power) = exponent((few, few_us), (robots, all_us))
            {
                table.run(&format!("exponent of the time per tick, from {few}"), power);
            }
            Ok(())
        })
    };
    robots.iter().zip(fewer).map(case).collect()
}

/// Returns the exponent with which the processor time per tick grows with the number of robots, from the
/// times per robot and tick. `None` if a time is not above 0, because a short run cannot be distinguished
/// from its start.
fn exponent((few, few_us): (usize, f64), (many, many_us): (usize, f64)) -> Option<f64> {
    let (few, many) = (few as f64, many as f64);
    let power = portable_math::ln(many * many_us / (few * few_us)) / portable_math::ln(many / few);
    Some(power).filter(|power| power.is_finite())
}

/// Returns the processor time per tick by [`TAKERS`], us, for the ticks that the second run has more than the first.
fn per_tick_us(start: &Summary, whole: &Summary) -> anyhow::Result<[f64; TAKERS.len()]> {
    let ticks = whole.number("/ticks")? - start.number("/ticks")?;
    let (start_s, whole_s) = (start.taken_s()?, whole.taken_s()?);
    Ok(std::array::from_fn(|taker| 1e6 * (whole_s[taker] - start_s[taker]) / ticks))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_start_does_not_count() {
        let summary = |ticks: u64, user_s: f64| {
            let process = serde_json::json!({ "name": "plant", "user_s": user_s });
            Summary(serde_json::json!({ "ticks": ticks, "wall": { "processes": [process] } }))
        };
        let taken = per_tick_us(&summary(10, 0.125), &summary(260, 0.375)).unwrap();
        assert_eq!(taken, [0.0, 1000.0, 0.0]);
    }

    #[test]
    fn robots_that_each_take_the_same_make_a_tick_grow_as_they_do_and_pairs_by_the_square() {
        let close = |few, many, wanted: f64| (exponent(few, many).unwrap() - wanted).abs() < 1e-12;
        assert!(close((3, 7.0), (8, 7.0), 1.0));
        assert!(close((16, 7.0), (32, 14.0), 2.0));
        assert!(close((64, 8.0), (128, 4.0), 0.0));
        assert_eq!(exponent((3, -1.0), (8, 7.0)), None);
    }
}
