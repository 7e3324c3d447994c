//! What is wrong with a scenario, or worth knowing.
//!
//! Single values are checked where they are read. Here they are held against each other and
//! against the theory. Nothing is read or spawned.

use std::f64::consts::PI;

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::graph::{Edge, FormationGraph};
use formation::laplacian::echoing;
use protocol::avoidance::{Advice, Promise, Senses};
use protocol::brief::AvoidanceBrief;
use protocol::law::Reference;
use protocol::message::PROXIMITY_MAX;
use protocol::number::{short, told_apart};
use serde::Serialize;

use super::opening::{Opening, locked_out};
use super::steady::{Motion, Peak, Settled};
use super::{rounded_down, rounded_up, start_points};
use crate::scenario::diagnostic::Severity;
use crate::scenario::{Robot, Scenario};
use formation::scale::Scale;
use formation::seconds;

/// Offsets around a cycle may miss by this much, m: rounding of decimals, and no more.
const OFFSET_GAP_M_MAX: f64 = 1e-6;

/// Something about a scenario that is wrong, or worth knowing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Whether it can be run all the same.
    pub severity: Severity,
    /// What is wrong, with the offending values.
    pub message: String,
    /// What was expected instead.
    pub expected: String,
    /// The key that says so, as in `avoidance.kind`, `robot.r1.pose` or `edge.0.offset_m`.
    pub path: String,
}

/// All that is wrong or worth knowing, errors first.
pub fn check(scenario: &Scenario) -> Vec<Finding> {
    let mut findings = unsettled(scenario);
    // A formation that never settles has nothing to be measured.
    if findings.iter().all(|finding| finding.severity != Severity::Error) {
        let settled = Settled::of(scenario);
        let motion = Motion::of(scenario, &settled);
        findings.extend(once_settled(scenario, &settled, motion.as_ref()));
    }
    findings.sort_by_key(|finding| finding.severity != Severity::Error);
    findings
}

/// What can be found without knowing where the robots settle.
pub(super) fn unsettled(scenario: &Scenario) -> Vec<Finding> {
    let mut findings = Vec::new();
    leaders_hear_leaders(scenario, &mut findings);
    references(scenario, &mut findings);
    echoes(scenario, &mut findings);
    offsets(scenario, &mut findings);
    speeds(scenario, &mut findings);
    ramps(scenario, &mut findings);
    start_distances(scenario, &mut findings);
    walls_minded(scenario, &mut findings);
    start_clearances(scenario, &mut findings);
    sensing(scenario, &mut findings);
    crowds(scenario, &mut findings);
    advice(scenario, &mut findings);
    findings
}

/// The rest, of a scenario without errors.
pub(super) fn once_settled(
    scenario: &Scenario,
    settled: &Settled,
    motion: Option<&Motion>,
) -> Vec<Finding> {
    let mut findings = Vec::new();
    settled_distances(scenario, settled, &mut findings);
    openings(scenario, &mut findings);
    goals(scenario, &mut findings);
    if let Some(motion) = motion {
        steady_speeds(scenario, motion, &mut findings);
        steady_wheels(scenario, motion, &mut findings);
        passages(scenario, motion, &mut findings);
    }
    findings
}

fn finding(
    severity: Severity,
    path: impl Into<String>,
    message: String,
    expected: impl Into<String>,
) -> Finding {
    Finding { severity, message, expected: expected.into(), path: path.into() }
}

/// Nobody that leads or keeps a place hears a contained robot: P of (52) has a block of zeros there.
fn leaders_hear_leaders(scenario: &Scenario, findings: &mut Vec<Finding>) {
    for (index, edge) in scenario.formation_edges() {
        let (from, to) = (&scenario.robots[edge.from], &scenario.robots[edge.to]);
        if from.role.reference == Reference::Middle {
            findings.push(finding(
                Severity::Error,
                format!("edge.{index}.from"),
                format!(
                    "{} keeps a place, but is to hear {}, which is contained and has none",
                    to.name, from.name
                ),
                "expected a robot that leads or keeps a place itself (52)",
            ));
        }
    }
}

