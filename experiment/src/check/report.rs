//! Text report of `phalanx check`, with aligned columns.

use std::cmp::Ordering::Equal;
use std::collections::BTreeSet;
use std::fmt::Write;

use formation::ns_to_seconds;
use protocol::number::format_short;

use super::braking::Braking;
use super::finding::NAMES_MAX;
use super::start_front_points;
use super::theory::{
    ClosestRobots, EdgeCut, EpsilonRule, FailureConsequences, InNeighbor, RobotFailure,
    RobotTheory, Theory, TopologyRepair,
};
use crate::prediction::{broken_definition_text, lines_by_cause};
use crate::scenario::diagnostic::format_list;
use crate::scenario::{Robot, Scenario};

/// Maximum number of robots for which the report shows the matrices.
const MATRIX_ROBOTS_MAX: usize = 12;
/// Maximum number of lines or names of a list.
const LIST_ITEMS_MAX: usize = 24;

/// Report text: lines with a label. Continuation lines have an empty label.
struct ReportPage(String);

impl ReportPage {
    fn write_line(&mut self, label: &str, value: impl AsRef<str>) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{label:<24}{}", value.as_ref());
    }

    /// Writes one line for each of `values`, the first with the label. After [`LIST_ITEMS_MAX`] lines only their number
    /// is given.
    fn write_list(&mut self, label: &str, values: impl IntoIterator<Item = String>) {
        let mut values = values.into_iter();
        for (i, value) in values.by_ref().take(LIST_ITEMS_MAX).enumerate() {
            self.write_line(if i == 0 { label } else { "" }, value);
        }
        match values.count() {
            0 => {}
            more => self.write_line("", format!("... and {more} more: --output json has all")),
        }
    }
}

/// Returns the report of a scenario without errors.
pub fn format_report(scenario: &Scenario, theory: &Theory<'_>) -> String {
    let mut page = ReportPage(String::new());
    page.write_line("scenario", theory.scenario);
    let in_s = |ns| format_short(ns_to_seconds(ns));
    let [duration, period] = [scenario.duration_ns, scenario.period_ns].map(in_s);
    let (ticks, seed) = (scenario.duration_ns / scenario.period_ns, scenario.seed);
    page.write_line(
        "time",
        format!("{duration} s in periods of {period} s: {ticks} ticks, seed {seed}"),
    );
    write_graph(&mut page, scenario, theory);
    write_failure_consequences(&mut page, theory);
    if let Some(liars) = &theory.liars {
        page.write_line("liars", liars.describe(theory.leader));
    }
    write_matrices(&mut page, scenario, theory);
    write_error_bounds(&mut page, theory);
    write_motion(&mut page, theory);
    write_unknown_motion(&mut page, theory);
    write_distances(&mut page, theory);
    write_opening(&mut page, theory);
    write_avoidance(&mut page, scenario, theory);
    write_inertia_and_walls(&mut page, scenario, theory);
    let [stale, lost] = [scenario.silence.stale_after_ns, scenario.silence.lost_after_ns].map(in_s);
    page.write_line("silence", format!("stale after {stale} s, lost after {lost} s"));
    if let Some(after_ns) = scenario.repair_after_ns {
        let after = in_s(after_ns);
        page.write_line(
            "repair",
            format!("a backup neighbor replaces an in-neighbor that is lost for {after} s"),
        );
    }
    let faults = scenario.faults.iter();
    let faults =
        faults.map(|fault| format!("{} s: {}", in_s(fault.start_ns), fault.describe(scenario)));
    page.write_list("faults", faults);
    page.0
}

