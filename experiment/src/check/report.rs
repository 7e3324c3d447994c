//! What a scenario amounts to, as `phalanx check` prints it: aligned text for people.

use std::cmp::Ordering::Equal;
use std::fmt::Write;

use protocol::number::short;

use super::braking::Braking;
use super::theory::{Death, Epsilon, Gap, Loss, RobotTheory, Theory};
use crate::prediction::{BrokenRobot, broken_means, lines};
use crate::scenario::Scenario;
use formation::seconds;

/// Matrices of more robots than this are not for people.
const MATRIX_ROBOTS_MAX: usize = 12;
/// No list has more lines or names than this.
const LIST_MAX: usize = 24;

/// Lines that begin with a label, or with nothing where they continue the line before.
struct Page(String);

impl Page {
    fn line(&mut self, label: &str, value: impl AsRef<str>) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{label:<24}{}", value.as_ref());
    }

    /// One line for each of `values`, the first with the label; of too many only the first.
    fn list(&mut self, label: &str, values: impl IntoIterator<Item = String>) {
        let mut values = values.into_iter();
        for (i, value) in values.by_ref().take(LIST_MAX).enumerate() {
            self.line(if i == 0 { label } else { "" }, value);
        }
        match values.count() {
            0 => {}
            more => self.line("", format!("... and {more} more: --output json has all")),
        }
    }
}

/// All that is known of a scenario without errors.
pub fn report(scenario: &Scenario, theory: &Theory<'_>) -> String {
    let mut page = Page(String::new());
    page.line("scenario", theory.scenario);
    page.line(
        "time",
        format!(
            "{} s in periods of {} s: {} ticks, seed {}",
            short(seconds(scenario.duration_ns)),
            short(seconds(scenario.period_ns)),
            scenario.duration_ns / scenario.period_ns,
            scenario.seed
        ),
    );
    graph(&mut page, theory);
    fragility(&mut page, theory);
    matrices(&mut page, scenario, theory);
    bounds(&mut page, theory);
    motion(&mut page, theory);
    distances(&mut page, theory);
    closing(&mut page, theory);
    avoidance(&mut page, scenario, theory);
    page.line(
        "silence",
        format!(
            "stale after {} s, lost after {} s",
            short(seconds(scenario.silence.stale_after_ns)),
            short(seconds(scenario.silence.lost_after_ns))
        ),
    );
    page.list(
        "faults",
        scenario
            .faults
            .iter()
            .map(|fault| format!("{} s: {}", short(seconds(fault.at_ns)), fault.words(scenario))),
    );
    page.0
}

/// Who hears whom, who plays which part, and who reaches everybody.
fn graph(page: &mut Page, theory: &Theory<'_>) {
    page.list(
        "who hears whom",
        theory.robots.iter().map(|robot| {
            let heard: Vec<String> = robot
                .hears
                .iter()
                .map(|hears| match hears.offset_m {
                    Some([x, y]) => {
                        format!("{} and wants to be at {0} + ({x:.3}, {y:.3}) m", hears.robot)
                    }
                    None => hears.robot.to_owned(),
                })
                .collect();
            match heard.len() {
                0 => format!("{} hears nobody", robot.name),
                _ => format!("{} hears {}", robot.name, heard.join(", ")),
            }
        }),
    );
    let mut parts: Vec<(&str, Vec<&str>)> = Vec::new();
    for robot in &theory.robots {
        match parts.iter_mut().find(|(does, _)| *does == robot.does) {
            Some((_, of_role)) => of_role.push(robot.name),
            None => parts.push((robot.does, vec![robot.name])),
        }
    }
    for (does, of_role) in parts {
        page.line(does, names(&of_role));
    }
    let contains = theory.robots.iter().any(|robot| robot.contained);
    let reachability = match theory.leader {
        Some(leader) if contains => {
            format!("the leader {leader} reaches all who keep a place (Assumption 5)")
        }
        Some(leader) => format!("the leader {leader} reaches everybody (Assumption 3)"),
        None if theory.robots.iter().all(|robot| robot.has_goal) => {
            "everybody knows its goal, whomever it hears".to_owned()
        }
        None if theory.roots.len() == theory.robots.len() => {
            "anybody's information reaches everybody".to_owned()
        }
        None => format!("everybody is reached from {}", names(&theory.roots)),
    };
    page.line("reachability", reachability);
    if contains {
        page.line("", "one who leads or keeps a place reaches each contained robot (Assumption 4)");
    }
}

