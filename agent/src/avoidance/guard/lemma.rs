//! Numerical test of the lemma on which the guard relies: while the twists of a certificate are in effect in
//! any order, followed by braking, the robot approaches no neighbor faster than Lambda e^(-2 Lambda t) g, where
//! g is the running maximum of e^(2 Lambda t) rho, for any motion of the others
//! (`proof/Braking.v::share_of_the_slack_with_inertia`). If all robots stop at once, this holds for the new
//! command, regardless of earlier commands (`proof/AtOnce.v::share_of_the_slack`).
//!
//! Ablations show that each part of the certificate is needed, by cases constructed for this purpose.

use formation::drive::DriveKind;
use formation::front_point::{front_point, front_velocity};
use formation::obstacle::Obstacle;
use formation::pose::{Pose, wrap_angle};
use formation::ramp::Ramp;
use formation::random::SplitMix64;
use formation::unicycle::integrate_arc;

use super::super::braking::approach_speed_factor;
use super::tests::{brief, sample as sample_at};
use super::*;

/// Part of a certificate that is disabled, to show that it is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DisabledCertificatePart {
    Nothing,
    /// The twist in force is not certified.
    TwistInForce,
    /// Own unexpired commands are neither certified nor included in the bounds.
    UnexpiredCommands,
    /// The certified path (M) ends when the command expires, without the braking after it.
    BrakingPath,
    /// The certificate assumes a constant heading after the command has expired.
    BrakingTurn,
    /// The factor mu is 1.
    ApproachSpeedFactor,
    /// The certificate assumes the middle of all possible headings.
    HeadingRange,
    /// Commands that only turn the robot count as zero.
    TurningInPlace,
    /// The certificate assumes that other robots do not move.
    NeighborSpeed,
}

/// Controlled point of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ControlledPoint {
    FrontPoint,
    /// Front point of a robot whose speed and turn rate change independently of each other.
    FrontPointIndependentRamps,
    AxleMidpoint,
    Omnidirectional,
    /// Omnidirectional, with a constant heading.
    Drone,
    /// Rear axle of a car.
    RearAxle,
}

const CONTROLLED_POINTS: [ControlledPoint; 6] = [
    ControlledPoint::FrontPoint,
    ControlledPoint::FrontPointIndependentRamps,
    ControlledPoint::AxleMidpoint,
    ControlledPoint::Omnidirectional,
    ControlledPoint::Drone,
    ControlledPoint::RearAxle,
];
/// Controlled points of robots that can turn in place. Ramps do not matter in these cases.
const TURNING_POINTS: [ControlledPoint; 3] =
    [ControlledPoint::FrontPoint, ControlledPoint::AxleMidpoint, ControlledPoint::Omnidirectional];
/// Controlled points of robots whose heading changes. With independent ramps, the corners of the certificate leave a
/// margin in these cases.
const HEADING_POINTS: [ControlledPoint; 4] = [
    ControlledPoint::FrontPoint,
    ControlledPoint::AxleMidpoint,
    ControlledPoint::Omnidirectional,
    ControlledPoint::RearAxle,
];

/// State of a robot at one instant of its path.
struct PathState {
    t: f64,
    front_point: Vec2,
    velocity: Vec2,
    /// `true` if the certificate covers the twist in force.
    is_certified: bool,
}

/// One robot, its sample, and its requested twist.
#[derive(Debug, Clone)]
struct GuardCase {
    distance_min: f64,
    kind: DriveKind,
    ell: f64,
    /// Maximum turn rate (w_max), rad/s; infinite for a front point. For a car, its turn rate at v_max.
    turn_rate_max: f64,
    v_max: f64,
    lifetime: f64,
    period: f64,
    /// Inertia, or `None` for a robot that stops at once.
    limits: Option<AccelerationLimitsBrief>,
    /// Maximum braking time of all robots, s.
    braking_time_max: f64,
    error_m: f64,
    heading_error: f64,
    heading: f64,
    twist_in_force: Twist,
    unexpired_commands: Vec<Twist>,
    requested_twist: Twist,
    /// Own front point - other front points, m.
    neighbor_vectors: Vec<Vec2>,
    clearance: f64,
    /// Walls, relative to the robot's axle midpoint.
    walls: Vec<Obstacle>,
}

/// Returns a vector with this length and angle.
fn polar_vector(length: f64, angle: f64) -> Vec2 {
    rotate(angle, Vec2::new(length, 0.0))
}

fn draw_uniform(rng: &mut SplitMix64, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.draw_unit()
}

/// Returns a random element of the list.
fn draw_element(rng: &mut SplitMix64, list: &[f64]) -> f64 {
    list[rng.draw_between(0, list.len() as u64 - 1) as usize]
}

