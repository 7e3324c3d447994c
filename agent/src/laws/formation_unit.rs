//! Formation at constant speed: every robot drives at mu straight towards its desired position. (18)
//!
//! gamma = -mu e / |e|, and 0 for e = 0. Sampled literally it would overshoot and chatter around e = 0. Inside
//! the boundary layer |e| < 5 mu T (1 + a) it is therefore linear in e (an addition to the chapter).

use formation::Vec2;

use super::{FORMATION, Gains, Law, LawRow, Situation};

pub(super) const ROW: LawRow = LawRow {
    name: "formation-unit",
    role: FORMATION,
    source: "(18)",
    gains: &["speed_m_s"], // mu
    feed_forward: false,
    correction_max: Some("speed_m_s"),
    message: None,
    withholds: false,
    signals: &[],
    build: |gains: &Gains<'_>| Box::new(FormationUnit { mu: gains.get("speed_m_s") }),
};

struct FormationUnit {
    /// Constant speed of all robots, m/s (mu in the chapter).
    mu: f64,
}

impl Law for FormationUnit {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        compute_constant_speed(self.mu, situation)
    }
}

/// Returns -mu e / |e|, m/s, linear in e inside the boundary layer.
pub(super) fn compute_constant_speed(mu: f64, situation: &Situation<'_>) -> Vec2 {
    let &Situation { error: e, period_s, age_periods, .. } = situation;
    let layer = 5.0 * mu * period_s * (1.0 + age_periods);
    -mu * e / e.norm().max(layer) // (18)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gamma(error: Vec2) -> Vec2 {
        FormationUnit { mu: 0.1 }.gamma(&Situation { error, ..Situation::ALONE })
    }

    #[test]
    fn gamma_far_from_target_has_speed_mu_towards_it() {
        assert!((gamma(Vec2::new(3.0, 4.0)) - Vec2::new(-0.06, -0.08)).norm() < 1e-15);
    }

    #[test]
    fn gamma_in_boundary_layer_is_linear_and_continuous() {
        let layer = 0.005; // 5 mu T (1 + a)
        assert!((gamma(Vec2::new(layer / 2.0, 0.0)).x + 0.05).abs() < 1e-15);
        assert!((gamma(Vec2::new(layer, 0.0)).x + 0.1).abs() < 1e-15);
        assert_eq!(gamma(Vec2::zeros()), Vec2::zeros());
    }
}
