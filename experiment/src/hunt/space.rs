//! Search space of a hunt. Each point of the unit cube is decoded to a run, so that any optimizer can be used.

use std::f64::consts::TAU;
use std::ops::Range;

use formation::Vec2;
use formation::closest::closest_pair;
use formation::front_point::{front_point, rotate};
use formation::graph::Edge;
use formation::portable_math;
use formation::pose::{Pose, wrap_angle};

use crate::check::start_front_points;
use crate::hunt::plan::{
    ALL_ROBOTS, MESSAGE_BITS, MESSAGE_NUMBERS, PlannedFault, RunPlan, round_to_digits,
};
use crate::scenario::{HuntBounds, Robot, Scenario, VariedPart};

/// Number of significant digits of decoded numbers.
const SIGNIFICANT_DIGITS: usize = 3;
/// Maximum number of consecutive losses, messages.
const BURST_MESSAGES_MAX: f64 = 20.0;
/// Maximum probability with which a bit of a message is inverted.
const BIT_FLIPS_MAX: f64 = 0.1;
/// Maximum difference of the factor on the numbers of a message from 1: the factor is from -2 to 4.
const MESSAGE_SCALE_CHANGE_MAX: f64 = 3.0;

/// Search space of a hunt.
pub struct SearchSpace {
    scenario: Scenario,
    bounds: HuntBounds,
    /// Minimum distance of two front points at the start, m.
    separation_min_m: f64,
    /// Kinds of faults with the components that each can affect.
    fault_kinds: Vec<(&'static str, Vec<AffectedTarget>)>,
    /// Groups of gains with their keys and values. The gains of a group get the same factor.
    gains: Vec<Vec<VariedGain>>,
}

/// Structure of the coordinates of a point.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CoordinateLayout {
    /// For each coordinate, `true` if runs depend on it continuously.
    pub is_continuous: Vec<bool>,
    /// Groups of coordinates, such as the start of one robot or one fault.
    pub coordinate_groups: Vec<Range<usize>>,
    /// Index of the coordinate that determines the number of faults.
    pub fault_count_index: Option<usize>,
    /// Indices in `coordinate_groups` of the faults. All have the same number of coordinates with the same meaning.
    pub fault_groups: Range<usize>,
}

