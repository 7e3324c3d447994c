//! Robots that cannot stop at once.

use formation::ramp::Ramp;
use protocol::brief::LimitsBrief;

use super::Fleet;

/// How fast the robots of a fleet can brake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Inertia {
    /// v_max in 0.12 s, half of the largest turn rate in 0.35 s.
    Light,
    /// v_max in a second, a tenth of it when turning.
    Heavy,
    /// Every third like this, every third four times as heavy, every third stops at once.
    Mixed,
}

pub const INERTIAS: [Inertia; 3] = [Inertia::Light, Inertia::Heavy, Inertia::Mixed];

impl Fleet {
    /// The same robots with inertia, and the guard that knows it.
    pub fn with_inertia(mut self, inertia: Inertia) -> Fleet {
        let speed_max_m_s = self.agents[0].avoidance.speed_max_m_s;
        let robots = self.plant.robots.iter_mut().zip(&mut self.agents);
        for (place, (body, agent)) in robots.enumerate() {
            let (forward_s, turning_s, tau_s) = match (inertia, place % 3) {
                (Inertia::Light, _) | (Inertia::Mixed, 0) => (0.12, 0.7, 0.35),
                (Inertia::Heavy, _) => (1.0, 0.1, 0.8),
                (Inertia::Mixed, 1) => (0.5, 2.8, 0.7),
                (Inertia::Mixed, _) => continue,
            };
            body.limits = Some(LimitsBrief {
                acceleration_m_s2: speed_max_m_s / forward_s,
                turn_acceleration_rad_s2: speed_max_m_s / (body.front_point_m * turning_s),
                braking_time_s: tau_s,
                ramp: Ramp::Together,
            });
            agent.limits = body.limits;
        }
        let times_s = self.plant.robots.iter().filter_map(|body| body.limits);
        let most_s = times_s.map(|limits| limits.braking_time_s).fold(0.0, f64::max);
        for agent in &mut self.agents {
            agent.avoidance.braking_time_max_s = most_s;
        }
        self.sees_as_far_as_needed()
    }

    /// The same bodies, and the guard that does not know that they have inertia.
    pub fn without_knowing_its_inertia(mut self) -> Fleet {
        for agent in &mut self.agents {
            agent.limits = None;
            agent.avoidance.braking_time_max_s = 0.0;
        }
        self.sees_as_far_as_needed()
    }
}
