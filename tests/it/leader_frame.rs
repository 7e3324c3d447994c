//! The leader's frame: what noise, silence and whoever pushes the leader make of the formation.

use experiment::scenario::FaultKind;
use experiment::scenario::read::{Overrides, read};
use formation::front_point::front_point;

use crate::oracle::{scenario, simulate, simulate_watched, with_faults};

/// Five millimeters of noise on the leader's odometry, and nobody hears of it for 0.4 s: the others
/// go on by its last turn rate and acceleration.
#[test]
fn noise_on_the_leader_does_not_throw_the_formation_while_it_is_silent() {
    let set = ["expect={}", "duration_s=50", "silence.lost_after_s=0.5"];
    let cut = "cut r5->r4 @40 for 0.4";
    let peak_m = |faults: &[&str]| {
        let measures = simulate(&with_faults("pentagon", &set, faults));
        measures.faults.iter().map(|fault| (fault.what.clone(), fault.peak_error_m)).next_back()
    };
    let (what, noisy_m) = peak_m(&["noise r5 odometry by 0.005 @0", cut]).expect("two faults");
    assert!(what.contains("cut") && noisy_m < 0.01, "{what}: {noisy_m} m");
    let (_, quiet_m) = peak_m(&[cut]).expect("a fault");
    assert!(quiet_m < 0.005, "without noise: {quiet_m} m");
}

#[test]
fn without_noise_nobody_is_farther_off_than_a_period_of_the_relay_makes_it() {
    for (name, error_m) in [("pentagon", 1.3e-4), ("containment", 2.95e-4)] {
        let found_m = simulate(&scenario(name, &[])).final_error_m_max.expect("errors");
        assert!(found_m < error_m, "{name}: {found_m} m, expected {error_m} m");
    }
}

/// A leader that starts off its path, and across it, turns on its way there; the formation does not.
#[test]
fn the_way_to_its_path_does_not_turn_a_leaders_formation() {
    let aside = "robot.l1.pose={x_m=0.4,y_m=1.6,heading_rad=0.0}";
    let scenario = scenario("standing-leaders", &[aside, "expect={}"]);
    let measures = simulate(&scenario);
    let worst_m = measures.final_ideal_error_m_max.expect("errors");
    assert!(worst_m < 1e-3, "{:?}", measures.final_ideal_error_m);
    let worst_m = measures.final_error_m_max.expect("errors");
    assert!(worst_m < 1e-3, "{:?}", measures.final_error_m);
}

/// For how long, s, kills and freezes keep the leader more than 5 cm off its path, and for how much of
/// that it lived: the table of docs/faults.md.
/// `cargo test --test it -- --ignored --nocapture chaos_keeps_the_leader`
#[test]
#[ignore = "a minute: 20 runs of 80 s"]
fn chaos_keeps_the_leader_off_its_path_only_while_it_is_down_and_on_its_way_back() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/containment-chaos.toml");
    let (mut off_in_all_s, mut living_in_all_s) = (0.0, 0.0);
    for seed in 1..=20 {
        let overrides = Overrides { seed: Some(seed), ..Overrides::default() };
        let read = read(path.as_ref(), &overrides, &agent::catalog());
        let (scenario, ..) = read.unwrap_or_else(|error| panic!("{}", error.render(false)));
        let (leader, lead) = (scenario.leader().unwrap(), scenario.lead.clone().unwrap());
        let (mut off, mut living) = (0u32, 0u32);
        let measures = simulate_watched(&scenario, |header, rows, alive| {
            let t_s = header.t_ns as f64 / 1e9;
            let alpha = front_point(rows[leader].pose(), scenario.robots[leader].front_point_m);
            let off_m = (alpha - lead.trajectory.at(t_s).position).norm();
            if t_s > 5.0 && off_m > 0.05 {
                off += 1;
                living += u32::from(alive[leader]);
            }
        });
        let seconds = |ticks: u32| f64::from(ticks) * scenario.period_ns as f64 / 1e9;
        println!("seed {seed}: {:.2} s, {:.2} s of it alive", seconds(off), seconds(living));
        off_in_all_s += seconds(off);
        living_in_all_s += seconds(living);
        let strikes = |kind: &FaultKind| match *kind {
            FaultKind::Kill { robot, .. } | FaultKind::Freeze { robot } => robot == leader,
            _ => false,
        };
        let struck = scenario.faults.iter().any(|fault| strikes(&fault.kind));
        assert!(struck || off == 0, "seed {seed}: somebody else held the leader up");
        assert_eq!(measures.violations, 0, "seed {seed}");
        assert!(measures.final_error_m_max.unwrap() < 0.02, "seed {seed}: all come home");
    }
    println!("in all: {off_in_all_s:.2} s, {living_in_all_s:.2} s of it alive");
}