/// Affected robots of a fault, and the affected stream, sensor or part of messages.
type AffectedTarget = (Vec<String>, &'static str);

/// Error: the search space is empty.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("nothing would vary: {0}")]
pub struct EmptySearchSpaceError(&'static str);

/// Reader of the coordinates of a point, in order.
struct CoordinateReader<'p> {
    point: &'p [f64],
    next_index: usize,
    /// For each coordinate, `true` if the result of a run depends on it continuously.
    is_continuous: Vec<bool>,
    is_used: Vec<bool>,
    /// `true` if the run depends on the coordinates that are read next.
    reads_used_coordinates: bool,
    /// Ends of the groups of coordinates.
    group_ends: Vec<usize>,
}

impl CoordinateReader<'_> {
    fn new(point: &[f64]) -> CoordinateReader<'_> {
        CoordinateReader {
            point,
            next_index: 0,
            is_continuous: Vec::new(),
            is_used: Vec::new(),
            reads_used_coordinates: true,
            group_ends: Vec::new(),
        }
    }

    fn next_coordinate(&mut self, is_continuous: bool) -> f64 {
        let coordinate = self.point.get(self.next_index).copied().unwrap_or(0.5);
        self.next_index += 1;
        self.is_continuous.push(is_continuous);
        self.is_used.push(self.reads_used_coordinates);
        coordinate
    }

    /// Ends a group of coordinates.
    fn end_group(&mut self) {
        self.group_ends.push(self.next_index);
    }

    /// Reads a continuous coordinate from 0 to 1.
    fn read_unit_coordinate(&mut self) -> f64 {
        self.next_coordinate(true)
    }

    /// Reads a choice among `count` options.
    fn read_choice(&mut self, count: usize) -> usize {
        ((self.next_coordinate(false) * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Reads an optional amount: `None` for the lower half of the coordinate, growing from 0 to 1 over the upper half.
    fn read_optional_amount(&mut self) -> Option<f64> {
        let coordinate = self.read_unit_coordinate();
        (coordinate > 0.5).then_some(2.0 * coordinate - 1.0)
    }
}

impl SearchSpace {
    /// Creates the search space of a scenario in which `vary` varies.
    ///
    /// # Errors
    ///
    /// The space is empty.
    pub fn new(
        scenario: &Scenario,
        vary: &[VariedPart],
    ) -> Result<SearchSpace, EmptySearchSpaceError> {
        let bounds = HuntBounds { varied_parts: vary.to_vec(), ..scenario.hunt_bounds.clone() };
        let start_distance_m = closest_pair(&start_front_points(&scenario.robots))
            .map_or(f64::INFINITY, |pair| pair.distance_m);
        let mut space = SearchSpace {
            separation_min_m: bounds.separation_min_m.min(start_distance_m),
            fault_kinds: Vec::new(),
            gains: gain_groups(scenario),
            scenario: scenario.clone(),
            bounds,
        };
        space.fault_kinds = space
            .bounds
            .fault_kinds
            .iter()
            .map(|kind| (*kind, space.targets_of_kind(kind)))
            .collect();
        space.fault_kinds.retain(|(_, targets)| !targets.is_empty());
        let varies_only = |varied| space.bounds.varied_parts == [varied];
        if space.bounds.varied_parts.is_empty() {
            Err(EmptySearchSpaceError("`vary` is empty"))
        } else if varies_only(VariedPart::Gains) && space.gains.is_empty() {
            Err(EmptySearchSpaceError("no law or method of the scenario has a gain"))
        } else if varies_only(VariedPart::Faults) && space.fault_kinds.is_empty() {
            Err(EmptySearchSpaceError("no robot or link can have any of the `kinds` of faults"))
        } else {
            Ok(space)
        }
    }

    /// Returns the structure of the coordinates.
    pub fn coordinate_layout(&self) -> CoordinateLayout {
        let mut reader = CoordinateReader::new(&[]);
        self.decode(&mut reader);
        let starts = [0].into_iter().chain(reader.group_ends.iter().copied());
        let parts = starts.zip(&reader.group_ends).map(|(start, &end)| start..end).collect();
        let count_index = self.fault_count_index();
        let first_fault_group = count_index.map_or(0, |count_index| {
            reader.group_ends.iter().filter(|&&end| end <= count_index + 1).count()
        });
        let faults = first_fault_group
            ..first_fault_group + count_index.map_or(0, |_| self.bounds.faults_max);
        CoordinateLayout {
            is_continuous: reader.is_continuous,
            coordinate_groups: parts,
            fault_count_index: count_index,
            fault_groups: faults,
        }
    }

    /// Returns for each coordinate of a point whether its run depends on it. It does not depend on the coordinates of
    /// unused faults.
    pub fn used_coordinates(&self, point: &[f64]) -> Vec<bool> {
        let mut reader = CoordinateReader::new(point);
        self.decode(&mut reader);
        reader.is_used
    }

    /// Returns the point that decodes to the unchanged scenario, as far as the bounds allow.
    pub fn unchanged_point(&self) -> Vec<f64> {
        let mut point = vec![0.5; self.coordinate_layout().is_continuous.len()];
        if let Some(count_index) = self.fault_count_index() {
            point[count_index] = 0.0;
        }
        point
    }

    /// Decodes a point to a run.
    pub fn decode_plan(&self, point: &[f64]) -> RunPlan {
        self.decode(&mut CoordinateReader::new(point))
    }

    /// Returns the scenario that all runs are based on.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Returns the single links or robots that a fault can affect in place of `*`.
    pub(super) fn single_targets(&self, fault: &PlannedFault) -> Vec<Vec<String>> {
        let targets = self.targets_of_kind(fault.kind).into_iter();
        let same = targets.filter(|(_, component)| *component == fault.target_component);
        same.map(|(target_names, _)| target_names).collect()
    }

    /// Returns whether faults can affect all robots.
    pub(super) fn can_affect_all(&self) -> bool {
        (0..self.scenario.robots.len()).all(|robot| self.bounds.robots.contains(&robot))
    }

    /// Returns the run with all its faults at their maximum strength.
    pub fn maximize_faults(&self, plan: &RunPlan) -> RunPlan {
        let faults = plan.faults.iter().map(|fault| self.strongest_fault(fault)).collect();
        RunPlan { faults, ..plan.clone() }
    }

    /// Returns the fault with the maximum duration, loss and delay within the bounds.
    pub(super) fn strongest_fault(&self, fault: &PlannedFault) -> PlannedFault {
        let HuntBounds { latest_fault_end_ns, loss_max, delay_ns_max, .. } = self.bounds;
        let mut strongest = fault.clone();
        if fault.kind != "kill" {
            let lengthen = |duration_ns: u64| {
                duration_ns.max(latest_fault_end_ns.saturating_sub(fault.start_ns))
            };
            strongest.duration_ns = fault.duration_ns.map(lengthen);
        }
        for (word, amount) in &mut strongest.parameters {
            match *word {
                "of" => *amount = Some(loss_max),
                "by" if fault.kind == "delay" => {
                    *amount = Some(formation::ns_to_seconds(delay_ns_max))
                }
                "noise" => *amount = Some(self.bounds.message_error_max),
                "flips" => *amount = Some(BIT_FLIPS_MAX),
                _ => {}
            }
        }
        strongest
    }

    fn is_varied(&self, varied: VariedPart) -> bool {
        self.bounds.varied_parts.contains(&varied)
    }

    fn fault_count_index(&self) -> Option<usize> {
        let before =
            if self.is_varied(VariedPart::Starts) { 3 * self.scenario.robots.len() } else { 0 };
        (self.is_varied(VariedPart::Faults) && !self.fault_kinds.is_empty()).then_some(before)
    }

    fn decode(&self, reader: &mut CoordinateReader<'_>) -> RunPlan {
        let mut plan = RunPlan::default();
        if self.is_varied(VariedPart::Starts) {
            plan.starts = self.decode_starts(reader);
        }
        if self.is_varied(VariedPart::Faults) && !self.fault_kinds.is_empty() {
            let count = reader.read_choice(self.bounds.faults_max + 1);
            reader.end_group();
            for fault in 0..self.bounds.faults_max {
                reader.reads_used_coordinates = fault < count;
                plan.faults.push(self.decode_fault(reader));
                reader.end_group();
            }
            reader.reads_used_coordinates = true;
            plan.faults.truncate(count);
        }
        if self.is_varied(VariedPart::Delays) {
            plan.faults.extend(self.decode_delays(reader));
        }
        if self.is_varied(VariedPart::Noise) {
            plan.faults.extend(self.decode_noise(reader));
        }
        if self.is_varied(VariedPart::Gains) {
            for group in &self.gains {
                let [factor_min, factor_max] = self.bounds.gain_factors;
                let factor = factor_min
                    * portable_math::pow(factor_max / factor_min, reader.read_unit_coordinate());
                reader.end_group();
                let gain =
                    |VariedGain { key, scenario_value, range: [lowest, highest] }: &VariedGain| {
                        let value = round_to_digits(scenario_value * factor, SIGNIFICANT_DIGITS);
                        (key.clone(), value.clamp(*lowest, *highest))
                    };
                plan.gains.extend(group.iter().map(gain));
            }
        }
        plan
    }

    /// Decodes the starts: each front point is in its box, moved toward its start in the scenario until it is far
    /// enough from others and clear of walls.
    fn decode_starts(&self, reader: &mut CoordinateReader<'_>) -> Vec<(usize, Pose)> {
        let robots = &self.scenario.robots;
        let walls = self.scenario.obstacles();
        let clearance_m = self.scenario.avoidance.clearance_m;
        let mut points = start_front_points(robots);
        let mut starts = Vec::new();
        for (index, robot) in robots.iter().enumerate() {
            let scenario_point = points[index];
            let [x, y] = self
                .bounds
                .start_box_m
                .map(|side_m| side_m * (reader.read_unit_coordinate() - 0.5));
            let turn_rad = TAU * (reader.read_unit_coordinate() - 0.5);
            reader.end_group();
            let heading_rad =
                round_to_multiple(wrap_angle(robot.start.heading_rad + turn_rad), 1e3);
            let pose_at = |point: Vec2| {
                let ahead = robot.front_point_m * rotate(heading_rad, Vec2::x());
                let [x_m, y_m] =
                    [point.x - ahead.x, point.y - ahead.y].map(|m| round_to_multiple(m, 1e3));
                Pose { x_m, y_m, heading_rad }
            };
            let mut tries = (0..=10).map(|tenths| {
                pose_at(scenario_point + Vec2::new(x, y) * (1.0 - 0.1 * f64::from(tenths)))
            });
            let free = tries.find(|pose| {
                let point = front_point(*pose, robot.front_point_m);
                let is_separated = |(other, other_point): (usize, &Vec2)| {
                    other == index || (other_point - point).norm() >= self.separation_min_m
                };
                points.iter().enumerate().all(is_separated)
                    && walls
                        .nearest_obstacle(point)
                        .is_none_or(|wall| wall.distance_m >= clearance_m)
            });
            // If there is no room, the start of the scenario is used.
            if let Some(pose) = free {
                points[index] = front_point(pose, robot.front_point_m);
                starts.push((index, pose));
            }
        }
        starts
    }

    fn decode_fault(&self, reader: &mut CoordinateReader<'_>) -> PlannedFault {
        let (kind, targets) = &self.fault_kinds[reader.read_choice(self.fault_kinds.len())];
        let (target_names, target_component) = targets[reader.read_choice(targets.len())].clone();
        let [start, duration, a, b] = [(); 4].map(|()| reader.read_unit_coordinate());
        let HuntBounds {
            earliest_fault_start_ns: earliest_ns,
            latest_fault_end_ns: latest_end_ns,
            ..
        } = self.bounds;
        let period_ns = self.scenario.period_ns;
        let latest_ns = latest_end_ns.saturating_sub(period_ns).max(earliest_ns);
        let start_ns = self
            .round_to_periods_ns(earliest_ns as f64 + start * (latest_ns - earliest_ns) as f64)
            .min(latest_ns);
        let remaining_periods = (latest_end_ns - start_ns) as f64 / period_ns as f64;
        let duration_ns = self
            .round_to_periods_ns(
                period_ns as f64 * portable_math::pow(remaining_periods.max(1.0), duration),
            )
            .max(period_ns);
        let parameters = self.fault_amounts(kind, target_component, [a, b]);
        // Half of the kills have no restart.
        let duration_ns = (*kind != "kill" || a < 0.5).then_some(duration_ns);
        PlannedFault { kind, target_names, target_component, parameters, start_ns, duration_ns }
    }

    /// Returns the numbers of a fault, from two coordinates.
    fn fault_amounts(
        &self,
        kind: &str,
        component: &str,
        [a, b]: [f64; 2],
    ) -> Vec<(&'static str, Option<f64>)> {
        let seconds = |ns| Some(formation::ns_to_seconds(ns));
        let (period_ns, d_m) = (self.scenario.period_ns, self.scenario.avoidance.distance_min_m);
        let loss = Some(round_to_digits(self.bounds.loss_max * a.max(0.01), 2));
        match kind {
            "slow" => vec![("by", seconds((period_ns / 10).max(1) * (1.0 + 15.0 * a) as u64))],
            "loss" => {
                vec![("of", loss), ("burst", Some((1.0 + b * (BURST_MESSAGES_MAX - 1.0)).floor()))]
            }
            "bursts" => {
                vec![
                    ("of", loss),
                    ("mean", seconds(period_ns * (1.0 + b * BURST_MESSAGES_MAX) as u64)),
                ]
            }
            "fading" => vec![("range", Some(round_to_digits(d_m * (1.0 + 9.0 * a), 2)))],
            "delay" => {
                let by_ns = self.delay_from_fraction_ns(a);
                let jitter_ns = self.round_to_periods_ns((2.0 * b - 1.0).max(0.0) * by_ns as f64);
                let jitter = (jitter_ns > 0).then(|| ("jitter", seconds(jitter_ns)));
                [("by", seconds(by_ns))].into_iter().chain(jitter).collect()
            }
            "noise" => {
                let by = round_to_digits(self.bounds.noise_m_max * a.max(0.01), 2);
                let heading =
                    round_to_digits(self.bounds.noise_heading_rad_max * (2.0 * b - 1.0), 2);
                let heading = (component == "odometry" && heading > 0.0)
                    .then_some(("heading", Some(heading)));
                [("by", Some(by))].into_iter().chain(heading).collect()
            }
            "lie" if component == MESSAGE_BITS => {
                vec![("flips", Some(round_to_digits(BIT_FLIPS_MAX * a.max(0.01), 2)))]
            }
            "lie" if component == MESSAGE_NUMBERS => {
                // Of both signs, and never so small that the message is not changed.
                let change = (2.0 * b - 1.0).abs().max(0.01).copysign(2.0 * b - 1.0);
                let error_max = self.bounds.message_error_max;
                let (word, amount) = match (3.0 * a) as usize {
                    0 => ("scale", 1.0 + MESSAGE_SCALE_CHANGE_MAX * change),
                    1 => ("offset", error_max * change),
                    _ => ("noise", error_max * b.max(0.01)),
                };
                vec![(word, Some(round_to_digits(amount, SIGNIFICANT_DIGITS)))]
            }
            "lie" => {
                let random = ("random", Some(round_to_digits(d_m * (0.1 + 4.9 * a), 2)));
                let turn = round_to_digits(2.0 * b - 1.0, 2);
                [random].into_iter().chain((turn > 0.0).then_some(("turn", Some(turn)))).collect()
            }
            "wheels" if a < 0.5 => vec![("stuck", None)],
            "wheels" => {
                let fast_m_s = self.scenario.avoidance.speed_max_m_s.min(1.0);
                vec![("limit", Some(round_to_digits(fast_m_s * b.max(0.01), 2)))]
            }
            _ => Vec::new(),
        }
    }

    /// Decodes delays and losses over the whole run.
    fn decode_delays(&self, reader: &mut CoordinateReader<'_>) -> Vec<PlannedFault> {
        let mut faults = Vec::new();
        let has_links = !self.scenario.graph.edges().is_empty();
        for target_component in ["", "odometry", "commands"]
            .into_iter()
            .filter(|target_component| has_links || !target_component.is_empty())
        {
            let (delay, jitter, loss) = (
                reader.read_optional_amount(),
                reader.read_unit_coordinate(),
                reader.read_optional_amount(),
            );
            reader.end_group();
            let target_names =
                vec![ALL_ROBOTS.to_owned(); if target_component.is_empty() { 2 } else { 1 }];
            let fractions = [
                ("delay", delay.map(|fraction| [fraction, jitter])),
                ("loss", loss.map(|fraction| [fraction, 0.0])),
            ];
            faults.extend(fractions.into_iter().filter_map(|(kind, fractions_of_kind)| {
                let parameters = self.fault_amounts(kind, target_component, fractions_of_kind?);
                Some(PlannedFault {
                    kind,
                    target_names: target_names.clone(),
                    target_component,
                    parameters,
                    start_ns: 0,
                    duration_ns: None,
                })
            }));
        }
        faults
    }

    /// Decodes sensor errors over the whole run.
    fn decode_noise(&self, reader: &mut CoordinateReader<'_>) -> Vec<PlannedFault> {
        let mut faults = Vec::new();
        for target_component in ["odometry", "proximity"] {
            let (position, heading) =
                (reader.read_optional_amount(), reader.read_unit_coordinate());
            reader.end_group();
            let Some(position) = position else { continue };
            let parameters = self.fault_amounts("noise", target_component, [position, heading]);
            let target_names = vec![ALL_ROBOTS.to_owned()];
            faults.push(PlannedFault {
                kind: "noise",
                target_names,
                target_component,
                parameters,
                start_ns: 0,
                duration_ns: None,
            });
        }
        faults
    }

    /// Returns a duration as a whole number of periods, ns.
    fn round_to_periods_ns(&self, ns: f64) -> u64 {
        let period_ns = self.scenario.period_ns;
        (ns / period_ns as f64).round() as u64 * period_ns
    }

    fn delay_from_fraction_ns(&self, fraction: f64) -> u64 {
        let delay_ns_max = self.bounds.delay_ns_max;
        self.round_to_periods_ns(fraction * delay_ns_max as f64)
            .max(self.scenario.period_ns)
            .min(delay_ns_max)
    }

    fn targets_of_kind(&self, kind: &str) -> Vec<AffectedTarget> {
        let of_robots = |component: &'static str| {
            self.robot_targets().into_iter().map(move |target_names| (target_names, component))
        };
        let links = || self.link_targets().into_iter().map(|target_names| (target_names, ""));
        match kind {
            "cut" | "fading" => links().collect(),
            "lie" => links().chain(self.false_message_targets()).collect(),
            "loss" | "bursts" | "delay" => {
                links().chain(of_robots("odometry")).chain(of_robots("commands")).collect()
            }
            "blackout" | "noise" => of_robots("odometry").chain(of_robots("proximity")).collect(),
            _ => of_robots("").collect(),
        }
    }

    /// Returns the robots that faults can affect, each as a target.
    fn robot_targets(&self) -> Vec<Vec<String>> {
        self.bounds
            .robots
            .iter()
            .map(|&robot| vec![self.scenario.robots[robot].name.clone()])
            .collect()
    }

    /// Returns the links on which these robots send.
    fn link_targets(&self) -> Vec<Vec<String>> {
        self.varied_edges().map(|edge| self.names_of_endpoints(edge)).collect()
    }

    /// Returns the links on which the laws of these robots send messages, with the parts of the messages that a lie can
    /// change.
    fn false_message_targets(&self) -> Vec<AffectedTarget> {
        let components = |edge: &Edge| match self.scenario.message_format(edge.from) {
            None => &[][..],
            Some(format) if format.is_bytes() => &[MESSAGE_BITS],
            Some(_) => &[MESSAGE_NUMBERS, MESSAGE_BITS],
        };
        self.varied_edges()
            .flat_map(|edge| {
                components(edge)
                    .iter()
                    .map(move |component| (self.names_of_endpoints(edge), *component))
            })
            .collect()
    }

    /// Returns the edges whose senders faults can affect.
    fn varied_edges(&self) -> impl Iterator<Item = &Edge> {
        let edges = self.scenario.graph.edges().iter();
        edges.filter(|edge| self.bounds.robots.contains(&edge.from))
    }

    /// Returns the names of the sender and the receiver of an edge.
    fn names_of_endpoints(&self, edge: &Edge) -> Vec<String> {
        [edge.from, edge.to].map(|robot| self.scenario.robots[robot].name.clone()).to_vec()
    }
}

/// Rounds to a multiple of 1 / `per_unit`.
pub(super) fn round_to_multiple(number: f64, per_unit: f64) -> f64 {
    // Avoids -0.
    (number * per_unit).round() / per_unit + 0.0
}

/// A gain that a hunt varies.
#[derive(Debug, Clone)]
struct VariedGain {
    /// Key in the syntax of `--set`.
    key: String,
    /// Value in the scenario.
    scenario_value: f64,
    /// Lowest and highest value.
    range: [f64; 2],
}

/// Range of a gain without one of its own.
const ANY_GAIN_RANGE: [f64; 2] = [0.0, f64::INFINITY];

/// Returns the groups of gains: one for each key of the laws, and those of the method.
fn gain_groups(scenario: &Scenario) -> Vec<Vec<VariedGain>> {
    let mut keys: Vec<&String> =
        scenario.robots.iter().flat_map(|robot| robot.gains.keys()).collect();
    keys.sort();
    keys.dedup();
    let of_laws = keys.into_iter().map(|key| {
        let gain = |robot: &Robot| {
            let range = robot.gain_ranges.iter().find(|(name, _)| name == key);
            Some(VariedGain {
                key: format!("robot.{}.{key}", robot.name),
                scenario_value: *robot.gains.get(key)?,
                range: range.map_or(ANY_GAIN_RANGE, |(_, range)| *range),
            })
        };
        scenario.robots.iter().filter_map(gain).collect()
    });
    let of_method = scenario.avoidance_method.gains.iter().filter_map(|gain| {
        let value = scenario.avoidance.gains.get(gain.key)?;
        Some(vec![VariedGain {
            key: format!("avoidance.{}", gain.key),
            scenario_value: *value,
            range: ANY_GAIN_RANGE,
        }])
    });
    of_laws.chain(of_method).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::borrow::Cow;
    use std::collections::{BTreeMap, BTreeSet};
    use std::path::Path;

    use formation::random::SplitMix64;
    use protocol::avoidance::AvoidanceDescription;
    use protocol::catalog::Catalog;
    use protocol::law::{LawDescription, Role};
    use protocol::law_message::{MessageArray, MessageFormat};

    use crate::scenario::read::{Overrides, read_text};

    static BID_ARRAYS: [MessageArray; 1] =
        [MessageArray { name: Cow::Borrowed("bid"), shape: Cow::Borrowed(&[]) }];
    static NUMBERS: MessageFormat =
        MessageFormat { bytes_max: 8, arrays: Cow::Borrowed(&BID_ARRAYS) };
    static BYTES: MessageFormat = MessageFormat::with_bytes(4);

    const THREE_LAWS: &str = r#"
name = "three-laws"
duration_s = 10.0
period_s = 0.02
[avoidance]
kind = "none"
distance_min_m = 0.2
speed_max_m_s = 0.5
[robot_defaults]
front_point_m = 0.1
[hunt]
kinds = ["lie"]
message_error_max = 2.0
[[robot]]
name = "r1"
law = "numbers"
hears = ["r2", "r3"]
pose = { x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }
[[robot]]
name = "r2"
law = "bytes"
hears = ["r1"]
pose = { x_m = 0.0, y_m = 1.0, heading_rad = 0.0 }
[[robot]]
name = "r3"
law = "silent"
hears = ["r1"]
pose = { x_m = 0.0, y_m = 2.0, heading_rad = 0.0 }
"#;

    fn catalog() -> Catalog {
        let law = |name, message| LawDescription {
            name,
            role: Role::FREE,
            source: "none",
            gain_keys: &[],
            gain_ranges: &[],
            feed_forward: false,
            correction_max: None,
            params: None,
            message_format: message,
            queued_messages_max: 0,
            may_withhold_beacon: false,
            signals: &[],
        };
        Catalog {
            laws: vec![
                law("numbers", Some(&NUMBERS)),
                law("bytes", Some(&BYTES)),
                law("silent", None),
            ],
            methods: vec![AvoidanceDescription {
                name: "none",
                ..AvoidanceDescription::NO_AVOIDANCE
            }],
        }
    }

    fn read(overrides: &Overrides) -> Scenario {
        let read = read_text(Path::new("three-laws.toml"), THREE_LAWS, overrides, &catalog());
        read.unwrap_or_else(|error| panic!("{overrides:?}: {}", error.render(false))).0
    }

    #[test]
    fn false_messages_are_drawn_for_laws_that_send_them() {
        let scenario = read(&Overrides::default());
        let space = SearchSpace::new(&scenario, &[VariedPart::Faults]).unwrap();
        let mut random = SplitMix64::new(1);
        let mut words: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
        for _ in 0..300 {
            let point: Vec<f64> =
                space.unchanged_point().iter().map(|_| random.draw_unit()).collect();
            let plan = space.maximize_faults(&space.decode_plan(&point));
            for plan in [&space.decode_plan(&point), &plan] {
                let faults = read(&plan.overrides(&scenario)).faults;
                assert!(faults.len() == plan.faults.len(), "{plan:?}");
            }
            for fault in plan.faults {
                let of_sender = words.entry(fault.target_names[0].clone()).or_default();
                of_sender.extend(fault.parameters.iter().map(|(word, _)| *word));
            }
        }
        let found: Vec<Vec<&str>> =
            words.into_values().map(|words| words.into_iter().collect()).collect();
        assert_eq!(
            found,
            [
                vec!["flips", "noise", "offset", "random", "scale", "turn"],
                vec!["flips", "random", "turn"],
                vec!["random", "turn"],
            ]
        );
    }

    #[test]
    fn false_messages_shrink_to_links_of_laws_that_send_them() {
        let scenario = read(&Overrides::default());
        let space = SearchSpace::new(&scenario, &[VariedPart::Faults]).unwrap();
        let fault = |target_component| PlannedFault {
            kind: "lie",
            target_names: vec![ALL_ROBOTS.to_owned(); 2],
            target_component,
            parameters: Vec::new(),
            start_ns: 0,
            duration_ns: None,
        };
        let targets = |component| space.single_targets(&fault(component)).len();
        assert_eq!((targets(""), targets(MESSAGE_BITS), targets(MESSAGE_NUMBERS)), (4, 3, 2));
    }
}