impl GuardCase {
    /// Returns a random robot without neighbors.
    fn draw_robot_without_neighbors(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
        let d = draw_uniform(rng, 0.1, 0.5);
        let ell = draw_uniform(rng, 0.03, 0.3);
        let (kind, ell, turn_rate_max, ramp) = match body {
            ControlledPoint::FrontPoint => {
                (DriveKind::Differential, ell, f64::INFINITY, Ramp::Together)
            }
            ControlledPoint::FrontPointIndependentRamps => {
                (DriveKind::Differential, ell, f64::INFINITY, Ramp::Independent)
            }
            ControlledPoint::AxleMidpoint => {
                (DriveKind::Differential, 0.0, draw_uniform(rng, 0.5, 12.0), Ramp::Independent)
            }
            ControlledPoint::Omnidirectional => {
                (DriveKind::Omni, 0.0, draw_uniform(rng, 0.5, 12.0), Ramp::Independent)
            }
            ControlledPoint::Drone => (DriveKind::Omni, 0.0, 0.0, Ramp::Independent),
            ControlledPoint::RearAxle => {
                (DriveKind::Ackermann, 0.0, draw_uniform(rng, 0.5, 12.0), Ramp::Independent)
            }
        };
        let v_max = draw_uniform(rng, 0.1, 1.0);
        let lifetime = draw_element(rng, &[0.005, 0.02, 0.1, 0.3]) * draw_uniform(rng, 0.5, 1.5);
        let acceleration_m_s2 = v_max / draw_uniform(rng, 0.05, 1.5);
        let turning_radius = (kind == DriveKind::Ackermann).then_some(v_max / turn_rate_max);
        let drive = Drive::new(kind, ell, Some(turn_rate_max)).with_turning_radius(turning_radius);
        let turn_acceleration_rad_s2 = match body {
            // It does not turn, whatever the limit.
            ControlledPoint::Drone => 1.0,
            _ => drive.turn_rate_bound(v_max) / draw_uniform(rng, 0.05, 1.5),
        };
        let braking_time_s = draw_uniform(rng, 0.05, 1.0);
        let others_longer = if rng.draw_bool(0.3) { draw_uniform(rng, 1.0, 2.0) } else { 1.0 };
        GuardCase {
            distance_min: d,
            kind,
            ell,
            turn_rate_max,
            v_max,
            lifetime,
            period: lifetime * draw_uniform(rng, 0.1, 1.0),
            limits: Some(AccelerationLimitsBrief {
                acceleration_m_s2,
                turn_acceleration_rad_s2,
                braking_time_s,
                ramp,
            }),
            braking_time_max: braking_time_s * others_longer,
            error_m: 0.0,
            heading_error: 0.0,
            heading: draw_uniform(rng, -3.1, 3.1),
            twist_in_force: Twist::ZERO,
            unexpired_commands: Vec::new(),
            requested_twist: Twist::ZERO,
            neighbor_vectors: Vec::new(),
            clearance: draw_uniform(rng, 0.05, 0.4),
            walls: Vec::new(),
        }
    }

    /// Returns the minimum turning radius of a car, m; `None` for other drives.
    fn turning_radius(&self) -> Option<f64> {
        (self.kind == DriveKind::Ackermann).then_some(self.v_max / self.turn_rate_max)
    }

    /// Returns the twist with the largest turn rate to this side, 1 or -1: in place, except for a car.
    fn turning_twist(&self, side: f64) -> Twist {
        let v_m_s = if self.kind == DriveKind::Ackermann { self.v_max } else { 0.0 };
        Twist::new(v_m_s, side * self.turn_rate_bound())
    }

    /// Returns the rate Lambda, 1/s.
    fn slack_decrease_rate_per_s(&self) -> f64 {
        1.0 / (self.lifetime + self.braking_time_max)
    }

    /// Sets the accelerations of the robot, with a maximum braking time of 1 s.
    fn set_accelerations(&mut self, acceleration_m_s2: f64, turn_acceleration_rad_s2: f64) {
        let ramp = self.limits.map_or(Ramp::Together, |limits| limits.ramp);
        self.braking_time_max = 1.0;
        self.limits = Some(AccelerationLimitsBrief {
            acceleration_m_s2,
            // Above 0 also for a drone, which does not turn.
            turn_acceleration_rad_s2: turn_acceleration_rad_s2.max(f64::MIN_POSITIVE),
            braking_time_s: 1.0,
            ramp,
        });
    }

    /// Returns a random case of any kind.
    fn draw_case(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
        let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
        if rng.draw_bool(0.4) {
            // The robot stops at once, alone or like all others.
            case.limits = None;
            case.braking_time_max *= draw_element(rng, &[0.0, 0.0, 1.0]);
        }
        if rng.draw_bool(0.3) {
            case.error_m = draw_uniform(rng, 0.0, 0.03);
            case.heading_error = draw_uniform(rng, 0.0, 0.3);
        }
        // Distances at which the neighbors matter, and often such that the current twists can be certified.
        let zone = case.v_max / case.slack_decrease_rate_per_s();
        for _ in 0..rng.draw_between(1, 3) {
            let slack = if rng.draw_bool(0.2) { 0.0 } else { zone * draw_uniform(rng, 0.0, 1.5) };
            let angle = draw_uniform(rng, -PI, PI);
            match rng.draw_bool(0.4) {
                true => case.place_wall(case.error_m + 0.5 * slack, angle, rng),
                false => case
                    .neighbor_vectors
                    .push(polar_vector(case.distance_min + case.error_m + slack, angle)),
            }
        }
        case.requested_twist = case.draw_twist(rng);
        let slow = draw_uniform(rng, 0.0, 1.0).powi(2);
        let now = case.draw_twist(rng).scale_by(slow);
        case.twist_in_force = if case.limits.is_some() { now } else { Twist::ZERO };
        for _ in 0..rng.draw_between(0, 2) {
            let slow = draw_uniform(rng, 0.0, 1.0).powi(2);
            let twist = case.draw_twist(rng).scale_by(slow);
            case.unexpired_commands.push(twist);
        }
        case
    }

