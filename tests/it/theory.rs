//! Results of `phalanx check` for the shipped scenarios, compared with sets and numbers that were computed manually.

use std::path::Path;

use experiment::check::Theory;
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read, read_text};
use formation::Vec2;
use serde_json::{Value, json};

use crate::harness::{ExitsWith as _, phalanx};

/// Reads a shipped scenario with these assignments. Returns it with its warnings.
fn scenario(name: &str, set: &[&str]) -> (Scenario, Vec<String>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenarios/{name}.toml"));
    let set = set.iter().map(|&s| s.to_owned()).collect();
    let overrides = Overrides { assignments: set, ..Overrides::default() };
    let (scenario, _, warnings) = read(&path, &overrides, &agent::catalog())
        .unwrap_or_else(|error| panic!("{}", error.render(false)));
    (scenario, warnings.into_iter().map(|warning| warning.message).collect())
}

/// Parses a scenario.
fn from_text(text: &str) -> Scenario {
    read_text("test.toml".as_ref(), text, &Overrides::default(), &agent::catalog())
        .unwrap_or_else(|error| panic!("{}", error.render(false)))
        .0
}

/// Returns the output of `phalanx check --output json` for a shipped scenario.
fn check_json(name: &str) -> Value {
    serde_json::from_str(&Theory::compute(&scenario(name, &[]).0).to_json()).unwrap()
}

/// Returns the deaths with consequences, each with its lists that are not empty.
fn losses(entries: &Value) -> Vec<Value> {
    let without_empty_lists = |entry: &Value| {
        let mut entry = entry.as_object().unwrap().clone();
        entry.remove("breaks");
        entry.retain(|_, value| value.as_array().is_none_or(|list| !list.is_empty()));
        entry
    };
    let lists = |entry: &serde_json::Map<String, Value>| entry.values().any(Value::is_array);
    let entries = entries.as_array().unwrap().iter();
    entries.map(without_empty_lists).filter(lists).map(Value::Object).collect()
}

fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
}

/// Two robots with goals beyond a wall: the goal of `a` is straight behind it, and `b` passes next to it.
const GOALS_BEYOND_A_WALL: &str = r#"
name = "t"
duration_s = 20.0
period_s = 0.02
avoidance = { kind = "guard", distance_min_m = 0.2, speed_max_m_s = 0.5 }
robot_defaults = { front_point_m = 0.05, law = "formation-unit", speed_m_s = 0.3 }
robot = [
    { name = "a", law = "goal-unit", goal_m = [2.0, 0.0], pose = { x_m = -2.05, y_m = 0.0, heading_rad = 0.0 } },
    { name = "b", law = "goal-unit", goal_m = [2.0, 2.0], pose = { x_m = -2.05, y_m = 2.0, heading_rad = 0.0 } },
]
wall = [{ points_m = [[0.0, -3.0], [0.0, 1.0]] }]
"#;

#[test]
fn goal_behind_a_wall_is_reported_by_check_and_summary() {
    let scenario = from_text(GOALS_BEYOND_A_WALL);
    let findings = experiment::check::check_scenario(&scenario);
    let goals: Vec<_> = findings.iter().filter(|found| found.path.ends_with("goal_m")).collect();
    let [goal] = &goals[..] else { panic!("{goals:?}") };
    assert_eq!(goal.path, "robot.a.goal_m");
    assert!(goal.message.starts_with("wall 1 is between a and its goal"), "{}", goal.message);
    let measures = crate::oracle::simulate(&scenario);
    let [wait] = &measures.waits[..] else { panic!("{:?}", measures.waits) };
    assert_eq!(wait.describe(), "a by wall 1 in its path");
    assert!((wait.error_m - 2.1).abs() < 0.1, "{wait:?}");
}

#[test]
fn circle_with_a_negative_period_is_driven_clockwise() {
    let clockwise = "trajectory={kind=\"circle\",radius_m=4.0,period_s=-80.0}";
    let (scenario, _) = scenario("pentagon", &[clockwise, "duration_s=20", "expect={}"]);
    let measures = crate::oracle::simulate(&scenario);
    let error_m = measures.tracking_error_m_max.expect("a leader");
    assert!(error_m < 0.02, "the leader follows it: {error_m} m");
}

