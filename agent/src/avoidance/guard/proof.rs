//! The guard compared with its proof: the formulas of the lemmas in the folder `proof` are read and evaluated.
//! A change of either side requires a change of the other.

use formation::ramp::Ramp;
use proptest::prelude::*;

use super::super::braking::approach_speed_factor;
use super::formulas::Formulas;
use super::tests::{brief, sample};
use super::*;

const PROOF_SOURCES: [&str; 6] = [
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Geometry.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Guard.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Walls.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Inertia.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Braking.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Obstacles.v")),
];

/// Maximum turn rate of a robot at its axle midpoint.
const TURN_RATE_MAX_RAD_S: f64 = 6.0;
/// Clearance in units of d.
const CLEARANCE: f64 = 0.7;

fn limits(accelerations: (f64, f64), braking_time_s: f64, ramp: Ramp) -> AccelerationLimitsBrief {
    let (acceleration_m_s2, turn_acceleration_rad_s2) = accelerations;
    AccelerationLimitsBrief { acceleration_m_s2, turn_acceleration_rad_s2, braking_time_s, ramp }
}

/// Returns a guard with T = 10 ms and H = 25 ms.
fn guard(
    [d, v_max, ell]: [f64; 3],
    errors: (f64, f64),
    limits: Option<AccelerationLimitsBrief>,
    tau_max: f64,
) -> Guard {
    let turn_rate_max_rad_s = (ell == 0.0).then_some(TURN_RATE_MAX_RAD_S);
    let mut brief = AgentBrief { limits, front_point_m: ell, turn_rate_max_rad_s, ..brief() };
    brief.avoidance.distance_min_m = d;
    brief.avoidance.clearance_m = CLEARANCE * d;
    brief.avoidance.speed_max_m_s = v_max;
    brief.avoidance.braking_time_max_s = tau_max;
    (brief.avoidance.sensing_error_m, brief.avoidance.heading_error_rad) = errors;
    Guard::new(&brief)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6000))]

    #[test]
    fn guard_formulas_equal_those_of_the_proof(
        d in 0.1..0.4f64,
        v_max in 0.1..2.0f64,
        ell in 0.05..0.3f64,
        accelerations in (0.2..5.0f64, 0.5..10.0f64),
        // All robots stop at once, or none does.
        tau in prop_oneof![Just(0.0), 0.05..2.0f64],
        team_factor in prop_oneof![Just(1.0), 1.0..2.0f64],
        own_fractions in (0.0..=1.0f64, 0.0..=1.0f64),
        period_longer in prop_oneof![Just(0.0), Just(1.0)],
        relative_slack in -0.2..3.5f64, // the distance beyond d, in v_max / Lambda
        direction in -3.2..3.2f64,
        heading in -3.2..3.2f64,
        turn_fractions in (-1.0..=0.0f64, 0.0..=1.0f64),
        errors in prop_oneof![Just((0.0, 0.0)), (0.0..0.02f64, 0.0..0.2f64)],
        is_wall in any::<bool>(),
        at_axle in any::<bool>(),
    ) {
        let ell = if at_axle { 0.0 } else { ell };
        let ramp = if at_axle { Ramp::Independent } else { Ramp::Together };
        let limits = (tau > 0.0).then(|| limits(accelerations, tau, ramp));
        let tau_max = tau * team_factor;
        let mut guard = guard([d, v_max, ell], errors, limits, tau_max);
        let proof = Formulas::read(&PROOF_SOURCES);
        let evaluate = |name: &str, arguments: &[f64]| proof.evaluate(name, arguments);

        let (v_own, tau_o) = (own_fractions.0 * v_max, own_fractions.1 * tau);
        let w_max = guard.drive.turn_rate_bound(v_max);
        let w = [turn_fractions.0 * w_max, turn_fractions.1 * w_max];
        // A certificate with a longer horizon equals one with a longer command timeout.
        let h = guard.command_lifetime_s + if tau > 0.0 { period_longer * guard.period_s } else { 0.0 };
        let rate = evaluate("braking_rate", &[guard.command_lifetime_s, tau_max]);
        prop_assert!((guard.slack_decrease_rate_per_s - rate).abs() < 1e-12);
        // The cases are `proof/Braking.v::another_robot` and `proof/Obstacles.v::an_obstacle`.
        let [neighbor_speed, slack_rate, distance_min] = match is_wall {
            true => [0.0, 2.0 * rate, CLEARANCE * d],
            false => [v_max, rate, d],
        };
        let r = (distance_min + relative_slack * v_max / rate).max(0.0);
        let z = [rotate(direction, Vec2::new(r, 0.0))];
        let [neighbor_vectors, walls] = if is_wall { [&[][..], &z] } else { [&z[..], &[]] };
        let sample = Sample { wall_vectors: walls, ..sample(0, heading, neighbor_vectors) };
        let bounds = MotionBounds { own_speed_max: v_own, braking_time_max: tau_o, turn_rate_range: w };
        let mid = guard.collect_cones(&sample, Horizon::new(guard.slack_decrease_rate_per_s, h), bounds);

        let (sensing_error, heading_error) = errors;
        let eps = sensing_error + evaluate("front_error", &[ell, heading_error]);
        let turning = evaluate("turning_time", &[if at_axle { 1.0 } else { 0.5 }, h, tau_o]);
        let spread = evaluate("spread", &[turning, w[0], w[1], heading_error]);
        let rho = evaluate("slack", &[r, eps, distance_min, ROUNDING_MARGIN_M]);
        let reach = evaluate("reach", &[neighbor_speed, v_own, h, eps]);
        let b = evaluate("braking_bound", &[slack_rate, rate, h, tau_o, rho, reach]);
        prop_assert!((mid - evaluate("middle", &[heading, turning, w[0], w[1]])).abs() < 1e-12);
        if tau == 0.0 {
            // The bound of robots that stop at once is a corollary.
            let at_once = evaluate(if is_wall { "wall_bound" } else { "bound" }, &[h, rho, reach]);
            prop_assert!((at_once - b).abs() < 1e-9);
        }
        let vicinity = &guard.vicinity;
        let radius = if is_wall { vicinity.known_walls_radius } else { vicinity.known_robots_radius };
        // At the limits rounding decides whether a neighbor matters. The radii are for H; the longer horizon only makes
        // it likely that a twist can be certified again.
        prop_assume!((b - v_own).abs() >= 1e-9 && (r - radius).abs() >= 1e-9);
        prop_assert_eq!(guard.cones.len(), usize::from(b < v_own && (r < radius || h == guard.command_lifetime_s)));
        let swept = evaluate("swept", &[v_own, neighbor_speed, h, tau_o, eps]);
        for cone in &guard.cones {
            prop_assert!((cone.approach_speed_max - b).abs() < 1e-9);
            let psi = evaluate("psi", &[spread, evaluate("swing", &[swept, r])]);
            prop_assert!((cone.half_angle_rad - psi).abs() < 1e-9);
            // At r = 0 every direction is valid.
            let n = rotate(if r > 0.0 { direction } else { 0.0 }, Vec2::new(1.0, 0.0));
            prop_assert!((cone.axis - n).norm() < 1e-9);
            let count = evaluate("count", &[cone.half_angle_rad]);
            prop_assert_eq!(cone.half_planes().count() as f64, count);
            for (q, side) in cone.half_planes().enumerate() {
                let angle = evaluate("side_angle", &[cone.half_angle_rad, count, q as f64]);
                prop_assert!((side.normal - rotate(angle, n)).norm() < 1e-9);
                prop_assert!((side.boundary_distance - evaluate("side_bound", &[b, cone.half_angle_rad, count])).abs() < 1e-9);
            }
        }

        // The radii cover the distance that the proof requires.
        let lifetime = guard.command_lifetime_s;
        let mut required_radius = evaluate("far_braking", &[distance_min, slack_rate, rate, lifetime, tau_max, v_max, neighbor_speed]);
        if tau == 0.0 {
            let name = if is_wall { "far_wall" } else { "far" };
            required_radius = required_radius.max(evaluate(name, &[distance_min, v_max, lifetime]));
        }
        prop_assert!(radius - 2.0 * eps >= required_radius - 1e-12);
    }

    #[test]
    fn braking_time_and_mu_equal_those_of_the_proof(
        a in (0.2..5.0f64, 0.5..10.0f64), twist in (-2.0..2.0f64, -5.0..5.0f64),
        x in 0.0..20.0f64, fraction in 0.0..1.5f64,
    ) {
        // In the proof a_w is the acceleration of ell w, and y is a vector.
        let limits = limits(a, 1.0, Ramp::Together);
        let guard = guard([0.2, 0.5, 0.1], (0.0, 0.0), Some(limits), 1.0);
        let time = (twist.0.abs() / a.0).max(twist.1.abs() / a.1);
        let twist = Twist::new(twist.0, twist.1);
        prop_assert!((guard.braking_time(twist) - time).abs() < 1e-12);
        prop_assert!((approach_speed_factor(x) - Formulas::read(&PROOF_SOURCES).evaluate("mu", &[x])).abs() < 1e-12);
        // Lemma `proof/Inertia.v::braking_keeps_up`, with k tau = x.
        prop_assert!((1.0 - fraction).max(0.0) * approach_speed_factor(x) <= (-x * fraction).exp() + 1e-15);
    }

    /// Checks the statement of the certificate for all directions of a cone.
    #[test]
    fn cone_permits_only_approaches_slower_than_b(
        psi in 0.0..=PI, b in 0.0..0.5f64, u in (0.0..1.0f64, -3.2..3.2f64),
    ) {
        let cone = Cone { axis: Vec2::new(1.0, 0.0), half_angle_rad: psi, approach_speed_max: b };
        let u = rotate(u.1, Vec2::new(u.0, 0.0));
        let slowest = (0..=2000).map(|k| {
            rotate(psi * (f64::from(k) / 1000.0 - 1.0), cone.axis).dot(&u)
        });
        let slowest = slowest.fold(f64::INFINITY, f64::min);
        if (slowest + b).abs() > 1e-5 {
            prop_assert_eq!(cone.permits(u), slowest > -b);
        }
        let within = cone.half_planes().all(|side| side.normal.dot(&u) >= -side.boundary_distance);
        prop_assert!(!within || cone.permits(u));
    }
}

