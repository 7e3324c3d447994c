//! One robot's brain: (odometry, beacons heard) in, (beacon, command) out.
//!
//! Pure: no I/O, no clock, no iceoryx2. The same brain runs in a process of its own and, composed
//! with the plant's world, inside a test that foretells the process's every bit.
//!
//! An answer has three steps: [`Brain::sense`] takes a sample in, the law says what it wants in the
//! situation at hand, and [`Brain::act`] makes an answer of that. Whoever trains a law takes them apart.

mod sent;

use formation::Vec2;
use formation::front_point::{front_motion, front_velocity};
use formation::pose::wrap_angle;
use protocol::age::AgeSums;
use protocol::brief::{AgentBrief, Pace, PublishedVelocity, REPAIR_HASTE, Rank};
use protocol::fault::{LinkFaultKind, Transmission};
use protocol::link::Link;
use protocol::message::{
    Beacon, Command, Goal, NeighborStatus, Odometry, PROXIMITY_MAX, StatusHeader,
};
use protocol::planted;

use crate::UnfitBrief;
use crate::avoidance::{self, Avoidance, Sample};
use crate::laws::{self, Heard, Law, Situation, Wish};
use crate::neighborhood::{BeaconRefusal, Neighborhood};
use crate::roles::{self, Moment, Role};
use sent::Sent;

/// a of the boundary layer: how many periods old a beacon is when it is used. In lockstep exactly
/// one; in real time up to one of the sender's period and one of delivery and phase. And what
/// delayed odometry and commands add.
fn age_periods(brief: &AgentBrief) -> f64 {
    let late = brief.late_ns as f64 / brief.period_ns as f64;
    match brief.pace {
        Pace::Lockstep => 1.0 + late,
        Pace::Realtime => 2.0 + late,
    }
}

/// What a brain is made of beside its brief: rows of this crate's tables, or a program's own.
pub struct Parts {
    /// Where the robot is to be.
    pub role: Box<dyn Role>,
    /// How it gets there.
    pub law: Box<dyn Law>,
    /// How it keeps its distance meanwhile.
    pub avoidance: Box<dyn Avoidance>,
}

impl Parts {
    /// Those that the brief names.
    pub fn of(brief: &AgentBrief) -> Result<Parts, UnfitBrief> {
        Parts::with_law(brief, laws::row(&brief.law)?.make(&brief.gains)?)
    }

    /// The same with this law; the role is that of the brief's program, or of the law that the brief names.
    pub fn with_law(brief: &AgentBrief, law: Box<dyn Law>) -> Result<Parts, UnfitBrief> {
        let role = match &brief.program {
            Some(program) => roles::row(&program.role)?,
            None => laws::row(&brief.law)?.role,
        };
        Ok(Parts { role: role.make(brief)?, law, avoidance: avoidance::build(brief)? })
    }
}

/// One robot's brain.
pub struct Brain {
    role: Box<dyn Role>,
    incarnation: u64,
    brief: AgentBrief,
    law: Box<dyn Law>,
    avoidance: Box<dyn Avoidance>,
    neighborhood: Neighborhood,
    now: Now,
    /// From each sender, in the brief's order.
    links: Vec<Link<Beacon>>,
    /// From its own sensors, where that may fail.
    odometry: Option<Link<Odometry>>,
    /// Stamp of the newest sample answered, ns.
    answered_ns: Option<u64>,
    /// Stamp of t = 0, ns; known with the first sample.
    start_ns: u64,
    news: bool,
    sent: Sent,
    /// Where it found itself last, m.
    front_point: Option<Vec2>,
    /// The previous sample's stamp, ns, and front point; kept only where velocities are differenced.
    before: Option<(u64, Vec2)>,
    velocities: Vec<Vec2>,
    walls: Vec<Vec2>,
    sequence: u64,
    beacons_refused: u64,
    newest: Option<(u64, u64)>,
}

