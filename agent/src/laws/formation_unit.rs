//! Formation at constant speed: every robot drives at mu straight towards its desired position. (18)
//!
//! gamma = -mu e / |e|, and 0 for e = 0. Sampled literally it would overshoot and chatter around e = 0. Inside
//! the boundary layer |e| < 5 mu T (1 + a) it is therefore linear in e (an addition to the chapter).

use formation::Vec2;

use super::{FORMATION_ROLE, Gains, Law, LawRow, Situation};

pub(super) const LAW: LawRow = LawRow {
    name: "formation-unit",
    role: FORMATION_ROLE,
    source: "(18)",
    gain_keys: &["speed_m_s"], // mu
    feed_forward: false,
    correction_max: Some("speed_m_s"),
    message_format: None,
    may_withhold_beacon: false,
    signals: &[],
    build: |gains: &Gains<'_>| Box::new(FormationUnit { speed_m_s: gains.get("speed_m_s") }),
};

struct FormationUnit {
    /// Constant speed of all robots, m/s (mu in the chapter).
    speed_m_s: f64,
}

impl Law for FormationUnit {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        constant_speed_velocity(self.speed_m_s, situation)
    }
}

/// Returns -mu e / |e|, m/s, linear in e inside the boundary layer.
pub(super) fn constant_speed_velocity(mu: f64, situation: &Situation<'_>) -> Vec2 {
    let &Situation { error: e, period_s, age_periods, .. } = situation;
    let layer = 5.0 * mu * period_s * (1.0 + age_periods);
    -mu * e / e.norm().max(layer) // (18)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nominal_velocity(error: Vec2) -> Vec2 {
        FormationUnit { speed_m_s: 0.1 }.gamma(&Situation { error, ..Situation::WITHOUT_NEIGHBORS })
    }

    #[test]
    fn gamma_far_from_target_has_speed_mu_towards_it() {
        assert!((nominal_velocity(Vec2::new(3.0, 4.0)) - Vec2::new(-0.06, -0.08)).norm() < 1e-15);
    }

    #[test]
    fn gamma_in_boundary_layer_is_linear_and_continuous() {
        let layer = 0.005; // 5 mu T (1 + a)
        assert!((nominal_velocity(Vec2::new(layer / 2.0, 0.0)).x + 0.05).abs() < 1e-15);
        assert!((nominal_velocity(Vec2::new(layer, 0.0)).x + 0.1).abs() < 1e-15);
        assert_eq!(nominal_velocity(Vec2::zeros()), Vec2::zeros());
    }
}
