//! The oracle: the same brains and the same world, composed in one process. What it foretells, a
//! lockstep run of real processes must fulfil bit by bit.

use agent::brain::Brain;
use formation::Vec2;
use formation::front_point::front_point;
use plant::world::World;
use protocol::brief::{AgentBrief, Pace, PlantBrief};
use protocol::message::{Beacon, TruthRow};
use supervisor::briefs;
use supervisor::metrics::hash::TrajectoryHash;
use supervisor::scenario::{FaultKind, Scenario};

/// What a run would do.
pub struct Flight {
    pub trajectory_hash: String,
    pub distance_m_min: f64,
    /// Worst error (13) of any robot over the last 10 % of the run, m.
    pub final_error_m_max: f64,
}

/// Flies `scenario` in lockstep, with its kills and restarts.
pub fn fly(scenario: &Scenario) -> Flight {
    let run_root = "/nowhere".as_ref();
    let plant = briefs::plant(scenario, Pace::Lockstep, run_root);
    let agents: Vec<AgentBrief> = (0..scenario.robots.len())
        .map(|i| briefs::agent(scenario, i, Pace::Lockstep, run_root))
        .collect();
    let ticks = plant.duration_ns / plant.period_ns;
    let tick_of = |t_ns: u64| t_ns.div_ceil(plant.period_ns);

    let mut world = World::new(&plant);
    let mut hash = TrajectoryHash::new();
    let mut robots: Vec<Option<Robot>> =
        agents.iter().map(|brief| Some(Robot::new(brief, 0, 0))).collect();
    let mut starts = vec![0u64; robots.len()];
    let mut last_beacons: Vec<Option<Beacon>> = vec![None; robots.len()];
    let mut final_error_m_max: f64 = 0.0;

    for tick in 0..=ticks {
        let truth: Vec<TruthRow> = world.truth().collect();
        hash.update(tick, &truth);
        if tick * 10 >= ticks * 9 {
            final_error_m_max = final_error_m_max.max(worst_error(scenario, &plant, &truth));
        }
        if tick == ticks {
            break;
        }
        for fault in &scenario.faults {
            let FaultKind::Kill { robot, restart_after_ns } = fault.kind;
            if tick_of(fault.at_ns) == tick {
                robots[robot] = None;
            }
            if restart_after_ns.is_some_and(|after| tick_of(fault.at_ns + after) == tick) {
                starts[robot] += 1;
                robots[robot] = Some(Robot::new(&agents[robot], starts[robot], tick));
            }
        }
        let mut beacons = vec![None; robots.len()];
        for (i, slot) in robots.iter_mut().enumerate() {
            let Some(robot) = slot else { continue };
            let odometry = world.odometry(i);
            if tick > robot.first_tick {
                for (place, neighbor) in agents[i].neighbors.iter().enumerate() {
                    // A beacon of the tick before, from a robot that still takes part.
                    if let Some(beacon) = last_beacons[neighbor.index - 1] {
                        robot.brain.hear(place, &beacon, odometry.stamp_ns).expect("in order");
                    }
                }
            }
            let answer = robot.brain.answer(&odometry, odometry.stamp_ns);
            world.accept(i, &answer.command).expect("an answer in time");
            beacons[i] = Some(answer.beacon);
        }
        world.advance((tick + 1) * plant.period_ns);
        world.next_tick();
        // Who dies at the next tick is not heard in it.
        for fault in &scenario.faults {
            let FaultKind::Kill { robot, .. } = fault.kind;
            if tick_of(fault.at_ns) == tick + 1 {
                beacons[robot] = None;
            }
        }
        last_beacons = beacons;
    }
    Flight {
        trajectory_hash: hash.finish(),
        distance_m_min: world.truth_header().closest_m,
        final_error_m_max,
    }
}

struct Robot {
    brain: Brain,
    first_tick: u64,
}

impl Robot {
    fn new(brief: &AgentBrief, incarnation: u64, first_tick: u64) -> Robot {
        Robot { brain: Brain::new(brief, incarnation).expect("a checked brief"), first_tick }
    }
}

/// The largest |alpha_i - alpha*_i|, m, with alpha* by (13) written out.
fn worst_error(scenario: &Scenario, plant: &PlantBrief, truth: &[TruthRow]) -> f64 {
    let alpha: Vec<Vec2> = truth
        .iter()
        .zip(&plant.robots)
        .map(|(row, body)| front_point(row.pose(), body.front_point_m))
        .collect();
    let error = |i: usize| {
        let heard: Vec<_> = scenario.graph.edges().iter().filter(|e| e.to == i).collect();
        let sum: Vec2 = heard.iter().map(|e| alpha[e.from] + e.offset_m).sum();
        if heard.is_empty() { 0.0 } else { (alpha[i] - sum / heard.len() as f64).norm() }
    };
    (0..alpha.len()).map(error).fold(0.0, f64::max)
}
