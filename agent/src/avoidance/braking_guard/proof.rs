//! The guard with inertia against its proof: `proof/Inertia.v`, read and evaluated, says what the code
//! does.

use proptest::prelude::*;
use protocol::brief::RampKind;

use super::super::formulas::Formulas;
use super::super::guard::tests::{brief, sample as sample_at};
use super::*;

const SOURCES: [&str; 5] = [
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Geometry.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Guard.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Inertia.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Braking.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Obstacles.v")),
];

/// The clearance, in units of d.
const CLEARANCE: f64 = 0.7;

fn guard(
    [d, v_max, ell]: [f64; 3],
    errors: [f64; 2],
    limits: LimitsBrief,
    tau_max: f64,
) -> BrakingGuard {
    let mut brief = AgentBrief { limits: Some(limits), front_point_m: ell, ..brief() };
    brief.avoidance.distance_min_m = d;
    brief.avoidance.clearance_m = CLEARANCE * d;
    brief.avoidance.speed_max_m_s = v_max;
    brief.avoidance.braking_time_max_s = tau_max;
    [brief.avoidance.sensing_error_m, brief.avoidance.heading_error_rad] = errors;
    BrakingGuard::new(&brief)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn the_formulas_of_the_guard_with_inertia_are_those_of_the_proof(
        d in 0.1..0.4f64,
        v_max in 0.1..2.0f64,
        ell in 0.05..0.3f64,
        accelerations in (0.2..5.0f64, 0.5..10.0f64),
        tau in 0.05..2.0f64,
        others_longer in prop_oneof![Just(1.0), 1.0..2.0f64],
        own in (0.0..=1.0f64, 0.0..=1.0f64),
        period_longer in prop_oneof![Just(0.0), Just(1.0)],
        far in -0.2..2.0f64, // the distance beyond d, in v_max / Lambda
        direction in -3.2..3.2f64,
        heading in -3.2..3.2f64,
        turns in (-1.0..=0.0f64, 0.0..=1.0f64),
        errors in prop_oneof![Just((0.0, 0.0)), (0.0..0.02f64, 0.0..0.2f64)],
        (twist, a_wall) in ((-2.0..2.0f64, -5.0..5.0f64), any::<bool>()),
    ) {
        let (acceleration_m_s2, turn_acceleration_rad_s2) = accelerations;
        let limits = LimitsBrief {
            acceleration_m_s2,
            turn_acceleration_rad_s2,
            braking_time_s: tau,
            ramp: RampKind::Together,
        };
        let mut guard = guard([d, v_max, ell], errors.into(), limits, tau * others_longer);
        let proof = Formulas::read(&SOURCES);
        let say = |name: &str, arguments: &[f64]| proof.value(name, arguments);

        let (v_own, tau_o) = (own.0 * v_max, own.1 * tau);
        let w = [turns.0 * v_max / ell, turns.1 * v_max / ell];
        // A certificate that lasts longer is one for a longer lifetime.
        let h = guard.lifetime + period_longer * guard.period;
        let rate = say("braking_rate", &[guard.lifetime, tau * others_longer]);
        prop_assert!((guard.rate - rate).abs() < 1e-12);
        // `proof/Braking.v::another_robot`, or `proof/Obstacles.v::an_obstacle`.
        let [its_speed, share, kept] = match a_wall {
            true => [0.0, 2.0 * rate, CLEARANCE * d],
            false => [v_max, rate, d],
        };
        let r = (kept + far * v_max / rate).max(0.0);
        let z = [rotate(direction, Vec2::new(r, 0.0))];
        let [away, walls] = if a_wall { [&[][..], &z] } else { [&z[..], &[]] };
        let sample = Sample { walls, ..sample_at(0, heading, away) };
        let mid = guard.collect_cones(&sample, h, Bounds { v_own, tau_o, w });

        let (sensing_error, heading_error) = errors;
        let eps = sensing_error + say("front_error", &[ell, heading_error]);
        let turning = say("turning_time", &[h, tau_o]);
        let spread = say("spread", &[turning, w[0], w[1], heading_error]);
        let rho = say("slack", &[r, eps, kept, ROUNDING_M]);
        let reach = say("reach", &[its_speed, v_own, h, eps]);
        let b = say("braking_bound", &[share, rate, h, tau_o, rho, reach]);
        prop_assert!((mid - say("middle", &[heading, turning, w[0], w[1]])).abs() < 1e-12);
        if (b - v_own).abs() < 1e-9 {
            return Ok(()); // Rounding may decide whether it matters.
        }
        prop_assert_eq!(guard.cones.len(), usize::from(b < v_own));
        let swept = say("swept", &[v_own, its_speed, h, tau_o, eps]);
        for cone in &guard.cones {
            prop_assert!((cone.b - b).abs() < 1e-9);
            let psi = say("psi", &[spread, say("swing", &[swept, r])]);
            prop_assert!((cone.psi - psi).abs() < 1e-9);
            let n = rotate(if r > 0.0 { direction } else { 0.0 }, Vec2::new(1.0, 0.0));
            prop_assert!((cone.n - n).norm() < 1e-9);
        }

        let tau_max = tau * others_longer;
        let far =
            say("far_braking", &[kept, share, rate, guard.lifetime, tau_max, v_max, its_speed]);
        let radius = if a_wall { guard.kept.walls_radius } else { guard.kept.robots_radius };
        prop_assert!(radius - 2.0 * eps >= far - 1e-12);
        // a_w of the proof is that of ell w. Its y is a vector.
        let twist = Twist { v_m_s: twist.0, w_rad_s: twist.1 };
        let (a, aw) = (acceleration_m_s2, ell * turn_acceleration_rad_s2);
        let time = (twist.v_m_s.abs() / a).max((ell * twist.w_rad_s).abs() / aw);
        prop_assert!((guard.braking_time(twist) - time).abs() < 1e-12);
    }

    #[test]
    fn mu_is_that_of_the_proof_and_lets_braking_keep_up(x in 0.0..20.0f64, share in 0.0..1.5f64) {
        prop_assert!((mu(x) - Formulas::read(&SOURCES).value("mu", &[x])).abs() < 1e-12);
        // `proof/Inertia.v::braking_keeps_up`, with k tau = x.
        prop_assert!((1.0 - share).max(0.0) * mu(x) <= (-x * share).exp() + 1e-15);
    }

    /// What the certificate says of a cone, for all its directions.
    #[test]
    fn a_cone_permits_what_approaches_slower_than_b_in_all_its_directions(
        psi in 0.0..=PI, b in 0.0..0.5f64, u in (0.0..1.0f64, -3.2..3.2f64),
    ) {
        let cone = Cone { n: Vec2::new(1.0, 0.0), psi, b };
        let u = rotate(u.1, Vec2::new(u.0, 0.0));
        let slowest = (0..=2000).map(|k| {
            rotate(psi * (f64::from(k) / 1000.0 - 1.0), cone.n).dot(&u)
        });
        let slowest = slowest.fold(f64::INFINITY, f64::min);
        if (slowest + b).abs() > 1e-5 {
            prop_assert_eq!(cone.permits(u), slowest > -b);
        }
        let within = cone.sides().all(|side| side.normal.dot(&u) >= -side.bound);
        prop_assert!(!within || cone.permits(u));
    }
}

#[test]
fn what_is_compared_above_is_what_the_certificate_says() {
    let [.., inertia, braking, obstacles] = SOURCES;
    for part in [
        "let h := turning_time (lifetime S) tau_o in",
        "let M := swept v_own (its_speed x) (lifetime S) tau_o (eps S) in",
        "let Psi := psi (spread h w_low w_high (eta S)) (swing M r) in",
        "- b <= dot (rotate a n) (rotate (middle theta_sensed h w_low w_high) y).",
        "v_own <= b \\/",
    ] {
        assert!(braking.contains(part), "{part}");
    }
    // The front point, its nearest point, its speed, the share, and what is kept.
    let of_robot = "Near (fun t => minus (front r t) (front o t)) (v_max S) (Lambda S) (d S).";
    assert!(braking.contains(of_robot));
    let of_wall = "Near (fun t => minus (front r t) (nearest (front r t))) 0 (2 * Lambda S) clear.";
    assert!(obstacles.contains(of_wall));
    assert!(inertia.contains("Rmax (Rabs (fst y) / a) (Rabs (snd y) / aw)."));
}