/// Returns a scenario of forty robots in a square at a spacing of 0.051 m, at T = 50 ms.
fn crowd(speed_max_m_s: f64) -> String {
    let robot = |i: u32| {
        let (x_m, y_m) = (0.051 * f64::from(i % 7), 0.051 * f64::from(i / 7));
        let pose = format!("{{ x_m = {x_m}, y_m = {y_m}, heading_rad = 0.0 }}");
        match i {
            0 => format!("[[robot]]\nname = \"r0\"\npose = {pose}\n"),
            _ => format!(
                "[[robot]]\nname = \"r{i}\"\npose = {pose}\n[[edge]]\nfrom = \"r{}\"\n\
                 to = \"r{i}\"\noffset_m = [0.5, 0.0]\n",
                i - 1
            ),
        }
    };
    let robots: String = (0..40).map(robot).collect();
    format!(
        "name = \"crowd\"\nduration_s = 30.0\nperiod_s = 0.05\n[avoidance]\n\
         distance_min_m = 0.05\nspeed_max_m_s = {speed_max_m_s}\n[robot_defaults]\n\
         front_point_m = 0.045\nlaw = \"formation-unit\"\nspeed_m_s = 0.1\n{robots}"
    )
}

#[test]
fn possible_sample_overflow_is_reported_with_a_safe_speed() {
    let warnings = |speed_max_m_s: f64| {
        let findings = Theory::compute(&from_text(&crowd(speed_max_m_s))).findings.into_iter();
        findings.filter(|f| f.message.contains("sample holds")).collect::<Vec<_>>()
    };
    let [stand] = &warnings(0.8)[..] else { panic!("expected one warning") };
    assert!(stand.message.starts_with("40 of 40 robots, "), "{}", stand.message);
    let [may] = &warnings(0.22)[..] else { panic!("expected one warning") };
    assert!(
        may.message.contains("robots at the distance d from each other fit within"),
        "{}",
        may.message
    );
    // What is expected is enough, and hardly more is not.
    let expected = may.expected.strip_prefix("expected at most ").unwrap();
    let (speed, rest) = expected.split_once(' ').unwrap();
    assert_eq!(rest, "m/s, or 33 robots");
    let speed: f64 = speed.parse().unwrap();
    assert_eq!((warnings(speed).len(), warnings(speed + 2e-4).len()), (0, 1), "{speed}");
}

#[test]
fn single_death_in_containment_leaves_all_robots_contained() {
    let theory = check_json("containment");
    let deaths = [
        json!({ "robot": "r6", "unled": ["r5"] }),
        json!({ "robot": "r7", "unled": ["r5", "r6"] }),
        json!({
            "robot": "r8",
            "unled": ["r5", "r6", "r7"],
            "adrift": ["r1", "r2", "r3", "r4"],
        }),
    ];
    assert_eq!(losses(&theory["deaths"]), deaths);
    let cuts = [
        json!({ "from": "r6", "to": "r5", "unled": ["r5"] }),
        json!({ "from": "r7", "to": "r6", "unled": ["r5", "r6"], "pulled": ["r7"] }),
        json!({ "from": "r8", "to": "r7", "unled": ["r5", "r6", "r7"] }),
    ];
    assert_eq!(losses(&theory["breaking_cuts"]), cuts);
}

#[test]
fn pentagon_has_the_numbers_of_the_chapter() {
    let (scenario, warnings) = scenario("pentagon", &[]);
    assert_eq!(warnings, Vec::<String>::new());
    let theory = Theory::compute(&scenario);
    assert_near(theory.matrix.iteration_radius, 0.5f64.sqrt(), 1e-12);
    assert_near(theory.matrix.inverse_radius.unwrap(), 2.0 + 2f64.sqrt(), 1e-9);
    assert!(theory.matrix.m_matrix);
    // |m'| of the rose is largest at its center: 2 a w.
    let facts = theory.trajectory.unwrap();
    assert_near(facts.eta_m_m_s, 8.0 * std::f64::consts::TAU / 80.0, 1e-12);
    assert!(facts.eta_c_m_s < facts.eta_m_m_s && facts.horizon_s == 80.0);
    assert_near(theory.bounds.unwrap().lemma_1_m_s, 20.125, 1e-3);
    let epsilon: Vec<f64> = theory.epsilon.iter().map(|rule| rule.epsilon_per_s).collect();
    assert_near(epsilon[2], 201.25, 5e-3);
    assert_near(epsilon[0], epsilon[2] / 3.0, 1e-9);
}

#[test]
fn triangle_has_the_chapter_epsilon_and_no_trajectory() {
    let (scenario, _) = scenario("triangle", &[]);
    let theory = Theory::compute(&scenario);
    let epsilon: Vec<f64> = theory.epsilon.iter().map(|rule| rule.epsilon_per_s).collect();
    assert_eq!(epsilon.len(), 2);
    assert_near(epsilon[0], 3.0, 1e-12);
    assert_near(epsilon[1], 1.0, 1e-12);
    // A directed ring would feed velocities back; this law uses none.
    assert_eq!(theory.matrix.iteration_radius, 0.0);
    assert!(!theory.matrix.m_matrix && theory.matrix.inverse_radius.is_none());
    assert!(theory.trajectory.is_none() && theory.bounds.is_none());
    assert_near(theory.distances.settled.unwrap().distance_m, 0.3, 1e-12);
}