/// Writes the links, the roles and the reachability.
fn write_graph(page: &mut ReportPage, scenario: &Scenario, theory: &Theory<'_>) {
    let distance_links = links_by_distance(scenario);
    let describe_in_neighbors = |robot: &RobotTheory<'_>, senders: &[InNeighbor<'_>]| {
        let in_neighbors =
            senders.iter().filter(|sender| !distance_links.contains(&(sender.robot, robot.name)));
        let in_neighbors = in_neighbors.map(|sender| match sender.offset_m {
            Some([x, y]) => format!("{} (slot at {0} + ({x:.3}, {y:.3}) m)", sender.robot),
            None => match sender.instead_of {
                Some(lost) => format!("{} in place of {lost}", sender.robot),
                None => sender.robot.to_owned(),
            },
        });
        let in_neighbors: Vec<String> = in_neighbors.collect();
        let senders =
            if in_neighbors.is_empty() { "no robot".to_owned() } else { in_neighbors.join(", ") };
        format!("{} hears {senders}", robot.name)
    };
    let has_permanent_link = |robot: &&RobotTheory<'_>| {
        let mut in_neighbors = robot.hears.iter();
        distance_links.is_empty()
            || in_neighbors.any(|h| !distance_links.contains(&(h.robot, robot.name)))
    };
    let with_links = theory.robots.iter().filter(has_permanent_link);
    page.write_list("links", with_links.map(|robot| describe_in_neighbors(robot, &robot.hears)));
    write_communication_range(page, scenario, distance_links.len());
    if let Some(leader) = theory.leader.filter(|_| !theory.deputies.is_empty()) {
        let robots = theory.deputies.join(", then ");
        page.write_line("deputies", format!("while {leader} is lost: {robots}"));
        page.write_line(
            "",
            "the two parts of a partitioned network can have two leaders until the links are \
         restored",
        );
    }
    for succession in &theory.successions {
        let robots = succession.deputies.join(", then ");
        page.write_line(
            "deputies",
            format!("in the slot of {} while it is lost: {robots}", succession.leader),
        );
    }
    let with_spares = theory.robots.iter().filter(|robot| !robot.spares.is_empty());
    page.write_list(
        "backup neighbors",
        with_spares.map(|robot| describe_in_neighbors(robot, &robot.spares)),
    );
    let mut parts: Vec<(&str, Vec<&str>)> = Vec::new();
    for robot in &theory.robots {
        match parts.iter_mut().find(|(does, _)| *does == robot.does) {
            Some((_, of_role)) => of_role.push(robot.name),
            None => parts.push((robot.does, vec![robot.name])),
        }
    }
    for (does, of_role) in parts {
        page.write_line(does, format_list(&of_role, LIST_ITEMS_MAX));
    }
    let has_contained = theory.robots.iter().any(|robot| robot.contained);
    let reachability = match theory.leader {
        Some(leader) if has_contained => {
            format!("the leader {leader} reaches all robots that keep a slot (Assumption 5)")
        }
        Some(leader) => format!("the leader {leader} reaches all robots (Assumption 3)"),
        None if theory.robots.iter().all(|robot| robot.has_goal) => {
            "each robot knows its own goal".to_owned()
        }
        None if theory.robots.iter().all(|robot| robot.has_goal || robot.is_free) => {
            "no robot needs another for its reference".to_owned()
        }
        None if theory.roots.len() == theory.robots.len() => {
            "the information of each robot reaches all others".to_owned()
        }
        None => {
            format!("all robots are reached from {}", format_list(&theory.roots, LIST_ITEMS_MAX))
        }
    };
    page.write_line("reachability", reachability);
    if has_contained {
        page.write_line(
            "",
            "a robot that leads or keeps a slot reaches each contained robot (Assumption 4)",
        );
    }
}

/// Returns the links that exist only while their robots are near each other, as names of sender and receiver.
fn links_by_distance(scenario: &Scenario) -> BTreeSet<(&str, &str)> {
    let first =
        scenario.disk_graph.map_or(scenario.graph.edges().len(), |disk| disk.first_edge_index);
    let name = |robot: usize| scenario.robots[robot].name.as_str();
    let links = scenario.graph.edges()[first..].iter();
    links.map(|edge| (name(edge.from), name(edge.to))).collect()
}

