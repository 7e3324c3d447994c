//! Signals that control laws recorded, and the metrics of the experiment's own that follow from them.

use experiment::scenario::{Metric, MetricSource, RobotReduction, Scenario, TimeReduction};
use protocol::signals::SignalValues;

use super::pending::PendingValues;

/// Newest value of one signal of one robot: run time of the sample, ns, and value; `None` before the first one.
pub type NewestValue = Option<(u64, f64)>;

/// Signals of all robots.
pub(super) struct Signals {
    metrics: Vec<Metric>,
    /// Names of the signals of each robot.
    names: Vec<&'static [&'static str]>,
    /// Index of the first signal of each robot in the lists of all signals.
    first_signal_index: Vec<usize>,
    pending_values: PendingValues<SignalValues>,
    newest_values: Vec<NewestValue>,
    reductions: Vec<ValueReductions>,
}

/// Reductions of the values of one signal of one robot.
#[derive(Debug, Clone, Copy)]
struct ValueReductions {
    count: u64,
    sum: f64,
    min: f64,
    max: f64,
}

impl ValueReductions {
    const NONE: ValueReductions =
        ValueReductions { count: 0, sum: 0.0, min: f64::INFINITY, max: f64::NEG_INFINITY };

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
        let (mut count, mut first_signal_index) = (0, Vec::with_capacity(names.len()));
        for robot_signals in &names {
            first_signal_index.push(count);
            count += robot_signals.len();
        }
        Signals {
            metrics: scenario.metrics.clone(),
            pending_values: PendingValues::new(names.len()),
            names,
            first_signal_index,
            newest_values: vec![None; count],
            reductions: vec![ValueReductions::NONE; count],
        }
    }

    /// Adds the values that a robot recorded at its sample of run time `t_ns`, ns.
    pub(super) fn add_values(&mut self, robot: usize, t_ns: u64, values: SignalValues) {
        if !values.is_empty() {
            self.pending_values.push(robot, t_ns, values);
        }
    }

    /// Counts all values of samples before run time `t_ns`, ns.
    pub(super) fn apply_values_before(&mut self, t_ns: u64) {
        let Signals {
            names, first_signal_index, pending_values, newest_values, reductions, ..
        } = self;
        pending_values.take_before(t_ns, |robot, at_ns, values| {
            let known_values = values.iter().filter(|(i, _)| *i < names[robot].len());
            for (i, value) in known_values {
                newest_values[first_signal_index[robot] + i] = Some((at_ns, value));
                reductions[first_signal_index[robot] + i].add(value);
            }
        });
    }

    /// Returns the newest value of each signal, robot by robot.
    pub(super) fn newest_values(&self) -> &[NewestValue] {
        &self.newest_values
    }

    /// Returns all metrics by name, over the robots that are alive. Those of programs have no value yet.
    pub(super) fn compute_metrics(&self, alive: &[bool]) -> Vec<(String, Option<f64>)> {
        let value = |metric: &Metric| match &metric.source {
            MetricSource::Program { .. } => None,
            MetricSource::Signal { signal, over_time, over_robots } => {
                let alive_robots = (0..self.names.len()).filter(|&robot| alive[robot]);
                let values = alive_robots
                    .filter_map(|robot| self.reduce_over_time(robot, signal, *over_time));
                reduce_over_robots(*over_robots, values)
            }
        };
        self.metrics.iter().map(|metric| (metric.name.clone(), value(metric))).collect()
    }

    /// Returns the reduction of a signal of one robot; `None` if it recorded none.
    fn reduce_over_time(
        &self,
        robot: usize,
        signal: &str,
        over_time: TimeReduction,
    ) -> Option<f64> {
        let signal = self.names[robot].iter().position(|&name| name == signal)?;
        let index = self.first_signal_index[robot] + signal;
        let (_, last) = self.newest_values[index]?;
        let ValueReductions { count, sum, min, max } = self.reductions[index];
        Some(match over_time {
            TimeReduction::Last => last,
            TimeReduction::Mean => sum / count as f64,
            TimeReduction::Min => min,
            TimeReduction::Max => max,
            TimeReduction::Sum => sum,
        })
    }
}

/// Returns the reduction of the robots' values; `None` without any, or if it is not finite.
fn reduce_over_robots(reduction: RobotReduction, values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut reductions = ValueReductions::NONE;
    values.for_each(|value| reductions.add(value));
    let ValueReductions { count, sum, min, max } = reductions;
    let value = match reduction {
        RobotReduction::Max => max,
        RobotReduction::Min => min,
        RobotReduction::Mean => sum / count as f64,
        RobotReduction::Sum => sum,
    };
    (count > 0 && value.is_finite()).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::examples::row_of_three;

    fn metric(over_time: TimeReduction, over_robots: RobotReduction) -> Metric {
        let name = format!("{over_time:?} {over_robots:?}");
        let source = MetricSource::Signal { signal: "cost_m2".to_owned(), over_time, over_robots };
        Metric { name, source }
    }

    /// Returns the row of three, in which r1 and r3 record a cost.
    fn scenario_with_signals(metrics: Vec<Metric>) -> Scenario {
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
            (TimeReduction::Last, RobotReduction::Max),
            (TimeReduction::Mean, RobotReduction::Sum),
            (TimeReduction::Min, RobotReduction::Min),
            (TimeReduction::Max, RobotReduction::Mean),
            (TimeReduction::Sum, RobotReduction::Max),
        ];
        let metrics = pairs.map(|(time, robots)| metric(time, robots)).to_vec();
        let mut signals = Signals::new(&scenario_with_signals(metrics));
        signals.add_values(0, 0, values(&[(0, 4.0)]));
        signals.add_values(0, 10, values(&[(0, 2.0)]));
        signals.add_values(2, 0, values(&[(0, 100.0), (1, 7.0)]));
        signals.apply_values_before(11);
        let found = |alive: &[bool]| -> Vec<Option<f64>> {
            signals.compute_metrics(alive).into_iter().map(|(_, value)| value).collect()
        };
        assert_eq!(found(&[true; 3]), [7.0, 10.0, 2.0, 5.5, 7.0].map(Some));
        assert_eq!(found(&[true, true, false]), [2.0, 3.0, 2.0, 4.0, 6.0].map(Some));
        assert_eq!(found(&[false, true, false]), [None; 5]);
    }

    #[test]
    fn value_counts_from_the_first_sample_after_its_own() {
        let mut signals = Signals::new(&scenario_with_signals(Vec::new()));
        signals.add_values(2, 10, values(&[(1, 1.0)]));
        signals.add_values(2, 20, values(&[(1, 2.0)]));
        signals.apply_values_before(10);
        assert_eq!(signals.newest_values(), [None; 3]);
        signals.apply_values_before(20);
        assert_eq!(signals.newest_values(), [None, None, Some((10, 1.0))]);
        signals.apply_values_before(30);
        assert_eq!(signals.newest_values(), [None, None, Some((20, 2.0))]);
    }
}
