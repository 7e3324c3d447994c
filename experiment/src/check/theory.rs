//! Theoretical analysis of a scenario: graph, matrices, bounds and distances. The text and the JSON of `phalanx check`
//! are generated from it. Equation numbers in parentheses refer to the chapter.

use formation::closest::{ClosestPair, closest_pair};
use formation::graph::Edge;
use formation::laplacian::{self, Matrix};
use formation::reachability::{Defects, Reachability};
use formation::rewiring::{ActiveRepair, Rewiring, SenderPurpose};
use formation::scale::Scale;
use protocol::avoidance::{DistanceGuarantee, MethodConditions};
use protocol::brief::{Pace, YieldPriority};
use protocol::law::Reference;
use serde::Serialize;

use super::braking::Braking;
use super::byzantine::LiarTolerance;
use super::finding::Finding;
use super::findings::{findings_of_settled_formation, findings_without_settled_formation};
use super::opening::Opening;
use super::start_front_points;
use super::steady::{FormationMotion, PeakSpeeds, SettledFormation};
use crate::prediction::{BrokenPrediction, BrokenRobot, FailurePredictor};
use crate::scenario::{Robot, Scenario};
use formation::ns_to_seconds;

/// Results of the analysis of a scenario. Rows and columns of matrices are robots in scenario order.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Theory<'s> {
    /// Name of the scenario.
    pub scenario: &'s str,
    /// Results for each robot.
    pub robots: Vec<RobotTheory<'s>>,
    /// Name of the main leader. `None` in a leaderless formation.
    pub leader: Option<&'s str>,
    /// Backup leaders of the main leader, in order of preference.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub deputies: Vec<&'s str>,
    /// Backup leaders of the secondary leaders.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub successions: Vec<Deputies<'s>>,
    /// Roots of the graph: robots whose information reaches all others.
    pub roots: Vec<&'s str>,
    /// Threshold for a broken robot: maximum distance from its slot in the planned formation, m.
    pub broken_m: f64,
    /// Predicted consequences of the permanent failure of each single robot, in scenario order.
    pub deaths: Vec<RobotFailure<'s>>,
    /// Single edges whose permanent failure disconnects or breaks a robot, or causes a repair.
    pub breaking_cuts: Vec<EdgeCut<'s>>,
    /// Robustness of the graph against Byzantine robots, if the scenario has any or uses a resilient law.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub liars: Option<LiarTolerance>,
    /// L, graph Laplacian (4)-(6).
    pub laplacian: Vec<Vec<f64>>,
    /// A = Lambda L + Gamma, system matrix (31).
    pub system: Vec<Vec<f64>>,
    /// Properties of the matrices.
    pub matrix: MatrixProperties,
    /// Maximum rates of the trajectory and of the offsets. `None` without a leader.
    pub trajectory: Option<TrajectoryRates>,
    /// Bounds on |alpha'| by Lemma 1. `None` unless there is a leader and all laws have feed-forward and a bounded
    /// correction.
    pub bounds: Option<SpeedBounds>,
    /// Strength of the repulsive field by each applicable rule.
    pub epsilon: Vec<EpsilonRule>,
    /// Smallest distances between robots.
    pub distances: RobotDistances<'s>,
    /// Parameters of a formation that opens and closes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closing: Option<ClosingParameters>,
    /// Distances from walls and obstacles, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub walls: Option<WallClearances<'s>>,
    /// Parameters of the collision avoidance.
    pub guard: AvoidanceParameters,
    /// Warnings. There are no errors, because a scenario with an error is not analyzed.
    pub findings: Vec<Finding>,
}