/// Writes the communication by distance, over this number of links.
fn write_communication_range(page: &mut ReportPage, scenario: &Scenario, links: usize) {
    let Some(disk) = scenario.disk_graph else { return };
    let points = start_front_points(&scenario.robots);
    let edges = &scenario.graph.edges()[disk.first_edge_index..];
    let in_range = edges
        .iter()
        .filter(|edge| disk.range.contains((points[edge.from] - points[edge.to]).norm(), false));
    let [radius, outer_radius] =
        [disk.range.radius_m, disk.range.radius_m + disk.range.hysteresis_m];
    page.write_line(
        "by distance",
        format!(
            "a robot is heard from {} m on, until it is more than {} m away; at the start {} of {links} links",
            format_short(radius),
            format_short(outer_radius),
            in_range.count()
        ),
    );
}

/// Writes the consequences of single permanent failures of robots and links.
fn write_failure_consequences(page: &mut ReportPage, theory: &Theory<'_>) {
    let breaking: Vec<_> =
        theory.deaths.iter().filter(|death| death.after.has_consequences()).collect();
    if breaking.is_empty() {
        page.write_line(
            "single deaths",
            "after the permanent failure of any robot, all others keep their leader and their slots",
        );
    }
    let death = |death: &RobotFailure<'_>| {
        let is_leader = theory.leader == Some(death.robot);
        let leads = if is_leader { ", the leader" } else { "" };
        let after = death.settles_after_s.map_or(String::new(), |after_s| {
            format!(
                "; within {} m of their new positions after {after_s:.0} s",
                format_short(theory.broken_m)
            )
        });
        format!(
            "without {}{leads}: {}{after}",
            death.robot,
            acting_leaders_text(&death.after.leading, death.peak_m) + &loss_text(&death.after)
        )
    };
    page.write_list("single deaths", breaking.into_iter().map(death));
    if theory.breaking_cuts.is_empty() {
        page.write_line(
            "single cuts",
            "after the permanent failure of any link, all robots keep their leader and their slots",
        );
    }
    let cut = |cut: &EdgeCut<'_>| {
        let what = acting_leaders_text(&cut.after.leading, None) + &loss_text(&cut.after);
        format!("without {} -> {}: {what}", cut.from, cut.to)
    };
    page.write_list("single cuts", theory.breaking_cuts.iter().map(cut));
    page.write_line("", broken_definition_text(theory.broken_m));
    if theory.liars.is_some() {
        page.write_line(
            "",
            "robots with a resilient law are predicted as if they used the mean of their in-neighbors",
        );
    }
}

/// Returns the backup leaders that lead, and the maximum error until then if it is known.
fn acting_leaders_text(leading: &[&str], peak_m: Option<f64>) -> String {
    let Some((last, others)) = leading.split_last() else { return String::new() };
    let robots = match others {
        [] => format!("{last} leads"),
        _ => format!("{} and {last} lead", others.join(", ")),
    };
    let error = peak_m
        .map_or(String::new(), |m| format!(", errors of up to {} m until then", format_short(m)));
    format!("{robots}{error}; ")
}

/// Returns the repairs, the losses and the broken robots.
fn loss_text(after: &FailureConsequences<'_>) -> String {
    let FailureConsequences { repairs, loss, breaks, .. } = after;
    let mut parts: Vec<String> = Vec::new();
    for TopologyRepair { robot, by, .. } in repairs.iter().take(LIST_ITEMS_MAX) {
        let uses = format!("{robot} uses {by}");
        match parts.last_mut().filter(|last| last.starts_with(&format!("{robot} uses "))) {
            Some(last) if last.ends_with(&format!(" {by}")) => *last += " twice",
            Some(last) => *last += &format!(" and {by}"),
            None => parts.push(uses),
        }
    }
    for (robots, one, many) in [
        (&loss.unled, "loses the leader", "lose the leader"),
        (
            &loss.pulled,
            "uses an in-neighbor without the leader",
            "use an in-neighbor without the leader",
        ),
        (&loss.uncontained, "has an empty hull", "have an empty hull"),
        (
            &loss.adrift,
            "is contained only by leaderless robots",
            "are contained only by leaderless robots",
        ),
    ] {
        // Broken robots are listed below with the reason.
        let is_broken =
            |robot: &&&str| breaks.iter().any(|broken_robot| broken_robot.robot == **robot);
        let unbroken: Vec<&str> =
            robots.iter().filter(|robot| !is_broken(robot)).copied().collect();
        match unbroken.len() {
            0 => {}
            1 => parts.push(format!("{} {one}", unbroken[0])),
            _ => parts.push(format!("{} {many}", format_list(&unbroken, LIST_ITEMS_MAX))),
        }
    }
    if !loss.groups.is_empty() {
        let groups = loss.groups.iter().take(LIST_ITEMS_MAX);
        let groups = groups.map(|group| format!("{{{}}}", format_list(group, LIST_ITEMS_MAX)));
        let groups: Vec<String> = groups.collect();
        parts.push(format!("the formation falls apart into {}", groups.join(" and ")));
    }
    let broken = lines_by_cause(
        breaks.iter().map(|broken_robot| (broken_robot.robot, broken_robot.why.clone())),
    );
    if broken.is_empty() {
        parts.push("no robot is broken".to_owned());
    }
    parts.extend(broken);
    parts.join("; ")
}

