//! Tests of the guarantees of ORCA (van den Berg et al. 2011), and of their limits.

use formation::front_point::twist_for_front_velocity;
use formation::random::SplitMix64;
use proptest::prelude::*;
use protocol::brief::AgentBrief;

use super::super::guard::tests::brief as guarded;
use super::super::ideal_simulation::{IdealSimulation, draw_separated_points};
use super::*;

const DISTANCE_MIN_M: f64 = 0.2;
const TIME_HORIZON_S: f64 = 2.0;

fn orca() -> Orca {
    Orca {
        distance_min: DISTANCE_MIN_M,
        clearance: 0.1,
        v_max: 0.5,
        ell: 0.1,
        period: 0.01,
        time_horizon: TIME_HORIZON_S,
        half_planes: Vec::new(),
    }
}

fn polar_vector(angle: f64, length: f64) -> Vec2 {
    length * Vec2::new(angle.cos(), angle.sin())
}

/// Returns the minimum distance within `time` of two robots at distance `p` with relative velocity `v`.
fn minimum_distance(p: Vec2, v: Vec2, time: f64) -> f64 {
    let speed = v.norm_squared();
    let time_of_minimum = if speed > 0.0 { (p.dot(&v) / speed).clamp(0.0, time) } else { 0.0 };
    (p - time_of_minimum * v).norm()
}

fn robots_collide(p: Vec2, v: Vec2, time: f64) -> bool {
    minimum_distance(p, v, time) < DISTANCE_MIN_M
}

