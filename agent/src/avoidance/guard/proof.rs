//! The guard against its proof: the formulas that the lemmas of the folder `proof` speak of, read from
//! there and evaluated, say what the guard does. Whoever changes one of the two has to change the other.

use formation::Vec2;
use formation::front_point::rotate;
use proptest::prelude::*;

use super::super::formulas::Formulas;
use super::tests::{brief, sample};
use super::*;

const SOURCES: [&str; 3] = [
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Geometry.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Guard.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Walls.v")),
];

/// The clearance, in units of d.
const CLEARANCE: f64 = 0.7;

/// T = 10 ms, H = 25 ms, ell = 0.1 m.
fn guard(d: f64, v_max: f64, sensing_error: f64, heading_error: f64) -> Guard {
    let mut brief = brief();
    brief.avoidance.distance_min_m = d;
    brief.avoidance.clearance_m = CLEARANCE * d;
    brief.avoidance.speed_max_m_s = v_max;
    brief.avoidance.sensing_error_m = sensing_error;
    brief.avoidance.heading_error_rad = heading_error;
    Guard::new(&brief)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn the_formulas_of_the_guard_are_those_of_the_proof(
        d in 0.1..0.4f64,
        v_max in 0.1..2.0f64,
        own_share in 0.0..=1.0f64,
        sensing_error in prop_oneof![Just(0.0), 0.0..0.02f64],
        heading_error in prop_oneof![Just(0.0), 0.0..0.2f64],
        // The distance beyond d, in units of v_max H.
        far in -2.0..4.0f64,
        direction in -3.2..3.2f64,
        heading in -3.2..3.2f64,
        turns in (-1.0..=0.0f64, 0.0..=1.0f64),
        a_wall in any::<bool>(),
    ) {
        let mut guard = guard(d, v_max, sensing_error, heading_error);
        let kept = if a_wall { CLEARANCE * d } else { d };
        let (ell, lifetime) = (guard.ell, guard.lifetime);
        let proof = Formulas::read(&SOURCES);
        let say = |name: &str, arguments: &[f64]| proof.value(name, arguments);

        let (w_low, w_high) = (turns.0 * v_max / ell, turns.1 * v_max / ell);
        let (mid, spread) = guard.headings(heading, w_low, w_high);
        let (proven_mid, proven_spread) = (
            say("middle", &[heading, lifetime, w_low, w_high]),
            say("spread", &[lifetime, w_low, w_high, heading_error]),
        );
        prop_assert!((mid - proven_mid).abs() < 1e-12);
        prop_assert!((spread - proven_spread).abs() < 1e-12);

        let v_own = own_share * v_max;
        let r = (kept + far * v_max * lifetime).max(0.0);
        let z = [rotate(direction, Vec2::new(r, 0.0))];
        let [away, walls] = if a_wall { [&[][..], &z] } else { [&z[..], &[]] };
        let sample = Sample { walls, ..sample(0, heading, away) };
        guard.collect_sides(&sample, v_own, spread);

        let eps = sensing_error + say("front_error", &[ell, heading_error]);
        // A wall does not come, and leaves all of the slack: `proof/Walls.v::respects_wall`.
        let its_speed = if a_wall { 0.0 } else { v_max };
        let m = say("reach", &[its_speed, v_own, lifetime, eps]);
        let rho = say("slack", &[r, eps, kept, ROUNDING_M]);
        let b = say(if a_wall { "wall_bound" } else { "bound" }, &[lifetime, rho, m]);
        if (b - v_own).abs() < 1e-9 {
            return Ok(()); // Rounding may decide whether it matters.
        }
        if b >= v_own {
            prop_assert!(guard.sides.is_empty());
            return Ok(());
        }
        let psi = say("psi", &[spread, say("swing", &[m, r])]);
        let count = say("count", &[psi]);
        prop_assert_eq!(guard.sides.len() as f64, count);
        for (q, side) in guard.sides.iter().enumerate() {
            let angle = say("side_angle", &[psi, count, q as f64]);
            // At r = 0 any direction is as good.
            let n = rotate(if r > 0.0 { direction } else { 0.0 }, Vec2::new(1.0, 0.0));
            prop_assert!((side.normal - rotate(angle, n)).norm() < 1e-9);
            prop_assert!((side.bound - say("side_bound", &[b, psi, count])).abs() < 1e-9);
        }
    }

    #[test]
    fn whoever_is_not_sensed_is_as_far_away_as_the_proof_wants_it(
        d in 0.1..0.4f64, v_max in 0.1..2.0f64, errors in (0.0..0.02f64, 0.0..0.2f64),
    ) {
        let guard = guard(d, v_max, errors.0, errors.1);
        let proof = Formulas::read(&SOURCES);
        let far = proof.value("far", &[d, v_max, guard.lifetime]);
        prop_assert!(guard.kept.robots_radius - guard.distance_error >= far - 1e-12);
        let far = proof.value("far_wall", &[CLEARANCE * d, v_max, guard.lifetime]);
        prop_assert!(guard.kept.walls_radius - guard.distance_error >= far - 1e-12);
    }
}

#[test]
fn what_is_compared_above_is_what_the_certificate_says() {
    let walls = SOURCES[2];
    for part in [
        "let M := reach 0 v_own (Guard.lifetime S) (Guard.eps S) in",
        "let b := wall_bound (Guard.lifetime S) (slack r (Guard.eps S) clear (Guard.rounding S)) M in",
    ] {
        assert!(walls.contains(part), "{part}");
    }
}

#[test]
fn what_is_taken_off_for_rounding_only_helps() {
    // `proof/Guard.v::sensible`.
    const { assert!(ROUNDING_M >= 0.0) };
}
