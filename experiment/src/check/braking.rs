//! Braking properties of a robot with inertia: braking time and distance, and maximum speed.

use formation::ns_to_seconds;
use protocol::avoidance::MethodConditions;
use protocol::brief::{AvoidanceBrief, Pace};
use serde::Serialize;

use super::bisect_largest;
use crate::scenario::Scenario;

/// Braking properties of a robot with inertia.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Braking {
    /// tau, maximum braking time from any command, s.
    pub braking_time_s: f64,
    /// Maximum commanded turn rate, rad/s: a_w tau, or w_max at the axle midpoint.
    pub turn_rate_max_rad_s: f64,
    /// Stopping distance from v_max in a straight line, command lifetime included, m.
    pub stopping_distance_m: f64,
    /// Stopping distance from the worst command, command lifetime included, m.
    pub stopping_distance_m_max: f64,
    /// Minimum sensing radius, m.
    pub sensing_radius_needed_m: f64,
    /// Maximum useful v_max, m/s. Above it the robot brakes more than it drives.
    pub speed_max_m_s: f64,
    /// Cause of the limit on v_max.
    pub limited_by: &'static str,
}

impl Braking {
    /// Returns the braking properties of robot `i`, or `None` if it has no inertia or the method does not limit speeds.
    pub fn for_robot(scenario: &Scenario, i: usize) -> Option<Braking> {
        let robot = &scenario.robots[i];
        let limits =
            robot.acceleration_limits.filter(|_| scenario.avoidance_method.clamps_speed)?;
        let avoidance = scenario.avoidance_of(i, Pace::Realtime);
        let conditions = scenario.conditions_of(i, &avoidance);
        let (v_max, lifetime_s) = (conditions.speed_max_m_s(), conditions.command_timeout_s);
        let (speed_max_m_s, limited_by) = maximum_speed_with_limit(scenario, i, &conditions);
        Some(Braking {
            braking_time_s: limits.braking_time_s,
            turn_rate_max_rad_s: match robot.drive().turns_freely() {
                true => robot.drive().turn_rate_bound(v_max),
                false => (limits.turn_acceleration_rad_s2 * limits.braking_time_s)
                    .min(robot.drive().turn_rate_bound(v_max)),
            },
            stopping_distance_m: v_max * (lifetime_s + 0.5 * v_max / limits.acceleration_m_s2),
            stopping_distance_m_max: v_max * (lifetime_s + 0.5 * limits.braking_time_s),
            sensing_radius_needed_m: (scenario.avoidance_method.sensing_radius_m)(&conditions),
            speed_max_m_s,
            limited_by,
        })
    }
}

/// Returns the maximum useful v_max of a robot, m/s, and the cause of the limit.
fn maximum_speed_with_limit(
    scenario: &Scenario,
    i: usize,
    conditions: &MethodConditions<'_>,
) -> (f64, &'static str) {
    let (d, avoidance) = (conditions.avoidance.distance_min_m, conditions.avoidance);
    let mut limits = vec![(0.25 * d / conditions.command_timeout_s, "d/4 per command lifetime")];
    if conditions.front_point_m > 0.0 {
        let ell_m = conditions.front_point_m;
        limits.push((0.5 * ell_m / conditions.command_timeout_s, "ell/2 per command lifetime"));
        limits.push((ell_m / ns_to_seconds(scenario.period_ns), "ell per period"));
    }
    if let Some(wheels) = scenario.robots[i].wheels {
        limits.push((wheels.speed_max_m_s, "its wheels"));
    }
    let radius_m = scenario.avoidance.sensing_radius_m;
    // The braking time grows with v_max, and the radius with both.
    let needed_m = |speed_max_m_s: f64| {
        let fraction = speed_max_m_s / avoidance.speed_max_m_s;
        let braking_time_max_s = fraction * avoidance.braking_time_max_s;
        let avoidance = AvoidanceBrief { speed_max_m_s, braking_time_max_s, ..avoidance.clone() };
        (scenario.avoidance_method.sensing_radius_m)(&MethodConditions {
            avoidance: &avoidance,
            ..*conditions
        })
    };
    let smallest_limit = limits.iter().map(|limit| limit.0).fold(f64::INFINITY, f64::min);
    if needed_m(smallest_limit) > radius_m {
        let fits = |speed_max_m_s| needed_m(speed_max_m_s) <= radius_m;
        limits.push((bisect_largest(smallest_limit, fits), "the sensing radius"));
    }
    { limits }.into_iter().fold((f64::INFINITY, ""), |a, b| if b.0 < a.0 { b } else { a })
}
