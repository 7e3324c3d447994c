//! Frame in which the ideal formation rotates and scales: the main leader's, with the heading that m(t) alone would
//! give it.
//!
//! Avoidance, the approach to the path and noise rotate the leader, and must not rotate the ideal formation. The
//! heading is therefore not read from the leader's pose: it is integrated from m'(t) and the start heading (17).
//! While the leader is on its path, both headings are equal. A leader that is controlled at its axle midpoint has the
//! heading of m'(t).

use formation::frame::LeaderFrame;
use formation::front_point::{towed_heading, towing_velocity};
use formation::ns_to_seconds;
use formation::scale::Scale;
use protocol::brief::LeadBrief;
use protocol::message::TruthRow;

use experiment::scenario::Scenario;

/// Frame of the ideal formation.
pub(super) enum IdealFrame {
    /// Frame of a formation with a main leader.
    WithLeader(Box<LeaderIdealFrame>),
    /// Frame of a leaderless formation: offsets do not rotate, and scale by this function if there is one.
    Leaderless(Option<Scale>),
}

impl IdealFrame {
    /// Creates the frame before the first sample.
    pub(super) fn new(scenario: &Scenario) -> IdealFrame {
        match LeaderIdealFrame::new(scenario) {
            Some(leader_frame) => IdealFrame::WithLeader(Box::new(leader_frame)),
            None => IdealFrame::Leaderless(scenario.leaderless_scale.clone()),
        }
    }

    /// Returns the frame at a ground-truth sample. `alive` gives which robots are alive.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        rows: &[TruthRow],
        alive: &[bool],
    ) -> LeaderFrame {
        self.frame_at(ns_to_seconds(t_ns), |i| rows[i].heading_rad, |i| alive[i])
    }

    /// Returns the frame at time `t_s`, from the true headings and the alive flags. Times must increase.
    pub(super) fn frame_at(
        &mut self,
        t_s: f64,
        heading_rad: impl Fn(usize) -> f64,
        alive: impl Fn(usize) -> bool,
    ) -> LeaderFrame {
        match self {
            IdealFrame::WithLeader(leader_frame) => {
                let alive = leader_frame.leader_and_deputies.iter().any(|&i| alive(i));
                leader_frame.frame_at(t_s, heading_rad(leader_frame.leader), alive)
            }
            IdealFrame::Leaderless(Some(scale)) => {
                LeaderFrame::for_leaderless_formation(scale, t_s)
            }
            IdealFrame::Leaderless(None) => LeaderFrame::IDENTITY,
        }
    }
}

/// Frame of a main leader.
pub(super) struct LeaderIdealFrame {
    leader: usize,
    /// Indices of the main leader and of its backup leaders (deputies), which continue the main leader's frame.
    leader_and_deputies: Vec<usize>,
    lead_brief: LeadBrief,
    /// Off-axis distance of the front point (ell), m.
    front_point_m: f64,
    /// Speed limit, m/s; infinite without a limit.
    speed_max_m_s: f64,
    period_s: f64,
    /// Frame at the newest sample at which the leader was alive.
    newest_heading: Option<HeadingSample>,
    was_alive: bool,
}

/// Heading of the frame at one sample.
#[derive(Debug, Clone, Copy)]
struct HeadingSample {
    t_s: f64,
    /// Heading of the frame, rad.
    heading_rad: f64,
}

impl LeaderIdealFrame {
    /// Creates the frame; `None` without a main leader.
    fn new(scenario: &Scenario) -> Option<LeaderIdealFrame> {
        let leader = scenario.leader()?;
        let robot = &scenario.robots[leader];
        let speed_max_m_s = match scenario.avoidance_method.clamps_speed {
            true => scenario.avoidance.speed_max_m_s,
            false => f64::INFINITY,
        };
        Some(LeaderIdealFrame {
            leader,
            leader_and_deputies: [&[leader], &scenario.repair_plan.deputies[..]].concat(),
            lead_brief: scenario.lead.clone()?,
            front_point_m: robot.front_point_m,
            speed_max_m_s,
            period_s: ns_to_seconds(scenario.period_ns),
            newest_heading: None,
            was_alive: false,
        })
    }

    /// Returns the frame at time `t_s`, from the leader's true heading. `alive` gives whether the leader or a deputy
    /// is alive. After the last of them died, the frame stays constant; a replacement begins with its true heading.
    fn frame_at(&mut self, t_s: f64, heading_rad: f64, alive: bool) -> LeaderFrame {
        let was_alive = std::mem::replace(&mut self.was_alive, alive);
        let is_replacement = alive && !was_alive;
        if alive || self.newest_heading.is_none() {
            let newest = self.newest_heading.filter(|_| !is_replacement);
            let heading_rad = match self.front_point_m > 0.0 {
                true => newest.map_or(heading_rad, |newest| self.integrate_heading(newest, t_s)),
                false => self
                    .path_heading_rad(newest.map_or(heading_rad, |newest| newest.heading_rad), t_s),
            };
            self.newest_heading = Some(HeadingSample { t_s, heading_rad });
        }
        let HeadingSample { t_s, heading_rad, .. } = self.newest_heading.expect("it was just set");
        LeaderFrame {
            heading_rad,
            scale: self.lead_brief.scale.value_and_rate_at(t_s).0,
            ..LeaderFrame::IDENTITY
        }
    }

    /// Returns the heading of m'(t) at `t_s`, rad, of a leader that is controlled at its axle midpoint. `previous_rad`
    /// counts where m(t) is at rest, and where the frame keeps its heading at a cusp.
    fn path_heading_rad(&self, previous_rad: f64, t_s: f64) -> f64 {
        let LeadBrief { trajectory, keep_heading, .. } = &self.lead_brief;
        trajectory.direction_at(t_s, self.period_s, previous_rad, *keep_heading).heading_rad
    }

    /// Returns the heading at `t_s`, integrated in steps of at most one period, because samples may be lost.
    fn integrate_heading(&self, from: HeadingSample, t_s: f64) -> f64 {
        let steps = ((t_s - from.t_s) / self.period_s - 1e-6).ceil().max(1.0);
        let step_s = (t_s - from.t_s) / steps;
        let (mut heading_rad, mut position) =
            (from.heading_rad, self.lead_brief.trajectory.target_at(from.t_s).position);
        for step in 1..=steps as u64 {
            let next_position =
                self.lead_brief.trajectory.target_at(from.t_s + step as f64 * step_s).position;
            let velocity =
                (next_position - std::mem::replace(&mut position, next_position)) / step_s;
            let speed_m_s = velocity.norm();
            let limited_velocity = match speed_m_s > self.speed_max_m_s {
                true => velocity * (self.speed_max_m_s / speed_m_s),
                false => velocity,
            };
            let towing =
                towing_velocity(heading_rad, limited_velocity, self.lead_brief.keep_heading);
            heading_rad = towed_heading(heading_rad, self.front_point_m, towing, step_s);
        }
        heading_rad
    }
}
