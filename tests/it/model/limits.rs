//! Robots with inertia, which cannot stop at once.

use formation::ramp::Ramp;
use protocol::brief::AccelerationLimitsBrief;

use super::Fleet;

/// Braking capability of the robots of a fleet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Inertia {
    /// Braking from v_max in 0.12 s, and from half of the maximum turn rate in 0.35 s.
    Light,
    /// Braking from v_max in 1 s, and from the maximum turn rate in 0.1 s.
    Heavy,
    /// Three kinds of robots in turn: as `Light`, about four times as heavy, without inertia.
    Mixed,
}

pub const INERTIAS: [Inertia; 3] = [Inertia::Light, Inertia::Heavy, Inertia::Mixed];

impl Fleet {
    /// Returns the fleet with inertia, and a guard that accounts for it.
    pub fn with_inertia(mut self, inertia: Inertia) -> Fleet {
        let speed_max_m_s = self.agents[0].avoidance.speed_max_m_s;
        let robots = self.plant.robots.iter_mut().zip(&mut self.agents);
        for (index, (body, agent)) in robots.enumerate() {
            let (forward_s, turning_s, tau_s) = match (inertia, index % 3) {
                (Inertia::Light, _) | (Inertia::Mixed, 0) => (0.12, 0.7, 0.35),
                (Inertia::Heavy, _) => (1.0, 0.1, 0.8),
                (Inertia::Mixed, 1) => (0.5, 2.8, 0.7),
                (Inertia::Mixed, _) => continue,
            };
            body.limits = Some(AccelerationLimitsBrief {
                acceleration_m_s2: speed_max_m_s / forward_s,
                turn_acceleration_rad_s2: body.drive().turn_rate_bound(speed_max_m_s) / turning_s,
                braking_time_s: tau_s,
                ramp: match body.drive().turns_freely() {
                    true => Ramp::Independent,
                    false => Ramp::Together,
                },
            });
            agent.limits = body.limits;
        }
        let times_s = self.plant.robots.iter().filter_map(|body| body.limits);
        let longest_s = times_s.map(|limits| limits.braking_time_s).fold(0.0, f64::max);
        for agent in &mut self.agents {
            agent.avoidance.braking_time_max_s = longest_s;
        }
        self.sees_as_far_as_needed()
    }

    /// Returns the fleet with speeds and turn rates that change independently of each other.
    pub fn with_independent_ramps(mut self) -> Fleet {
        for (body, agent) in self.plant.robots.iter_mut().zip(&mut self.agents) {
            let limits = body
                .limits
                .map(|limits| AccelerationLimitsBrief { ramp: Ramp::Independent, ..limits });
            (body.limits, agent.limits) = (limits, limits);
        }
        self
    }

    /// Returns the fleet with inertia, and a guard that does not account for it.
    pub fn without_knowing_its_inertia(mut self) -> Fleet {
        for agent in &mut self.agents {
            agent.limits = None;
            agent.avoidance.braking_time_max_s = 0.0;
        }
        self.sees_as_far_as_needed()
    }
}