/// Everybody must have what it goes by. (Assumptions 3 to 5)
fn references(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let goes = |robot: &&Robot| robot.goal_m.is_some();
    if let Some(goer) = scenario.robots.iter().find(goes) {
        if let Some(other) = scenario.robots.iter().find(|robot| !goes(robot)) {
            findings.push(finding(
                Severity::Error,
                format!("robot.{}.law", other.name),
                format!(
                    "{} goes to a goal, and {} does not: nobody can say where a formation beside it \
                     is to be",
                    goer.name, other.name
                ),
                "expected a law that goes to a goal for all robots, or for none",
            ));
        }
        return;
    }
    let reachability = scenario.reachability();
    let standing = reachability.intact();
    let robots = &scenario.robots;
    if let Some(leader) = scenario.leader() {
        let leader = &robots[leader].name;
        let mut unreached =
            [&standing.unled[..], &standing.uncontained[..], &standing.adrift[..]].concat();
        unreached.sort_unstable();
        for robot in unreached {
            let name = &robots[robot].name;
            findings.push(finding(
                Severity::Error,
                format!("robot.{name}"),
                format!("nothing that {leader} says ever reaches {name}"),
                format!("expected a path of edges from the leader {leader} (Assumptions 3 to 5)"),
            ));
        }
        return;
    }
    let names = |group: &[usize]| {
        let shown: Vec<&str> = group.iter().take(6).map(|&r| robots[r].name.as_str()).collect();
        let more = if group.len() > 6 { ", ..." } else { "" };
        format!("{{{}{more}}}", shown.join(", "))
    };
    if let [_, second, ..] = &standing.groups[..] {
        let list: Vec<String> = standing.groups.iter().take(4).map(|group| names(group)).collect();
        findings.push(finding(
            Severity::Error,
            format!("robot.{}", robots[second[0]].name),
            format!(
                "the formation falls apart: {} groups hear nobody outside: {}",
                standing.groups.len(),
                list.join(" and ")
            ),
            format!("expected an edge from another group into {}", names(second)),
        ));
    }
    if let Some(&robot) = standing.uncontained.first() {
        let name = &robots[robot].name;
        let others = match standing.uncontained.len() {
            1 => String::new(),
            n => format!(" (and {} more)", n - 1),
        };
        findings.push(finding(
            Severity::Error,
            format!("robot.{name}"),
            format!(
                "{name} is contained{others}, but nothing ever reaches it from anybody who leads \
                 or keeps a place"
            ),
            "expected a path of edges from a robot that leads or keeps a place (Assumption 4)",
        ));
    }
}

/// The velocities that robots learn from each other must die out: a radius of the iteration below
/// 1.
fn echoes(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let feed_forward: Vec<bool> = scenario.robots.iter().map(|r| r.feed_forward).collect();
    let echoing = echoing(&scenario.graph, &feed_forward);
    if let Some(&first) = echoing.first() {
        let names: Vec<&str> =
            echoing.iter().take(6).map(|&r| scenario.robots[r].name.as_str()).collect();
        let more = if echoing.len() > 6 { ", ..." } else { "" };
        findings.push(finding(
            Severity::Error,
            format!("robot.{}", scenario.robots[first].name),
            format!(
                "{}{more} go only by the velocities of each other, which never die out: the \
                 iteration's spectral radius is 1",
                names.join(", ")
            ),
            "expected a leader's information to reach them, or a law without feed-forward, such as \
             formation-unit",
        ));
    }
}

/// Offsets must close: around a directed cycle the formation would walk away for ever, around
/// any other the robots settle for a mean that fits no offset.
fn offsets(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let graph = &scenario.graph;
    let reached = graph.reachability();
    // Edges within groups that hear each other: every cycle among them is made of directed ones.
    let within: Vec<usize> = scenario
        .formation_edges()
        .filter(|(_, edge)| reached[edge.to][edge.from])
        .map(|(e, _)| e)
        .collect();
    let directed =
        FormationGraph::new(graph.robots(), within.iter().map(|&e| graph.edges()[e]).collect());
    let mut say = |edge: usize, gap_m: f64, severity, what: &str| {
        let ends = graph.edges()[edge];
        findings.push(finding(
            severity,
            format!("edge.{edge}.offset_m"),
            format!(
                "offsets around a {what} through {} and {} do not close: they miss by {} m",
                scenario.robots[ends.from].name,
                scenario.robots[ends.to].name,
                short(gap_m)
            ),
            "expected offsets that add up to zero around every cycle",
        ));
    };
    let (_, open) = directed.shape(OFFSET_GAP_M_MAX);
    if let Some(cycle) = open.first() {
        say(within[cycle.edge], cycle.gap_m, Severity::Error, "directed cycle");
        return;
    }
    let kept: Vec<(usize, &Edge)> = scenario.formation_edges().collect();
    let rigid = FormationGraph::new(graph.robots(), kept.iter().map(|(_, e)| **e).collect());
    let (_, open) = rigid.shape(OFFSET_GAP_M_MAX);
    if let Some(cycle) = open.first() {
        say(kept[cycle.edge].0, cycle.gap_m, Severity::Warning, "cycle");
    }
}

