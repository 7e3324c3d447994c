//! Leader failover: deputies (backup leaders) lead when the main leader is lost. Tested in the oracle and with
//! processes.

use experiment::prediction::FailurePredictor;
use experiment::scenario::Scenario;
use formation::Vec2;
use formation::front_point::front_point;
use formation::random::draw_unit_by_number;
use protocol::law::Reference;

use crate::harness::{map_in_parallel, repetition_factor, run};
use crate::oracle::{simulate, simulate_watched, with_faults};

const PENTAGON: [&str; 4] =
    ["repair=spares", "repair_after_s=0.2", "expect={}", "deputies=[\"r4\",\"r3\"]"];
const CONTAINMENT: [&str; 4] =
    ["repair=spares", "repair_after_s=0.2", "expect={}", "deputies=[\"r7\",\"r6\"]"];

/// Two contained robots that may replace the leader `left`.
const ESCORT: [&str; 4] =
    ["repair=spares", "repair_after_s=0.2", "expect={}", "robot.left.deputies=[\"f2\",\"f4\"]"];

/// Returns, by time (s), the maximum distance of robots with slots from their positions in the run without faults, m.
fn slot_error_m(name: &str, set: &[&str], faults: &[&str]) -> Vec<(f64, f64)> {
    let planned = with_faults(name, set, &[]);
    let [without, with] =
        [&[][..], faults].map(|faults| front_point_paths(&with_faults(name, set, faults)));
    let slots = || (0..planned.robots.len()).filter(|&i| keeps_slot(&planned, i));
    let slot_error_m = without.iter().zip(&with).map(|((t_s, expected), (_, found))| {
        let slot_error_m = slots().map(|i| (found[i] - expected[i]).norm());
        (*t_s, slot_error_m.fold(0.0, f64::max))
    });
    slot_error_m.collect()
}

fn keeps_slot(scenario: &Scenario, i: usize) -> bool {
    scenario.robots[i].role.reference == Reference::Offsets
}

/// Returns the front points of all robots (m) at each ground-truth sample, by time (s).
fn front_point_paths(scenario: &Scenario) -> Vec<(f64, Vec<Vec2>)> {
    let mut paths = Vec::new();
    simulate_watched(scenario, |header, rows, _| {
        let ells = scenario.robots.iter().map(|robot| robot.front_point_m);
        let alphas = rows.iter().zip(ells).map(|(row, ell)| front_point(row.pose(), ell));
        paths.push((header.t_ns as f64 / 1e9, alphas.collect()));
    });
    paths
}

fn peak_m(slot_error_m: &[(f64, f64)]) -> f64 {
    slot_error_m.iter().map(|(_, slot_error_m)| *slot_error_m).fold(0.0, f64::max)
}

#[test]
fn deputy_leads_after_leader_death_and_slots_are_kept() {
    let cases = [
        ("pentagon", PENTAGON[3], "r5", "0.2"),
        ("pentagon", "deputies=[\"r1\"]", "r5", "0.5"),
        ("containment", CONTAINMENT[3], "r8", "0.2"),
        ("containment", "deputies=[\"r5\"]", "r8", "0.5"),
    ];
    map_in_parallel(&cases, |(name, deputies, leader, after)| {
        let after = format!("repair_after_s={after}");
        let set = ["repair=spares", &after, "expect={}", "duration_s=26", deputies];
        let kill = format!("kill {leader} @20");
        let slot_error_m = slot_error_m(name, &set, &[&kill]);
        let late: Vec<_> = slot_error_m
            .iter()
            .filter(|(t_s, slot_error_m)| *t_s > 23.0 && *slot_error_m > 0.01)
            .collect();
        assert!(late.is_empty(), "{name} {deputies}: {late:?}");
        // A robot that does not wait for a spare continues without a jump.
        let scenario = with_faults(name, &set, &[&kill]);
        let dead = scenario.leader().unwrap();
        let predicted_m =
            FailurePredictor::new(&scenario).peak_error_m(&[dead], Some(20.0)).unwrap();
        let seen_m = peak_m(&slot_error_m);
        println!("{name} {deputies}: predicted {predicted_m}, measured {seen_m}");
        let both_small = predicted_m < 0.01 && seen_m < 0.01;
        let within = seen_m < 2.0 * predicted_m && predicted_m < 2.0 * seen_m;
        assert!(
            both_small || within,
            "{name} {deputies}: {predicted_m} m predicted, {seen_m} m measured"
        );
        assert_eq!(simulate(&scenario).violations, 0, "{name} {deputies}");
    });
}