/// Results for one robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RobotTheory<'s> {
    /// Name of the robot.
    pub name: &'s str,
    /// Role by its control law: `leader`, `formation`, `contained`, ...
    pub role: &'static str,
    /// Description of the role.
    #[serde(skip)]
    pub does: &'static str,
    /// `true` for a contained robot.
    #[serde(skip)]
    pub contained: bool,
    /// `true` for a robot with a goal.
    #[serde(skip)]
    pub has_goal: bool,
    /// Whether its law alone decides where it goes.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_free: bool,
    /// Whether its motion is unknown: it is free, or follows a free robot. Then `settled_m` is relative to the start of
    /// that robot, and `peak` is zero.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_unknown: bool,
    /// Name of the robot's control law.
    pub law: &'s str,
    /// In-neighbors of the robot.
    pub hears: Vec<InNeighbor<'s>>,
    /// Backup neighbors, in order of preference.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub spares: Vec<InNeighbor<'s>>,
    /// Settled position at scale 1, m: in the leader's frame; without a leader in `map`, relative to the first root;
    /// for a robot with a goal, the goal.
    pub settled_m: [f64; 2],
    /// Maximum speeds needed to stay in its slot. Zero without a leader, and if the motion is unknown.
    pub peak: PeakSpeeds,
    /// Maximum speed that the robot's front point would need during the initial transient of the leader, and its
    /// time. `None` unless the start heading of the leader matters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transient: Option<TransientPeak>,
    /// Braking properties, if the robot has inertia.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub braking: Option<Braking>,
    /// Maximum speed of the rims of the robot's wheels, m/s. `None`: unlimited.
    pub rim_speed_max_m_s: Option<f64>,
}

/// Maximum speed that a robot would need while the leader turns into its path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TransientPeak {
    /// |alpha'|, speed of the front point, m/s.
    pub front_speed_m_s: f64,
    /// Time, s since the start.
    pub t_s: f64,
}

/// An in-neighbor or a backup neighbor of a robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InNeighbor<'s> {
    /// Name of the sender.
    pub robot: &'s str,
    /// c_ji, desired position relative to the sender, m. `None` for contained robots.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset_m: Option<[f64; 2]>,
    /// In-neighbor that this one replaces. `None` if it can replace any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instead_of: Option<&'s str>,
}

/// Backup leaders of a secondary leader.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Deputies<'s> {
    /// Name of the secondary leader.
    pub leader: &'s str,
    /// Names of the backup leaders, in order of preference. The first living one takes the slot.
    pub deputies: Vec<&'s str>,
}

impl<'s> Deputies<'s> {
    /// Returns the backup leaders of all secondary leaders that have any.
    fn collect_all(scenario: &'s Scenario) -> Vec<Deputies<'s>> {
        let name = |i: usize| scenario.robots[i].name.as_str();
        let named = scenario.repair_plan.successions.iter().map(|succession| Deputies {
            leader: name(succession.leader),
            deputies: succession.deputies.iter().map(|&i| name(i)).collect(),
        });
        named.collect()
    }
}

/// A topology repair: a backup neighbor replaces an in-neighbor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct TopologyRepair<'s> {
    /// Name of the receiving robot.
    pub robot: &'s str,
    /// Name of the replacement.
    pub by: &'s str,
    /// Name of the lost in-neighbor.
    pub instead_of: &'s str,
}

impl<'s> TopologyRepair<'s> {
    /// Returns all repairs after the robots `dead` have failed and the edges `cut` are down.
    fn repairs_after(
        analysis: &FailureAnalysis<'s>,
        dead: &[usize],
        cut_edges: &[usize],
    ) -> Vec<TopologyRepair<'s>> {
        let name = |robot: usize| analysis.scenario.robots[robot].name.as_str();
        let repairs = analysis.rewiring.active_repairs(dead, cut_edges).into_iter();
        let repair = |ActiveRepair { robot, substitute: by, lost_in_neighbor, .. }| {
            TopologyRepair { robot: name(robot), by: name(by), instead_of: name(lost_in_neighbor) }
        };
        repairs.map(repair).collect()
    }
}

/// Consequences of a permanent failure of a robot or an edge.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FailureConsequences<'s> {
    /// Names of the backup leaders that then lead.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub leading: Vec<&'s str>,
    /// Topology repairs that then take place.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub repairs: Vec<TopologyRepair<'s>>,
    /// Robots that lose their leader, their leaders' hull or their group.
    #[serde(flatten)]
    pub loss: Defects<&'s str>,
    /// Robots that end off their slots, with the causes.
    pub breaks: Vec<BrokenRobot<'s>>,
}

impl FailureConsequences<'_> {
    /// Returns whether there is any consequence.
    pub fn has_consequences(&self) -> bool {
        let FailureConsequences { leading, repairs, loss, breaks } = self;
        !(loss.is_empty() && breaks.is_empty() && repairs.is_empty() && leading.is_empty())
    }
}

