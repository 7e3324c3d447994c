//! How the cost of a tick grows with the number of robots: the ring in lockstep, larger and larger.
//!
//! From each run's processor time that of a run of the same ring is taken off that hardly moves:
//! the start of many processes is dear, and would be most of what few ticks seem to cost. Must
//! not: count those that keep cores awake. They take what nobody else wanted.

use protocol::brief::Pace;

use formation::portable_math;

use crate::lockstep::{self, PERIOD_S, TICKS_OF_A_START};
use crate::ring;
use crate::rounds::{Case, Setting};
use crate::run::{Run, Summary, TAKERS};

/// What grows, and how to read the rows.
pub(crate) const NOTES: [&str; 4] = [
    "growth: the robots of the ring grow in number, and with them processes, edges and samples;",
    "  not what a robot hears (the next four; all others of fewer than five), nor how near they are.",
    "  Processor time is without start and end, and without what keeps cores awake; a difference of",
    "  two runs, it scatters with many robots. Exponent 1: per tick it grows as the robots do",
];

/// A run whose cost is to be told from that of starting 256 processes takes this much longer.
const LONGER: f64 = 3.0;
/// Fewer ticks of 256 robots take less than what their start takes more or less from run to run.
const TICKS_MIN: u64 = 500;

/// A case for each number of robots, the smallest first.
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

/// The power of the number of robots by which the processor time per tick grows, from the times
/// per robot and tick. `None` where a time is not above 0: a short run takes nothing that can be told from
/// its start.
fn exponent((few, few_us): (usize, f64), (many, many_us): (usize, f64)) -> Option<f64> {
    let (few, many) = (few as f64, many as f64);
    let power = portable_math::ln(many * many_us / (few * few_us)) / portable_math::ln(many / few);
    Some(power).filter(|power| power.is_finite())
}

/// Processor time per tick by [`TAKERS`], us, of the ticks that the second run made beyond the
/// first.
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
