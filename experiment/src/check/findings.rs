//! Checks of a scenario that produce errors and warnings.
//!
//! Single values are checked when they are parsed. These checks compare values with each other and with the theory.
//! They read no files and start no processes.

use std::borrow::Cow;
use std::f64::consts::PI;

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::drive::DriveKind;
use formation::graph::{Edge, FormationGraph};
use formation::laplacian::velocity_feedback_robots;
use formation::ns_to_seconds;
use formation::scale::Scale;
use protocol::avoidance::{AvoidanceWarning, DistanceGuarantee, RequiredSensing};
use protocol::brief::{AvoidanceBrief, Pace};
use protocol::law::Reference;
use protocol::message::PROXIMITY_MAX;
use protocol::number::{format_distinct, format_short};

use super::byzantine::check_liar_tolerance;
use super::cars::{check_car_crowd, check_path_curvatures};
use super::closed_cycles::{DependencyCycle, find_first_cycle};
use super::dead_ends::check_dead_ends;
use super::finding::{Finding, NAMES_MAX, error_finding, warning_finding};
use super::opening::{Opening, find_enclosed_slot};
use super::reversals::check_reversals;
use super::steady::{FormationMotion, PeakSpeeds, SettledFormation};
use super::team::check_team;
use super::{bisect_largest, format_rounded_down, format_rounded_up, start_front_points};
use crate::scenario::diagnostic::{Severity, format_list};
use crate::scenario::{Robot, Scenario};

/// Maximum closing error of the offsets around a cycle, m. It covers the rounding of decimals.
const CYCLE_CLOSING_ERROR_M_MAX: f64 = 1e-6;

/// Returns all errors and warnings, errors first.
pub fn check_scenario(scenario: &Scenario) -> Vec<Finding> {
    let mut findings = findings_without_settled_formation(scenario);
    // With errors there is no settled formation to check.
    if findings.iter().all(|finding| finding.severity != Severity::Error) {
        let settled = SettledFormation::compute(scenario);
        let motion = FormationMotion::compute(scenario, &settled);
        findings.extend(findings_of_settled_formation(scenario, &settled, motion.as_ref()));
    }
    findings.sort_by_key(|finding| finding.severity != Severity::Error);
    findings
}

/// Runs the checks that do not need the settled formation.
pub(super) fn findings_without_settled_formation(scenario: &Scenario) -> Vec<Finding> {
    let checks: [fn(&Scenario) -> Vec<Finding>; 14] = [
        check_in_neighbors_of_leaders,
        check_references,
        check_velocity_feedback,
        check_spare_cycles,
        check_liar_tolerance,
        check_offsets,
        check_speeds,
        check_start_distances,
        check_wall_support,
        check_start_clearances,
        check_sensing_radius,
        check_neighbor_count,
        avoidance_advice,
        check_team,
    ];
    checks.into_iter().flat_map(|check| check(scenario)).collect()
}

/// Runs the other checks of a scenario without errors.
pub(super) fn findings_of_settled_formation(
    scenario: &Scenario,
    settled: &SettledFormation,
    motion: Option<&FormationMotion>,
) -> Vec<Finding> {
    let mut findings = check_settled_distances(scenario, settled);
    findings.extend(check_scale_opening(scenario));
    findings.extend(check_goal_clearances(scenario));
    findings.extend(check_dead_ends(scenario));
    findings.extend(check_reversals(scenario));
    findings.extend(check_car_crowd(scenario));
    if let Some(motion) = motion {
        findings.extend(check_steady_speeds(scenario, motion));
        findings.extend(check_steady_wheel_speeds(scenario, motion));
        findings.extend(check_steady_turn_rates(scenario, motion));
        findings.extend(check_path_curvatures(scenario, motion));
        findings.extend(check_wall_passages(scenario, motion));
    }
    findings
}

/// Checks that no leader and no robot with a slot receives from a contained robot. P of (52) has a block of zeros
/// there.
fn check_in_neighbors_of_leaders(scenario: &Scenario) -> Vec<Finding> {
    let endpoints = |edge: &Edge| [edge.from, edge.to].map(|robot| &scenario.robots[robot]);
    let edges = scenario.formation_edges().map(|(index, edge)| (index, endpoints(edge)));
    let invalid = edges.filter(|(_, [from, _])| from.role.reference == Reference::NeighborMean);
    let finding = |(index, [from, to]): (usize, [&Robot; 2])| {
        let message = format!(
            "{} keeps a slot, but hears {}, which is contained and has none",
            to.name, from.name
        );
        let expected = "expected an in-neighbor that leads or keeps a slot (52)";
        error_finding(format!("edge.{index}.from"), message, expected)
    };
    invalid.map(finding).collect()
}

