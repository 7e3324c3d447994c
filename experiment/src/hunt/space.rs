//! Search space of a hunt. Each point of the unit cube is decoded to a run, so that any optimizer can be used.

use std::f64::consts::TAU;
use std::ops::Range;

use formation::Vec2;
use formation::closest::closest_pair;
use formation::front_point::{front_point, rotate};
use formation::portable_math;
use formation::pose::{Pose, wrap_angle};

use crate::check::start_points;
use crate::hunt::plan::{EVERY, Plan, PlannedFault, round_to_digits};
use crate::scenario::{HuntBounds, Robot, Scenario, Varied};

/// Number of significant digits of decoded numbers.
const SIGNIFICANT_DIGITS: usize = 3;
/// Maximum number of consecutive losses, messages.
const BURST_MAX: f64 = 20.0;

/// Search space of a hunt.
pub struct Space {
    scenario: Scenario,
    bounds: HuntBounds,
    /// Minimum distance of two front points at the start, m.
    separation_min_m: f64,
    /// Kinds of faults with the components that each can affect.
    kinds: Vec<(&'static str, Vec<Target>)>,
    /// Groups of gains with their keys and values. The gains of a group get the same factor.
    gains: Vec<Vec<(String, f64)>>,
}

/// Structure of the coordinates of a point.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Shape {
    /// For each coordinate, `true` if runs depend on it continuously.
    pub gradual: Vec<bool>,
    /// Groups of coordinates, such as the start of one robot or one fault.
    pub parts: Vec<Range<usize>>,
    /// Index of the coordinate that determines the number of faults.
    pub count: Option<usize>,
    /// Indices in `parts` of the faults. All have the same number of coordinates with the same meaning.
    pub faults: Range<usize>,
}