/// The sample at hand, and what it tells.
struct Now {
    period_s: f64,
    age_periods: f64,
    /// Of which the pose is valid; `None`: nothing to answer.
    odometry: Option<Odometry>,
    /// alpha, m, and alpha', m/s.
    front_point: Vec2,
    front_velocity: Vec2,
    /// alpha - alpha*, m; `None`: nothing to go by.
    error: Option<Vec2>,
    /// The same as the law is to see it, and alpha*', m/s.
    target: Option<(Vec2, Vec2)>,
    /// Own front point - that of each robot near, m.
    away: Vec<Vec2>,
    /// What is known of those heard.
    heard: Vec<Heard>,
}

/// What a robot with nothing to go by does.
const STAND: Wish = Wish::Velocity(Vec2::new(0.0, 0.0));

/// What a brain answers to one odometry sample.
#[derive(Debug, Clone, Copy)]
pub struct Answer {
    /// For those that hear this robot.
    pub beacon: Beacon,
    /// For the plant.
    pub command: Command,
    /// How much longer than the answer itself it takes to send it, ns: a fault of the brief.
    pub delay_ns: u64,
}

impl Brain {
    /// A brain that has heard nothing yet.
    pub fn new(brief: &AgentBrief, incarnation: u64) -> Result<Brain, UnfitBrief> {
        Ok(Brain::with_parts(brief, incarnation, Parts::of(brief)?))
    }

    /// The same of other parts than the brief names: they need not be in any table.
    pub fn with_parts(brief: &AgentBrief, incarnation: u64, parts: Parts) -> Brain {
        let Parts { role, law, avoidance } = parts;
        Brain {
            role,
            incarnation,
            brief: brief.clone(),
            law,
            avoidance,
            neighborhood: Neighborhood::new(brief, incarnation),
            now: Now {
                period_s: brief.period_ns as f64 / 1e9,
                age_periods: age_periods(brief),
                odometry: None,
                front_point: Vec2::zeros(),
                front_velocity: Vec2::zeros(),
                error: None,
                target: None,
                away: Vec::with_capacity(PROXIMITY_MAX),
                heard: Vec::with_capacity(brief.senders().count()),
            },
            links: brief.senders().map(|sender| Link::new(&sender.faults)).collect(),
            odometry: (!brief.odometry_faults.is_empty())
                .then(|| Link::new(&brief.odometry_faults)),
            answered_ns: None,
            start_ns: 0,
            news: false,
            sent: Sent::default(),
            front_point: None,
            before: None,
            velocities: Vec::new(),
            walls: Vec::new(),
            sequence: 0,
            beacons_refused: 0,
            newest: None,
        }
    }

    /// Takes a beacon from the neighbour at `place` (in the brief's order), after the first sample.
    /// A refused one is counted and changes nothing; one that the link's faults swallow or keep
    /// under way is not heard, for now.
    pub fn hear(
        &mut self,
        place: usize,
        beacon: &Beacon,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        let transmission = Transmission {
            tick: beacon.tick,
            t_ns: beacon.stamp_ns.saturating_sub(self.start_ns),
            distance_m: self.front_point.map(|alpha| (alpha - beacon.position()).norm()),
        };
        let mut beacon = *beacon;
        let lies = self.brief.senders().nth(place).into_iter().flat_map(|sender| &sender.lies);
        lies.for_each(|lie| lie.falsify(&mut beacon, transmission.t_ns));
        match self.links[place].pass(&beacon, transmission) {
            Some(beacon) => self.hear_now(place, &beacon, now_ns),
            None => Ok(()),
        }
    }

    /// Cuts the link from a robot, by its place in the scenario from 1, or mends it. One that is not
    /// heard has none.
    pub fn set_cut(&mut self, robot: u64, cut: bool) {
        if let Some(place) = self.neighborhood.place_of(robot) {
            self.links[place].set_cut(cut);
        }
    }

    /// Somebody outside sends the robot to this place, from its next sample on. What is no newer than the goal
    /// in force changes nothing, and no role but one that goes to a goal listens.
    pub fn go_to(&mut self, goal: &Goal) {
        self.sent.ask(goal);
    }

    fn hear_now(
        &mut self,
        place: usize,
        beacon: &Beacon,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        let heard = self.neighborhood.hear(place, beacon, now_ns);
        self.beacons_refused += u64::from(heard.is_err());
        self.news |= heard.is_err();
        heard
    }

