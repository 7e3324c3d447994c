//! Latencies and ages of all processes over all their incarnations, as one HDR histogram for each stage and robot
//! or edge.
//!
//! No value is trimmed. A wake-up that missed several deadlines counts for each of them with its own lateness
//! (correction of coordinated omission, exact because the schedule is known).

mod distribution;
mod over_time;

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

use hdrhistogram::serialization::V2DeflateSerializer;
use hdrhistogram::serialization::interval_log::{IntervalLogWriterBuilder, Tag};
use protocol::age::AgeSums;
use protocol::brief::Pace;
use protocol::message::{LatencyHeader, LatencyRow};
use protocol::stage::Stage;

use crate::metrics::summary::{InformationAge, LatencyInterval, StageLatency};
use distribution::ValueDistribution;
use experiment::scenario::Scenario;
use over_time::{ClosedInterval, LatencyIntervals};

/// Maximum plausible value, ns. A larger one counts as lost.
const LATENCY_NS_MAX: u64 = 3_600_000_000_000;

/// Latencies and ages that the processes of a run measured.
#[derive(Debug, Clone, Default)]
pub struct LatencyCollector {
    robots: Vec<String>,
    /// Plant, robots in scenario order, control timer.
    processes: Vec<ProcessLatency>,
    rows_lost: u64,
    intervals: LatencyIntervals,
}

/// Robot name of the line about all robots. No robot can have this name.
const ALL_ROBOTS: &str = "all robots";

/// Measurements of one process over all its incarnations.
#[derive(Debug, Clone)]
struct ProcessLatency {
    /// Period of the process's timer, ns.
    wake_period_ns: u64,
    /// Distributions by stage and other robot, counted from 1; 0 for no robot. In the order of their first values.
    distributions: Vec<((u32, usize), ValueDistribution)>,
    /// Index of each distribution, by stage and other robot.
    distribution_indices: BTreeMap<(u32, usize), usize>,
    /// Index of the distribution that the next row probably belongs to.
    next_distribution: usize,
    /// Sums of the age of information, by the sending robot, counted from 1.
    ages: BTreeMap<usize, AgeSums>,
    incarnation: u64,
    next_row: u64,
    samples_lost: u64,
    /// Number of the interval of run time to which the newest values belong.
    interval: u64,
}

impl ProcessLatency {
    /// Registers a batch of `rows` rows. Returns the number of rows that were lost before it.
    fn register_batch(&mut self, header: &LatencyHeader, rows: usize) -> u64 {
        if header.incarnation != self.incarnation {
            self.incarnation = header.incarnation;
            self.next_row = 0;
        }
        let missing = header.first_row.saturating_sub(self.next_row);
        self.next_row = header.first_row.saturating_add(rows as u64);
        missing
    }

    /// Adds the lateness of the wake-ups that this late one, ns, missed.
    #[cold]
    fn add_missed_wake_ups(&mut self, stage: Stage, other: usize, lateness_ns: u64) {
        let mut next_ns = lateness_ns.checked_sub(self.wake_period_ns);
        while let Some(value_ns) = next_ns {
            self.distribution_mut(stage, other).add(value_ns);
            next_ns = value_ns.checked_sub(self.wake_period_ns);
        }
    }

    /// Adds a value to the distribution that the next row probably belongs to, because the rows of most ticks have the
    /// same order. Returns `false`, and adds nothing, if the row belongs to another one, or its value is larger than
    /// `value_ns_max`.
    #[inline(always)]
    fn add_if_expected(&mut self, row: &LatencyRow, value_ns_max: u64) -> bool {
        let index = self.next_distribution;
        let Some((key, distribution)) = self.distributions.get_mut(index) else { return false };
        if *key != (row.stage, row.from as usize) || row.value_ns > value_ns_max {
            return false;
        }
        distribution.add(row.value_ns);
        self.expect_row_after(index);
        true
    }

    /// Returns the distribution of a stage and of the other robot. The next row is expected in the one after it.
    fn distribution_mut(&mut self, stage: Stage, other: usize) -> &mut ValueDistribution {
        let index = self.find_distribution(stage, other);
        self.expect_row_after(index);
        &mut self.distributions[index].1
    }

    /// Expects the next row in the distribution after `index`, in a cycle.
    #[inline(always)]
    fn expect_row_after(&mut self, index: usize) {
        self.next_distribution = if index + 1 < self.distributions.len() { index + 1 } else { 0 };
    }

