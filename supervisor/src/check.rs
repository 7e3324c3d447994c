//! Does a scenario make sense: graph, offsets, distances, speeds? And what does it amount to?
//!
//! Single values are checked where they are read. Here they are held against each other and
//! against the theory. Nothing is read or spawned.

use std::fmt::Write;

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::front_point::front_point;
use formation::graph::{Edge, FormationGraph};
use protocol::brief::{AvoidanceKind, Pace};
use protocol::law::Role;

use crate::scenario::diagnostic::Severity;
use crate::scenario::{Robot, Scenario, seconds};

/// Offsets around a cycle may miss by this much, m: rounding of decimals, and no more.
const OFFSET_GAP_M_MAX: f64 = 1e-6;
/// Above this epsilon T, a sampled focus overshoots (measured on all three cases of the chapter).
const EPSILON_PERIOD_MAX: f64 = 0.1;

/// Something about a scenario that is wrong, or worth knowing.
#[derive(Debug, Clone, PartialEq)]
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
    let mut findings = Vec::new();
    roots(scenario, &mut findings);
    offsets(scenario, &mut findings);
    speeds(scenario, &mut findings);
    start_distances(scenario, &mut findings);
    sensing(scenario, &mut findings);
    final_shape(scenario, &mut findings);
    if scenario.avoidance.kind == AvoidanceKind::Focus {
        focus_strength(scenario, &mut findings);
    }
    findings.sort_by_key(|finding| finding.severity != Severity::Error);
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