    /// Returns a random twist in Y.
    fn draw_twist(&self, rng: &mut SplitMix64) -> Twist {
        let u = polar_vector(
            self.v_max * draw_element(rng, &[1.0, 1.0, 0.5]),
            draw_uniform(rng, -PI, PI),
        );
        let twist = self.front_velocity_to_twist(u);
        let w_rad_s = match self.kind {
            DriveKind::Differential | DriveKind::Ackermann => twist.w_rad_s,
            DriveKind::Omni => draw_uniform(rng, -1.0, 1.0) * self.turn_rate_max,
        };
        self.build_guard().scale_into_twist_set(Twist { w_rad_s, ..twist })
    }

    /// Returns the twist of a controlled point with the velocity `u` in the robot's frame, m/s. Where ell = 0, the
    /// second component, divided by v_max, is the fraction of w_max.
    fn front_velocity_to_twist(&self, u: Vec2) -> Twist {
        match self.ell > 0.0 {
            true => Twist::new(u.x, u.y / self.ell),
            false => self
                .build_guard()
                .drive
                .twist_for_velocity(u, u.y / self.v_max * self.turn_rate_max),
        }
    }

    /// Returns the maximum turn rate, rad/s.
    fn turn_rate_bound(&self) -> f64 {
        self.build_guard().drive.turn_rate_bound(self.v_max)
    }

    /// Places another robot at a distance of d + `slack` in the direction `angle`, relative to the robot's
    /// heading.
    fn place_neighbor(&mut self, slack: f64, angle: f64) {
        // z points from the other to the robot.
        self.neighbor_vectors =
            vec![polar_vector(self.distance_min + slack, self.heading + angle + PI)];
    }

