//! The guard (safety filter): no two front points closer than d, regardless of late samples, frozen or killed
//! processes, also with braking times. An addition to the chapter.
//!
//! It has two parts. *Deflect* uses the chapter's unstable focus to steer around others, only as strongly as
//! needed. It is a performance term. *Bound* restricts the command so that the robot uses up at most its half
//! of the slack to every neighbor, for as long as the plant may execute the command (the command timeout H,
//! counted from the stamp of the sample) and until the wheels are at rest. It is the guarantee. Every output of
//! *deflect*, for any yield priority, passes through the same half-planes, which depend only on d, v_max, H and
//! Lambda. The guarantee does not depend on which robot yields.
//!
//! Assumptions about the plant: P1, the target of the wheels is the newest accepted command until its stamp +
//! H, and 0 afterwards; late and old commands are refused, and no target exceeds v_max. P2, the twist y = (v,
//! ell w) moves only on the straight segment towards the target. P3, with target 0 it goes to 0 on its ray,
//! within its braking time ||y||. P4, odometry reports the twist in force at its stamp.
//!
//! Proof idea: a certificate at the sample s covers the set K = {0, the twist in force at s, own unexpired
//! commands, the new command}. None of them approaches any neighbor faster than b, for all directions and
//! headings possible until s + H + tau_o. After the newest command that moves the robot, only members of K are
//! targets, so y stays in their convex hull. The half-planes are linear in y, so y satisfies them as well. From
//! s + H on the robot brakes, and mu makes b so small that the approach decreases at least as fast as the slack
//! may: (1 - x/tau_o) mu(2 Lambda tau_o) <= e^(-2 Lambda x). Hence the robot uses up at most its half of the
//! slack at all times, and E = e^(2 Lambda t) rho never decreases. Latency, phase, freezes and deaths do not
//! enter the argument, because they only cause refusals and stops.
//!
//! If all robots stop at once, tau_o = 0, mu = 1 and Lambda = 1/H, and y jumps from target to target. Each
//! instant then belongs to one command, which was certified at its own sample. The certificate covers the new
//! command alone, and the other unexpired commands only bound how far the robot may move and turn meanwhile.
//!
//! - *Zero* needs no certificate: it only brakes earlier, on a ray on which every twist satisfies the
//!   half-planes.
//! - *Restart.* In real time, and where commands are delayed, commands of a previous incarnation may be
//!   executed for H after the first sample. They are unknown, so with inertia none can be certified, and the
//!   answer is 0 until they have expired. From then on the twist in force contains all that matters of the
//!   previous incarnation. Without inertia they count as the worst case, v_max and +-v_max/ell: stopping instead
//!   would cost H in every run. In lockstep without delays, no command of an earlier tick is unexpired at a
//!   sample.
//! - *Blind.* If the neighbors in range are not completely known, the answer is 0.
//! - *Wheels* that are too weak, failing or stuck execute a fraction of a command. The segment towards a
//!   fraction of a target is in the hull of K as well, since 0 is in K.
//! - *Sensing error eps.* The true distance is at least r - eps: rho is reduced by eps. The true z stays within
//!   M + eps of the sensed one: M and M_H are increased by eps.
//! - *Heading error eta.* The path follows from y and the targets in the robot's own frame, so a heading error
//!   rotates all of it rigidly: the true heading stays within delta + eta. The error of the own front point is at
//!   most 2 ell sin(eta/2), which is part of eps. y itself must be exact.
//! - *Walls* and obstacles do not move: the robot may use up the whole slack, so that Lambda in b becomes 2
//!   Lambda, and the speed of the other in M and M_H is 0. mu is unchanged, since E decreases at the same rate.
//!   Each convex part counts by its nearest point. The vector from it changes by at most the displacement of the
//!   robot, and the clearance takes the place of d.
//! - *Far neighbors.* From d + Z on, Z = v_max/(Lambda mu) min(e^(2 Lambda H), 1 + 2 Lambda H mu), b is at
//!   least v_max for any state of the robot. Next to a wall this holds from the clearance + Z/2 on.
//!
//! *Independent ramps.* If speed and turn rate of a robot with a front point change independently, y stays in a
//! rectangle around K instead of its convex hull; see [`independent_ramps`].
//!
//! *Axle midpoint.* With ell = 0, y = (v, 0) and the turn rate is independent of y: v and w may reach their targets
//! separately, ||y|| = |v|/a_v, and the heading may turn at the full rate until the robot is at rest. The half-planes
//! limit v alone, on the line of the heading. A command that only turns, y = 0, is a command like any other: it may
//! turn the robot while an older y is still in force, so it is in K.
//!
//! *Omnidirectional robot.* As at the axle midpoint, but y = (v, s) has any direction and moves on its own segment to
//! its target, ||y|| = hypot(v, s)/a_v, and the half-planes limit both components.
//!
//! *Car.* As at the axle midpoint, but |w| <= kappa |v|. The steering angle may change in any way, so the headings
//! possible are those of W- = -kappa v_own and W+ = kappa v_own, whatever the commands say. A slower command keeps its
//! curvature.
//!
//! The folder `proof` contains the Coq proof, for any Lambda > 0 and any accelerations. Comments name its lemma
//! where a rule is needed. Explanation: `docs/explanation/guard.md`, `inertia.md`.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n | own position minus other's, its length, its direction |
//! | y, \|y\| | (v, ell w) and the front point's speed, m/s |
//! | \|\|y\|\| | max(\|v\|/a_v, \|w\|/a_w), the braking time, s; 0 for a robot that stops at once |
//! | tau, tau_o | bound on \|\|y\|\| for all commands, and for the commands of this certificate, s |
//! | Y | twists with \|y\| <= v_max and \|\|y\|\| <= tau |
//! | Lambda | 1 / (H + maximum tau of all robots), 1/s |
//! | h | horizon: H, s, or longer for a command that has to be certified again at the next sample |
//! | eps, eta | bounds on the errors of a sensed distance, m, and of the heading, rad |
//! | rho | slack r - d, m; next to a wall r - clearance |
//! | M_H, M | maximum displacement of z until s + h, and until all robots are at rest, m |
//! | b | maximum speed at which this robot may approach another, m/s |
//! | W-, W+ | range of turn rates that may be in force, rad/s |

