//! Faults between hosts: no two robots come closer than d, no expired message is used, and the run recovers soon after.

use std::os::unix::fs::PermissionsExt as _;
use std::time::{Duration, Instant};

use crate::hosts::{Cable, Hosts};
use crate::run::{FinishedFleetRun, Run};

const SPLIT_ROBOTS: [&[&str]; 2] = [&["r1", "r2"], &["r3"]];

fn triangle(hosts: &Hosts, more: &str, duration_s: f64, options: &[&str]) -> Run {
    let duration = format!("duration_s={duration_s}");
    let options = [&["--set", duration.as_str()], options].concat();
    Run::start(hosts, "triangle", &hosts.fleet(&SPLIT_ROBOTS, more), &options)
}

/// Runs with the link to the second host down for this long. Returns the results.
fn outage(down: Duration) -> Option<FinishedFleetRun> {
    let hosts = Hosts::make(2)?;
    let options = ["--set", "expect={ min_distance_m = 0.2, final_error_m_max = 1e-3 }"];
    let mut run = triangle(&hosts, "", 12.0 + down.as_secs_f64(), &options);
    run.wait_for_run_time(3.0);
    hosts.plug(1, false);
    let start = Instant::now();
    std::thread::sleep(down);
    let down_s = start.elapsed().as_secs_f64();
    hosts.plug(1, true);
    let ended = run.end();
    ended.assert_passed();
    ended.assert_undisturbed(&["r1", "r2"]);
    // In both directions: r2 receives from r3, on the other host, and r3 from r1.
    let recovered_s =
        [("r2", "r3"), ("r3", "r1")].map(|(robot, from)| ended.peak_s(robot, from) - down_s);
    eprintln!(
        "{down_s:.1} s down: heard again after {recovered_s:.3?} s, too old {}",
        ended.dropped_count("old")
    );
    assert!(
        recovered_s.iter().all(|&after_s| (0.0..1.0).contains(&after_s)),
        "{recovered_s:?}\n{}",
        ended.logs()
    );
    Some(ended)
}

/// Checks that an event of one kind is followed by one of the other kind.
fn assert_event_order(ended: &FinishedFleetRun, first: &str, then: &str) {
    let [first, then] = [first, then].map(|kind| ended.events(kind).first().map(|event| event.0));
    assert!(first.is_some() && first < then, "{first:?} s, {then:?} s\n{}", ended.logs());
}

#[test]
#[ignore = "needs root"]
fn link_down_for_2_s_only_delays_the_run() {
    let Some(ended) = outage(Duration::from_secs(2)) else { return };
    assert_event_order(&ended, "host-lost", "host-back");
    assert_eq!(ended.events("unreachable")[0].1, "r3");
    let lost = ended.events("contact");
    assert!(lost.iter().any(|(_, robot, what)| robot == "r2" && what == "lost r3"), "{lost:?}");
    // The records that its robot sent during the outage have arrived.
    assert_eq!(ended.summary["wall"]["latencies_lost"], 0, "{}", ended.logs());
}

#[test]
#[ignore = "needs root"]
fn link_down_for_15_s_only_delays_the_run() {
    let Some(ended) = outage(Duration::from_secs(15)) else { return };
    assert_event_order(&ended, "host-lost", "host-back");
}

#[test]
#[ignore = "needs root"]
fn killed_bridge_is_restarted_on_either_host() {
    let Some(hosts) = Hosts::make(2) else { return };
    let mut run = triangle(&hosts, "", 14.0, &[]);
    run.wait_for_run_time(3.0);
    run.kill_child(1, "phalanx-bridge");
    run.wait_for_run_time(6.0);
    run.kill_child(0, "phalanx-bridge");
    let ended = run.end();
    ended.assert_passed();
    ended.assert_undisturbed(&["r1", "r2"]);
    assert_eq!(ended.events("bridge-died").len(), 1, "{}", ended.logs());
    assert_eq!(ended.events("bridge-restarted").len(), 2, "{}", ended.logs());
}