    /// Adds a wall (a segment or a disc) at a distance of the clearance + `slack` in this direction.
    fn place_wall(&mut self, slack: f64, angle: f64, rng: &mut SplitMix64) {
        let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad: self.heading };
        let foot = front_point(start, self.ell) + polar_vector(self.clearance + slack, angle);
        let point_along = |length: f64| (foot + polar_vector(length, angle + 0.5 * PI)).into();
        self.walls.push(match rng.draw_bool(0.5) {
            true => Obstacle::segment(
                point_along(draw_uniform(rng, 0.0, 1.0)),
                point_along(-draw_uniform(rng, 0.01, 1.0)),
            ),
            false => {
                let radius_m = draw_uniform(rng, 0.01, 0.5);
                Obstacle::Disc { center_m: (foot + polar_vector(radius_m, angle)).into(), radius_m }
            }
        });
    }

    fn build_guard(&self) -> Guard {
        let mut brief = AgentBrief { pace: Pace::Lockstep, ..brief() };
        (brief.front_point_m, brief.drive_kind) = (self.ell, self.kind);
        brief.turn_rate_max_rad_s = Some(self.turn_rate_max);
        brief.turning_radius_min_m = self.turning_radius();
        brief.period_ns = (self.period * 1e9) as u64;
        brief.command_lifetime_ns = (self.lifetime * 1e9) as u64;
        brief.limits = self.limits;
        brief.avoidance.distance_min_m = self.distance_min;
        brief.avoidance.clearance_m = self.clearance;
        brief.avoidance.speed_max_m_s = self.v_max;
        brief.avoidance.sensing_error_m = self.error_m;
        brief.avoidance.heading_error_rad = self.heading_error;
        brief.avoidance.braking_time_max_s = self.braking_time_max;
        Guard::new(&brief)
    }

    /// Calls `use_sample` with the sample of the robot, including sensor errors, if its sensed heading is `sensed`,
    /// rad.
    fn with_sample<T>(
        &self,
        sensed: f64,
        rng: &mut SplitMix64,
        use_sample: impl FnOnce(&Sample<'_>) -> T,
    ) -> T {
        let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad: self.heading };
        let alpha = front_point(start, self.ell);
        let alpha_sensed = front_point(Pose { heading_rad: sensed, ..start }, self.ell);
        let mut reported = |points: Vec<Vec2>| {
            let points = points.into_iter().map(|point| {
                alpha_sensed - point
                    + polar_vector(self.error_m * rng.draw_unit(), draw_uniform(rng, -PI, PI))
            });
            let mut reported: Vec<Vec2> = points.collect();
            reported.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
            reported
        };
        let neighbor_vectors = reported(self.neighbor_vectors.iter().map(|z| alpha - z).collect());
        let walls = reported(self.walls.iter().map(|wall| wall.nearest_point(alpha)).collect());
        use_sample(&Sample {
            twist: self.twist_in_force,
            wall_vectors: &walls,
            ..sample_at(0, sensed, &neighbor_vectors)
        })
    }

    /// Returns the maximum by which an approach exceeds its share of the slack, m/s, or `None` if there is no
    /// certificate.
    fn slack_excess(
        &self,
        disabled_part: DisabledCertificatePart,
        ramp: Ramp,
        rng: &mut SplitMix64,
    ) -> Option<f64> {
        let mut guard = self.build_guard();
        let mut now = self.twist_in_force;
        guard.unexpired_commands =
            self.unexpired_commands.iter().map(|twist| (0, *twist)).collect();
        let tried = guard.clamp_to_reachable(now, guard.scale_into_twist_set(self.requested_twist));
        match disabled_part {
            DisabledCertificatePart::Nothing => {}
            DisabledCertificatePart::TwistInForce => now = Twist::ZERO,
            DisabledCertificatePart::UnexpiredCommands => guard.unexpired_commands.clear(),
            DisabledCertificatePart::BrakingPath => guard.braking_terms.path_factor = 0.0,
            DisabledCertificatePart::BrakingTurn => guard.braking_terms.turn_factor = 0.0,
            DisabledCertificatePart::ApproachSpeedFactor => {
                guard.braking_terms.approach_speed_factor = |_| 1.0
            }
            DisabledCertificatePart::HeadingRange => {
                guard.braking_terms.heading_range_fraction = 0.0
            }
            DisabledCertificatePart::TurningInPlace => {
                guard.unexpired_commands.retain(|(_, twist)| twist.v_m_s != 0.0)
            }
            DisabledCertificatePart::NeighborSpeed => {
                guard.vicinity.default_class.speed_max_m_s = 0.0
            }
        }
        let sensed = self.heading + self.heading_error * draw_uniform(rng, -1.0, 1.0);
        let granted =
            self.with_sample(sensed, rng, |sample| guard.grant_twist(sample, now, tried))?;

        let path = self.draw_path(granted, ramp, rng);
        let alpha = path[0].front_point;
        let worst = { &self.neighbor_vectors }
            .iter()
            .map(|z| self.worst_neighbor_excess(alpha - z, &path, rng));
        let worst = worst.fold(f64::NEG_INFINITY, f64::max);
        let wall_excesses = self.walls.iter().map(|wall| self.worst_wall_excess(wall, &path));
        Some(wall_excesses.fold(worst, f64::max))
    }

    /// Returns a random path of the robot: its unexpired commands act in random order until the command
    /// timeout, followed by braking. Weak wheels execute a fraction of each command.
    fn draw_path(&self, granted: Twist, ramp: Ramp, rng: &mut SplitMix64) -> Vec<PathState> {
        let fraction = if rng.draw_bool(0.2) { draw_uniform(rng, 0.2, 1.0) } else { 1.0 };
        let has_inertia = self.braking_time_max > 0.0;
        let independent = self.limits.is_some_and(|limits| !limits.ramp.is_coupled());
        let ramp = if independent { Ramp::Independent } else { ramp };
        let mut commands: Vec<(Twist, bool)> =
            self.unexpired_commands.iter().map(|twist| (*twist, has_inertia)).collect();
        commands.extend([(granted, true), (granted, true), (Twist::ZERO, true)]);
        let mut targets = Vec::new();
        let mut t = 0.0;
        while t < self.lifetime {
            targets.push((t, commands[rng.draw_between(0, commands.len() as u64 - 1) as usize]));
            t += if rng.draw_bool(0.5) { self.lifetime } else { self.lifetime * rng.draw_unit() };
        }
        targets.push((self.lifetime, (Twist::ZERO, true)));
        let end = self.lifetime + self.limits.map_or(0.0, |limits| 1.1 * limits.braking_time_s);

        let mut pose = Pose { x_m: 0.0, y_m: 0.0, heading_rad: self.heading };
        let mut twist = self.twist_in_force;
        let instant = |t: f64, pose: Pose, twist: Twist, is_certified: bool| PathState {
            t,
            front_point: front_point(pose, self.ell),
            velocity: front_velocity(pose.heading_rad, self.ell, twist),
            is_certified,
        };
        let mut path = vec![instant(0.0, pose, twist, true)];
        for (k, &(start_of_target, (target, is_certified))) in targets.iter().enumerate() {
            let end_of_target = targets.get(k + 1).map_or(end, |next| next.0);
            let steps = 12;
            let curvature = self.draw_curvature(rng);
            for step in 1..=steps {
                let dt = (end_of_target - start_of_target) / f64::from(steps);
                let target = target.scale_by(fraction);
                let on_curve = |twist: Twist| match curvature {
                    Some(curvature) => Twist::new(twist.v_m_s, curvature * twist.v_m_s),
                    None => twist,
                };
                let (steered, target) = (on_curve(twist), on_curve(target));
                (pose, twist) = match self.limits.map(|limits| limits.maximum_accelerations()) {
                    Some(accelerations) if curvature.is_some() => {
                        accelerations.car_pose_and_twist_after(pose, steered, target, dt)
                    }
                    Some(accelerations) => {
                        accelerations.pose_and_twist_after(pose, twist, target, ramp, dt)
                    }
                    None => (integrate_arc(pose, target, dt), target),
                };
                path.push(instant(
                    start_of_target + dt * f64::from(step),
                    pose,
                    twist,
                    is_certified,
                ));
            }
        }
        path
    }

    /// Returns a curvature that the steering of a car may have, whatever was commanded, 1/m; `None` for other drives.
    fn draw_curvature(&self, rng: &mut SplitMix64) -> Option<f64> {
        self.turning_radius().map(|radius| {
            let any = draw_uniform(rng, -1.0, 1.0);
            draw_element(rng, &[1.0, -1.0, any]) / radius
        })
    }

    /// Returns the worst case that random paths reach only by chance: the maximum by which a certified twist is
    /// too fast, m/s, over all possible headings and all possible motions of the others.
    fn worst_case_excess(&self, rng: &mut SplitMix64) -> Option<f64> {
        let mut guard = self.build_guard();
        guard.unexpired_commands =
            self.unexpired_commands.iter().map(|twist| (0, *twist)).collect();
        let tried = guard.clamp_to_reachable(
            self.twist_in_force,
            guard.scale_into_twist_set(self.requested_twist),
        );
        let GuardCase { ell, lifetime: h, v_max, .. } = *self;
        self.with_sample(self.heading, rng, |sample| {
            let granted = guard.grant_twist(sample, self.twist_in_force, tried)?;
            let others = self.unexpired_commands.iter().copied().chain([self.twist_in_force]);
            let in_force: Vec<Twist> = others.chain([granted]).collect();
            let maximum = |of: &dyn Fn(&Twist) -> f64| in_force.iter().map(of).fold(0.0, f64::max);
            let v_own = maximum(&|twist| front_speed(ell, *twist));
            let tau_o = maximum(&|twist| guard.braking_time(*twist));
            let (w_low, w_high) =
                (-maximum(&|twist| -twist.w_rad_s), maximum(&|twist| twist.w_rad_s));
            let (w_low, w_high) = match self.turning_radius() {
                Some(radius) => (-v_own / radius, v_own / radius),
                None => (w_low, w_high),
            };
            let turning = 0.5 * (h + if ell > 0.0 { 0.5 } else { 1.0 } * tau_o);
            let middle = self.heading + turning * (w_low + w_high);
            let delta = turning * (w_high - w_low) + self.heading_error;
            let certified = if self.braking_time_max > 0.0 { &in_force[..] } else { &[granted] };
            let eps = guard.distance_error_max_m;
            let robots = sample.neighbor_vectors.iter().map(|z| (z, v_max, 1.0, self.distance_min));
            let walls = sample.wall_vectors.iter().map(|z| (z, 0.0, 2.0, self.clearance));
            let mut worst = f64::NEG_INFINITY;
            for (z, its_speed, slack_share, distance_min) in robots.chain(walls) {
                let rho = (z.norm() - eps - distance_min).max(0.0);
                let granted = (rho * (-2.0 * self.slack_decrease_rate_per_s() * h).exp())
                    .max(rho - (v_own + its_speed) * h - eps);
                let b = slack_share
                    * self.slack_decrease_rate_per_s()
                    * approach_speed_factor(2.0 * self.slack_decrease_rate_per_s() * tau_o)
                    * granted;
                let m = v_own * (h + 0.5 * tau_o) + its_speed * (h + tau_o) + eps;
                let swing = if m < z.norm() { (m / z.norm()).asin() } else { PI };
                for twist in certified {
                    let course = middle + (twist.side_m_s + ell * twist.w_rad_s).atan2(twist.v_m_s);
                    let angle_error = wrap_angle((-z.y).atan2(-z.x) - course).abs() - delta - swing;
                    let approach = front_speed(ell, *twist) * angle_error.max(0.0).cos();
                    worst = worst.max(approach - b);
                }
            }
            Some(worst)
        })
    }

    /// Returns the worst excess next to a wall, where the robot may use up all of the slack, m/s.
    fn worst_wall_excess(&self, wall: &Obstacle, path: &[PathState]) -> f64 {
        let rate = self.slack_decrease_rate_per_s();
        let (mut g, mut worst) = (0.0f64, f64::NEG_INFINITY);
        for PathState { t, front_point: alpha, velocity, is_certified } in path {
            let z = alpha - wall.nearest_point(*alpha);
            g = g.max((2.0 * rate * t).exp() * (z.norm() - self.clearance));
            if *is_certified {
                let approach = -z.dot(velocity) / z.norm();
                worst = worst.max(approach - 2.0 * rate * (-2.0 * rate * t).exp() * g);
            }
        }
        worst
    }

    /// Returns the worst excess against one robot that starts at `other`, over random motions of it, m/s.
    fn worst_neighbor_excess(&self, other: Vec2, path: &[PathState], rng: &mut SplitMix64) -> f64 {
        let rate = self.slack_decrease_rate_per_s();
        let mut worst = f64::NEG_INFINITY;
        for _ in 0..6 {
            // Random motion, or straight into the path at some instant.
            let PathState { t: meeting_time, front_point: alpha, velocity, .. } =
                path[rng.draw_between(0, path.len() as u64 - 1) as usize];
            let course = if rng.draw_bool(0.4) {
                polar_vector(self.v_max, draw_uniform(rng, -PI, PI))
            } else {
                let ahead =
                    self.distance_min * draw_uniform(rng, 0.5, 1.2) * velocity.cap_magnitude(1.0);
                let ahead =
                    if velocity.norm() > 0.0 { ahead / velocity.norm().min(1.0) } else { ahead };
                let displacement = alpha + ahead - other;
                (displacement / meeting_time.max(1e-9)).cap_magnitude(self.v_max)
            };
            let stop_time = if rng.draw_bool(0.5) { meeting_time } else { f64::INFINITY };
            let mut g: f64 = 0.0;
            for PathState { t, front_point: alpha, velocity, is_certified } in path {
                let z = alpha - (other + course * t.min(stop_time));
                let rho = z.norm() - self.distance_min;
                g = g.max((2.0 * rate * t).exp() * rho);
                if *is_certified {
                    let approach = -z.dot(velocity) / z.norm();
                    worst = worst.max(approach - rate * (-2.0 * rate * t).exp() * g);
                }
            }
        }
        worst
    }
}