use std::collections::VecDeque;
use std::f64::consts::PI;

use formation::Vec2;
use formation::drive::Drive;
use formation::front_point::{Heading, front_speed, rotate};
use formation::portable_math;
use formation::pose::Twist;
use protocol::avoidance::{
    AvoidanceDescription, AvoidanceWarning, DistanceGuarantee, MethodConditions, RequiredSensing,
};
use protocol::brief::{AccelerationLimitsBrief, AgentBrief, Pace};
use protocol::number::{format_distinct, format_short};

use super::braking::{BrakingTerms, slack_decrease_rate_per_s, slow_down_zone_m};
use super::cone::{
    Cone, REQUESTED_TWIST_SCALES, ROUNDING_MARGIN_M, WIDENING_PASSES_MAX, direction,
    direction_change_max_rad, heading_range,
};
use super::deflection::{
    Deflection, STANDOFF_EXCESS_FRACTION, approach_slack_fraction, deflection_distance_m,
    look_ahead_radius_m, wall_approach_slack_fraction, wall_deflection_distance_m,
};
use super::polygon::{HalfPlane, nearest_point, scale_factor_on_ray};
use super::steering::Steering;
use super::vicinity::VicinityParameters;
use super::{Avoidance, AvoidanceRow, Sample, clip};

/// Factor that keeps commands strictly within their bounds despite rounding.
const STRICT_BOUND_FACTOR: f64 = 1.0 - 1e-12;