    /// Those whom it hears, and what it makes of their silence.
    pub fn neighborhood(&self) -> &Neighborhood {
        &self.neighborhood
    }

    /// Which incarnation of the robot it is, from 0.
    pub fn incarnation(&self) -> u64 {
        self.incarnation
    }

    /// Whether a sample was taken.
    pub fn has_started(&self) -> bool {
        self.newest.is_some()
    }

    /// Whether some neighbour's contact changed, or a beacon was refused, since this was asked last.
    pub fn take_news(&mut self) -> bool {
        std::mem::take(&mut self.news)
    }

    /// Answers an odometry sample; `None` if it does not know where the robot is. Where faults lose
    /// or delay odometry, the newest that has arrived is answered, unless it was before. `effect_ns`:
    /// the stamp at which the answer is expected to take effect, but for faults that delay it; the
    /// sample's own stamp in lockstep. The caller fills in `sent_ns`.
    pub fn answer(&mut self, odometry: &Odometry, effect_ns: u64) -> Option<Answer> {
        self.sense(odometry);
        let wish = self.wish();
        self.act(wish, effect_ns)
    }

    /// Takes an odometry sample in, and judges what is known of others as of then.
    pub fn sense(&mut self, odometry: &Odometry) {
        self.newest = Some((odometry.tick, odometry.t_ns));
        self.start_ns = odometry.stamp_ns.saturating_sub(odometry.t_ns);
        for place in 0..self.links.len() {
            while let Some(beacon) = self.links[place].due(odometry.t_ns) {
                // A refusal is counted: jitter lets beacons overtake each other.
                let _ = self.hear_now(place, &beacon, odometry.stamp_ns);
            }
        }
        self.news |= self.sent.apply(&mut *self.role, odometry.t_ns);
        self.news |= self.neighborhood.judge(odometry.tick, odometry.t_ns, odometry.stamp_ns);
        (self.now.error, self.now.target) = (None, None);
        match (&self.odometry, &mut self.now.odometry) {
            // A sample is large: it is copied once.
            (None, Some(sample)) if odometry.pose_valid == 1 => sample.clone_from(odometry),
            (None, sample) => *sample = (odometry.pose_valid == 1).then_some(*odometry),
            (Some(_), _) => {
                let arrived = self.arrived(odometry);
                self.now.odometry = arrived.filter(|sample| sample.pose_valid == 1);
            }
        }
        let Some(odometry) = &self.now.odometry else { return };
        let (alpha, velocity) =
            front_motion(odometry.pose(), self.brief.front_point_m, odometry.twist()); // (2), (3)
        self.front_point = Some(alpha);
        (self.now.front_point, self.now.front_velocity) = (alpha, velocity);
        self.now.away.clear();
        self.now.away.extend(odometry.proximity().map(|other| alpha - other));
        let target = self.role.target(&moment(odometry, &self.neighborhood), &mut self.now.heard);
        if let Some(target) = target {
            let error = alpha - target.position;
            self.now.error = Some(error);
            if error.norm() <= self.brief.front_point_m {
                self.neighborhood.arrived();
            }
            let seen = seen(odometry, (alpha, velocity), &self.now.away);
            let error = self.avoidance.stand_off(&seen, error);
            let hastens = self.brief.rank == Rank::Contained && self.neighborhood.has_given_up();
            let error = if hastens { REPAIR_HASTE * error } else { error };
            self.now.target = Some((error, target.velocity));
        }
    }

    /// There is no sample to be answered.
    pub fn sense_nothing(&mut self) {
        self.now.odometry = None;
    }

