//! Verdicts about expectations when the supervisor has exited or was stopped.

use rustix::process::Signal;

use crate::harness::{FinishedRun, run};

/// Returns verdict and reason of an expectation.
#[track_caller]
fn verdict_of(ended: &FinishedRun, name: &str) -> (String, String) {
    let all = ended.summary["expectations"].as_array().expect("expectations");
    let found = all.iter().find(|one| one["name"] == name).expect(name);
    let word = |key: &str| found[key].as_str().unwrap_or_default().to_owned();
    (word("verdict"), word("reason"))
}

fn missed(reason: &str) -> (String, String) {
    ("missed".to_owned(), reason.to_owned())
}

#[test]
fn expectation_of_dead_robots_is_missed_with_the_reason() {
    let kills = ["kill r1 @2", "kill r2 @2", "kill r3 @2", "kill r4 @2"];
    let all = |what| run(what).lockstep().set("duration_s=6").faults(kills);
    let contained = all("containment").set("expect={ hull_distance_m_max = 0.0 }").finish();
    contained.exits_with(1);
    let nobody = missed("the plan leaves none of r1, r2, r3, r4 alive");
    contained.assert_holds(
        verdict_of(&contained, "hull_distance_m_max") == nobody,
        "without robots the expectation does not hold",
    );
    contained.assert_holds(
        contained.stdout.contains("the plan leaves none of r1"),
        "the screen shows the reason",
    );

    let formation = all("pentagon").set("expect={ converged_by_s = 5.0, min_distance_m = 0.3 }");
    let formation = formation.finish();
    formation.exits_with(1);
    let alone = missed("only r5 is left");
    formation.assert_holds(
        verdict_of(&formation, "converged_by_s") == alone,
        "one robot is no formation",
    );
    formation.assert_holds(
        verdict_of(&formation, "min_distance_m").0 == "held",
        "dead robots still have bodies",
    );

    let meant = "expect={ converged_by_s = 5.0, alive_at_end = [\"r5\"] }";
    let meant = all("pentagon").set(meant).finish();
    meant.exits_with(0);
    meant.assert_holds(meant.summary["alive_at_end"][0] == "r5", "r5 is alive");
    let more = all("pentagon").set("expect={ alive_at_end = 2 }").finish();
    more.exits_with(1);
    let dead = missed("dead at the end: r1, r2, r3, r4");
    more.assert_holds(verdict_of(&more, "alive_at_end") == dead, "one is not two");
}

/// Returns the number of voluntary context switches of a process. `None` if it has exited.
fn naps(pid: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
    line.and_then(|count| count.trim().parse().ok())
}

#[test]
fn expectation_during_supervisor_stop_is_unseen_not_held() {
    // The queue to the supervisor holds 1024 ground-truth samples, one for each wake-up of the plant.
    const WAKE_UPS: u64 = 4096;
    let mut running = run("triangle")
        .set("duration_s=10")
        .set("expect={ min_distance_m = 0.2, alive_at_end = 3 }")
        .start();
    running.wait_for_event("contact");
    let plant = running.pid_of("plant");
    let before = naps(plant).expect("the plant lives");
    running.signal(Signal::STOP);
    // The machine may be slow: only the number of wake-ups of the plant shows what was lost.
    while naps(plant).is_some_and(|now| now < before + WAKE_UPS) {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    running.signal(Signal::CONT);
    let ended = running.finish();
    ended.assert_holds(ended.number("/truths_lost") > 0.0, "truths were lost");
    let gaps = ended.summary["unseen_s"].as_array().expect("gaps").clone();
    ended.assert_holds(!gaps.is_empty(), "for a while");
    ended.exits_with(1);
    let (verdict, reason) = verdict_of(&ended, "min_distance_m");
    ended.assert_holds(verdict == "unseen", format!("it is {verdict}"));
    ended.assert_holds(reason.starts_with("no ground-truth samples from "), reason);
    ended.assert_holds(
        verdict_of(&ended, "alive_at_end").0 == "held",
        "a verdict that needs no samples is known",
    );
    ended.assert_holds(
        ended.stdout.contains("UNSEEN min_distance_m"),
        "the screen shows the verdict",
    );
}