pub(super) const METHOD: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "guard",
        source: "not in the chapter",
        distance_guarantee: DistanceGuarantee::Unconditional,
        guarantee_text: "d and the clearance, despite late samples, frozen or killed processes and lost messages",
        assumptions_text: "every robot uses it, senses all neighbors in range within known errors, and its wheels do no more \
                  than commanded",
        clamps_speed: true,
        required_sensing: RequiredSensing::Positions,
        needs_front_point: false,
        avoids_walls: true,
        sensing_radius_m,
        useful_radius_m: Some(look_ahead_radius_m),
        steering_distance: Some(("d_f", deflection_distance_m)),
        wall_steering_distance: Some(("c_f", wall_deflection_distance_m)),
        standoff_excess: STANDOFF_EXCESS_FRACTION,
        slow_down_zone_m: Some(slow_down_zone_m),
        useful_speed_max_m_s: Some(speed_cap_m_s),
        gains: &[],
        find_warning: advise_speed_cap,
    },
    build: |brief, _| Box::new(Guard::new(brief)),
};

/// Returns the radius, m, beyond which no robot and no wall matters.
fn sensing_radius_m(conditions: &MethodConditions<'_>) -> f64 {
    // Without walls the clearance is 0, and the second radius is less than the first.
    known_robots_radius_m(conditions).max(known_walls_radius_m(conditions))
}

/// Returns the radius within which all robots must be known, m: the maximum of d + Z and of the radius that the
/// deflection needs, d_f + v_max T / kappa, plus twice eps. Z is 3 v_max H if all robots stop at once.
fn known_robots_radius_m(conditions: &MethodConditions<'_>) -> f64 {
    let bounded = conditions.avoidance.distance_min_m + slow_down_zone_m(conditions);
    let deflected = deflection_distance_m(conditions)
        + conditions.speed_max_m_s() * conditions.period_s / approach_slack_fraction(conditions);
    bounded.max(deflected) + 2.0 * conditions.distance_error_max_m()
}

/// Returns the radius within which all walls must be known, m: the maximum of the clearance + Z/2 (twice the
/// speed is granted, and walls do not move) and of c_f + v_max T / kappa, plus twice eps.
fn known_walls_radius_m(conditions: &MethodConditions<'_>) -> f64 {
    let bounded = conditions.avoidance.clearance_m + 0.5 * slow_down_zone_m(conditions);
    let approach_margin =
        conditions.speed_max_m_s() * conditions.period_s / wall_approach_slack_fraction(conditions);
    let deflected = wall_deflection_distance_m(conditions) + approach_margin;
    bounded.max(deflected) + 2.0 * conditions.distance_error_max_m()
}

/// Returns the recommended maximum of v_max, m/s: min(d/4, ell/2) / H, or d/4 / H at the axle midpoint, whose turn
/// rate does not follow from the speed.
fn speed_cap_m_s(conditions: &MethodConditions<'_>) -> f64 {
    let turning =
        if conditions.front_point_m > 0.0 { 0.5 * conditions.front_point_m } else { f64::INFINITY };
    (0.25 * conditions.avoidance.distance_min_m).min(turning) / conditions.command_timeout_s
}

/// Returns an advice if v_max exceeds the recommended maximum, above which the guard brakes often.
fn advise_speed_cap(conditions: &MethodConditions<'_>) -> Option<AvoidanceWarning> {
    let (v_max, cap) = (conditions.avoidance.speed_max_m_s, speed_cap_m_s(conditions));
    let [limit, maximum] = format_distinct(v_max, cap);
    (v_max.is_finite() && v_max > cap).then(|| AvoidanceWarning {
        key: "speed_max_m_s",
        message: format!(
            "the speed limit {limit} m/s is above {} / H = {maximum} m/s: safe, but the guard will brake a lot",
            if conditions.front_point_m > 0.0 { "min(d/4, ell/2)" } else { "d/4" }
        ),
        expected_value: format!(
            "expected at most {maximum} m/s, or a shorter H (now {} s)",
            format_short(conditions.command_timeout_s)
        ),
    })
}