/// Tolerance for rounding, and for what the guard subtracts because of it: 1 nm times Lambda.
const TOLERANCE_M_S: f64 = 1e-7;

/// Returns how many of `certified` certified cases violate the lemma, and the maximum excess.
fn count_violations(
    certified: u64,
    disabled_part: DisabledCertificatePart,
    ramp: Ramp,
    body: ControlledPoint,
    draw_case: impl Fn(&mut SplitMix64, ControlledPoint) -> GuardCase,
) -> (u64, f64) {
    let (mut certified_count, mut count, mut worst) = (0, 0, f64::NEG_INFINITY);
    for seed in 0.. {
        let mut rng = SplitMix64::new(seed);
        let case = draw_case(&mut rng, body);
        assert!(seed < 1000 * certified, "only {certified_count} of {seed} cases are certified");
        let Some(excess) = case.slack_excess(disabled_part, ramp, &mut rng) else { continue };
        certified_count += 1;
        worst = worst.max(excess);
        if excess > TOLERANCE_M_S {
            count += 1;
            let must_hold = ramp == Ramp::Together || body != ControlledPoint::FrontPoint;
            assert!(
                disabled_part != DisabledCertificatePart::Nothing || !must_hold,
                "{excess}: {case:?}"
            );
        }
        if certified_count == certified {
            break;
        }
    }
    (count, worst)
}