    /// Closes the interval of the newest values, if a later one has begun. `process` is the index of this process.
    fn close_interval_before(
        &mut self,
        current_interval: u64,
        process: usize,
        closed_intervals: &mut Vec<ClosedInterval>,
    ) {
        let interval = std::mem::replace(&mut self.interval, current_interval);
        if interval == current_interval {
            return;
        }
        for ((stage, other), distribution) in &mut self.distributions {
            let quantiles = distribution.end_interval();
            closed_intervals.extend(quantiles.map(|quantiles| {
                let (stage, other) = (*stage, *other);
                ClosedInterval { interval, stage, process, other, quantiles }
            }));
        }
    }

    /// Returns the index of the distribution of a stage and of the other robot, which is added if it is new.
    fn find_distribution(&mut self, stage: Stage, other: usize) -> usize {
        let key = (stage as u32, other);
        *self.distribution_indices.entry(key).or_insert_with(|| {
            self.distributions.push((key, ValueDistribution::default()));
            self.distributions.len() - 1
        })
    }

    /// Iterates over the distributions of a stage, and the other robots, ascending.
    fn distributions_of(&self, stage: Stage) -> impl Iterator<Item = (usize, &ValueDistribution)> {
        let keys = distribution_keys(stage);
        self.distribution_indices
            .range(keys)
            .map(|(&(_, other), &index)| (other, &self.distributions[index].1))
    }
}

/// Returns the range of the keys of a stage's distributions: the stage, and any other robot.
fn distribution_keys(stage: Stage) -> std::ops::Range<(u32, usize)> {
    (stage as u32, 0)..(stage as u32 + 1, 0)
}

fn to_stage_latency(
    (stage, robot, from, distribution): (Stage, &str, Option<&str>, &ValueDistribution),
) -> StageLatency {
    let (histogram, count) = (distribution.histogram(), distribution.count());
    let quantile_ns = |quantile| distribution.quantile_ns(&histogram, quantile);
    StageLatency {
        stage: stage.keyword().into(),
        robot: robot.into(),
        from: from.map(str::to_owned),
        count,
        min_ns: distribution.min_ns,
        p50_ns: quantile_ns(0.5),
        p90_ns: quantile_ns(0.9),
        p99_ns: quantile_ns(0.99),
        p99_9_ns: quantile_ns(0.999),
        p99_99_ns: quantile_ns(0.9999),
        max_ns: distribution.max_ns,
        mean_ns: distribution.sum_ns() as f64 / count as f64,
    }
}

impl LatencyCollector {
    /// Creates the collection before the first measurement.
    pub fn new(scenario: &Scenario, pace: Pace) -> LatencyCollector {
        let robots: Vec<String> = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
        let process = |process| ProcessLatency {
            wake_period_ns: match (pace, process) {
                (Pace::Lockstep, _) => u64::MAX, // no timer in lockstep
                (Pace::Realtime, 0) => scenario.realtime.plant_tick_ns,
                (Pace::Realtime, _) => scenario.period_ns,
            },
            distributions: Vec::new(),
            distribution_indices: BTreeMap::new(),
            next_distribution: 0,
            ages: BTreeMap::new(),
            incarnation: 0,
            next_row: 0,
            samples_lost: 0,
            interval: 0,
        };
        let processes = (0..robots.len() + 2).map(process).collect();
        let intervals = LatencyIntervals::new(scenario.duration_ns);
        LatencyCollector { robots, processes, rows_lost: 0, intervals }
    }

    /// Sets the run time, ns, at which the following batches reached the supervisor.
    pub fn set_time(&mut self, t_ns: u64) {
        self.intervals.set_time(t_ns);
    }

    /// Returns the lines of `latency_over_time.csv` up to now.
    pub fn intervals_over_time(&mut self) -> Vec<LatencyInterval> {
        let closed_intervals = &mut self.intervals.closed_intervals;
        for (process, latency) in self.processes.iter_mut().enumerate() {
            latency.close_interval_before(u64::MAX, process, closed_intervals);
        }
        closed_intervals.sort_unstable();
        self.intervals.closed_intervals.iter().map(|closed| self.to_interval(closed)).collect()
    }

