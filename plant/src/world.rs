//! The world: bodies under commands that die, and what each robot senses.
//!
//! Pure: commands and time in, odometry and truth out. Half of the guard's promise lives here: a
//! command acts only until the stamp it answers + H, late and out-of-order ones are refused, and
//! with a speed limit hypot(v, ell w) never exceeds it. The rule stands once more, for
//! Coq, in `proof/Plant.v::in_force`. A robot with limits goes towards the command in force, and
//! towards 0 where there is none, no faster than they allow.

mod walls;

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::front_point::{front_point, front_speed, front_velocity};
use formation::near::NearPairs;
use formation::pose::{Twist, wrap_angle};
use protocol::brief::{BodyBrief, Pace, PlantBrief};
use protocol::fault::{Said, Sensor, SensorFault, SensorFaultKind, WheelFaultKind};
use protocol::link::Link;
use protocol::message::{Command, Odometry, PROXIMITY_MAX, TruthHeader, TruthRow};

use crate::motion::{Motion, State, Unicycles};
use walls::Walls;

/// Speeds above the limit by less than this share are rounding, not worth counting.
const SPEED_TOLERANCE: f64 = 1e-9;

/// All robots at one instant, and what happened so far.
pub struct World<M = Unicycles> {
    start_ns: u64,
    t_ns: u64,
    tick: u64,
    arc_ns_max: u64,
    command_lifetime_ns: u64,
    distance_min_m: f64,
    speed_max_m_s: Option<f64>,
    sensing_radius_m: f64,
    velocities_sensed: bool,
    robots: Vec<Robot>,
    motion: M,
    /// Twists: over the whole of the last arc, or, with limits, at its end.
    states: Vec<State>,
    /// What each is to do over the arc at hand.
    targets: Vec<Twist>,
    alphas: Vec<Vec2>,
    /// As far as anybody senses, and as any pair that is or will be worth telling of is apart.
    near: NearPairs,
    closest: Option<(ClosestPair, u64)>,
    violations: u64,
    walls: Walls,
    counters: Counters,
}

struct Robot {
    body: BodyBrief,
    commanded: bool,
    obeyed: Option<Obeyed>,
    /// (incarnation, stamp, sequence) of the newest command accepted.
    newest: Option<(u64, u64, u64)>,
    /// On which its commands come.
    link: Link<Command>,
}

/// A command in force.
struct Obeyed {
    twist: Twist,
    /// Of the sample that it answers.
    stamp_ns: u64,
    dies_ns: u64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Counters {
    late: u64,
    old: u64,
    not_finite: u64,
    scaled: u64,
    expired: u64,
    age_ns_max: u64,
}

/// Why a command was not obeyed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// A number in it is NaN, infinite, or larger than any robot's.
    #[error("not finite, or not plausible")]
    NotFinite,
    /// It answers a sample that is not yet, or is too old to be acted on.
    #[error("late, or from the future")]
    Late,
    /// Not newer, by (incarnation, stamp, sequence), than the newest one accepted.
    #[error("older than the newest accepted")]
    Old,
}

impl World {
    /// Everybody at the start, at t = 0, standing; they move as unicycles do.
    pub fn new(brief: &PlantBrief) -> World {
        World::moved_by(Unicycles::new(brief), brief)
    }

    /// The same as [`World::try_advance`], which cannot fail with unicycles.
    pub fn advance(&mut self, t_ns: u64) {
        let Ok(()) = self.try_advance(t_ns);
    }
}

impl<M: Motion> World<M> {
    /// Everybody at the start, at t = 0, standing; something else moves them.
    pub fn moved_by(motion: M, brief: &PlantBrief) -> World<M> {
        let robots: Vec<Robot> = brief
            .robots
            .iter()
            .map(|body| Robot {
                body: body.clone(),
                commanded: false,
                obeyed: None,
                newest: None,
                link: Link::new(&body.command_faults),
            })
            .collect();
        let standing = |body: &BodyBrief| State { pose: body.start, twist: Twist::ZERO };
        let states = brief.robots.iter().map(standing).collect();
        let arc_ns_max = match brief.pace {
            Pace::Lockstep => brief.period_ns,
            Pace::Realtime => brief.plant_tick_ns,
        };
        let start = |body: &BodyBrief| front_point(body.start, body.front_point_m);
        let alphas: Vec<Vec2> = brief.robots.iter().map(start).collect();
        let closest = closest_pair(&alphas);
        let apart_m = closest.map_or(0.0, |pair| pair.distance_m);
        let reach_m = brief.sensing_radius_m.max(brief.distance_min_m).max(apart_m);
        let mut near = NearPairs::new(reach_m);
        near.update(&alphas);
        let mut walls = Walls::new(brief);
        walls.look(&alphas, 0);
        World {
            walls,
            start_ns: 0,
            t_ns: 0,
            tick: 0,
            arc_ns_max,
            command_lifetime_ns: brief.command_lifetime_ns,
            distance_min_m: brief.distance_min_m,
            speed_max_m_s: brief.speed_max_m_s,
            sensing_radius_m: brief.sensing_radius_m,
            velocities_sensed: brief.velocities_sensed,
            alphas,
            near,
            motion,
            states,
            targets: Vec::with_capacity(robots.len()),
            robots,
            closest: closest.map(|pair| (pair, 0)),
            violations: closest.map_or(0, |pair| u64::from(pair.distance_m < brief.distance_min_m)),
            counters: Counters::default(),
        }
    }