/// Which single deaths and cuts, for good, take something from whom, and whom they break.
fn fragility(page: &mut Page, theory: &Theory<'_>) {
    let breaking = |death: &&Death<'_>| !death.loss.is_none() || !death.breaks.is_empty();
    let breaking: Vec<_> = theory.deaths.iter().filter(breaking).collect();
    if breaking.is_empty() {
        page.line("single deaths", "none leaves another robot with less to go by");
    }
    page.list(
        "single deaths",
        breaking.into_iter().map(|death| {
            let leads =
                if theory.leader == Some(death.robot) { ", who leads all others" } else { "" };
            format!("without {}{leads}: {}", death.robot, lost(&death.loss, &death.breaks))
        }),
    );
    if theory.breaking_cuts.is_empty() {
        page.line("single cuts", "none leaves a robot with less to go by");
    }
    page.list(
        "single cuts",
        theory.breaking_cuts.iter().map(|cut| {
            format!("without {} -> {}: {}", cut.from, cut.to, lost(&cut.loss, &cut.breaks))
        }),
    );
    page.line("", broken_means(theory.broken_m));
}

/// What is lost by whom, and who is broken.
fn lost(loss: &Loss<'_>, breaks: &[BrokenRobot<'_>]) -> String {
    let mut parts = Vec::new();
    let mut say = |who: &[&str], one: &str, many: &str| {
        if !who.is_empty() {
            parts.push(format!("{} {}", names(who), if who.len() == 1 { one } else { many }));
        }
    };
    // Whoever is broken is said to be so, with the reason.
    let whole = |who: &[&'_ str]| -> Vec<String> {
        let broken = |robot: &str| breaks.iter().any(|one| one.robot == robot);
        who.iter().filter(|robot| !broken(robot)).map(|&robot| robot.to_owned()).collect()
    };
    let mut said = |who: &[&str], one: &str, many: &str| {
        let who = whole(who);
        say(&who.iter().map(String::as_str).collect::<Vec<_>>(), one, many);
    };
    said(&loss.unled, "loses the leader", "lose the leader");
    said(&loss.pulled, "goes by one without the leader", "go by one without the leader");
    said(&loss.uncontained, "is contained by nobody", "are contained by nobody");
    said(&loss.adrift, "is contained by the unled only", "are contained by the unled only");
    if !loss.groups.is_empty() {
        let groups: Vec<String> = loss
            .groups
            .iter()
            .take(LIST_MAX)
            .map(|group| format!("{{{}}}", names(group)))
            .collect();
        parts.push(format!("the formation falls apart into {}", groups.join(" and ")));
    }
    let broken = lines(breaks.iter().map(|one| (one.robot, one.why.clone())));
    if broken.is_empty() {
        parts.push("nobody is broken".to_owned());
    }
    parts.extend(broken);
    parts.join("; ")
}

/// L, A and what follows from them.
fn matrices(page: &mut Page, scenario: &Scenario, theory: &Theory<'_>) {
    let n = theory.robots.len();
    if n <= MATRIX_ROBOTS_MAX {
        let row = |row: &Vec<f64>, width, digits| {
            let elements = row.iter().map(|x| {
                // No minus before a zero.
                format!(" {:>width$.digits$}", if *x == 0.0 { 0.0 } else { *x })
            });
            elements.collect::<String>()
        };
        page.list("L (4)-(6)", theory.laplacian.iter().map(|elements| row(elements, 3, 0)));
        page.list("A = Lambda L + Gamma", theory.system.iter().map(|elements| row(elements, 7, 4)));
    } else {
        page.line("L, A", format!("{n} x {n}: --output json has them"));
    }
    let matrix = &theory.matrix;
    page.line(
        "",
        match (matrix.inverse_radius, matrix.inverse_norm_2) {
            (Some(radius), Some(norm)) => format!(
                "{}: eigenvalues from {} on, rho(A^-1) = {}, |A^-1| = {}",
                if matrix.m_matrix { "an M-matrix, invertible" } else { "no M-matrix" },
                short(matrix.system_eigenvalue_min),
                short(radius),
                short(norm)
            ),
            _ => "singular: without a leader the offsets fix the shape, and the starts where it is"
                .to_owned(),
        },
    );
    let iterated = scenario.robots.iter().any(|robot| robot.feed_forward);
    page.line(
        "velocity iteration",
        match matrix.iteration_radius {
            _ if !iterated => "none: no law uses the velocities of others".to_owned(),
            0.0 => "spectral radius 0: velocities agree exactly after some ticks".to_owned(),
            radius => format!("spectral radius {}, below 1: velocities agree", short(radius)),
        },
    );
}

