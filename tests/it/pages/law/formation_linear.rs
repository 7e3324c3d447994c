//! Formation with a linear law, saturated. (16)

use formation::Vec2;

use super::{FORMATION_ROLE, Gains, Law, LawRow, Situation};

pub(super) const LAW: LawRow = LawRow {
    name: "formation-linear",
    role: FORMATION_ROLE,
    source: "(16)",
    gain_keys: &["k_per_s", "limit_m_s"],
    feed_forward: false,
    correction_max: Some("limit_m_s"),
    message_format: None,
    may_withhold_beacon: false,
    signals: &[],
    build: |gains: &Gains<'_>| {
        Box::new(FormationLinear { k: gains.get("k_per_s"), limit: gains.get("limit_m_s") })
    },
};

struct FormationLinear {
    k: f64,
    limit: f64,
}

impl Law for FormationLinear {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        (-self.k * situation.error).cap_magnitude(self.limit) // (16)
    }
}
