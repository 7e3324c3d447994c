//! To a goal with bounded effort. (28) with a place that stands
//!
//! gamma = -k_g tanh(e).

use formation::Vec2;

use super::{GOAL, Gains, Law, LawRow, Situation, tanh};

pub(super) const ROW: LawRow = LawRow {
    name: "goal-tanh",
    role: GOAL,
    source: "(28), of a goal",
    gains: &["k_g_m_s"],
    feed_forward: false,
    correction_max: Some("k_g_m_s"),
    build: |gains: &Gains<'_>| Box::new(GoalTanh { k_g: gains.get("k_g_m_s") }),
};

struct GoalTanh {
    /// Largest speed along each axis, m/s.
    k_g: f64,
}

impl Law for GoalTanh {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        -self.k_g * tanh(situation.error) // (28)
    }
}