/// Checks that r3, on the second host, failed for this reason, that the run failed, and that the last line reports it.
#[track_caller]
fn assert_r3_failed(ended: &FinishedFleetRun, cause: &str) {
    assert_eq!(ended.codes[0], Some(1), "{}", ended.logs());
    let expectations = ended.summary["expectations"].as_array().unwrap();
    let failed =
        expectations.iter().find(|expectation| expectation["name"] == "failed_robots").unwrap();
    let reason = format!("r3 {cause}");
    assert_eq!(failed["reason"], reason.as_str(), "{}", ended.logs());
    let log = ended.log(0);
    let last = log.lines().last().unwrap_or_default();
    assert!(last.starts_with(&format!("failed: {reason}; its log")), "{log}");
}

#[test]
#[ignore = "needs root"]
fn lost_host_may_fail_if_its_robots_need_not_live() {
    let Some(hosts) = Hosts::make(2) else { return };
    let expect = "expect={ alive_at_end = [\"r1\", \"r2\"] }";
    let mut run = triangle(&hosts, "", 6.0, &["--set", expect]);
    run.wait_for_run_time(3.0);
    run.kill_host(1);
    let ended = run.end();
    assert_eq!(ended.codes, [Some(0), None], "{}", ended.logs());
}

#[test]
#[ignore = "needs root"]
fn host_asked_to_end_leaves_and_fails_the_run() {
    let Some(hosts) = Hosts::make(2) else { return };
    // The timeout alone would not report it before the end.
    let mut run = triangle(&hosts, "unreachable_after_s = 60.0", 8.0, &["--set", "expect={}"]);
    run.wait_for_run_time(3.0);
    run.signal_host(1, libc::SIGTERM);
    run.wait_for_event("host-lost");
    let ended = run.end();
    assert_eq!(ended.codes, [Some(1), Some(130)], "{}", ended.logs());
    assert_r3_failed(&ended, "was out of reach at the end: the supervisor of host b ended");
    assert_eq!(ended.summary["alive_at_end"], serde_json::json!(["r1", "r2"]));
}

#[test]
#[ignore = "needs root"]
fn host_that_dies_just_before_the_end_fails_the_run() {
    let Some(hosts) = Hosts::make(2) else { return };
    // As if the run ended before the timeout.
    let mut run = triangle(&hosts, "unreachable_after_s = 60.0", 5.0, &["--set", "expect={}"]);
    run.wait_for_run_time(3.0);
    run.kill_host(1);
    let ended = run.end();
    let why = "host b did not report the states of its robots at the end";
    assert_r3_failed(&ended, &format!("was out of reach at the end: {why}"));
    assert_eq!(ended.summary["alive_at_end"], serde_json::json!(["r1", "r2"]));
}

#[test]
#[ignore = "needs root"]
fn robots_of_a_lost_host_are_not_alive_after_a_failed_run() {
    let Some(hosts) = Hosts::make(2) else { return };
    let mut run = triangle(&hosts, "unreachable_after_s = 60.0", 60.0, &["--set", "expect={}"]);
    run.wait_for_run_time(2.0);
    run.kill_host(1);
    run.kill_child(0, "phalanx-plant");
    let ended = run.end();
    assert_eq!(ended.codes[0], Some(4), "{}", ended.logs());
    assert_eq!(ended.summary["alive_at_end"], serde_json::json!(["r1", "r2"]));
}

#[test]
#[ignore = "needs root"]
fn robot_death_under_a_stopped_supervisor_fails_the_run() {
    let Some(hosts) = Hosts::make(2) else { return };
    let mut run = triangle(&hosts, "silence_max_s = 2.0", 6.0, &["--set", "expect={}"]);
    run.wait_for_run_time(2.0);
    run.signal_host(1, libc::SIGSTOP);
    run.kill_child(1, "phalanx-agent");
    run.wait_for_host(0);
    run.signal_host(1, libc::SIGCONT);
    let ended = run.end();
    let why = "host b did not report the states of its robots at the end";
    assert_r3_failed(&ended, &format!("was out of reach at the end: {why}"));
    assert_eq!(ended.summary["alive_at_end"], serde_json::json!(["r1", "r2"]));
}