    fn to_interval(&self, closed: &ClosedInterval) -> LatencyInterval {
        let &ClosedInterval { interval, stage, process, other, quantiles } = closed;
        let stage = Stage::from_number(stage).expect("only known stages are added");
        let (robot, from) = owner_and_sender(stage, process, other);
        let name = |process| process_name(&self.robots, process).to_owned();
        LatencyInterval {
            t_s: self.intervals.middle_s(interval),
            stage: stage.keyword().to_owned(),
            robot: name(robot),
            from: from.map(name),
            count: quantiles.count,
            p50_ns: quantiles.p50_ns,
            p99_ns: quantiles.p99_ns,
            max_ns: quantiles.max_ns,
        }
    }

    /// Adds a batch of measurements of a process: 0 is the plant, robots count from 1, the control timer is the
    /// last.
    pub fn add_batch(&mut self, process: usize, header: &LatencyHeader, rows: &[LatencyRow]) {
        let (index, robots) = (process, self.robots.len());
        let LatencyIntervals { current_interval, closed_intervals, .. } = &mut self.intervals;
        let process = &mut self.processes[index];
        process.close_interval_before(*current_interval, index, closed_intervals);
        self.rows_lost += process.register_batch(header, rows.len());
        process.samples_lost = process.samples_lost.max(header.samples_lost);
        let value_ns_max = LATENCY_NS_MAX.min(process.wake_period_ns - 1);
        for row in rows {
            if process.add_if_expected(row, value_ns_max) {
                continue;
            }
            let other = row.from as usize;
            if other <= robots && AgeSums::is_carried_by(row) {
                process.ages.entry(other).or_default().add_row(row);
                continue;
            }
            let stage = Stage::from_number(row.stage);
            let is_valid = other <= robots && row.value_ns <= LATENCY_NS_MAX;
            let Some(stage) = stage.filter(|_| is_valid) else {
                self.rows_lost += 1;
                continue;
            };
            process.distribution_mut(stage, other).add(row.value_ns);
            if matches!(stage, Stage::Wake | Stage::Machine) {
                process.add_missed_wake_ups(stage, other, row.value_ns);
            }
        }
    }

    /// Skips a batch that was measured before the run began.
    pub fn skip_batch(&mut self, process: usize, header: &LatencyHeader, rows: &[LatencyRow]) {
        self.processes[process].register_batch(header, rows.len());
    }

    /// Returns the number of measured values that did not arrive or were invalid.
    pub fn rows_lost(&self) -> u64 {
        self.rows_lost
    }

    /// Returns the number of commands that a newer one replaced before the plant received them.
    pub fn commands_lost(&self) -> u64 {
        self.processes.first().map_or(0, |plant| plant.samples_lost)
    }

    /// Iterates over all distributions by stage, then by process: the plant, then the robots in scenario order.
    fn distributions(
        &self,
    ) -> impl Iterator<Item = (Stage, &str, Option<&str>, &ValueDistribution)> {
        let distributions_of_process = move |stage: Stage, process: usize| {
            self.processes[process].distributions_of(stage).map(move |(other, distribution)| {
                let (robot, from) = owner_and_sender(stage, process, other);
                let name = |process| process_name(&self.robots, process);
                (stage, name(robot), from.map(name), distribution)
            })
        };
        Stage::ALL.into_iter().flat_map(move |stage| {
            (0..self.processes.len())
                .flat_map(move |process| distributions_of_process(stage, process))
        })
    }

    /// Returns the lines of `latency.csv`.
    pub fn stage_latencies(&self) -> Vec<StageLatency> {
        self.distributions().map(to_stage_latency).collect()
    }

    /// Returns the wake-up latency of all robots as one line; `None` without values.
    pub fn wake_latency_of_all_robots(&self) -> Option<StageLatency> {
        let robot_processes = 1..=self.robots.len();
        let mut all = ValueDistribution::default();
        let wake_distributions =
            |process: usize| self.processes[process].distributions_of(Stage::Wake);
        robot_processes
            .flat_map(wake_distributions)
            .for_each(|(_, distribution)| all.merge(distribution));
        (all.count() > 0).then(|| to_stage_latency((Stage::Wake, ALL_ROBOTS, None, &all)))
    }