#[test]
fn state_exceeds_lemma_1_bound_and_stays_below_norm_bound() {
    let (scenario, _) = scenario("pentagon", &[]);
    let theory = Theory::compute(&scenario);
    let n = theory.robots.len();
    let inverse = formation::laplacian::Matrix::from_fn(n, n, |i, j| theory.system[i][j]);
    let inverse = inverse.try_inverse().unwrap();
    // All robots start far behind their slots along both axes: alpha' by (29).
    let trajectory = &scenario.lead.as_ref().unwrap().trajectory;
    let pull = |i: usize| {
        let k = scenario.robots[i].correction_max_m_s.unwrap();
        let ahead = if i == n - 1 { trajectory.target_at(0.0).velocity } else { Vec2::zeros() };
        Vec2::new(k, k) + ahead
    };
    let velocity = |i: usize| (0..n).map(|j| inverse[(i, j)] * pull(j)).sum::<Vec2>();
    let speed = (0..n).map(|i| velocity(i).norm_squared()).sum::<f64>().sqrt();
    let bounds = theory.bounds.unwrap();
    assert!(speed > bounds.lemma_1_m_s, "{speed} {bounds:?}");
    assert!(speed < bounds.norm_2_m_s, "{speed} {bounds:?}");
}

#[test]
fn wheels_limited_to_0_5_m_s_cannot_follow_cases_2_and_3() {
    for (name, warned_of_bodies) in [("pentagon", 0), ("containment", 1)] {
        let wheels = |limit| format!("robot_defaults.wheels={{speed_max_m_s={limit},track_m=0.2}}");
        let (_, warnings) = scenario(name, &[&wheels("0.5")]);
        let slow = warnings.iter().filter(|warning| warning.contains("than its limit of 0.5 m/s"));
        assert_eq!(slow.count(), 1, "{name}: {warnings:?}");
        let (_, warnings) = scenario(name, &[&wheels("1.0")]);
        assert_eq!(warnings.len(), warned_of_bodies, "{name}: {warnings:?}");
    }
}

#[test]
fn formation_on_a_circle_rotates_like_a_rigid_body() {
    // The leader's front point is drawn along a circle of radius 2 m once in 40 s; its heading
    // trails the tangent by lambda, sin lambda = ell / radius. r2 keeps its place at c.
    let (radius, ell, turn_rate) = (2.0, 0.1, std::f64::consts::TAU / 40.0);
    let lambda = f64::asin(ell / radius);
    let heading = format!("heading_rad = {:?}", std::f64::consts::FRAC_PI_2 - lambda);
    let text = format!(
        "name = 'circle'\nduration_s = 40.0\nperiod_s = 0.005\n\
         [trajectory]\nkind = 'circle'\nradius_m = {radius:?}\nperiod_s = 40.0\n\
         [avoidance]\ndistance_min_m = 0.2\nspeed_max_m_s = 1.0\n\
         [robot_defaults]\nfront_point_m = {ell:?}\nlaw = 'formation-tanh'\nk_f_m_s = 1.0\n\
         [[robot]]\nname = 'r1'\nlaw = 'leader-tanh'\nk_m_m_s = 1.0\n\
         pose = {{ x_m = 2.0, y_m = 0.0, {heading} }}\n\
         [[robot]]\nname = 'r2'\npose = {{ x_m = 1.0, y_m = 0.0, heading_rad = 0.0 }}\n\
         [[edge]]\nfrom = 'r1'\nto = 'r2'\noffset_m = [-0.8, -0.5]\n"
    );
    let scenario = from_text(&text);
    let theory = Theory::compute(&scenario);
    let facts = theory.trajectory.unwrap();
    assert_near(facts.eta_m_m_s, turn_rate * radius, 1e-12);
    assert_near(facts.eta_c_m_s, turn_rate * 0.8f64.hypot(0.5), 1e-6);
    let center = radius * Vec2::new(-lambda.sin(), lambda.cos()); // in the leader's frame
    let arm = (Vec2::new(-0.8, -0.5) - center).norm();
    assert_near(theory.robots[1].peak.front_speed_m_s, turn_rate * arm, 1e-6);
    for robot in &theory.robots {
        assert_near(robot.peak.w_rad_s, turn_rate, 1e-6);
        assert_eq!(robot.transient, None);
    }
    assert_eq!((theory.trajectory.unwrap().tangent_rad, &theory.findings[..]), (None, &[][..]));

    // A leader that starts across its path swings the others around until it has turned.
    let across = text.replace(&heading, "heading_rad = 0.5");
    assert_ne!(across, text);
    let scenario = from_text(&across);
    let theory = Theory::compute(&scenario);
    assert_near(theory.trajectory.unwrap().tangent_rad.unwrap(), std::f64::consts::FRAC_PI_2, 1e-9);
    // The settled speed is that of a rigid rotation, apart from the lag of the front point, which exists from the
    // start.
    assert_near(theory.robots[1].peak.front_speed_m_s, turn_rate * arm, 0.02 * turn_rate * arm);
    let transient = theory.robots[1].transient.unwrap();
    assert!(
        transient.front_speed_m_s > 2.0 * turn_rate * arm && transient.t_s < 1.0,
        "{transient:?}"
    );
    let alarms: Vec<&str> = theory.findings.iter().map(|f| f.message.as_str()).collect();
    assert!(alarms.len() == 1 && alarms[0].contains("once settled"), "{alarms:?}");
    assert!(theory.findings[0].expected.contains("heading_rad = 1.5708"));
}