/// Information must flow from some robot to all others.
fn roots(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let reached = scenario.graph.reachability();
    let n = scenario.robots.len();
    if let Some(leader) = scenario.leader() {
        for (robot, led) in scenario.robots.iter().zip(&reached[leader]) {
            if !led {
                let name = &scenario.robots[leader].name;
                findings.push(finding(
                    Severity::Error,
                    format!("robot.{}", robot.name),
                    format!("nothing that {name} says ever reaches {}", robot.name),
                    format!("expected a path of edges from the leader {name} (Assumptions 3 to 5)"),
                ));
            }
        }
        return;
    }
    if (0..n).any(|r| reached[r].iter().all(|&yes| yes)) {
        return;
    }
    // Groups that hear nobody outside themselves: robots reached only by robots they reach.
    let closed = |r: usize| (0..n).all(|s| !reached[s][r] || reached[r][s]);
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for robot in (0..n).filter(|&r| closed(r)) {
        match groups.iter_mut().find(|group| reached[group[0]][robot]) {
            Some(group) => group.push(robot),
            None => groups.push(vec![robot]),
        }
    }
    let names = |group: &[usize]| {
        let shown: Vec<&str> =
            group.iter().take(6).map(|&r| scenario.robots[r].name.as_str()).collect();
        let more = if group.len() > 6 { ", ..." } else { "" };
        format!("{{{}{more}}}", shown.join(", "))
    };
    let list: Vec<String> = groups.iter().take(4).map(|group| names(group)).collect();
    findings.push(finding(
        Severity::Error,
        format!("robot.{}", scenario.robots[groups[1][0]].name),
        format!(
            "the formation falls apart: {} groups hear nobody outside: {}",
            groups.len(),
            list.join(" and ")
        ),
        format!("expected an edge from another group into {}", names(&groups[1])),
    ));
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

/// v_max T < ell, v_max below its cap, and front points nearer to the axle than d/2.
fn speeds(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let a = &scenario.avoidance;
    let d = a.distance_min_m;
    if a.speed_max_m_s.is_finite() {
        let step_m = a.speed_max_m_s * seconds(scenario.period_ns);
        if let Some(robot) = scenario.robots.iter().find(|robot| step_m >= robot.front_point_m) {
            findings.push(finding(
                Severity::Error,
                "avoidance.speed_max_m_s",
                format!(
                    "in one period a front point may move {} m, no less than it lies ahead of \
                     the axle of {} ({} m)",
                    short(step_m),
                    robot.name,
                    short(robot.front_point_m)
                ),
                format!(
                    "expected less than front_point_m / period_s = {} m/s",
                    short(robot.front_point_m / seconds(scenario.period_ns))
                ),
            ));
        }
        let cap = scenario.speed_cap_m_s();
        if a.kind == AvoidanceKind::Guard && a.speed_max_m_s > cap {
            findings.push(finding(
                Severity::Warning,
                "avoidance.speed_max_m_s",
                format!(
                    "the speed limit {} m/s is above min(d/4, ell/2) / H = {} m/s: safe, but the \
                     guard will brake a lot",
                    short(a.speed_max_m_s),
                    short(cap)
                ),
                format!(
                    "expected at most {} m/s, or a shorter H (now {} s)",
                    short(cap),
                    short(seconds(scenario.command_lifetime_ns_max()))
                ),
            ));
        }
    }
    if let Some(robot) = scenario.robots.iter().find(|robot| d < 2.0 * robot.front_point_m) {
        findings.push(finding(
            Severity::Warning,
            "avoidance.distance_min_m",
            format!(
                "d = {} m keeps front points apart, but not bodies: that of {} is {} m ahead",
                short(d),
                robot.name,
                short(robot.front_point_m)
            ),
            format!("expected at least twice that, {} m", short(2.0 * robot.front_point_m)),
        ));
    }
}

/// The front points at the start, m.
fn start_points(robots: &[Robot]) -> Vec<Vec2> {
    robots.iter().map(|robot| front_point(robot.start, robot.front_point_m)).collect()
}

/// Assumption 1: all start at least d apart.
fn start_distances(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let severity = match scenario.avoidance.kind {
        AvoidanceKind::Guard => Severity::Error,
        AvoidanceKind::Focus => Severity::Warning,
        AvoidanceKind::None => return,
    };
    let d = scenario.avoidance.distance_min_m;
    if let Some(ClosestPair { pair: [i, j], distance_m }) =
        closest_pair(&start_points(&scenario.robots))
        && distance_m < d
    {
        let (a, b) = (&scenario.robots[i].name, &scenario.robots[j].name);
        findings.push(finding(
            severity,
            format!("robot.{b}.pose"),
            format!("the front points of {a} and {b} start {} m apart", short(distance_m)),
            format!("expected at least `distance_min_m`, {} m (Assumption 1)", short(d)),
        ));
    }
}

/// With `guard`, whoever matters must be seen.
fn sensing(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let a = &scenario.avoidance;
    let needed_m = scenario.sensing_radius_needed_m();
    if a.kind == AvoidanceKind::Guard && a.sensing_radius_m < needed_m {
        findings.push(finding(
            Severity::Error,
            "avoidance.sensing_radius_m",
            format!(
                "`sensing_radius_m` is {}: the guard would see too late",
                short(a.sensing_radius_m)
            ),
            format!("expected at least {} m, or no such key", rounded_up(needed_m)),
        ));
    }
}

/// Remark 1: in the final shape nobody stands where avoidance would push it away.
fn final_shape(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let (bound_m, name) = match scenario.avoidance.kind {
        AvoidanceKind::Guard => (scenario.deflection_distance_m(), "d_f"),
        AvoidanceKind::Focus => (scenario.avoidance.distance_min_m, "d"),
        AvoidanceKind::None => return,
    };
    let Some((shape, _)) = settled_shape(scenario) else { return };
    let Some(ClosestPair { pair: [i, j], distance_m }) = closest_pair(&shape) else { return };
    if distance_m <= bound_m {
        let (a, b) = (&scenario.robots[i].name, &scenario.robots[j].name);
        let edges = scenario.graph.edges();
        let direct =
            edges.iter().position(|e| [e.from, e.to] == [i, j] || [e.from, e.to] == [j, i]);
        findings.push(finding(
            Severity::Warning,
            direct.map_or("edge".to_owned(), |edge| format!("edge.{edge}.offset_m")),
            format!(
                "in the final shape {a} and {b} stand {} m apart: avoidance will keep them from it",
                short(distance_m)
            ),
            format!("expected more than {name} = {} m (Remark 1)", short(bound_m)),
        ));
    }
}

/// The shape that the robots settle in, at its smallest, and its closest pair; only if all keep a
/// place in it and their offsets agree.
fn settled_shape(scenario: &Scenario) -> Option<(Vec<Vec2>, Option<ClosestPair>)> {
    let rooted = !scenario.graph.roots().is_empty();
    let rigid = scenario.robots.iter().all(|robot| robot.role != Role::Contained);
    let (mut shape, open) = scenario.graph.shape(OFFSET_GAP_M_MAX);
    // At its smallest, where robots come nearest.
    let scale = scenario.lead.as_ref().map_or(1.0, |lead| lead.scale.mean - lead.scale.amplitude);
    shape.iter_mut().for_each(|place| *place *= scale);
    (rooted && rigid && open.is_empty()).then(|| {
        let closest = closest_pair(&shape);
        (shape, closest)
    })
}

/// A focus that turns by more than a tenth within one period overshoots.
fn focus_strength(scenario: &Scenario, findings: &mut Vec<Finding>) {
    let product = scenario.avoidance.epsilon_per_s * seconds(scenario.period_ns);
    if product > EPSILON_PERIOD_MAX {
        findings.push(finding(
            Severity::Warning,
            "avoidance.epsilon_per_s",
            format!("epsilon T = {}: a focus sampled this slowly does not keep d", short(product)),
            format!(
                "expected a period of at most {} s, or kind = \"guard\"",
                short(EPSILON_PERIOD_MAX / scenario.avoidance.epsilon_per_s)
            ),
        ));
    }
}

/// What a scenario amounts to, as `phalanx check` prints it: one screen of aligned text.
pub fn report(scenario: &Scenario) -> String {
    let robots = &scenario.robots;
    let mut text = String::new();
    // Writing to a string cannot fail.
    let mut line = |label: &str, value: String| {
        let _ = writeln!(text, "{label:<24}{value}");
    };
    line("scenario", scenario.name.clone());
    line(
        "time",
        format!(
            "{} s in periods of {} s: {} ticks, seed {}",
            short(seconds(scenario.duration_ns)),
            short(seconds(scenario.period_ns)),
            scenario.duration_ns / scenario.period_ns,
            scenario.seed
        ),
    );
    for (i, robot) in robots.iter().enumerate() {
        let heard: Vec<String> = scenario
            .graph
            .heard_by(i)
            .map(|e| match robot.role {
                Role::Contained => robots[e.from].name.clone(),
                Role::Leader | Role::Formation => {
                    let (name, at) = (&robots[e.from].name, e.offset_m);
                    format!("{name} at ({:.3}, {:.3}) m", at.x, at.y)
                }
            })
            .collect();
        let label = if i == 0 { "who hears whom" } else { "" };
        let heard = if heard.is_empty() { "nobody".to_owned() } else { heard.join(", ") };
        line(label, format!("{} hears {heard}", robot.name));
    }
    for (label, role) in [
        ("leads", Role::Leader),
        ("keep a place", Role::Formation),
        ("are contained", Role::Contained),
    ] {
        let names = robots.iter().filter(|robot| robot.role == role);
        let names: Vec<&str> = names.map(|robot| robot.name.as_str()).collect();
        if !names.is_empty() {
            line(label, names.join(", "));
        }
    }
    let roots: Vec<&str> =
        scenario.graph.roots().into_iter().map(|r| robots[r].name.as_str()).collect();
    line(
        "roots",
        match roots.len() {
            0 => "none: the formation falls apart".to_owned(),
            n if n == robots.len() => "all: anybody's information reaches everybody".to_owned(),
            _ => roots.join(", "),
        },
    );
    let pair = |closest: Option<ClosestPair>| {
        closest.map_or("one robot alone".to_owned(), |c| {
            let [i, j] = c.pair;
            format!("{:.4} m ({} and {})", c.distance_m, robots[i].name, robots[j].name)
        })
    };
    line(
        "smallest distance",
        format!("{} at the start", pair(closest_pair(&start_points(robots)))),
    );
    line(
        "",
        match settled_shape(scenario) {
            Some((_, closest)) => format!("{} in the final shape", pair(closest)),
            None if !scenario.contained().is_empty() => {
                "no final shape: some robots are contained, and have no place of their own".into()
            }
            None => "no final shape: offsets do not agree".to_owned(),
        },
    );
    let a = &scenario.avoidance;
    let kind = match a.kind {
        AvoidanceKind::None => "none",
        AvoidanceKind::Focus => "focus",
        AvoidanceKind::Guard => "guard",
    };
    let speed = if a.speed_max_m_s.is_finite() {
        format!("v_max = {} m/s", short(a.speed_max_m_s))
    } else {
        "no speed limit".to_owned()
    };
    line("avoidance", format!("{kind}, d = {} m, {speed}", short(a.distance_min_m)));
    if a.epsilon_per_s > 0.0 {
        let product = a.epsilon_per_s * seconds(scenario.period_ns);
        line(
            "",
            format!("epsilon = {} 1/s, epsilon T = {}", short(a.epsilon_per_s), short(product)),
        );
    }
    line(
        "command lifetime H",
        format!(
            "{} s in lockstep, {} s in real time",
            short(seconds(scenario.command_lifetime_ns(Pace::Lockstep))),
            short(seconds(scenario.command_lifetime_ns(Pace::Realtime)))
        ),
    );
    line("deflects within d_f", format!("{:.4} m", scenario.deflection_distance_m()));
    line(
        "sensing radius",
        format!("{:.4} m, needed {:.4} m", a.sensing_radius_m, scenario.sensing_radius_needed_m()),
    );
    line("cap on v_max", format!("{:.4} m/s", scenario.speed_cap_m_s()));
    line(
        "silence",
        format!(
            "stale after {} s, lost after {} s",
            short(seconds(scenario.silence.stale_after_ns)),
            short(seconds(scenario.silence.lost_after_ns))
        ),
    );
    for (i, fault) in scenario.faults.iter().enumerate() {
        let label = if i == 0 { "faults" } else { "" };
        line(label, format!("{} s: {}", short(seconds(fault.at_ns)), fault.words(scenario)));
    }
    text
}

/// Six significant digits, without trailing zeros.
fn short(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    let digits = 5 - (number.abs().log10().floor() as i32);
    let rounded = format!("{number:.*}", digits.clamp(0, 15) as usize);
    if rounded.contains('.') {
        rounded.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        rounded
    }
}

/// Four decimals, never less than `number`.
fn rounded_up(number: f64) -> String {
    format!("{:.4}", (number * 1e4 - 1e-6).ceil() / 1e4)
}