/// Draws a case of moving straight towards a nearby robot, with no other request.
fn draw_head_on_case(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
    let ahead = draw_uniform(rng, -0.3, 0.3);
    case.place_neighbor(
        draw_uniform(rng, 0.0, 0.2) * case.v_max / case.slack_decrease_rate_per_s(),
        ahead,
    );
    case.twist_in_force = case.build_guard().scale_into_twist_set(Twist::new(case.v_max, 0.0));
    case
}

/// Draws a case of standing still, with an unexpired command that moves straight towards a nearby robot.
fn draw_case_commanded_at_neighbor(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase { twist_in_force: Twist::ZERO, ..draw_head_on_case(rng, body) };
    let towards = case.build_guard().scale_into_twist_set(Twist::new(case.v_max, 0.0));
    case.unexpired_commands = vec![towards; 3];
    case.lifetime = draw_uniform(rng, 0.1, 0.3);
    case
}

/// Draws a case of a fast robot at the side that can cut in before this robot is at rest.
fn draw_overtaking_case(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
    case.lifetime = 0.005;
    case.period = 0.001;
    case.set_accelerations(
        draw_uniform(rng, 0.3, 1.0) * case.v_max,
        draw_uniform(rng, 0.7, 20.0) * case.turn_rate_bound(),
    );
    case.place_neighbor(
        draw_uniform(rng, 0.0, 0.6) * case.v_max,
        draw_element(rng, &[1.0, -1.0]) * draw_uniform(rng, 0.8, 2.2),
    );
    case.twist_in_force = case
        .build_guard()
        .scale_into_twist_set(Twist::new(draw_uniform(rng, 0.2, 1.0) * case.v_max, 0.0));
    case.requested_twist = case.twist_in_force;
    case
}

/// Draws a case of turning towards a robot at the side, on a small circle.
fn draw_case_turning_towards_neighbor(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
    case.lifetime = 0.005;
    case.period = 0.001;
    case.set_accelerations(case.v_max, case.turn_rate_bound());
    let side = draw_element(rng, &[1.0, -1.0]);
    case.place_neighbor(
        draw_uniform(rng, 0.0, 0.6) * case.v_max,
        side * draw_uniform(rng, 1.2, 2.6),
    );
    let u =
        polar_vector(draw_uniform(rng, 0.2, 1.0) * case.v_max, side * draw_uniform(rng, 0.0, 0.9));
    case.twist_in_force = case.build_guard().scale_into_twist_set(case.front_velocity_to_twist(u));
    case.requested_twist = case.twist_in_force;
    case
}

/// Draws a case of approaching a robot at the granted speed while braking all the time.
fn draw_case_braking_towards_neighbor(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
    case.lifetime = 0.005;
    case.period = 0.0005;
    case.set_accelerations(draw_uniform(rng, 0.2, 1.0) * case.v_max, case.turn_rate_bound());
    case.place_neighbor(draw_uniform(rng, 0.1, 1.0) * case.v_max, 0.0);
    // The speed granted straight towards the other robot if mu is 1.
    let granted_speed =
        case.slack_decrease_rate_per_s() * (case.neighbor_vectors[0].norm() - case.distance_min);
    let v_m_s = (0.97 * granted_speed).min(case.v_max);
    case.twist_in_force = case.build_guard().scale_into_twist_set(Twist::new(v_m_s, 0.0));
    case.requested_twist = case.twist_in_force;
    case
}

