//! Faults in the model: the adversary that chooses them, the velocities that the robots are made to request, and the
//! delays of samples, commands and beacons.

use std::f64::consts::PI;
use std::sync::{Arc, Mutex};

use agent::avoidance::{self, Avoidance, Sample, approach_slack_fraction, deflection_distance_m};
use agent::control_cycle::ControlCycle;
use agent::controller::{Controller, Parts};
use agent::laws::{Law, Situation};
use agent::roles::LEADER_ROLE;
use formation::Vec2;
use formation::front_point::{Heading, front_speed};
use formation::pose::{Twist, wrap_angle};
use formation::scale::Scale;
use formation::trajectory::Trajectory;
use protocol::avoidance::MethodConditions;
use protocol::brief::{AgentBrief, LeadBrief};

use super::walls::Ramming;
use super::{MS, Model, NextAction, Robot, US, distance_m};

/// Strategy that chooses faults and their times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Adversary {
    /// Random freezes, kills and latencies far beyond the command lifetime (H).
    Chance,
    /// Freezes of a robot at the moment when its nearest neighbor approaches.
    FreezeTheNear,
    /// Delays that make every command arrive just before or just after it expires.
    JustInTime,
    /// Freezes of a robot between reading and sending. The robot is resumed when another one is near, and killed when
    /// it has sent.
    Ambush,
}

pub const ADVERSARIES: [Adversary; 4] =
    [Adversary::Chance, Adversary::FreezeTheNear, Adversary::JustInTime, Adversary::Ambush];

/// Velocities that the robots request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RequestedVelocity {
    /// Velocity of the control law in the robot's brief.
    Law,
    /// Maximum velocity towards the nearest neighbor or wall. The robots receive a false prediction of their own
    /// rotation, so that avoidance steering turns them towards it: only the bound of the guard is left.
    Ram,
}

/// Mean rate of kills for each robot, Hz.
const KILLS_HZ: f64 = 0.33;

