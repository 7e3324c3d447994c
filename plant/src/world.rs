//! State of all robots: bodies under commands that expire, and what each robot senses.
//!
//! This module does no I/O: commands and time in, odometry and ground truth out. Half of the guarantee of the
//! guard is implemented here: a command is in effect only until the stamp it answers + H, late and out-of-order
//! commands are refused, and with a speed limit hypot(v, ell w) never exceeds it. At the axle midpoint the turn rate is
//! limited by itself. The Coq model of this rule is
//! `proof/Plant.v::in_force`. A robot with acceleration limits moves towards the command in force, and towards
//! 0 without one, within these limits.

mod walls;

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::front_point::{front_point, front_speed, front_velocity};
use formation::neighbor_list::NeighborList;
use formation::pose::{Pose, Twist, wrap_angle};
use protocol::brief::{BodyBrief, Pace, PlantBrief};
use protocol::fault::{Sensor, SensorFault, SensorFaultKind, Transmission, WheelFaultKind};
use protocol::link::FaultyLink;
use protocol::message::{Command, Odometry, PROXIMITY_MAX, TruthHeader, TruthRow};

use crate::motion::{BodyState, Motion, UnicycleMotion};
use walls::Walls;

/// Relative excess over the speed limit that counts as rounding.
const RELATIVE_SPEED_TOLERANCE: f64 = 1e-9;

/// State of all robots at one instant, and accumulated events.
pub struct World<M = UnicycleMotion> {
    start_ns: u64,
    t_ns: u64,
    tick: u64,
    arc_duration_max_ns: u64,
    command_lifetime_ns: u64,
    distance_min_m: f64,
    /// `true` in a team: each pair of robots has its own minimum distance, the sum of their sizes.
    has_pair_distances: bool,
    speed_max_m_s: Option<f64>,
    sensing_radius_m: f64,
    senses_velocities: bool,
    robots: Vec<SimulatedRobot>,
    motion: M,
    /// Pose and twist of each robot. The twist is that of the last arc or, with acceleration limits, that at its end.
    states: Vec<BodyState>,
    /// Target twist of each robot during the current arc.
    target_twists: Vec<Twist>,
    front_points: Vec<Vec2>,
    /// Pairs within the sensing radius, and within the distance of every pair that is or may become the
    /// closest.
    neighbor_list: NeighborList,
    closest_pair: Option<(ClosestPair, u64)>,
    distance_violations: u64,
    walls: Walls,
    counters: CommandCounters,
}

struct SimulatedRobot {
    body: BodyBrief,
    has_command: bool,
    command_in_force: Option<CommandInForce>,
    /// Key (incarnation, stamp, sequence) of the newest command accepted.
    newest_command_key: Option<(u64, u64, u64)>,
    /// Link over which the robot's commands arrive.
    command_link: FaultyLink<Command>,
}

/// A command in force.
struct CommandInForce {
    twist: Twist,
    /// Stamp of the sample that it answers.
    stamp_ns: u64,
    expires_ns: u64,
}

#[derive(Debug, Clone, Copy, Default)]
struct CommandCounters {
    late: u64,
    not_newer: u64,
    not_finite: u64,
    scaled: u64,
    expired: u64,
    age_ns_max: u64,
}

/// Reason why a command was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CommandRefusal {
    /// A number in the command is NaN, infinite or not plausible.
    #[error("not finite, or not plausible")]
    NotFinite,
    /// The answered sample is in the future, or too old.
    #[error("late, or from the future")]
    Late,
    /// The command is not newer, by (incarnation, stamp, sequence), than the newest one accepted.
    #[error("older than the newest accepted")]
    NotNewer,
}

impl World {
    /// Creates the state at t = 0 with all robots at rest at their start poses, moved by exact unicycle motion.
    pub fn new(brief: &PlantBrief) -> World {
        World::with_motion(UnicycleMotion::new(brief), brief)
    }

