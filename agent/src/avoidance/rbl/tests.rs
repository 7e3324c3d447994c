//! Guarantees of the paper, cells, centroids and rules.

use formation::random::SplitMix64;
use proptest::prelude::*;

use super::super::guard::tests::brief;
use super::super::ideal_simulation::{
    IdealSimulation, antipodal_starts_and_goals, draw_separated_points,
};
use super::*;

const DISTANCE_MIN_M: f64 = 0.2;

fn rbl(k: f64, period: f64) -> Rbl {
    Rbl {
        distance_min: DISTANCE_MIN_M,
        clearance: 0.1,
        v_max: 0.5,
        period,
        approach_rate: k,
        nominal_spread: 0.1,
        spread: 0.1,
        goal_rotation_rad: 0.0,
        disc_points: disc_grid_points(0.6),
        cell_points: Vec::new(),
        half_planes: Vec::new(),
    }
}

fn simulation(starts: Vec<Vec2>, goals: Vec<Vec2>, k: f64, period: f64) -> IdealSimulation<Rbl> {
    IdealSimulation::new(
        (0..starts.len()).map(|_| rbl(k, period)).collect(),
        starts,
        goals,
        0.5,
        period,
    )
}

/// Sampled at the maximum period.
#[test]
fn ideal_robots_keep_d() {
    for seed in 0..12 {
        let mut random = SplitMix64::new(seed);
        let robots = random.draw_between(2, 8) as usize;
        let starts = draw_separated_points(&mut random, robots, 1.2, DISTANCE_MIN_M);
        let goals = draw_separated_points(&mut random, robots, 1.2, 0.0);
        let mut simulation = simulation(starts, goals, 10.0, 0.05);
        for k in 0..300 {
            let closest = simulation.step();
            assert!(closest > DISTANCE_MIN_M - 1e-9, "seed {seed}: {closest} in period {k}");
        }
    }
}

/// Convergence to a neighborhood of the goals, also from exact symmetry.
#[test]
fn ideal_robots_arrive_near_their_goals() {
    for robots in [2, 3, 4, 6, 8] {
        let [starts, goals] = antipodal_starts_and_goals(robots, 1.0);
        let mut simulation = simulation(starts, goals, 10.0, 0.02);
        let closest = (0..3000).map(|_| simulation.step()).fold(f64::INFINITY, f64::min);
        assert!(closest > DISTANCE_MIN_M - 1e-9, "{robots}: {closest}");
        assert!(
            simulation.goal_distance_max() < 0.05,
            "{robots}: {}",
            simulation.goal_distance_max()
        );
    }
}

#[test]
fn single_robot_goes_straight_to_its_goal_and_stays() {
    let mut simulation = simulation(vec![Vec2::zeros()], vec![Vec2::new(0.7, -0.4)], 10.0, 0.02);
    for _ in 0..400 {
        simulation.step();
        let error = 0.7 * simulation.positions[0].y + 0.4 * simulation.positions[0].x;
        assert!(error.abs() < 0.02, "{:?}", simulation.positions);
    }
    assert!(simulation.goal_distance_max() < 1e-3, "{}", simulation.goal_distance_max());
    // Without a goal it stays where it is.
    let u = rbl(10.0, 0.02).choose_velocity(&Sample::default(), Vec2::new(0.3, 0.0)).unwrap();
    assert!(u.norm() < 1e-12, "{u:?}");
}

