//! The error relative to the ideal formation, for moving robots.

use crate::oracle::{scenario, simulate, with_faults};

/// Returns the error of a robot, m.
fn error_m(errors: &[(String, Option<f64>)], robot: &str) -> f64 {
    let found = errors.iter().find(|(name, _)| name == robot).and_then(|(_, error)| *error);
    found.unwrap_or_else(|| panic!("{robot} has no error in {errors:?}"))
}

#[test]
fn undisturbed_formation_converges_to_the_ideal() {
    for (name, duration_s) in
        [("triangle", 14), ("pentagon", 14), ("containment", 14), ("line-5", 60)]
    {
        let scenario = scenario(name, &[&format!("duration_s={duration_s}")]);
        let measures = simulate(&scenario);
        let named = measures.final_ideal_error_m.iter().filter(|(_, error)| error.is_some());
        assert_eq!(named.count(), scenario.robots.len(), "{name}: every robot has a slot");
        let worst_m = measures.final_ideal_error_m_max.unwrap();
        assert!(worst_m < 5e-3, "{name}: {:?}", measures.final_ideal_error_m);
    }
}

#[test]
fn follower_of_dead_robot_is_locally_right_globally_wrong() {
    let measures = simulate(&with_faults("line-5", &[], &["kill r2 @40"]));
    // r3 receives from r2 only, and stops at the slot of its last beacon, except for the line that the leader continues
    // to turn.
    let (local_error_m, ideal_error_m) =
        (error_m(&measures.final_error_m, "r3"), error_m(&measures.final_ideal_error_m, "r3"));
    assert!(
        local_error_m < 1.0 && ideal_error_m > 3.0,
        "{local_error_m} m by r2, {ideal_error_m} m in the whole"
    );
}