    /// Advances like [`World::try_advance`], which cannot fail with unicycles.
    pub fn advance(&mut self, t_ns: u64) {
        let Ok(()) = self.try_advance(t_ns);
    }
}

impl<M: Motion> World<M> {
    /// Creates the state at t = 0 with all robots at rest at their start poses, moved by `motion`.
    pub fn with_motion(motion: M, brief: &PlantBrief) -> World<M> {
        let robots: Vec<SimulatedRobot> = brief
            .robots
            .iter()
            .map(|body| SimulatedRobot {
                body: body.clone(),
                has_command: false,
                command_in_force: None,
                newest_command_key: None,
                command_link: FaultyLink::new(&body.command_faults),
            })
            .collect();
        let at_rest = |body: &BodyBrief| BodyState { pose: body.start, twist: Twist::ZERO };
        let states = brief.robots.iter().map(at_rest).collect();
        let arc_duration_max_ns = match brief.pace {
            Pace::Lockstep => brief.period_ns,
            Pace::Realtime => brief.plant_tick_ns,
        };
        let start = |body: &BodyBrief| front_point(body.start, body.front_point_m);
        let alphas: Vec<Vec2> = brief.robots.iter().map(start).collect();
        let closest = closest_pair(&alphas);
        let closest_distance_m = closest.map_or(0.0, |pair| pair.distance_m);
        let members = brief.robots.iter().filter_map(|body| body.member);
        let keep_m_max = members.map(|member| member.keep_m).fold(0.0, f64::max);
        let keep_distance_max_m = brief.distance_min_m.max(2.0 * keep_m_max);
        let reach_m = brief.sensing_radius_m.max(keep_distance_max_m).max(closest_distance_m);
        let mut neighbor_list = NeighborList::new(reach_m);
        neighbor_list.update(&alphas);
        let mut walls = Walls::new(brief);
        walls.update(&alphas, 0);
        let mut world = World {
            walls,
            start_ns: 0,
            t_ns: 0,
            tick: 0,
            arc_duration_max_ns,
            command_lifetime_ns: brief.command_lifetime_ns,
            distance_min_m: brief.distance_min_m,
            has_pair_distances: keep_m_max > 0.0,
            speed_max_m_s: brief.speed_max_m_s,
            sensing_radius_m: brief.sensing_radius_m,
            senses_velocities: brief.velocities_sensed,
            front_points: alphas,
            neighbor_list,
            motion,
            states,
            target_twists: Vec::with_capacity(robots.len()),
            robots,
            closest_pair: closest.map(|pair| (pair, 0)),
            distance_violations: 0,
            counters: CommandCounters::default(),
        };
        world.distance_violations = u64::from(world.has_pair_below_minimum(closest));
        world
    }

    /// Returns `true` if any pair is closer than its minimum distance. `closest` is the closest pair.
    fn has_pair_below_minimum(&self, closest: Option<ClosestPair>) -> bool {
        if !self.has_pair_distances {
            return closest.is_some_and(|pair| pair.distance_m < self.distance_min_m);
        }
        let keep_m = |robot: usize| self.robots[robot].body.member.map_or(0.0, |own| own.keep_m);
        (0..self.front_points.len()).any(|i| {
            let mut later = self.neighbor_list.neighbors_of(i).filter(|&j| j > i);
            later.any(|j| {
                (self.front_points[i] - self.front_points[j]).norm() < keep_m(i) + keep_m(j)
            })
        })
    }

    /// Sets the stamp of t = 0 (real time only). In lockstep stamps are simulated times.
    pub fn start_at(&mut self, stamp_ns: u64) {
        self.start_ns = stamp_ns;
    }

    /// Returns the time since the start, ns.
    pub fn t_ns(&self) -> u64 {
        self.t_ns
    }