/// Consequences of the failure of one robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RobotFailure<'s> {
    /// Name of the failed robot.
    pub robot: &'s str,
    /// Maximum error of a robot that keeps a slot until a backup leader leads, m. Detours around the failed robot are
    /// not included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_m: Option<f64>,
    /// Time after the failure at which contained robots with backup neighbors have reached their new positions, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settles_after_s: Option<f64>,
    /// Consequences of the failure.
    #[serde(flatten)]
    pub after: FailureConsequences<'s>,
}

/// Consequences of the failure of one edge.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EdgeCut<'s> {
    /// Name of the sender.
    pub from: &'s str,
    /// Name of the receiver.
    pub to: &'s str,
    /// Consequences of the failure.
    #[serde(flatten)]
    pub after: FailureConsequences<'s>,
}

/// Properties of A and of the velocity iteration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MatrixProperties {
    /// Smallest real part of an eigenvalue of A. 0 without a leader: A is then singular, and the formation has a shape,
    /// but no determined position.
    pub system_eigenvalue_min: f64,
    /// `true` if A is an M-matrix (Definition 3), and therefore invertible.
    pub m_matrix: bool,
    /// rho(A^-1), spectral radius. Lemma 1 uses its square root.
    pub inverse_radius: Option<f64>,
    /// |A^-1|_2, spectral norm.
    pub inverse_norm_2: Option<f64>,
    /// Spectral radius of the iteration by which robots learn each other's velocities, with a delay of one tick. Below
    /// 1 the velocities converge. Rows of laws without feed-forward are zero.
    pub iteration_radius: f64,
}

/// Maximum rates of the trajectory and of the offsets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrajectoryRates {
    /// eta_m, maximum |m'|, m/s.
    pub eta_m_m_s: f64,
    /// eta_c, maximum |C'_ji| over all offsets, with the turn rate w_n of a leader on its trajectory, m/s.
    pub eta_c_m_s: f64,
    /// End of the interval, from 0, over which both maxima are taken, s.
    pub horizon_s: f64,
    /// Heading of the path at the start, rad. `None` unless the leader starts with another heading that makes a robot
    /// faster until the leader has turned.
    pub tangent_rad: Option<f64>,
}

/// Bounds on |alpha'| of all robots stacked, while beta = 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedBounds {
    /// k*, maximum gain, m/s.
    pub k_m_s: f64,
    /// eta*, maximum of eta_m and eta_c, m/s.
    pub eta_m_s: f64,
    /// sqrt(rho(A^-1)) (k* sqrt(2 n) + eta* sqrt(n)), m/s, by Lemma 1 (39). It can be exceeded, because sqrt(rho) is
    /// not a norm.
    pub lemma_1_m_s: f64,
    /// |A^-1|_2 (k* sqrt(2 n) + eta* sqrt(n)), m/s. A valid bound by (38).
    pub norm_2_m_s: f64,
}

/// Strength of the repulsive field (11) by one rule of the chapter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EpsilonRule {
    /// Formula of the rule.
    pub rule: &'static str,
    /// Source in the chapter.
    pub source: &'static str,
    /// Strength by the rule, 1/s.
    pub epsilon_per_s: f64,
    /// Strength by the rule with the bound of the 2-norm in place of Lemma 1, 1/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epsilon_norm_2_per_s: Option<f64>,
}

/// Distance of two robots.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ClosestRobots<'s> {
    /// Names of the robots.
    pub robots: [&'s str; 2],
    /// Distance of the robots' front points, m.
    pub distance_m: f64,
}

/// Smallest distances between robots. `None` for a single robot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RobotDistances<'s> {
    /// d, minimum distance, m.
    pub distance_min_m: f64,
    /// Smallest distance of two front points at the start (Assumption 1: at least d).
    pub start: Option<ClosestRobots<'s>>,
    /// Smallest distance of two settled robots at the smallest scale (Remark 1: more than d; with `guard` more than
    /// d_f).
    pub settled: Option<ClosestRobots<'s>>,
    /// Smallest and largest scale.
    pub scale: [f64; 2],
}

/// Parameters of a formation that opens and closes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClosingParameters {
    /// Scale of the open formation.
    pub from: f64,
    /// Time for which the formation stays open, s.
    pub hold_s: f64,
    /// Duration of closing and of opening again, s.
    pub over_s: f64,
    /// Times at which the formation starts to open again, s.
    pub reopen_at_s: Vec<f64>,
    /// Time from which on the formation stays closed, s.
    pub closed_at_s: f64,
    /// Opening that slots, starts and speeds require.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub asked: Option<Opening>,
}