#[test]
fn split_network_has_two_agreeing_leaders_until_it_is_mended() {
    let set = [&PENTAGON[..], &["duration_s=10"]].concat();
    let cut = ["cut r5->r4 @5 for 2"];
    let peak_m = peak_m(&slot_error_m("pentagon", &set, &cut));
    assert!(peak_m < 0.005, "the largest deviation was {peak_m} m");
    let ended = run("pentagon").lockstep().sets(&set).faults(cut).finish();
    ended.exits_with(0);
    let events = ended.file("events.csv");
    let at = |what: &str| {
        let row = events.lines().find(|row| row.contains(what));
        let t_s = row.and_then(|row| row.split(',').next()).and_then(|t_s| t_s.parse::<f64>().ok());
        t_s.unwrap_or_else(|| panic!("no {what}: {events}"))
    };
    // Lost after 0.1 s. The leader's frame returns after two ticks.
    ended.assert_holds((at("repair,r4,leads") - 5.1).abs() < 0.01, "r4 leads");
    ended.assert_holds((at("repair,r4,leads no longer") - 7.0).abs() < 0.01, "and gives back");
    let [orphaned, led] = [at("orphaned,r4,"), at("led,r4,")];
    ended.assert_holds(orphaned <= 5.0 && led < 5.2, "it is orphaned until it leads");
}

#[test]
fn returning_leader_resumes_without_a_jump_for_followers() {
    let set = [&PENTAGON[..], &["duration_s=16"]].concat();
    let slot_error_m = slot_error_m("pentagon", &set, &["kill r5 @5 restart 0.5"]);
    let peak_m = peak_m(&slot_error_m);
    println!("{peak_m} m off");
    // The leader resumes within ell (0.15 m) of its path, not at the position of its death.
    assert!(peak_m < 0.3, "the largest deviation was {peak_m} m");
    let late =
        slot_error_m.iter().filter(|(t_s, slot_error_m)| *t_s > 14.0 && *slot_error_m > 0.01);
    assert_eq!(late.count(), 0);
}

/// Returns the distances of robots at a time (s) from the positions of other robots in the run without faults, m.
fn distances_m(faults: &[&str], at_s: f64, slots: &[(&str, &str)]) -> Vec<f64> {
    let set = [&ESCORT[..], &["duration_s=46"]].concat();
    let scenario = with_faults("escort", &set, faults);
    let index_of =
        |name: &str| scenario.robots.iter().position(|robot| robot.name == name).unwrap();
    let [found, planned] = [faults, &[]].map(|faults| {
        let paths = front_point_paths(&with_faults("escort", &set, faults));
        let index = paths.partition_point(|(t_s, _)| *t_s < at_s);
        paths.into_iter().nth(index).unwrap().1
    });
    let distances_m =
        slots.iter().map(|&(robot, of)| (found[index_of(robot)] - planned[index_of(of)]).norm());
    distances_m.collect()
}

#[test]
fn first_live_deputy_replaces_secondary_leader_until_return() {
    let leaders = [("lead", "lead"), ("right", "right")];
    let with = |others: &[(&'static str, &'static str)]| [&leaders[..], others].concat();
    let all = ["lead", "left", "right", "f1", "f2", "f3", "f4", "f5"].map(|name| (name, name));
    type Case = (&'static [&'static str], f64, Vec<(&'static str, &'static str)>);
    let cases: [Case; 4] = [
        (&["kill left @20"], 40.0, with(&[("f2", "left")])),
        (&["kill left @20", "kill f2 @22"], 44.0, with(&[("f4", "left")])),
        // The first deputy is back and receives nothing from `left`: it takes over from the second one.
        (&["kill left @20", "kill f2 @20.5 restart 4"], 44.0, with(&[("f2", "left")])),
        (&["kill left @16 restart 4"], 44.0, all.to_vec()),
    ];
    map_in_parallel(&cases, |(faults, at_s, slots)| {
        let distances_m = distances_m(faults, *at_s, slots);
        assert!(
            distances_m.iter().all(|distance_m| *distance_m < 0.01),
            "{faults:?} {slots:?}: {distances_m:?}"
        );
        let measures = simulate(&with_faults("escort", &ESCORT, faults));
        assert_eq!(measures.violations, 0, "{faults:?}");
        // Errors are relative to the references in use, and the hull has its corner again.
        let [error_m, outside_m] =
            [measures.final_error_m_max, measures.hull_distance_m_max_final].map(Option::unwrap);
        assert!(error_m < 0.01 && outside_m == 0.0, "{faults:?}: {error_m} m, {outside_m} m");
    });
}