    /// In real time, t = 0 is at this stamp; in lockstep stamps are times.
    pub fn start_at(&mut self, stamp_ns: u64) {
        self.start_ns = stamp_ns;
    }

    /// Time since the start, ns.
    pub fn t_ns(&self) -> u64 {
        self.t_ns
    }

    fn stamp_ns(&self) -> u64 {
        self.start_ns + self.t_ns
    }

    /// Counts one plant tick: what odometry and truth say from now on is the next sample.
    pub fn next_tick(&mut self) -> u64 {
        self.tick += 1;
        self.tick
    }

    /// Takes a command that is sent now: it is lost or held back where faults say so, and else accepted
    /// at once.
    pub fn take(&mut self, robot: usize, command: &Command) -> Result<(), Refusal> {
        let said = Said { tick: command.tick, t_ns: self.t_ns, distance_m: None };
        match self.robots[robot].link.pass(command, said) {
            Some(command) => self.accept(robot, &command),
            None => Ok(()),
        }
    }

    /// Accepts what was held back and is due by now; refusals are counted.
    pub fn take_due(&mut self) {
        for robot in 0..self.robots.len() {
            while let Some(command) = self.robots[robot].link.due(self.t_ns) {
                // One that was overtaken is refused, and one that jitter kept for too long.
                let _ = self.accept(robot, &command);
            }
        }
    }

    /// Lets `robot` obey `command` from now on: `proof/Plant.v::accept`, and the scaling of
    /// `proof/Motion.v::obeys`.
    pub fn accept(&mut self, robot: usize, command: &Command) -> Result<(), Refusal> {
        let now_ns = self.stamp_ns();
        let dies_ns = command.stamp_ns.saturating_add(self.command_lifetime_ns);
        let order = (command.incarnation, command.stamp_ns, command.sequence);
        let mut twist = command.twist();
        if !command.is_plausible() {
            self.counters.not_finite += 1;
            return Err(Refusal::NotFinite);
        }
        if command.stamp_ns > now_ns || now_ns >= dies_ns {
            self.counters.late += 1;
            return Err(Refusal::Late);
        }
        let robot = &mut self.robots[robot];
        if robot.newest.is_some_and(|newest| order <= newest) {
            self.counters.old += 1;
            return Err(Refusal::Old);
        }
        if let Some(speed_max) = self.speed_max_m_s {
            let speed = front_speed(robot.body.front_point_m, twist);
            if speed > speed_max {
                twist = twist.scaled(speed_max / speed);
                self.counters.scaled += u64::from(speed > speed_max * (1.0 + SPEED_TOLERANCE));
            }
        }
        robot.newest = Some(order);
        let (twist, stamp_ns) = (robot.body.within_wheel_limits(twist), command.stamp_ns);
        robot.obeyed = Some(Obeyed { twist, stamp_ns, dies_ns });
        Ok(())
    }

    /// Lets time pass until `t_ns` since the start, in arcs that end where a command dies and where
    /// wheels begin or cease to fail: `proof/Plant.v::in_force`, `proof/Motion.v::obeys`,
    /// `proof/Motion.v::moves` and `proof/Motion.v::an_arc_moves_like_this`.
    pub fn try_advance(&mut self, t_ns: u64) -> Result<(), M::Error> {
        while self.t_ns < t_ns {
            let now_ns = self.stamp_ns();
            let mut end_ns = (self.start_ns + t_ns).min(now_ns + self.arc_ns_max);
            for robot in &mut self.robots {
                if robot.obeyed.as_ref().is_some_and(|obeyed| obeyed.dies_ns <= now_ns) {
                    robot.obeyed = None;
                    self.counters.expired += 1;
                }
                if let Some(obeyed) = &robot.obeyed {
                    end_ns = end_ns.min(obeyed.dies_ns);
                }
                for fault in &robot.body.wheel_faults {
                    let bound_ns = fault.span.next_bound_ns(self.t_ns);
                    end_ns = end_ns.min(bound_ns.map_or(u64::MAX, |t_ns| self.start_ns + t_ns));
                }
            }
            let dt_s = (end_ns - now_ns) as f64 / 1e9;
            self.targets.clear();
            for robot in &mut self.robots {
                robot.commanded = robot.obeyed.is_some();
                if let Some(obeyed) = &robot.obeyed {
                    let age_ns = end_ns - obeyed.stamp_ns;
                    self.counters.age_ns_max = self.counters.age_ns_max.max(age_ns);
                }
                self.targets.push(robot.obeyed.as_ref().map_or(Twist::ZERO, |obeyed| {
                    robot.body.within_failing_wheels(obeyed.twist, self.t_ns)
                }));
            }
            self.motion.step(&self.targets, dt_s, &mut self.states)?;
            self.t_ns = end_ns - self.start_ns;
            self.look();
        }
        Ok(())
    }

