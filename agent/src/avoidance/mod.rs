//! Keeping distance: from the nominal velocity gamma to a twist (v, w).
//!
//! No I/O, no clock, no iceoryx2 in here. A method is one file and one row of [`METHODS`].
//!
//! | file | question it answers |
//! |---|---|
//! | `none` | what does the law alone do? (17) |
//! | `focus` | what does the chapter do? (11) (12) (19) |
//! | `guard` | what keeps d when samples are late, robots die, and nobody stops at once? |
//! | `braking` | what does inertia do to its figures? |
//! | `deflection` | which way leads around others? |
//! | `motion` | how do those near move? |
//! | `patience` | does the robot get where it wants, and when does it give up? |
//! | `near` | what is near, how fast may it come, and what distance is kept from it? |
//! | `cone` | in which directions may another be while a command acts? |
//! | `hold` | which held (v, w) moves the front point by exactly this much? |
//! | `polygon` | what is the nearest velocity that all bounds permit? |
//!
//! Methods of others, for comparison:
//!
//! | file | question it answers |
//! |---|---|
//! | `orca` | what does optimal reciprocal collision avoidance do? |
//! | `cbf_qp` | what do safety barrier certificates do? |
//! | `rbl` | what does the rule-based Lloyd algorithm do? |
//! | `holonomic` | how do wheels follow a velocity that a method chooses for a point? |
//! | `program` | what is the best velocity, if need be against some of the bounds? |

mod braking;
mod cbf_qp;
mod cone;
mod deflection;
mod focus;
mod guard;
mod hold;
mod holonomic;
#[cfg(test)]
mod ideal;
mod motion;
mod near;
mod none;
mod orca;
mod patience;
mod polygon;
mod program;
mod rbl;

use formation::Vec2;
use formation::front_point::front_speed;
use formation::pose::Twist;
use protocol::avoidance::{AvoidanceDescription, Conditions};
use protocol::brief::{AgentBrief, AvoidanceBrief};
use protocol::number::told_apart;

pub use deflection::{
    deflection_distance_m, deflection_share, wall_deflection_distance_m, wall_deflection_share,
};
pub use hold::exact_hold;

use crate::UnfitBrief;
pub use crate::gains::Gains;

/// One odometry sample as avoidance sees it.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// When it was sensed, ns.
    pub stamp_ns: u64,
    /// Time since the run's start, s.
    pub t_s: f64,
    /// Heading at the stamp, rad.
    pub heading_rad: f64,
    /// Heading expected when the answer takes effect, rad.
    pub heading_effect_rad: f64,
    /// The twist in force at the stamp.
    pub twist: Twist,
    /// Own front point, m, in `map`.
    pub front_point: Vec2,
    /// Its velocity at the stamp, m/s, in `map`.
    pub front_velocity: Vec2,
    /// z_j = own front point - other's, m, in `map`, nearest first.
    pub away: &'a [Vec2],
    /// The sensor works; `false`: nothing is known about who is near.
    pub proximity_valid: bool,
    /// The list of the near is not complete.
    pub proximity_cut: bool,
    /// Velocities of the others' front points, m/s, in `map`, in the order of `away`; empty where
    /// they are not sensed: only methods that ask for [`Senses::Velocities`] get them.
    ///
    /// [`Senses::Velocities`]: protocol::avoidance::Senses::Velocities
    pub velocities: &'a [Vec2],
    /// Own front point - the nearest point of each convex part of a wall or obstacle, m, in `map`,
    /// nearest first. The proximity sensor sees them too.
    pub walls: &'a [Vec2],
    /// The list of walls is not complete.
    pub walls_cut: bool,
    /// Own front point - the place wanted, m, in `map`; `None`: no place is.
    pub error: Option<Vec2>,
    /// How that place moves, m/s, in `map`.
    pub place_velocity: Vec2,
}

impl Sample<'_> {
    /// Everybody near: own front point - other's, m, and the other's velocity, m/s. `None` where
    /// nothing is known of that, and a robot that needs it stands.
    pub fn moving(&self) -> Option<impl Iterator<Item = (Vec2, Vec2)>> {
        let known = self.proximity_valid && self.velocities.len() == self.away.len();
        known.then(|| self.away.iter().copied().zip(self.velocities.iter().copied()))
    }
}

/// A method of keeping distance: what one robot does about those that it senses near.
pub trait Avoidance: Send {
    /// gamma, m/s, as it may be used and published.
    fn admit(&self, gamma: Vec2) -> Vec2 {
        gamma
    }

    /// e = alpha - alpha*, m, as the law is to see it, with those near as in `sample`, of which
    /// velocities, walls and the error itself are not known yet: another where alpha* is a place that
    /// somebody has taken.
    fn stand_off(&mut self, sample: &Sample<'_>, error: Vec2) -> Vec2 {
        let _ = sample;
        error
    }

    /// The twist that follows the admitted gamma from `heading_rad` while nobody is near.
    fn follow(&self, heading_rad: f64, gamma: Vec2) -> Twist;

