//! What inertia does to the guard's figures: the rate Lambda, the factor mu, the zone in which robots slow
//! down. Not in the paper: `docs/explanation/inertia.md`.

use protocol::avoidance::Conditions;

use formation::real;

/// What braking adds to a certificate. Tests leave parts of it out, to show that each is needed.
#[derive(Debug, Clone, Copy)]
pub struct Braking {
    /// For how long after its lifetime a command's way goes on, in tau_o.
    pub way: f64,
    /// For how long after it the heading turns, at the full rate, in tau_o.
    pub turn: f64,
    /// mu.
    pub mu: fn(f64) -> f64,
}

impl Default for Braking {
    /// `proof/Braking.v::swept`, `proof/Braking.v::turning_time`.
    fn default() -> Self {
        Braking { way: 1.0, turn: 0.5, mu }
    }
}

/// mu: how much less may be granted because braking takes time: `proof/Inertia.v::mu`,
/// `proof/Inertia.v::braking_keeps_up`.
pub fn mu(x: f64) -> f64 {
    if x <= 1.0 { 1.0 } else { x * real::exp(1.0 - x) }
}

/// Lambda, 1/s: `proof/Braking.v::braking_rate`.
pub fn rate_per_s(at: &Conditions<'_>) -> f64 {
    1.0 / (at.lifetime_s + at.avoidance.braking_time_max_s)
}

/// Z, m: from d + Z on, a robot of the largest braking time may do as it likes:
/// `proof/Braking.v::far_braking`, `proof/Braking.v::far_is_far_enough`; without inertia 3 v_max H:
/// `proof/Guard.v::far`, `proof/Walls.v::far_wall`.
pub fn slow_down_zone_m(at: &Conditions<'_>) -> f64 {
    let (rate, tau) = (rate_per_s(at), at.avoidance.braking_time_max_s);
    let less = mu(2.0 * rate * tau);
    let lasting = 2.0 * rate * at.lifetime_s;
    at.speed_m_s() / (rate * less) * real::exp(lasting).min(1.0 + lasting * less)
}