impl ClosingParameters {
    fn compute(scenario: &Scenario) -> Option<ClosingParameters> {
        let scale = scenario.scale()?;
        let Scale::Closing { from, hold_s, over_s, reopen_at_s } = scale.clone() else {
            return None;
        };
        let (closed_at_s, asked) = (scale.closing_end_s()?, Opening::compute(scenario));
        Some(ClosingParameters { from, hold_s, over_s, reopen_at_s, closed_at_s, asked })
    }
}

/// Parameters of the collision avoidance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AvoidanceParameters {
    /// `true` if d is guaranteed regardless of late, frozen or failed robots.
    pub on: bool,
    /// H, command lifetime in lockstep, s.
    pub lifetime_lockstep_s: f64,
    /// H, command lifetime in real time, s.
    pub lifetime_realtime_s: f64,
    /// Parts of H that allow for odometry and commands delayed by faults, s: in lockstep and in real time.
    pub late_s: [f64; 2],
    /// Distance within which robots are steered around each other, m (d_f of `guard`). `None`: never.
    pub deflection_distance_m: Option<f64>,
    /// Steering distance of followers, which yield to leaders, m. `None` without followers.
    pub following_distance_m: Option<f64>,
    /// Steering distance of contained robots, which yield to all others, m. `None` without contained robots.
    pub giving_way_distance_m: Option<f64>,
    /// Sensing radius, m.
    pub sensing_radius_m: f64,
    /// Minimum sensing radius that the method requires, m.
    pub sensing_radius_needed_m: f64,
    /// Width of the zone beyond d in which other robots slow a robot down, m. `None` without inertia.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slow_down_zone_m: Option<f64>,
    /// v_max, maximum speed, m/s. `None`: unlimited.
    pub speed_max_m_s: Option<f64>,
    /// v_max above which the method brakes more than a higher speed gains, m/s. `None` if there is none.
    pub speed_cap_m_s: Option<f64>,
}

impl AvoidanceParameters {
    fn compute(scenario: &Scenario) -> AvoidanceParameters {
        let (a, conditions, method) =
            (&scenario.avoidance, scenario.avoidance_conditions(), &scenario.avoidance_method);
        let lifetime_s = |pace| ns_to_seconds(scenario.command_lifetime_ns(pace));
        let first_of = |rank| (0..scenario.robots.len()).find(|&i| scenario.yield_rank(i) == rank);
        let steering_distances_m = scenario.steering_distances_m();
        let steers_within_m = |rank| Some(steering_distances_m.as_ref()?[first_of(rank)?]);
        let steers = method.steering_distance;
        let zone = method.slow_down_zone_m.filter(|_| a.braking_time_max_s > 0.0);
        AvoidanceParameters {
            on: method.distance_guarantee == DistanceGuarantee::Unconditional
                && scenario.missing_guarantee_reason().is_none(),
            lifetime_lockstep_s: lifetime_s(Pace::Lockstep),
            lifetime_realtime_s: lifetime_s(Pace::Realtime),
            late_s: [Pace::Lockstep, Pace::Realtime]
                .map(|pace| ns_to_seconds(scenario.command_delay_ns_max(pace))),
            deflection_distance_m: steers
                .map(|(_, m)| m(&MethodConditions { rank: YieldPriority::First, ..conditions })),
            giving_way_distance_m: steers_within_m(YieldPriority::Contained),
            following_distance_m: steers_within_m(YieldPriority::Follower),
            sensing_radius_m: a.sensing_radius_m,
            sensing_radius_needed_m: scenario.sensing_radius_needed_m(),
            slow_down_zone_m: zone.map(|m| m(&conditions)),
            speed_max_m_s: a.speed_max_m_s.is_finite().then_some(a.speed_max_m_s),
            speed_cap_m_s: method.useful_speed_max_m_s.map(|m_s| m_s(&conditions)),
        }
    }
}

