//! Simulation of robots under the assumptions of the papers, for tests: points that choose velocities
//! simultaneously with exact knowledge of the positions and velocities of the others, and move at these
//! velocities until the next period.

use formation::Vec2;
use formation::front_point::twist_for_front_velocity;
use formation::random::SplitMix64;

use super::holonomic::VelocityMethod;
use super::{Sample, clip};

/// Distance of the front point (ell) of each robot, m. The heading is always along x.
pub const ELL: f64 = 0.1;

/// Points with their methods, goals and velocities.
pub struct IdealSimulation<V> {
    pub methods: Vec<V>,
    pub positions: Vec<Vec2>,
    pub goals: Vec<Vec2>,
    pub velocities: Vec<Vec2>,
    pub v_max: f64,
    /// Control period (T), s.
    pub period: f64,
}

impl<V: VelocityMethod> IdealSimulation<V> {
    /// Creates points at rest at the given `positions`.
    pub fn new(
        methods: Vec<V>,
        positions: Vec<Vec2>,
        goals: Vec<Vec2>,
        v_max: f64,
        period: f64,
    ) -> Self {
        let velocities = vec![Vec2::zeros(); positions.len()];
        IdealSimulation { methods, positions, goals, velocities, v_max, period }
    }

    /// Simulates one period towards the goals at up to v_max. Returns the minimum distance of two points during
    /// it, m.
    pub fn step(&mut self) -> f64 {
        let velocity =
            |(position, goal): (&Vec2, &Vec2)| clip((goal - position) / self.period, self.v_max);
        let gammas: Vec<Vec2> = self.positions.iter().zip(&self.goals).map(velocity).collect();
        self.step_with_velocities(&gammas)
    }

    /// Simulates one period with the requested velocities `gammas`. Returns the minimum distance of two points
    /// during it, m.
    pub fn step_with_velocities(&mut self, gammas: &[Vec2]) -> f64 {
        let chosen: Vec<Vec2> =
            (0..self.positions.len()).map(|i| self.choose_velocity(i, gammas[i])).collect();
        let mut closest = f64::INFINITY;
        for i in 0..self.positions.len() {
            for j in 0..i {
                let (z, v) = (self.positions[i] - self.positions[j], chosen[i] - chosen[j]);
                let speed = v.norm_squared();
                let time =
                    if speed > 0.0 { (-z.dot(&v) / speed).clamp(0.0, self.period) } else { 0.0 };
                closest = closest.min((z + time * v).norm());
            }
        }
        for (position, v) in self.positions.iter_mut().zip(&chosen) {
            *position += self.period * v;
        }
        self.velocities = chosen;
        closest
    }

    fn choose_velocity(&mut self, i: usize, gamma: Vec2) -> Vec2 {
        let mut others: Vec<usize> = (0..self.positions.len()).filter(|j| *j != i).collect();
        let z = |j: usize| self.positions[i] - self.positions[j];
        others.sort_by(|a, b| z(*a).norm().total_cmp(&z(*b).norm()));
        let neighbor_vectors: Vec<Vec2> = others.iter().map(|j| z(*j)).collect();
        let velocities: Vec<Vec2> = others.iter().map(|j| self.velocities[*j]).collect();
        let sample = Sample {
            twist: twist_for_front_velocity(0.0, ELL, self.velocities[i]),
            neighbor_vectors: &neighbor_vectors,
            neighbor_velocities: &velocities,
            error: Some(self.positions[i] - self.goals[i]),
            ..Sample::default()
        };
        let u = self.methods[i]
            .choose_velocity(&sample, gamma)
            .expect("positions and velocities are known");
        assert!(u.norm() <= self.v_max * (1.0 + 1e-9), "{u:?}");
        u
    }

    /// Returns the maximum distance of a point from its goal, m.
    pub fn goal_distance_max(&self) -> f64 {
        let error = |(position, goal): (&Vec2, &Vec2)| (position - goal).norm();
        self.positions.iter().zip(&self.goals).map(error).fold(0.0, f64::max)
    }
}

/// Returns `robots` points evenly spaced on a circle, and as goals the opposite points.
pub fn antipodal_starts_and_goals(robots: usize, radius: f64) -> [Vec<Vec2>; 2] {
    let point = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / robots as f64;
        radius * Vec2::new(angle.cos(), angle.sin())
    };
    let starts: Vec<Vec2> = (0..robots).map(point).collect();
    let goals = starts.iter().map(|start| -start).collect();
    [starts, goals]
}

/// Returns `robots` points uniformly distributed over a square of side `side`, with a minimum distance of
/// `distance_min`.
pub fn draw_separated_points(
    random: &mut SplitMix64,
    robots: usize,
    side: f64,
    distance_min: f64,
) -> Vec<Vec2> {
    let mut points: Vec<Vec2> = Vec::new();
    while points.len() < robots {
        let point = side * Vec2::new(random.draw_unit() - 0.5, random.draw_unit() - 0.5);
        if points.iter().all(|other| (point - other).norm() >= distance_min) {
            points.push(point);
        }
    }
    points
}