/// Checks that each robot is reached by a reference: a leader, or a common root (Assumptions 3 to 5).
fn check_references(scenario: &Scenario) -> Vec<Finding> {
    let robots = &scenario.robots;
    let has_goal = |robot: &&Robot| robot.goal_m.is_some();
    if let Some(goal_robot) = robots.iter().find(has_goal) {
        let is_other =
            |robot: &&Robot| !has_goal(robot) && robot.role.reference != Reference::LawTarget;
        let other = robots.iter().find(is_other);
        let finding = |other: &Robot| {
            let message = format!(
                "{} has a law that goes to a goal, but {} does not: goals and a formation cannot be combined",
                goal_robot.name, other.name
            );
            let expected = "expected a law that goes to a goal for all robots, or for none";
            error_finding(format!("robot.{}.law", other.name), message, expected)
        };
        return other.map(finding).into_iter().collect();
    }
    let reachability = scenario.reachability();
    let defects = reachability.defects_without_faults();
    if let Some(leader) = scenario.leader() {
        let leader = &robots[leader].name;
        let mut unreached =
            [&defects.unled[..], &defects.uncontained[..], &defects.adrift[..]].concat();
        unreached.sort_unstable();
        let finding = |robot: usize| {
            let name = &robots[robot].name;
            let message = format!("no information of the leader {leader} reaches {name}");
            let expected =
                format!("expected a path of edges from the leader {leader} (Assumptions 3 to 5)");
            error_finding(format!("robot.{name}"), message, expected)
        };
        return unreached.into_iter().map(finding).collect();
    }
    let names = |group: &Vec<usize>| {
        let names: Vec<&str> = group.iter().map(|&r| robots[r].name.as_str()).collect();
        format!("{{{}}}", format_list(&names, NAMES_MAX))
    };
    let mut findings = Vec::new();
    if let [_, second, ..] = &defects.groups[..] {
        let list: Vec<String> = defects.groups.iter().take(4).map(names).collect();
        findings.push(error_finding(
            format!("robot.{}", robots[second[0]].name),
            format!(
                "the formation graph has {} separate groups without in-edges from outside: {}",
                defects.groups.len(),
                list.join(" and ")
            ),
            format!("expected an edge from another group into {}", names(second)),
        ));
    }
    if let Some(&robot) = defects.uncontained.first() {
        let name = &robots[robot].name;
        let others = format_further_count(defects.uncontained.len(), "more");
        findings.push(error_finding(
            format!("robot.{name}"),
            format!(
                "{name} is contained{others}, but no robot that leads or keeps a slot reaches it"
            ),
            "expected a path of edges from a robot that leads or keeps a slot (Assumption 4)",
        ));
    }
    findings
}

/// Returns the number of further items as text, or "" if there is only one.
fn format_further_count(count: usize, what: &str) -> String {
    if count > 1 { format!(" (and {} {what})", count - 1) } else { String::new() }
}

/// Checks that velocity feedback between robots decays: the spectral radius of the iteration must be below 1.
fn check_velocity_feedback(scenario: &Scenario) -> Vec<Finding> {
    let feed_forward: Vec<bool> = scenario.robots.iter().map(|r| r.uses_feed_forward).collect();
    let graph = scenario.graph_of_offsets();
    let velocity_feedback_robots = velocity_feedback_robots(&graph, &feed_forward);
    let names: Vec<&str> =
        velocity_feedback_robots.iter().map(|&r| scenario.robots[r].name.as_str()).collect();
    let finding = |first: &&str| {
        error_finding(
            format!("robot.{first}"),
            format!(
                "{} use only the velocities of each other, so velocity feedback never decays: the spectral \
                 radius of the iteration is 1",
                format_list(&names, NAMES_MAX)
            ),
            "expected a leader's information to reach them, or a law without feed-forward: \
             `law = \"formation-unit\"` and `speed_m_s = 0.1` in place of their law and its gains; \
             `phalanx new NAME --from ring-6` writes such a scenario",
        )
    };
    names.first().map(finding).into_iter().collect()
}

/// Checks that backup neighbors create no closed cycle of robots that use only each other.
fn check_spare_cycles(scenario: &Scenario) -> Vec<Finding> {
    let name = |robot: usize| scenario.robots[robot].name.as_str();
    let finding = |DependencyCycle { failed_robot: dead, robot, spare }| {
        let [dead, robot, spare] = [dead, robot, spare].map(name);
        let cause = match scenario.leader() {
            Some(leader) => format!("the leader {} reaches neither", name(leader)),
            None => "their velocity feedback never decays".to_owned(),
        };
        error_finding(
            format!("robot.{robot}.spares"),
            format!(
                "after the failure of {dead}, {robot} uses its backup neighbor {spare}, which uses {robot}: \
                 {cause}"
            ),
            format!("expected a backup neighbor that does not use {robot} then"),
        )
    };
    find_first_cycle(scenario).map(finding).into_iter().collect()
}