    /// Takes in where the front points are, and how near they are to each other.
    fn look(&mut self) {
        for ((alpha, robot), state) in self.alphas.iter_mut().zip(&self.robots).zip(&self.states) {
            *alpha = front_point(state.pose, robot.body.front_point_m);
        }
        self.walls.look(&self.alphas, self.t_ns);
        self.near.update(&self.alphas);
        // If none of those near is the closest of all, the closest is no news either.
        if let Some(pair) = self.near.closest(&self.alphas) {
            self.violations += u64::from(pair.distance_m < self.distance_min_m);
            if self.closest.is_none_or(|(closest, _)| pair.distance_m < closest.distance_m) {
                self.closest = Some((pair, self.t_ns));
            }
        }
    }

    /// What `robot` senses now. Of what a sensor without power would know, nothing is in it.
    pub fn odometry(&self, robot: usize) -> Odometry {
        let body = &self.robots[robot].body;
        let works = |sensor| {
            !self.faults_of(body, sensor).any(|fault| fault.kind == SensorFaultKind::Blackout)
        };
        let mut sample = Odometry {
            tick: self.tick,
            t_ns: self.t_ns,
            stamp_ns: self.stamp_ns(),
            velocities_sensed: u32::from(self.velocities_sensed),
            ..Odometry::default()
        };
        if works(Sensor::Odometry) {
            self.sense_itself(robot, &mut sample);
        }
        if works(Sensor::Proximity) {
            self.sense_the_near(robot, &mut sample);
            let radius_m = self.sensing_radius_m;
            // Numbered after the front points of others.
            let off_m = |item| self.noise_m(body, Sensor::Proximity, (PROXIMITY_MAX + item) as u64);
            self.walls.sense(self.alphas[robot], radius_m, off_m, &mut sample);
        }
        sample
    }

    /// Fills in pose and twist.
    fn sense_itself(&self, robot: usize, sample: &mut Odometry) {
        let body = &self.robots[robot].body;
        let State { pose, twist } = &self.states[robot];
        let off = self.noise_m(body, Sensor::Odometry, 0);
        sample.pose_valid = 1;
        sample.x_m = pose.x_m + off.x;
        sample.y_m = pose.y_m + off.y;
        sample.heading_rad = wrap_angle(pose.heading_rad + self.heading_noise_rad(body));
        sample.v_m_s = twist.v_m_s;
        sample.w_rad_s = twist.w_rad_s;
    }

    /// Fills in who is near.
    fn sense_the_near(&self, robot: usize, sample: &mut Odometry) {
        let body = &self.robots[robot].body;
        let (radius_m, own) = (self.sensing_radius_m, self.alphas[robot]);
        let most = if self.velocities_sensed { PROXIMITY_MAX / 2 } else { PROXIMITY_MAX };
        let mut near = [(0.0, 0); PROXIMITY_MAX];
        let mut within = 0;
        for other in self.near.of(robot) {
            let distance = (self.alphas[other] - own).norm();
            if distance <= radius_m {
                let kept = within.min(most);
                within += 1;
                // Behind those at the same distance: they stay in scenario order.
                let place = near[..kept].partition_point(|nearer| nearer.0 <= distance);
                if place < most {
                    near.copy_within(place..kept.min(most - 1), place + 1);
                    near[place] = (distance, other);
                }
            }
        }
        let kept = within.min(most);
        for (item, (place, (_, other))) in sample.near.iter_mut().zip(&near[..kept]).enumerate() {
            let alpha = self.alphas[*other];
            let off = self.noise_m(body, Sensor::Proximity, item as u64 + 1);
            *place = [alpha.x + off.x, alpha.y + off.y];
        }
        if self.velocities_sensed {
            for (place, (_, other)) in sample.near[most..].iter_mut().zip(&near[..kept]) {
                let front_point_m = self.robots[*other].body.front_point_m;
                let State { pose, twist } = self.states[*other];
                let velocity = front_velocity(pose.heading_rad, front_point_m, twist);
                *place = velocity.into();
            }
        }
        sample.proximity_valid = 1;
        sample.proximity_cut = u32::from(within > most);
        sample.proximity_count = kept as u32;
    }

