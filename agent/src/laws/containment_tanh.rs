//! Containment: into the convex hull of those heard, with bounded effort. (51)
//!
//! gamma = -k_c tanh(e) + alpha*', with alpha* by (46).

use formation::Vec2;

use super::{CONTAINED, Gains, Law, LawRow, Situation, tanh};

pub(super) const ROW: LawRow = LawRow {
    name: "containment-tanh",
    role: CONTAINED,
    source: "(51)",
    gains: &["k_c_m_s"],
    feed_forward: true,
    correction_max: Some("k_c_m_s"),
    build: |gains: &Gains<'_>| Box::new(ContainmentTanh { k_c: gains.get("k_c_m_s") }),
};

struct ContainmentTanh {
    /// Largest correction along each axis, m/s. In paper.
    k_c: f64,
}

impl Law for ContainmentTanh {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        -self.k_c * tanh(situation.error) + situation.desired_velocity // (51)
    }
}
