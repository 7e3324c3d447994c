//! On how many of its cores a lockstep run is fastest: tried, for it depends on the machine.
//!
//! Of few robots on two cores everybody is woken from afar, which takes 2 us on one machine and 40 us on another;
//! on one core each waits for the other. A run begins on all cores that it was dealt; then half of them are tried
//! for a moment, and kept if they do better, and so on.

use std::time::Duration;

/// More robots than these on one core are never faster: nothing is tried.
const ROBOTS_PER_CORE_MAX: usize = 16;
/// How long ticks are counted; as long before that nobody counts, for all come from another core.
const COUNTED: Duration = Duration::from_millis(20);
/// With fewer ticks a count says little.
const TICKS_MIN: u64 = 50;
/// Fewer cores are kept if they do so much better.
const BETTER: f64 = 1.05;

/// The trial of one run.
#[derive(Debug)]
pub(super) struct Trial {
    robots: usize,
    cores: usize,
    /// The most ticks/s so far, and on how many cores: more than now.
    best: Option<(usize, f64)>,
    stage: Stage,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Stage {
    /// Everybody settles where it is now, since that time, with so many ticks done.
    Settling(Duration, u64),
    Counting(Duration, u64),
    Over,
}

impl Trial {
    /// Of so many robots, on so many cores at first.
    pub(super) fn new(robots: usize, cores: usize) -> Trial {
        Trial { robots, cores, best: None, stage: Stage::Settling(Duration::ZERO, 0) }
    }

    /// How many cores are used.
    pub(super) fn cores(&self) -> usize {
        self.cores
    }

    /// So much time has passed, and so many ticks have been done: another number of cores, if that follows.
    pub(super) fn passed(&mut self, time: Duration, ticks: u64) -> Option<usize> {
        let before = self.cores;
        match self.stage {
            Stage::Settling(since, _) if time < since + COUNTED => {}
            Stage::Settling(_, at) if ticks < at + TICKS_MIN => {}
            Stage::Settling(..) => self.stage = Stage::Counting(time, ticks),
            Stage::Counting(since, _) if time < since + COUNTED => {}
            Stage::Counting(_, from) if ticks < from + TICKS_MIN => {}
            Stage::Counting(since, from) => {
                let rate = (ticks - from) as f64 / (time - since).as_secs_f64();
                match self.best {
                    Some((more, best)) if rate < BETTER * best => {
                        (self.cores, self.stage) = (more, Stage::Over);
                    }
                    _ if self.may_be_fewer() => {
                        self.best = Some((self.cores, rate));
                        (self.cores, self.stage) = (self.cores / 2, Stage::Settling(time, ticks));
                    }
                    _ => self.stage = Stage::Over,
                }
            }
            Stage::Over => {}
        }
        (self.cores != before).then_some(self.cores)
    }

    /// Whether half as many cores are any, with not too many robots each.
    fn may_be_fewer(&self) -> bool {
        let half = self.cores / 2;
        half > 0 && self.robots <= half * ROBOTS_PER_CORE_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On how many cores it ends, and with how many it was each millisecond, where so many cores do so
    /// many ticks/s.
    fn tried(robots: usize, cores: usize, rate: fn(usize) -> f64) -> (usize, Vec<usize>) {
        let mut trial = Trial::new(robots, cores);
        let (mut ticks, mut was) = (0.0, Vec::new());
        for ms in 0..1_000 {
            trial.passed(Duration::from_millis(ms), ticks as u64);
            ticks += rate(trial.cores()) / 1e3;
            was.push(trial.cores());
        }
        (trial.cores(), was)
    }

    #[test]
    fn a_run_that_is_faster_on_fewer_cores_stays_there() {
        assert_eq!(tried(8, 2, |cores| if cores == 1 { 2e4 } else { 1.2e4 }).0, 1);
        assert_eq!(tried(32, 8, |cores| 4e4 / cores as f64).0, 2, "no more than 16 on one core");
        assert_eq!(tried(9, 3, |cores| 4e4 / cores as f64).0, 1);
    }

    #[test]
    fn a_run_that_is_slower_there_goes_back_and_tries_no_more() {
        let (cores, was) = tried(8, 2, |cores| 1e4 * cores as f64);
        assert_eq!(cores, 2);
        assert!((1..60).contains(&was.iter().filter(|&&cores| cores == 1).count()), "{was:?}");
        assert_eq!(tried(9, 3, |cores| 1e4 * cores as f64).0, 3);
        // Alike is not better.
        assert_eq!(tried(8, 2, |_| 1e4).0, 2);
        // Four are best.
        let four = |cores| if cores == 4 { 2e4 } else { 1e4 };
        assert_eq!(tried(32, 8, four).0, 4);
    }

    #[test]
    fn few_ticks_decide_nothing() {
        let (_, was) = tried(8, 2, |_| 60.0);
        assert!(was.iter().all(|&cores| cores == 2), "not 50 ticks counted yet");
        // Nor are many robots tried on fewer cores.
        assert_eq!(tried(64, 2, |_| 1e4).1, [2; 1_000]);
    }
}