#[test]
#[ignore = "needs root"]
fn stopped_robot_on_another_host_is_a_fault_and_fails_the_run() {
    let Some(hosts) = Hosts::make(2) else { return };
    let mut run = triangle(&hosts, "", 10.0, &["--set", "expect={}"]);
    run.wait_for_run_time(2.0);
    run.signal_child(1, "phalanx-agent", libc::SIGSTOP);
    run.wait_for_event("freeze");
    run.signal_child(1, "phalanx-agent", libc::SIGCONT);
    run.wait_for_event("thaw");
    run.signal_child(1, "phalanx-agent", libc::SIGSTOP);
    let ended = run.end();
    assert_r3_failed(&ended, "was stopped by another process, and was not resumed");
    let freezes = ended.events("freeze");
    assert!(freezes.len() == 2 && freezes.iter().all(|(_, robot, _)| robot == "r3"), "{freezes:?}");
    assert_eq!(ended.summary["faults"][0]["what"], "freeze r3, by another process");
}

#[test]
#[ignore = "needs root"]
fn planned_freeze_on_another_host_is_not_an_external_stop() {
    let Some(hosts) = Hosts::make(2) else { return };
    let options = ["--set", "expect={}", "--fault", "freeze r3 @2 for 2"];
    let ended = triangle(&hosts, "", 8.0, &options).end();
    ended.assert_passed();
    let freezes = ended.events("freeze");
    assert_eq!(freezes.len(), 1, "{freezes:?}");
}

#[test]
#[ignore = "needs root"]
fn silent_robot_on_another_host_is_reported_and_fails_the_run() {
    let Some(hosts) = Hosts::make(2) else { return };
    let folder = tempfile::tempdir().unwrap();
    // Only the agent, a child of the script, is stopped, so that the robot counts as hung and not as stopped.
    let program = env!("CARGO_BIN_EXE_phalanx");
    let script = format!(
        "#!/bin/sh\nbrief=\"$1\"; shift\n\
         sed -e 's/^law = .*/law = \"formation-unit\"/' -e '/^\\[program\\]/,/^$/d' \"$brief\" > \"$brief-own\"\n\
         \"{program}\" agent \"$brief-own\" \"$@\" &\nsleep 4; kill -STOP $!; exec sleep 1000\n"
    );
    let path = folder.path().join("own.sh");
    std::fs::write(&path, script).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/triangle.toml");
    let text = std::fs::read_to_string(shipped).unwrap();
    let law =
        "[laws.own]\nrole = \"formation\"\ngains = [\"speed_m_s\"]\nprogram = [\"./own.sh\"]\n";
    let file = folder.path().join("own.toml");
    std::fs::write(&file, format!("{text}\n{law}")).unwrap();
    let options = ["--set", "duration_s=14", "--set", "expect={}", "--set", "robot.r3.law=own"];
    let ended = Run::start_file(&hosts, &file, &hosts.fleet(&SPLIT_ROBOTS, ""), &options).end();
    assert_r3_failed(&ended, "was hung at the end: it sent no status while blocked");
    let warning = "r3 has sent no status for 5 s while blocked; the others continue without it";
    assert!(ended.log(0).contains(warning), "{}", ended.log(0));
}

#[test]
#[ignore = "needs root"]
fn killed_host_without_the_plant_does_not_stop_the_others() {
    let Some(hosts) = Hosts::make(2) else { return };
    let mut run = triangle(&hosts, "", 10.0, &["--set", "expect={ min_distance_m = 0.2 }"]);
    run.wait_for_run_time(3.0);
    run.kill_host(1);
    let ended = run.end();
    assert_eq!(ended.codes, [Some(1), None], "{}", ended.logs());
    assert_r3_failed(&ended, "was out of reach at the end: host b is unreachable");
    ended.assert_safe();
    ended.assert_undisturbed(&["r1", "r2"]);
    assert_eq!(ended.summary["alive_at_end"], serde_json::json!(["r1", "r2"]));
    let fault = &ended.summary["faults"][0];
    assert!(fault["what"].as_str().unwrap().contains("r3 out of reach"), "{fault}");
    assert!(fault["lost_after_s"].as_f64().is_some(), "{fault}");
    assert_eq!(ended.summary["wall"]["hosts"][1]["reachable"], false);
}

