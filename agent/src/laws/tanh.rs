//! Control laws with bounded effort: gamma = -k tanh(e) + alpha*'. (28) (51)
//!
//! A leader tracks m(t) (28), a formation robot keeps its slot in a time-varying formation (28), and a follower
//! moves into the convex hull of its in-neighbors, with alpha* by (46) (51). A goal is fixed and has no
//! alpha*'.

use formation::Vec2;
use protocol::law::LIARS_MAX_KEY;

use super::{
    CONTAINED_ROLE, FORMATION_ROLE, GOAL_ROLE, Gains, LEADER_ROLE, Law, LawRow, RoleRow, Situation,
    tanh,
};

pub(super) const LEADER_TANH: LawRow =
    tanh_row("leader-tanh", LEADER_ROLE, "(28)", &["k_m_m_s"], |gains| {
        new_tanh_law(gains.get("k_m_m_s"))
    });

pub(super) const FORMATION_TANH: LawRow =
    tanh_row("formation-tanh", FORMATION_ROLE, "(28)", &["k_f_m_s"], |gains| {
        new_tanh_law(gains.get("k_f_m_s"))
    });

/// Law of the W-MSR role, which additionally uses the gain `liars_max` (F), the number of values discarded on
/// either side.
pub(super) const FORMATION_ROBUST: LawRow = LawRow {
    gain_keys: &["k_f_m_s", LIARS_MAX_KEY],
    ..tanh_row("formation-robust", FORMATION_ROLE, "(28) with W-MSR", &["k_f_m_s"], |gains| {
        new_tanh_law(gains.get("k_f_m_s"))
    })
};

pub(super) const CONTAINMENT_TANH: LawRow =
    tanh_row("containment-tanh", CONTAINED_ROLE, "(51)", &["k_c_m_s"], |gains| {
        new_tanh_law(gains.get("k_c_m_s"))
    });

pub(super) const GOAL_TANH: LawRow = LawRow {
    feed_forward: false,
    ..tanh_row("goal-tanh", GOAL_ROLE, "(28) with a fixed goal", &["k_g_m_s"], |gains| {
        Box::new(TanhLaw { gain: gains.get("k_g_m_s"), feed_forward: false })
    })
};

const fn tanh_row(
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
        gain_keys: gains,
        feed_forward: true,
        correction_max,
        message_format: None,
        may_withhold_beacon: false,
        signals: &[],
        build,
    }
}

fn new_tanh_law(k: f64) -> Box<dyn Law> {
    Box::new(TanhLaw { gain: k, feed_forward: true })
}

struct TanhLaw {
    /// Maximum correction along each axis, m/s (k in the chapter).
    gain: f64,
    /// `true` if alpha*' is added.
    feed_forward: bool,
}

impl Law for TanhLaw {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let correction = -self.gain * tanh(situation.error);
        match self.feed_forward {
            true => correction + situation.desired_velocity, // (28) (51)
            false => correction,
        }
    }
}