/// v_max T < ell, and front points nearer to the axle than d/2.
fn speeds(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let a = &scenario.avoidance;
    let d = a.distance_min_m;
    if a.speed_max_m_s.is_finite() {
        let step_m = a.speed_max_m_s * seconds(scenario.period_ns);
        if let Some(robot) = scenario.robots.iter().find(|robot| step_m >= robot.front_point_m) {
            let [step, ell] = told_apart(step_m, robot.front_point_m);
            findings.push(finding(
                Severity::Error,
                "avoidance.speed_max_m_s",
                format!(
                    "in one period a front point may move {step} m, no less than it lies ahead of \
                     the axle of {} ({ell} m)",
                    robot.name
                ),
                format!(
                    "expected less than front_point_m / period_s = {} m/s",
                    short(robot.front_point_m / seconds(scenario.period_ns))
                ),
            ));
        }
    }
    // From the front point to the far side of the body.
    let reach_m = |robot: &Robot| robot.front_point_m + robot.body_radius_m.unwrap_or(0.0);
    if let Some(robot) = scenario.robots.iter().find(|robot| d < 2.0 * reach_m(robot)) {
        let body = robot.body_radius_m.map_or(String::new(), |body_radius_m| {
            format!(", and its body reaches {} m from the axle", short(body_radius_m))
        });
        findings.push(finding(
            Severity::Warning,
            "avoidance.distance_min_m",
            format!(
                "d = {} m keeps front points apart, but not bodies: that of {} is {} m ahead{body}",
                short(d),
                robot.name,
                short(robot.front_point_m)
            ),
            format!("expected at least twice that, {} m", short(2.0 * reach_m(robot))),
        ));
    }
}

/// Wheels whose speed and turn rate do not change together leave the segment that the guard certifies.
fn ramps(scenario: &Scenario, findings: &mut Vec<Finding>) {
    if scenario.method.promise != Promise::Always {
        return;
    }
    if let Some(name) = scenario.voids_the_promise() {
        findings.push(finding(
            Severity::Warning,
            format!("robot.{name}.limits"),
            format!(
                "speed and turn rate of {name} change independently: the {} promises nothing then",
                scenario.method.name
            ),
            "expected `ramp = \"together\"`: both arrive at the same time",
        ));
    }
}

/// Assumption 1: all start at least d apart.
fn start_distances(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let severity = match scenario.method.promise {
        Promise::Always => Severity::Error,
        Promise::Ideal => Severity::Warning,
        Promise::Nothing => return,
    };
    let d = scenario.avoidance.distance_min_m;
    if let Some(ClosestPair { pair: [i, j], distance_m }) =
        closest_pair(&start_points(&scenario.robots))
        && distance_m < d
    {
        let (a, b) = (&scenario.robots[i].name, &scenario.robots[j].name);
        let [distance, least] = told_apart(distance_m, d);
        findings.push(finding(
            severity,
            format!("robot.{b}.pose"),
            format!("the front points of {a} and {b} start {distance} m apart"),
            format!("expected at least `distance_min_m`, {least} m (Assumption 1)"),
        ));
    }
}

/// A method that knows nothing of walls leads through them; and bodies are larger than points.
fn walls_minded(scenario: &Scenario, findings: &mut Vec<Finding>) {
    if scenario.walls.is_empty() {
        return;
    }
    if !scenario.method.minds_walls {
        findings.push(finding(
            Severity::Warning,
            "avoidance.kind",
            format!(
                "avoidance \"{}\" knows nothing of walls: robots drive through them",
                scenario.method.name
            ),
            "expected `kind = \"guard\"`, or a scenario without walls",
        ));
        return;
    }
    let clearance_m = scenario.avoidance.clearance_m;
    let reach_m = |robot: &Robot| Some(robot.front_point_m + robot.body_radius_m?);
    let wide = |robot: &&Robot| reach_m(robot).is_some_and(|reach_m| clearance_m < reach_m);
    if let Some(robot) = scenario.robots.iter().find(wide) {
        let [clearance, reach] = told_apart(clearance_m, reach_m(robot).unwrap_or_default());
        findings.push(finding(
            Severity::Warning,
            "avoidance.clearance_m",
            format!(
                "a clearance of {clearance} m keeps front points from walls, but not bodies: that of {} \
                 reaches {reach} m from its front point",
                robot.name
            ),
            format!("expected at least {reach} m"),
        ));
    }
}

