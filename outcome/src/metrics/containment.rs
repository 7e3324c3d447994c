//! How far outside the leaders' convex hull the contained are towards the end. (49)

use formation::Vec2;
use formation::hull::hull_distance;

use crate::metrics::finals::{Window, Worst};
use crate::metrics::silence::Silent;
use experiment::scenario::Scenario;

/// The largest distance from the hull so far.
pub(super) struct Containment {
    /// Whose convex hull the contained are to be in.
    leaders: Vec<usize>,
    contained: Vec<usize>,
    corners: Vec<Vec2>,
    /// How far they were outside, m.
    outside_m: Worst,
    window: Window,
}

impl Containment {
    /// Nothing measured yet. `window`: what counts.
    pub(super) fn new(scenario: &Scenario, window: Window) -> Containment {
        Containment {
            leaders: scenario.leaders(),
            contained: scenario.contained(),
            corners: Vec::new(),
            outside_m: Worst::new(window),
            window,
        }
    }

    /// Takes in where everybody is now, and who lives. Whoever takes a leader's place is a corner.
    pub(super) fn truth(&mut self, t_ns: u64, alphas: &[Vec2], alive: &[bool], silent: &Silent) {
        if t_ns < self.window.begins_ns(t_ns) || self.contained.is_empty() {
            return;
        }
        self.corners.clear();
        self.corners.extend(self.leaders.iter().map(|&i| alphas[i]));
        let living = self.contained.iter().filter(|&&i| alive[i]);
        let (take_places, contained): (Vec<&usize>, Vec<&usize>) =
            living.partition(|&&i| silent.takes_place(i));
        self.corners.extend(take_places.into_iter().map(|&i| alphas[i]));
        let outside = contained.into_iter().map(|&i| hull_distance(alphas[i], &self.corners));
        if let Some(outside_m) = outside.reduce(f64::max) {
            self.outside_m.take(t_ns, outside_m);
        }
    }

    /// The largest distance of a living contained robot from the hull, m; `None` where nobody is
    /// contained, or alive.
    pub(super) fn final_m_max(&self, end_ns: u64) -> Option<f64> {
        self.outside_m.at(end_ns)
    }
}
