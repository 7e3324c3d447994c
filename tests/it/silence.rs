//! Robots that fall silent: which robots continue, which stop, which faults are reported, and how the formation
//! recovers.

use crate::harness::{FinishedRun, run};

/// Returns speeds and turn rates of a robot in `samples.csv` from `from_s` to before `until_s`.
fn motion(ended: &FinishedRun, robot: &str, from_s: f64, until_s: f64) -> Vec<(f64, f64)> {
    let samples = ended.file("samples.csv");
    let rows = samples.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
    let number = |field: &str| field.parse::<f64>().unwrap();
    rows.filter(|row| row[1] == robot && (from_s..until_s).contains(&number(row[0])))
        .map(|row| (number(row[5]), number(row[6])))
        .collect()
}

#[track_caller]
fn assert_stopped(ended: &FinishedRun, robot: &str, from_s: f64, until_s: f64) {
    let motion = motion(ended, robot, from_s, until_s);
    let moves = motion.iter().find(|(v_m_s, w_rad_s)| v_m_s.hypot(*w_rad_s) > 1e-3);
    ended.assert_holds(motion.len() > 10, format!("{robot} is recorded from {from_s} s"));
    ended.assert_holds(moves.is_none(), format!("{robot} must stop from {from_s} s on: {moves:?}"));
}

#[track_caller]
fn names(ended: &FinishedRun, pointer: &str) -> Vec<String> {
    let list = ended.summary.pointer(pointer).and_then(|list| list.as_array());
    list.expect(pointer).iter().map(|name| name.as_str().unwrap().to_owned()).collect()
}

#[test]
fn leader_death_reaches_every_robot_and_none_spins() {
    let ended = run("pentagon")
        .lockstep()
        .sets(["duration_s=40", "expect={}"])
        .fault("kill r5 @20")
        .finish();
    ended.exits_with(0);
    ended.assert_holds(
        names(&ended, "/faults/0/predicted") == ["r1", "r2", "r3", "r4"],
        "the prediction names all other robots",
    );
    let events = ended.file("events.csv");
    for robot in ["r1", "r2", "r3", "r4"] {
        let event = format!(",contact,{robot},lost frame of the leader");
        ended.assert_holds(
            events.contains(&event),
            format!("{robot} reports that the frame is lost"),
        );
        assert_stopped(&ended, robot, 30.0, 40.0);
    }
    ended.assert_holds(ended.number("/min_distance_m") >= 0.3, "no distance is below d");
}

#[test]
fn cut_breaks_exactly_the_predicted_robots() {
    let all = &["r1", "r2", "r3", "r4"][..];
    for (cut, broken, expected_affected) in [
        ("r5->r4", all, all),
        // r1 stops and blocks r2. r2 does not detect it, and stops where r1 and r3 want it.
        ("r2->r1", &["r1", "r2"], &["r1"]),
    ] {
        let ended = run("pentagon")
            .lockstep()
            .set("duration_s=40")
            .set("expect={ min_distance_m = 0.3, final_error_m_max = 1e-3 }")
            .fault(&format!("cut {cut} @20 for 4"))
            .finish();
        ended.exits_with(0);
        let (predicted, affected) =
            (names(&ended, "/faults/0/predicted"), names(&ended, "/faults/0/affected"));
        ended.assert_holds(predicted == broken, format!("{cut}: the prediction is {predicted:?}"));
        ended.assert_holds(
            affected == expected_affected,
            format!("{cut}: off by those they hear are {affected:?}"),
        );
        let seen = names(&ended, "/faults/0/broken");
        ended.assert_holds(seen == broken, format!("{cut}: seen is {seen:?}"));
        ended.assert_holds(ended.number("/faults/0/recovered_after_s") < 10.0, "all come back");
        let events = ended.file("events.csv");
        let last = events.lines().rfind(|line| line.contains(",contact,")).unwrap_or_default();
        ended.assert_holds(last.contains("fresh"), format!("all robots are heard again: {last}"));
    }
}

#[test]
fn silent_neighbors_are_ignored_kept_or_awaited_by_policy() {
    for policy in ["last", "ignore", "keep", "stop"] {
        let continues = ["last", "keep"].contains(&policy);
        let ended = run("triangle")
            .lockstep()
            .sets(["duration_s=20", "expect={}", &format!("silence.policy={policy}")])
            .fault("freeze r3 @2 for 6")
            .finish();
        ended.exits_with(0);
        // r2 receives only from the silent r3: without a reference it stops, unless the kept position still gives it a
        // target.
        if !continues {
            assert_stopped(&ended, "r2", 2.5, 8.0);
        }
        let moved = motion(&ended, "r2", 2.5, 3.0).iter().any(|(v_m_s, _)| v_m_s.abs() > 0.01);
        ended.assert_holds(moved == continues, format!("{policy}: r2 continues: {moved}"));
        ended
            .assert_holds(ended.number("/final_error_m_max") < 1e-3, "the formation has recovered");
    }
}

#[test]
fn cut_orphans_robots_downstream_with_growing_age() {
    let ended = run("pentagon-cut").lockstep().finish();
    ended.exits_with(0);
    let all = ["r1", "r2", "r3", "r4"];
    ended.assert_holds(
        names(&ended, "/faults/0/orphaned") == all,
        "the fault lists the orphaned robots",
    );
    let events = ended.file("events.csv");
    for (t_s, kind, detail) in
        [(20, "orphaned", "no living leader reaches it"), (24, "led", "a leader reaches it again")]
    {
        for robot in all {
            let line = format!("\n{t_s},{kind},{robot},{detail},,,,\n");
            ended.assert_holds(events.matches(&line).count() == 1, format!("once: {line:?}"));
        }
    }
    ended.assert_holds(!events.contains(",orphaned,r5,"), "a leader needs no leader");
    let ages = ended.summary["information_ages"].as_array().expect("ages").clone();
    ended.assert_holds(ages.len() == 6, format!("every edge has an age: {ages:?}"));
    for age in &ages {
        let (peak_s, mean_s) =
            (age["peak_ns"].as_f64().unwrap() / 1e9, age["mean_ns"].as_f64().unwrap() / 1e9);
        let cut = age["from"] == "r5";
        // Beacons have an age of one period (2 ms) when they arrive, and of two when the next ones arrive.
        let (peak, mean) = if cut { (4.002, 0.1..0.2) } else { (0.004, 0.00299..0.00301) };
        let right = (peak_s - peak).abs() < 0.003 && mean.contains(&mean_s);
        ended.assert_holds(right, format!("the age of {age}"));
    }
}
