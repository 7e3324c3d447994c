//! The oracle: the same brains and the same world, composed in one process. What it foretells, a
//! lockstep run of real processes must fulfil bit by bit.

use agent::brain::Brain;
use plant::world::World;
use protocol::brief::{AgentBrief, Pace};
use protocol::message::{Beacon, TruthRow};
use supervisor::briefs;
use supervisor::metrics::{Measures, Metrics};
use supervisor::scenario::{FaultKind, Scenario};

/// Flies `scenario` in lockstep, with its kills and restarts, and measures what it would do.
pub fn fly(scenario: &Scenario) -> Measures {
    let run_root = "/nowhere".as_ref();
    let plant = briefs::plant(scenario, Pace::Lockstep, run_root);
    let agents: Vec<AgentBrief> = (0..scenario.robots.len())
        .map(|i| briefs::agent(scenario, i, Pace::Lockstep, run_root))
        .collect();
    let ticks = plant.duration_ns / plant.period_ns;
    let tick_of = |t_ns: u64| t_ns.div_ceil(plant.period_ns);

    let mut world = World::new(&plant);
    let mut metrics = Metrics::new(scenario, Pace::Lockstep);
    let mut robots: Vec<Option<Robot>> =
        agents.iter().map(|brief| Some(Robot::new(brief, 0, 0))).collect();
    let mut starts = vec![0u64; robots.len()];
    let mut last_beacons: Vec<Option<Beacon>> = vec![None; robots.len()];
    let mut alive = vec![true; robots.len()];

    for tick in 0..=ticks {
        let truth: Vec<TruthRow> = world.truth().collect();
        metrics.truth(&world.truth_header(), &truth, &alive);
        if tick == ticks {
            break;
        }
        for fault in &scenario.faults {
            let FaultKind::Kill { robot, restart_after_ns } = fault.kind;
            if tick_of(fault.at_ns) == tick {
                robots[robot] = None;
                alive[robot] = false;
            }
            if restart_after_ns.is_some_and(|after| tick_of(fault.at_ns + after) == tick) {
                starts[robot] += 1;
                alive[robot] = true;
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
            // An answer that takes a period or more is dead before it is sent.
            let Some(answer) = answer.filter(|answer| answer.delay_ns < plant.period_ns) else {
                continue;
            };
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
    metrics.finish()
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
