//! The frame that the formation turns and grows with: the main leader's, with the heading that it
//! would have if nothing but m(t) had ever turned it.
//!
//! Avoidance, the way back to its path and noise turn the leader, and must not turn the formation.
//! So the heading is not read off the leader's pose: it is the one that m'(t) draws it to, from the
//! heading at its start (17). While the leader is on its path, the two are the same.

use formation::frame::LeaderFrame;
use formation::front_point::{drawing_velocity, drawn_heading};
use formation::scale::Scale;
use formation::seconds;
use protocol::brief::LeadBrief;
use protocol::message::TruthRow;

use experiment::scenario::Scenario;

/// The frame of the ideal formation.
pub(super) enum IdealFrame {
    /// Somebody leads.
    Led(Box<Led>),
    /// Nobody does: offsets do not turn, and grow by this scale, if there is one.
    Unled(Option<Scale>),
}

impl IdealFrame {
    /// Nothing seen yet.
    pub(super) fn new(scenario: &Scenario) -> IdealFrame {
        match Led::new(scenario) {
            Some(led) => IdealFrame::Led(Box::new(led)),
            None => IdealFrame::Unled(scenario.unled_scale.clone()),
        }
    }

    /// The frame at a truth, by who was alive at it.
    pub(super) fn truth(&mut self, t_ns: u64, rows: &[TruthRow], alive: &[bool]) -> LeaderFrame {
        self.at(seconds(t_ns), |i| rows[i].heading_rad, |i| alive[i])
    }

    /// The frame at the truth of this time, by everybody's true heading, and whether it was alive.
    pub(super) fn at(
        &mut self,
        t_s: f64,
        heading_rad: impl Fn(usize) -> f64,
        alive: impl Fn(usize) -> bool,
    ) -> LeaderFrame {
        match self {
            IdealFrame::Led(led) => {
                let alive = led.lead_it.iter().any(|&i| alive(i));
                led.at(t_s, heading_rad(led.leader), alive)
            }
            IdealFrame::Unled(Some(scale)) => LeaderFrame::leaderless(scale, t_s),
            IdealFrame::Unled(None) => LeaderFrame::STILL,
        }
    }
}

/// The frame of a main leader.
pub(super) struct Led {
    leader: usize,
    /// It, and its deputies, who continue its frame.
    lead_it: Vec<usize>,
    lead: LeadBrief,
    /// ell, m.
    front_point_m: f64,
    /// Bound on its velocity, m/s; infinite where nothing limits it.
    speed_max_m_s: f64,
    period_s: f64,
    /// At the newest truth at which the leader lived.
    newest: Option<Moment>,
    lived: bool,
}

/// The leader at one truth.
#[derive(Debug, Clone, Copy)]
struct Moment {
    t_s: f64,
    /// Of the frame.
    heading_rad: f64,
}

impl Led {
    /// `None` without a main leader.
    fn new(scenario: &Scenario) -> Option<Led> {
        let leader = scenario.leader()?;
        let robot = &scenario.robots[leader];
        let speed_max_m_s = match scenario.method.clamps_speed {
            true => scenario.avoidance.speed_max_m_s,
            false => f64::INFINITY,
        };
        Some(Led {
            leader,
            lead_it: [&[leader], &scenario.deputies[..]].concat(),
            lead: scenario.lead.clone()?,
            front_point_m: robot.front_point_m,
            speed_max_m_s,
            period_s: seconds(scenario.period_ns),
            newest: None,
            lived: false,
        })
    }

    /// The frame at the truth of this time, by the leader's true heading, and whether it or a deputy
    /// lives. A dead leader's frame stays as it was when the last of them died; whoever replaces it begins
    /// with the true heading.
    fn at(&mut self, t_s: f64, heading_rad: f64, alive: bool) -> LeaderFrame {
        let lived = std::mem::replace(&mut self.lived, alive);
        let begins = alive && !lived;
        if alive || self.newest.is_none() {
            let drawn = self.newest.filter(|_| !begins).map(|newest| self.drawn(newest, t_s));
            let heading_rad = drawn.unwrap_or(heading_rad);
            self.newest = Some(Moment { t_s, heading_rad });
        }
        let Moment { t_s, heading_rad, .. } = self.newest.expect("it was just set");
        LeaderFrame {
            heading_rad,
            scale: self.lead.scale.value_and_rate_at(t_s).0,
            ..LeaderFrame::STILL
        }
    }

    /// The heading at `t_s`, in steps of a period at most: truths may be lost.
    fn drawn(&self, from: Moment, t_s: f64) -> f64 {
        let steps = ((t_s - from.t_s) / self.period_s - 1e-6).ceil().max(1.0);
        let step_s = (t_s - from.t_s) / steps;
        let (mut heading_rad, mut was) =
            (from.heading_rad, self.lead.trajectory.target_at(from.t_s).position);
        for step in 1..=steps as u64 {
            let next = self.lead.trajectory.target_at(from.t_s + step as f64 * step_s).position;
            let velocity = (next - std::mem::replace(&mut was, next)) / step_s;
            let speed_m_s = velocity.norm();
            let limited = match speed_m_s > self.speed_max_m_s {
                true => velocity * (self.speed_max_m_s / speed_m_s),
                false => velocity,
            };
            let drawing = drawing_velocity(heading_rad, limited, self.lead.keep_heading);
            heading_rad = drawn_heading(heading_rad, self.front_point_m, drawing, step_s);
        }
        heading_rad
    }
}
