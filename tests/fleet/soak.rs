//! Random outages between hosts. CI runs a short form; two hundred outages in half an hour by
//! `PHALANX_OUTAGES=200 cargo test --features bridge --test fleet -- --ignored --nocapture soak`.

use std::collections::BTreeMap;
use std::time::Duration;

use formation::random::SplitMix64;

use crate::hosts::{Hosts, children_of};
use crate::run::Run;

/// Number of outages in CI.
const CI_OUTAGES: u64 = 3;
/// Length of the intervals with one outage each, s.
const EVERY_S: u64 = 9;
/// Minimum and maximum length of an outage, ms.
const LENGTH_MS: [u64; 2] = [100, 5_000];
/// Time without outages before the first and after the last one, s.
const CALM_S: u64 = 12;
/// Maximum time after an outage until robots receive from each other again, ms.
const HEARD_WITHIN_MS: u64 = 1_000;
/// Maximum growth of a bridge's memory since the first outage, kB.
const GROWTH_KB_MAX: u64 = 16 * 1024;

#[test]
#[ignore = "needs root"]
fn soak_random_outages_leave_no_permanent_damage() {
    let Some(hosts) = Hosts::make(2) else { return };
    let count = std::env::var("PHALANX_OUTAGES").map_or(CI_OUTAGES, |count| count.parse().unwrap());
    let seed = std::env::var("PHALANX_SEED").map_or(1, |seed| seed.parse().unwrap());
    let duration = format!("duration_s={}", count * EVERY_S + 2 * CALM_S);
    let options =
        ["--set", &duration, "--set", "expect={ min_distance_m = 0.2 }", "--set", "record_hz=10"];
    let fleet = hosts.fleet(&[&["r1", "r2"], &["r3"]], "");
    let mut run = Run::start(&hosts, "triangle", &fleet, &options);
    run.wait_for_run_time(CALM_S as f64 / 2.0);
    let mut random = SplitMix64::new(seed);
    let mut first_kb = None;
    // Time since the link is up, and time that it was down, including gaps too short for robots to receive anything.
    let (mut gap_ms, mut stretch_ms, mut longest_ms) = (u64::MAX, 0, 0);
    for outage in 0..count {
        let length_ms = random.draw_between(LENGTH_MS[0], LENGTH_MS[1]);
        let before_ms = random.draw_between(0, 1_000 * EVERY_S - length_ms);
        gap_ms = gap_ms.saturating_add(before_ms);
        stretch_ms = length_ms + if gap_ms < HEARD_WITHIN_MS { stretch_ms + gap_ms } else { 0 };
        longest_ms = longest_ms.max(stretch_ms);
        gap_ms = 1_000 * EVERY_S - length_ms - before_ms;
        std::thread::sleep(Duration::from_millis(before_ms));
        hosts.plug(1, false);
        std::thread::sleep(Duration::from_millis(length_ms));
        hosts.plug(1, true);
        std::thread::sleep(Duration::from_millis(gap_ms));
        let kb = bridges_kb(&run);
        first_kb.get_or_insert(kb);
        if outage % 20 == 0 || outage + 1 == count {
            eprintln!("seed {seed}, outage {} of {count}: bridges {kb:?} kB", outage + 1);
        }
    }
    let last_kb = bridges_kb(&run);
    let ended = run.end();
    ended.assert_passed();
    ended.assert_undisturbed(&["r1", "r2"]);
    let peak_age_s = ended.peak_s("r2", "r3");
    let limit_s = (longest_ms + HEARD_WITHIN_MS) as f64 / 1e3;
    assert!(peak_age_s < limit_s, "{peak_age_s} s, more than {limit_s} s");
    for (first, last) in first_kb.unwrap().into_iter().zip(last_kb) {
        assert!(last < first + GROWTH_KB_MAX, "{first} kB at first, {last} kB at last");
    }
    let mut contacts = BTreeMap::new();
    for (_, robot, what) in ended.events("contact") {
        let (state, sender) = what.split_once(' ').unwrap();
        contacts.insert((robot, sender.to_owned()), state.to_owned());
    }
    assert!(contacts.values().all(|state| state == "fresh"), "{contacts:?}");
    assert!(ended.number("/converged_at_s").is_some(), "{}", ended.logs());
    eprintln!(
        "too old, and dropped: {}; unheard for {peak_age_s:.3} s at most",
        ended.dropped_count("old")
    );
}

/// Returns the memory of both bridges, kB.
fn bridges_kb(run: &Run) -> [u64; 2] {
    let kb = [0, 1].map(|host| bridge_kb(run.pid(host)));
    match kb {
        [Some(a), Some(b)] => [a, b],
        _ => panic!("a bridge is not there: {kb:?}\n{}", run.logs()),
    }
}

/// Returns the memory of a host's bridge, kB.
fn bridge_kb(supervisor: u32) -> Option<u64> {
    let found = children_of(supervisor);
    let (pid, _) = found.iter().find(|(_, name)| name == "phalanx-bridge")?;
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}