impl Model<'_> {
    /// Applies the adversary's faults of one tick.
    pub(super) fn inject_faults(&mut self) {
        let tick_s = self.fleet.plant.plant_tick_ns as f64 / 1e9;
        for i in 0..self.robots.len() {
            if self.robots[i].cycle.is_none() {
                continue;
            }
            if self.rng.draw_bool(KILLS_HZ * tick_s) {
                self.kill(i);
                continue;
            }
            match self.trial.adversary {
                Adversary::Chance if self.rng.draw_bool(2.0 * tick_s) => {
                    let doublings = self.rng.draw_between(0, 8);
                    self.freeze(i, MS << doublings);
                }
                Adversary::FreezeTheNear if self.is_approached(i) && self.rng.draw_bool(0.1) => {
                    let freeze_ns = self.rng.draw_between(MS, 200 * MS);
                    self.freeze(i, freeze_ns);
                }
                Adversary::JustInTime if self.rng.draw_bool(tick_s) => self.freeze(i, 20 * MS),
                Adversary::Ambush => self.ambush(i),
                _ => {}
            }
        }
    }

    /// Returns whether the nearest neighbor of `i` is near and was farther away one tick ago.
    fn is_approached(&self, i: usize) -> bool {
        let (nearest, towards) = self.nearest_robot(i);
        let before_m = (self.alphas_before[nearest] - self.alphas_before[i]).norm();
        let near_m = self.fleet.plant.distance_min_m + 3.0 * self.reach_m();
        towards.norm() < near_m.min(before_m)
    }

    fn ambush(&mut self, i: usize) {
        let (_, towards) = self.nearest_robot(i);
        let brief = &self.fleet.agents[i];
        let fast_m_s = 0.25 * brief.avoidance.speed_max_m_s;
        // One robot at a time: the others must be free to come near.
        let is_ambushing = |robot: &Robot| robot.ambush_m.is_some() && robot.is_frozen(self.now_ns);
        let is_ambush_active = self.robots.iter().any(is_ambushing);
        let robot = &mut self.robots[i];
        match &robot.next {
            NextAction::Send(_)
                if robot.ambush_m.is_some_and(|ambush_m| towards.norm() < ambush_m) =>
            {
                robot.ambush_m = None;
                robot.frozen_until_ns = self.now_ns;
                robot.kill_after_send = true;
            }
            NextAction::Send(answer)
                if !is_ambush_active
                    && !robot.kill_after_send
                    && front_speed(brief.front_point_m, answer.command.twist()) > fast_m_s
                    && self.rng.draw_bool(0.1) =>
            {
                let ambush_m =
                    self.fleet.plant.distance_min_m + self.reach_m() * self.rng.draw_unit();
                self.freeze(i, 1000 * MS);
                self.robots[i].ambush_m = Some(ambush_m);
            }
            _ => {}
        }
    }

    /// Returns the distance that a robot can move during a command lifetime (v_max H), m.
    fn reach_m(&self) -> f64 {
        let lifetime_s = self.fleet.plant.command_lifetime_ns as f64 / 1e9;
        self.fleet.agents[0].avoidance.speed_max_m_s * lifetime_s
    }

    /// Returns the nearest other robot of `i`, and its position relative to `i`, m.
    fn nearest_robot(&self, i: usize) -> (usize, Vec2) {
        let points: Vec<[f64; 2]> = self.alphas.iter().map(|&alpha| alpha.into()).collect();
        let others = (0..points.len()).filter(|&j| j != i);
        let distances = others.map(|j| (j, distance_m(points[i], points[j])));
        let nearest = distances.min_by(|(_, a), (_, b)| a.total_cmp(b));
        let (nearest, _) = nearest.expect("more than one robot");
        (nearest, self.alphas[nearest] - self.alphas[i])
    }

    fn freeze(&mut self, i: usize, freeze_ns: u64) {
        let robot = &mut self.robots[i];
        if !robot.is_frozen(self.now_ns) {
            robot.frozen_until_ns = self.now_ns + freeze_ns;
            self.freezes += 1;
        }
    }

    /// Kills `i`, unless it is the last running robot. One of four stays dead until the faults end.
    pub(super) fn kill(&mut self, i: usize) {
        if self.robots.iter().filter(|robot| robot.cycle.is_some()).count() == 1 {
            return;
        }
        let starts_ns = self.now_ns + self.rng.draw_between(20 * MS, 600 * MS);
        let robot = &mut self.robots[i];
        robot.cycle = None;
        robot.beacons.clear();
        robot.starts_ns = self.rng.draw_bool(0.75).then_some(starts_ns);
        self.kills += 1;
    }

    /// Resumes all frozen robots and restarts all dead ones.
    pub(super) fn clear_faults(&mut self) {
        for i in 0..self.robots.len() {
            let robot = &mut self.robots[i];
            robot.frozen_until_ns = robot.frozen_until_ns.min(self.now_ns);
            if robot.cycle.is_none() {
                self.start(i);
            }
        }
    }

    pub(super) fn plant_lateness_ns(&mut self) -> u64 {
        match self.is_hostile() && self.rng.draw_bool(0.005) {
            true => self.rng.draw_between(0, 5 * MS),
            false => self.rng.draw_between(0, 100 * US),
        }
    }

    pub(super) fn oversleeping_ns(&mut self, period_ns: u64) -> u64 {
        match self.is_hostile() && self.rng.draw_bool(0.05) {
            true => self.rng.draw_between(0, 2 * period_ns),
            false => self.rng.draw_between(0, 100 * US),
        }
    }

    /// Draws the delay of a command from the agent to the plant, ns.
    pub(super) fn transport_ns(&mut self) -> u64 {
        match self.is_hostile() && self.rng.draw_bool(0.1) {
            true => self.rng.draw_between(0, 2 * self.fleet.plant.command_lifetime_ns),
            false => self.rng.draw_between(0, 20 * US),
        }
    }

    /// Draws the delay of a beacon from its sender to a receiver, ns. `None` means that it is lost.
    pub(super) fn beacon_delay_ns(&mut self) -> Option<u64> {
        match self.is_hostile() {
            true if self.rng.draw_bool(0.1) => None,
            true if self.rng.draw_bool(0.2) => Some(self.rng.draw_between(0, 50 * MS)),
            _ => Some(self.rng.draw_between(0, 20 * US)),
        }
    }

    /// Draws the time at which the answer to a sample with this stamp is sent, ns.
    pub(super) fn answer_takes_until_ns(&mut self, stamp_ns: u64) -> u64 {
        let lifetime_ns = self.fleet.plant.command_lifetime_ns;
        let tick_ns = self.fleet.plant.plant_tick_ns;
        let soon_ns = self.now_ns + self.rng.draw_between(10 * US, 300 * US);
        if !self.is_hostile() {
            return soon_ns;
        }
        match self.trial.adversary {
            Adversary::JustInTime if self.rng.draw_bool(0.8) => {
                let expires_ns = stamp_ns + lifetime_ns;
                self.rng.draw_between(expires_ns - 3 * tick_ns, expires_ns + tick_ns / 2)
            }
            // Long enough for ticks between reading and sending.
            Adversary::Ambush => self.now_ns + self.rng.draw_between(100 * US, 4 * MS),
            _ if self.rng.draw_bool(0.6) => soon_ns,
            _ if self.rng.draw_bool(0.7) => self.now_ns + self.rng.draw_between(0, lifetime_ns),
            _ => self.now_ns + self.rng.draw_between(0, 4 * lifetime_ns),
        }
    }

    /// Creates the control cycle of the next incarnation of `i`, which has received nothing yet.
    pub(super) fn cycle(
        &self,
        i: usize,
        incarnation: u64,
        deceit: &Arc<Mutex<Deceit>>,
    ) -> ControlCycle {
        let brief = &self.fleet.agents[i];
        let controller = match self.trial.requested_velocity {
            RequestedVelocity::Law => Controller::new(brief, incarnation).expect("a checked brief"),
            // A leader computes a velocity even if it receives no beacon.
            RequestedVelocity::Ram => {
                let lead = Some(stay_at([0.0, 0.0]));
                let leader = AgentBrief { lead, ..brief.clone() };
                let honest = avoidance::build(brief).expect("a checked brief");
                let parts = Parts {
                    role: LEADER_ROLE.make(&leader).expect("a trajectory"),
                    law: Box::new(AdversaryLaw(deceit.clone())),
                    avoidance: Box::new(Deceived { honest, deceit: deceit.clone() }),
                };
                Controller::with_parts(&leader, incarnation, parts)
            }
        };
        ControlCycle::new(controller, self.now_ns)
    }

    /// Sets the requested velocity and the false rotation of a ramming robot. Does nothing if robots follow their law.
    pub(super) fn deceive(&mut self, i: usize) {
        if self.trial.requested_velocity == RequestedVelocity::Law {
            return;
        }
        let brief = &self.fleet.agents[i];
        let speed_max = brief.avoidance.speed_max_m_s;
        let (_, towards) = self.nearest_robot(i);
        let slack_m = towards.norm() - self.fleet.plant.distance_min_m;
        let ramming = match self.wall_nearer_than(i, slack_m) {
            Some(towards) => self.ramming_a_wall(i, towards),
            None => {
                // For one neighbor, deflection turns -V n into this p (in n and t), which is turned back here.
                let reach = speed_max * brief.period_ns as f64 / 1e9; // V
                let at = MethodConditions::for_robot(brief);
                let excess =
                    approach_slack_fraction(&at) * (deflection_distance_m(&at) - towards.norm());
                let requested_direction = towards / towards.norm().max(f64::MIN_POSITIVE);
                Ramming { requested_direction, p_n: excess, p_t: reach + excess }
            }
        };
        let Ramming { requested_direction, p_n, p_t } = ramming;
        let turn_rad = match p_t > 0.0 {
            // The dither is unknown here; a small random angle compensates it.
            true => PI - p_t.atan2(p_n) + 0.6 * (self.rng.draw_unit() - 0.5),
            false => 0.0,
        };
        *self.robots[i].deceit.lock().unwrap() =
            Deceit { requested_velocity: 2.0 * speed_max * requested_direction, turn_rad };
    }
}

