//! Effect of inertia on the guard (safety filter): the rate Lambda, the factor mu, and the zone in which robots
//! slow down. An addition to the chapter: `docs/explanation/inertia.md`.

use protocol::avoidance::MethodConditions;

use formation::drive::Drive;
use formation::portable_math;

/// Braking terms of a certificate. Tests disable single terms to show that each is needed.
#[derive(Debug, Clone, Copy)]
pub struct BrakingTerms {
    /// Time for which a command's motion continues after the command has expired, in multiples of tau_o.
    pub path_factor: f64,
    /// Time for which the heading turns at the full rate after the command has expired, in multiples of tau_o.
    pub turn_factor: f64,
    /// Fraction of the range of possible headings that the cones cover.
    pub heading_range_fraction: f64,
    /// The factor mu as a function of 2 Lambda tau_o.
    pub approach_speed_factor: fn(f64) -> f64,
}

impl BrakingTerms {
    /// Returns the terms that the proof uses: `proof/Braking.v::swept`, `proof/Braking.v::turning_time`. A turn rate
    /// that decreases with the speed of a front point counts half; at the axle midpoint it need not decrease.
    pub fn new(drive: Drive) -> Self {
        BrakingTerms {
            path_factor: 1.0,
            turn_factor: if drive.turns_freely() { 1.0 } else { 0.5 },
            heading_range_fraction: 1.0,
            approach_speed_factor,
        }
    }
}

/// Returns the factor mu, at most 1, by which the permitted approach speed is reduced because braking takes
/// time: `proof/Inertia.v::mu`, `proof/Inertia.v::braking_keeps_up`.
pub fn approach_speed_factor(x: f64) -> f64 {
    if x <= 1.0 { 1.0 } else { x * portable_math::exp(1.0 - x) }
}

/// Returns the rate Lambda, 1/s: `proof/Braking.v::braking_rate`. It is the same for all robots of a team: that of the
/// longest command timeout and the longest braking time (`proof/Team.v::a_team_keeps_its_distances`).
pub fn slack_decrease_rate_per_s(conditions: &MethodConditions<'_>) -> f64 {
    1.0 / (conditions.team_command_timeout_max_s() + conditions.avoidance.braking_time_max_s)
}

/// Returns the width Z of the slow-down zone, m. At a distance of d + Z or more, a robot with the maximum
/// braking time is not restricted: `proof/Braking.v::far_braking`, `proof/Braking.v::far_is_far_enough`.
/// Without inertia it is 3 v_max H: `proof/Guard.v::far`, `proof/Walls.v::far_wall`.
pub fn slow_down_zone_m(conditions: &MethodConditions<'_>) -> f64 {
    let (rate, tau) =
        (slack_decrease_rate_per_s(conditions), conditions.avoidance.braking_time_max_s);
    let speed_factor = approach_speed_factor(2.0 * rate * tau);
    let exponent = 2.0 * rate * conditions.command_timeout_s;
    // Mean of the speed limits of both robots, as a fraction of the own one. It is 1 if they are equal, and next to
    // walls.
    let speed_ratio =
        (0.5 * (1.0 + conditions.others_speed_max_m_s() / conditions.speed_max_m_s())).max(1.0);
    conditions.speed_max_m_s() / (rate * speed_factor)
        * portable_math::exp(exponent).min(1.0 + exponent * speed_factor * speed_ratio)
}