/// Distances from walls and obstacles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WallClearances<'s> {
    /// Number of convex parts.
    pub parts: usize,
    /// Minimum distance that robots keep from them, m.
    pub clearance_m: f64,
    /// Distance within which robots are steered along them, m (c_f of `guard`). `None`: never.
    pub deflection_distance_m: Option<f64>,
    /// Smallest clearance at the start, m.
    pub start_m: f64,
    /// Names of the robot and of the wall or obstacle with this clearance.
    pub start: [&'s str; 2],
}

impl<'s> WallClearances<'s> {
    fn compute(scenario: &'s Scenario) -> Option<WallClearances<'s>> {
        let obstacles = scenario.obstacles();
        let starts = start_front_points(&scenario.robots).into_iter().zip(&scenario.robots);
        let near =
            starts.filter_map(|(start, robot)| Some((robot, obstacles.nearest_obstacle(start)?)));
        let (robot, near) = near.min_by(|a, b| a.1.distance_m.total_cmp(&b.1.distance_m))?;
        let steers = scenario.avoidance_method.wall_steering_distance;
        Some(WallClearances {
            parts: scenario.walls.len(),
            clearance_m: scenario.avoidance.clearance_m,
            deflection_distance_m: steers.map(|(_, m)| m(&scenario.avoidance_conditions())),
            start_m: near.distance_m,
            start: [&robot.name, &scenario.walls[near.index].name],
        })
    }
}

impl<'s> RobotDistances<'s> {
    fn compute(scenario: &'s Scenario, settled: &SettledFormation) -> RobotDistances<'s> {
        let name = |i: usize| scenario.robots[i].name.as_str();
        let gap = |closest: Option<ClosestPair>| {
            closest.map(|ClosestPair { pair, distance_m }| ClosestRobots {
                robots: pair.map(name),
                distance_m,
            })
        };
        RobotDistances {
            distance_min_m: scenario.avoidance.distance_min_m,
            start: gap(closest_pair(&start_front_points(&scenario.robots))),
            settled: gap(settled.closest_pair),
            scale: settled.scale_range,
        }
    }
}

/// Calculator of the consequences of single failures of robots and edges.
struct FailureAnalysis<'s> {
    scenario: &'s Scenario,
    rewiring: Rewiring,
    predictor: FailurePredictor,
    /// Reachability over the graph with the backup links in use.
    reachability_with_spares: Reachability,
    /// Indices of the edges whose cut disconnects or breaks a robot.
    breaking_edges: Vec<usize>,
}

impl<'s> FailureAnalysis<'s> {
    fn new(scenario: &'s Scenario, reachability: &Reachability) -> FailureAnalysis<'s> {
        let breaking =
            reachability.cuts_causing_defects().into_iter().map(|(edge, _)| edge).collect();
        let repaired = scenario.reachability_of(&scenario.graph_with_spares());
        let (rewiring, predictor) = (scenario.rewiring(), FailurePredictor::new(scenario));
        FailureAnalysis {
            scenario,
            rewiring,
            predictor,
            reachability_with_spares: repaired,
            breaking_edges: breaking,
        }
    }

    /// Returns the consequences of all single robot failures, in scenario order. `progress` gets the number of
    /// completed ones.
    fn single_robot_failures(&self, progress: &mut dyn FnMut(usize)) -> Vec<RobotFailure<'s>> {
        let (scenario, predictor) = (self.scenario, &self.predictor);
        let death = |(i, robot): (usize, &'s Robot)| {
            progress(i);
            let settles_after_s = || predictor.settling_time_s(&[i]);
            let is_planned = !scenario.repair_plan.substitutes.is_empty();
            let broken = predictor.broken_robots(&[i], &[], None);
            RobotFailure {
                robot: &robot.name,
                peak_m: predictor.peak_error_m(&[i], None),
                settles_after_s: is_planned.then(settles_after_s).flatten(),
                after: self.failure_consequences(
                    &[i],
                    &[],
                    self.defects_after_failures(&[i], &[]),
                    &broken,
                ),
            }
        };
        scenario.robots.iter().enumerate().map(death).collect()
    }

