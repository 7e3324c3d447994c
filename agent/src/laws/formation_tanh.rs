//! Time-varying formation with bounded effort and velocity feed-forward. (28) (51)
//!
//! gamma = -k_f tanh(e) + alpha*'.

use formation::Vec2;

use super::{FORMATION, Gains, Law, LawRow, Situation, tanh};

pub(super) const ROW: LawRow = LawRow {
    name: "formation-tanh",
    role: FORMATION,
    source: "(28)",
    gains: &["k_f_m_s"],
    feed_forward: true,
    correction_max: Some("k_f_m_s"),
    build: |gains: &Gains<'_>| Box::new(FormationTanh { k_f: gains.get("k_f_m_s") }),
};

struct FormationTanh {
    /// Largest correction along each axis, m/s. In paper.
    k_f: f64,
}

impl Law for FormationTanh {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        -self.k_f * tanh(situation.error) + situation.desired_velocity // (28)
    }
}
