//! Neighbors and walls in range of a robot.
//!
//! The bounds of the guard use no more than `proof/Braking.v::near` states. Of the slack between two robots
//! each may use up the fraction Lambda per second, since the other does the same. A wall uses up nothing, so
//! the robot may use up 2 Lambda. (`proof/Obstacles.v::an_obstacle`, `proof/Walls.v::wall_bound`)

use formation::Vec2;
use protocol::avoidance::Conditions;

use super::Sample;

/// Multiples of Lambda for another robot and for a wall.
const ROBOT_FACTOR: f64 = 1.0;
const WALL_FACTOR: f64 = 2.0;

/// A neighbor or wall in range.
#[derive(Debug, Clone, Copy)]
pub struct NearbyObject {
    /// Own front point - nearest point of the neighbor or wall, m.
    pub z: Vec2,
    /// Maximum own speed of the neighbor, m/s. It is 0 for a wall.
    pub speed: f64,
    /// Multiple of Lambda that the robot may use up of the slack per second.
    pub share: f64,
    /// Minimum distance to be kept, m: d or the clearance.
    pub distance_min: f64,
}

/// Minimum distances, the speed limit, and the radii within which neighbors and walls must be known.
#[derive(Debug, Clone, Copy)]
pub struct Vicinity {
    d: f64,
    v_max: f64,
    clearance: f64,
    /// Radius within which all robots must be known, m.
    pub(super) robots_radius: f64,
    /// Radius within which all walls must be known, m.
    pub(super) walls_radius: f64,
}

impl Vicinity {
    /// Creates the parameters with the radii within which all robots, and all walls, must be known, m.
    pub fn new(at: &Conditions<'_>, [robots_radius, walls_radius]: [f64; 2]) -> Vicinity {
        Vicinity {
            d: at.avoidance.distance_min_m,
            v_max: at.avoidance.speed_max_m_s,
            clearance: at.avoidance.clearance_m,
            robots_radius,
            walls_radius,
        }
    }

    /// Returns the sensed robots, then the walls, that are within the radii.
    #[inline]
    pub fn objects_in_range<'s>(
        self,
        sample: &Sample<'s>,
    ) -> impl Iterator<Item = NearbyObject> + use<'s> {
        let robot = NearbyObject {
            z: Vec2::zeros(),
            speed: self.v_max,
            share: ROBOT_FACTOR,
            distance_min: self.d,
        };
        let wall =
            NearbyObject { speed: 0.0, share: WALL_FACTOR, distance_min: self.clearance, ..robot };
        let within = |radius: f64| move |z: &&Vec2| z.norm_squared() < radius * radius;
        let robots = sample.away.iter().filter(within(self.robots_radius));
        let walls = sample.walls.iter().filter(within(self.walls_radius));
        robots
            .map(move |&z| NearbyObject { z, ..robot })
            .chain(walls.map(move |&z| NearbyObject { z, ..wall }))
    }

    /// Returns `true` if the neighbors within the radii are not completely known. The proofs require all robots
    /// closer than `proof/Guard.v::far` or `proof/Braking.v::far_braking`, and all walls closer than
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
