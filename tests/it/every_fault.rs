//! Every kind of fault in lockstep: predicted bit for bit, survived, reported, and without effect after its end.

use crate::harness::{map_in_parallel, run};
use crate::oracle::{self, with_faults};

/// Faults on the way into the formation, and whether each changes the trajectory.
const FAULTS: [(&str, bool); 28] = [
    ("kill r2 @2.5 restart 2", true),
    ("freeze r2 @2.5 for 1.5", true),
    ("slow r2 by 0.005 @2 for 1", true),
    // Less than a period: the answers still arrive in time.
    ("slow r2 by 0.004 @2 for 1", false),
    ("cut r3->r2 @2 for 2", true),
    ("loss r2->r1 of 0.9 @1 for 5", true),
    ("loss r2->r1 of 0.9 burst 7 @1 for 5", true),
    ("delay r2->r1 by 0.2 @1 for 5", true),
    ("delay r2->r1 by 0.02 jitter 0.1 @1 for 5", true),
    ("bursts r2->r1 of 0.6 mean 0.3 @1 for 5", true),
    ("fading r2->r1 range 0.3 exponent 3 @1 for 5", true),
    ("lie r2 beacons by [0.1, -0.05] drift [0.0, 0.02] @2 for 5", true),
    ("lie r2->r1 random 0.2 @2 for 5", true),
    // Without a leader, there is no frame to forward.
    ("lie r2 beacons turn 0.5 @2 for 5", false),
    ("loss r2 odometry of 0.3 burst 4 @1 for 5", true),
    ("loss r2 commands of 0.3 @1 for 5", true),
    ("bursts r1 commands of 0.4 mean 0.1 @1 for 5", true),
    ("delay r2 odometry by 0.012 jitter 0.01 @1 for 5", true),
    ("delay r2 commands by 0.012 @1 for 5", true),
    ("blackout r1 odometry @2 for 1", true),
    ("blackout r1 proximity @2 for 1", true),
    ("noise r1 odometry by 0.01 @2 for 5", true),
    ("noise r1 odometry by 0.01 heading 0.05 @2 for 5", true),
    ("noise r1 proximity by 0.01 @2 for 5", true),
    ("wheels r1 stuck @2 for 1", true),
    ("wheels r1 limit 0.03 @2 for 4", true),
    ("load of 2 @2 for 1", false),
    // Between two ticks: the robot only misses the beacons of the second one.
    ("freeze r2 @2.5011 for 0.002", true),
];

#[test]
fn every_fault_is_predicted_and_recovered_without_traces() {
    let set = ["duration_s=20", "expect={}"];
    map_in_parallel(&FAULTS, |&(fault, changes)| {
        let ended = run("triangle").lockstep().sets(set).fault(fault).finish();
        ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
        let predicted = oracle::simulate(&with_faults("triangle", &set, &[fault]));
        let hash = predicted.trajectory_hash.unwrap();
        ended.assert_holds(ended.hash() == hash, format!("{fault}: the hash is {hash}"));
        let undisturbed = oracle::simulate(&with_faults("triangle", &set, &[])).trajectory_hash;
        // Noise makes the guard more careful from the start, even if no robot is near.
        let has_changed = Some(ended.hash()) != undisturbed.as_deref();
        ended.assert_holds(
            has_changed == changes,
            format!("{fault}: it changes something: {changes}"),
        );
        ended.assert_holds(ended.number("/final_error_m_max") < 1e-3, "the formation stands again");
        let reported = ended.summary["faults"].as_array().map(Vec::len);
        ended.assert_holds(reported == Some(1), "one fault is reported");
        ended.assert_holds(
            ended.number("/faults/0/recovered_after_s") >= 0.0,
            "it was recovered from",
        );
    });
}

#[test]
fn silent_neighbor_is_stale_and_then_lost_at_the_exact_tick() {
    for (fault, stale_s, lost_s) in [
        // The last beacon is from the tick before the fault: 3 and 20 periods later, and one more.
        ("freeze r2 @2.5 for 1.5", 0.01, 0.095),
        ("kill r2 @2.5 restart 1.5", 0.01, 0.095),
        // Here the change occurs one tick later, because the link fails by the stamps of its messages.
        ("cut r2->r1 @2.5 for 1.5", 0.015, 0.1),
        ("slow r2 by 0.01 @2.5 for 1.5", 0.015, 0.1),
        ("blackout r2 odometry @2.5 for 1.5", 0.015, 0.1),
    ] {
        let ended = run("triangle").lockstep().set("expect={}").fault(fault).finish();
        ended.exits_with(0);
        ended.assert_holds(
            ended.number("/faults/0/stale_after_s") == stale_s,
            format!("{fault}: stale"),
        );
        ended.assert_holds(
            ended.number("/faults/0/lost_after_s") == lost_s,
            format!("{fault}: lost"),
        );
        let events = ended.file("events.csv");
        let last = events.lines().rfind(|line| line.contains(" r2,")).unwrap_or_default();
        ended.assert_holds(
            last.contains(",contact,r1,fresh r2,"),
            format!("{fault}: heard again: {last}"),
        );
    }
}

#[test]
fn plant_death_ends_run_with_4_and_can_be_expected() {
    for pace in ["lockstep", "realtime"] {
        let killed = || run("triangle").args(["--pace", pace]).fault("kill plant @1");
        let ended = killed().set("expect={}").finish();
        ended.exits_with(4).assert_leaves_nothing();
        ended.assert_holds(ended.stderr.contains("the plant died (signal 9)"), "it says why");
        let expected = killed().set("expect={ exit = 4 }").finish();
        expected.exits_with(0).assert_leaves_nothing();
    }
}