/// State and constants of the guard of one robot.
struct Guard {
    vicinity: VicinityParameters,
    v_max: f64,
    drive: Drive,
    steering: Steering,
    /// Control period (T), s.
    period_s: f64,
    /// Command timeout (H), s.
    command_lifetime_s: f64,
    command_lifetime_ns: u64,
    /// Rate of decrease of the slack (Lambda), 1/s.
    slack_decrease_rate_per_s: f64,
    /// `true` if any robot has inertia, so that intermediate twists occur on the way to a command.
    any_robot_has_inertia: bool,
    /// Inertia of this robot, or `None` if it stops at once.
    inertia_limits: Option<AccelerationLimitsBrief>,
    /// `true` for a front point whose speed and turn rate change independently of each other.
    has_independent_ramps: bool,
    braking_terms: BrakingTerms,
    /// Horizon of a command that is certified once, and of a command that has to be certified again.
    horizons: [Horizon; 2],
    /// Bound on the distance error (eps), m.
    distance_error_max_m: f64,
    /// Bound on the heading error (eta), rad.
    heading_error_max_rad: f64,
    deflection: Deflection,
    /// Own commands that the plant may still execute: stamp of the answered sample, and twist.
    unexpired_commands: VecDeque<(u64, Twist)>,
    /// Time until which commands of a previous incarnation may be executed. Set in real time, and if commands
    /// are delayed.
    predecessor_end_ns: Option<u64>,
    may_have_predecessor: bool,
    cones: Vec<Cone>,
    half_planes: Vec<HalfPlane>,
}

/// Horizon of a certificate.
#[derive(Debug, Clone, Copy)]
struct Horizon {
    /// Length of the horizon (h), s.
    duration: f64,
    /// Factor e^(-2 Lambda h).
    slack_decay_factor: f64,
}

impl Horizon {
    fn new(rate: f64, h: f64) -> Horizon {
        Horizon { duration: h, slack_decay_factor: portable_math::exp(-2.0 * rate * h) }
    }
}

/// Bounds on all twists that may be in force until the robot is at rest.
#[derive(Debug, Clone, Copy, Default)]
struct MotionBounds {
    own_speed_max: f64,
    braking_time_max: f64,
    /// Range of turn rates (W-, W+), rad/s.
    turn_rate_range: [f64; 2],
}

impl MotionBounds {
    /// Returns the bounds on any motion of a robot that stops at once.
    fn without_inertia(v_max: f64, drive: Drive) -> MotionBounds {
        let w_max = drive.turn_rate_bound(v_max);
        MotionBounds {
            own_speed_max: v_max,
            braking_time_max: 0.0,
            turn_rate_range: [-w_max, w_max],
        }
    }
}

impl Avoidance for Guard {
    /// Returns gamma, clipped to v_max.
    fn admit_velocity(&self, gamma: Vec2) -> Vec2 {
        clip(gamma, self.v_max)
    }

    fn standoff_error(&mut self, sample: &Sample<'_>, error: Vec2) -> Vec2 {
        self.deflection.standoff_error(sample, error)
    }

    /// Returns the twist that moves the front point by gamma T.
    fn velocity_to_twist(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        self.steering.displacement_to_twist(Heading::new(heading_rad), gamma * self.period_s)
    }

    /// Returns the certified twist for `sample` if gamma is requested.
    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        let p = self.deflection.deflect(sample, gamma * self.period_s);
        let wanted = self.steering.steer(sample, gamma, p);
        self.restrict_twist(sample, wanted, gamma)
    }

    /// Returns the certified part of `wanted`, without deflection.
    fn restrict_twist(&mut self, sample: &Sample<'_>, wanted: Twist, _: Vec2) -> Twist {
        self.drop_expired_commands(sample.stamp_ns);
        let unknown = self.any_robot_has_inertia && self.has_predecessor(sample.stamp_ns);
        let granted = match unknown || self.vicinity.lacks_neighbor_information(sample) {
            true => Twist::ZERO,
            false => self.certify(sample, self.drive.clamp(self.v_max, wanted)),
        };
        // A command that only turns counts as well: `proof/Time.v::stands`.
        self.unexpired_commands.push_back((sample.stamp_ns, granted));
        granted
    }
}