    /// Returns the number of the current sample.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    fn stamp_ns(&self) -> u64 {
        self.start_ns + self.t_ns
    }

    /// Increments the plant tick: odometry and ground truth belong to the next sample from now on. Returns the
    /// new tick.
    pub fn increment_tick(&mut self) -> u64 {
        self.tick += 1;
        self.tick
    }

    /// Receives a command sent now. It is dropped or delayed if faults say so, and accepted at once otherwise.
    /// Returns why it was refused, if it was.
    pub fn receive_command(
        &mut self,
        robot: usize,
        command: &Command,
    ) -> Result<(), CommandRefusal> {
        let link = &mut self.robots[robot].command_link;
        if link.is_transparent() {
            return self.accept_command(robot, command);
        }
        let transmission = Transmission { tick: command.tick, t_ns: self.t_ns, distance_m: None };
        match link.send(command, transmission) {
            Some(command) => self.accept_command(robot, &command),
            None => Ok(()),
        }
    }

    /// Counts the refusal of a command from a dead incarnation.
    pub fn count_command_of_dead_incarnation(&mut self) {
        self.counters.not_newer += 1;
    }

    /// Accepts the delayed commands that are due. Refusals are counted.
    pub fn accept_due_commands(&mut self) {
        for robot in 0..self.robots.len() {
            while let Some(command) = self.robots[robot].command_link.next_due_message(self.t_ns) {
                // Overtaken commands, and those that jitter delayed for too long, are refused.
                let _ = self.accept_command(robot, &command);
            }
        }
    }

    /// Puts `command` into effect for `robot`: `proof/Plant.v::accept`, and the scaling of
    /// `proof/Motion.v::obeys`. Returns why it was refused, if it was.
    pub fn accept_command(
        &mut self,
        robot: usize,
        command: &Command,
    ) -> Result<(), CommandRefusal> {
        let now_ns = self.stamp_ns();
        let member = self.robots[robot].body.member;
        let lifetime_ns =
            member.map_or(self.command_lifetime_ns, |member| member.command_lifetime_ns);
        let expires_ns = command.stamp_ns.saturating_add(lifetime_ns);
        let order = (command.incarnation, command.stamp_ns, command.sequence);
        let mut twist = command.twist();
        if !command.is_plausible() {
            self.counters.not_finite += 1;
            return Err(CommandRefusal::NotFinite);
        }
        if command.stamp_ns > now_ns || now_ns >= expires_ns {
            self.counters.late += 1;
            return Err(CommandRefusal::Late);
        }
        let robot = &mut self.robots[robot];
        if robot.newest_command_key.is_some_and(|newest| order <= newest) {
            self.counters.not_newer += 1;
            return Err(CommandRefusal::NotNewer);
        }
        let speed_max_m_s = member.map_or(self.speed_max_m_s, |member| member.speed_max_m_s);
        if let Some(speed_max) = speed_max_m_s {
            let speed = front_speed(robot.body.front_point_m, twist);
            self.counters.scaled += u64::from(speed > speed_max * (1.0 + RELATIVE_SPEED_TOLERANCE));
        }
        twist = robot.body.drive().clamp(speed_max_m_s.unwrap_or(f64::INFINITY), twist);
        robot.newest_command_key = Some(order);
        let (twist, stamp_ns) = (robot.body.clamp_to_wheel_limits(twist), command.stamp_ns);
        robot.command_in_force = Some(CommandInForce { twist, stamp_ns, expires_ns });
        Ok(())
    }

    /// Advances to `t_ns` since the start, in arcs that end when a command expires and when a wheel fault
    /// starts or ends: `proof/Plant.v::in_force`, `proof/Motion.v::obeys`, `proof/Motion.v::moves` and
    /// `proof/Motion.v::an_arc_moves_like_this`.
    pub fn try_advance(&mut self, t_ns: u64) -> Result<(), M::Error> {
        while self.t_ns < t_ns {
            let now_ns = self.stamp_ns();
            let mut end_ns = (self.start_ns + t_ns).min(now_ns + self.arc_duration_max_ns);
            for robot in &mut self.robots {
                if robot
                    .command_in_force
                    .as_ref()
                    .is_some_and(|in_force| in_force.expires_ns <= now_ns)
                {
                    robot.command_in_force = None;
                    self.counters.expired += 1;
                }
                if let Some(in_force) = &robot.command_in_force {
                    end_ns = end_ns.min(in_force.expires_ns);
                }
                for fault in &robot.body.wheel_faults {
                    let bound_ns = fault.span.next_bound_ns(self.t_ns);
                    end_ns = end_ns.min(bound_ns.map_or(u64::MAX, |t_ns| self.start_ns + t_ns));
                }
            }
            let dt_s = (end_ns - now_ns) as f64 / 1e9;
            self.target_twists.clear();
            for robot in &mut self.robots {
                robot.has_command = robot.command_in_force.is_some();
                if let Some(in_force) = &robot.command_in_force {
                    let age_ns = end_ns - in_force.stamp_ns;
                    self.counters.age_ns_max = self.counters.age_ns_max.max(age_ns);
                }
                self.target_twists.push(
                    robot.command_in_force.as_ref().map_or(Twist::ZERO, |in_force| {
                        robot.body.clamp_to_failing_wheels(in_force.twist, self.t_ns)
                    }),
                );
            }
            self.motion.step(&self.target_twists, dt_s, &mut self.states)?;
            self.t_ns = end_ns - self.start_ns;
            self.update_closest_pair();
        }
        Ok(())
    }

    /// Updates the front points, the closest pair and the counters.
    fn update_closest_pair(&mut self) {
        for ((alpha, robot), state) in
            self.front_points.iter_mut().zip(&self.robots).zip(&self.states)
        {
            *alpha = front_point(state.pose, robot.body.front_point_m);
        }
        self.walls.update(&self.front_points, self.t_ns);
        self.neighbor_list.update(&self.front_points);
        // A pair missing from the neighbor list cannot be a new closest pair.
        let closest = self.neighbor_list.closest_pair(&self.front_points);
        self.distance_violations += u64::from(self.has_pair_below_minimum(closest));
        if let Some(pair) = closest
            && self.closest_pair.is_none_or(|(closest, _)| pair.distance_m < closest.distance_m)
        {
            self.closest_pair = Some((pair, self.t_ns));
        }
    }

    /// Returns the current odometry sample of `robot`.
    pub fn odometry(&self, robot: usize) -> Odometry {
        let mut sample = Odometry::default();
        self.sense(robot, &mut sample);
        sample
    }

    /// Writes the current odometry of `robot` into `sample`: a new one, or an earlier one of this robot. Fields of a
    /// sensor in dropout (blackout) become 0. List entries beyond the length of their list stay as they are.
    pub fn sense(&self, robot: usize, sample: &mut Odometry) {
        let body = &self.robots[robot].body;
        let is_working = |sensor| {
            !self
                .active_sensor_faults(body, sensor)
                .any(|fault| fault.kind == SensorFaultKind::Blackout)
        };
        sample.tick = self.tick;
        sample.t_ns = self.t_ns;
        sample.stamp_ns = self.stamp_ns();
        sample.velocities_sensed = u32::from(self.senses_velocities);
        let own_state = is_working(Sensor::Odometry).then(|| self.sensed_own_state(robot));
        sample.set_own_state(own_state);
        sample.clear_proximity();
        if is_working(Sensor::Proximity) {
            self.sense_neighbors(robot, sample);
            let radius_m = self.sensing_radius_m;
            // Noise items of walls are numbered after those of the other front points.
            let noise_m = |item| {
                self.position_noise_m(body, Sensor::Proximity, (PROXIMITY_MAX + item) as u64)
            };
            self.walls.sense_walls(self.front_points[robot], radius_m, noise_m, sample);
        }
    }

    /// Returns the sensed pose and twist.
    fn sensed_own_state(&self, robot: usize) -> (Pose, Twist) {
        let body = &self.robots[robot].body;
        let BodyState { pose, twist } = self.states[robot];
        let noise = self.position_noise_m(body, Sensor::Odometry, 0);
        let pose = Pose {
            x_m: pose.x_m + noise.x,
            y_m: pose.y_m + noise.y,
            heading_rad: wrap_angle(pose.heading_rad + self.heading_noise_rad(body)),
        };
        (pose, twist)
    }

    /// Fills in the neighbors in range.
    fn sense_neighbors(&self, robot: usize, sample: &mut Odometry) {
        let body = &self.robots[robot].body;
        let (radius_m, own) = (self.sensing_radius_m, self.front_points[robot]);
        let count_max = if self.senses_velocities { PROXIMITY_MAX / 2 } else { PROXIMITY_MAX };
        let mut nearest = [(0.0, 0); PROXIMITY_MAX];
        let mut in_range_count = 0;
        for other in self.neighbor_list.neighbors_of(robot) {
            let distance = (self.front_points[other] - own).norm();
            if distance <= radius_m {
                let count = in_range_count.min(count_max);
                in_range_count += 1;
                // Inserted after neighbors at the same distance, so that these stay in scenario order.
                let mut index = count;
                while index > 0 && nearest[index - 1].0 > distance {
                    if index < count_max {
                        nearest[index] = nearest[index - 1];
                    }
                    index -= 1;
                }
                if index < count_max {
                    nearest[index] = (distance, other);
                }
            }
        }
        let count = in_range_count.min(count_max);
        for (item, &(_, other)) in nearest[..count].iter().enumerate() {
            let noise = self.position_noise_m(body, Sensor::Proximity, item as u64 + 1);
            sample.near[item] = (self.front_points[other] + noise).into();
        }
        if self.has_pair_distances {
            for (class, (_, other)) in sample.near_class.iter_mut().zip(&nearest[..count]) {
                *class = self.robots[*other].body.member.map_or(0, |member| member.class);
            }
        }
        if self.senses_velocities {
            for (sensed, (_, other)) in sample.near[count_max..].iter_mut().zip(&nearest[..count]) {
                let front_point_m = self.robots[*other].body.front_point_m;
                let BodyState { pose, twist } = self.states[*other];
                let velocity = front_velocity(pose.heading_rad, front_point_m, twist);
                *sensed = velocity.into();
            }
        }
        sample.proximity_valid = 1;
        sample.proximity_cut = u32::from(in_range_count > count_max);
        sample.proximity_count = count as u32;
    }

    /// Returns the noise of the position with number `item` in this tick's sample, m.
    #[inline(always)]
    fn position_noise_m(&self, body: &BodyBrief, sensor: Sensor, item: u64) -> Vec2 {
        // Most robots have no faulty sensor. `Vec2::zeros` would be a call with a loop here.
        match body.sensor_faults.is_empty() {
            true => Vec2::new(0.0, 0.0),
            false => self.fault_noise_m(body, sensor, item),
        }
    }

    fn fault_noise_m(&self, body: &BodyBrief, sensor: Sensor, item: u64) -> Vec2 {
        let faults = self.active_sensor_faults(body, sensor);
        faults.map(|fault| Vec2::from(fault.position_error_m(self.tick, item))).sum()
    }

    /// Returns the noise of the heading in this tick's sample, rad.
    fn heading_noise_rad(&self, body: &BodyBrief) -> f64 {
        let faults = self.active_sensor_faults(body, Sensor::Odometry);
        faults.map(|fault| fault.heading_error_rad(self.tick)).sum()
    }

    /// Returns the active faults of this sensor.
    fn active_sensor_faults<'b>(
        &self,
        body: &'b BodyBrief,
        sensor: Sensor,
    ) -> impl Iterator<Item = &'b SensorFault> {
        let t_ns = self.t_ns;
        let faults = body.sensor_faults.iter();
        faults.filter(move |fault| fault.sensor == sensor && fault.span.contains(t_ns))
    }

    /// Returns the time of this ground truth, and the events up to it.
    pub fn truth_header(&self) -> TruthHeader {
        let (closest, closest_t_ns) = self
            .closest_pair
            .unwrap_or((ClosestPair { pair: [0, 0], distance_m: f64::INFINITY }, 0));
        let clearance = self.walls.smallest_clearance();
        TruthHeader {
            tick: self.tick,
            t_ns: self.t_ns,
            stamp_ns: self.stamp_ns(),
            sent_ns: 0,
            closest_m: closest.distance_m,
            closest_t_ns,
            closest_pair: closest.pair.map(|robot| robot as u32),
            violations: self.distance_violations,
            clearance_m: clearance.distance_m,
            clearance_t_ns: clearance.t_ns,
            clearance_at_m: clearance.front_point.into(),
            clearance_between: clearance.robot_and_wall_indices.map(|index| index as u32),
            clearance_violations: self.walls.violations(),
            commands_late: self.counters.late,
            commands_old: self.counters.not_newer,
            commands_not_finite: self.counters.not_finite,
            commands_scaled: self.counters.scaled,
            commands_expired: self.counters.expired,
            command_age_ns_max: self.counters.age_ns_max,
        }
    }

    /// Returns the true states of all robots, in scenario order.
    pub fn truth(&self) -> impl ExactSizeIterator<Item = TruthRow> {
        self.robots.iter().zip(&self.states).map(|(robot, BodyState { pose, twist })| TruthRow {
            x_m: pose.x_m,
            y_m: pose.y_m,
            heading_rad: pose.heading_rad,
            v_m_s: twist.v_m_s,
            side_m_s: twist.side_m_s,
            w_rad_s: twist.w_rad_s,
            commanded: u64::from(robot.has_command),
        })
    }
}

