//! The leader's frame: effects of noise, communication timeouts and avoidance of the leader on the formation.

use experiment::check::check_scenario;
use experiment::scenario::Scenario;
use formation::pose::wrap_angle;

use crate::oracle::{scenario, simulate, simulate_watched, with_faults};

/// Noise of 5 mm on the leader's odometry, and no beacon of the leader for 0.4 s: the others extrapolate its last turn
/// rate and acceleration.
#[test]
fn leader_noise_does_not_disturb_formation_during_silence() {
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
fn noise_free_error_is_at_most_one_relay_period() {
    for (name, error_m) in [("pentagon", 1.3e-4), ("containment", 2.95e-4)] {
        let found_m = simulate(&scenario(name, &[])).final_error_m_max.expect("errors");
        assert!(found_m < error_m, "{name}: {found_m} m, expected {error_m} m");
    }
}

/// Reads the pentagon with a leader that moves back and forth along y = x, and reverses at 5, 15 and 25 s.
fn to_and_fro(more: &str) -> Scenario {
    let trajectory = format!(
        "trajectory={{kind=\"lissajous\",radii_m=[2.0,2.0],cycles=[1,1],period_s=20.0{more}}}"
    );
    scenario("pentagon", &[&trajectory, "expect={}", "duration_s=34", "period_s=0.005"])
}

/// Returns how far the heading of the line from r1 to r5 turns during the run, rad.
fn turned_rad(scenario: &Scenario) -> f64 {
    let (mut first, mut last) = (None, 0.0);
    simulate_watched(scenario, |header, rows, _| {
        if header.t_ns >= 4_000_000_000 {
            last = (rows[4].y_m - rows[0].y_m).atan2(rows[4].x_m - rows[0].x_m);
            first.get_or_insert(last);
        }
    });
    wrap_angle(last - first.unwrap()).abs()
}

#[test]
fn formation_keeps_its_heading_at_a_cusp_with_keep_heading() {
    let (turning, keeping) = (to_and_fro(""), to_and_fro(", keep_heading=true"));
    // After 34 s the leader has turned around three times, each time some 7 s after a cusp.
    assert!(turned_rad(&turning) > 2.8, "{} rad", turned_rad(&turning));
    assert!(turned_rad(&keeping) < 0.3, "{} rad", turned_rad(&keeping));
    let ideal_m = simulate(&keeping).final_ideal_error_m_max.expect("errors");
    assert!(ideal_m < 0.02, "the ideal formation keeps its heading, too: {ideal_m} m");
}

#[test]
fn check_warns_of_a_cusp_with_its_time() {
    let warnings = |scenario: &Scenario| {
        let findings = check_scenario(scenario).into_iter().map(|finding| finding.message);
        findings.filter(|message| message.contains("reverses")).collect::<Vec<_>>()
    };
    let [warning] = &warnings(&to_and_fro(""))[..] else { panic!("one warning") };
    assert!(warning.starts_with("reverses at 5"), "{warning}");
    assert!(warning.contains("at (2, 2) m, and 2 more times until the end"), "{warning}");
    assert_eq!(warnings(&to_and_fro(", keep_heading=true")), [""; 0]);
    assert_eq!(warnings(&scenario("pentagon", &[])), [""; 0]);
    // A turn in little space counts too.
    let waypoints = "trajectory={kind=\"waypoints\",speed_m_s=0.5,\
                     points_m=[[0.0,0.0],[3.0,0.0],[3.0,0.01],[0.0,0.01]]}";
    let there_and_back = scenario("pentagon", &[waypoints, "expect={}"]);
    assert_eq!(warnings(&there_and_back).len(), 1, "{:?}", check_scenario(&there_and_back));
}

/// A leader that starts off its path and across it turns on its way there; the formation does not turn.
#[test]
fn approach_to_the_path_does_not_rotate_the_formation() {
    let start_pose = "robot.l1.pose={x_m=0.4,y_m=1.6,heading_rad=0.0}";
    let scenario = scenario("standing-leaders", &[start_pose, "expect={}"]);
    let measures = simulate(&scenario);
    let worst_m = measures.final_ideal_error_m_max.expect("errors");
    assert!(worst_m < 1e-3, "{:?}", measures.final_ideal_error_m);
    let worst_m = measures.final_error_m_max.expect("errors");
    assert!(worst_m < 1e-3, "{:?}", measures.final_error_m);
}
