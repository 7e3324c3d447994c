//! How far outside the leaders' convex hull the contained are towards the end. (49)

use formation::Vec2;
use formation::hull::hull_distance;

use experiment::scenario::Scenario;

/// The largest distance from the hull so far.
pub(super) struct Containment {
    /// Whose convex hull the contained are to be in.
    leaders: Vec<usize>,
    contained: Vec<usize>,
    final_from_ns: u64,
    corners: Vec<Vec2>,
    final_m_max: Option<f64>,
}

impl Containment {
    /// Nothing measured yet. `final_from_ns`: from then on it counts.
    pub(super) fn new(scenario: &Scenario, final_from_ns: u64) -> Containment {
        Containment {
            leaders: scenario.leaders(),
            contained: scenario.contained(),
            final_from_ns,
            corners: Vec::new(),
            final_m_max: None,
        }
    }

    /// Takes in where everybody is now, and who lives.
    pub(super) fn truth(&mut self, t_ns: u64, alphas: &[Vec2], alive: &[bool]) {
        if t_ns < self.final_from_ns || self.contained.is_empty() {
            return;
        }
        self.corners.clear();
        self.corners.extend(self.leaders.iter().map(|&i| alphas[i]));
        let living = self.contained.iter().filter(|&&i| alive[i]);
        let outside = living.map(|&i| hull_distance(alphas[i], &self.corners));
        self.final_m_max = outside.chain(self.final_m_max).reduce(f64::max);
    }

    /// The largest distance of a living contained robot from the hull, m; `None` where nobody is
    /// contained, or alive.
    pub(super) fn final_m_max(&self) -> Option<f64> {
        self.final_m_max
    }
}
