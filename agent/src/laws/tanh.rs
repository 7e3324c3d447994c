//! Control laws with bounded effort: gamma = -k tanh(e) + alpha*'. (28) (51)
//!
//! A leader tracks m(t) (28), a formation robot keeps its slot in a time-varying formation (28), and a follower
//! moves into the convex hull of its in-neighbors, with alpha* by (46) (51). A goal is fixed and has no
//! alpha*'.

use formation::Vec2;
use protocol::law::LIARS_MAX;

use super::{CONTAINED, FORMATION, GOAL, Gains, LEADER, Law, LawRow, RoleRow, Situation, tanh};

pub(super) const LEADER_TANH: LawRow = row("leader-tanh", LEADER, "(28)", &["k_m_m_s"], |gains| {
    new_saturated_law(gains.get("k_m_m_s"))
});

pub(super) const FORMATION_TANH: LawRow =
    row("formation-tanh", FORMATION, "(28)", &["k_f_m_s"], |gains| {
        new_saturated_law(gains.get("k_f_m_s"))
    });

/// Law of the W-MSR role, which additionally uses the gain `liars_max` (F), the number of values discarded on
/// either side.
pub(super) const FORMATION_ROBUST: LawRow = LawRow {
    gains: &["k_f_m_s", LIARS_MAX],
    ..row("formation-robust", FORMATION, "(28) with W-MSR", &["k_f_m_s"], |gains| {
        new_saturated_law(gains.get("k_f_m_s"))
    })
};

pub(super) const CONTAINMENT_TANH: LawRow =
    row("containment-tanh", CONTAINED, "(51)", &["k_c_m_s"], |gains| {
        new_saturated_law(gains.get("k_c_m_s"))
    });

pub(super) const GOAL_TANH: LawRow = LawRow {
    feed_forward: false,
    ..row("goal-tanh", GOAL, "(28) with a fixed goal", &["k_g_m_s"], |gains| {
        Box::new(Tanh { k: gains.get("k_g_m_s"), feed_forward: false })
    })
};

const fn row(
    name: &'static str,
    role: RoleRow,
    source: &'static str,
    gains: &'static [&'static str; 1],
    build: fn(&Gains<'_>) -> Box<dyn Law>,
) -> LawRow {
    let correction_max = Some(gains[0]);
    LawRow {
        name,
        role,
        source,
        gains,
        feed_forward: true,
        correction_max,
        message: None,
        withholds: false,
        signals: &[],
        build,
    }
}

fn new_saturated_law(k: f64) -> Box<dyn Law> {
    Box::new(Tanh { k, feed_forward: true })
}

struct Tanh {
    /// Maximum correction along each axis, m/s (k in the chapter).
    k: f64,
    /// `true` if alpha*' is added.
    feed_forward: bool,
}

impl Law for Tanh {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let correction = -self.k * tanh(situation.error);
        match self.feed_forward {
            true => correction + situation.desired_velocity, // (28) (51)
            false => correction,
        }
    }
}
