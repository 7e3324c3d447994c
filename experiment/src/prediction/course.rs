//! How the main leader goes, as far as a prediction needs it: until when, and how fast each place
//! in the formation is meanwhile.

use formation::Vec2;
use formation::frame::LeaderFrame;
use formation::seconds;

use crate::check::leader_course;
use crate::scenario::Scenario;

/// Instants at which a trajectory is looked at.
const LOOKS: usize = 1000;
/// A leader that moves less than this, m, stands.
const STANDS_M: f64 = 1e-6;

/// The main leader on its trajectory.
#[derive(Debug, Clone)]
pub(super) struct Course {
    step_s: f64,
    /// At each look: m', m/s, and the frame.
    looks: Vec<(Vec2, LeaderFrame)>,
    /// From this look on it stands.
    stands_from: usize,
}

impl Course {
    /// `None` where nobody leads.
    pub(super) fn of(scenario: &Scenario) -> Option<Course> {
        let leader = scenario.leader()?;
        let step_s = seconds(scenario.duration_ns) / LOOKS as f64;
        let start_rad = scenario.robots[leader].start.heading_rad;
        let course = leader_course(scenario, start_rad, step_s, LOOKS)?;
        let (looks, places): (Vec<_>, Vec<_>) = course
            .map(|(_, target, frame)| ((target.velocity, frame), (target.position, frame.scale)))
            .unzip();
        let (last, last_scale) = places[LOOKS];
        let moving = places.iter().rposition(|(place, scale)| {
            (place - last).norm() > STANDS_M || (scale - last_scale).abs() > STANDS_M
        });
        Some(Course { step_s, looks, stands_from: moving.map_or(0, |look| look + 1) })
    }

    /// Whether it still moves at this time, s; without a time, whether it ever does.
    pub(super) fn moves(&self, t_s: Option<f64>) -> bool {
        t_s.map_or(0, |t_s| self.look(t_s)) < self.stands_from
    }

    /// How fast the place at `planned` (heading 0, scale 1) moves at this time, m/s; without a
    /// time, the fastest.
    pub(super) fn speed_m_s(&self, planned: Vec2, t_s: Option<f64>) -> f64 {
        let speed = |(velocity, frame): &(Vec2, LeaderFrame)| {
            (velocity + frame.offset(planned).velocity).norm()
        };
        match t_s {
            Some(t_s) => speed(&self.looks[self.look(t_s)]),
            // The leader's turn into its path at the start is not meant.
            None => self.looks[LOOKS / 10..].iter().map(speed).fold(0.0, f64::max),
        }
    }

    fn look(&self, t_s: f64) -> usize {
        ((t_s / self.step_s) as usize).min(LOOKS)
    }
}