impl Guard {
    fn new(brief: &AgentBrief) -> Guard {
        let avoidance = &brief.avoidance;
        let conditions = MethodConditions::for_robot(brief);
        let (rate, any_robot_has_inertia) =
            (slack_decrease_rate_per_s(&conditions), avoidance.braking_time_max_s > 0.0);
        let repeated_horizon = conditions.command_timeout_s
            + if any_robot_has_inertia { conditions.period_s } else { 0.0 };
        let drive = brief.drive();
        Guard {
            vicinity: VicinityParameters::new(
                &conditions,
                [known_robots_radius_m(&conditions), known_walls_radius_m(&conditions)],
            ),
            v_max: avoidance.speed_max_m_s,
            drive,
            steering: Steering::new(brief),
            period_s: conditions.period_s,
            command_lifetime_s: conditions.command_timeout_s,
            command_lifetime_ns: brief.command_lifetime_ns,
            slack_decrease_rate_per_s: rate,
            any_robot_has_inertia,
            inertia_limits: brief.limits,
            has_independent_ramps: !drive.turns_freely()
                && brief.limits.is_some_and(|limits| !limits.ramp.is_coupled()),
            braking_terms: BrakingTerms::new(drive),
            horizons: [conditions.command_timeout_s, repeated_horizon]
                .map(|h| Horizon::new(rate, h)),
            distance_error_max_m: conditions.distance_error_max_m(),
            heading_error_max_rad: avoidance.heading_error_rad,
            deflection: Deflection::new(brief),
            unexpired_commands: VecDeque::new(),
            predecessor_end_ns: None,
            may_have_predecessor: brief.pace == Pace::Realtime || brief.late_ns > 0,
            cones: Vec::new(),
            half_planes: Vec::new(),
        }
    }

    /// Drops expired commands. The remaining ones may still be executed: `proof/Time.v::covers_the_alive`,
    /// `proof/Inertia.v::what_acts_since_the_last_sample`.
    fn drop_expired_commands(&mut self, stamp_ns: u64) {
        let lifetime_ns = self.command_lifetime_ns;
        self.unexpired_commands.retain(|(answered_ns, _)| answered_ns + lifetime_ns > stamp_ns);
        if self.may_have_predecessor && self.predecessor_end_ns.is_none() {
            self.predecessor_end_ns = Some(stamp_ns + lifetime_ns);
        }
    }

    /// Returns `true` while commands of a previous incarnation may be executed:
    /// `proof/Time.v::after_the_first_lifetime_no_predecessor_is_alive`.
    fn has_predecessor(&self, stamp_ns: u64) -> bool {
        self.predecessor_end_ns.is_some_and(|end_ns| stamp_ns < end_ns)
    }

    /// Returns the best certified twist for `requested` over the [`REQUESTED_TWIST_SCALES`]. If none is certified, the
    /// robot keeps its twist if that is certified, and brakes otherwise.
    fn certify(&mut self, sample: &Sample<'_>, requested: Twist) -> Twist {
        // A robot that stops at once has no twist of its own at a sample.
        let now = if self.inertia_limits.is_some() { sample.twist } else { Twist::ZERO };
        let mut best: Option<(f64, Twist)> = None;
        for sigma in REQUESTED_TWIST_SCALES {
            let tried =
                self.clamp_to_reachable(now, self.scale_into_twist_set(requested.scale_by(sigma)));
            let Some(granted) = self.grant_twist(sample, now, tried) else { continue };
            if sigma == 1.0 && granted == tried {
                return granted;
            }
            let merit =
                self.drive.velocity_of_twist(granted).dot(&self.drive.velocity_of_twist(requested));
            if best.is_none_or(|(best_merit, _)| merit > best_merit.max(0.0)) {
                best = Some((merit, granted));
            }
        }
        if let Some((_, granted)) = best {
            return granted;
        }
        self.grant_twist(sample, now, self.scale_into_twist_set(now)).unwrap_or(Twist::ZERO)
    }

    /// Returns the braking time ||y||, s: `proof/Inertia.v::braking_time`.
    fn braking_time(&self, twist: Twist) -> f64 {
        self.inertia_limits
            .map_or(0.0, |limits| self.drive.braking_time_s(limits.maximum_accelerations(), twist))
    }

    /// Returns `twist`, scaled down on its ray into Y.
    fn scale_into_twist_set(&self, twist: Twist) -> Twist {
        let Some(limits) = self.inertia_limits else { return twist };
        let twist = self.drive.clamp(self.v_max, twist);
        let braking_time_max = STRICT_BOUND_FACTOR * limits.braking_time_s;
        self.drive.clamp_braking_time(limits.maximum_accelerations(), twist, braking_time_max)
    }

