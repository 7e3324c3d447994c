//! Search for the number of cores on which a lockstep run is fastest, which depends on the machine.
//!
//! With few robots on two cores, each wake-up crosses cores, which takes 2 us on one machine and 40 us on
//! another; on one core, robots wait for each other. A run begins on all its cores. Then half of them are
//! tried for a short time and kept if they are faster, and so on.

use std::time::Duration;

/// Maximum number of robots per core for which fewer cores are tried; more robots on one core are never faster.
const ROBOTS_PER_CORE_MAX: usize = 16;
/// Duration for which ticks are counted, after an equal time for settling on the new cores.
const COUNTING_TIME: Duration = Duration::from_millis(20);
/// Minimum number of ticks for a meaningful count.
const TICKS_MIN: u64 = 50;
/// Minimum speedup for which fewer cores are kept.
const SPEEDUP_MIN: f64 = 1.05;

/// Search state of one run.
#[derive(Debug)]
pub(super) struct CoreCountTuner {
    robots: usize,
    cores: usize,
    /// Highest measured rate, ticks/s, and its number of cores, which is larger than the current one.
    best_rate: Option<(usize, f64)>,
    stage: SearchStage,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum SearchStage {
    /// Processes settle on their cores: time and number of ticks at which this began.
    Settling(Duration, u64),
    Counting(Duration, u64),
    Finished,
}

impl CoreCountTuner {
    /// Creates the search for `robots` robots that start on `cores` cores.
    pub(super) fn new(robots: usize, cores: usize) -> CoreCountTuner {
        CoreCountTuner {
            robots,
            cores,
            best_rate: None,
            stage: SearchStage::Settling(Duration::ZERO, 0),
        }
    }

    /// Returns the current number of cores.
    pub(super) fn cores(&self) -> usize {
        self.cores
    }

    /// Advances the search to `time`, at which `ticks` ticks have been done. Returns the new number of
    /// cores if it changes.
    pub(super) fn advance_search(&mut self, time: Duration, ticks: u64) -> Option<usize> {
        let previous_cores = self.cores;
        match self.stage {
            SearchStage::Settling(start, _) if time < start + COUNTING_TIME => {}
            SearchStage::Settling(_, start_ticks) if ticks < start_ticks + TICKS_MIN => {}
            SearchStage::Settling(..) => self.stage = SearchStage::Counting(time, ticks),
            SearchStage::Counting(start, _) if time < start + COUNTING_TIME => {}
            SearchStage::Counting(_, start_ticks) if ticks < start_ticks + TICKS_MIN => {}
            SearchStage::Counting(start, start_ticks) => {
                let rate = (ticks - start_ticks) as f64 / (time - start).as_secs_f64();
                match self.best_rate {
                    Some((more_cores, best_rate)) if rate < SPEEDUP_MIN * best_rate => {
                        (self.cores, self.stage) = (more_cores, SearchStage::Finished);
                    }
                    _ if self.can_halve_cores() => {
                        self.best_rate = Some((self.cores, rate));
                        (self.cores, self.stage) =
                            (self.cores / 2, SearchStage::Settling(time, ticks));
                    }
                    _ => self.stage = SearchStage::Finished,
                }
            }
            SearchStage::Finished => {}
        }
        (self.cores != previous_cores).then_some(self.cores)
    }

    /// Returns whether half as many cores may be tried, by the number of robots on each.
    fn can_halve_cores(&self) -> bool {
        let half = self.cores / 2;
        half > 0 && self.robots <= half * ROBOTS_PER_CORE_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the final number of cores, and the number in each millisecond, if n cores do `rate(n)` ticks/s.
    fn run_tuner(robots: usize, cores: usize, rate: fn(usize) -> f64) -> (usize, Vec<usize>) {
        let mut tuner = CoreCountTuner::new(robots, cores);
        let (mut ticks, mut history) = (0.0, Vec::new());
        for ms in 0..1_000 {
            tuner.advance_search(Duration::from_millis(ms), ticks as u64);
            ticks += rate(tuner.cores()) / 1e3;
            history.push(tuner.cores());
        }
        (tuner.cores(), history)
    }

    #[test]
    fn tuner_stays_on_fewer_cores_if_faster() {
        assert_eq!(run_tuner(8, 2, |cores| if cores == 1 { 2e4 } else { 1.2e4 }).0, 1);
        assert_eq!(
            run_tuner(32, 8, |cores| 4e4 / cores as f64).0,
            2,
            "no more than 16 on one core"
        );
        assert_eq!(run_tuner(9, 3, |cores| 4e4 / cores as f64).0, 1);
    }

    #[test]
    fn tuner_returns_to_all_cores_if_slower() {
        let (cores, history) = run_tuner(8, 2, |cores| 1e4 * cores as f64);
        assert_eq!(cores, 2);
        assert!(
            (1..60).contains(&history.iter().filter(|&&cores| cores == 1).count()),
            "{history:?}"
        );
        assert_eq!(run_tuner(9, 3, |cores| 1e4 * cores as f64).0, 3);
        // Equal rates do not favor fewer cores.
        assert_eq!(run_tuner(8, 2, |_| 1e4).0, 2);
        // Four cores are fastest.
        let rate = |cores| if cores == 4 { 2e4 } else { 1e4 };
        assert_eq!(run_tuner(32, 8, rate).0, 4);
    }

    #[test]
    fn few_ticks_decide_nothing() {
        let (_, history) = run_tuner(8, 2, |_| 60.0);
        assert!(history.iter().all(|&cores| cores == 2), "not 50 ticks counted yet");
        // Fewer cores are not tried for many robots.
        assert_eq!(run_tuner(64, 2, |_| 1e4).1, [2; 1_000]);
    }
}