    /// Returns the consequences of the single link failures that have any, in edge order. `progress` gets the number of
    /// completed ones.
    fn breaking_cuts(&self, progress: &mut dyn FnMut(usize)) -> Vec<EdgeCut<'s>> {
        let name = |i: usize| self.scenario.robots[i].name.as_str();
        let cut_predictor = self.predictor.single_cut_predictor();
        let cut = |(edge, endpoints): (usize, &Edge)| {
            progress(edge);
            let loss = match self.breaking_edges.contains(&edge) {
                true => self.defects_after_failures(&[], &[edge]),
                false => Defects::default(),
            };
            let after =
                self.failure_consequences(&[], &[edge], loss, &cut_predictor.broken_by_cut(edge));
            EdgeCut { from: name(endpoints.from), to: name(endpoints.to), after }
        };
        let edges = self.scenario.graph.edges().iter().enumerate();
        edges.map(cut).filter(|cut| cut.after.has_consequences()).collect()
    }

    fn defects_after_failures(&self, dead: &[usize], cut_edges: &[usize]) -> Defects {
        let silent = [cut_edges, &self.rewiring.unused_links(dead, cut_edges)].concat();
        self.reachability_with_spares.new_defects_with_leaders(
            &self.leading_robots(dead, cut_edges),
            dead,
            &silent,
        )
    }

    fn leading_robots(&self, dead: &[usize], cut_edges: &[usize]) -> Vec<usize> {
        let deputies = &self.scenario.repair_plan.deputies;
        self.rewiring.leading_robots(self.scenario.leader(), deputies, dead, cut_edges)
    }

    fn failure_consequences(
        &self,
        dead: &[usize],
        cut_edges: &[usize],
        loss: Defects,
        broken: &[BrokenPrediction],
    ) -> FailureConsequences<'s> {
        let (scenario, leader) = (self.scenario, self.scenario.leader());
        let name = |i: usize| scenario.robots[i].name.as_str();
        let leading = self.leading_robots(dead, cut_edges).into_iter();
        FailureConsequences {
            leading: leading.filter(|&i| Some(i) != leader).map(name).collect(),
            repairs: TopologyRepair::repairs_after(self, dead, cut_edges),
            loss: loss.map_robots(|&i| name(i)),
            breaks: broken.iter().map(|broken| broken.with_names(&scenario.robots)).collect(),
        }
    }
}

