//! Robots with other bodies than a front point.

use formation::drive::DriveKind;
use formation::front_point::front_point;

use super::Fleet;

/// Maximum turn rates of robots at their axle midpoints, in turn, rad/s.
const TURN_RATES_RAD_S: [f64; 3] = [4.0, 1.5, 9.0];
/// Maximum turn rates of omnidirectional robots, in turn, rad/s; 0 for a drone at fixed height.
const OMNI_TURN_RATES_RAD_S: [f64; 3] = [4.0, 0.0, 9.0];
/// Minimum turning radii of cars, in turn, m.
const TURNING_RADII_M: [f64; 3] = [0.15, 0.05, 0.4];
/// Maximum turn rate of a drone at fixed height, rad/s.
const DRONE_TURN_RATE_RAD_S: f64 = 0.0;

impl Fleet {
    /// Returns the fleet with every robot controlled at its axle midpoint, which starts where the front point was.
    pub fn at_axle(self) -> Fleet {
        self.with_bodies(1, |_| DriveKind::Differential)
    }

    /// Returns the fleet with every second robot controlled at its axle midpoint.
    pub fn at_axle_in_turn(self) -> Fleet {
        self.with_bodies(2, |_| DriveKind::Differential)
    }

    /// Returns the fleet with every robot omnidirectional and controlled at its center, where the front point was.
    pub fn omnidirectional(self) -> Fleet {
        self.with_bodies(1, |_| DriveKind::Omni)
    }

    /// Returns the fleet with every robot a drone at fixed height: omnidirectional, with a constant heading.
    pub fn drones(self) -> Fleet {
        let mut fleet = self.omnidirectional();
        let robots = fleet.plant.robots.iter_mut().zip(&mut fleet.agents);
        for (body, agent) in robots {
            body.turn_rate_max_rad_s = Some(DRONE_TURN_RATE_RAD_S);
            agent.turn_rate_max_rad_s = body.turn_rate_max_rad_s;
        }
        fleet
    }

    /// Returns the fleet with every second robot a drone at fixed height.
    pub fn drones_in_turn(self) -> Fleet {
        let mut fleet = self.with_bodies(2, |_| DriveKind::Omni);
        let robots = fleet.plant.robots.iter_mut().zip(&mut fleet.agents);
        for (body, agent) in robots.step_by(2) {
            body.turn_rate_max_rad_s = Some(DRONE_TURN_RATE_RAD_S);
            agent.turn_rate_max_rad_s = body.turn_rate_max_rad_s;
        }
        fleet
    }

    /// Returns the fleet with every robot a car controlled at its rear axle, which starts where the front point was.
    pub fn cars(self) -> Fleet {
        self.with_cars(1)
    }

    /// Returns the fleet with every second robot a car.
    pub fn cars_in_turn(self) -> Fleet {
        self.with_cars(2)
    }

    /// Returns the fleet with every robot of `every` a car.
    fn with_cars(self, every: usize) -> Fleet {
        let mut fleet = self.with_bodies(every, |_| DriveKind::Ackermann);
        let robots = fleet.plant.robots.iter_mut().zip(&mut fleet.agents);
        for (index, (body, agent)) in robots.enumerate().step_by(every) {
            let radius_m = TURNING_RADII_M[index % TURNING_RADII_M.len()];
            body.turning_radius_min_m = Some(radius_m);
            agent.turning_radius_min_m = body.turning_radius_min_m;
        }
        fleet.sees_as_far_as_needed()
    }

    /// Returns the fleet with a robot of each kind in turn: omnidirectional, at its front point, at its axle midpoint,
    /// at its front point.
    pub fn of_all_bodies(self) -> Fleet {
        self.with_bodies(2, |index| match index % 4 {
            0 => DriveKind::Omni,
            _ => DriveKind::Differential,
        })
    }

    /// Returns the fleet with every robot of `every` controlled without a front point, with the drive that `kind`
    /// returns for its index.
    fn with_bodies(mut self, every: usize, kind: impl Fn(usize) -> DriveKind) -> Fleet {
        let robots = self.plant.robots.iter_mut().zip(&mut self.agents);
        for (index, (body, agent)) in robots.enumerate().step_by(every) {
            let alpha = front_point(body.start, body.front_point_m);
            (body.start.x_m, body.start.y_m) = (alpha.x, alpha.y);
            body.front_point_m = 0.0;
            body.drive_kind = kind(index);
            let turn_rates = match body.drive_kind {
                DriveKind::Differential | DriveKind::Ackermann => TURN_RATES_RAD_S,
                DriveKind::Omni => OMNI_TURN_RATES_RAD_S,
            };
            body.turn_rate_max_rad_s = Some(turn_rates[index % turn_rates.len()]);
            (agent.front_point_m, agent.drive_kind) = (0.0, body.drive_kind);
            agent.turn_rate_max_rad_s = body.turn_rate_max_rad_s;
        }
        self.sees_as_far_as_needed()
    }
}