/// Checks that offsets add up to zero around cycles. Otherwise the formation drifts away forever if the cycle is
/// directed, and settles at a mean that fits no offset if it is not.
fn check_offsets(scenario: &Scenario) -> Vec<Finding> {
    let graph = &scenario.graph;
    let reached = scenario.graph_with_spares().reachability();
    let offset_edges: Vec<(usize, &Edge)> = scenario.formation_edges().collect();
    let keeps_slot = |edge: &&Edge| scenario.robots[edge.to].role.reference == Reference::Offsets;
    let spares = scenario
        .repair_plan
        .spares
        .iter()
        .filter(keeps_slot)
        .map(|edge| (graph.edges().len(), edge));
    // Edges within strongly connected groups. Every cycle among them is a combination of directed ones.
    let in_cycles = offset_edges.iter().copied().chain(spares);
    let in_cycles = in_cycles.filter(|(_, edge)| reached[edge.to][edge.from]);
    let in_cycles: Vec<(usize, &Edge)> = in_cycles.collect();
    let find_open_cycle = |edges: &[(usize, &Edge)], what: &str| {
        let subgraph =
            FormationGraph::new(graph.robot_count(), edges.iter().map(|(_, e)| **e).collect());
        let (_, open_cycles) = subgraph.positions_from_offsets(CYCLE_CLOSING_ERROR_M_MAX);
        let cycle = open_cycles.first()?;
        let (index, edge) = edges[cycle.edge];
        let [from, to] = [edge.from, edge.to].map(|robot| &scenario.robots[robot].name);
        let error = format_short(cycle.closure_error_m);
        let is_spare = index == graph.edges().len();
        let path =
            if is_spare { format!("robot.{to}.spares") } else { format!("edge.{index}.offset_m") };
        Some(warning_finding(
            path,
            format!(
                "offsets around a {what} through {from} and {to} do not add up to zero: their sum is {error} m long"
            ),
            "expected offsets that add up to zero around every cycle",
        ))
    };
    let directed = find_open_cycle(&in_cycles, "directed cycle");
    let directed = directed.map(|finding| Finding { severity: Severity::Error, ..finding });
    directed.or_else(|| find_open_cycle(&offset_edges, "cycle")).into_iter().collect()
}

/// Checks that v_max T < ell, and that d keeps bodies apart.
fn check_speeds(scenario: &Scenario) -> Vec<Finding> {
    let period_s = ns_to_seconds(scenario.period_ns);
    let mut findings = Vec::new();
    let step_m = |robot: &Robot| robot.speed_max_m_s * period_s;
    let moves_too_far = |robot: &&Robot| {
        let step_m = step_m(robot);
        step_m.is_finite() && step_m >= robot.front_point_m && !robot.drive().turns_freely()
    };
    if let Some(robot) = scenario.robots.iter().find(moves_too_far) {
        let [step, ell] = format_distinct(step_m(robot), robot.front_point_m);
        let speed_max = format_short(robot.front_point_m / period_s);
        findings.push(error_finding(
            speed_limit_key(scenario, robot),
            format!(
                "in one period a front point can move {step} m, which must be less than the front point \
                 distance of {} ({ell} m)",
                robot.name
            ),
            format!("expected less than front_point_m / period_s = {speed_max} m/s"),
        ));
    }
    findings.extend(check_axle_turns(scenario));
    // From the front point to the far side of the body.
    let reach_m = |robot: &Robot| robot.front_point_m + robot.body_radius_m.unwrap_or(0.0);
    let is_narrow = |robot: &&Robot| 2.0 * robot.keep_m < 2.0 * reach_m(robot);
    if let Some(robot) = scenario.robots.iter().find(is_narrow) {
        let (key, distance_name) = match scenario.has_different_sizes() {
            true => (format!("robot.{}.keep_m", robot.name), "2 keep_m"),
            false => ("avoidance.distance_min_m".to_owned(), "d"),
        };
        let body = robot.body_radius_m.map_or(String::new(), |body_radius_m| {
            format!(", and its body reaches {} m from the axle", format_short(body_radius_m))
        });
        findings.push(warning_finding(
            key,
            format!(
                "{distance_name} = {} m keeps front points apart, but not bodies: the front point of {} is {} m \
                 ahead{body}",
                format_short(2.0 * robot.keep_m),
                robot.name,
                format_short(robot.front_point_m)
            ),
            format!("expected at least twice that, {} m", format_short(2.0 * reach_m(robot))),
        ));
    }
    findings
}

/// Returns the key that sets the speed limit of this robot.
fn speed_limit_key(scenario: &Scenario, robot: &Robot) -> String {
    match scenario.is_team() {
        true => format!("robot.{}.speed_max_m_s", robot.name),
        false => "avoidance.speed_max_m_s".to_owned(),
    }
}

/// Warns about robots without a front point that turn far within one command timeout, and refuses methods that need
/// one.
fn check_axle_turns(scenario: &Scenario) -> Vec<Finding> {
    let axles = || scenario.robots.iter().filter(|robot| robot.drive().turns_freely());
    let Some(first) = axles().next() else { return Vec::new() };
    if scenario.avoidance_method.needs_front_point {
        let method = scenario.avoidance_method.name;
        let point = match first.drive_kind {
            DriveKind::Differential | DriveKind::Ackermann => "its axle midpoint",
            DriveKind::Omni => "its center",
        };
        let message = format!(
            "avoidance \"{method}\" moves a front point, and {} is controlled at {point}",
            first.name
        );
        let expected = "expected a differential drive with `front_point_m` above 0, or another `kind`, such as \"guard\"";
        return vec![error_finding("avoidance.kind", message, expected)];
    }
    if scenario.avoidance_method.distance_guarantee != DistanceGuarantee::Unconditional {
        return Vec::new();
    }
    let lifetime_s = ns_to_seconds(scenario.command_lifetime_ns_max());
    let turn_rate = |robot: &Robot| robot.turn_rate_max_rad_s.unwrap_or_default();
    let mut axles = axles().filter(|robot| !robot.drive().is_car());
    let Some(first) = axles.next() else { return Vec::new() };
    let fastest = axles.fold(first, |a, b| if turn_rate(b) > turn_rate(a) { b } else { a });
    let turn_rad = turn_rate(fastest) * lifetime_s;
    let finding = || {
        let [turn, limit] = format_distinct(turn_rad, TURN_RAD_MAX);
        warning_finding(
            format!("robot.{}.turn_rate_max_rad_s", fastest.name),
            format!(
                "{} turns by up to {turn} rad within a command lifetime, more than {limit}: safe, but the guard \
                 will brake a lot",
                fastest.name
            ),
            format!(
                "expected at most {} rad/s, or a shorter H",
                format_short(TURN_RAD_MAX / lifetime_s)
            ),
        )
    };
    (turn_rad > TURN_RAD_MAX).then(finding).into_iter().collect()
}