impl<'s> Theory<'s> {
    /// Computes the theoretical analysis of a scenario without errors.
    pub fn compute(scenario: &'s Scenario) -> Theory<'s> {
        Theory::compute_with_progress(scenario, &mut |_, _| ())
    }

    /// Returns the same as [`Theory::compute`]. `progress` gets the number of single deaths and cuts computed so
    /// far, and the number of all.
    pub fn compute_with_progress(
        scenario: &'s Scenario,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Theory<'s> {
        let robots = &scenario.robots;
        let name = |i: usize| robots[i].name.as_str();
        let settled = SettledFormation::compute(scenario);
        let motion = FormationMotion::compute(scenario, &settled);
        let mut findings = findings_without_settled_formation(scenario);
        findings.extend(findings_of_settled_formation(scenario, &settled, motion.as_ref()));
        let leader = scenario.leader();
        let reachability = scenario.reachability();
        let system = match scenario.anchors_m().iter().all(Option::is_some) {
            // No robot needs the position of another.
            true => Matrix::identity(robots.len(), robots.len()),
            false => laplacian::formation_matrix(&scenario.graph_of_offsets(), leader),
        };
        let matrix = matrix_properties(scenario, &system);
        let bounds = motion.as_ref().and_then(|motion| speed_bounds(robots, &matrix, motion));
        let edges = scenario.graph.edges();
        let analysis = FailureAnalysis::new(scenario, &reachability);
        let all = robots.len() + edges.len();
        let deaths = analysis.single_robot_failures(&mut |done| progress(done, all));
        let breaking_cuts = analysis.breaking_cuts(&mut |done| progress(robots.len() + done, all));
        Theory {
            scenario: &scenario.name,
            robots: (0..robots.len())
                .map(|i| robot_theory(scenario, &analysis.rewiring, i, &settled, motion.as_ref()))
                .collect(),
            leader: leader.map(name),
            deputies: scenario.repair_plan.deputies.iter().map(|&i| name(i)).collect(),
            successions: Deputies::collect_all(scenario),
            roots: scenario.graph.roots().into_iter().map(name).collect(),
            broken_m: analysis.predictor.broken_threshold_m(),
            deaths,
            breaking_cuts,
            liars: LiarTolerance::compute(scenario),
            laplacian: matrix_rows(&laplacian::laplacian(&scenario.graph)),
            system: matrix_rows(&system),
            matrix,
            trajectory: motion.as_ref().map(|motion| TrajectoryRates {
                eta_m_m_s: motion.trajectory_speed_max_m_s,
                eta_c_m_s: motion.offset_rate_max_m_s,
                horizon_s: motion.horizon_s,
                tangent_rad: motion.transient.as_ref().map(|transient| transient.tangent_rad),
            }),
            bounds,
            epsilon: epsilon_rules(scenario, bounds),
            distances: RobotDistances::compute(scenario, &settled),
            closing: ClosingParameters::compute(scenario),
            walls: WallClearances::compute(scenario),
            guard: AvoidanceParameters::compute(scenario),
            findings,
        }
    }

    /// Returns the results as indented JSON with a newline at the end.
    pub fn to_json(&self) -> String {
        let text = serde_json::to_string_pretty(self);
        text.expect("a theory has string keys only") + "\n"
    }
}

fn robot_theory<'s>(
    scenario: &'s Scenario,
    rewiring: &Rewiring,
    i: usize,
    settled: &SettledFormation,
    motion: Option<&FormationMotion>,
) -> RobotTheory<'s> {
    let robot = &scenario.robots[i];
    let in_neighbor = |edge: &Edge| InNeighbor {
        robot: &scenario.robots[edge.from].name,
        offset_m: (robot.role.reference == Reference::Offsets).then(|| edge.offset_m.into()),
        instead_of: None,
    };
    let name = |robot: usize| scenario.robots[robot].name.as_str();
    let (receiver, incoming) = (rewiring.receiver(i), rewiring.incoming_links(i));
    let links_for = |purpose: SenderPurpose| {
        let senders = receiver.senders().iter().zip(incoming);
        senders.filter(move |(sender, _)| sender.purpose == purpose).map(|(_, &link)| link)
    };
    let substitute = |by: usize, lost: usize| InNeighbor {
        robot: name(by),
        offset_m: None,
        instead_of: Some(name(lost)),
    };
    let substitute_plans = receiver.substitutes().iter();
    let planned = substitute_plans
        .flat_map(|plan| plan.substitutes.iter().map(|&by| substitute(by, plan.lost_in_neighbor)));
    let successors = receiver.successions().iter().flat_map(|succession| {
        let better_deputies = succession.deputies.iter().copied().take_while(|&deputy| deputy != i);
        let own_senders =
            links_for(SenderPurpose::KeepLeaderSlot).map(|link| rewiring.links()[link].from);
        let by = better_deputies.chain(own_senders.filter(|_| succession.deputies.contains(&i)));
        by.map(|by| substitute(by, succession.leader)).collect::<Vec<_>>()
    });
    let planned: Vec<InNeighbor<'_>> = planned.chain(successors).collect();
    let spares = links_for(SenderPurpose::ReplaceAnyLost).map(|link| &rewiring.links()[link]);
    let at_rest = PeakSpeeds { rim_speed_m_s: robot.wheels.map(|_| 0.0), ..PeakSpeeds::default() };
    RobotTheory {
        name: &robot.name,
        role: robot.role.name,
        does: robot.role.verb_phrase,
        contained: robot.role.reference == Reference::NeighborMean,
        has_goal: robot.goal_m.is_some(),
        is_free: scenario.is_free(i),
        is_unknown: settled.is_unknown[i],
        law: &robot.law,
        hears: scenario.graph.incoming_edges(i).map(in_neighbor).collect(),
        spares: spares.map(in_neighbor).chain(planned).collect(),
        settled_m: settled.positions[i].into(),
        peak: motion.map_or(at_rest, |motion| motion.peak_speeds[i]),
        transient: motion.and_then(|motion| motion.transient.as_ref()).map(|transient| {
            let front_speed_m_s = transient.peak_speeds[i].front_speed_m_s;
            TransientPeak { front_speed_m_s, t_s: transient.peak_times_s[i][0] }
        }),
        braking: Braking::for_robot(scenario, i),
        rim_speed_max_m_s: robot.wheels.map(|wheels| wheels.speed_max_m_s),
    }
}

