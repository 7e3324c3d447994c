//! What is near a robot: others, which move too, and walls, which do not.
//!
//! The guard's bounds ask no more of it than `proof/Braking.v::near` has. Of the slack between two
//! robots each may use up a share of Lambda, since the other does the same. A wall uses up nothing, so
//! that the robot has all of it: 2 Lambda. (`proof/Obstacles.v::an_obstacle`, `proof/Walls.v::wall_bound`)

use formation::Vec2;
use protocol::avoidance::Conditions;
use protocol::planted;

use super::Sample;

/// Shares of Lambda.
const OF_ANOTHER: f64 = 1.0;
const OF_A_WALL: f64 = 2.0;

/// One of those near.
#[derive(Debug, Clone, Copy)]
pub struct Near {
    /// Own front point - its point, m.
    pub z: Vec2,
    /// How fast it may come by itself, m/s.
    pub speed: f64,
    /// What share of Lambda the robot may use up of the slack a second.
    pub share: f64,
    /// What distance is kept, m: d or the clearance.
    pub distance_min: f64,
}

/// What distances are kept, how fast others are, and how far the robot must see.
#[derive(Debug, Clone, Copy)]
pub struct Vicinity {
    d: f64,
    v_max: f64,
    clearance: f64,
    /// Within this radius all robots must be known, m.
    pub(super) robots_radius: f64,
    /// Within this radius all walls must be known, m.
    pub(super) walls_radius: f64,
}

impl Vicinity {
    /// Within `robots_radius` all robots must be known, within `walls_radius` all walls, m.
    pub fn new(at: &Conditions<'_>, [robots_radius, walls_radius]: [f64; 2]) -> Vicinity {
        Vicinity {
            d: at.avoidance.distance_min_m,
            v_max: at.avoidance.speed_max_m_s,
            clearance: at.avoidance.clearance_m,
            robots_radius,
            walls_radius,
        }
    }

    /// All who are near enough to matter, as far as the sample says: robots, then walls.
    #[inline]
    pub fn near<'s>(self, sample: &Sample<'s>) -> impl Iterator<Item = Near> + use<'s> {
        let share = if planted::is("share-doubled") { OF_A_WALL } else { OF_ANOTHER };
        let robot = Near { z: Vec2::zeros(), speed: self.v_max, share, distance_min: self.d };
        let wall = Near { speed: 0.0, share: OF_A_WALL, distance_min: self.clearance, ..robot };
        let within = |radius: f64| move |z: &&Vec2| z.norm_squared() < radius * radius;
        let robots = sample.away.iter().filter(within(self.robots_radius));
        let walls = sample.walls.iter().filter(within(self.walls_radius));
        robots.map(move |&z| Near { z, ..robot }).chain(walls.map(move |&z| Near { z, ..wall }))
    }

    /// Nothing, or not enough, is known about what is near: the proofs need all robots that are nearer
    /// than `proof/Guard.v::far` or `proof/Braking.v::far_braking`, and all walls nearer than
    /// `proof/Walls.v::far_wall` or the latter.
    #[inline]
    pub fn is_blind(self, sample: &Sample<'_>) -> bool {
        let misses = |cut: bool, listed: &[Vec2], radius: f64| {
            cut && listed.last().map_or(0.0, |z| z.norm()) < radius
        };
        !sample.proximity_valid
            || misses(sample.proximity_cut, sample.away, self.robots_radius)
            || misses(sample.walls_cut, sample.walls, self.walls_radius)
    }
}