/// False input of a ramming robot.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Deceit {
    /// Requested velocity, m/s.
    requested_velocity: Vec2,
    /// Reduction of the rotation that the robot predicts until its answer takes effect, rad.
    turn_rad: f64,
}

/// Control law with the velocity that the adversary requests.
struct AdversaryLaw(Arc<Mutex<Deceit>>);

impl Law for AdversaryLaw {
    fn gamma(&mut self, _: &Situation<'_>) -> Vec2 {
        self.0.lock().unwrap().requested_velocity
    }
}

/// Avoidance with a false heading for the time at which its answer takes effect. The guard uses this heading only to
/// convert the deflected displacement to wheel speeds.
struct Deceived {
    honest: Box<dyn Avoidance>,
    deceit: Arc<Mutex<Deceit>>,
}

impl Avoidance for Deceived {
    fn admit_velocity(&self, gamma: Vec2) -> Vec2 {
        self.honest.admit_velocity(gamma)
    }

    fn standoff_error(&mut self, sample: &Sample<'_>, error: Vec2) -> Vec2 {
        self.honest.standoff_error(sample, error)
    }

    fn velocity_to_twist(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        self.honest.velocity_to_twist(heading_rad, gamma)
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        let turn_rad = self.deceit.lock().unwrap().turn_rad;
        let heading_at_effect = Heading::new(wrap_angle(sample.heading_rad - turn_rad));
        self.honest.steer(&Sample { heading_at_effect, ..*sample }, gamma)
    }
}

/// Returns the brief of a leader that goes to a point, m, and stays there.
pub fn stay_at(center_m: [f64; 2]) -> LeadBrief {
    LeadBrief {
        scale: Scale::CONSTANT_ONE,
        trajectory: Trajectory::Still { center_m },
        keep_heading: false,
    }
}