/// eta and epsilon, by each rule.
fn bounds(page: &mut Page, theory: &Theory<'_>) {
    if let Some(facts) = &theory.trajectory {
        page.line(
            "trajectory and offsets",
            format!(
                "eta_m = {} m/s, eta_c = {} m/s over {} s",
                short(facts.eta_m_m_s),
                short(facts.eta_c_m_s),
                short(facts.horizon_s)
            ),
        );
    }
    if let Some(bounds) = &theory.bounds {
        page.line(
            "bounds on |alpha'|",
            format!(
                "eta = {} m/s by Lemma 1 (can be exceeded), {} m/s by the 2-norm of A^-1",
                short(bounds.lemma_1_m_s),
                short(bounds.norm_2_m_s)
            ),
        );
        page.line(
            "",
            format!("with k* = {} m/s, eta* = {} m/s", short(bounds.k_m_s), short(bounds.eta_m_s)),
        );
    }
    if theory.epsilon.is_empty() {
        page.line("epsilon", "no rule of the chapter applies to these laws");
    }
    page.list(
        "epsilon by the rules",
        theory.epsilon.iter().map(|epsilon| {
            let Epsilon { rule, source, epsilon_per_s, epsilon_norm_2_per_s } = epsilon;
            let true_bound = epsilon_norm_2_per_s
                .map_or(String::new(), |epsilon| format!(", by the 2-norm {}", short(epsilon)));
            format!("{rule} = {} 1/s ({source}){true_bound}", short(*epsilon_per_s))
        }),
    );
}

/// Peak speeds of everybody once all errors are gone.
fn motion(page: &mut Page, theory: &Theory<'_>) {
    if theory.trajectory.is_none() {
        page.line("once settled", "all stand still");
        return;
    }
    page.list(
        "peaks once settled",
        theory.robots.iter().map(|robot| {
            let peak = &robot.peak;
            let rim = match (peak.rim_speed_m_s, robot.rim_speed_max_m_s) {
                (Some(rim_m_s), Some(limit)) => {
                    format!(", wheel rim {rim_m_s:.4} of {} m/s", short(limit))
                }
                _ => String::new(),
            };
            format!(
                "{} front point {:.4} m/s, v {:.4} m/s, w {:.4} rad/s{rim}",
                robot.name, peak.front_speed_m_s, peak.v_m_s, peak.w_rad_s
            )
        }),
    );
    let front = |robot: &&RobotTheory<'_>| robot.transient.map(|peak| peak.front_speed_m_s);
    let fastest =
        theory.robots.iter().max_by(|a, b| front(a).partial_cmp(&front(b)).unwrap_or(Equal));
    let tangent_rad = theory.trajectory.and_then(|facts| facts.tangent_rad);
    if let (Some(robot), Some(tangent_rad)) = (fastest, tangent_rad)
        && let Some(peak) = robot.transient
    {
        page.line(
            "before that",
            format!(
                "up to {1:.4} m/s ({0} at {2} s), while the leader turns to the heading of its path, {3} rad",
                robot.name,
                peak.front_speed_m_s,
                short(peak.t_s),
                short(tangent_rad)
            ),
        );
    }
    if let Some(limit_m_s) = theory.guard.speed_max_m_s {
        let fastest = theory.robots.iter().map(|robot| robot.peak.front_speed_m_s);
        let fastest_m_s = fastest.fold(0.0, f64::max);
        page.line("", format!("at most {fastest_m_s:.4} of v_max = {} m/s", short(limit_m_s)));
    }
}

/// Where everybody settles, and how near to each other.
fn distances(page: &mut Page, theory: &Theory<'_>) {
    page.list(
        "places once settled",
        theory.robots.iter().map(|robot| {
            let [x, y] = robot.settled_m.map(|c| if c.abs() < 5e-5 { 0.0 } else { c });
            format!("{} ({x:.4}, {y:.4}) m", robot.name)
        }),
    );
    let of = |gap: &Option<Gap<'_>>| {
        gap.map_or("one robot alone".to_owned(), |Gap { robots: [a, b], distance_m }| {
            format!("{distance_m:.4} m ({a} and {b})")
        })
    };
    let distances = &theory.distances;
    let [smallest, largest] = distances.scale.map(short);
    let at_scale = match smallest == largest {
        true => String::new(),
        false => format!(", at the smallest scale, {smallest} ({smallest} to {largest})"),
    };
    let d = short(distances.distance_min_m);
    page.line(
        "smallest distance",
        format!("{} at the start; Assumption 1 asks for {d} m", of(&distances.start)),
    );
    page.line(
        "",
        format!(
            "{} once settled{at_scale}; Remark 1 asks for more than {d} m",
            of(&distances.settled)
        ),
    );
}

/// How the formation opens and closes, and what its places, starts and speeds ask for.
fn closing(page: &mut Page, theory: &Theory<'_>) {
    let Some(closing) = &theory.closing else { return };
    let again = match &closing.reopen_at_s[..] {
        [] => String::new(),
        times => {
            let times: Vec<String> =
                times.iter().map(|&at_s| format!("{} s", short(at_s))).collect();
            format!("; opens again at {}", times.join(", "))
        }
    };
    page.line(
        "opening",
        format!(
            "scale {} for {} s, then closes in {} s{again}; closed for good at {} s",
            short(closing.from),
            short(closing.hold_s),
            short(closing.over_s),
            short(closing.closed_at_s)
        ),
    );
    if let Some(asked) = &closing.asked {
        page.line(
            "",
            format!(
                "asked for: {} for gaps of {} m, {} s for ways of {} m at {} m/s, {} s to close",
                short(asked.from),
                short(asked.gap_m),
                short(asked.hold_s),
                short(asked.way_m),
                short(asked.speed_m_s),
                short(asked.over_s)
            ),
        );
    }
}

