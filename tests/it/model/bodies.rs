//! Robots with other bodies than a front point.

use formation::front_point::front_point;

use super::Fleet;

/// Maximum turn rates of robots at their axle midpoints, in turn, rad/s.
const TURN_RATES_RAD_S: [f64; 3] = [4.0, 1.5, 9.0];

impl Fleet {
    /// Returns the fleet with every robot controlled at its axle midpoint, which starts where the front point was.
    pub fn at_axle(self) -> Fleet {
        self.with_axles(1)
    }

    /// Returns the fleet with every second robot controlled at its axle midpoint.
    pub fn at_axle_in_turn(self) -> Fleet {
        self.with_axles(2)
    }

    fn with_axles(mut self, every: usize) -> Fleet {
        let robots = self.plant.robots.iter_mut().zip(&mut self.agents);
        for (place, (body, agent)) in robots.enumerate().step_by(every) {
            let alpha = front_point(body.start, body.front_point_m);
            (body.start.x_m, body.start.y_m) = (alpha.x, alpha.y);
            body.front_point_m = 0.0;
            body.turn_rate_max_rad_s = Some(TURN_RATES_RAD_S[place % TURN_RATES_RAD_S.len()]);
            (agent.front_point_m, agent.turn_rate_max_rad_s) = (0.0, body.turn_rate_max_rad_s);
        }
        self.sees_as_far_as_needed()
    }
}