/// Writes L, A and their properties.
fn write_matrices(page: &mut ReportPage, scenario: &Scenario, theory: &Theory<'_>) {
    let n = theory.robots.len();
    if n <= MATRIX_ROBOTS_MAX {
        let row = |row: &Vec<f64>, width, digits| -> String {
            // -0 is written as 0.
            let elements = row.iter().map(|x| if *x == 0.0 { 0.0 } else { *x });
            elements.map(|x| format!(" {x:>width$.digits$}")).collect()
        };
        page.write_list("L (4)-(6)", theory.laplacian.iter().map(|elements| row(elements, 3, 0)));
        page.write_list(
            "A = Lambda L + Gamma",
            theory.system.iter().map(|elements| row(elements, 7, 4)),
        );
    } else {
        page.write_line("L, A", format!("{n} x {n}: --output json has them"));
    }
    let matrix = &theory.matrix;
    let inverse = match matrix.inverse_radius.zip(matrix.inverse_norm_2) {
        Some((radius, norm)) => {
            let kind = if matrix.m_matrix { "an M-matrix, invertible" } else { "not an M-matrix" };
            let [eigenvalue_min, radius, norm] = [matrix.system_eigenvalue_min, radius, norm].map(format_short);
            format!("{kind}: eigenvalues from {eigenvalue_min} on, rho(A^-1) = {radius}, |A^-1| = {norm}")
        }
        None if theory.leader.is_some() => {
            "singular: the position of a free robot does not follow from that of the leader".to_owned()
        }
        None => "singular: without a leader the offsets determine the shape, and the start poses its position"
            .to_owned(),
    };
    page.write_line("", inverse);
    let uses_velocities = scenario.robots.iter().any(|robot| robot.uses_feed_forward);
    let iteration = match matrix.iteration_radius {
        _ if !uses_velocities => "none: no law uses the velocities of others".to_owned(),
        0.0 => "spectral radius 0: velocities agree exactly after some ticks".to_owned(),
        radius => format!("spectral radius {}, below 1: velocities agree", format_short(radius)),
    };
    page.write_line("velocity iteration", iteration);
}

/// Writes the bounds eta, and epsilon by each rule.
fn write_error_bounds(page: &mut ReportPage, theory: &Theory<'_>) {
    if let Some(facts) = &theory.trajectory {
        let [m, c, horizon] = [facts.eta_m_m_s, facts.eta_c_m_s, facts.horizon_s].map(format_short);
        let etas = format!("eta_m = {m} m/s, eta_c = {c} m/s over {horizon} s");
        page.write_line("trajectory and offsets", etas);
    }
    if let Some(bounds) = &theory.bounds {
        let [lemma, norm] = [bounds.lemma_1_m_s, bounds.norm_2_m_s].map(format_short);
        page.write_line(
            "bounds on |alpha'|",
            format!(
                "eta = {lemma} m/s by Lemma 1 (can be exceeded), {norm} m/s by the 2-norm of A^-1"
            ),
        );
        let [k, eta] = [bounds.k_m_s, bounds.eta_m_s].map(format_short);
        page.write_line("", format!("with k* = {k} m/s, eta* = {eta} m/s"));
    }
    if theory.epsilon.is_empty() {
        page.write_line("epsilon", "no rule of the chapter applies to these laws");
    }
    let rule = |epsilon: &EpsilonRule| {
        let EpsilonRule { rule, source, epsilon_per_s, epsilon_norm_2_per_s } = epsilon;
        let norm = epsilon_norm_2_per_s
            .map(|epsilon| format!(", by the 2-norm {}", format_short(epsilon)));
        format!(
            "{rule} = {} 1/s ({source}){}",
            format_short(*epsilon_per_s),
            norm.unwrap_or_default()
        )
    };
    page.write_list("epsilon by the rules", theory.epsilon.iter().map(rule));
}