fn matrix_properties(scenario: &Scenario, system: &Matrix) -> MatrixProperties {
    let graph = &scenario.graph;
    let feed_forward: Vec<bool> = scenario.robots.iter().map(|r| r.uses_feed_forward).collect();
    let iteration_radius =
        laplacian::spectral_radius(&laplacian::velocity_iteration_matrix(graph, &feed_forward));
    // In a valid scenario the leader reaches all robots, so A is an M-matrix. Without a leader the vector of ones
    // solves A x = 0.
    let is_positioned =
        scenario.leader().is_some() || scenario.anchors_m().iter().all(Option::is_some);
    let Some(inverse_norm_2) = is_positioned.then(|| laplacian::inverse_norm_2(system)).flatten()
    else {
        return MatrixProperties {
            system_eigenvalue_min: 0.0,
            m_matrix: false,
            inverse_radius: None,
            inverse_norm_2: None,
            iteration_radius,
        };
    };
    let radius = if feed_forward.iter().all(|&uses| uses) {
        iteration_radius
    } else {
        let uses_neighbors = |robot: &Robot| !robot.role.reference.is_local();
        let uses_neighbors: Vec<bool> = scenario.robots.iter().map(uses_neighbors).collect();
        laplacian::spectral_radius(&laplacian::velocity_iteration_matrix(graph, &uses_neighbors))
    };
    MatrixProperties {
        system_eigenvalue_min: 1.0 - radius,
        m_matrix: radius < 1.0,
        inverse_radius: Some(1.0 / (1.0 - radius)),
        inverse_norm_2: Some(inverse_norm_2),
        iteration_radius,
    }
}

/// Returns the largest bound of a law's correction, m/s, or `None` if a law has no such bound.
fn correction_max_m_s(robots: &[Robot]) -> Option<f64> {
    let gains: Option<Vec<f64>> = robots.iter().map(|robot| robot.correction_max_m_s).collect();
    gains.map(|gains| gains.into_iter().fold(0.0, f64::max))
}

/// Returns the bounds by Lemma 1 and by the 2-norm, or `None` if Lemma 1 does not apply.
fn speed_bounds(
    robots: &[Robot],
    matrix: &MatrixProperties,
    motion: &FormationMotion,
) -> Option<SpeedBounds> {
    if !robots.iter().all(|robot| robot.uses_feed_forward) {
        return None;
    }
    let n = robots.len() as f64;
    let k = correction_max_m_s(robots)?;
    let eta = motion.trajectory_speed_max_m_s.max(motion.offset_rate_max_m_s);
    let right = k * (2.0 * n).sqrt() + eta * n.sqrt();
    Some(SpeedBounds {
        k_m_s: k,
        eta_m_s: eta,
        lemma_1_m_s: matrix.inverse_radius?.sqrt() * right, // (39)
        norm_2_m_s: matrix.inverse_norm_2? * right,         // (38)
    })
}

fn epsilon_rules(scenario: &Scenario, bounds: Option<SpeedBounds>) -> Vec<EpsilonRule> {
    let d = scenario.avoidance.distance_min_m;
    let by = |rules: &[(&'static str, f64, &'static str)], speed_m_s: f64, norm_2: Option<f64>| {
        let rules = rules.iter().map(|&(rule, factor, source)| EpsilonRule {
            rule,
            source,
            epsilon_per_s: factor * speed_m_s / d,
            epsilon_norm_2_per_s: norm_2.map(|norm_2_m_s| factor * norm_2_m_s / d),
        });
        rules.collect()
    };
    if let Some(SpeedBounds { lemma_1_m_s, norm_2_m_s, .. }) = bounds {
        let rules = [
            ("eta / d", 1.0, "Proposition 4, two robots"),
            ("2 eta / d", 2.0, "Propositions 5 and 6, more"),
            ("3 eta / d", 3.0, "simulations of 3.2 and 3.3"),
        ];
        return by(&rules, lemma_1_m_s, Some(norm_2_m_s));
    }
    let unit =
        |robot: &Robot| robot.role.reference == Reference::Offsets && !robot.uses_feed_forward;
    match correction_max_m_s(&scenario.robots).filter(|_| scenario.robots.iter().all(unit)) {
        Some(mu) => {
            let rules =
                [("6 mu / d", 6.0, "Proposition 2"), ("2 mu / d", 2.0, "simulation of 2.5")];
            by(&rules, mu, None)
        }
        None => Vec::new(),
    }
}

fn matrix_rows(matrix: &Matrix) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}