    /// Returns the twist nearest to `tried` that the wheels can reach from `now` within H.
    fn clamp_to_reachable(&self, now: Twist, tried: Twist) -> Twist {
        let Some(limits) = self.inertia_limits else { return tried };
        self.drive.nearest_reachable_twist(
            limits.maximum_accelerations(),
            now,
            tried,
            self.command_lifetime_s,
        )
    }

    /// Returns the twist nearest to `tried` for which a certificate exists: `proof/Time.v::certified` or, if
    /// any robot has inertia, `proof/Braking.v::certified`. Returns `None` if there is none.
    ///
    /// The bounds hold for every command that may be executed, or has been executed since the sample:
    /// `proof/Time.v::wheels_since_the_sample`, `proof/Inertia.v::fits`.
    fn grant_twist(&mut self, sample: &Sample<'_>, now: Twist, tried: Twist) -> Option<Twist> {
        if self.has_independent_ramps {
            return self.grant_within_rectangle(sample, now, tried);
        }
        let mut bounds = match self.has_predecessor(sample.stamp_ns) {
            true => MotionBounds::without_inertia(self.v_max, self.drive),
            false => MotionBounds::default(),
        };
        let alive = self.unexpired_commands.iter().map(|(_, twist)| *twist);
        for twist in alive.chain([now, tried]) {
            self.widen_bounds(&mut bounds, twist);
        }
        if self.drive.is_car() {
            // Whatever the steering angle does: `proof/Bodies.v::car_turns_at_most`.
            let w_max = self.drive.turn_rate_bound(bounds.own_speed_max);
            bounds.turn_rate_range = [-w_max, w_max];
        }
        for pass in 1..=WIDENING_PASSES_MAX {
            if self.any_robot_has_inertia && !self.is_still_certified(sample, now, bounds) {
                return None;
            }
            let granted = self.certified_twist_near(sample, tried, bounds);
            let [w_low, w_high] = bounds.turn_rate_range;
            let in_range = (w_low..=w_high).contains(&granted.w_rad_s);
            if in_range && self.braking_time(granted) <= bounds.braking_time_max {
                return Some(granted);
            }
            self.widen_bounds(&mut bounds, granted);
            if pass == WIDENING_PASSES_MAX - 1 {
                let w_max = self.drive.turn_rate_bound(bounds.own_speed_max);
                bounds.turn_rate_range =
                    [bounds.turn_rate_range[0].min(-w_max), bounds.turn_rate_range[1].max(w_max)];
                let tau = self.inertia_limits.map_or(0.0, |limits| limits.braking_time_s);
                bounds.braking_time_max = bounds.braking_time_max.max(tau);
            }
        }
        None
    }

    /// Widens `bounds` to include `twist`.
    fn widen_bounds(&self, bounds: &mut MotionBounds, twist: Twist) {
        bounds.own_speed_max = bounds.own_speed_max.max(front_speed(self.drive.ell_m, twist));
        bounds.braking_time_max = bounds.braking_time_max.max(self.braking_time(twist));
        bounds.turn_rate_range = [
            bounds.turn_rate_range[0].min(twist.w_rad_s),
            bounds.turn_rate_range[1].max(twist.w_rad_s),
        ];
    }

    /// Returns `true` if the twist in force and the unexpired commands approach no neighbor faster than b.
    fn is_still_certified(
        &mut self,
        sample: &Sample<'_>,
        now: Twist,
        bounds: MotionBounds,
    ) -> bool {
        let mid = self.collect_cones(sample, self.horizons[0], bounds);
        if self.cones.is_empty() {
            return true;
        }
        let mut certified = self.unexpired_commands.iter().map(|(_, twist)| *twist).chain([now]);
        certified.all(|twist| {
            let u = rotate(mid, self.drive.velocity_of_twist(twist));
            self.cones.iter().all(|cone| cone.permits(u))
        })
    }

