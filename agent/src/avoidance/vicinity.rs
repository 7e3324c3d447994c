//! Neighbors and walls in range of a robot.
//!
//! The bounds of the guard use no more than `proof/Braking.v::near` states. Of the slack between two robots
//! each may use up the fraction Lambda per second, since the other does the same. A wall uses up nothing, so
//! the robot may use up 2 Lambda. (`proof/Obstacles.v::an_obstacle`, `proof/Walls.v::wall_bound`)

use formation::Vec2;
use protocol::avoidance::MethodConditions;
use protocol::brief::RobotClassBrief;

use super::Sample;

/// Multiples of Lambda for another robot and for a wall.
const ROBOT_SLACK_RATE_FACTOR: f64 = 1.0;
const WALL_SLACK_RATE_FACTOR: f64 = 2.0;

/// A neighbor or wall in range.
#[derive(Debug, Clone, Copy)]
pub struct NearbyObject {
    /// Own front point - nearest point of the neighbor or wall, m.
    pub z: Vec2,
    /// Maximum own speed of the neighbor, m/s. It is 0 for a wall.
    pub neighbor_speed_max: f64,
    /// Multiple of Lambda that the robot may use up of the slack per second.
    pub slack_rate_factor: f64,
    /// Minimum distance to be kept, m: d or the clearance.
    pub distance_min: f64,
}

/// Minimum distances, speed limits, and the radii within which neighbors and walls must be known.
#[derive(Debug, Clone)]
pub struct VicinityParameters {
    /// Distance and speed limit of a robot of an unknown class, and of every robot if the brief has no classes.
    pub(super) default_class: RobotClassBrief,
    /// Distances and speed limits of robots by their class.
    classes: Vec<RobotClassBrief>,
    clearance: f64,
    /// Radius within which all robots must be known, m.
    pub(super) known_robots_radius: f64,
    /// Radius within which all walls must be known, m.
    pub(super) known_walls_radius: f64,
}

impl VicinityParameters {
    /// Creates the parameters with the radii within which all robots, and all walls, must be known, m.
    pub fn new(
        conditions: &MethodConditions<'_>,
        [robots_radius, walls_radius]: [f64; 2],
    ) -> VicinityParameters {
        let avoidance = conditions.avoidance;
        let speeds_max = avoidance.classes.iter().map(|class| class.speed_max_m_s);
        VicinityParameters {
            default_class: RobotClassBrief {
                distance_min_m: avoidance.distance_min_m,
                speed_max_m_s: speeds_max.reduce(f64::max).unwrap_or(avoidance.speed_max_m_s),
            },
            classes: avoidance.classes.clone(),
            clearance: avoidance.clearance_m,
            known_robots_radius: robots_radius,
            known_walls_radius: walls_radius,
        }
    }

    /// Returns the sensed robots, then the walls, that are within the radii. Each robot has the distance and the speed
    /// of its class; of an unknown class the largest are assumed.
    #[inline]
    pub fn objects_in_range(&self, sample: &Sample<'_>) -> impl Iterator<Item = NearbyObject> {
        let wall = NearbyObject {
            z: Vec2::zeros(),
            neighbor_speed_max: 0.0,
            slack_rate_factor: WALL_SLACK_RATE_FACTOR,
            distance_min: self.clearance,
        };
        let within = |radius: f64| move |z: &Vec2| z.norm_squared() < radius * radius;
        let [is_near_robot, is_near_wall] =
            [within(self.known_robots_radius), within(self.known_walls_radius)];
        let robots = sample.neighbor_vectors.iter().enumerate();
        let robots = robots.filter(move |(_, z)| is_near_robot(z));
        let walls = sample.wall_vectors.iter().filter(move |z| is_near_wall(z));
        robots
            .map(move |(index, &z)| {
                let class = self.class_of(sample, index);
                NearbyObject {
                    z,
                    neighbor_speed_max: class.speed_max_m_s,
                    slack_rate_factor: ROBOT_SLACK_RATE_FACTOR,
                    distance_min: class.distance_min_m,
                }
            })
            .chain(walls.map(move |&z| NearbyObject { z, ..wall }))
    }

    /// Returns the distance and the speed limit of the sensed robot with this index. Of an unknown class the largest
    /// are assumed.
    #[inline]
    fn class_of(&self, sample: &Sample<'_>, index: usize) -> RobotClassBrief {
        if self.classes.is_empty() {
            return self.default_class;
        }
        let class = sample.neighbor_classes.get(index).map(|&class| usize::from(class));
        class.and_then(|class| self.classes.get(class)).copied().unwrap_or(self.default_class)
    }

    /// Returns `true` if the neighbors within the radii are not completely known. The proofs require all robots
    /// closer than `proof/Guard.v::far` or `proof/Braking.v::far_braking`, and all walls closer than
    /// `proof/Walls.v::far_wall` or the latter.
    #[inline]
    pub fn lacks_neighbor_information(&self, sample: &Sample<'_>) -> bool {
        let is_incomplete = |is_truncated: bool, vectors: &[Vec2], radius: f64| {
            is_truncated && vectors.last().map_or(0.0, |z| z.norm()) < radius
        };
        !sample.proximity_valid
            || is_incomplete(
                sample.neighbors_truncated,
                sample.neighbor_vectors,
                self.known_robots_radius,
            )
            || is_incomplete(sample.walls_truncated, sample.wall_vectors, self.known_walls_radius)
    }
}