    /// By how much position number `item` of this tick's sample is off, m.
    fn noise_m(&self, body: &BodyBrief, sensor: Sensor, item: u64) -> Vec2 {
        let faults = self.faults_of(body, sensor);
        faults.map(|fault| Vec2::from(fault.offset_m(self.tick, item))).sum()
    }

    /// By how much the heading in this tick's sample is off, rad.
    fn heading_noise_rad(&self, body: &BodyBrief) -> f64 {
        let faults = self.faults_of(body, Sensor::Odometry);
        faults.map(|fault| fault.heading_offset_rad(self.tick)).sum()
    }

    /// What is wrong with this sensor now.
    fn faults_of<'b>(
        &self,
        body: &'b BodyBrief,
        sensor: Sensor,
    ) -> impl Iterator<Item = &'b SensorFault> {
        let t_ns = self.t_ns;
        let faults = body.sensor_faults.iter();
        faults.filter(move |fault| fault.sensor == sensor && fault.span.holds(t_ns))
    }

    /// The time of this truth, and what happened up to it.
    pub fn truth_header(&self) -> TruthHeader {
        let (closest, closest_t_ns) =
            self.closest.unwrap_or((ClosestPair { pair: [0, 0], distance_m: f64::INFINITY }, 0));
        let clearance = self.walls.clearance();
        TruthHeader {
            tick: self.tick,
            t_ns: self.t_ns,
            stamp_ns: self.stamp_ns(),
            sent_ns: 0,
            closest_m: closest.distance_m,
            closest_t_ns,
            closest_pair: closest.pair.map(|place| place as u32),
            violations: self.violations,
            clearance_m: clearance.distance_m,
            clearance_t_ns: clearance.t_ns,
            clearance_at_m: clearance.at.into(),
            clearance_between: clearance.between.map(|place| place as u32),
            clearance_violations: self.walls.violations(),
            commands_late: self.counters.late,
            commands_old: self.counters.old,
            commands_not_finite: self.counters.not_finite,
            commands_scaled: self.counters.scaled,
            commands_expired: self.counters.expired,
            command_age_ns_max: self.counters.age_ns_max,
        }
    }

    /// The true state of everybody, in scenario order.
    pub fn truth(&self) -> impl ExactSizeIterator<Item = TruthRow> {
        self.robots.iter().zip(&self.states).map(|(robot, State { pose, twist })| TruthRow {
            x_m: pose.x_m,
            y_m: pose.y_m,
            heading_rad: pose.heading_rad,
            v_m_s: twist.v_m_s,
            w_rad_s: twist.w_rad_s,
            commanded: u64::from(robot.commanded),
        })
    }
}

/// Scaling of a twist to what the wheels can do: always a part of it, as `proof/Motion.v::obeys`
/// wants it.
trait WheelLimits {
    /// `twist`, scaled down until no wheel is faster than its limit.
    fn within_wheel_limits(&self, twist: Twist) -> Twist;
    /// `twist`, scaled down to what failing wheels can still do at `t_ns`.
    fn within_failing_wheels(&self, twist: Twist, t_ns: u64) -> Twist;
}

impl WheelLimits for BodyBrief {
    fn within_wheel_limits(&self, twist: Twist) -> Twist {
        match &self.wheels {
            Some(wheels) => limited(twist, wheels.speed_max_m_s, wheels.track_m),
            None => twist,
        }
    }

    fn within_failing_wheels(&self, twist: Twist, t_ns: u64) -> Twist {
        // Without wheels in the brief, those that limit the front point's speed.
        let track_m = self.wheels.map_or(2.0 * self.front_point_m, |wheels| wheels.track_m);
        let active = self.wheel_faults.iter().filter(|fault| fault.span.holds(t_ns));
        active.fold(twist, |twist, fault| match fault.kind {
            WheelFaultKind::Stuck => Twist::ZERO,
            WheelFaultKind::Limit { speed_max_m_s } => limited(twist, speed_max_m_s, track_m),
        })
    }
}

/// `twist`, scaled down until no wheel of an axle `track_m` wide is faster than `speed_max_m_s`.
fn limited(twist: Twist, speed_max_m_s: f64, track_m: f64) -> Twist {
    let fastest = twist.v_m_s.abs() + 0.5 * track_m * twist.w_rad_s.abs();
    if fastest > speed_max_m_s { twist.scaled(speed_max_m_s / fastest) } else { twist }
}

#[cfg(test)]
mod inertia;
#[cfg(test)]
mod proof;

#[cfg(test)]
mod tests {
    use super::*;
    use formation::pose::Pose;
    use protocol::brief::{Format, WheelsBrief};
    use protocol::fault::{Span, WheelFault};