    /// Returns `tried`, or the nearest twist that approaches no neighbor faster than b. A twist that has to be
    /// certified again at the next sample, as the twist in force, is bounded for H + T, so that this is
    /// possible.
    fn certified_twist_near(
        &mut self,
        sample: &Sample<'_>,
        tried: Twist,
        bounds: MotionBounds,
    ) -> Twist {
        let mid = self.collect_cones(sample, self.horizons[1], bounds);
        if self.cones.is_empty() {
            return tried;
        }
        let u = rotate(mid, self.drive.velocity_of_twist(tried));
        if self.any_robot_has_inertia && self.cones.iter().all(|cone| cone.permits(u)) {
            return tried;
        }
        self.collect_half_planes();
        if self.drive.moves_along_heading() {
            // y is on the line of the heading. The turn rate stays, and the curvature of a car.
            let factor = scale_factor_on_ray(u, &self.half_planes);
            return match self.drive.is_car() {
                true => tried.scale_by(factor),
                false => Twist::new(tried.v_m_s * factor, tried.w_rad_s),
            };
        }
        let Some(u) = nearest_point(u, &self.half_planes) else { return tried };
        self.scale_into_twist_set(self.drive.twist_for_velocity(rotate(-mid, u), tried.w_rad_s))
    }

    /// Collects the half-planes of all cones.
    fn collect_half_planes(&mut self) {
        self.half_planes.clear();
        for cone in &self.cones {
            self.half_planes.extend(cone.half_planes());
        }
    }

    /// Collects a cone for each neighbor in range: the directions possible until all robots are at rest, and
    /// the permitted approach speed. Returns the center of the range of headings possible until then, rad.
    ///
    /// The formulas come from `proof/Braking.v::certified_against`: `proof/Braking.v::swept`,
    /// `proof/Braking.v::turning_time` and `proof/Braking.v::braking_bound`; for tau_o = 0 from
    /// `proof/Guard.v::respects` and `proof/Walls.v::respects_wall`.
    fn collect_cones(
        &mut self,
        sample: &Sample<'_>,
        horizon: Horizon,
        bounds: MotionBounds,
    ) -> f64 {
        let MotionBounds { own_speed_max: v_own, braking_time_max: tau_o, turn_rate_range: w } =
            bounds;
        let Horizon { duration: h, slack_decay_factor } = horizon;
        let BrakingTerms {
            path_factor,
            turn_factor,
            heading_range_fraction,
            approach_speed_factor: mu,
        } = self.braking_terms;
        let (mid, spread) = heading_range(
            sample.heading_rad,
            h + turn_factor * tau_o,
            w,
            self.heading_error_max_rad,
        );
        let spread = heading_range_fraction * spread;
        let braking_s = path_factor * tau_o;
        let speed_factor = mu(2.0 * self.slack_decrease_rate_per_s * tau_o);
        self.cones.clear();
        for object in self.vicinity.objects_in_range(sample) {
            let r = object.z.norm();
            let rho =
                (r - self.distance_error_max_m - object.distance_min - ROUNDING_MARGIN_M).max(0.0);
            let reach_h = (object.neighbor_speed_max + v_own) * h + self.distance_error_max_m; // M_H + eps
            let b = object.slack_rate_factor
                * self.slack_decrease_rate_per_s
                * speed_factor
                * (slack_decay_factor * rho).max(rho - reach_h);
            if b >= v_own {
                continue;
            }
            let reach = match braking_s > 0.0 {
                true => {
                    let own_reach = v_own * (h + 0.5 * braking_s);
                    own_reach
                        + object.neighbor_speed_max * (h + braking_s)
                        + self.distance_error_max_m // M + eps
                }
                false => reach_h,
            };
            let psi = (spread + direction_change_max_rad(reach, r)).min(PI);
            self.cones.push(Cone {
                axis: direction(object.z),
                half_angle_rad: psi,
                approach_speed_max: b,
            });
        }
        mid
    }
}

mod independent_ramps;

#[cfg(test)]
mod formulas;
#[cfg(test)]
mod lemma;
#[cfg(test)]
mod proof;
#[cfg(test)]
pub(super) mod tests;