/// Writes the peak speeds of all robots in the settled formation.
fn write_motion(page: &mut ReportPage, theory: &Theory<'_>) {
    if theory.trajectory.is_none() {
        let free = theory.robots.iter().filter(|robot| robot.is_free).count();
        if free < theory.robots.len() {
            let robots = if free > 0 { "all robots that are not free" } else { "all robots" };
            page.write_line("once settled", format!("{robots} are at rest"));
        }
        return;
    }
    let peak = |robot: &RobotTheory<'_>| {
        let (name, peak) = (robot.name, &robot.peak);
        let rim = peak.rim_speed_m_s.zip(robot.rim_speed_max_m_s);
        let rim = rim.map(|(rim_m_s, limit)| {
            format!(", wheel rim {rim_m_s:.4} of {} m/s", format_short(limit))
        });
        format!(
            "{name} front point {:.4} m/s, v {:.4} m/s, w {:.4} rad/s{}",
            peak.front_speed_m_s,
            peak.v_m_s,
            peak.w_rad_s,
            rim.unwrap_or_default()
        )
    };
    let known = theory.robots.iter().filter(|robot| !robot.is_unknown);
    page.write_list("peaks once settled", known.map(peak));
    let front = |robot: &&RobotTheory<'_>| robot.transient.map(|peak| peak.front_speed_m_s);
    let fastest =
        theory.robots.iter().max_by(|a, b| front(a).partial_cmp(&front(b)).unwrap_or(Equal));
    let tangent_rad = theory.trajectory.and_then(|facts| facts.tangent_rad);
    if let (Some(RobotTheory { name, transient: Some(peak), .. }), Some(tangent_rad)) =
        (fastest, tangent_rad)
    {
        let (speed_m_s, [t, tangent]) =
            (peak.front_speed_m_s, [peak.t_s, tangent_rad].map(format_short));
        page.write_line(
            "before that",
            format!(
                "up to {speed_m_s:.4} m/s ({name} at {t} s), while the leader turns to the heading of its \
                 path, {tangent} rad"
            ),
        );
    }
    if let Some(limit_m_s) = theory.guard.speed_max_m_s {
        let fastest = theory.robots.iter().map(|robot| robot.peak.front_speed_m_s);
        let fastest_m_s = fastest.fold(0.0, f64::max);
        page.write_line(
            "",
            format!("at most {fastest_m_s:.4} of v_max = {} m/s", format_short(limit_m_s)),
        );
    }
}

/// Writes which robots move as their laws decide, so that nothing about their motion is predicted.
fn write_unknown_motion(page: &mut ReportPage, theory: &Theory<'_>) {
    let names = |predicate: fn(&RobotTheory<'_>) -> bool| -> Vec<&str> {
        theory.robots.iter().filter(|robot| predicate(robot)).map(|robot| robot.name).collect()
    };
    let free = names(|robot| robot.is_free);
    if free.is_empty() {
        return;
    }
    let followers = names(|robot| robot.is_unknown && !robot.is_free);
    let mut robots = format_list(&free, LIST_ITEMS_MAX);
    if !followers.is_empty() {
        robots += &format!(
            ", and {}, which {} a free robot",
            format_list(&followers, LIST_ITEMS_MAX),
            match followers.len() {
                1 => "follows",
                _ => "follow",
            }
        );
    }
    page.write_line(
        "not predicted",
        format!(
            "the motion of {robots}: the law of a free robot alone decides where it goes. Speeds of these robots, and their \
             distances from walls and other robots after the start, are unknown"
        ),
    );
}

