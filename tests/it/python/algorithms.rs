//! Published algorithms in `scenarios/algorithms/`: each gives the result of its page, the same in two runs, and also
//! after a kill and a restart of one robot.

use std::collections::BTreeMap;

use super::{ROOT, installed};
use crate::harness::{FinishedRun, Phalanx};

/// Prepares the lockstep run of an algorithm.
fn algorithm(name: &str) -> Phalanx {
    let mut command = installed();
    command.arg("run").arg(format!("{ROOT}/scenarios/algorithms/{name}/scenario.toml"));
    Phalanx::new(command).lockstep().drawing()
}

/// Returns the final front point of each robot, m.
fn end_points(ended: &FinishedRun) -> BTreeMap<String, [f64; 2]> {
    let samples = ended.file("samples.csv");
    let mut lines = samples.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|&column| column == name).unwrap();
    let [robot, x, y] = ["robot", "front_x_m", "front_y_m"].map(column);
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        (cells[robot].to_owned(), [x, y].map(|column| cells[column].parse().unwrap()))
    };
    lines.map(row).collect()
}

/// Returns the distance of two points, m.
fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Runs an algorithm twice, and once with `fault`, and calls `check` for the first and the last run.
#[track_caller]
fn assert_reproducible(name: &str, fault: &str, check: impl Fn(&FinishedRun)) -> FinishedRun {
    let [first, second] = [(); 2].map(|()| algorithm(name).finish());
    for ended in [&first, &second] {
        ended.exits_with(0).assert_leaves_nothing();
    }
    first.assert_holds(first.hash() == second.hash(), "both runs have the same trajectory hash");
    let messages = |ended: &FinishedRun| ended.summary["message_hash"].clone();
    first.assert_holds(messages(&first) == messages(&second), "and the same messages");
    check(&first);
    let killed = algorithm(name).fault(fault).finish();
    killed.exits_with(0).assert_leaves_nothing();
    let events = killed.file("events.csv");
    killed
        .assert_holds(events.contains(",ready,"), format!("the killed robot came back: {events}"));
    check(&killed);
    first
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn observer_line_follows_a_leader_four_hops_away_within_0_23_mm() {
    assert_reproducible("observer", "kill r3 @10 restart 0.5", |ended| {
        let error_m = ended.number("/final_error_m_max");
        ended.assert_holds(error_m < 2.3e-4, format!("{error_m} m"));
    });
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn filtered_positions_have_a_tenth_of_the_measurement_noise() {
    assert_reproducible("filter", "kill r3 @5 restart 0.5", |ended| {
        let rms_m = rms_slot_error_m(ended);
        ended.assert_holds(
            rms_m < 0.06,
            format!("rms of the places {rms_m} m, of one measurement 0.41 m"),
        );
    });
}

/// Returns the rms distance of eight robots from their slots around the object at (1, 0.5), m.
fn rms_slot_error_m(ended: &FinishedRun) -> f64 {
    let near = |(name, [x, y]): (String, [f64; 2])| {
        let angle = std::f64::consts::TAU * (name[1..].parse::<f64>().unwrap() - 1.0) / 8.0;
        distance_m([x - angle.cos(), y - angle.sin()], [1.0, 0.5]).powi(2)
    };
    let squares: Vec<f64> = end_points(ended).into_iter().map(near).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn resilient_filter_discards_false_messages_and_a_mean_does_not() {
    let first = assert_reproducible("resilient-filter", "kill r5 @10 restart 0.5", |ended| {
        let rms_m = rms_slot_error_m(ended);
        ended.assert_holds(rms_m < 0.06, format!("rms of the places {rms_m} m"));
        ended.assert_holds(
            ended.number("/beacons_refused/r4") == 0.0,
            "false messages have the format",
        );
    });
    let mean = "laws.resilient-filter.params.liars_max=0";
    let misled = algorithm("resilient-filter").set(mean).finish();
    let rms_m = rms_slot_error_m(&misled);
    misled.assert_holds(rms_m > 2.0, format!("without the filter: {rms_m} m"));
    // Every kind of false data, to one receiver only and to all.
    for false_data in [
        "lie r3->r4 scale -2 @5",
        "lie r3 beacons noise 3 @5 for 20",
        "lie r3 beacons offset -1 noise 0.5 by [0.5, 0.0] @2",
    ] {
        let [falsified, second] = [(); 2]
            .map(|()| algorithm("resilient-filter").set("fault=[]").fault(false_data).finish());
        falsified.exits_with(0).assert_leaves_nothing();
        falsified
            .assert_holds(falsified.hash() == second.hash(), "the same false data in both runs");
        falsified.assert_holds(falsified.hash() != first.hash(), "another fault");
        let rms_m = rms_slot_error_m(&falsified);
        falsified.assert_holds(rms_m < 0.06, format!("{false_data}: rms of the places {rms_m} m"));
    }
    let bit_flipped = algorithm("resilient-filter")
        .sets(["fault=[]", "expect={}"])
        .fault("lie r3 beacons flips 0.02 @5")
        .finish();
    bit_flipped.exits_with(0).assert_leaves_nothing();
    let rms_m = rms_slot_error_m(&bit_flipped);
    bit_flipped.assert_holds(rms_m < 0.06, format!("inverted bits: rms of the places {rms_m} m"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn auction_matches_robots_and_goals_optimally() {
    assert_reproducible("auction", "kill r3 @2 restart 0.5", |ended| {
        let scenario =
            std::fs::read_to_string(format!("{ROOT}/scenarios/algorithms/auction/scenario.toml"));
        let scenario: toml::Table = scenario.unwrap().parse().unwrap();
        let goals = scenario["laws"]["auction"]["params"]["goals_m"].as_array().unwrap();
        let goals: Vec<[f64; 2]> =
            goals.iter().map(|goal| [0, 1].map(|i| goal[i].as_float().unwrap())).collect();
        let starts: Vec<[f64; 2]> = (0..7).map(|i| [0.0, 0.8 * f64::from(i)]).collect();
        let end_points: Vec<[f64; 2]> = end_points(ended).into_values().collect();
        let goal_of = |end: &[f64; 2]| goals.iter().position(|goal| distance_m(*goal, *end) < 1e-2);
        let found: Vec<Option<usize>> = end_points.iter().map(goal_of).collect();
        let found_m: f64 =
            starts.iter().zip(&end_points).map(|(start, end)| distance_m(*start, *end)).sum();
        let shortest = shortest_m(&starts, &goals, &mut vec![false; 7]);
        ended.assert_holds(
            found.iter().all(Option::is_some),
            format!("each robot is at a goal: {found:?}"),
        );
        ended.assert_holds(
            (found_m - shortest).abs() < 0.014,
            format!("{found_m} m, the optimum is {shortest} m"),
        );
    });
}

/// Returns the smallest sum of distances of a matching of `starts` with the goals that are not matched yet, m.
fn shortest_m(starts: &[[f64; 2]], goals: &[[f64; 2]], is_matched: &mut Vec<bool>) -> f64 {
    let Some((start, others)) = starts.split_first() else { return 0.0 };
    let mut shortest = f64::INFINITY;
    for goal in 0..goals.len() {
        if !is_matched[goal] {
            is_matched[goal] = true;
            shortest = shortest
                .min(distance_m(*start, goals[goal]) + shortest_m(others, goals, is_matched));
            is_matched[goal] = false;
        }
    }
    shortest
}

/// Returns the robots that stand 0.5 m in front of their places at the end.
fn leaders(ended: &FinishedRun) -> Vec<String> {
    let end_points = end_points(ended);
    end_points.into_iter().filter(|(_, [_, y])| *y > 0.49).map(|(name, _)| name).collect()
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn election_has_one_leader_before_and_after_its_death() {
    assert_reproducible("election", "kill r1 @5 restart 2", |ended| {
        ended.assert_holds(leaders(ended) == ["r1"], format!("r1 leads: {:?}", leaders(ended)));
    });
    let ended = algorithm("election").set("expect={}").fault("kill r1 @5").finish();
    ended
        .assert_holds(leaders(&ended).contains(&"r2".to_owned()), format!("{:?}", leaders(&ended)));
    let samples = ended.file("samples.csv");
    let r2 = samples.lines().filter(|line| line.contains(",r2,"));
    let moved = r2.map(|line| line.split(',').collect::<Vec<_>>());
    let moved = moved.map(|cells| [cells[0], cells[3]].map(|cell| cell.parse::<f64>().unwrap()));
    let [first_s, _] = moved.into_iter().find(|[t_s, y_m]| *t_s > 5.0 && *y_m > 1e-4).unwrap();
    ended.assert_holds((5.5..5.7).contains(&first_s), format!("r2 steps forward at {first_s} s"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn admm_reaches_the_minimum_within_1e_6_also_after_a_restart() {
    let scenario =
        std::fs::read_to_string(format!("{ROOT}/scenarios/algorithms/admm/scenario.toml"));
    let scenario: toml::Table = scenario.unwrap().parse().unwrap();
    let (mut weights, mut sums) = (0.0, [0.0; 2]);
    for robot in scenario["robot"].as_array().unwrap() {
        let weight = robot["params"]["w"].as_float().unwrap();
        weights += weight;
        (0..2).for_each(|i| sums[i] += weight * robot["params"]["a_m"][i].as_float().unwrap());
    }
    let optimum = sums.map(|sum| sum / weights);
    assert_reproducible("admm", "kill r3 @5 restart 0.5", |ended| {
        for (name, [x, y]) in end_points(ended) {
            let angle = std::f64::consts::TAU * (name[1..].parse::<f64>().unwrap() - 1.0) / 6.0;
            let error_m = distance_m([x - angle.cos(), y - angle.sin()], optimum);
            ended.assert_holds(
                error_m < 2e-6,
                format!("{name} is {error_m} m from its place at the minimum"),
            );
        }
    });
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn event_triggered_robots_meet_with_few_messages() {
    let first = assert_reproducible("event-triggered", "kill r3 @5 restart 0.5", |ended| {
        let end_points: Vec<[f64; 2]> = end_points(ended).into_values().collect();
        let spread_m =
            end_points.iter().map(|end| distance_m(*end, end_points[0])).fold(0.0, f64::max);
        ended.assert_holds(spread_m < 0.02, format!("all within {spread_m} m"));
        for name in ["r1", "r2", "r3", "r4", "r5"] {
            let [beacons, messages] =
                ["beacons", "messages"].map(|what| ended.number(&format!("/{what}_sent/{name}")));
            ended.assert_holds(beacons == messages, "no beacon without a message");
            ended.assert_holds(
                (5.0..=60.0).contains(&messages),
                format!("{name}: {messages} of 3,000"),
            );
        }
    });
    first.assert_holds(
        first.summary["converged_at_s"].is_null(),
        "without a target nothing is judged",
    );
    // Thresholds of 0: each robot sends at each sample.
    let set = ["robot_defaults.c_0_m=1e-9", "robot_defaults.c_1_m=1e-9"];
    let periodic = algorithm("event-triggered").sets(set).finish();
    periodic.exits_with(0).assert_leaves_nothing();
    let figures = |ended: &FinishedRun| {
        let sent =
            ["r1", "r2", "r3", "r4", "r5"].map(|n| ended.number(&format!("/messages_sent/{n}")));
        // The mean of the starts.
        let error_m = end_points(ended).into_values().map(|end| distance_m(end, [0.8, 0.6]));
        (sent, error_m.fold(0.0, f64::max))
    };
    let ((triggered_counts, triggered_error_m), (periodic_counts, error_m)) =
        (figures(&first), figures(&periodic));
    println!(
        "event-triggered: messages {triggered_counts:?}, off the mean by {triggered_error_m} m"
    );
    println!("periodic: messages {periodic_counts:?}, off the mean by {error_m} m");
    periodic.assert_holds(
        periodic_counts.iter().all(|sent| *sent >= 2000.0),
        format!("{periodic_counts:?} of 3,000"),
    );
    first.assert_holds(
        triggered_error_m < error_m + 0.01,
        format!("{triggered_error_m} m, periodic {error_m} m"),
    );
    first.assert_holds(
        first.stdout.contains(" sent with "),
        "the screen has the number of messages",
    );
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn trained_policy_drives_robots_into_their_slots() {
    assert_reproducible("policy", "kill r3 @15 restart 0.5", |ended| {
        let error_m = ended.number("/final_error_m_max");
        ended.assert_holds(error_m < 1e-3, format!("{error_m} m"));
        let min_distance_m = ended.number("/min_distance_m");
        ended.assert_holds(min_distance_m >= 0.2, format!("{min_distance_m} m of 0.2 m"));
    });
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn predictive_control_keeps_the_distance_by_plans_alone() {
    assert_reproducible("mpc", "kill r3 @20 restart 1", |ended| {
        let min_distance_m = ended.number("/min_distance_m");
        ended.assert_holds(min_distance_m >= 0.4, format!("{min_distance_m} m of 0.4 m"));
        let error_m = ended.number("/final_error_m_max");
        ended.assert_holds(error_m < 0.02, format!("all are at their goals: {error_m} m"));
    });
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn consensus_meets_in_the_predicted_weighted_mean() {
    assert_reproducible("consensus", "kill r3 @15 restart 0.5", |ended| {
        let end_points: Vec<[f64; 2]> = end_points(ended).into_values().collect();
        let spread_m =
            end_points.iter().map(|end| distance_m(*end, end_points[0])).fold(0.0, f64::max);
        ended.assert_holds(spread_m < 1e-3, format!("all within {spread_m} m"));
        // The left null vector of the weighted Laplacian is (3, 1, 1, 3) / 8.
        let error_m = distance_m(end_points[0], CONSENSUS_M);
        ended.assert_holds(
            error_m < 0.01,
            format!("{error_m} m from the prediction, {end_points:?}"),
        );
    });
}

/// Weighted mean of the starts of `consensus`, m.
const CONSENSUS_M: [f64; 2] = [0.25, 0.875];

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn pursuing_robots_circle_with_equal_radii() {
    assert_reproducible("pursuit", "kill r3 @38 restart 0.1", |ended| {
        let end_points: Vec<[f64; 2]> = end_points(ended).into_values().collect();
        let center = [0, 1].map(|i| end_points.iter().map(|end| end[i]).sum::<f64>() / 5.0);
        let radii: Vec<f64> = end_points.iter().map(|end| distance_m(*end, center)).collect();
        let [minimum, maximum] =
            [f64::min, f64::max].map(|pick| radii.iter().copied().reduce(pick).unwrap());
        ended.assert_holds(minimum > 0.3 && maximum < 1.2 * minimum, format!("radii {radii:?}"));
    });
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn distances_form_a_square_and_nothing_is_judged() {
    let first = assert_reproducible("distances", "kill r3 @5 restart 0.5", |ended| {
        let end_points: Vec<[f64; 2]> = end_points(ended).into_values().collect();
        for (i, j, desired_m) in [(0, 1, 1.0), (1, 2, 1.0), (2, 3, 1.0), (0, 2, 2f64.sqrt())] {
            let error_m = (distance_m(end_points[i], end_points[j]) - desired_m).abs();
            ended.assert_holds(error_m < 1e-6, format!("{error_m} m"));
        }
    });
    first.assert_holds(first.summary["is_unjudged"] == true, "no error, no convergence");
    let error_m = first.number("/metrics/distance_error_m");
    first.assert_holds(error_m < 1e-6, format!("the metric of the scenario: {error_m} m"));
    let lines: Vec<&str> = first.stdout.lines().filter(|line| line.contains("converged")).collect();
    first.assert_holds(lines.is_empty(), format!("{lines:?}"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn bearings_form_a_house_on_two_anchors() {
    assert_reproducible("bearings", "kill r3 @5 restart 0.5", |ended| {
        let positions = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 1.8]];
        for ((name, end), position) in end_points(ended).into_iter().zip(positions) {
            let error_m = distance_m(end, position);
            ended.assert_holds(error_m < 1e-6, format!("{name} is {error_m} m from its place"));
        }
    });
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn flock_stays_connected_with_equal_velocities() {
    assert_reproducible("flocking", "kill r3 @5 restart 0.5", |ended| {
        let end_points: Vec<[f64; 2]> = end_points(ended).into_values().collect();
        for (i, end) in end_points.iter().enumerate() {
            let others = end_points.iter().enumerate().filter(|(j, _)| *j != i);
            let nearest_m = others.map(|(_, other)| distance_m(*end, *other)).fold(9.0, f64::min);
            ended
                .assert_holds((0.3..0.9).contains(&nearest_m), format!("nearest at {nearest_m} m"));
        }
        let error_m_s = ended.number("/metrics/velocity_error_m_s");
        ended.assert_holds(error_m_s < 1e-3, format!("velocities off by {error_m_s} m/s"));
        let samples = ended.file("samples.csv");
        let header: Vec<&str> = samples.lines().next().unwrap().split(',').collect();
        let speed = header.iter().position(|&column| column == "v_m_s").unwrap();
        for line in samples.lines().rev().take(end_points.len()) {
            let v_m_s: f64 = line.split(',').nth(speed).unwrap().parse().unwrap();
            ended.assert_holds((v_m_s - 0.1).abs() < 1e-3, format!("all move at 0.1 m/s: {line}"));
        }
    });
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn coverage_converges_to_the_centroids() {
    assert_reproducible("coverage", "kill r3 @5 restart 0.5", |ended| {
        let error_m = ended.number("/final_error_m_max");
        ended.assert_holds(
            error_m < 0.01,
            format!("each is {error_m} m from the centroid of its cell"),
        );
        let cost_m2 = ended.number("/metrics/cost_m2");
        ended.assert_holds(
            (0.02..0.035).contains(&cost_m2),
            format!("locational cost {cost_m2} m2"),
        );
        let report = ended.file("report.html");
        ended.assert_holds(report.contains("figures/signals.svg"), "the report has the figure");
        ended.assert_holds(ended.file("figures/signals.svg").contains(">cost_m2<"), "of the cost");
        for (name, end) in end_points(ended) {
            ended.assert_holds(
                end.iter().all(|x| (0.0..1.0).contains(x)),
                format!("{name}: {end:?}"),
            );
        }
    });
}

/// A robot with a built-in law, and one with the law `publish` of the tests.
const PUBLISH: &str = r#"
name = "publish"
duration_s = 1.0
period_s = 0.01

[avoidance]
distance_min_m = 0.2
speed_max_m_s = 0.5

[laws.publish]
program = ["python3", "publish.py"]
role = "free"
params = { kind = "none" }
message = { v_m_s = 2, bid = 1 }
withholds = true
signals = ["cost_m2"]

[robot_defaults]
front_point_m = 0.1

[[robot]]
name = "r1"
law = "goal-unit"
speed_m_s = 0.1
goal_m = [1.0, 0.0]
pose = { x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }

[[robot]]
name = "r2"
law = "publish"
hears = ["r1"]
restart_policy = "never"
pose = { x_m = 0.0, y_m = 1.0, heading_rad = 0.0 }
"#;

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn wrong_messages_and_targets_end_the_law_and_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("publish.toml");
    std::fs::write(&scenario, PUBLISH).unwrap();
    std::fs::copy(super::law("publish"), folder.path().join("publish.py")).unwrap();
    let run = |kind: &str| {
        let mut command = installed();
        command.arg("run").arg(&scenario);
        let run = Phalanx::new(command).lockstep();
        run.set(format!("laws.publish.params.kind=\"{kind}\"")).finish()
    };
    for (kind, part) in [
        ("long", "`v_m_s` has 3 elements where 2 are declared"),
        ("missing", "the message has no `bid`, expected { bid = 1, v_m_s = 2 }"),
        ("unknown", "the message has `price`, which is not declared"),
        ("nan", "the message has NaN in `v_m_s`, expected finite numbers"),
        ("text", "`v_m_s` has 'ab', expected 2 numbers"),
        ("bytes", "publish was called with bytes, expected { bid = 1, v_m_s = 2 }"),
        ("both", "publish and withhold were both called for one answer"),
        (
            "signal",
            "record was called with `costs`, which the law does not declare, expected one of cost_m2",
        ),
        ("infinite", "the signal `cost_m2` is inf, expected a finite number"),
        ("target", "the position of the target is (0.0, inf), expected two finite numbers"),
    ] {
        let ended = run(kind);
        ended.exits_with(1).assert_leaves_nothing();
        super::stderr_contains(&ended, part);
        super::stderr_contains(&ended, "publish.py");
    }
    let ended = run("none");
    ended.exits_with(0);
    let sent = |what: &str| ended.number(&format!("/{what}_sent/r2"));
    ended.assert_holds(sent("messages") == 50.0, "50 messages before 0.5 s");
    ended.assert_holds(sent("beacons") == 100.0, "a beacon at each of 100 ticks");
    ended.assert_holds(ended.number("/beacons_sent/r1") == 100.0, "also of the built-in law");
    let silent = run("silent");
    silent.exits_with(0);
    silent.assert_holds(silent.number("/messages_sent/r2") == 0.0, "a law that publishes nothing");
    silent
        .assert_holds(silent.number("/beacons_sent/r2") == 100.0, "its beacons leave without one");
}

/// Two robots that exchange the messages of `exchange.py` every millisecond, and stand.
const EXCHANGE: &str = r#"
name = "exchange"
duration_s = 5.0
period_s = 0.001

[avoidance]
distance_min_m = 0.2
speed_max_m_s = 0.5

[laws.exchange]
program = ["python3", "exchange.py"]
role = "free"
params = { kind = "bytes" }
message_bytes_max = 64
message_queue = 4
signals = ["seen"]

[metrics.seen]
signal = "seen"

[robot_defaults]
front_point_m = 0.1
law = "exchange"

[[robot]]
name = "r1"
hears = ["r2"]
pose = { x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }

[[robot]]
name = "r2"
hears = ["r1"]
pose = { x_m = 0.0, y_m = 1.0, heading_rad = 0.0 }
"#;

/// Prepares a run of [`EXCHANGE`] in `folder`, with messages of numbers if `of_numbers`.
fn exchange(folder: &std::path::Path, of_numbers: bool) -> Phalanx {
    let scenario = folder.join("exchange.toml");
    let bytes = "params = { kind = \"bytes\" }\nmessage_bytes_max = 64";
    let numbers = "params = { kind = \"numbers\" }\nmessage = { x_m = 2, n = 1 }";
    let text = if of_numbers { EXCHANGE.replace(bytes, numbers) } else { EXCHANGE.into() };
    std::fs::write(&scenario, text).unwrap();
    std::fs::copy(super::law("exchange"), folder.join("exchange.py")).unwrap();
    let mut command = installed();
    command.arg("run").arg(&scenario);
    Phalanx::new(command)
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn ten_thousand_drawn_messages_arrive_as_they_were_sent() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = [(); 2].map(|()| exchange(folder.path(), false).lockstep().finish());
    for ended in [&first, &second] {
        ended.exits_with(0).assert_leaves_nothing();
        for name in ["r1", "r2"] {
            let count = |what: &str| ended.number(&format!("/messages_{what}/{name}"));
            ended.assert_holds(count("sent") == 5000.0, format!("{name} sent 5,000 messages"));
            ended.assert_holds(count("dropped") == 0.0, "none was dropped");
        }
        ended.assert_holds(ended.number("/metrics/seen") >= 4998.0, "the law saw each of them");
    }
    let hash = |ended: &FinishedRun| ended.summary["message_hash"].clone();
    first.assert_holds(hash(&first) == hash(&second), "the same messages");
    // Inverted bits: what arrives still has a permitted length, and no process fails.
    let bit_flipped = exchange(folder.path(), false).lockstep();
    let bit_flipped = bit_flipped.set("laws.exchange.params.kind=falsified");
    let bit_flipped = bit_flipped.fault("lie * beacons flips 0.5 @0").finish();
    bit_flipped.exits_with(0).assert_leaves_nothing();
    bit_flipped.assert_holds(hash(&bit_flipped) == hash(&first), "the same messages were sent");
    let numbers = exchange(folder.path(), true).lockstep();
    let numbers = numbers.fault("lie * beacons flips 0.2 @0").finish();
    numbers.exits_with(0).assert_leaves_nothing();
    let refused = numbers.number("/beacons_refused/r1");
    numbers.assert_holds(refused > 0.0, format!("{refused} refused: not finite"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn messages_that_no_law_processes_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    // Without odometry r2 calls no law for 10 ticks, and keeps the newest 4 messages.
    let set = ["duration_s=1.0", "period_s=0.01"];
    let without_odometry = exchange(folder.path(), true).lockstep().sets(set);
    let without_odometry = without_odometry.fault("blackout r2 odometry @0.2 for 0.1").finish();
    without_odometry.exits_with(0).assert_leaves_nothing();
    let dropped = without_odometry.number("/messages_dropped/r2");
    without_odometry.assert_holds((5.0..=7.0).contains(&dropped), format!("{dropped} dropped"));
    without_odometry
        .assert_holds(without_odometry.number("/messages_dropped/r1") == 0.0, "none of r1");
    let frozen = exchange(folder.path(), true).lockstep().sets(set);
    let frozen = frozen.fault("freeze r2 @0.2 for 0.5").finish();
    frozen.exits_with(0).assert_leaves_nothing();
    let dropped = frozen.number("/messages_dropped/r2");
    frozen
        .assert_holds((45.0..=51.0).contains(&dropped), format!("{dropped} dropped while frozen"));
    let realtime = exchange(folder.path(), true).args(["--pace", "realtime"]).sets(set);
    let realtime = realtime.fault("freeze r2 @0.2 for 0.5").finish();
    realtime.exits_with(0).assert_leaves_nothing();
    let dropped = realtime.number("/messages_dropped/r2");
    realtime.assert_holds(
        (1.0..=51.0).contains(&dropped),
        format!("{dropped} dropped by the queue of 16"),
    );
    realtime
        .assert_holds(realtime.stdout.contains("messages dropped"), "the screen has the number");
}
