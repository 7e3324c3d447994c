//! Signals that control laws recorded, and the metrics of the experiment's own that follow from them.

use std::collections::VecDeque;

use experiment::scenario::{Metric, OverRobots, OverTime, Scenario};
use protocol::signals::SignalValues;

/// Newest value of one signal of one robot: run time of the sample, ns, and value; `None` before the first one.
pub type Newest = Option<(u64, f64)>;

/// Signals of all robots.
pub(super) struct Signals {
    metrics: Vec<Metric>,
    /// Names of the signals of each robot.
    names: Vec<&'static [&'static str]>,
    /// Index of the first signal of each robot in the lists of all signals.
    first: Vec<usize>,
    /// Values of each robot that later ground-truth samples will count, with the run time of their samples, ns.
    waiting: Vec<VecDeque<(u64, SignalValues)>>,
    newest: Vec<Newest>,
    sums: Vec<Sums>,
}

/// Reductions of the values of one signal of one robot.
#[derive(Debug, Clone, Copy)]
struct Sums {
    count: u64,
    sum: f64,
    min: f64,
    max: f64,
}

impl Sums {
    const NONE: Sums = Sums { count: 0, sum: 0.0, min: f64::INFINITY, max: f64::NEG_INFINITY };

    fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
        self.min = self.min.min(value);
        self.max = self.max.max(value);
    }
}

impl Signals {
    /// Creates the state without any value.
    pub(super) fn new(scenario: &Scenario) -> Signals {
        let names: Vec<&'static [&'static str]> =
            scenario.robots.iter().map(|robot| robot.signals).collect();
        let (mut count, mut first) = (0, Vec::with_capacity(names.len()));
        for own in &names {
            first.push(count);
            count += own.len();
        }
        Signals {
            metrics: scenario.metrics.clone(),
            waiting: vec![VecDeque::new(); names.len()],
            names,
            first,
            newest: vec![None; count],
            sums: vec![Sums::NONE; count],
        }
    }

    /// Adds the values that a robot recorded at its sample of run time `t_ns`, ns.
    pub(super) fn add(&mut self, robot: usize, t_ns: u64, values: SignalValues) {
        if !values.is_empty() {
            self.waiting[robot].push_back((t_ns, values));
        }
    }

    /// Counts all values of samples before run time `t_ns`, ns.
    pub(super) fn advance(&mut self, t_ns: u64) {
        for (robot, waiting) in self.waiting.iter_mut().enumerate() {
            while let Some(&(at_ns, values)) = waiting.front().filter(|(at_ns, _)| *at_ns < t_ns) {
                waiting.pop_front();
                let own = values.iter().filter(|(i, _)| *i < self.names[robot].len());
                for (i, value) in own {
                    self.newest[self.first[robot] + i] = Some((at_ns, value));
                    self.sums[self.first[robot] + i].add(value);
                }
            }
        }
    }

    /// Returns the newest value of each signal, robot by robot.
    pub(super) fn newest(&self) -> &[Newest] {
        &self.newest
    }

    /// Returns all metrics by name, over the robots that are alive.
    pub(super) fn metrics(&self, alive: &[bool]) -> Vec<(String, Option<f64>)> {
        let metric = |metric: &Metric| {
            let living = (0..self.names.len()).filter(|&robot| alive[robot]);
            let values = living.filter_map(|robot| self.over_time(robot, metric));
            (metric.name.clone(), over_robots(metric.over_robots, values))
        };
        self.metrics.iter().map(metric).collect()
    }

    /// Returns the value of one robot for a metric; `None` if it recorded none.
    fn over_time(&self, robot: usize, metric: &Metric) -> Option<f64> {
        let signal = self.names[robot].iter().position(|&name| name == metric.signal)?;
        let place = self.first[robot] + signal;
        let (_, last) = self.newest[place]?;
        let Sums { count, sum, min, max } = self.sums[place];
        Some(match metric.over_time {
            OverTime::Last => last,
            OverTime::Mean => sum / count as f64,
            OverTime::Min => min,
            OverTime::Max => max,
            OverTime::Sum => sum,
        })
    }
}

/// Returns the reduction of the robots' values; `None` without any, or if it is not finite.
fn over_robots(reduction: OverRobots, values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut all = Sums::NONE;
    values.for_each(|value| all.add(value));
    let Sums { count, sum, min, max } = all;
    let value = match reduction {
        OverRobots::Max => max,
        OverRobots::Min => min,
        OverRobots::Mean => sum / count as f64,
        OverRobots::Sum => sum,
    };
    (count > 0 && value.is_finite()).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::examples::row_of_three;

    fn metric(over_time: OverTime, over_robots: OverRobots) -> Metric {
        let name = format!("{over_time:?} {over_robots:?}");
        Metric { name, signal: "cost_m2".to_owned(), over_time, over_robots }
    }

    /// Returns the row of three, in which r1 and r3 record a cost.
    fn recording(metrics: Vec<Metric>) -> Scenario {
        let mut scenario = row_of_three();
        scenario.robots[0].signals = &["cost_m2"];
        scenario.robots[2].signals = &["gap_m", "cost_m2"];
        scenario.metrics = metrics;
        scenario
    }

    fn values(values: &[(usize, f64)]) -> SignalValues {
        let mut all = SignalValues::NONE;
        values.iter().for_each(|&(i, value)| all.set(i, value));
        all
    }

    #[test]
    fn metrics_reduce_over_time_and_then_over_living_robots() {
        let pairs = [
            (OverTime::Last, OverRobots::Max),
            (OverTime::Mean, OverRobots::Sum),
            (OverTime::Min, OverRobots::Min),
            (OverTime::Max, OverRobots::Mean),
            (OverTime::Sum, OverRobots::Max),
        ];
        let metrics = pairs.map(|(time, robots)| metric(time, robots)).to_vec();
        let mut signals = Signals::new(&recording(metrics));
        signals.add(0, 0, values(&[(0, 4.0)]));
        signals.add(0, 10, values(&[(0, 2.0)]));
        signals.add(2, 0, values(&[(0, 100.0), (1, 7.0)]));
        signals.advance(11);
        let found = |alive: &[bool]| -> Vec<Option<f64>> {
            signals.metrics(alive).into_iter().map(|(_, value)| value).collect()
        };
        assert_eq!(found(&[true; 3]), [7.0, 10.0, 2.0, 5.5, 7.0].map(Some));
        assert_eq!(found(&[true, true, false]), [2.0, 3.0, 2.0, 4.0, 6.0].map(Some));
        assert_eq!(found(&[false, true, false]), [None; 5]);
    }

    #[test]
    fn value_counts_from_the_first_sample_after_its_own() {
        let mut signals = Signals::new(&recording(Vec::new()));
        signals.add(2, 10, values(&[(1, 1.0)]));
        signals.add(2, 20, values(&[(1, 2.0)]));
        signals.advance(10);
        assert_eq!(signals.newest(), [None; 3]);
        signals.advance(20);
        assert_eq!(signals.newest(), [None, None, Some((10, 1.0))]);
        signals.advance(30);
        assert_eq!(signals.newest(), [None, None, Some((20, 2.0))]);
    }
}
