//! Teams of robots with different sizes, speed limits and command timeouts.

use protocol::brief::{MemberBrief, RobotClassBrief};

use super::Fleet;

/// Sizes of the robots, in turn, as a fraction of d. The largest two keep d.
const SIZES: [f64; 3] = [0.5, 0.25, 0.4];
/// Speed limits of the robots, in turn, as a fraction of v_max.
const SPEEDS: [f64; 4] = [1.0, 1.25, 0.5, 0.8];
/// Command timeouts of the robots, in turn, in multiples of H, at most as long as the period of the faults permits.
const LIFETIMES: [u64; 2] = [1, 2];

impl Fleet {
    /// Returns the fleet as a team. Robots sense the classes of others if `sensed`.
    pub fn into_team(mut self, sensed: bool) -> Fleet {
        let (d, v_max) = (self.plant.distance_min_m, self.agents[0].avoidance.speed_max_m_s);
        let own =
            |index: usize| (SIZES[index % SIZES.len()] * d, SPEEDS[index % SPEEDS.len()] * v_max);
        let robots = self.agents.len();
        let lifetime_ns = |index: usize, ns: u64| LIFETIMES[index % LIFETIMES.len()] * ns;
        let longest_ns =
            (0..robots).map(|i| lifetime_ns(i, self.plant.command_lifetime_ns)).max().unwrap();
        let maxima =
            (0..robots).map(own).fold((0.0f64, 0.0f64), |a, b| (a.0.max(b.0), a.1.max(b.1)));
        let bodies = self.plant.robots.iter_mut().zip(&mut self.agents);
        for (index, (body, agent)) in bodies.enumerate() {
            let (keep_m, speed_max_m_s) = own(index);
            let command_lifetime_ns = lifetime_ns(index, self.plant.command_lifetime_ns);
            let class = if sensed { index as u8 } else { 0 };
            body.member = Some(MemberBrief {
                keep_m,
                speed_max_m_s: Some(speed_max_m_s),
                command_lifetime_ns,
                class,
            });
            let class = |(other_m, speed_max_m_s): (f64, f64)| RobotClassBrief {
                distance_min_m: keep_m + other_m,
                speed_max_m_s,
            };
            let avoidance = &mut agent.avoidance;
            avoidance.classes = match sensed {
                true => (0..robots).map(|other| class(own(other))).collect(),
                false => vec![class(maxima)],
            };
            let distances_m = avoidance.classes.iter().map(|class| class.distance_min_m);
            avoidance.distance_min_m = distances_m.fold(0.0, f64::max);
            avoidance.speed_max_m_s = speed_max_m_s;
            avoidance.command_timeout_max_s = longest_ns as f64 / 1e9;
            agent.command_lifetime_ns = command_lifetime_ns;
        }
        self.sees_as_far_as_needed()
    }
}