    const MS: u64 = 1_000_000;

    fn brief(wheels: Option<WheelsBrief>) -> PlantBrief {
        let body = |name: &str, x_m: f64| BodyBrief {
            name: name.into(),
            front_point_m: 0.1,
            wheels,
            limits: None,
            start: Pose { x_m, y_m: 0.0, heading_rad: 0.0 },
            sensor_faults: Vec::new(),
            wheel_faults: Vec::new(),
            command_faults: Vec::new(),
        };
        PlantBrief {
            format: Format,
            run_root: "/nowhere".into(),
            pace: Pace::Realtime,
            duration_ns: 1000 * MS,
            period_ns: 10 * MS,
            plant_tick_ns: MS,
            command_lifetime_ns: 20 * MS,
            distance_min_m: 0.5,
            speed_max_m_s: Some(1.0),
            sensing_radius_m: 3.0,
            velocities_sensed: false,
            clearance_m: 0.0,
            program: None,
            obstacles: Vec::new(),
            robots: vec![body("a", 0.0), body("b", 2.0), body("c", 4.5)],
        }
    }

    fn command(stamp_ns: u64, sequence: u64, v_m_s: f64, w_rad_s: f64) -> Command {
        Command { tick: 0, stamp_ns, sent_ns: 0, sequence, incarnation: 0, v_m_s, w_rad_s }
    }

    fn x(world: &World, robot: usize) -> f64 {
        world.states[robot].pose.x_m
    }

    #[test]
    fn a_command_that_is_delayed_is_obeyed_later_and_dies_by_its_stamp() {
        use protocol::fault::{LinkFault, LinkFaultKind};
        let mut brief = brief(None);
        let kind = LinkFaultKind::Delay { delay_ns: 15 * MS, jitter_ns: 0 };
        let span = Span { from_ns: 0, until_ns: 100 * MS };
        brief.robots[0].command_faults = vec![LinkFault { span, kind, seed: 1 }];
        let mut world = World::new(&brief);
        world.take(0, &command(0, 1, 0.4, 0.0)).unwrap();
        world.take(1, &command(0, 1, 0.4, 0.0)).unwrap();
        let mut driven = [[false; 2]; 3];
        for (tick, driven) in (1..).zip(&mut driven) {
            world.advance(10 * tick * MS);
            *driven = [0, 1].map(|i| world.truth().nth(i).unwrap().commanded == 1);
            world.take_due();
        }
        // Under way until 15 ms, taken at 20 ms, when it has just died.
        assert_eq!(driven.map(|[late, _]| late), [false, false, false]);
        assert_eq!(driven.map(|[_, in_time]| in_time), [true, true, false]);
        assert_eq!(world.truth_header().commands_late, 1);

        brief.command_lifetime_ns = 30 * MS;
        let mut world = World::new(&brief);
        world.take(0, &command(0, 1, 0.4, 0.0)).unwrap();
        for (tick, driven) in (1..).zip(&mut driven) {
            world.advance(10 * tick * MS);
            driven[0] = world.truth().next().unwrap().commanded == 1;
            world.take_due();
        }
        assert_eq!(driven.map(|[late, _]| late), [false, false, true]);
        assert_eq!(world.truth_header().commands_late, 0);
    }

    #[test]
    fn velocities_are_sensed_where_they_are_asked_for_and_halve_the_room_for_the_near() {
        let crowd = |velocities_sensed| {
            let brief = brief(None);
            let start = |i: u32| Pose { x_m: 0.01 * f64::from(i), y_m: 0.0, heading_rad: 0.1 };
            let body = |i| BodyBrief { start: start(i), ..brief.robots[0].clone() };
            let robots = (0..20).map(body).collect();
            World::new(&PlantBrief { velocities_sensed, robots, ..brief.clone() })
        };
        let mut world = crowd(true);
        world.accept(1, &command(0, 1, 0.3, 2.0)).unwrap();
        world.advance(MS);
        let sample = world.odometry(0);
        let (near, velocities) = (sample.proximity(), sample.velocities());
        let moving: Vec<(Vec2, Vec2)> = near.zip(velocities).collect();
        assert_eq!((moving.len(), sample.proximity_cut), (PROXIMITY_MAX / 2, 1));
        let pose = world.states[1].pose;
        let velocity = front_velocity(pose.heading_rad, 0.1, Twist { v_m_s: 0.3, w_rad_s: 2.0 });
        assert_eq!(moving[0], (world.alphas[1], velocity));
        assert!(moving[1..].iter().all(|(_, velocity)| *velocity == Vec2::zeros()));

        let sample = crowd(false).odometry(0);
        let found = (sample.proximity().count(), sample.velocities().count(), sample.proximity_cut);
        assert_eq!(found, (19, 0, 0));
    }

