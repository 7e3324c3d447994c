//! Keeping distance: from the nominal velocity gamma to a twist (v, w).
//!
//! No I/O, no clock, no iceoryx2 in here.
//!
//! | file | question it answers |
//! |---|---|
//! | `focus` | what does the chapter do? (11) (12) (19) |
//! | `guard` | what keeps d when samples are late and robots die? |
//! | `hold` | which held (v, w) moves the front point by exactly this much? |
//! | `polygon` | what is the nearest velocity that all bounds permit? |

mod focus;
mod guard;
mod hold;
mod polygon;

use formation::Vec2;
use formation::front_point::twist_for;
use formation::pose::Twist;
use protocol::brief::{AgentBrief, AvoidanceKind};

use focus::Focus;
pub use guard::Guard;
pub use hold::exact_hold;

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
    /// z_j = own front point - other's, m, in `map`, nearest first.
    pub away: &'a [Vec2],
    /// The sensor works; `false`: nothing is known about who is near.
    pub proximity_valid: bool,
    /// The list of the near is not complete.
    pub proximity_cut: bool,
}

/// One of the three kinds.
pub enum Avoidance {
    /// gamma alone, literally. (17)
    None {
        /// ell, m.
        front_point_m: f64,
    },
    /// The chapter's repulsive field, literally. (19)
    Focus(Focus),
    /// The bound that survives sampling and death.
    Guard(Box<Guard>),
}

impl Avoidance {
    /// The kind that the brief asks for.
    pub fn new(brief: &AgentBrief) -> Avoidance {
        let front_point_m = brief.front_point_m;
        match brief.avoidance.kind {
            AvoidanceKind::None => Avoidance::None { front_point_m },
            AvoidanceKind::Focus => Avoidance::Focus(Focus::new(brief)),
            AvoidanceKind::Guard => Avoidance::Guard(Box::new(Guard::new(brief))),
        }
    }

    /// gamma as it may be used and published: `guard` clips it to v_max.
    pub fn admit(&self, gamma: Vec2) -> Vec2 {
        match self {
            Avoidance::Guard(guard) => guard.admit(gamma),
            Avoidance::None { .. } | Avoidance::Focus(_) => gamma,
        }
    }

    /// The twist that follows the admitted gamma from `heading_rad` while nobody is near: held for
    /// a period it moves the front point by gamma T exactly with `guard`, by (17) otherwise.
    pub fn follow(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        match self {
            Avoidance::None { front_point_m } => twist_for(heading_rad, *front_point_m, gamma),
            Avoidance::Focus(focus) => focus.follow(heading_rad, gamma),
            Avoidance::Guard(guard) => guard.follow(heading_rad, gamma),
        }
    }

    /// The twist that answers `sample`, given the admitted gamma.
    pub fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        match self {
            Avoidance::None { .. } => self.follow(sample.heading_rad, gamma),
            Avoidance::Focus(focus) => focus.steer(sample, gamma),
            Avoidance::Guard(guard) => guard.steer(sample, gamma),
        }
    }
}