/// All start as far from walls as they are to stay.
fn start_clearances(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let (walls, clearance_m) = (scenario.obstacles(), scenario.avoidance.clearance_m);
    let promised = scenario.method.minds_walls && scenario.method.promise == Promise::Always;
    let severity = if promised { Severity::Error } else { Severity::Warning };
    let starts = start_points(&scenario.robots).into_iter().zip(&scenario.robots);
    let near = starts.filter_map(|(start, robot)| walls.nearest(start).map(|near| (robot, near)));
    for (robot, near) in near.filter(|(_, near)| near.distance_m < clearance_m) {
        let [distance, least] = told_apart(near.distance_m, clearance_m);
        let wall = &scenario.walls[near.place].name;
        findings.push(finding(
            severity,
            format!("robot.{}.pose", robot.name),
            format!("the front point of {} starts {distance} m from {wall}", robot.name),
            format!("expected at least `clearance_m`, {least} m"),
        ));
    }
}

/// Nobody is led away from its goal by a wall.
fn goals(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let (Some((name, distance_m)), Some(goals)) =
        (scenario.method.steers_beside_walls, scenario.goals_m())
    else {
        return;
    };
    let (bound_m, walls) = (distance_m(&scenario.conditions()), scenario.obstacles());
    let near = scenario.robots.iter().zip(goals).filter_map(|(robot, goal)| {
        walls.nearest(goal).filter(|near| near.distance_m < bound_m).map(|near| (robot, near))
    });
    for (robot, near) in near {
        let [distance, bound] = told_apart(near.distance_m, bound_m);
        let wall = &scenario.walls[near.place].name;
        findings.push(finding(
            Severity::Warning,
            format!("robot.{}.goal_m", robot.name),
            format!(
                "the goal of {} is {distance} m from {wall}: avoidance will keep it from there",
                robot.name
            ),
            format!("expected more than {name} = {bound} m"),
        ));
    }
}

/// Places and the trajectory should keep so far from walls that nobody is led away from them.
fn passages(scenario: &Scenario, motion: &Motion, findings: &mut Vec<Finding>) {
    let Some((name, distance_m)) = scenario.method.steers_beside_walls else { return };
    let bound_m = distance_m(&scenario.conditions());
    let passages = motion.passages.iter().zip(&scenario.robots);
    let near = passages.filter_map(|(passage, robot)| passage.map(|passage| (passage, robot)));
    let near: Vec<_> = near.filter(|(passage, _)| passage.distance_m < bound_m).collect();
    let (led, others): (Vec<_>, Vec<_>) = near.into_iter().partition(|(_, robot)| robot.role.leads);
    let tightest = others.iter().min_by(|a, b| a.0.distance_m.total_cmp(&b.0.distance_m));
    for (passage, robot) in led.iter().chain(tightest) {
        let [distance, bound] = told_apart(passage.distance_m, bound_m);
        let (path, what) = match robot.role.leads {
            true => ("trajectory.points_m".to_owned(), format!("the trajectory of {}", robot.name)),
            false => (format!("robot.{}", robot.name), format!("the place of {}", robot.name)),
        };
        let more = match others.len() {
            n if n > 1 && !robot.role.leads => format!(" ({} more are too near)", n - 1),
            _ => String::new(),
        };
        findings.push(finding(
            Severity::Warning,
            path,
            format!(
                "{what} is {distance} m from {} at {} s: avoidance will keep it from there{more}",
                scenario.walls[passage.wall].name,
                short(passage.t_s)
            ),
            format!("expected more than {name} = {bound} m"),
        ));
    }
}