#[test]
#[ignore = "needs root"]
fn loss_of_the_plant_host_ends_all_others_with_the_reason() {
    let Some(hosts) = Hosts::make(3) else { return };
    let fleet = hosts.fleet(&[&["r1"], &["r2"], &["r3"]], "silence_max_s = 2.0");
    let mut run = Run::start(&hosts, "triangle", &fleet, &["--set", "duration_s=60"]);
    run.wait_for_run_time(2.0);
    run.kill_host(0);
    let ended = run.end();
    assert_eq!(ended.codes, [None, Some(4), Some(4)], "{}", ended.logs());
    for host in [1, 2] {
        let log = ended.log(host);
        assert!(log.contains("the plant's host a is lost"), "{log}");
    }
}

#[test]
#[ignore = "needs root"]
fn planned_partition_is_a_fault_in_the_report() {
    let Some(hosts) = Hosts::make(2) else { return };
    let ended = triangle(&hosts, "", 16.0, &["--fault", "partition b @4 for 3"]).end();
    ended.assert_passed();
    ended.assert_undisturbed(&["r1", "r2"]);
    assert!(ended.dropped_count("partition") > 100, "{}", ended.logs());
    let lost = ended.events("contact");
    let has_event = |robot: &str, what: &str| lost.iter().any(|(_, r, w)| r == robot && w == what);
    // r3 receives neither beacons nor samples of the plant: it stops.
    assert!(has_event("r2", "lost r3"), "{lost:?}");
    assert_eq!(ended.summary["faults"][0]["what"], "partition b");
}

/// Runs with a delay of 20 ms and jitter in each direction to the second host. Returns the results.
fn delayed(latency_max_s: f64) -> Option<FinishedFleetRun> {
    let mut hosts = Hosts::make_with(2, Some(Cable { delay_ms: [20, 5], loss_percent: 0 }))?;
    let more = format!("latency_max_s = {latency_max_s}");
    let options = ["--set", "expect={ min_distance_m = 0.2 }"];
    let ended = triangle(&hosts, &more, 14.0, &options).end();
    assert!(hosts.is_running());
    assert_eq!(ended.codes, [Some(0), Some(0)], "{}", ended.logs());
    ended.assert_safe();
    let round_trip_ns = ended.number("/wall/hosts/1/round_trip_ns").unwrap();
    assert!(round_trip_ns > 25e6, "{round_trip_ns} ns");
    Some(ended)
}

#[test]
#[ignore = "needs root"]
fn low_latency_limit_stops_remote_robots_without_collision() {
    let Some(ended) = delayed(0.01) else { return };
    let moved_m = ended.number("/path_m/r3").unwrap();
    assert!(moved_m < 0.01, "{moved_m} m\n{}", ended.logs());
}

#[test]
#[ignore = "needs root"]
fn with_enough_latency_allowed_all_converge() {
    let Some(ended) = delayed(0.08) else { return };
    let converged_s = ended.number("/converged_at_s");
    assert!(converged_s.is_some_and(|t_s| t_s < 13.0), "{}", ended.logs());
}

#[test]
#[ignore = "needs root"]
fn five_percent_packet_loss_only_delays_the_run() {
    let cable = Cable { delay_ms: [0, 0], loss_percent: 5 };
    let Some(mut hosts) = Hosts::make_with(2, Some(cable)) else { return };
    let options = ["--set", "expect={ min_distance_m = 0.2 }"];
    for transport in ["tcp", "udp"] {
        let more = format!("latency_max_s = 0.08\ntransport = \"{transport}\"");
        let ended = triangle(&hosts, &more, 14.0, &options).end();
        assert!(hosts.is_running());
        assert_eq!(ended.codes, [Some(0), Some(0)], "{}", ended.logs());
        ended.assert_safe();
        let converged_s = ended.number("/converged_at_s");
        eprintln!(
            "5 % lost, {transport}: converged at {converged_s:?} s, too old {}",
            ended.dropped_count("old")
        );
        assert!(converged_s.is_some(), "{transport}\n{}", ended.logs());
    }
}
