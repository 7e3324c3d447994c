//! Motion of the main leader for predictions: when it moves, and the speed of each slot.

use formation::Vec2;
use formation::desired::Target;
use formation::frame::LeaderFrame;
use formation::ns_to_seconds;

use crate::check::leader_motion_samples;
use crate::scenario::Scenario;

/// Number of intervals in which the trajectory is sampled.
const SAMPLE_INTERVALS: usize = 1000;
/// Maximum displacement of a leader that counts as at rest, m.
const AT_REST_DISPLACEMENT_M_MAX: f64 = 1e-6;

/// Sampled motion of the main leader on its trajectory.
#[derive(Debug, Clone)]
pub(super) struct LeaderMotion {
    step_s: f64,
    /// Samples: m, m, m', m/s, and the leader's frame.
    samples: Vec<(Target, LeaderFrame)>,
    /// Index of the first sample at which it is at rest.
    first_at_rest_index: usize,
}

impl LeaderMotion {
    /// Samples the motion, or returns `None` without a leader.
    pub(super) fn from_scenario(scenario: &Scenario) -> Option<LeaderMotion> {
        let leader = scenario.leader()?;
        let step_s = ns_to_seconds(scenario.duration_ns) / SAMPLE_INTERVALS as f64;
        let start_rad = scenario.robots[leader].start.heading_rad;
        let motion = leader_motion_samples(scenario, start_rad, step_s, SAMPLE_INTERVALS)?;
        let samples: Vec<_> = motion.map(|(_, target, frame)| (target, frame)).collect();
        let (last, last_frame) = samples[SAMPLE_INTERVALS];
        let moving = samples.iter().rposition(|(target, frame)| {
            (target.position - last.position).norm() > AT_REST_DISPLACEMENT_M_MAX
                || (frame.scale - last_frame.scale).abs() > AT_REST_DISPLACEMENT_M_MAX
        });
        Some(LeaderMotion {
            step_s,
            samples,
            first_at_rest_index: moving.map_or(0, |sample| sample + 1),
        })
    }

    /// Returns whether the leader still moves at `t_s`, s; with `None`, whether it ever moves.
    pub(super) fn is_moving(&self, t_s: Option<f64>) -> bool {
        t_s.map_or(0, |t_s| self.sample_index(t_s)) < self.first_at_rest_index
    }

    /// Returns the speed of the slot at `planned` (heading 0, scale 1) at `t_s`, m/s; with `None`, its maximum.
    pub(super) fn slot_speed_m_s(&self, planned: Vec2, t_s: Option<f64>) -> f64 {
        let speed = |(target, frame): &(Target, LeaderFrame)| {
            (target.velocity + frame.transform_offset(planned).velocity).norm()
        };
        match t_s {
            Some(t_s) => speed(&self.samples[self.sample_index(t_s)]),
            // Excludes the initial turn of the leader into its path.
            None => self.samples[SAMPLE_INTERVALS / 10..].iter().map(speed).fold(0.0, f64::max),
        }
    }

    /// Returns the smallest distance of the slot at `planned`, from `t_s` on, to the position of the leader at `t_s`,
    /// m.
    pub(super) fn leader_distance_min_m(&self, planned: Vec2, t_s: f64) -> f64 {
        let samples = &self.samples[self.sample_index(t_s)..];
        let (leader, _) = samples[0];
        let position = |(target, frame): &(Target, LeaderFrame)| {
            target.position + frame.transform_offset(planned).position
        };
        let distances_m = samples.iter().map(|sample| (position(sample) - leader.position).norm());
        distances_m.fold(f64::INFINITY, f64::min)
    }

    fn sample_index(&self, t_s: f64) -> usize {
        ((t_s / self.step_s) as usize).min(SAMPLE_INTERVALS)
    }
}