/// Whoever matters to the method must be seen.
fn sensing(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let a = &scenario.avoidance;
    let needed_m = scenario.sensing_radius_needed_m();
    if a.sensing_radius_m < needed_m {
        let [radius, needed] = told_apart(a.sensing_radius_m, needed_m);
        let rounded = rounded_up(needed_m);
        let more = rounded.parse().is_ok_and(|rounded_m: f64| rounded_m > a.sensing_radius_m);
        let needed = if more { rounded } else { needed };
        findings.push(finding(
            Severity::Error,
            "avoidance.sensing_radius_m",
            format!("`sensing_radius_m` is {radius}: the {} would see too late", a.kind),
            format!("expected at least {needed} m, or no such key"),
        ));
    }
}

/// A robot that may have more others near than a sample of its sensor reports stands, for it does
/// not know where the rest are. With v_max below the cap no such crowd fits within the needed radius.
fn crowds(scenario: &Scenario, findings: &mut Vec<Finding>) {
    if scenario.method.promise != Promise::Always {
        return;
    }
    let most = match scenario.method.senses {
        Senses::Velocities => PROXIMITY_MAX / 2,
        Senses::Positions | Senses::Nothing => PROXIMITY_MAX,
    };
    let (d, radius_m) = (scenario.avoidance.distance_min_m, scenario.sensing_radius_needed_m());
    let fit = points_max(radius_m, d) - 1.0;
    let others = scenario.robots.len().saturating_sub(1);
    if others <= most || fit <= most as f64 {
        return;
    }
    let points = start_points(&scenario.robots);
    let near = |point: &Vec2| {
        points.iter().filter(|other| (*other - point).norm() <= radius_m).count() - 1
    };
    let crowded: Vec<usize> = (0..points.len()).filter(|&i| near(&points[i]) > most).collect();
    let worst = crowded.iter().copied().max_by_key(|&i| near(&points[i]));
    let who = match worst {
        Some(i) => format!(
            "{} of {} robots, {} the most, start with more than {most} others within {} m, which \
             is all that a sample reports: they stand, for good if all do",
            crowded.len(),
            points.len(),
            scenario.robots[i].name,
            short(radius_m)
        ),
        None => format!(
            "up to {} others, d apart, fit within {} m of a robot, and a sample reports {most}: one \
             with more of them that near stands until some leave",
            fit.min(others as f64).floor(),
            short(radius_m)
        ),
    };
    // The radius grows with v_max: halve the interval until it is known to six digits.
    let fits_at = |speed_max_m_s: f64| {
        let avoidance = AvoidanceBrief { speed_max_m_s, ..scenario.avoidance.clone() };
        let slower = Scenario { avoidance, ..scenario.clone() };
        points_max(slower.sensing_radius_needed_m(), d) - 1.0 <= most as f64
    };
    let (mut low, mut high) = (0.0, scenario.avoidance.speed_max_m_s);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        *if fits_at(middle) { &mut low } else { &mut high } = middle;
    }
    let expected = match low > 0.0 {
        true => format!("expected at most {} m/s, or {} robots", rounded_down(low), most + 1),
        false => format!("expected {} robots at most", most + 1),
    };
    findings.push(finding(Severity::Warning, "avoidance.speed_max_m_s", who, expected));
}

/// A bound on how many points lie within `radius_m` of one of them, itself included, if no two are
/// nearer to each other than `apart_m`. (Oler 1961, of a disc)
fn points_max(radius_m: f64, apart_m: f64) -> f64 {
    let radii = radius_m / apart_m;
    (2.0 / 3f64.sqrt() * PI * radii * radii + PI * radii + 1.0).floor()
}

/// Remark 1: in the final shape nobody stands where avoidance would push it away.
fn settled_distances(scenario: &Scenario, settled: &Settled, findings: &mut Vec<Finding>) {
    let Some((name, _)) = scenario.method.steers_within else { return };
    let steered: Vec<f64> =
        (0..scenario.robots.len()).filter_map(|i| scenario.steers_within_m(i)).collect();
    let pairs = (0..steered.len()).flat_map(|i| (0..i).map(move |j| [j, i]));
    let spare = pairs.map(|[i, j]| {
        let distance_m = settled.scale[0] * (settled.places[i] - settled.places[j]).norm();
        ([i, j], distance_m, steered[i].max(steered[j]))
    });
    let tightest =
        spare.min_by(|(_, a, a_bound), (_, b, b_bound)| (a - a_bound).total_cmp(&(b - b_bound)));
    let Some(([i, j], distance_m, bound_m)) = tightest else { return };
    if distance_m <= bound_m {
        let [distance, bound] = told_apart(distance_m, bound_m);
        let (a, b) = (&scenario.robots[i].name, &scenario.robots[j].name);
        let mut edges = scenario.formation_edges();
        let direct = edges.find(|(_, e)| [e.from, e.to] == [i, j] || [e.from, e.to] == [j, i]);
        findings.push(finding(
            Severity::Warning,
            direct.map_or(format!("robot.{b}"), |(edge, _)| format!("edge.{edge}.offset_m")),
            format!(
                "in the final shape {a} and {b} stand {distance} m apart: avoidance will keep them \
                 from it"
            ),
            format!("expected more than {name} = {bound} m (Remark 1)"),
        ));
    }
}