    /// Returns the age of information of every edge over which a beacon was received.
    pub fn information_ages(&self) -> Vec<InformationAge> {
        let ages_of_process = |process: usize| {
            self.processes[process].ages.iter().filter_map(move |(&from, sums)| {
                Some(InformationAge {
                    robot: process_name(&self.robots, process).to_owned(),
                    from: process_name(&self.robots, from).to_owned(),
                    heard: sums.sample_count,
                    over_ns: sums.duration_ns,
                    mean_ns: sums.mean_ns()?,
                    peak_ns: sums.peak_ns,
                })
            })
        };
        (0..self.processes.len()).flat_map(ages_of_process).collect()
    }

    /// Returns for each stage the robot or edge with the largest value up to now. It is fast, because it computes
    /// quantiles only for these.
    pub fn worst_stage_latencies(&self) -> Vec<StageLatency> {
        let mut worst_by_stage = Stage::ALL.map(|_| None);
        for (stage, robot, from, distribution) in self.distributions() {
            let worst: &mut Option<(_, _, _, &ValueDistribution)> =
                &mut worst_by_stage[stage as usize];
            if worst.is_none_or(|(.., worst)| worst.max_ns < distribution.max_ns) {
                *worst = Some((stage, robot, from, distribution));
            }
        }
        worst_by_stage.into_iter().flatten().map(to_stage_latency).collect()
    }

    /// Returns `latency.hlog` in the log format of HdrHistogram: one interval, the run, for each tag `stage:robot`
    /// or `stage:from->to`. Values are in ns, the column of maxima is in ms.
    pub fn encode_hlog(&self, start: SystemTime, duration: Duration) -> Vec<u8> {
        let mut log = Vec::new();
        let mut serializer = V2DeflateSerializer::new();
        let mut writer = IntervalLogWriterBuilder::new()
            .add_comment("phalanx: latencies in ns, maxima in ms")
            .with_start_time(start)
            .with_base_time(start)
            .with_max_value_divisor(1e6)
            .begin_log_with(&mut log, &mut serializer)
            .expect("memory takes everything");
        for (stage, robot, from, distribution) in self.distributions() {
            let edge = from.map_or(robot.to_owned(), |from| format!("{from}->{robot}"));
            // A tag may contain neither commas nor white space.
            let is_forbidden = |c: char| c == ',' || c.is_whitespace();
            let tag = format!("{}:{edge}", stage.keyword()).replace(is_forbidden, "_");
            writer
                .write_histogram(
                    &distribution.histogram(),
                    Duration::ZERO,
                    duration,
                    Tag::new(&tag),
                )
                .expect("memory takes everything");
        }
        log
    }
}

/// Returns the name of a process: `plant`, the robot counted from 1, or `machine` for the control timer.
fn process_name(robots: &[String], process: usize) -> &str {
    match process.checked_sub(1) {
        Some(robot) => robots.get(robot).map_or("machine", String::as_str),
        None => "plant",
    }
}

