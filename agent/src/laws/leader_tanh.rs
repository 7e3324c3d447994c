//! The main leader tracks m(t) with bounded effort. (28)
//!
//! gamma = -k_m tanh(alpha - m) + m'.

use formation::Vec2;

use super::{Gains, LEADER, Law, LawRow, Situation, tanh};

pub(super) const ROW: LawRow = LawRow {
    name: "leader-tanh",
    role: LEADER,
    source: "(28)",
    gains: &["k_m_m_s"],
    feed_forward: true,
    correction_max: Some("k_m_m_s"),
    build: |gains: &Gains<'_>| Box::new(LeaderTanh { k_m: gains.get("k_m_m_s") }),
};

struct LeaderTanh {
    /// Largest correction along each axis, m/s. In paper.
    k_m: f64,
}

impl Law for LeaderTanh {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        -self.k_m * tanh(situation.error) + situation.desired_velocity // (28)
    }
}