/// Maximum turn within a command lifetime that does not widen the guard's cones much, rad.
const TURN_RAD_MAX: f64 = 0.5;

/// Checks that all front points start at least d apart (Assumption 1).
fn check_start_distances(scenario: &Scenario) -> Vec<Finding> {
    let severity = match scenario.avoidance_method.distance_guarantee {
        DistanceGuarantee::Unconditional => Severity::Error,
        DistanceGuarantee::UnderIdealAssumptions => Severity::Warning,
        DistanceGuarantee::NoGuarantee => return Vec::new(),
    };
    let starts = start_front_points(&scenario.robots);
    let by_pair = scenario.has_different_sizes();
    let closest = match by_pair {
        false => closest_pair(&starts),
        true => pair_with_least_margin(scenario, &starts),
    };
    let finding = |ClosestPair { pair, distance_m }| {
        let [a, b] = pair.map(|robot: usize| &scenario.robots[robot].name);
        let [distance, minimum] = format_distinct(distance_m, scenario.start_distance_min_m(pair));
        let message = format!("the front points of {a} and {b} start {distance} m apart");
        let key = match (by_pair, scenario.classes_sensed) {
            (false, _) => "`distance_min_m`",
            (true, true) => "the sum of their `keep_m`",
            (true, false) => "the larger `keep_m` of both and the largest of the team",
        };
        let expected = format!("expected at least {key}, {minimum} m (Assumption 1)");
        Finding { severity, ..warning_finding(format!("robot.{b}.pose"), message, expected) }
    };
    let too_close =
        |closest: &ClosestPair| closest.distance_m < scenario.start_distance_min_m(closest.pair);
    closest.filter(too_close).map(finding).into_iter().collect()
}

/// Returns the pair of robots with the smallest difference between distance and minimum distance.
fn pair_with_least_margin(scenario: &Scenario, points: &[Vec2]) -> Option<ClosestPair> {
    let pairs = (0..points.len()).flat_map(|j| (0..j).map(move |i| [i, j]));
    let pairs = pairs
        .map(|[i, j]| ClosestPair { pair: [i, j], distance_m: (points[i] - points[j]).norm() });
    let margin_m = |pair: &ClosestPair| pair.distance_m - scenario.start_distance_min_m(pair.pair);
    pairs.min_by(|a, b| margin_m(a).total_cmp(&margin_m(b)))
}

/// Warns if the method ignores walls, or if the clearance is smaller than a body.
fn check_wall_support(scenario: &Scenario) -> Vec<Finding> {
    if scenario.walls.is_empty() {
        return Vec::new();
    }
    if !scenario.avoidance_method.avoids_walls {
        let name = scenario.avoidance_method.name;
        return vec![warning_finding(
            "avoidance.kind",
            format!("avoidance \"{name}\" ignores walls: robots drive through them"),
            "expected `kind = \"guard\"`, or a scenario without walls",
        )];
    }
    let clearance_m = scenario.avoidance.clearance_m;
    let body_finding = |robot: &Robot| {
        let reach_m = robot.front_point_m + robot.body_radius_m?;
        let [clearance, reach] = format_distinct(clearance_m, reach_m);
        (clearance_m < reach_m).then(|| {
            warning_finding(
                "avoidance.clearance_m",
                format!(
                    "a clearance of {clearance} m keeps front points from walls, but not bodies: the body of \
                     {} reaches {reach} m from its front point",
                    robot.name
                ),
                format!("expected at least {reach} m"),
            )
        })
    };
    scenario.robots.iter().find_map(body_finding).into_iter().collect()
}

/// Returns the robots whose `points` are closer to a wall than `bound_m`: the robot, its distance and the bound as
/// distinct numbers, and the name of the wall.
fn robots_near_walls(
    scenario: &Scenario,
    points: Vec<Vec2>,
    bound_m: f64,
) -> Vec<(&Robot, [String; 2], &str)> {
    let walls = scenario.obstacles();
    let near = scenario.robots.iter().zip(points).filter_map(|(robot, point)| {
        let nearest =
            walls.nearest_obstacle(point).filter(|nearest| nearest.distance_m < bound_m)?;
        let wall = scenario.walls[nearest.index].name.as_str();
        Some((robot, format_distinct(nearest.distance_m, bound_m), wall))
    });
    near.collect()
}