/// Returns the maximum violation of a side.
fn max_violation(u: Vec2, sides: &[HalfPlane]) -> f64 {
    sides.iter().map(|side| side.violation_m_s(u)).fold(f64::NEG_INFINITY, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    /// Just inside the boundary the robots collide, just outside they do not, and no smaller change reaches the
    /// boundary.
    #[test]
    fn smallest_change_reaches_the_velocity_obstacle_boundary(
        (direction, slack) in (-3.2..3.2f64, 0.001..1.5f64), (course, speed) in (-3.2..3.2f64, 0.0..1.0f64),
    ) {
        let (p, v) = (polar_vector(direction, DISTANCE_MIN_M + slack), polar_vector(course, speed));
        let (u, n) = orca().smallest_velocity_change(p, v);
        let boundary_velocity = v + u;
        prop_assert!(!robots_collide(p, boundary_velocity + 1e-6 * n, TIME_HORIZON_S));
        prop_assert!(robots_collide(p, boundary_velocity - 1e-6 * n, TIME_HORIZON_S));
        prop_assert!((u - u.dot(&n) * n).norm() < 1e-9);
        for k in 0..64 {
            let other = v + polar_vector(f64::from(k) * 0.1, 0.999 * u.norm() - 1e-9);
            prop_assert_eq!(robots_collide(p, other, TIME_HORIZON_S), robots_collide(p, v, TIME_HORIZON_S), "{:?}", other);
        }
    }

    /// The theorem of the paper: any velocities in the two half-planes keep the robots apart for tau.
    #[test]
    fn velocities_in_both_half_planes_avoid_collision(
        (direction, slack) in (-3.2..3.2f64, 0.001..1.5f64),
        velocities in [(-3.2..3.2f64, 0.0..0.5f64), (-3.2..3.2f64, 0.0..0.5f64)],
        gammas in [(-3.2..3.2f64, 0.0..0.5f64), (-3.2..3.2f64, 0.0..0.5f64)],
    ) {
        let z = polar_vector(direction, -(DISTANCE_MIN_M + slack));
        let [a, b] = velocities.map(|(angle, speed)| polar_vector(angle, speed));
        let choose = |z: Vec2, own: Vec2, other: Vec2, gamma: Vec2| {
            let mut orca = Orca { v_max: 10.0, ..orca() };
            let (neighbor_vectors, velocities) = ([z], [other]);
            let sample = Sample {
                twist: twist_for_front_velocity(0.0, 0.1, own),
                neighbor_vectors: &neighbor_vectors,
                neighbor_velocities: &velocities,
                ..Sample::default()
            };
            orca.choose_velocity(&sample, gamma).unwrap()
        };
        let [gamma_a, gamma_b] = gammas.map(|(angle, speed)| polar_vector(angle, speed));
        let relative = choose(z, a, b, gamma_a) - choose(-z, b, a, gamma_b);
        // At the boundary itself rounding decides.
        prop_assert!(minimum_distance(-z, relative, TIME_HORIZON_S) > DISTANCE_MIN_M - 1e-9, "{relative:?}");
    }
}

fn simulation(starts: Vec<Vec2>, goals: Vec<Vec2>) -> IdealSimulation<Orca> {
    IdealSimulation::new((0..starts.len()).map(|_| orca()).collect(), starts, goals, 0.5, 0.01)
}

/// The guarantee of the paper, for robots that satisfy its assumptions.
#[test]
fn ideal_robots_keep_d_while_programs_are_feasible() {
    let (mut feasible_periods, mut arrived) = (0, 0);
    for seed in 0..20 {
        let mut random = SplitMix64::new(seed);
        let [starts, goals] = [0, 1].map(|_| draw_separated_points(&mut random, 6, 2.0, 0.3));
        let mut simulation = simulation(starts, goals);
        let mut closest = f64::INFINITY;
        for _ in 0..2000 {
            let now = simulation.step();
            let is_feasible =
                |(orca, u): (&Orca, &Vec2)| max_violation(*u, &orca.half_planes) < 1e-9;
            if !simulation.methods.iter().zip(&simulation.velocities).all(is_feasible) {
                break;
            }
            feasible_periods += 1;
            closest = closest.min(now);
        }
        assert!(closest > DISTANCE_MIN_M - 1e-9, "seed {seed}: {closest}");
        arrived += u32::from(simulation.goal_distance_max() < 0.01);
    }
    assert!(
        feasible_periods > 30_000 && arrived >= 15,
        "{feasible_periods} periods, {arrived} of 20 arrived"
    );
}

#[test]
fn wall_constraint_is_full_and_not_relaxed() {
    let mut orca = orca();
    // The wall is 0.15 m ahead, and another robot approaches from behind at 0.5 m/s.
    let (walls, neighbor_vectors) = ([Vec2::new(-0.15, 0.0)], [Vec2::new(0.21, 0.0)]);
    let velocities = [Vec2::new(0.5, 0.0)];
    let sample = Sample { wall_vectors: &walls, ..Sample::default() };
    let u = orca.choose_velocity(&sample, Vec2::new(0.5, 0.0)).unwrap();
    assert!((u - Vec2::new(0.025, 0.0)).norm() < 1e-12, "0.05 m of slack in 2 s: {u:?}");
    let pushed =
        Sample { neighbor_vectors: &neighbor_vectors, neighbor_velocities: &velocities, ..sample };
    let u = orca.choose_velocity(&pushed, Vec2::new(0.5, 0.0)).unwrap();
    assert!(u.x <= 0.025 + 1e-9, "{u:?}");
    // Inside the clearance it must leave within one period.
    let beyond = [Vec2::new(-0.097, 0.0)];
    let u = orca
        .choose_velocity(&Sample { wall_vectors: &beyond, ..Sample::default() }, Vec2::zeros())
        .unwrap();
    assert!((u.x + 0.3).abs() < 1e-9, "{u:?}");
}

#[test]
fn missing_velocities_give_no_velocity() {
    let neighbor_vectors = [Vec2::new(0.3, 0.0)];
    let sample = Sample { neighbor_vectors: &neighbor_vectors, ..Sample::default() };
    assert_eq!(orca().choose_velocity(&sample, Vec2::new(0.1, 0.0)), None);
}

#[test]
fn sensing_radius_covers_all_meetings_in_the_horizon() {
    let mut brief = AgentBrief { ..guarded() };
    brief.avoidance.gains = [("horizon_s".to_owned(), 2.0)].into();
    brief.avoidance.kind = "orca".into();
    let needed = sensing_radius_m(&MethodConditions::for_robot(&brief));
    assert!((needed - 2.2).abs() < 1e-12, "d + 2 v_max tau: {needed}");
    brief.avoidance.clearance_m = 1.5;
    assert!((sensing_radius_m(&MethodConditions::for_robot(&brief)) - 2.5).abs() < 1e-12);
    assert!(super::super::build(&brief).is_ok());
    brief.avoidance.gains.clear();
    assert!(super::super::build(&brief).is_err());
}