#[test]
fn too_low_speed_limit_is_reported() {
    let (scenario, warnings) = scenario("pentagon", &["avoidance.speed_max_m_s=0.7"]);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("faster than the speed limit of 0.7 m/s"), "{warnings:?}");
    assert_eq!(Theory::compute(&scenario).findings.len(), 1);
}

#[test]
fn contained_robots_that_would_meet_are_reported() {
    // r1 and r4 of the containment settle 0.365 m apart at the smallest scale, r4 and r7 0.364 m.
    let (_, warnings) = scenario("containment", &["avoidance.distance_min_m=0.36"]);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("in the settled formation r4 and r7 are 0.36"), "{warnings:?}");
    // These robots yield, and are steered around from 1.12 times the distance of robots with slots.
    let (near, warnings) = scenario("containment", &["avoidance.distance_min_m=0.31"]);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("in the settled formation r4 and r7 are 0.36"), "{warnings:?}");
    let guard = Theory::compute(&near).guard;
    let (keep_distance_m, yield_distance_m) =
        (guard.deflection_distance_m.unwrap(), guard.giving_way_distance_m.unwrap());
    assert!(keep_distance_m < 0.364 && 0.364 < yield_distance_m, "{guard:?}");
    assert_near(yield_distance_m, 1.12 * keep_distance_m, 1e-12);
}

#[test]
fn check_text_and_json_agree() {
    let checked = |args: &[&str]| {
        phalanx([&["check", "scenarios/containment.toml"][..], args].concat()).exits_with(0)
    };
    let mut printed = checked(&["--output", "json"]).json();
    let needs = printed.as_object_mut().unwrap().remove("needs").unwrap();
    assert_eq!(needs["processes"], 8 + 8, "eight robots");
    assert_eq!(printed, check_json("containment"));
    let text = checked(&[]).stdout;
    for part in [
        "r7 hears r6 (slot at r6 + (0.000, -1.200) m), r8 (slot at r8 + (-1.200",
        "without r4: r1: another desired position without r4; ",
        "r3: desired position occupied by r8 (Remark 1)",
        "without r7: ",
        "without r8, the leader: r1, r5, r6, r7: the leader r8 is dead",
        "; r7: held back by r6, which is left behind",
        "spectral radius 0.707107, below 1",
        "3 eta / d = 276.98",
        "(r4 and r7) once settled, at the smallest scale, 0.8 (0.8 to 1.2)",
    ] {
        assert!(text.contains(part), "{part:?} is missing in\n{text}");
    }
}

#[test]
fn goal_robots_without_neighbors_end_at_their_goals() {
    let (antipodal, warnings) = scenario("antipodal-8", &[]);
    assert!(warnings.is_empty(), "{warnings:?}");
    let theory = Theory::compute(&antipodal);
    let goals = antipodal.goals_m().unwrap();
    for (robot, goal) in theory.robots.iter().zip(&goals) {
        assert_eq!(Vec2::from(robot.settled_m), *goal);
    }
    assert!(
        theory
            .deaths
            .iter()
            .all(|death| death.after.loss.is_empty() && death.after.breaks.is_empty())
    );
    assert!(theory.matrix.m_matrix && theory.matrix.inverse_norm_2 == Some(1.0));
    let settled = theory.distances.settled.unwrap().distance_m;
    assert_near(settled, 1.6 * (std::f64::consts::PI / 8.0).sin(), 1e-6);
    // Edges are no references for them, so that a cut has no effect.
    let (with_edge, _) = scenario("antipodal-8", &["robot.r1.hears=[\"r2\"]"]);
    let theory = Theory::compute(&with_edge);
    assert!(theory.breaking_cuts.is_empty() && theory.deaths[1].after.loss.is_empty());
}