/// What keeps them apart.
fn avoidance(page: &mut Page, scenario: &Scenario, theory: &Theory<'_>) {
    let a = &scenario.avoidance;
    let guard = &theory.guard;
    let speed = guard.speed_max_m_s.map_or("no speed limit".to_owned(), |speed_max_m_s| {
        format!("v_max = {} m/s", short(speed_max_m_s))
    });
    page.line("avoidance", format!("{}, d = {} m, {speed}", a.kind, short(a.distance_min_m)));
    page.line("promises", scenario.method.promises);
    if !scenario.method.assumes.is_empty() {
        page.line("assumes", scenario.method.assumes);
    }
    let own = |key: &String| scenario.method.gains.iter().any(|gain| gain.key == key);
    for (key, gain) in a.gains.iter().filter(|(key, _)| own(key)) {
        page.line("", format!("{key} = {}", short(*gain)));
    }
    page.line(
        "command lifetime H",
        format!(
            "{} s in lockstep, {} s in real time",
            short(guard.lifetime_lockstep_s),
            short(guard.lifetime_realtime_s)
        ),
    );
    let [lockstep_s, realtime_s] = guard.late_s;
    if realtime_s > 0.0 {
        page.line(
            "",
            format!(
                "of that {} s and {} s for odometry and commands that are delayed",
                short(lockstep_s),
                short(realtime_s)
            ),
        );
    }
    if let (Some((symbol, _)), Some(distance_m)) =
        (scenario.method.steers_within, guard.deflection_distance_m)
    {
        let more = |m: Option<f64>, whose: &str| {
            m.map(|m| format!(", {m:.4} m for {whose}")).unwrap_or_default()
        };
        let followers = more(guard.following_distance_m, "followers");
        let contained = more(guard.giving_way_distance_m, "the contained");
        let distances = format!("{distance_m:.4} m{followers}{contained}");
        page.line(&format!("no rest within {symbol}"), distances);
    }
    page.line(
        "sensing radius",
        format!("{:.4} m, needed {:.4} m", guard.sensing_radius_m, guard.sensing_radius_needed_m),
    );
    if let Some(speed_cap_m_s) = guard.speed_cap_m_s {
        page.line("cap on v_max", format!("{speed_cap_m_s:.4} m/s"));
    }
    if let Some(zone_m) = guard.slow_down_zone_m {
        page.line(
            "slows down within",
            format!("{:.4} m of another (d + {zone_m:.4} m)", a.distance_min_m + zone_m),
        );
    }
    let braking = theory.robots.iter().filter_map(|robot| {
        let braking = robot.braking?;
        Some((robot.name, braking_line(&braking)))
    });
    page.list("inertia", lines(braking));
    if let Some(walls) = &theory.walls {
        let led = walls.deflection_distance_m.map(|m| format!(", led along them within {m:.4} m"));
        page.line(
            "walls",
            format!(
                "{} convex part{}; front points stay {} m away{}",
                walls.parts,
                if walls.parts == 1 { "" } else { "s" },
                short(walls.clearance_m),
                led.unwrap_or_default()
            ),
        );
        let [robot, wall] = walls.start;
        page.line("", format!("{:.4} m at the start ({robot} and {wall})", walls.start_m));
    }
    if let Some(name) = scenario.voids_the_promise() {
        page.line("", format!("{name} ramps independently: no promise about distances"));
    }
    if let Some(plant) = &scenario.plant {
        let words = plant.words.join(" ");
        page.line("plant", format!("{words}: no promise about distances, which are measured"));
    }
}

fn braking_line(braking: &Braking) -> String {
    format!(
        "brakes in {} s at most, stops within {:.4} m ({:.4} m at worst), turns at {} rad/s at most, \
         must see {:.4} m far, v_max up to {} m/s ({})",
        short(braking.braking_time_s),
        braking.stopping_distance_m,
        braking.stopping_distance_m_max,
        short(braking.turn_rate_max_rad_s),
        braking.sensing_radius_needed_m,
        short(braking.speed_max_m_s),
        braking.limited_by
    )
}

/// The first of these names, and how many there are.
fn names(names: &[&str]) -> String {
    match names.len() {
        n if n > LIST_MAX => format!("{}, ... ({n} in all)", names[..LIST_MAX].join(", ")),
        _ => names.join(", "),
    }
}
