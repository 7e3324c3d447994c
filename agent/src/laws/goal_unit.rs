//! Straight motion to a goal at constant speed: (18) with a fixed desired position.
//!
//! gamma = -mu e / |e|, linear in the boundary layer of `formation-unit`.

use formation::Vec2;

use super::formation_unit::compute_constant_speed;
use super::{GOAL, Gains, Law, LawRow, Situation};

pub(super) const ROW: LawRow = LawRow {
    name: "goal-unit",
    role: GOAL,
    source: "(18) with a fixed goal",
    gains: &["speed_m_s"], // mu
    feed_forward: false,
    correction_max: Some("speed_m_s"),
    message: None,
    withholds: false,
    signals: &[],
    build: |gains: &Gains<'_>| Box::new(GoalUnit { mu: gains.get("speed_m_s") }),
};

struct GoalUnit {
    /// Constant speed, m/s (mu in the chapter).
    mu: f64,
}

impl Law for GoalUnit {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        compute_constant_speed(self.mu, situation) // (18)
    }
}