/// Returns the robot that a value belongs to and, for an edge, the sending robot. `process` measured the value,
/// `other` is the number of the other robot.
fn owner_and_sender(stage: Stage, process: usize, other: usize) -> (usize, Option<usize>) {
    match stage {
        // The plant measures commands, but the control loop is the robot's.
        Stage::Command => (other, None),
        _ => (process, (other > 0).then_some(other)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::examples::row_of_three;
    use proptest::prelude::*;
    use protocol::latency::LatencyRecorder;

    const NS_PER_MS: u64 = 1_000_000;

    fn row(stage: Stage, from: u32, value_ns: u64) -> LatencyRow {
        LatencyRow { stage: stage as u32, from, value_ns }
    }

    #[test]
    fn edge_information_age_is_aggregated_over_all_incarnations() {
        let mut latency = LatencyCollector::new(&row_of_three(), Pace::Lockstep);
        for (incarnation, integral_s2, peak_ns) in [(0, 1.0, 7), (1, 2.0, 5)] {
            let header = LatencyHeader { incarnation, ..LatencyHeader::default() };
            let sums =
                AgeSums { sample_count: 3, duration_ns: 1_000_000_000, integral_s2, peak_ns };
            latency.add_batch(2, &header, &sums.to_rows(1));
        }
        assert_eq!((latency.stage_latencies(), latency.rows_lost()), (Vec::new(), 0));
        let [age] = &latency.information_ages()[..] else { panic!("one edge") };
        assert_eq!((age.robot.as_str(), age.from.as_str(), age.heard), ("r2", "r1", 6));
        assert_eq!((age.over_ns, age.mean_ns, age.peak_ns), (2_000_000_000, 1.5e9, 7));
    }

    #[test]
    fn invalid_values_are_counted_and_omitted() {
        let mut latency = LatencyCollector::new(&row_of_three(), Pace::Realtime);
        let mut unknown = row(Stage::Wake, 0, 1);
        unknown.stage = 99;
        let rows = [unknown, row(Stage::Wake, 4, 1), row(Stage::Wake, 0, u64::MAX)];
        latency.add_batch(0, &LatencyHeader::default(), &rows);
        assert_eq!((latency.rows_lost(), latency.stage_latencies()), (3, Vec::new()));
    }

    #[test]
    fn each_interval_has_median_and_maximum_unless_it_is_silent() {
        let mut latency = LatencyCollector::new(&row_of_three(), Pace::Lockstep); // 20 s
        let mut add_values = |t_ms: u64, robot, values_ms: &[u64]| {
            latency.set_time(t_ms * NS_PER_MS);
            let row = |value_ms: &u64| row(Stage::BeaconAge, 1, value_ms * NS_PER_MS);
            let rows: Vec<LatencyRow> = values_ms.iter().map(row).collect();
            latency.add_batch(robot, &LatencyHeader::default(), &rows);
        };
        add_values(100, 2, &[4, 2]);
        add_values(900, 2, &[3, 9]);
        add_values(900, 3, &[5]);
        add_values(7_000, 2, &[1]);
        add_values(20_000, 2, &[8]);
        let lines = latency.intervals_over_time();
        let found: Vec<_> = lines
            .iter()
            .map(|line| (line.t_s, line.robot.as_str(), line.count, line.p50_ns, line.max_ns))
            .collect();
        let ms = |p50: u64, max: u64| (p50 * NS_PER_MS, max * NS_PER_MS);
        let expected = [
            (0.5, "r2", 4, ms(3, 9)),
            (0.5, "r3", 1, ms(5, 5)),
            (7.5, "r2", 1, ms(1, 1)),
            (20.0, "r2", 1, ms(8, 8)), // the last values are sent at the very end
        ];
        assert_eq!(found, expected.map(|(t_s, robot, n, (p50, max))| (t_s, robot, n, p50, max)));
        assert!(lines.iter().all(|line| line.from.as_deref() == Some("r1")));
    }

    proptest! {
        /// For any batch sizes, the histogram is that of all values.
        #[test]
        fn batches_add_up_to_all_measurements(
            values_ns in proptest::collection::vec(0..2 * LATENCY_NS_MAX / 3, 1..400),
            is_sent_after in proptest::collection::vec(any::<bool>(), 400),
            capacity in 1..500_usize,
        ) {
            let mut recorder = LatencyRecorder::new(0, capacity);
            let mut latency = LatencyCollector::new(&row_of_three(), Pace::Lockstep);
            let mut expected = ValueDistribution::default();
            let mut buffered_count = 0;
            for (&value_ns, is_sent) in values_ns.iter().zip(is_sent_after) {
                if buffered_count < capacity {
                    expected.add(value_ns);
                    buffered_count += 1;
                }
                recorder.record(Stage::Odometry, 0, value_ns);
                if is_sent {
                    let (header, rows) = recorder.batch();
                    latency.add_batch(3, &header, rows);
                    recorder.begin_next_batch(0);
                    buffered_count = 0;
                }
            }
            recorder.record(Stage::Compute, 0, 0); // so that the last batch has a successor
            let (header, rows) = recorder.batch();
            latency.add_batch(3, &header, rows);
            recorder.begin_next_batch(0);
            latency.add_batch(3, &recorder.batch().0, &[]);
            let distribution = |stage: Stage| latency.processes[3].distributions_of(stage).next();
            let found = distribution(Stage::Odometry).unwrap().1;
            prop_assert_eq!(found.histogram(), expected.histogram());
            prop_assert_eq!(found.sum_ns(), expected.sum_ns());
            let received_count = found.count() + distribution(Stage::Compute).map_or(0, |(_, distribution)| distribution.count());
            prop_assert_eq!(received_count + latency.rows_lost(), values_ns.len() as u64 + 1);
        }
    }
}