/// Writes the settled positions and the smallest distances.
fn write_distances(page: &mut ReportPage, theory: &Theory<'_>) {
    let format_position = |robot: &RobotTheory<'_>| {
        let [x, y] = robot.settled_m.map(|c| if c.abs() < 5e-5 { 0.0 } else { c });
        format!("{} ({x:.4}, {y:.4}) m", robot.name)
    };
    let settles = |robot: &&RobotTheory<'_>| !robot.is_free;
    page.write_list("settled positions", theory.robots.iter().filter(settles).map(format_position));
    let format_closest = |gap: &Option<ClosestRobots<'_>>| {
        gap.map_or("one robot alone".to_owned(), |ClosestRobots { robots: [a, b], distance_m }| {
            format!("{distance_m:.4} m ({a} and {b})")
        })
    };
    let distances = &theory.distances;
    let [smallest, largest] = distances.scale.map(format_short);
    let at_scale = match smallest == largest {
        true => String::new(),
        false => format!(", at the smallest scale, {smallest} ({smallest} to {largest})"),
    };
    let d = format_short(distances.distance_min_m);
    let (start, settled) = (format_closest(&distances.start), format_closest(&distances.settled));
    page.write_line(
        "smallest distance",
        format!("{start} at the start; Assumption 1 requires {d} m"),
    );
    if theory.robots.iter().all(|robot| !robot.is_free) || distances.settled.is_some() {
        let required = format!("Remark 1 requires more than {d} m");
        page.write_line("", format!("{settled} once settled{at_scale}; {required}"));
    }
}

/// Writes the opening of the formation, and the opening that slots, starts and speeds require.
fn write_opening(page: &mut ReportPage, theory: &Theory<'_>) {
    let Some(closing) = &theory.closing else { return };
    let times: Vec<String> =
        closing.reopen_at_s.iter().map(|&at_s| format_short(at_s) + " s").collect();
    let reopening = match times.is_empty() {
        true => String::new(),
        false => format!("; opens again at {}", times.join(", ")),
    };
    let [from, hold, over, closed] =
        [closing.from, closing.hold_s, closing.over_s, closing.closed_at_s].map(format_short);
    page.write_line(
        "opening",
        format!(
            "scale {from} for {hold} s, then closes in {over} s{reopening}; closed for good at {closed} s"
        ),
    );
    if let Some(required) = &closing.asked {
        let [from, gap, hold] = [required.from, required.gap_m, required.hold_s].map(format_short);
        let [distance, speed, over] =
            [required.way_m, required.speed_m_s, required.over_s].map(format_short);
        page.write_line(
            "",
            format!(
                "required: scale {from} for gaps of {gap} m, {hold} s for distances of {distance} m at {speed} m/s, \
                 {over} s to close"
            ),
        );
    }
}

/// Returns the size and the speed limit of a class of robots, and its robots.
fn class_line(scenario: &Scenario, (keep_m, speed_max_m_s): (f64, f64)) -> String {
    let is_one = |robot: &&Robot| (robot.keep_m, robot.speed_max_m_s) == (keep_m, speed_max_m_s);
    let names: Vec<&str> =
        scenario.robots.iter().filter(is_one).map(|robot| robot.name.as_str()).collect();
    let speed = match speed_max_m_s.is_finite() {
        true => format!("v_max {} m/s", format_short(speed_max_m_s)),
        false => "no speed limit".to_owned(),
    };
    format!("keep {} m, {speed}: {}", format_short(keep_m), format_list(&names, NAMES_MAX))
}

