//! `[chaos]`: kills and freezes at random times, drawn from the scenario's seed.
//!
//! The same seed draws the same faults. They are ordinary faults from then on: planned, exact to
//! the tick in lockstep, reported one by one.

use formation::random::draw;

use super::diagnostic::Diagnostic;
use super::lives::Lives;
use super::table::Value;
use super::{Fault, FaultKind, seconds};

/// More faults than this are a slip of the keyboard.
const FAULTS_MAX: usize = 10_000;

/// How often what happens.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chaos {
    /// Mean time from one kill to the next, s.
    between_kills_s: Option<f64>,
    /// A killed robot's replacement comes this long after, ns.
    restart_after_ns: u64,
    /// Mean time from one freeze to the next, s.
    between_freezes_s: Option<f64>,
    /// Mean length of a freeze, s.
    freeze_s: f64,
    /// Nothing happens before, ns.
    from_ns: u64,
    /// Nothing begins from here on, ns.
    until_ns: u64,
}

impl Chaos {
    /// Reads the table.
    pub(super) fn read(value: &Value<'_>, duration_ns: u64) -> Result<Chaos, Diagnostic> {
        let table = value.table()?;
        let until_ns = table.get("until_s").map_or(Ok(duration_ns), |until| until.time_ns())?;
        let chaos = Chaos {
            between_kills_s: table.maybe_number("mean_time_between_kills_s")?,
            restart_after_ns: table.time_ns("restart_after_s")?,
            between_freezes_s: table.maybe_number("mean_time_between_freezes_s")?,
            freeze_s: table.number("mean_freeze_s")?,
            from_ns: table.time_ns("from_s")?,
            until_ns: until_ns.min(duration_ns),
        };
        if chaos.between_kills_s.is_none() && chaos.between_freezes_s.is_none() {
            return Err(table.need("mean_time_between_kills_s").expect_err("it is not given"));
        }
        let span_s = seconds(chaos.until_ns.saturating_sub(chaos.from_ns));
        let often = |mean_s: Option<f64>| mean_s.map_or(0.0, |mean_s| span_s / mean_s);
        let expected = often(chaos.between_kills_s) + often(chaos.between_freezes_s);
        if expected > FAULTS_MAX as f64 {
            return Err(value.wrong(
                format!("draws about {expected:.0} faults"),
                format!("expected longer mean times: at most {FAULTS_MAX} faults"),
            ));
        }
        Ok(chaos)
    }

    /// The faults that the seed draws, each at a robot that is up at that time.
    pub(super) fn draw(&self, seed: u64, lives: &mut Lives) -> Vec<Fault> {
        let mut dice = Dice { seed: seed ^ u64::from_le_bytes(*b"in chaos"), drawn: 0 };
        let mut times = Vec::new();
        for (mean_s, freezes) in [(self.between_kills_s, false), (self.between_freezes_s, true)] {
            let Some(mean_s) = mean_s else { continue };
            let mut at_ns = self.from_ns;
            loop {
                at_ns = at_ns.saturating_add(dice.exponential_ns(mean_s));
                if at_ns >= self.until_ns {
                    break;
                }
                times.push((at_ns, freezes));
            }
        }
        times.sort_unstable();
        times.truncate(2 * FAULTS_MAX);
        let mut faults = Vec::new();
        for (at_ns, freezes) in times {
            let up = lives.up(at_ns);
            if up.is_empty() {
                continue;
            }
            let robot = up[(dice.next() * up.len() as f64) as usize];
            let fault = if freezes {
                // No shorter than a nanosecond: a fault without length would not be one.
                let for_ns = Some(dice.exponential_ns(self.freeze_s).max(1));
                Fault { at_ns, for_ns, kind: FaultKind::Freeze { robot } }
            } else {
                let restart_after_ns = Some(self.restart_after_ns);
                Fault { at_ns, for_ns: None, kind: FaultKind::Kill { robot, restart_after_ns } }
            };
            // Those planned later in the file may be in the way; then nothing happens.
            if lives.take(&fault).is_ok() {
                faults.push(fault);
            }
        }
        faults
    }
}

/// One draw after the other.
struct Dice {
    seed: u64,
    drawn: u64,
}

impl Dice {
    fn next(&mut self) -> f64 {
        self.drawn += 1;
        draw(self.seed, self.drawn)
    }

    /// A time until something that happens every `mean_s` on average, ns.
    fn exponential_ns(&mut self, mean_s: f64) -> u64 {
        let draw = self.next();
        (-(1.0 - draw).ln() * mean_s * 1e9) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chaos() -> Chaos {
        Chaos {
            between_kills_s: Some(0.5),
            restart_after_ns: 300_000_000,
            between_freezes_s: Some(1.0),
            freeze_s: 0.4,
            from_ns: 2_000_000_000,
            until_ns: 102_000_000_000,
        }
    }

    fn drawn(seed: u64) -> Vec<Fault> {
        chaos().draw(seed, &mut Lives::new(3))
    }

    #[test]
    fn the_same_seed_draws_the_same_faults_and_another_one_others() {
        assert_eq!(drawn(1), drawn(1));
        assert_ne!(drawn(1), drawn(2));
    }

    #[test]
    fn faults_come_as_often_as_asked_for_within_their_time_and_at_robots_that_are_up() {
        for seed in 0..20 {
            let faults = drawn(seed);
            let kills = faults.iter().filter(|f| matches!(f.kind, FaultKind::Kill { .. })).count();
            let freezes = faults.len() - kills;
            // 200 and 100 are due; few find nobody who is up.
            assert!((140..240).contains(&kills), "seed {seed}: {kills} kills");
            assert!((60..135).contains(&freezes), "seed {seed}: {freezes} freezes");
            let within = |fault: &Fault| (2_000_000_000..102_000_000_000).contains(&fault.at_ns);
            assert!(faults.is_sorted_by_key(|fault| fault.at_ns) && faults.iter().all(within));
            let mut lives = Lives::new(3);
            for fault in &faults {
                assert_eq!(lives.take(fault), Ok(()), "seed {seed}: {fault:?}");
            }
        }
    }
}
