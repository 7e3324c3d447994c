//! Straight motion to a goal at constant speed: (18) with a fixed desired position.
//!
//! gamma = -mu e / |e|, linear in the boundary layer of `formation-unit`.

use formation::Vec2;

use super::formation_unit::constant_speed_velocity;
use super::{GOAL_ROLE, Gains, Law, LawRow, Situation};

pub(super) const LAW: LawRow = LawRow {
    name: "goal-unit",
    role: GOAL_ROLE,
    source: "(18) with a fixed goal",
    gain_keys: &["speed_m_s"], // mu
    feed_forward: false,
    correction_max: Some("speed_m_s"),
    message_format: None,
    may_withhold_beacon: false,
    signals: &[],
    build: |gains: &Gains<'_>| Box::new(GoalUnit { speed_m_s: gains.get("speed_m_s") }),
};

struct GoalUnit {
    /// Constant speed, m/s (mu in the chapter).
    speed_m_s: f64,
}

impl Law for GoalUnit {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        constant_speed_velocity(self.speed_m_s, situation) // (18)
    }
}
