//! One robot's brain: (odometry, beacons heard) in, (beacon, command) out.
//!
//! Pure: no I/O, no clock, no iceoryx2. The same brain runs in a process of its own and, composed
//! with the plant's world, inside a test that foretells the process's every bit.

use formation::Vec2;
use formation::front_point::front_point;
use formation::pose::wrap_angle;
use protocol::brief::{AgentBrief, Pace};
use protocol::message::{Beacon, Command, NeighborStatus, Odometry, StatusHeader};

use crate::avoidance::{Avoidance, Sample};
use crate::laws::{self, Law, LawError, Situation};
use crate::neighborhood::{BeaconRefusal, Neighborhood};

/// a of the boundary layer: how many periods old a beacon is when it is used. In lockstep exactly
/// one; in real time up to one of the sender's period and one of delivery and phase.
fn age_periods(pace: Pace) -> f64 {
    match pace {
        Pace::Lockstep => 1.0,
        Pace::Realtime => 2.0,
    }
}

/// One robot's brain.
pub struct Brain {
    incarnation: u64,
    front_point_m: f64,
    period_s: f64,
    age_periods: f64,
    law: Box<dyn Law>,
    avoidance: Avoidance,
    neighborhood: Neighborhood,
    away: Vec<Vec2>,
    sequence: u64,
    beacons_refused: u64,
    newest: Option<(u64, u64)>,
}

/// What a brain answers to one odometry sample.
#[derive(Debug, Clone, Copy)]
pub struct Answer {
    /// For those that hear this robot.
    pub beacon: Beacon,
    /// For the plant.
    pub command: Command,
    /// Some neighbour's contact changed.
    pub contacts_changed: bool,
}

impl Brain {
    /// A brain that has heard nothing yet.
    pub fn new(brief: &AgentBrief, incarnation: u64) -> Result<Brain, LawError> {
        Ok(Brain {
            incarnation,
            front_point_m: brief.front_point_m,
            period_s: brief.period_ns as f64 / 1e9,
            age_periods: age_periods(brief.pace),
            law: laws::build(&brief.law, &brief.gains)?,
            avoidance: Avoidance::new(brief),
            neighborhood: Neighborhood::new(&brief.neighbors, brief.silence.clone()),
            away: Vec::new(),
            sequence: 0,
            beacons_refused: 0,
            newest: None,
        })
    }

    /// Takes a beacon from the neighbour at `place` (in the brief's order). A refused one is
    /// counted and changes nothing.
    pub fn hear(
        &mut self,
        place: usize,
        beacon: &Beacon,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        let heard = self.neighborhood.hear(place, beacon, now_ns);
        self.beacons_refused += u64::from(heard.is_err());
        heard
    }

    /// Answers an odometry sample. `effect_ns`: the stamp at which the answer is expected to take
    /// effect; the sample's own stamp in lockstep. The caller fills in `sent_ns`.
    pub fn answer(&mut self, odometry: &Odometry, effect_ns: u64) -> Answer {
        self.newest = Some((odometry.tick, odometry.t_ns));
        let contacts_changed =
            self.neighborhood.judge(odometry.tick, odometry.t_ns, odometry.stamp_ns);

        let pose = odometry.pose();
        let alpha = front_point(pose, self.front_point_m); // (2)
        let gamma = match self.neighborhood.desired(odometry.stamp_ns) {
            None => Vec2::zeros(),
            Some(desired) => self.law.gamma(&Situation {
                error: alpha - desired,
                period_s: self.period_s,
                age_periods: self.age_periods,
            }),
        };
        let gamma = self.avoidance.admit(gamma);

        self.away.clear();
        self.away.extend(odometry.proximity().map(|other| alpha - other));
        let until_effect_s = effect_ns.saturating_sub(odometry.stamp_ns) as f64 / 1e9;
        let sample = Sample {
            stamp_ns: odometry.stamp_ns,
            t_s: odometry.t_ns as f64 / 1e9,
            heading_rad: pose.heading_rad,
            heading_effect_rad: wrap_angle(
                pose.heading_rad + odometry.twist().w_rad_s * until_effect_s,
            ),
            away: &self.away,
            proximity_valid: odometry.proximity_valid == 1,
            proximity_cut: odometry.proximity_cut == 1,
        };
        let twist = self.avoidance.steer(&sample, gamma);

        self.sequence += 1;
        Answer {
            beacon: Beacon {
                tick: odometry.tick,
                stamp_ns: odometry.stamp_ns,
                sent_ns: 0,
                incarnation: self.incarnation,
                x_m: alpha.x,
                y_m: alpha.y,
                vx_m_s: gamma.x,
                vy_m_s: gamma.y,
            },
            command: Command {
                tick: odometry.tick,
                stamp_ns: odometry.stamp_ns,
                sent_ns: 0,
                sequence: self.sequence,
                incarnation: self.incarnation,
                v_m_s: twist.v_m_s,
                w_rad_s: twist.w_rad_s,
            },
            contacts_changed,
        }
    }

    /// How the brain is doing, for the supervisor. The caller knows the deadline misses.
    pub fn status(
        &self,
        deadline_misses: u64,
    ) -> (StatusHeader, impl ExactSizeIterator<Item = NeighborStatus>) {
        let (tick, t_ns) = self.newest.unwrap_or_default();
        let header = StatusHeader {
            tick,
            t_ns,
            incarnation: self.incarnation,
            flying: u64::from(self.newest.is_some()),
            deadline_misses,
            beacons_refused: self.beacons_refused,
        };
        (header, self.neighborhood.status())
    }
}