#[test]
fn compared_formulas_occur_in_the_certificates() {
    let [.., walls, inertia, braking, obstacles] = PROOF_SOURCES;
    let parts = [
        (walls, "let M := reach 0 v_own (Guard.lifetime S) (Guard.eps S) in"),
        (
            walls,
            "let b := wall_bound (Guard.lifetime S) (slack r (Guard.eps S) clear (Guard.rounding S)) M in",
        ),
        (braking, "let h := turning_time (turn_part S) (lifetime S) tau_o in"),
        (braking, "turn_part S = 1 \\/"),
        (
            braking,
            "turn_part S = 1 / 2 /\\ exists ell, 0 < ell /\\ forall t, side r t = ell * w r t.",
        ),
        (braking, "let M := swept v_own (its_speed x) (lifetime S) tau_o (eps S) in"),
        (braking, "let Psi := psi (spread h w_low w_high (eta S)) (swing M r) in"),
        (braking, "- b <= dot (rotate a n) (rotate (middle theta_sensed h w_low w_high) y)."),
        (braking, "v_own <= b \\/"),
        // The front point, its nearest point, its speed, the share, and the minimum distance.
        (braking, "Near (fun t => minus (front r t) (front o t)) (v_max S) (Lambda S) (d S)."),
        (
            obstacles,
            "Near (fun t => minus (front r t) (nearest (front r t))) 0 (2 * Lambda S) clear.",
        ),
        (inertia, "Rmax (Rabs (fst y) / a) (Rabs (snd y) / aw)."),
    ];
    for (source, part) in parts {
        assert!(source.contains(part), "{part}");
    }
    // Assumption `proof/Guard.v::sensible`: the rounding margin is not negative.
    const { assert!(ROUNDING_MARGIN_M >= 0.0) };
}