    /// What the law sees of the sample at hand; `None` if the robot has nothing to go by.
    pub fn situation(&self) -> Option<Situation<'_>> {
        self.now.situation()
    }

    /// What the law wants in the situation at hand. To be asked once.
    pub fn wish(&mut self) -> Wish {
        self.now.situation().map_or(STAND, |situation| self.law.wish(&situation))
    }

    /// The answer to the sample at hand, given what the law wants; a robot that has nothing to go by stands.
    /// See [`Brain::answer`].
    pub fn act(&mut self, wish: Wish, effect_ns: u64) -> Option<Answer> {
        let (tick, t_ns) = self.newest?;
        let effect_ns = effect_ns + self.commands_late_ns(t_ns);
        let odometry = self.now.odometry.as_ref()?;
        let moment = moment(odometry, &self.neighborhood);
        let (pose, alpha) = (moment.pose, self.now.front_point);
        let wish = self.now.target.map_or(STAND, |_| wish);
        let gamma = self.avoidance.admit(match wish {
            Wish::Velocity(gamma) => gamma,
            Wish::Twist(twist) => front_velocity(pose.heading_rad, self.brief.front_point_m, twist),
        });
        let (frame_rank, frame) = match self.role.frame(&moment, &*self.avoidance) {
            Some(own) => {
                // 0: the main leader's.
                let rank = self.brief.deputy.as_ref().map_or(0, |deputy| deputy.rank);
                (rank, Some((odometry.stamp_ns, own)))
            }
            None => match self.neighborhood.frame(odometry.stamp_ns) {
                Some(heard) => (heard.rank, Some((heard.stamp_ns, heard.frame))),
                None => (0, None),
            },
        };

        self.velocities.clear();
        self.velocities.extend(odometry.velocities());
        self.walls.clear();
        self.walls.extend(odometry.walls().map(|nearest| alpha - nearest));
        let until_effect_s = effect_ns.saturating_sub(odometry.stamp_ns) as f64 / 1e9;
        let sample = Sample {
            heading_effect_rad: wrap_angle(
                pose.heading_rad + odometry.twist().w_rad_s * until_effect_s,
            ),
            velocities: &self.velocities,
            walls: &self.walls,
            error: self.now.error,
            place_velocity: self.now.target.map_or(Vec2::zeros(), |(_, velocity)| velocity),
            ..seen(odometry, (alpha, self.now.front_velocity), &self.now.away)
        };
        let twist = match wish {
            Wish::Velocity(_) => self.avoidance.steer(&sample, gamma),
            Wish::Twist(twist) => self.avoidance.restrain(&sample, twist, gamma),
        };
        let published = match self.brief.published_velocity {
            PublishedVelocity::Gamma => gamma,
            PublishedVelocity::GammaAndBeta => {
                front_velocity(pose.heading_rad, self.brief.front_point_m, twist)
            }
            PublishedVelocity::Differenced => {
                let before = self.before.replace((odometry.stamp_ns, alpha));
                differenced(before, odometry.stamp_ns, alpha)
            }
        };

        self.sequence += 1;
        let slow = self.brief.slow.iter().filter(|fault| fault.span.holds(odometry.t_ns));
        Some(Answer {
            beacon: Beacon {
                tick,
                stamp_ns: odometry.stamp_ns,
                sent_ns: 0,
                incarnation: self.incarnation,
                x_m: alpha.x,
                y_m: alpha.y,
                vx_m_s: published.x,
                vy_m_s: published.y,
                frame_rank,
                ..Beacon::default()
            }
            .with_frame(frame),
            command: Command {
                tick,
                stamp_ns: match planted::is("odometry-age-ignored") {
                    true => self.start_ns + t_ns,
                    false => odometry.stamp_ns,
                },
                sent_ns: 0,
                sequence: self.sequence,
                incarnation: self.incarnation,
                v_m_s: twist.v_m_s,
                w_rad_s: twist.w_rad_s,
            },
            delay_ns: slow.map(|fault| fault.delay_ns).sum(),
        })
    }

    /// Where odometry fails: takes a sample as it is sent; the newest that has arrived by then, if it
    /// was not answered before.
    fn arrived(&mut self, odometry: &Odometry) -> Option<Odometry> {
        let link = self.odometry.as_mut()?;
        let Odometry { tick, t_ns, .. } = *odometry;
        let mut newest = link.pass(odometry, Transmission { tick, t_ns, distance_m: None });
        while let Some(sample) = link.due(t_ns) {
            if newest.is_none_or(|newest| sample.stamp_ns > newest.stamp_ns) {
                newest = Some(sample);
            }
        }
        let answered_ns = self.answered_ns;
        let newest = newest.filter(|sample| Some(sample.stamp_ns) > answered_ns)?;
        self.answered_ns = Some(newest.stamp_ns);
        Some(newest)
    }

    /// How long commands sent at this run time are under way, ns: the mean of what delays them.
    fn commands_late_ns(&self, t_ns: u64) -> u64 {
        let holding = self.brief.command_faults.iter().filter(|fault| fault.span.holds(t_ns));
        let late_ns = holding.map(|fault| match fault.kind {
            LinkFaultKind::Delay { delay_ns, jitter_ns } => delay_ns.saturating_add(jitter_ns / 2),
            _ => 0,
        });
        late_ns.max().unwrap_or(0)
    }

    /// What information ages came to since this was asked last: see [`Neighborhood::take_ages`].
    pub fn take_ages(&mut self, now_ns: u64) -> impl Iterator<Item = (usize, AgeSums)> {
        self.neighborhood.take_ages(now_ns)
    }

    /// How the brain is doing, for the supervisor. What missed a deadline or was too old it does not know.
    pub fn status(&self) -> (StatusHeader, impl ExactSizeIterator<Item = NeighborStatus>) {
        let (tick, t_ns) = self.newest.unwrap_or_default();
        let (goal, goal_since_ns) = self.sent.in_force();
        let header = StatusHeader {
            tick,
            t_ns,
            incarnation: self.incarnation,
            moving: u64::from(self.newest.is_some()),
            deadline_misses: 0,
            odometry_old: 0,
            beacons_refused: self.beacons_refused,
            frame: self.neighborhood.frame_contact().contact as u64,
            frame_since_t_ns: self.neighborhood.frame_contact().t_ns,
            goal_stamp_ns: goal.stamp_ns,
            goal_since_t_ns: goal_since_ns,
            goal_m: [goal.x_m, goal.y_m],
        };
        (header, self.neighborhood.status())
    }
}