/// A formation whose gaps nobody passes through must open while it forms, far and long enough.
fn openings(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let Some(((symbol, _), opening)) = scenario.method.steers_within.zip(Opening::of(scenario))
    else {
        return;
    };
    let ([a, b], farthest) = opening.who;
    let name = |i: usize| scenario.robots[i].name.as_str();
    let passage = short(opening.passage_m);
    let duration_s = seconds(scenario.duration_ns);
    let mut warn = |path: &str, message: String, expected: String| {
        findings.push(finding(Severity::Warning, path, message, expected));
    };
    let Some(&Scale::Closing { from, hold_s, .. }) = scenario.scale() else {
        let smallest = scenario.scale().map_or(1.0, |scale| scale.range()[0]);
        // Nearer than d_f nobody stays in any case, which is said by Remark 1.
        let gaps = 0.5 * opening.passage_m..opening.passage_m;
        if !gaps.contains(&(smallest * opening.gap_m)) {
            return;
        }
        let Some(ringed) = locked_out(scenario, opening.passage_m / smallest) else { return };
        warn(
            &format!("robot.{}", name(ringed)),
            format!(
                "places are {} m apart ({} and {}), less than 2 {symbol} = {passage} m: if {} comes \
                 late, it may find no way in between the others",
                short(smallest * opening.gap_m),
                name(a),
                name(b),
                name(ringed)
            ),
            format!(
                "expected `scale = {{ kind = \"closing\" }}`, which opens to {} for {} s and closes in \
                 {} s, or wider gaps",
                short(opening.from),
                short(opening.hold_s),
                short(opening.over_s)
            ),
        );
        return;
    };
    if from * opening.gap_m < opening.passage_m {
        warn(
            "scale.from",
            format!(
                "open, {} and {} are {} m apart, less than 2 {symbol} = {passage} m: nobody passes \
                 between them",
                name(a),
                name(b),
                short(from * opening.gap_m)
            ),
            format!("expected {} or more", short(opening.from)),
        );
    }
    let least_s = opening.way_m / opening.speed_m_s;
    if hold_s < least_s {
        warn(
            "scale.hold_s",
            format!(
                "the formation closes from {} s on, and {} alone needs {} s: {} m at {} m/s",
                short(hold_s),
                name(farthest),
                short(least_s),
                short(opening.way_m),
                short(opening.speed_m_s)
            ),
            format!("expected {} or more", short(opening.hold_s)),
        );
    }
    let closed_s = scenario.scale().and_then(Scale::closed_at_s);
    if let Some(closed_s) = closed_s.filter(|&closed_s| closed_s > duration_s) {
        warn(
            "scale",
            format!(
                "the formation has closed at {} s, and the run ends at {} s",
                short(closed_s),
                short(duration_s)
            ),
            "expected a longer run, or shorter times".to_owned(),
        );
    }
}

/// Where speeds are limited, nobody may need to be faster than v_max to stay in its place.
fn steady_speeds(scenario: &Scenario, motion: &Motion, findings: &mut Vec<Finding>) {
    let (v_max, limited) = (scenario.avoidance.speed_max_m_s, scenario.method.clamps_speed);
    let front = |i: &usize| motion.peaks[*i].front_speed_m_s;
    let fastest = (0..scenario.robots.len()).max_by(|a, b| front(a).total_cmp(&front(b)));
    let Some(i) = fastest.filter(|i| limited && front(i) > v_max) else {
        if limited {
            let front = |peak: &Peak| Some(peak.front_speed_m_s);
            transient(scenario, motion, 0, "", front, |_| Some(v_max), findings);
        }
        return;
    };
    let [needed, limit] = told_apart(front(&i), v_max);
    findings.push(finding(
        Severity::Warning,
        "avoidance.speed_max_m_s",
        format!(
            "to stay in its place {} must go at {needed} m/s, faster than the speed limit of \
             {limit} m/s",
            scenario.robots[i].name
        ),
        format!("expected more than {needed} m/s, or a slower trajectory"),
    ));
}

