//! The leader's frame: what noise, silence and whoever pushes the leader make of the formation.

use crate::oracle::{scenario, simulate, with_faults};

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