#[test]
fn processes_replacing_secondary_leaders_match_prediction() {
    let set = [&ESCORT[..], &["duration_s=9"]].concat();
    let faults = ["kill left @2 restart 4", "kill f2 @4 restart 1", "cut left->f4 @7.5 for 1"];
    let hash = simulate(&with_faults("escort", &set, &faults)).trajectory_hash.unwrap();
    let ended = run("escort").lockstep().sets(&set).faults(faults).finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(ended.hash() == hash, format!("the hash is {hash}"));
    let events = ended.file("events.csv");
    for detail in ["f2,uses lead", "f4,uses f2", "f4,uses lead", "f2,no longer uses lead"] {
        ended.assert_holds(events.contains(&format!(",repair,{detail}")), detail);
    }
}

#[test]
fn containment_with_deputies_matches_the_prediction() {
    let planned = with_faults("escort", &ESCORT, &[]);
    let index_of = |name: &str| planned.robots.iter().position(|robot| robot.name == name).unwrap();
    let broken = |dead: &[&str]| {
        let dead: Vec<usize> = dead.iter().map(|name| index_of(name)).collect();
        let broken = FailurePredictor::new(&planned).broken_robots(&dead, &[], Some(20.0));
        let named = broken.iter().map(|one| one.with_names(&planned.robots));
        named.map(|one| format!("{}: {}", one.robot, one.why)).collect::<Vec<String>>()
    };
    let assert_reason = |dead: &[&str], what: &str| {
        let broken = broken(dead);
        assert!(broken.iter().any(|one| one == what), "{dead:?}: {broken:?}");
    };
    assert_reason(&["left"], "f2: backup leader in the slot of left");
    assert_reason(&["left", "f2"], "f4: backup leader in the slot of left");
    assert!(!broken(&["left"]).iter().any(|one| one.contains("outside the hull")));
}

#[test]
fn processes_led_by_deputies_match_the_prediction() {
    let cases: [(&str, &[&str], &[&str]); 4] = [
        ("pentagon", &PENTAGON, &["kill r5 @2 restart 1.5", "kill r4 @2.5 restart 2"]),
        ("pentagon", &PENTAGON, &["kill r5 @2", "kill r4 @2.05", "freeze r3 @4 for 0.5"]),
        ("pentagon", &PENTAGON, &["cut r5->r4 @2 for 1", "kill r2 @2.3 restart 1"]),
        ("containment", &CONTAINMENT, &["kill r8 @2 restart 2", "kill r6 @3 restart 1"]),
    ];
    map_in_parallel(&cases, |(name, set, faults)| {
        let set = [set, &["duration_s=7"][..]].concat();
        let hash = simulate(&with_faults(name, &set, faults)).trajectory_hash.unwrap();
        let ended = run(name).lockstep().sets(&set).faults(*faults).finish();
        ended.exits_with(0).assert_leaves_nothing();
        ended.assert_holds(ended.hash() == hash, format!("{name} {faults:?}: the hash is {hash}"));
        ended.assert_holds(ended.file("events.csv").contains(",leads"), "a deputy led");
    });
}

#[test]
fn realtime_deputy_leads_and_all_keep_their_distance() {
    let set = [&PENTAGON[..], &["duration_s=6"]].concat();
    let faults = ["kill r5 @2 restart 2", "kill r4 @3 restart 1"];
    let ended = run("pentagon").args(["--pace", "realtime"]).sets(set).faults(faults).finish();
    ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
    ended.assert_holds(ended.file("events.csv").contains(",repair,r4,leads"), "r4 led");
}

/// `PHALANX_TIMES=25 cargo test --test it -- --nocapture succession::killed_leaders`
#[test]
fn killed_leaders_deputies_and_spares_never_violate_d() {
    let draws: Vec<u64> = (0..8 * repetition_factor() as u64).collect();
    map_in_parallel(&draws, |&number| {
        let (name, set) =
            [("pentagon", PENTAGON), ("containment", CONTAINMENT), ("escort", ESCORT)]
                [number as usize % 3];
        let set = [&set[..], &["duration_s=8"]].concat();
        let robots = with_faults(name, &set, &[]).robots;
        let of = |what: u64| draw_unit_by_number(number, what);
        let kill = |k: u64| {
            let robot = ((of(0) * robots.len() as f64) as usize + k as usize) % robots.len();
            let robot = &robots[robot].name;
            let (at_s, after_s) = (0.5 + 6.0 * of(3 * k + 1), 0.05 + 2.0 * of(3 * k + 2));
            format!("kill {robot} @{at_s:.3} restart {after_s:.3}")
        };
        let kills: Vec<String> = (0..3).map(kill).collect();
        let kills: Vec<&str> = kills.iter().map(String::as_str).collect();
        let measures = simulate(&with_faults(name, &set, &kills));
        assert_eq!(measures.violations, 0, "{name} {kills:?}");
    });
}