/// Draws a case of a transition from turning on the spot to passing another robot: if speed and turn rate changed
/// independently, the robot would move towards the other.
fn draw_case_turning_then_passing(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
    case.lifetime = draw_uniform(rng, 0.1, 0.3);
    case.set_accelerations(case.v_max / 0.05, case.turn_rate_bound());
    let side = draw_element(rng, &[1.0, -1.0]);
    case.place_neighbor(
        draw_uniform(rng, 0.0, 0.5) * case.v_max,
        side * draw_uniform(rng, 0.3, 1.5),
    );
    let fraction = draw_uniform(rng, 0.05, 0.7);
    case.twist_in_force = case
        .build_guard()
        .scale_into_twist_set(Twist::new(0.0, side * fraction * case.turn_rate_bound()));
    let w_rad_s = -0.2 * side / if case.ell > 0.0 { case.ell } else { 1.0 };
    case.requested_twist = Twist::new(draw_uniform(rng, 0.2, 1.0) * case.v_max, w_rad_s);
    case
}

/// Draws a case of passing a robot that is where an unexpired command would turn this robot to. All robots stop at
/// once.
fn draw_case_turned_towards_neighbor(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
    (case.limits, case.braking_time_max) = (None, 0.0);
    case.lifetime = draw_uniform(rng, 0.1, 0.3);
    let side = draw_element(rng, &[1.0, -1.0]);
    case.place_neighbor(
        draw_uniform(rng, 0.0, 0.5) * case.v_max,
        side * draw_uniform(rng, 0.3, 1.5),
    );
    case.requested_twist = Twist::new(draw_uniform(rng, 0.2, 1.0) * case.v_max, 0.0);
    case.unexpired_commands = vec![case.turning_twist(side); 3];
    case
}

type DrawCase = fn(&mut SplitMix64, ControlledPoint) -> GuardCase;

/// Draws a case whose requested path leads straight to a wall.
fn draw_case_driving_at_wall(rng: &mut SplitMix64, body: ControlledPoint) -> GuardCase {
    let mut case = GuardCase::draw_robot_without_neighbors(rng, body);
    let slack = draw_uniform(rng, 0.0, 0.5) * case.v_max / case.slack_decrease_rate_per_s();
    case.place_wall(slack, case.heading + draw_uniform(rng, -1.0, 1.0), rng);
    case.requested_twist = case.build_guard().scale_into_twist_set(Twist::new(case.v_max, 0.0));
    case.twist_in_force = case.requested_twist.scale_by(draw_uniform(rng, 0.0, 1.0).powi(2));
    case
}

/// Disabled parts, cases constructed to show their effect, and the bodies that it concerns.
const ABLATIONS: [(DisabledCertificatePart, Ramp, DrawCase, &[ControlledPoint]); 10] = [
    (DisabledCertificatePart::TwistInForce, Ramp::Together, draw_head_on_case, &CONTROLLED_POINTS),
    (
        DisabledCertificatePart::UnexpiredCommands,
        Ramp::Together,
        draw_case_commanded_at_neighbor,
        &CONTROLLED_POINTS,
    ),
    (
        DisabledCertificatePart::UnexpiredCommands,
        Ramp::Together,
        draw_case_turned_towards_neighbor,
        &TURNING_POINTS,
    ),
    (
        DisabledCertificatePart::BrakingPath,
        Ramp::Together,
        draw_overtaking_case,
        &CONTROLLED_POINTS,
    ),
    (
        DisabledCertificatePart::BrakingTurn,
        Ramp::Together,
        draw_case_turning_towards_neighbor,
        &HEADING_POINTS,
    ),
    (
        DisabledCertificatePart::ApproachSpeedFactor,
        Ramp::Together,
        draw_case_braking_towards_neighbor,
        &CONTROLLED_POINTS,
    ),
    (
        DisabledCertificatePart::HeadingRange,
        Ramp::Together,
        draw_case_turned_towards_neighbor,
        &HEADING_POINTS,
    ),
    (
        DisabledCertificatePart::TurningInPlace,
        Ramp::Together,
        draw_case_turned_towards_neighbor,
        &TURNING_POINTS,
    ),
    (
        DisabledCertificatePart::NeighborSpeed,
        Ramp::Together,
        draw_overtaking_case,
        &CONTROLLED_POINTS,
    ),
    (
        DisabledCertificatePart::Nothing,
        Ramp::Independent,
        draw_case_turning_then_passing,
        &CONTROLLED_POINTS,
    ),
];

#[test]
fn certified_twists_use_up_at_most_half_of_the_slack() {
    for body in CONTROLLED_POINTS {
        count_violations(
            3000,
            DisabledCertificatePart::Nothing,
            Ramp::Together,
            body,
            GuardCase::draw_case,
        );
        count_violations(
            1000,
            DisabledCertificatePart::Nothing,
            Ramp::Together,
            body,
            draw_case_driving_at_wall,
        );
        // Cases constructed to violate it.
        for (_, _, draw_case, _) in ABLATIONS {
            count_violations(
                100,
                DisabledCertificatePart::Nothing,
                Ramp::Together,
                body,
                draw_case,
            );
        }
    }
}

