//! How the main leader goes, as far as a prediction needs it: until when, and how fast each place
//! in the formation is meanwhile.

use formation::Vec2;
use formation::desired::Target;
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
    /// At each look: m, m, and m', m/s, and the frame.
    looks: Vec<(Target, LeaderFrame)>,
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
        let looks: Vec<_> = course.map(|(_, target, frame)| (target, frame)).collect();
        let (last, last_frame) = looks[LOOKS];
        let moving = looks.iter().rposition(|(target, frame)| {
            (target.position - last.position).norm() > STANDS_M
                || (frame.scale - last_frame.scale).abs() > STANDS_M
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
        let speed = |(target, frame): &(Target, LeaderFrame)| {
            (target.velocity + frame.offset(planned).velocity).norm()
        };
        match t_s {
            Some(t_s) => speed(&self.looks[self.look(t_s)]),
            // The leader's turn into its path at the start is not meant.
            None => self.looks[LOOKS / 10..].iter().map(speed).fold(0.0, f64::max),
        }
    }

    /// How near the place at `planned` comes from this time on to where the leader was then, m.
    pub(super) fn nears_m(&self, planned: Vec2, t_s: f64) -> f64 {
        let looks = &self.looks[self.look(t_s)..];
        let (leader, _) = looks[0];
        let place = |(target, frame): &(Target, LeaderFrame)| {
            target.position + frame.offset(planned).position
        };
        let apart_m = looks.iter().map(|look| (place(look) - leader.position).norm());
        apart_m.fold(f64::INFINITY, f64::min)
    }

    fn look(&self, t_s: f64) -> usize {
        ((t_s / self.step_s) as usize).min(LOOKS)
    }
}
