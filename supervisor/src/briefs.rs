//! What each process is told, and no more: the scenario cut into briefs.

use std::path::Path;

use protocol::brief::{AgentBrief, AvoidanceKind, BodyBrief, NeighborBrief, Pace, PlantBrief};

use crate::scenario::Scenario;
use protocol::law::Role;

/// The brief of robot `i` (from 0).
pub fn agent(scenario: &Scenario, i: usize, pace: Pace, run_root: &Path) -> AgentBrief {
    let robot = &scenario.robots[i];
    let neighbors = scenario.graph.heard_by(i).map(|edge| NeighborBrief {
        name: scenario.robots[edge.from].name.clone(),
        index: edge.from + 1,
        offset_m: edge.offset_m.into(),
        faults: Vec::new(),
    });
    AgentBrief {
        name: robot.name.clone(),
        index: i + 1,
        run_root: run_root.into(),
        pace,
        period_ns: scenario.period_ns,
        plant_tick_ns: scenario.plant_tick_ns,
        command_lifetime_ns: scenario.command_lifetime_ns(pace),
        front_point_m: robot.front_point_m,
        law: robot.law.clone(),
        gains: robot.gains.clone(),
        led: scenario.lead.is_some(),
        lead: scenario.lead.clone().filter(|_| robot.role == Role::Leader),
        published_velocity: scenario.published_velocity,
        avoidance: scenario.avoidance.clone(),
        silence: scenario.silence.clone(),
        slow: Vec::new(),
        neighbors: neighbors.collect(),
    }
}

/// The plant's brief.
pub fn plant(scenario: &Scenario, pace: Pace, run_root: &Path) -> PlantBrief {
    let robots = scenario.robots.iter().map(|robot| BodyBrief {
        name: robot.name.clone(),
        front_point_m: robot.front_point_m,
        wheels: robot.wheels,
        start: robot.start,
        sensor_faults: Vec::new(),
        wheel_faults: Vec::new(),
    });
    let avoidance = &scenario.avoidance;
    PlantBrief {
        run_root: run_root.into(),
        pace,
        duration_ns: scenario.duration_ns,
        period_ns: scenario.period_ns,
        plant_tick_ns: scenario.plant_tick_ns,
        command_lifetime_ns: scenario.command_lifetime_ns(pace),
        distance_min_m: avoidance.distance_min_m,
        speed_max_m_s: (avoidance.kind == AvoidanceKind::Guard).then_some(avoidance.speed_max_m_s),
        sensing_radius_m: avoidance.sensing_radius_m,
        robots: robots.collect(),
    }
}
