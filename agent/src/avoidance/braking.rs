//! Effect of inertia on the guard (safety filter): the rate Lambda, the factor mu, and the zone in which robots
//! slow down. An addition to the chapter: `docs/explanation/inertia.md`.

use protocol::avoidance::Conditions;

use formation::drive::Drive;
use formation::portable_math;

/// Braking terms of a certificate. Tests disable single terms to show that each is needed.
#[derive(Debug, Clone, Copy)]
pub struct Braking {
    /// Time for which a command's motion continues after the command has expired, in multiples of tau_o.
    pub path_factor: f64,
    /// Time for which the heading turns at the full rate after the command has expired, in multiples of tau_o.
    pub turn_factor: f64,
    /// Fraction of the range of possible headings that the cones cover.
    pub range: f64,
    /// The factor mu as a function of 2 Lambda tau_o.
    pub mu: fn(f64) -> f64,
}

impl Braking {
    /// Returns the terms that the proof uses: `proof/Braking.v::swept`, `proof/Braking.v::turning_time`. A turn rate that
    /// decreases with the speed of a front point counts half; at the axle midpoint it need not decrease.
    pub fn new(drive: Drive) -> Self {
        Braking {
            path_factor: 1.0,
            turn_factor: if drive.turns_freely() { 1.0 } else { 0.5 },
            range: 1.0,
            mu,
        }
    }
}

/// Returns the factor mu, at most 1, by which the permitted approach speed is reduced because braking takes
/// time: `proof/Inertia.v::mu`, `proof/Inertia.v::braking_keeps_up`.
pub fn mu(x: f64) -> f64 {
    if x <= 1.0 { 1.0 } else { x * portable_math::exp(1.0 - x) }
}

/// Returns the rate Lambda, 1/s: `proof/Braking.v::braking_rate`.
pub fn rate_per_s(at: &Conditions<'_>) -> f64 {
    1.0 / (at.lifetime_s + at.avoidance.braking_time_max_s)
}

/// Returns the width Z of the slow-down zone, m. At a distance of d + Z or more, a robot with the maximum
/// braking time is not restricted: `proof/Braking.v::far_braking`, `proof/Braking.v::far_is_far_enough`.
/// Without inertia it is 3 v_max H: `proof/Guard.v::far`, `proof/Walls.v::far_wall`.
pub fn slow_down_zone_m(at: &Conditions<'_>) -> f64 {
    let (rate, tau) = (rate_per_s(at), at.avoidance.braking_time_max_s);
    let less = mu(2.0 * rate * tau);
    let lasting = 2.0 * rate * at.lifetime_s;
    at.speed_m_s() / (rate * less) * portable_math::exp(lasting).min(1.0 + lasting * less)
}
