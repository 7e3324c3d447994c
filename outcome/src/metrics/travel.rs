//! Arrival time and path length of each robot.

use formation::Vec2;

use experiment::scenario::Scenario;
use formation::ns_to_seconds;

/// Path lengths and arrivals up to now.
pub(super) struct Travel {
    converged_error_m: f64,
    /// Whether every robot has a goal that stays the same for all of the run.
    has_fixed_goals: bool,
    start_positions: Vec<Vec2>,
    newest_points: Vec<Vec2>,
    path_lengths_m: Vec<f64>,
    arrivals: Vec<Option<Arrival>>,
}

/// Arrival of a robot: from then on its error stays below the bound.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    /// Time of arrival, ns.
    t_ns: u64,
    /// Path length until the arrival, m.
    path_length_m: f64,
    /// Straight-line length from the start to the arrival, m.
    straight_length_m: f64,
}

impl Travel {
    /// Creates the metric before the first sample.
    pub(super) fn new(scenario: &Scenario) -> Travel {
        let robots = scenario.robots.len();
        Travel {
            converged_error_m: scenario.expectations.converged_error_m,
            has_fixed_goals: scenario.goals_m().is_some(),
            start_positions: Vec::new(),
            newest_points: Vec::new(),
            path_lengths_m: vec![0.0; robots],
            arrivals: vec![None; robots],
        }
    }

    /// Stops the computation of the path ratio, because a robot was sent to another goal.
    pub(super) fn drop_path_ratio(&mut self) {
        self.has_fixed_goals = false;
    }

    /// Updates the metric with one sample: positions, errors, m, and which robots are alive. Dead robots have not
    /// arrived.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        alphas: &[Vec2],
        errors_m: &[Option<f64>],
        alive: &[bool],
    ) {
        if self.start_positions.is_empty() {
            self.start_positions = alphas.to_vec();
            self.newest_points = alphas.to_vec();
        }
        for (i, &alpha) in alphas.iter().enumerate() {
            self.path_lengths_m[i] += (alpha - self.newest_points[i]).norm();
            self.newest_points[i] = alpha;
            let has_arrived = alive[i] && errors_m[i].is_some_and(|m| m < self.converged_error_m);
            self.arrivals[i] = match self.arrivals[i] {
                _ if !has_arrived => None,
                None => {
                    let straight_m = (alpha - self.start_positions[i]).norm();
                    Some(Arrival {
                        t_ns,
                        path_length_m: self.path_lengths_m[i],
                        straight_length_m: straight_m,
                    })
                }
                arrival => arrival,
            };
        }
    }

    /// Returns the arrival time of each robot, s.
    pub(super) fn arrival_times_s(&self) -> Vec<Option<f64>> {
        self.arrivals
            .iter()
            .map(|arrival| arrival.map(|arrival| ns_to_seconds(arrival.t_ns)))
            .collect()
    }

    /// Returns the path length of each robot until its arrival, or until the end of the run, m.
    pub(super) fn path_lengths_m(&self) -> Vec<Option<f64>> {
        let robots = self.arrivals.iter().zip(&self.path_lengths_m);
        robots
            .map(|(arrival, &total_m)| {
                Some(arrival.map_or(total_m, |arrival| arrival.path_length_m))
            })
            .collect()
    }

    /// Returns the sum of the path lengths divided by the sum of the straight-line lengths, over the robots that
    /// arrived at goals.
    pub(super) fn path_ratio(&self) -> Option<f64> {
        let sum = |length_m: fn(&Arrival) -> f64| {
            self.arrivals.iter().flatten().map(length_m).sum::<f64>()
        };
        let straight_m = sum(|arrival| arrival.straight_length_m);
        (self.has_fixed_goals && straight_m > 0.0)
            .then(|| sum(|arrival| arrival.path_length_m) / straight_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn travel_of_two_robots() -> Travel {
        Travel {
            converged_error_m: 0.1,
            has_fixed_goals: true,
            start_positions: Vec::new(),
            newest_points: Vec::new(),
            path_lengths_m: vec![0.0; 2],
            arrivals: vec![None; 2],
        }
    }

    #[test]
    fn travel_ends_when_the_error_stays_small() {
        let mut travel = travel_of_two_robots();
        // The first robot takes a detour, leaves its target and returns; the second never arrives.
        let samples =
            [(0.0, 0.0, 1.0), (0.5, 0.5, 0.7), (1.0, 0.0, 0.0), (1.0, 0.3, 0.3), (1.0, 0.0, 0.0)];
        for (second, (x, y, error)) in (0..).zip(samples) {
            let alphas = [Vec2::new(x, y), Vec2::new(0.0, 0.1 * f64::from(second))];
            let t_ns = 1_000_000_000 * u64::from(second as u8);
            travel.add_truth(t_ns, &alphas, &[Some(error), Some(2.0)], &[true, true]);
        }
        // Motion after the arrival does not count.
        let end_positions = [Vec2::new(1.05, 0.0), Vec2::new(0.0, 0.4)];
        travel.add_truth(5_000_000_000, &end_positions, &[Some(0.05), Some(1.6)], &[true, true]);
        assert_eq!(travel.arrival_times_s(), [Some(4.0), None]);
        let [Some(first), Some(second)] = travel.path_lengths_m()[..] else { panic!("two paths") };
        let expected = 2f64.sqrt() + 0.6;
        assert!(
            (first - expected).abs() < 1e-12 && (second - 0.4).abs() < 1e-12,
            "{first} {second}"
        );
        assert!((travel.path_ratio().unwrap() - expected).abs() < 1e-12);
        // A robot that dies has not arrived; without an arrival there is no ratio.
        travel.add_truth(6_000_000_000, &end_positions, &[Some(0.05), Some(1.6)], &[false, true]);
        assert_eq!((travel.arrival_times_s(), travel.path_ratio()), (vec![None; 2], None));
    }
}