/// Checks that all front points start at least the clearance away from walls.
fn check_start_clearances(scenario: &Scenario) -> Vec<Finding> {
    let is_guaranteed = scenario.avoidance_method.avoids_walls
        && scenario.avoidance_method.distance_guarantee == DistanceGuarantee::Unconditional;
    let severity = if is_guaranteed { Severity::Error } else { Severity::Warning };
    let starts = start_front_points(&scenario.robots);
    let near_robots =
        robots_near_walls(scenario, starts, scenario.avoidance.clearance_m).into_iter();
    near_robots
        .map(|(robot, [distance, minimum], wall)| {
            let message =
                format!("the front point of {} starts {distance} m from {wall}", robot.name);
            let expected = format!("expected at least `clearance_m`, {minimum} m");
            Finding {
                severity,
                ..warning_finding(format!("robot.{}.pose", robot.name), message, expected)
            }
        })
        .collect()
}

/// Warns about goals so close to a wall that avoidance steers the robot away.
fn check_goal_clearances(scenario: &Scenario) -> Vec<Finding> {
    let steering = scenario.avoidance_method.wall_steering_distance.zip(scenario.goals_m());
    let Some(((symbol, distance_m), goals)) = steering else { return Vec::new() };
    let near_robots =
        robots_near_walls(scenario, goals, distance_m(&scenario.avoidance_conditions()))
            .into_iter();
    near_robots.map(|(Robot { name, .. }, [distance, bound], wall)| {
        warning_finding(
            format!("robot.{name}.goal_m"),
            format!(
                "the goal of {name} is {distance} m from {wall}: avoidance steers it away from there"
            ),
            format!("expected more than {symbol} = {bound} m"),
        )
    })
    .collect()
}

/// Warns about slots and trajectories so close to a wall that avoidance steers the robot away.
fn check_wall_passages(scenario: &Scenario, motion: &FormationMotion) -> Vec<Finding> {
    let Some((symbol, distance_m)) = scenario.avoidance_method.wall_steering_distance else {
        return Vec::new();
    };
    let bound_m = distance_m(&scenario.avoidance_conditions());
    let passages = motion.wall_passages.iter().zip(&scenario.robots);
    let near_passages =
        passages.filter_map(|(passage, robot)| passage.map(|passage| (passage, robot)));
    let near_passages: Vec<_> =
        near_passages.filter(|(passage, _)| passage.distance_m < bound_m).collect();
    let (leaders, others): (Vec<_>, Vec<_>) =
        near_passages.into_iter().partition(|(_, robot)| robot.role.leads);
    let tightest = others.iter().min_by(|a, b| a.0.distance_m.total_cmp(&b.0.distance_m));
    leaders.iter()
        .chain(tightest)
        .map(|(passage, Robot { name, role, .. })| {
            let [distance, bound] = format_distinct(passage.distance_m, bound_m);
            let (wall, t) = (&scenario.walls[passage.wall].name, format_short(passage.t_s));
            let (path, what) = match role.leads {
                true => ("trajectory.points_m".to_owned(), "trajectory"),
                false => (format!("robot.{name}"), "slot"),
            };
            let more = match others.len() {
                n if n > 1 && !role.leads => format!(" ({} more are too close)", n - 1),
                _ => String::new(),
            };
            warning_finding(
                path,
                format!(
                    "the {what} of {name} is {distance} m from {wall} at {t} s: avoidance steers it away \
                     from there{more}"
                ),
                format!("expected more than {symbol} = {bound} m"),
            )
        })
        .collect()
}

/// Checks that the sensing radius is as large as the method requires.
fn check_sensing_radius(scenario: &Scenario) -> Vec<Finding> {
    let a = &scenario.avoidance;
    let needed_m = scenario.sensing_radius_needed_m();
    if a.sensing_radius_m >= needed_m {
        return Vec::new();
    }
    let [radius, needed] = format_distinct(a.sensing_radius_m, needed_m);
    let rounded = format_rounded_up(needed_m);
    let is_larger = rounded.parse().is_ok_and(|rounded_m: f64| rounded_m > a.sensing_radius_m);
    let needed = if is_larger { rounded } else { needed };
    vec![error_finding(
        "avoidance.sensing_radius_m",
        format!("`sensing_radius_m` is {radius}: the {} would sense other robots too late", a.kind),
        format!("expected at least {needed} m, or no such key"),
    )]
}