/// Writes the parameters of collision avoidance.
fn write_avoidance(page: &mut ReportPage, scenario: &Scenario, theory: &Theory<'_>) {
    let (a, guard, method) = (&scenario.avoidance, &theory.guard, &scenario.avoidance_method);
    let speed = guard
        .speed_max_m_s
        .map(|speed_max_m_s| format!("v_max = {} m/s", format_short(speed_max_m_s)));
    let speed = speed.unwrap_or("no speed limit".to_owned());
    page.write_line(
        "avoidance",
        format!("{}, d = {} m, {speed}", a.kind, format_short(a.distance_min_m)),
    );
    if scenario.is_team() {
        page.write_list(
            "team",
            scenario.classes().into_iter().map(|class| class_line(scenario, class)),
        );
    }
    page.write_line("guarantees", method.guarantee_text);
    if !method.assumptions_text.is_empty() {
        page.write_line("assumes", method.assumptions_text);
    }
    let is_method_gain = |key: &String| method.gains.iter().any(|gain| gain.key == key);
    for (key, gain) in a.gains.iter().filter(|(key, _)| is_method_gain(key)) {
        page.write_line("", format!("{key} = {}", format_short(*gain)));
    }
    let [lockstep, realtime] =
        [guard.lifetime_lockstep_s, guard.lifetime_realtime_s].map(format_short);
    page.write_line(
        "command lifetime H",
        format!("{lockstep} s in lockstep, {realtime} s in real time"),
    );
    if guard.late_s[1] > 0.0 {
        let [lockstep, realtime] = guard.late_s.map(format_short);
        page.write_line(
            "",
            format!("of that {lockstep} s and {realtime} s for delayed odometry and commands"),
        );
    }
    if let (Some((symbol, _)), Some(distance_m)) =
        (method.steering_distance, guard.deflection_distance_m)
    {
        let format_distance = |m: Option<f64>, robots: &str| {
            m.map(|m| format!(", {m:.4} m for {robots}")).unwrap_or_default()
        };
        let followers = format_distance(guard.following_distance_m, "followers");
        let contained = format_distance(guard.giving_way_distance_m, "contained robots");
        let distances = format!("{distance_m:.4} m{followers}{contained}");
        page.write_line(&format!("steers within {symbol}"), distances);
    }
    let (radius_m, needed_m) = (guard.sensing_radius_m, guard.sensing_radius_needed_m);
    page.write_line("sensing radius", format!("{radius_m:.4} m, needed {needed_m:.4} m"));
    if let Some(speed_cap_m_s) = guard.speed_cap_m_s {
        page.write_line("recommended v_max", format!("at most {speed_cap_m_s:.4} m/s"));
    }
    if let Some(zone_m) = guard.slow_down_zone_m {
        let within_m = a.distance_min_m + zone_m;
        page.write_line(
            "slows down within",
            format!("{within_m:.4} m of another robot (d + {zone_m:.4} m)"),
        );
    }
}

/// Writes braking and wall parameters, and the reasons why distances are not guaranteed.
fn write_inertia_and_walls(page: &mut ReportPage, scenario: &Scenario, theory: &Theory<'_>) {
    let braking = theory.robots.iter().filter_map(|robot| {
        let braking = robot.braking?;
        Some((robot.name, braking_line(&braking)))
    });
    page.write_list("inertia", lines_by_cause(braking));
    if let Some(walls) = &theory.walls {
        let (parts, s) = (walls.parts, if walls.parts == 1 { "" } else { "s" });
        let clearance = format_short(walls.clearance_m);
        let steering =
            walls.deflection_distance_m.map(|m| format!(", steered along them within {m:.4} m"));
        let steering = steering.unwrap_or_default();
        let text =
            format!("{parts} convex part{s}; front points stay {clearance} m away{steering}");
        page.write_line("walls", text);
        let ([robot, wall], start_m) = (walls.start, walls.start_m);
        page.write_line("", format!("{start_m:.4} m at the start ({robot} and {wall})"));
    }
    if let Some(plant) = &scenario.plant_program {
        let command = plant.command_line.join(" ");
        page.write_line("plant", format!("{command}: distances are measured, but not guaranteed"));
    }
}

fn braking_line(braking: &Braking) -> String {
    format!(
        "brakes in {} s at most, stops within {:.4} m ({:.4} m at worst), turns at {} rad/s at most, \
         needs a sensing radius of {:.4} m, v_max up to {} m/s ({})",
        format_short(braking.braking_time_s),
        braking.stopping_distance_m,
        braking.stopping_distance_m_max,
        format_short(braking.turn_rate_max_rad_s),
        braking.sensing_radius_needed_m,
        format_short(braking.speed_max_m_s),
        braking.limited_by
    )
}