proptest! {
    /// The cell consists of the points closer to the robot, and far enough from others.
    #[test]
    fn cell_matches_the_definition_of_the_paper(
        neighbors in proptest::collection::vec((-3.2..3.2f64, 0.2..1.2f64), 0..6),
        wall in proptest::option::of((-3.2..3.2f64, 0.1..0.5f64)),
    ) {
        let polar = |(angle, length): (f64, f64)| length * Vec2::new(angle.cos(), angle.sin());
        let neighbor_vectors: Vec<Vec2> = neighbors.into_iter().map(polar).collect();
        let walls: Vec<Vec2> = wall.into_iter().map(polar).collect();
        let mut rbl = rbl(10.0, 0.02);
        rbl.collect_cell_points(&Sample { neighbor_vectors: &neighbor_vectors, wall_vectors: &walls, ..Sample::default() });
        let disc = disc_grid_points(0.6);
        let is_nearer = |q: &Vec2| neighbor_vectors.iter().all(|z| {
            // Definition of the paper: compared with the other robot or, if it is near, with a point before it.
            let p = -z;
            let limit_point = if p.norm() >= 2.0 * DISTANCE_MIN_M { p } else {
                p + 2.0 * (DISTANCE_MIN_M - 0.5 * p.norm()) * z / z.norm()
            };
            (q - limit_point).norm() >= q.norm() - 1e-12
        });
        let is_clear = |q: &Vec2| walls.iter().all(|z| z.dot(q) / z.norm() >= 0.1 - z.norm() - 1e-12);
        let expected: Vec<Vec2> = disc.into_iter().filter(|q| is_nearer(q) && is_clear(q)).collect();
        // At a boundary rounding decides.
        prop_assert!(rbl.cell_points.len().abs_diff(expected.len()) <= 2, "{} {}", rbl.cell_points.len(), expected.len());
    }
}

#[test]
fn empty_cell_stops_the_robot() {
    let neighbor_vectors = [Vec2::new(0.05, 0.0), Vec2::new(-0.05, 0.0)];
    let sample = Sample {
        neighbor_vectors: &neighbor_vectors,
        error: Some(Vec2::new(1.0, 0.0)),
        ..Sample::default()
    };
    let mut rbl = rbl(10.0, 0.02);
    assert_eq!(rbl.choose_velocity(&sample, Vec2::zeros()), Some(Vec2::zeros()));
    assert!(rbl.cell_points.is_empty());
}

#[test]
fn blocked_robot_turns_goal_clockwise_and_back_when_free() {
    let mut rbl = rbl(10.0, 0.1);
    // Another robot ahead leaves 0.06 m.
    let neighbor_vectors = [Vec2::new(-0.26, 0.0)];
    let goal = Some(Vec2::new(-1.0, 0.0)); // ahead
    let blocked_sample =
        Sample { neighbor_vectors: &neighbor_vectors, error: goal, ..Sample::default() };
    rbl.choose_velocity(&blocked_sample, Vec2::zeros());
    assert!(
        (rbl.goal_rotation_rad - 0.1).abs() < 1e-12 && (rbl.spread - 0.05).abs() < 1e-12,
        "first (8) and (9)"
    );
    let u =
        rbl.choose_velocity(&Sample { error: goal, ..Sample::default() }, Vec2::zeros()).unwrap();
    assert!(u.y < -0.01, "the goal lies clockwise of ahead: {u:?}");
    let free = Sample { error: goal, ..Sample::default() };
    for _ in 0..100 {
        rbl.choose_velocity(&free, Vec2::zeros());
    }
    assert_eq!(rbl.goal_rotation_rad, 0.0);
    assert!((rbl.spread - 0.1).abs() < 1e-4, "{}", rbl.spread);
}

#[test]
fn turned_goal_resets_if_the_straight_way_is_longer() {
    let mut rbl = rbl(10.0, 0.1);
    let goal = Some(Vec2::new(-1.0, 0.0));
    // The way ahead is free, and another robot is on the right, in the direction of the turned goal.
    let neighbor_vectors = [Vec2::new(0.0, 0.26)];
    rbl.goal_rotation_rad = FRAC_PI_2;
    rbl.choose_velocity(
        &Sample { neighbor_vectors: &neighbor_vectors, error: goal, ..Sample::default() },
        Vec2::zeros(),
    );
    assert_eq!(rbl.goal_rotation_rad, 0.0);
}

#[test]
fn sensing_radius_covers_touching_cells_and_period_advised() {
    let mut brief = brief();
    let gains = [("cell_radius_m", 0.6), ("spread_m", 0.1), ("approach_per_s", 10.0)];
    brief.avoidance.gains = gains.map(|(key, gain)| (key.to_owned(), gain)).into();
    let starts = MethodConditions::for_robot(&brief);
    assert!((sensing_radius_m(&starts) - 1.2).abs() < 1e-12);
    assert!((METHOD.description.find_warning)(&starts).is_none());
    let advice =
        (METHOD.description.find_warning)(&MethodConditions { period_s: 0.06, ..starts }).unwrap();
    assert!(advice.message.starts_with("approach_per_s T = 0.6: "), "{}", advice.message);
}