impl Now {
    fn situation(&self) -> Option<Situation<'_>> {
        let (odometry, (error, desired_velocity)) = (self.odometry.as_ref()?, self.target?);
        Some(Situation {
            error,
            desired_velocity,
            period_s: self.period_s,
            age_periods: self.age_periods,
            t_s: t_s(odometry),
            pose: odometry.pose(),
            front_point: self.front_point,
            twist: odometry.twist(),
            away: &self.away,
            heard: &self.heard,
        })
    }
}

/// What a sample tells avoidance at once: where the robot is, at `alpha`, and who is near, at `away`.
fn seen<'a>(
    odometry: &Odometry,
    (front_point, front_velocity): (Vec2, Vec2),
    away: &'a [Vec2],
) -> Sample<'a> {
    let heading_rad = odometry.pose().heading_rad;
    Sample {
        stamp_ns: odometry.stamp_ns,
        t_s: odometry.t_ns as f64 / 1e9,
        heading_rad,
        heading_effect_rad: heading_rad,
        twist: odometry.twist(),
        front_point,
        front_velocity,
        away,
        proximity_valid: odometry.proximity_valid == 1,
        proximity_cut: odometry.proximity_cut == 1,
        velocities: &[],
        walls: &[],
        walls_cut: odometry.walls_cut == 1,
        error: None,
        place_velocity: Vec2::zeros(),
    }
}

/// A sample as a role sees it.
fn moment<'a>(odometry: &Odometry, neighborhood: &'a Neighborhood) -> Moment<'a> {
    let (stamp_ns, pose) = (odometry.stamp_ns, odometry.pose());
    Moment { stamp_ns, t_s: t_s(odometry), pose, neighborhood }
}

fn t_s(odometry: &Odometry) -> f64 {
    odometry.t_ns as f64 / 1e9
}

/// By how much alpha moved since the sample `before`, over the time between, m/s.
fn differenced(before: Option<(u64, Vec2)>, stamp_ns: u64, alpha: Vec2) -> Vec2 {
    before.map_or(Vec2::zeros(), |(then_ns, was)| {
        (alpha - was) / (stamp_ns.saturating_sub(then_ns).max(1) as f64 / 1e9)
    })
}

#[cfg(test)]
mod tests;