/// Scaling of a twist to what the wheels can execute: always a fraction of it, as `proof/Motion.v::obeys`
/// requires.
trait WheelLimits {
    /// Returns `twist`, scaled down until no wheel exceeds its speed limit.
    fn clamp_to_wheel_limits(&self, twist: Twist) -> Twist;
    /// Returns `twist`, scaled down to what failing wheels can execute at `t_ns`.
    fn clamp_to_failing_wheels(&self, twist: Twist, t_ns: u64) -> Twist;
}

impl WheelLimits for BodyBrief {
    fn clamp_to_wheel_limits(&self, twist: Twist) -> Twist {
        match &self.wheels {
            Some(wheels) => limit_wheel_speed(twist, wheels.speed_max_m_s, wheels.track_m),
            None => twist,
        }
    }

    fn clamp_to_failing_wheels(&self, twist: Twist, t_ns: u64) -> Twist {
        // Without wheels in the brief, a track that limits the speed of the front point is assumed.
        let track_m = self.wheels.map_or(2.0 * self.front_point_m, |wheels| wheels.track_m);
        let active = self.wheel_faults.iter().filter(|fault| fault.span.contains(t_ns));
        active.fold(twist, |twist, fault| match fault.kind {
            WheelFaultKind::Stuck => Twist::ZERO,
            WheelFaultKind::Limit { speed_max_m_s } => {
                limit_wheel_speed(twist, speed_max_m_s, track_m)
            }
        })
    }
}

/// Returns `twist`, scaled down until no wheel of an axle with the track `track_m` exceeds `speed_max_m_s`.
fn limit_wheel_speed(twist: Twist, speed_max_m_s: f64, track_m: f64) -> Twist {
    let fastest = twist.planar_speed_m_s() + 0.5 * track_m * twist.w_rad_s.abs();
    // At rest the quotient may be NaN, and `min` returns the other value.
    twist.scale_by((speed_max_m_s / fastest).min(1.0))
}

#[cfg(test)]
mod inertia;
#[cfg(test)]
mod proof;
#[cfg(test)]
mod tests;