/// Warns if more robots fit within the required sensing radius than one proximity sample can hold. A robot whose sample
/// is truncated stops, because the positions of the omitted robots are missing. With v_max below the cap no such crowd
/// fits.
fn check_neighbor_count(scenario: &Scenario) -> Vec<Finding> {
    let neighbors_max = match scenario.avoidance_method.required_sensing {
        RequiredSensing::PositionsAndVelocities => PROXIMITY_MAX / 2,
        RequiredSensing::Positions | RequiredSensing::Nothing => PROXIMITY_MAX,
    };
    // Two of the smallest robots are d apart.
    let sizes_m = scenario.robots.iter().map(|robot| robot.keep_m);
    let d = 2.0 * sizes_m.fold(f64::INFINITY, f64::min);
    let radius_m = scenario.sensing_radius_needed_m();
    let fitting = point_count_max(radius_m, d) - 1.0;
    let others = scenario.robots.len().saturating_sub(1);
    let is_guaranteed =
        scenario.avoidance_method.distance_guarantee == DistanceGuarantee::Unconditional;
    if !is_guaranteed || others <= neighbors_max || fitting <= neighbors_max as f64 {
        return Vec::new();
    }
    let points = start_front_points(&scenario.robots);
    let neighbor_count = |point: &Vec2| {
        points.iter().filter(|other| (*other - point).norm() <= radius_m).count() - 1
    };
    let crowded: Vec<usize> =
        (0..points.len()).filter(|&i| neighbor_count(&points[i]) > neighbors_max).collect();
    let worst = crowded.iter().copied().max_by_key(|&i| neighbor_count(&points[i]));
    let message = match worst {
        Some(i) => format!(
            "{} of {} robots, {} foremost, start with more than {neighbors_max} others within {} m, but a proximity \
             sample holds {neighbors_max}: they stop, permanently if all do",
            crowded.len(),
            points.len(),
            scenario.robots[i].name,
            format_short(radius_m)
        ),
        None => format!(
            "up to {} robots at the distance d from each other fit within {} m, but a proximity sample holds \
             {neighbors_max}: a robot with more neighbors stops until some leave",
            fitting.min(others as f64).floor(),
            format_short(radius_m)
        ),
    };
    // The radius grows with v_max.
    let fits_at = |speed_max_m_s: f64| {
        let avoidance = AvoidanceBrief { speed_max_m_s, ..scenario.avoidance.clone() };
        let slower_robot = |robot: &Robot| Robot {
            speed_max_m_s: robot.speed_max_m_s.min(speed_max_m_s),
            ..robot.clone()
        };
        let robots = scenario.robots.iter().map(slower_robot).collect();
        let slower = Scenario { avoidance, robots, ..scenario.clone() };
        point_count_max(slower.sensing_radius_needed_m(), d) - 1.0 <= neighbors_max as f64
    };
    let speed_max_m_s = bisect_largest(scenario.avoidance.speed_max_m_s, fits_at);
    let expected = match speed_max_m_s > 0.0 {
        true => format!(
            "expected at most {} m/s, or {} robots",
            format_rounded_down(speed_max_m_s),
            neighbors_max + 1
        ),
        false => format!("expected {} robots at most", neighbors_max + 1),
    };
    vec![warning_finding("avoidance.speed_max_m_s", message, expected)]
}

/// Returns an upper bound on the number of points within `radius_m` of one of them, itself included, if all are at
/// least `separation_m` apart (Oler 1961, for a disc).
fn point_count_max(radius_m: f64, separation_m: f64) -> f64 {
    let radii = radius_m / separation_m;
    (2.0 / 3f64.sqrt() * PI * radii * radii + PI * radii + 1.0).floor()
}

/// Warns about settled positions so close that avoidance pushes the robots apart (Remark 1).
fn check_settled_distances(scenario: &Scenario, settled: &SettledFormation) -> Vec<Finding> {
    let Some((name, _)) = scenario.avoidance_method.steering_distance else { return Vec::new() };
    let steering_m = scenario.steering_distances_m().unwrap_or_default();
    let by_pair = scenario.has_different_sizes();
    let is_known = |pair: &[usize; 2]| pair.iter().all(|&robot| !scenario.is_free(robot));
    let pairs = (0..steering_m.len()).flat_map(|i| (0..i).map(move |j| [j, i]));
    let separations = pairs.filter(is_known).map(|[i, j]| {
        let distance_m =
            settled.scale_range[0] * (settled.positions[i] - settled.positions[j]).norm();
        let bound_m = match by_pair {
            true => scenario.pair_steering_distance_m([i, j]).unwrap_or_default(),
            false => steering_m[i].max(steering_m[j]),
        };
        ([i, j], distance_m, bound_m)
    });
    let tightest = separations
        .min_by(|(_, a, a_bound), (_, b, b_bound)| (a - a_bound).total_cmp(&(b - b_bound)));
    let finding = |([i, j], distance_m, bound_m): ([usize; 2], f64, f64)| {
        let [distance, bound] = format_distinct(distance_m, bound_m);
        let [a, b] = [i, j].map(|robot| &scenario.robots[robot].name);
        let mut edges = scenario.formation_edges();
        let direct = edges.find(|(_, e)| [e.from, e.to] == [i, j] || [e.from, e.to] == [j, i]);
        warning_finding(
            direct.map_or(format!("robot.{b}"), |(edge, _)| format!("edge.{edge}.offset_m")),
            format!(
                "in the settled formation {a} and {b} are {distance} m apart: avoidance keeps them from \
                 reaching it"
            ),
            format!("expected more than {name} = {bound} m (Remark 1)"),
        )
    };
    tightest
        .filter(|(_, distance_m, bound_m)| distance_m <= bound_m)
        .map(finding)
        .into_iter()
        .collect()
}

/// Warns about a formation with narrow gaps that does not open far or long enough while it forms.
fn check_scale_opening(scenario: &Scenario) -> Vec<Finding> {
    let steering = scenario.avoidance_method.steering_distance.zip(Opening::compute(scenario));
    let Some(((symbol, _), opening)) = steering else { return Vec::new() };
    match scenario.scale() {
        Some(scale @ &Scale::Closing { from, hold_s, .. }) => {
            let closed_s = scale.closing_end_s().unwrap_or_default();
            warn_opening_too_small(scenario, &opening, symbol, [from, hold_s, closed_s])
        }
        scale => {
            let smallest = scale.map_or(1.0, |scale| scale.value_range()[0]);
            warn_scale_never_opens(scenario, &opening, symbol, smallest).into_iter().collect()
        }
    }
}