    #[test]
    fn a_command_dies_at_the_stamp_it_answers_plus_its_lifetime_whenever_it_came() {
        let mut world = World::new(&brief(None));
        world.advance(10 * MS);
        world.accept(0, &command(2 * MS + 500_000, 1, 1.0, 0.0)).unwrap();
        world.advance(100 * MS);
        // Taken at 10 ms, dead at 2.5 + 20 ms.
        assert!((x(&world, 0) - 0.0125).abs() < 1e-15);
        assert_eq!(world.truth_header().commands_expired, 1);
        assert_eq!(world.truth().next().unwrap().commanded, 0);
    }

    #[test]
    fn late_future_old_and_unreal_commands_are_refused_and_counted() {
        let mut world = World::new(&brief(None));
        world.advance(50 * MS);
        world.accept(0, &command(45 * MS, 7, 0.0, 0.0)).unwrap();
        let refused = [
            (command(30 * MS, 8, 0.5, 0.0), Refusal::Late),
            (command(51 * MS, 8, 0.5, 0.0), Refusal::Late),
            (command(45 * MS, 7, 0.5, 0.0), Refusal::Old),
            (command(44 * MS, 9, 0.5, 0.0), Refusal::Old),
            (command(46 * MS, 9, f64::NAN, 0.0), Refusal::NotFinite),
            (command(46 * MS, 9, 0.0, f64::NEG_INFINITY), Refusal::NotFinite),
            (command(46 * MS, 9, 1e300, 0.0), Refusal::NotFinite),
            // It would be newer than whatever the honest agent says for the rest of the run.
            (
                Command { incarnation: u64::MAX, ..command(46 * MS, 9, 0.0, 0.0) },
                Refusal::NotFinite,
            ),
            (command(u64::MAX, 9, 0.5, 0.0), Refusal::Late),
        ];
        for (command, why) in refused {
            assert_eq!(world.accept(0, &command), Err(why), "{command:?}");
        }
        world.advance(60 * MS);
        assert_eq!(x(&world, 0), 0.0);
        let header = world.truth_header();
        assert_eq!(
            (header.commands_late, header.commands_old, header.commands_not_finite),
            (3, 2, 4)
        );
        let replacement = Command { incarnation: 1, ..command(55 * MS, 1, 0.5, 0.0) };
        assert_eq!(world.accept(0, &replacement), Ok(()));
    }

    #[test]
    fn a_command_over_the_speed_limit_is_scaled_and_counted() {
        let mut world = World::new(&brief(None));
        world.accept(0, &command(0, 1, 3.0, 40.0)).unwrap();
        world.advance(MS);
        let twist = world.states[0].twist;
        assert!((front_speed(0.1, twist) - 1.0).abs() < 1e-12);
        assert!((twist.w_rad_s / twist.v_m_s - 40.0 / 3.0).abs() < 1e-12);
        assert_eq!(world.truth_header().commands_scaled, 1);
    }

    #[test]
    fn a_command_that_the_wheels_cannot_follow_keeps_its_path() {
        let wheels = WheelsBrief { speed_max_m_s: 0.3, track_m: 0.2 };
        let mut world = World::new(&brief(Some(wheels)));
        world.accept(0, &command(0, 1, 0.4, -2.0)).unwrap();
        world.advance(MS);
        let twist = world.states[0].twist;
        assert!((twist.v_m_s - 0.2).abs() < 1e-15 && (twist.w_rad_s + 1.0).abs() < 1e-15);
    }

    #[test]
    fn the_nearest_are_sensed_first_and_the_far_not_at_all() {
        let world = World::new(&brief(None));
        let near: Vec<Vec2> = world.odometry(1).proximity().collect();
        assert_eq!(near, [Vec2::new(0.1, 0.0), Vec2::new(4.6, 0.0)]);
        assert_eq!(world.odometry(0).proximity().count(), 1);
    }

    #[test]
    fn in_a_crowd_the_nearest_32_are_sensed_and_those_equally_far_in_scenario_order() {
        let mut brief = brief(None);
        let body = brief.robots[0].clone();
        // A lattice, on which many distances are equal, in no order of distance.
        brief.robots = (0..100)
            .map(|i| {
                let (column, row) = (i * 37 % 100 / 10, i * 37 % 10);
                let start = Pose { x_m: column as f64, y_m: row as f64, heading_rad: 0.0 };
                BodyBrief { start, ..body.clone() }
            })
            .collect();
        for (robot, radius_m) in (0..100).zip([0.5, 1.0, 2.0, 3.0, 4.0, 20.0].into_iter().cycle()) {
            brief.sensing_radius_m = radius_m;
            let world = World::new(&brief);
            let mut near: Vec<(f64, Vec2)> = (0..100)
                .filter(|&other| other != robot)
                .map(|other| {
                    ((world.alphas[other] - world.alphas[robot]).norm(), world.alphas[other])
                })
                .filter(|&(distance_m, _)| distance_m <= radius_m)
                .collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let sample = world.odometry(robot);
            assert_eq!(sample.proximity_cut == 1, near.len() > PROXIMITY_MAX);
            near.truncate(PROXIMITY_MAX);
            let nearest: Vec<Vec2> = near.into_iter().map(|(_, alpha)| alpha).collect();
            assert_eq!(sample.proximity().collect::<Vec<_>>(), nearest, "{robot} {radius_m}");
        }
    }

