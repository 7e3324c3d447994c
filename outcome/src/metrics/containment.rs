//! Containment error (49): distance of the followers from the leaders' convex hull over the last part of the run.

use formation::Vec2;
use formation::hull::hull_distance;

use crate::metrics::finals::{FinalWindow, WindowMaximum};
use crate::metrics::silence::SilenceState;
use experiment::scenario::Scenario;

/// Largest distance of a follower from the leaders' convex hull.
pub(super) struct Containment {
    /// Leaders whose convex hull the followers must be in.
    leaders: Vec<usize>,
    followers: Vec<usize>,
    corners: Vec<Vec2>,
    /// Largest distance from the hull, m.
    hull_distance_m_max: WindowMaximum,
    window: FinalWindow,
}

impl Containment {
    /// Creates the metric before the first sample. `window` selects the samples that count.
    pub(super) fn new(scenario: &Scenario, window: FinalWindow) -> Containment {
        Containment {
            leaders: scenario.leaders(),
            followers: scenario.contained_robots(),
            corners: Vec::new(),
            hull_distance_m_max: WindowMaximum::new(window),
            window,
        }
    }

    /// Updates the metric with one sample. A follower that takes over a leader's slot counts as a corner of the
    /// hull.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        alphas: &[Vec2],
        alive: &[bool],
        silence: &SilenceState,
    ) {
        if t_ns < self.window.start_ns(t_ns) || self.followers.is_empty() {
            return;
        }
        self.corners.clear();
        self.corners.extend(self.leaders.iter().map(|&i| alphas[i]));
        let alive_followers = self.followers.iter().filter(|&&i| alive[i]);
        let (leader_substitutes, contained): (Vec<&usize>, Vec<&usize>) =
            alive_followers.partition(|&&i| silence.takes_leader_slot(i));
        self.corners.extend(leader_substitutes.into_iter().map(|&i| alphas[i]));
        let distances_m = contained.into_iter().map(|&i| hull_distance(alphas[i], &self.corners));
        if let Some(distance_m) = distances_m.reduce(f64::max) {
            self.hull_distance_m_max.push(t_ns, distance_m);
        }
    }

    /// Returns the largest distance of a living follower from the hull, m; `None` without a living follower.
    pub(super) fn final_distance_m_max(&self, end_ns: u64) -> Option<f64> {
        self.hull_distance_m_max.value_at_end(end_ns)
    }
}