/// Warns if the scale never opens the formation and its gaps at the smallest scale are too narrow for a late robot.
fn warn_scale_never_opens(
    scenario: &Scenario,
    opening: &Opening,
    symbol: &str,
    smallest: f64,
) -> Option<Finding> {
    // Robots do not stay closer than d_f in any case. The check of Remark 1 reports that.
    let gaps = 0.5 * opening.passage_m..opening.passage_m;
    let is_narrow = gaps.contains(&(smallest * opening.gap_m));
    let enclosed =
        is_narrow.then(|| find_enclosed_slot(scenario, opening.passage_m / smallest)).flatten()?;
    let name = &scenario.robots[enclosed].name;
    let [a, b] = opening.closest_pair_and_farthest.0.map(|robot| &scenario.robots[robot].name);
    let [gap, passage] = [smallest * opening.gap_m, opening.passage_m].map(format_short);
    let [from, hold, over] = [opening.from, opening.hold_s, opening.over_s].map(format_short);
    Some(warning_finding(
        format!("robot.{name}"),
        format!(
            "slots are {gap} m apart ({a} and {b}), less than 2 {symbol} = {passage} m: if {name} arrives \
             late, it may not get through between the others"
        ),
        format!(
            "expected `scale = {{ kind = \"closing\" }}`, which opens to {from} for {hold} s and closes in \
             {over} s, or wider gaps"
        ),
    ))
}

/// Warns about an opening that is too small, too short, or not over at the end of the run. Takes the scale, the open
/// time, s, and the time at which it has closed, s.
fn warn_opening_too_small(
    scenario: &Scenario,
    opening: &Opening,
    symbol: &str,
    [from, hold_s, closed_s]: [f64; 3],
) -> Vec<Finding> {
    let ([a, b], farthest) = opening.closest_pair_and_farthest;
    let [a, b, farthest] = [a, b, farthest].map(|robot| &scenario.robots[robot].name);
    let mut findings = Vec::new();
    if from * opening.gap_m < opening.passage_m {
        let [gap, passage] = [from * opening.gap_m, opening.passage_m].map(format_short);
        findings.push(warning_finding(
            "scale.from",
            format!(
                "in the open formation {a} and {b} are {gap} m apart, less than 2 {symbol} = {passage} m: no \
                 robot passes between them"
            ),
            format!("expected {} or more", format_short(opening.from)),
        ));
    }
    let travel_s = opening.way_m / opening.speed_m_s;
    if hold_s < travel_s {
        let [hold, travel, distance, speed] =
            [hold_s, travel_s, opening.way_m, opening.speed_m_s].map(format_short);
        findings.push(warning_finding(
            "scale.hold_s",
            format!(
                "the formation starts to close at {hold} s, but {farthest} needs {travel} s to reach its \
                 slot: {distance} m at {speed} m/s"
            ),
            format!("expected {} or more", format_short(opening.hold_s)),
        ));
    }
    let duration_s = ns_to_seconds(scenario.duration_ns);
    if closed_s > duration_s {
        let [closed, duration] = [closed_s, duration_s].map(format_short);
        findings.push(warning_finding(
            "scale",
            format!("the formation is closed at {closed} s, but the run ends at {duration} s"),
            "expected a longer run, or shorter times",
        ));
    }
    findings
}

/// Warns if a robot must be faster than v_max to stay in its slot.
fn check_steady_speeds(scenario: &Scenario, motion: &FormationMotion) -> Option<Finding> {
    if !scenario.avoidance_method.clamps_speed {
        return None;
    }
    let v_max = |robot: &Robot| Some(robot.speed_max_m_s);
    let front = |peak: &PeakSpeeds| Some(peak.front_speed_m_s);
    let (robot, speed_m_s, limit_m_s) =
        match find_worst_limit_excess(scenario, &motion.peak_speeds, front, v_max) {
            Some((fastest, _)) => fastest,
            None => return check_transient_speeds(scenario, motion, 0, "", front, v_max),
        };
    let [needed, limit] = format_distinct(speed_m_s, limit_m_s);
    Some(warning_finding(
        speed_limit_key(scenario, &scenario.robots[robot]),
        format!(
            "to stay in its slot {} must move at {needed} m/s, faster than the speed limit of {limit} m/s",
            scenario.robots[robot].name
        ),
        format!("expected more than {needed} m/s, or a slower trajectory"),
    ))
}

/// Warns if a wheel must be faster than its limit to stay in the slot.
fn check_steady_wheel_speeds(scenario: &Scenario, motion: &FormationMotion) -> Option<Finding> {
    let limit = |robot: &Robot| robot.wheels.map(|wheels| wheels.speed_max_m_s);
    let rim = |peak: &PeakSpeeds| peak.rim_speed_m_s;
    let Some((worst, exceeding)) =
        find_worst_limit_excess(scenario, &motion.peak_speeds, rim, limit)
    else {
        return check_transient_speeds(scenario, motion, 1, "a wheel of ", rim, limit);
    };
    let (robot, rim_m_s, limit_m_s) = worst;
    let name = &scenario.robots[robot].name;
    let others = format_further_count(exceeding, "more cannot follow");
    let [needed, limit] = format_distinct(rim_m_s, limit_m_s);
    Some(warning_finding(
        format!("robot.{name}.wheels.speed_max_m_s"),
        format!(
            "to stay in the slot, a wheel of {name} must move at {needed} m/s, faster than its limit \
             of {limit} m/s{others}"
        ),
        format!("expected more than {needed} m/s, or a slower trajectory"),
    ))
}