    #[test]
    fn wheels_fail_exactly_from_the_first_to_the_last_instant_of_their_fault() {
        let mut brief = brief(None);
        let span = |from, until| Span { from_ns: from * MS, until_ns: until * MS };
        brief.robots[0].wheel_faults = vec![
            WheelFault { span: span(5, 8), kind: WheelFaultKind::Stuck },
            WheelFault { span: span(10, 20), kind: WheelFaultKind::Limit { speed_max_m_s: 0.5 } },
        ];
        brief.plant_tick_ns = 20 * MS;
        let mut world = World::new(&brief);
        world.accept(0, &command(0, 1, 1.0, 0.0)).unwrap();
        world.advance(15 * MS);
        // 5 ms and 2 ms at 1 m/s, 5 ms at 0.5 m/s.
        assert!((x(&world, 0) - 0.0095).abs() < 1e-15, "{}", x(&world, 0));
    }

    #[test]
    fn a_dark_sensor_says_so_and_a_noisy_one_stays_within_its_bound() {
        let mut brief = brief(None);
        let fault = |sensor, kind, from_ns| SensorFault {
            span: Span { from_ns, until_ns: from_ns + MS },
            sensor,
            kind,
            seed: 5,
        };
        let noise = SensorFaultKind::Noise { bound_m: 0.1, heading_bound_rad: 0.2 };
        brief.robots[1].sensor_faults = vec![
            fault(Sensor::Odometry, SensorFaultKind::Blackout, MS),
            fault(Sensor::Proximity, SensorFaultKind::Blackout, 2 * MS),
            fault(Sensor::Odometry, noise, 3 * MS),
            fault(Sensor::Proximity, noise, 4 * MS),
        ];
        let mut world = World::new(&brief);
        world.accept(1, &command(0, 1, 0.0, 1.0)).unwrap();
        let mut seen = Vec::new();
        for t_ms in 1..6 {
            world.advance(t_ms * MS);
            let sample = world.odometry(1);
            let works = (sample.pose_valid == 1, sample.proximity_valid == 1);
            let off_m = works.0.then(|| (sample.x_m - 2.0).hypot(sample.y_m));
            let near = sample.proximity().next();
            let off_near_m = near.map(|near| (near - Vec2::new(0.1, 0.0)).norm());
            assert!(off_m.is_none_or(|off_m| off_m <= 0.1));
            assert!(off_near_m.is_none_or(|off_m| off_m <= 0.1));
            let turned_rad = sample.heading_rad - world.states[1].pose.heading_rad;
            assert!(!works.0 || turned_rad.abs() <= 0.2);
            assert_eq!(works.0 && turned_rad != 0.0, off_m.is_some_and(|m| m > 0.0));
            // A dark sensor sends nothing that is true.
            let own = [sample.x_m, sample.y_m, sample.heading_rad, sample.v_m_s, sample.w_rad_s];
            assert!(works.0 || own == [0.0; 5], "{own:?}");
            assert!(works.1 || sample.near == [[0.0; 2]; PROXIMITY_MAX], "{:?}", sample.near);
            assert_eq!(sample.proximity_count, if works.1 { 2 } else { 0 });
            seen.push((works, off_m.map(|m| m > 0.0), off_near_m.map(|m| m > 1e-9)));
            world.next_tick();
        }
        let works = (true, true);
        assert_eq!(
            seen,
            [
                ((false, true), None, Some(false)),
                ((true, false), Some(false), None),
                (works, Some(true), Some(false)),
                (works, Some(false), Some(true)),
                (works, Some(false), Some(false)),
            ]
        );
    }

    #[test]
    fn two_that_come_too_near_are_counted_at_every_arc() {
        let mut world = World::new(&brief(None));
        let mut t_ns = 0;
        for sequence in 1.. {
            world.accept(0, &command(t_ns, sequence, 1.0, 0.0)).unwrap();
            t_ns += 10 * MS;
            world.advance(t_ns);
            if x(&world, 0) > 1.6 {
                break;
            }
        }
        let header = world.truth_header();
        assert!((header.closest_m - (2.0 - x(&world, 0))).abs() < 1e-12);
        assert_eq!(header.closest_pair, [0, 1]);
        assert_eq!(header.closest_t_ns, t_ns);
        // 1.5 m to 1.61 m at 1 mm an arc.
        assert!((105..=115).contains(&header.violations), "{}", header.violations);
    }

