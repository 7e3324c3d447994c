//! Inexact sensors, bodies and speeds, which make it harder to keep d, in addition to the adversary.

use agent::avoidance::METHODS;
use formation::front_point::front_point;
use protocol::avoidance::MethodConditions;
use protocol::brief::{AgentBrief, WheelsBrief};
use protocol::fault::{Sensor, SensorFault, SensorFaultKind, Span};

use super::{Fleet, MS};

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultProfile {
    /// No change of the scenario.
    Nothing,
    /// Errors in all sensed positions, of the robot and of others, and in the heading.
    Noise,
    /// A different distance of the front point ahead of the axle for each robot.
    MixedFrontPoints,
    /// Wheels that cannot follow most of the commands.
    WeakWheels,
    /// Speed limit (v_max) of three times the advised value.
    Fast,
    /// Repeated dropouts of each sensor, at independent times.
    DarkSensors,
}

pub const FAULT_PROFILES: [FaultProfile; 6] = [
    FaultProfile::Nothing,
    FaultProfile::Noise,
    FaultProfile::MixedFrontPoints,
    FaultProfile::WeakWheels,
    FaultProfile::Fast,
    FaultProfile::DarkSensors,
];

/// Maximum error of the sensed heading, rad.
const HEADING_NOISE_RAD: f64 = 0.1;
/// Maximum errors of sensed positions, m: of the robot itself, and of others.
const NOISE_M: [(Sensor, f64); 2] = [(Sensor::Odometry, 0.01), (Sensor::Proximity, 0.02)];

impl Fleet {
    /// Returns the fleet with this fault profile.
    pub fn under(mut self, profile: FaultProfile) -> Fleet {
        match profile {
            FaultProfile::Nothing => {}
            FaultProfile::Noise => {
                for (seed, body) in (0..).zip(&mut self.plant.robots) {
                    body.sensor_faults.extend(NOISE_M.map(|(sensor, bound_m)| SensorFault {
                        span: Span { from_ns: 0, until_ns: Span::UNBOUNDED_END_NS },
                        sensor,
                        kind: SensorFaultKind::Noise {
                            bound_m,
                            heading_bound_rad: match sensor {
                                Sensor::Odometry => HEADING_NOISE_RAD,
                                Sensor::Proximity => 0.0,
                            },
                        },
                        seed,
                    }));
                }
                for agent in &mut self.agents {
                    agent.avoidance.sensing_error_m = NOISE_M.iter().map(|(_, m)| m).sum();
                    agent.avoidance.heading_error_rad = HEADING_NOISE_RAD;
                }
            }
            FaultProfile::MixedFrontPoints => {
                let robots = self.plant.robots.iter_mut().zip(&mut self.agents);
                for (index, (body, agent)) in robots.enumerate() {
                    let alpha = front_point(body.start, body.front_point_m);
                    body.front_point_m *= [1.0, 0.6, 1.5][index % 3];
                    agent.front_point_m = body.front_point_m;
                    // The axle starts at another position, so that the front point stays.
                    let shift = alpha - front_point(body.start, body.front_point_m);
                    body.start.x_m += shift.x;
                    body.start.y_m += shift.y;
                }
            }
            FaultProfile::WeakWheels => {
                let speed_max_m_s = 0.4 * self.agents[0].avoidance.speed_max_m_s;
                for body in &mut self.plant.robots {
                    let track_m = 2.0 * speed_max_m_s / body.drive().turn_rate_bound(speed_max_m_s);
                    body.wheels = Some(WheelsBrief { speed_max_m_s, track_m });
                }
            }
            FaultProfile::Fast => {
                let cap_m_s =
                    METHODS[0].description.useful_speed_max_m_s.expect("the guard has a cap");
                let lower_limit =
                    |m_s: f64, agent| cap_m_s(&MethodConditions::for_robot(agent)).min(m_s);
                let speed_max_m_s = 3.0 * self.agents.iter().fold(f64::INFINITY, lower_limit);
                for agent in &mut self.agents {
                    agent.avoidance.speed_max_m_s = speed_max_m_s;
                }
                self.plant.speed_max_m_s = Some(speed_max_m_s);
            }
            FaultProfile::DarkSensors => {
                for (i, body) in (0..).zip(&mut self.plant.robots) {
                    for (sensor, from_ms) in [(Sensor::Odometry, 100), (Sensor::Proximity, 250)] {
                        body.sensor_faults.extend((0..20).map(|k| {
                            let from_ns = (from_ms + 37 * i + 400 * k) * MS;
                            SensorFault {
                                span: Span { from_ns, until_ns: from_ns + 60 * MS },
                                sensor,
                                kind: SensorFaultKind::Blackout,
                                seed: 0,
                            }
                        }));
                    }
                }
            }
        }
        self.sees_as_far_as_needed()
    }

    /// Returns the fleet with the minimum sensing radius that all robots accept.
    pub(super) fn sees_as_far_as_needed(mut self) -> Fleet {
        let needed_m = |agent: &AgentBrief| {
            (METHODS[0].description.sensing_radius_m)(&MethodConditions::for_robot(agent))
        };
        let radius_m = self.agents.iter().map(needed_m).fold(0.0, f64::max);
        self.plant.sensing_radius_m = radius_m;
        for agent in &mut self.agents {
            agent.avoidance.sensing_radius_m = radius_m;
        }
        self
    }
}
