//! Formations that are split over hosts behave as on one host.

use crate::hosts::Hosts;
use crate::run::Run;

#[test]
#[ignore = "needs root"]
fn pentagon_on_two_hosts_keeps_distance_and_converges() {
    let Some(hosts) = Hosts::make(2) else { return };
    let fleet = hosts.fleet(&[&["r1", "r2", "r3"], &["r4", "r5"]], "");
    let options = ["--set", "period_s=0.005", "--set", "duration_s=20"];
    let ended = Run::start(&hosts, "pentagon", &fleet, &options).end();
    ended.assert_passed();
    // The clocks are a day apart, but ages are as on one machine.
    let error_ns = ended.number("/wall/hosts/1/stamp_error_ns_max").unwrap();
    assert!(error_ns < 1e9, "{error_ns}");
    let accepted = ended.number("/wall/hosts/1/taken").unwrap();
    assert!(accepted > 1000.0, "{accepted}");
    assert!(ended.number("/wall/hosts/1/samples_sent") > Some(1000.0), "they are counted");
    assert_eq!(
        ended.dropped_count("garbage")
            + ended.dropped_count("layout")
            + ended.dropped_count("owner"),
        0
    );
}

#[test]
#[ignore = "needs root"]
fn containment_on_three_hosts_keeps_distance_and_converges() {
    let Some(hosts) = Hosts::make(3) else { return };
    let fleet = hosts.fleet(&[&["r1", "r2", "r8"], &["r3", "r4", "r5"], &["r6", "r7"]], "");
    let options = ["--set", "period_s=0.005", "--set", "duration_s=20"];
    Run::start(&hosts, "containment", &fleet, &options).end().assert_passed();
}

#[test]
#[ignore = "needs root"]
fn unneeded_host_receives_only_heartbeats() {
    let Some(hosts) = Hosts::make(2) else { return };
    let fleet = hosts.fleet(&[&["r1", "r2", "r3"], &[]], "");
    let mut run = Run::start(&hosts, "triangle", &fleet, &["--set", "duration_s=10"]);
    run.wait_for_run_time(2.0);
    let before = hosts.bytes(1);
    run.wait_for_run_time(6.0);
    let per_s = (hosts.bytes(1) - before) as f64 / 4.0;
    eprintln!("without a consumer: {per_s:.0} B/s");
    let ended = run.end();
    ended.assert_passed();
    for host in [0, 1] {
        let of_host = |key: &str| ended.number(&format!("/wall/hosts/{host}/{key}"));
        assert_eq!(of_host("samples_sent"), Some(0.0), "{}", ended.logs());
        assert!(of_host("sent") > Some(100.0), "they know of each other");
    }
    // Clock messages, orders, reports and the lease; the odometry of one robot alone would exceed 1 MB/s.
    assert!(per_s < 100_000.0, "{per_s} B/s");
}