    #[test]
    fn stamps_count_from_the_start_times_from_zero_and_ticks_by_one() {
        let mut world = World::new(&brief(None));
        world.start_at(7 * MS);
        assert_eq!((world.next_tick(), world.next_tick()), (1, 2));
        world.advance(5 * MS);
        let (header, sample) = (world.truth_header(), world.odometry(0));
        assert_eq!((world.t_ns(), header.t_ns, sample.t_ns), (5 * MS, 5 * MS, 5 * MS));
        assert_eq!((header.stamp_ns, sample.stamp_ns), (12 * MS, 12 * MS));
        assert_eq!((header.tick, sample.tick), (2, 2));
    }

    #[test]
    fn who_stands_exactly_d_apart_violates_nothing_and_who_starts_nearer_does_at_once() {
        for (apart_m, at_start, later) in [(0.5, 0, 0), (0.49, 1, 11), (0.51, 0, 0)] {
            let mut brief = brief(None);
            brief.robots[1].start.x_m = apart_m;
            let mut world = World::new(&brief);
            assert_eq!(world.truth_header().violations, at_start, "{apart_m}");
            world.advance(10 * MS);
            let header = world.truth_header();
            assert_eq!((header.violations, header.closest_t_ns), (later, 0), "{apart_m}");
        }
    }

    #[test]
    fn rounding_over_the_speed_limit_is_no_command_to_count() {
        for (speed_m_s, counted) in [(1.0, 0), (1.0 + 1e-12, 0), (1.0 + 1e-6, 1)] {
            let mut world = World::new(&brief(None));
            world.accept(0, &command(0, 1, speed_m_s, 0.0)).unwrap();
            assert_eq!(world.truth_header().commands_scaled, counted, "{speed_m_s}");
        }
    }

    #[test]
    fn noise_is_what_the_fault_draws_for_each_number_of_the_sample() {
        let mut brief = brief(None);
        let fault = |sensor| SensorFault {
            span: Span { from_ns: 0, until_ns: MS },
            sensor,
            kind: SensorFaultKind::Noise { bound_m: 0.1, heading_bound_rad: 0.2 },
            seed: 11,
        };
        let faults = [Sensor::Odometry, Sensor::Proximity].map(fault);
        brief.robots[1].sensor_faults = faults.to_vec();
        brief.robots[1].start.y_m = 0.3;
        let mut world = World::new(&brief);
        world.next_tick();
        let sample = world.odometry(1);
        let [x, y] = faults[0].offset_m(1, 0);
        let turned_rad = faults[0].heading_offset_rad(1);
        let pose = Pose { x_m: 2.0 + x, y_m: 0.3 + y, heading_rad: turned_rad };
        assert_eq!(sample.pose(), pose);
        let near: Vec<Vec2> = sample.proximity().collect();
        let off = [1, 2].map(|item| Vec2::from(faults[1].offset_m(1, item)));
        assert_eq!(near, [Vec2::new(0.1, 0.0) + off[0], Vec2::new(4.6, 0.0) + off[1]]);
    }

    #[test]
    fn as_many_as_a_sample_holds_are_no_reason_to_call_it_cut() {
        for (robots, cut) in [(PROXIMITY_MAX + 1, 0), (PROXIMITY_MAX + 2, 1)] {
            let mut brief = brief(None);
            let body = brief.robots[0].clone();
            let start = |i: usize| Pose { x_m: 0.01 * i as f64, y_m: 0.0, heading_rad: 0.0 };
            let bodies = (0..robots).map(|i| BodyBrief { start: start(i), ..body.clone() });
            brief.robots = bodies.collect();
            let sample = World::new(&brief).odometry(0);
            assert_eq!((sample.proximity_cut, sample.proximity_count), (cut, 32), "{robots}");
        }
    }

    #[test]
    fn without_wheels_in_the_brief_failing_ones_stand_two_front_points_apart() {
        let mut brief = brief(None);
        let kind = WheelFaultKind::Limit { speed_max_m_s: 0.3 };
        let span = Span { from_ns: 0, until_ns: 10 * MS };
        brief.robots[0].wheel_faults = vec![WheelFault { span, kind }];
        let mut world = World::new(&brief);
        world.accept(0, &command(0, 1, 0.4, -2.0)).unwrap();
        world.advance(MS);
        // |v| + ell |w| = 0.6 m/s: half as fast.
        let twist = world.states[0].twist;
        assert!((twist.v_m_s - 0.2).abs() < 1e-15 && (twist.w_rad_s + 1.0).abs() < 1e-15);
    }
}