#[test]
fn certified_twist_is_safe_for_all_headings_and_directions() {
    for seed in 0..12_000 {
        let mut rng = SplitMix64::new(seed);
        let case = GuardCase::draw_case(
            &mut rng,
            CONTROLLED_POINTS[seed as usize % CONTROLLED_POINTS.len()],
        );
        let worst = case.worst_case_excess(&mut rng).unwrap_or(0.0);
        assert!(worst <= TOLERANCE_M_S, "{worst}: {case:?}");
    }
}

/// Compares with an independent selection of the best scale.
#[test]
fn best_of_the_tried_scales_is_granted() {
    for seed in 0..3000 {
        let mut rng = SplitMix64::new(seed);
        let case = GuardCase::draw_case(
            &mut rng,
            CONTROLLED_POINTS[seed as usize % CONTROLLED_POINTS.len()],
        );
        let GuardCase { twist_in_force: now, requested_twist: requested, ell, .. } = case;
        case.with_sample(case.heading, &mut rng, |sample| {
            let mut guard = case.build_guard();
            let granted = guard.certify(sample, requested);
            let mut tried = |twist: Twist| {
                let tried = guard.clamp_to_reachable(now, guard.scale_into_twist_set(twist));
                guard.grant_twist(sample, now, tried).map(|granted| (granted, granted == tried))
            };
            let merit = |twist: Twist| {
                twist.v_m_s * requested.v_m_s
                    + twist.side_m_s * requested.side_m_s
                    + ell * twist.w_rad_s * (ell * requested.w_rad_s)
            };
            let scales: Vec<_> = [1.0, 0.5, 0.25]
                .iter()
                .filter_map(|sigma| tried(requested.scale_by(*sigma)))
                .collect();
            let best = scales.iter().map(|(twist, _)| merit(*twist)).fold(0.0, f64::max);
            match (tried(requested), scales.first()) {
                (Some((unscaled, true)), _) => assert_eq!(granted, unscaled, "{case:?}"),
                (_, Some((first, _))) if best == 0.0 => assert_eq!(granted, *first, "{case:?}"),
                (_, Some(_)) => assert!((merit(granted) - best).abs() < 1e-12, "{case:?}"),
                (_, None) => {
                    let fallback = tried(now).map_or(Twist::ZERO, |(twist, _)| twist);
                    assert_eq!(granted, fallback, "{case:?}");
                }
            }
        });
    }
}

#[test]
fn lemma_is_violated_without_any_of_its_parts() {
    let ablations = ABLATIONS.into_iter().flat_map(|(disabled_part, ramp, draw_case, bodies)| {
        bodies.iter().map(move |&body| (disabled_part, ramp, draw_case, body))
    });
    for (disabled_part, ramp, draw_case, body) in ablations {
        let (count, worst) = count_violations(1000, disabled_part, ramp, body, draw_case);
        // Where ell = 0, velocity and turn rate may change independently.
        if body != ControlledPoint::FrontPoint && disabled_part == DisabledCertificatePart::Nothing
        {
            assert_eq!(count, 0, "{worst}");
            continue;
        }
        assert!(
            count > 0 && worst > 1e-4,
            "{body:?}, {disabled_part:?}, {ramp:?}: {count} of 1000, {worst}"
        );
    }
}

/// Other robots rely on the speed limit, also while speed and turn rate change independently of each other.
#[test]
fn corners_of_independent_ramps_are_at_most_as_fast_as_v_max() {
    let mut count = 0;
    for seed in 0..3000 {
        let mut rng = SplitMix64::new(seed);
        let mut case = GuardCase::draw_case(&mut rng, ControlledPoint::FrontPointIndependentRamps);
        if case.limits.is_none() {
            continue;
        }
        // It reaches any twist within the command timeout.
        let ramp_s = 0.2 * case.lifetime;
        case.set_accelerations(case.v_max / ramp_s, case.turn_rate_bound() / ramp_s);
        let mut guard = case.build_guard();
        guard.unexpired_commands =
            case.unexpired_commands.iter().map(|twist| (0, *twist)).collect();
        let now = case.twist_in_force;
        let tried = guard.clamp_to_reachable(now, guard.scale_into_twist_set(case.requested_twist));
        let granted = case
            .with_sample(case.heading, &mut rng, |sample| guard.grant_twist(sample, now, tried));
        let Some(granted) = granted else { continue };
        let in_force = || case.unexpired_commands.iter().chain([&now, &granted]);
        let v_m_s = in_force().map(|twist| twist.v_m_s.abs()).fold(0.0, f64::max);
        let w_rad_s = in_force().map(|twist| twist.w_rad_s.abs()).fold(0.0, f64::max);
        let fastest = front_speed(case.ell, Twist::new(v_m_s, w_rad_s));
        assert!(fastest <= case.v_max * (1.0 + 1e-9), "{fastest}: {case:?}");
        count += usize::from(granted != Twist::ZERO);
    }
    assert!(count > 300, "{count} cases");
}