/// Affected robots of a fault, and the affected stream or sensor.
type Target = (Vec<String>, &'static str);

/// Error: the search space is empty.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("nothing would vary: {0}")]
pub struct EmptySpace(&'static str);

/// Reader of the coordinates of a point, in order.
struct Genes<'p> {
    point: &'p [f64],
    next_index: usize,
    /// For each coordinate, `true` if the result of a run depends on it continuously.
    gradual: Vec<bool>,
    matters: Vec<bool>,
    /// `true` if the run depends on the coordinates that are read next.
    count: bool,
    /// Ends of the groups of coordinates.
    group_ends: Vec<usize>,
}

impl Genes<'_> {
    fn new(point: &[f64]) -> Genes<'_> {
        Genes {
            point,
            next_index: 0,
            gradual: Vec::new(),
            matters: Vec::new(),
            count: true,
            group_ends: Vec::new(),
        }
    }

    fn next_gene(&mut self, gradual: bool) -> f64 {
        let gene = self.point.get(self.next_index).copied().unwrap_or(0.5);
        self.next_index += 1;
        self.gradual.push(gradual);
        self.matters.push(self.count);
        gene
    }

    /// Ends a group of coordinates.
    fn end(&mut self) {
        self.group_ends.push(self.next_index);
    }

    /// Reads a continuous coordinate from 0 to 1.
    fn read_unit_coordinate(&mut self) -> f64 {
        self.next_gene(true)
    }

    /// Reads a choice among `count` options.
    fn pick(&mut self, count: usize) -> usize {
        ((self.next_gene(false) * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Reads an optional amount: `None` for the lower half of the coordinate, growing from 0 to 1 over the upper half.
    fn read_optional_amount(&mut self) -> Option<f64> {
        let gene = self.read_unit_coordinate();
        (gene > 0.5).then_some(2.0 * gene - 1.0)
    }
}

impl Space {
    /// Creates the search space of a scenario in which `vary` varies.
    ///
    /// # Errors
    ///
    /// The space is empty.
    pub fn new(scenario: &Scenario, vary: &[Varied]) -> Result<Space, EmptySpace> {
        let bounds = HuntBounds { vary: vary.to_vec(), ..scenario.hunt.clone() };
        let own_m = closest_pair(&start_points(&scenario.robots))
            .map_or(f64::INFINITY, |pair| pair.distance_m);
        let mut space = Space {
            separation_min_m: bounds.separation_min_m.min(own_m),
            kinds: Vec::new(),
            gains: gains(scenario),
            scenario: scenario.clone(),
            bounds,
        };
        space.kinds = space.bounds.kinds.iter().map(|kind| (*kind, space.targets(kind))).collect();
        space.kinds.retain(|(_, targets)| !targets.is_empty());
        let only = |varied| space.bounds.vary == [varied];
        if space.bounds.vary.is_empty() {
            Err(EmptySpace("`vary` is empty"))
        } else if only(Varied::Gains) && space.gains.is_empty() {
            Err(EmptySpace("no law or method of the scenario has a gain"))
        } else if only(Varied::Faults) && space.kinds.is_empty() {
            Err(EmptySpace("no robot or link can have any of the `kinds` of faults"))
        } else {
            Ok(space)
        }
    }

    /// Returns the structure of the coordinates.
    pub fn coordinate_shape(&self) -> Shape {
        let mut genes = Genes::new(&[]);
        self.decode(&mut genes);
        let begins = [0].into_iter().chain(genes.group_ends.iter().copied());
        let parts = begins.zip(&genes.group_ends).map(|(begin, &end)| begin..end).collect();
        let count = self.place_of_count();
        let before = count
            .map_or(0, |count| genes.group_ends.iter().filter(|&&end| end <= count + 1).count());
        let faults = before..before + count.map_or(0, |_| self.bounds.faults_max);
        Shape { gradual: genes.gradual, parts, count, faults }
    }

    /// Returns for each coordinate of a point whether its run depends on it. It does not depend on the coordinates of
    /// unused faults.
    pub fn used_coordinates(&self, point: &[f64]) -> Vec<bool> {
        let mut genes = Genes::new(point);
        self.decode(&mut genes);
        genes.matters
    }

    /// Returns the point that decodes to the unchanged scenario, as far as the bounds allow.
    pub fn unchanged_point(&self) -> Vec<f64> {
        let mut point = vec![0.5; self.coordinate_shape().gradual.len()];
        if let Some(count) = self.place_of_count() {
            point[count] = 0.0;
        }
        point
    }

    /// Decodes a point to a run.
    pub fn plan(&self, point: &[f64]) -> Plan {
        self.decode(&mut Genes::new(point))
    }

    /// Returns the scenario that all runs are based on.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Returns the single links or robots that a fault can affect in place of `*`.
    pub(super) fn single_targets(&self, who: &[String]) -> Vec<Vec<String>> {
        match who {
            [_, _] => self.links(),
            _ => self.robots(),
        }
    }

    /// Returns whether faults can affect all robots.
    pub(super) fn can_affect_all(&self) -> bool {
        (0..self.scenario.robots.len()).all(|robot| self.bounds.robots.contains(&robot))
    }

    /// Returns the run with all its faults at their maximum strength.
    pub fn maximize_faults(&self, plan: &Plan) -> Plan {
        let faults = plan.faults.iter().map(|fault| self.strongest_fault(fault)).collect();
        Plan { faults, ..plan.clone() }
    }

    /// Returns the fault with the maximum duration, loss and delay within the bounds.
    pub(super) fn strongest_fault(&self, fault: &PlannedFault) -> PlannedFault {
        let HuntBounds { until_ns, loss_max, delay_ns_max, .. } = self.bounds;
        let mut strongest = fault.clone();
        if fault.kind != "kill" {
            let longest = |for_ns: u64| for_ns.max(until_ns.saturating_sub(fault.at_ns));
            strongest.for_ns = fault.for_ns.map(longest);
        }
        for (word, amount) in &mut strongest.amounts {
            match *word {
                "of" => *amount = Some(loss_max),
                "by" if fault.kind == "delay" => *amount = Some(formation::seconds(delay_ns_max)),
                _ => {}
            }
        }
        strongest
    }

    fn is_varied(&self, varied: Varied) -> bool {
        self.bounds.vary.contains(&varied)
    }

    fn place_of_count(&self) -> Option<usize> {
        let before =
            if self.is_varied(Varied::Starts) { 3 * self.scenario.robots.len() } else { 0 };
        (self.is_varied(Varied::Faults) && !self.kinds.is_empty()).then_some(before)
    }

    fn decode(&self, genes: &mut Genes<'_>) -> Plan {
        let mut plan = Plan::default();
        if self.is_varied(Varied::Starts) {
            plan.starts = self.starts(genes);
        }
        if self.is_varied(Varied::Faults) && !self.kinds.is_empty() {
            let count = genes.pick(self.bounds.faults_max + 1);
            genes.end();
            for fault in 0..self.bounds.faults_max {
                genes.count = fault < count;
                plan.faults.push(self.fault(genes));
                genes.end();
            }
            genes.count = true;
            plan.faults.truncate(count);
        }
        if self.is_varied(Varied::Delays) {
            plan.faults.extend(self.delays(genes));
        }
        if self.is_varied(Varied::Noise) {
            plan.faults.extend(self.noise(genes));
        }
        if self.is_varied(Varied::Gains) {
            for keys in &self.gains {
                let [least, most] = self.bounds.gain_factors;
                let factor = least * portable_math::pow(most / least, genes.read_unit_coordinate());
                genes.end();
                let gain = |(key, own): &(String, f64)| {
                    (key.clone(), round_to_digits(own * factor, SIGNIFICANT_DIGITS))
                };
                plan.gains.extend(keys.iter().map(gain));
            }
        }
        plan
    }

    /// Decodes the starts: each front point is in its box, moved toward its start in the scenario until it is far
    /// enough from others and clear of walls.
    fn starts(&self, genes: &mut Genes<'_>) -> Vec<(usize, Pose)> {
        let robots = &self.scenario.robots;
        let walls = self.scenario.obstacles();
        let clearance_m = self.scenario.avoidance.clearance_m;
        let mut points = start_points(robots);
        let mut starts = Vec::new();
        for (place, robot) in robots.iter().enumerate() {
            let own = points[place];
            let [x, y] =
                self.bounds.box_m.map(|side_m| side_m * (genes.read_unit_coordinate() - 0.5));
            let turn_rad = TAU * (genes.read_unit_coordinate() - 0.5);
            genes.end();
            let heading_rad =
                round_to_multiple(wrap_angle(robot.start.heading_rad + turn_rad), 1e3);
            let pose_at = |point: Vec2| {
                let ahead = robot.front_point_m * rotate(heading_rad, Vec2::x());
                let [x_m, y_m] =
                    [point.x - ahead.x, point.y - ahead.y].map(|m| round_to_multiple(m, 1e3));
                Pose { x_m, y_m, heading_rad }
            };
            let mut tries = (0..=10)
                .map(|tenths| pose_at(own + Vec2::new(x, y) * (1.0 - 0.1 * f64::from(tenths))));
            let free = tries.find(|pose| {
                let point = front_point(*pose, robot.front_point_m);
                let apart = |(other, at): (usize, &Vec2)| {
                    other == place || (at - point).norm() >= self.separation_min_m
                };
                points.iter().enumerate().all(apart)
                    && walls
                        .nearest_obstacle(point)
                        .is_none_or(|wall| wall.distance_m >= clearance_m)
            });
            // If there is no room, the start of the scenario is used.
            if let Some(pose) = free {
                points[place] = front_point(pose, robot.front_point_m);
                starts.push((place, pose));
            }
        }
        starts
    }

    fn fault(&self, genes: &mut Genes<'_>) -> PlannedFault {
        let (kind, targets) = &self.kinds[genes.pick(self.kinds.len())];
        let (who, what) = targets[genes.pick(targets.len())].clone();
        let [at, length, a, b] = [(); 4].map(|()| genes.read_unit_coordinate());
        let HuntBounds { from_ns, until_ns, .. } = self.bounds;
        let period_ns = self.scenario.period_ns;
        let latest_ns = until_ns.saturating_sub(period_ns).max(from_ns);
        let at_ns =
            self.ticks_ns(from_ns as f64 + at * (latest_ns - from_ns) as f64).min(latest_ns);
        let rest = (until_ns - at_ns) as f64 / period_ns as f64;
        let for_ns = self
            .ticks_ns(period_ns as f64 * portable_math::pow(rest.max(1.0), length))
            .max(period_ns);
        let amounts = self.fault_amounts(kind, what, [a, b]);
        // Half of the kills have no restart.
        let for_ns = (*kind != "kill" || a < 0.5).then_some(for_ns);
        PlannedFault { kind, who, what, amounts, at_ns, for_ns }
    }

    /// Returns the numbers of a fault, from two coordinates.
    fn fault_amounts(
        &self,
        kind: &str,
        what: &str,
        [a, b]: [f64; 2],
    ) -> Vec<(&'static str, Option<f64>)> {
        let seconds = |ns| Some(formation::seconds(ns));
        let (period_ns, d_m) = (self.scenario.period_ns, self.scenario.avoidance.distance_min_m);
        let loss = Some(round_to_digits(self.bounds.loss_max * a.max(0.01), 2));
        match kind {
            "slow" => vec![("by", seconds((period_ns / 10).max(1) * (1.0 + 15.0 * a) as u64))],
            "loss" => vec![("of", loss), ("burst", Some((1.0 + b * (BURST_MAX - 1.0)).floor()))],
            "bursts" => {
                vec![("of", loss), ("mean", seconds(period_ns * (1.0 + b * BURST_MAX) as u64))]
            }
            "fading" => vec![("range", Some(round_to_digits(d_m * (1.0 + 9.0 * a), 2)))],
            "delay" => {
                let by_ns = self.delay_ns(a);
                let jitter_ns = self.ticks_ns((2.0 * b - 1.0).max(0.0) * by_ns as f64);
                let jitter = (jitter_ns > 0).then(|| ("jitter", seconds(jitter_ns)));
                [("by", seconds(by_ns))].into_iter().chain(jitter).collect()
            }
            "noise" => {
                let by = round_to_digits(self.bounds.noise_m_max * a.max(0.01), 2);
                let heading =
                    round_to_digits(self.bounds.noise_heading_rad_max * (2.0 * b - 1.0), 2);
                let heading =
                    (what == "odometry" && heading > 0.0).then_some(("heading", Some(heading)));
                [("by", Some(by))].into_iter().chain(heading).collect()
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
    fn delays(&self, genes: &mut Genes<'_>) -> Vec<PlannedFault> {
        let mut faults = Vec::new();
        let links = !self.scenario.graph.edges().is_empty();
        for what in
            ["", "odometry", "commands"].into_iter().filter(|what| links || !what.is_empty())
        {
            let (delay, jitter, loss) = (
                genes.read_optional_amount(),
                genes.read_unit_coordinate(),
                genes.read_optional_amount(),
            );
            genes.end();
            let who = vec![EVERY.to_owned(); if what.is_empty() { 2 } else { 1 }];
            let drawn = [
                ("delay", delay.map(|share| [share, jitter])),
                ("loss", loss.map(|share| [share, 0.0])),
            ];
            faults.extend(drawn.into_iter().filter_map(|(kind, shares)| {
                let amounts = self.fault_amounts(kind, what, shares?);
                Some(PlannedFault { kind, who: who.clone(), what, amounts, at_ns: 0, for_ns: None })
            }));
        }
        faults
    }

    /// Decodes sensor errors over the whole run.
    fn noise(&self, genes: &mut Genes<'_>) -> Vec<PlannedFault> {
        let mut faults = Vec::new();
        for what in ["odometry", "proximity"] {
            let (position, heading) = (genes.read_optional_amount(), genes.read_unit_coordinate());
            genes.end();
            let Some(position) = position else { continue };
            let amounts = self.fault_amounts("noise", what, [position, heading]);
            let who = vec![EVERY.to_owned()];
            faults.push(PlannedFault { kind: "noise", who, what, amounts, at_ns: 0, for_ns: None });
        }
        faults
    }

    /// Returns a duration as a whole number of periods, ns.
    fn ticks_ns(&self, ns: f64) -> u64 {
        let period_ns = self.scenario.period_ns;
        (ns / period_ns as f64).round() as u64 * period_ns
    }

    fn delay_ns(&self, share: f64) -> u64 {
        let most_ns = self.bounds.delay_ns_max;
        self.ticks_ns(share * most_ns as f64).max(self.scenario.period_ns).min(most_ns)
    }

    fn targets(&self, kind: &str) -> Vec<Target> {
        let of_robots = |what: &'static str| self.robots().into_iter().map(move |who| (who, what));
        let links = || self.links().into_iter().map(|who| (who, ""));
        match kind {
            "cut" | "fading" | "lie" => links().collect(),
            "loss" | "bursts" | "delay" => {
                links().chain(of_robots("odometry")).chain(of_robots("commands")).collect()
            }
            "blackout" | "noise" => of_robots("odometry").chain(of_robots("proximity")).collect(),
            _ => of_robots("").collect(),
        }
    }

    /// Returns the robots that faults can affect, each as a target.
    fn robots(&self) -> Vec<Vec<String>> {
        self.bounds
            .robots
            .iter()
            .map(|&robot| vec![self.scenario.robots[robot].name.clone()])
            .collect()
    }

    /// Returns the links on which these robots send.
    fn links(&self) -> Vec<Vec<String>> {
        let edges = self.scenario.graph.edges().iter();
        let sent = edges.filter(|edge| self.bounds.robots.contains(&edge.from));
        let names =
            |robots: [usize; 2]| robots.map(|robot| self.scenario.robots[robot].name.clone());
        sent.map(|edge| names([edge.from, edge.to]).to_vec()).collect()
    }
}

/// Rounds to a multiple of 1 / `per_unit`.
pub(super) fn round_to_multiple(number: f64, in_one: f64) -> f64 {
    // Avoids -0.
    (number * in_one).round() / in_one + 0.0
}

/// Returns the groups of gains: one for each key of the laws, and those of the method.
fn gains(scenario: &Scenario) -> Vec<Vec<(String, f64)>> {
    let mut keys: Vec<&String> =
        scenario.robots.iter().flat_map(|robot| robot.gains.keys()).collect();
    keys.sort();
    keys.dedup();
    let of_laws = keys.into_iter().map(|key| {
        let gain =
            |robot: &Robot| Some((format!("robot.{}.{key}", robot.name), *robot.gains.get(key)?));
        scenario.robots.iter().filter_map(gain).collect()
    });
    let of_method = scenario.method.gains.iter().filter_map(|gain| {
        let own = scenario.avoidance.gains.get(gain.key)?;
        Some(vec![(format!("avoidance.{}", gain.key), *own)])
    });
    of_laws.chain(of_method).collect()
}