/// Warns if a robot at its axle midpoint must turn faster than w_max to stay in its slot: where its path is tight.
fn check_steady_turn_rates(scenario: &Scenario, motion: &FormationMotion) -> Option<Finding> {
    let limit = |robot: &Robot| {
        let is_turn_limited = robot.drive().moves_along_heading() && !robot.drive().is_car();
        is_turn_limited.then_some(robot.turn_rate_max_rad_s).flatten()
    };
    let turn = |peak: &PeakSpeeds| Some(peak.w_rad_s);
    let ((robot, turn_rad_s, limit_rad_s), exceeding) =
        find_worst_limit_excess(scenario, &motion.peak_speeds, turn, limit)?;
    let name = &scenario.robots[robot].name;
    let others = format_further_count(exceeding, "more leave theirs");
    let [needed, limit] = format_distinct(turn_rad_s, limit_rad_s);
    let t = format_short(motion.peak_times_s[robot][2]);
    Some(warning_finding(
        format!("robot.{name}.turn_rate_max_rad_s"),
        format!(
            "the slot of {name} turns at {needed} rad/s at {t} s, faster than the robot's limit of {limit} rad/s: \
             it leaves its slot there for a moment{others}"
        ),
        format!("expected more than {needed} rad/s, or a path with a wider turn"),
    ))
}

/// Returns the robot that exceeds its limit by the largest factor, its speed and the limit, m/s, and the number of
/// robots that exceed theirs.
fn find_worst_limit_excess(
    scenario: &Scenario,
    peaks: &[PeakSpeeds],
    speed_m_s: impl Fn(&PeakSpeeds) -> Option<f64>,
    limit_m_s: impl Fn(&Robot) -> Option<f64>,
) -> Option<((usize, f64, f64), usize)> {
    let robots = scenario.robots.iter().zip(peaks).enumerate();
    let limits =
        robots.filter_map(|(i, (robot, peak))| Some((i, speed_m_s(peak)?, limit_m_s(robot)?)));
    let exceeding: Vec<(usize, f64, f64)> =
        limits.filter(|(_, speed, limit)| speed > limit).collect();
    let excess = |&(_, speed, limit): &(usize, f64, f64)| speed / limit;
    let worst = exceeding.iter().copied().max_by(|a, b| excess(a).total_cmp(&excess(b)))?;
    Some((worst, exceeding.len()))
}

/// Warns about a robot that exceeds its limit only while the leader turns into its path. `peak_index` selects the
/// time of its peaks.
fn check_transient_speeds(
    scenario: &Scenario,
    motion: &FormationMotion,
    peak_index: usize,
    subject: &str,
    speed_m_s: impl Fn(&PeakSpeeds) -> Option<f64>,
    limit_m_s: impl Fn(&Robot) -> Option<f64>,
) -> Option<Finding> {
    let (transient, leader) = (motion.transient.as_ref()?, scenario.leader()?);
    let ((i, needed_m_s, limit), _) =
        find_worst_limit_excess(scenario, &transient.peak_speeds, &speed_m_s, limit_m_s)?;
    let leader = &scenario.robots[leader].name;
    let settled_m_s = speed_m_s(&motion.peak_speeds[i]).unwrap_or_default();
    let [needed, settled, limit, t] =
        [needed_m_s, settled_m_s, limit, transient.peak_times_s[i][peak_index]].map(format_short);
    Some(warning_finding(
        format!("robot.{leader}.pose.heading_rad"),
        format!(
            "while the leader {leader} turns into its path, {subject}{} would have to move at {needed} m/s at \
             {t} s to stay in its slot ({settled} m/s once settled), faster than its limit of {limit} m/s",
            scenario.robots[i].name
        ),
        format!(
            "expected heading_rad = {}, the tangent of its path at the start",
            format_short(transient.tangent_rad)
        ),
    ))
}

/// Returns the advice of the avoidance method for the first robot that needs any.
fn avoidance_advice(scenario: &Scenario) -> Vec<Finding> {
    let (advise, is_team) = (scenario.avoidance_method.find_warning, scenario.is_team());
    let briefs = scenario.avoidance_of_all(Pace::Realtime);
    let robot_finding = |(i, avoidance): (usize, &Cow<'_, AvoidanceBrief>)| {
        let AvoidanceWarning { key, message, expected_value } =
            advise(&scenario.conditions_of(i, avoidance))?;
        let name = &scenario.robots[i].name;
        let (key, message) = match is_team {
            true => (format!("robot.{name}.{key}"), format!("{name}: {message}")),
            false => (format!("avoidance.{key}"), message),
        };
        Some(warning_finding(key, message, expected_value))
    };
    briefs.iter().enumerate().find_map(robot_finding).into_iter().collect()
}
