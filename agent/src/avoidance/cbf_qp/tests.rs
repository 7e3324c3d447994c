//! Guarantees of the paper.

use formation::random::SplitMix64;

use super::super::guard::tests::brief;
use super::super::ideal_simulation::{IdealSimulation, draw_separated_points};
use super::*;

const DISTANCE_MIN_M: f64 = 0.2;

fn cbf_qp(rate: f64) -> CbfQp {
    CbfQp { distance_min: DISTANCE_MIN_M, clearance: 0.1, v_max: 0.5, barrier_rate: rate }
}

fn polar_vector(angle: f64, length: f64) -> Vec2 {
    length * Vec2::new(angle.cos(), angle.sin())
}

/// Forward invariance at the maximum period, for arbitrary requested velocities.
#[test]
fn ideal_robots_keep_d_for_any_requested_velocities() {
    let period = 0.05;
    for seed in 0..30 {
        let mut random = SplitMix64::new(seed);
        let robots = random.draw_between(2, 9) as usize;
        let starts = draw_separated_points(&mut random, robots, 1.2, DISTANCE_MIN_M);
        let goals = draw_separated_points(&mut random, robots, 1.2, 0.0);
        let methods = (0..robots).map(|_| cbf_qp(1.0 / period)).collect();
        let mut simulation = IdealSimulation::new(methods, starts, goals, 0.5, period);
        for k in 0..400 {
            let closest = match k % 40 {
                // Half of the time all robots request random velocities.
                0..20 => {
                    let gammas: Vec<Vec2> =
                        (0..robots).map(|_| polar_vector(6.3 * random.draw_unit(), 0.5)).collect();
                    simulation.step_with_velocities(&gammas)
                }
                _ => simulation.step(),
            };
            assert!(closest > DISTANCE_MIN_M - 1e-9, "seed {seed}: {closest} in period {k}");
        }
    }
}

#[test]
fn constraint_is_shared_with_robots_and_full_for_walls() {
    let neighbor_vectors = [Vec2::new(-0.25, 0.0)];
    let sample = Sample { neighbor_vectors: &neighbor_vectors, ..Sample::default() };
    let u = cbf_qp(1.0).choose_velocity(&sample, Vec2::new(0.5, 0.1)).unwrap();
    // a (r^2 - d^2) / (4 r)
    assert!((u - Vec2::new(0.0225, 0.1)).norm() < 1e-12, "{u:?}");
    let walls = [Vec2::new(-0.2, 0.0)];
    let sample = Sample { wall_vectors: &walls, ..Sample::default() };
    let u = cbf_qp(1.0).choose_velocity(&sample, Vec2::new(0.5, 0.1)).unwrap();
    // a (r^2 - clearance^2) / (2 r)
    assert!((u - Vec2::new(0.03 / 0.4, 0.1)).norm() < 1e-12, "{u:?}");
}

#[test]
fn infeasible_program_leaves_violated_neighbors_fastest() {
    // Evenly surrounded by three robots that are too close: no direction improves the worst case.
    let neighbor_vectors =
        [0.3, 2.394_395_102_393_2, 4.488_790_204_786_4].map(|angle| polar_vector(angle, 0.15));
    let sample = Sample { neighbor_vectors: &neighbor_vectors, ..Sample::default() };
    let u = cbf_qp(1.0).choose_velocity(&sample, Vec2::new(0.5, 0.0)).unwrap();
    assert!(u.norm() < 1e-9, "{u:?}");
    // Coincident with another robot, it leaves at v_max.
    let same = [Vec2::zeros()];
    let sample = Sample { neighbor_vectors: &same, ..Sample::default() };
    let u = cbf_qp(1.0).choose_velocity(&sample, Vec2::zeros()).unwrap();
    assert!((u.norm() - 0.5).abs() < 1e-12, "{u:?}");
}

#[test]
fn sensing_radius_bounds_influence_and_long_period_is_advised() {
    let mut brief = brief();
    brief.avoidance.gains = [("barrier_per_s".to_owned(), 2.0)].into();
    let conditions = MethodConditions::for_robot(&brief);
    let needed = sensing_radius_m(&conditions);
    let granted_speed = |r: f64| {
        let neighbor_vectors = [Vec2::new(-r, 0.0)];
        let sample = Sample { neighbor_vectors: &neighbor_vectors, ..Sample::default() };
        cbf_qp(2.0).choose_velocity(&sample, Vec2::new(0.5, 0.0)).unwrap().x
    };
    assert_eq!(granted_speed(1.000_001 * needed), 0.5);
    assert!(granted_speed(0.99 * needed) < 0.5);
    assert!((METHOD.description.find_warning)(&conditions).is_none());
    let slow = MethodConditions { period_s: 0.6, ..conditions };
    let advice = (METHOD.description.find_warning)(&slow).unwrap();
    assert!(advice.message.starts_with("barrier_per_s T = 1.2: "), "{}", advice.message);
}