    /// The twist that answers `sample`, given the admitted gamma.
    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist;

    /// The twist that answers `sample` where the robot wants the twist `wanted` itself, which gives
    /// its front point the velocity gamma (as admitted): by that, where a method knows velocities
    /// alone.
    fn restrain(&mut self, sample: &Sample<'_>, wanted: Twist, gamma: Vec2) -> Twist {
        let _ = wanted;
        self.steer(sample, gamma)
    }
}

/// A row of [`METHODS`].
pub struct AvoidanceRow {
    /// Name, source, keys and figures, as the supervisor may know them.
    pub description: AvoidanceDescription,
    /// Makes the method of a brief and of its gains (all present and positive).
    pub build: fn(&AgentBrief, &Gains<'_>) -> Box<dyn Avoidance>,
}

impl AvoidanceRow {
    /// The method for the robot of this brief.
    pub fn make(&self, brief: &AgentBrief) -> Result<Box<dyn Avoidance>, UnfitBrief> {
        let of = format!("avoidance {:?}", self.description.name);
        let keys = self.description.gains.iter();
        let keys = keys.map(|gain| (gain.key, gain.otherwise.is_none()));
        let gains = Gains::check(&brief.avoidance.gains, &of, keys)?;
        let AvoidanceBrief { speed_max_m_s, sensing_radius_m, .. } = brief.avoidance;
        if self.description.clamps_speed && !speed_max_m_s.is_finite() {
            let got = format!("got avoidance.speed_max_m_s = {speed_max_m_s}");
            return Err(UnfitBrief(format!("{of} needs a speed limit, {got}")));
        }
        let needed_m = (self.description.sensing_radius_m)(&Conditions::of(brief));
        // Not a number is less than anything.
        if sensing_radius_m.is_nan() || sensing_radius_m < needed_m {
            let [found, needed] = told_apart(sensing_radius_m, needed_m);
            let radius =
                format!("avoidance.sensing_radius_m = {found}, expected {needed} m or more");
            return Err(UnfitBrief(format!("{of} sees too late with {radius}")));
        }
        Ok((self.build)(brief, &gains))
    }
}

/// Every method there is; the first is the default.
pub const METHODS: &[AvoidanceRow] =
    &[guard::ROW, focus::ROW, none::ROW, orca::ROW, cbf_qp::ROW, rbl::ROW];

/// The method that a brief asks for.
pub fn build(brief: &AgentBrief) -> Result<Box<dyn Avoidance>, UnfitBrief> {
    let name = &brief.avoidance.kind;
    let row = METHODS.iter().find(|row| row.description.name == name).ok_or_else(|| {
        let known: Vec<_> = METHODS.iter().map(|row| row.description.name).collect();
        UnfitBrief(format!("unknown avoidance {name:?}, expected one of {}", known.join(", ")))
    })?;
    row.make(brief)
}

/// `vector`, shortened to `length_max` if it is longer.
#[inline]
fn clip(vector: Vec2, length_max: f64) -> Vec2 {
    match vector.norm_squared() > length_max * length_max {
        true => shortened(vector, length_max),
        false => vector,
    }
}

/// Seldom needed: roots and quotients are slow.
#[cold]
fn shortened(vector: Vec2, length: f64) -> Vec2 {
    vector * (length / vector.norm())
}

/// `twist`, slowed down on its path until the front point is no faster than `speed_max`, m/s.
#[inline]
fn within_speed(speed_max: f64, ell: f64, twist: Twist) -> Twist {
    let speed = front_speed(ell, twist);
    if speed > speed_max { twist.scaled(speed_max / speed) } else { twist }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Default for Sample<'_> {
        /// At the start, with a sensor that works and nobody near.
        fn default() -> Self {
            Sample {
                stamp_ns: 0,
                t_s: 0.0,
                heading_rad: 0.0,
                heading_effect_rad: 0.0,
                twist: Twist::ZERO,
                front_point: Vec2::zeros(),
                front_velocity: Vec2::zeros(),
                away: &[],
                proximity_valid: true,
                proximity_cut: false,
                velocities: &[],
                walls: &[],
                walls_cut: false,
                error: None,
                place_velocity: Vec2::zeros(),
            }
        }
    }

    #[test]
    fn how_others_move_is_known_only_with_a_velocity_for_each_from_a_sensor_that_works() {
        let (away, velocities) = ([Vec2::new(0.1, 0.0)], [Vec2::new(0.0, 0.3)]);
        let sample = Sample { away: &away, velocities: &velocities, ..Sample::default() };
        let known = |sample: Sample<'_>| sample.moving().map(Iterator::collect::<Vec<_>>);
        assert_eq!(known(sample), Some(vec![(away[0], velocities[0])]));
        assert_eq!(known(Sample { velocities: &[], ..sample }), None);
        assert_eq!(known(Sample { proximity_valid: false, ..sample }), None);
    }
}