/// Wheels must be able to follow.
fn steady_wheels(scenario: &Scenario, motion: &Motion, findings: &mut Vec<Finding>) {
    let too_slow = |i: &usize| {
        let (rim_m_s, wheels) = (motion.peaks[*i].rim_speed_m_s?, scenario.robots[*i].wheels?);
        (rim_m_s > wheels.speed_max_m_s).then_some((rim_m_s, wheels.speed_max_m_s))
    };
    let slow: Vec<usize> = (0..scenario.robots.len()).filter(|i| too_slow(i).is_some()).collect();
    let excess = |i: &usize| too_slow(i).map_or(0.0, |(rim_m_s, limit)| rim_m_s / limit);
    let Some(&worst) = slow.iter().max_by(|a, b| excess(a).total_cmp(&excess(b))) else {
        let limit = |robot: &Robot| robot.wheels.map(|wheels| wheels.speed_max_m_s);
        let rim = |peak: &Peak| peak.rim_speed_m_s;
        transient(scenario, motion, 1, "a wheel of ", rim, limit, findings);
        return;
    };
    let Some((rim_m_s, limit_m_s)) = too_slow(&worst) else { return };
    let name = &scenario.robots[worst].name;
    let others = match slow.len() {
        1 => String::new(),
        n => format!(" (and {} more cannot follow)", n - 1),
    };
    let [needed, limit] = told_apart(rim_m_s, limit_m_s);
    findings.push(finding(
        Severity::Warning,
        format!("robot.{name}.wheels.speed_max_m_s"),
        format!(
            "to stay in its place a wheel of {name} must go at {needed} m/s, faster than its limit \
             of {limit} m/s{others}"
        ),
        format!("expected more than {needed} m/s, or a slower trajectory"),
    ));
}

/// That somebody is slow enough once settled, but not while the leader turns into its path.
fn transient(
    scenario: &Scenario,
    motion: &Motion,
    which: usize,
    what: &str,
    speed_m_s: impl Fn(&Peak) -> Option<f64>,
    limit_m_s: impl Fn(&Robot) -> Option<f64>,
    findings: &mut Vec<Finding>,
) {
    let (Some(transient), Some(leader)) = (&motion.transient, scenario.leader()) else { return };
    let robots = &scenario.robots;
    let excess = |i: &usize| {
        let (speed, limit) = (speed_m_s(&transient.peaks[*i]), limit_m_s(&robots[*i]));
        speed.zip(limit).map_or(0.0, |(speed, limit)| speed / limit)
    };
    let worst = (0..robots.len()).max_by(|a, b| excess(a).total_cmp(&excess(b)));
    let Some(i) = worst.filter(|i| excess(i) > 1.0) else { return };
    let speed = |peak: &Peak| short(speed_m_s(peak).unwrap_or_default());
    let leader = &robots[leader];
    findings.push(finding(
        Severity::Warning,
        format!("robot.{}.pose.heading_rad", leader.name),
        format!(
            "while {}, the leader, turns into its path, {what}{} would have to go at {} m/s at {} s \
             to stay in its place ({} m/s once settled), faster than its limit of {} m/s",
            leader.name,
            robots[i].name,
            speed(&transient.peaks[i]),
            short(transient.peaks_at_s[i][which]),
            speed(&motion.peaks[i]),
            short(limit_m_s(&robots[i]).unwrap_or_default())
        ),
        format!(
            "expected heading_rad = {}, the tangent of its path at the start",
            short(transient.tangent_rad)
        ),
    ));
}

/// What the method itself has to say.
fn advice(scenario: &Scenario, findings: &mut Vec<Finding>) {
    if let Some(Advice { key, message, expected }) =
        (scenario.method.advice)(&scenario.conditions())
    {
        let path = format!("avoidance.{key}");
        findings.push(finding(Severity::Warning, path, message, expected));
    }
}
