//! The oracle: the same brains and the same world, composed in one process. What it foretells, a
//! lockstep run of real processes must fulfil bit by bit.

use agent::brain::Brain;
use experiment::briefs;
use experiment::scenario::read::{Overrides, read};
use experiment::scenario::{FaultKind, Scenario};
use metrics::fault::End;
use metrics::{Measures, Metrics};
use plant::world::World;
use protocol::brief::{AgentBrief, Pace};
use protocol::message::{Beacon, TruthHeader, TruthRow};

/// `scenarios/<name>.toml`, with these keys set.
pub fn scenario(name: &str, set: &[&str]) -> Scenario {
    with_faults(name, set, &[])
}

/// The same with these faults added, in the words of `--fault`.
pub fn with_faults(name: &str, set: &[&str], faults: &[&str]) -> Scenario {
    let owned = |list: &[&str]| list.iter().map(|&word| word.into()).collect();
    let overrides = Overrides { set: owned(set), faults: owned(faults), seed: None };
    let path = format!("{}/scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    match read(path.as_ref(), &overrides, &agent::catalog()) {
        Ok((scenario, ..)) => scenario,
        Err(diagnostic) => panic!("{}", diagnostic.render(false)),
    }
}

/// Simulates `scenario` in lockstep, with its faults, and measures what it would do.
pub fn simulate(scenario: &Scenario) -> Measures {
    simulate_with(scenario, &|brief, incarnation| {
        Brain::new(brief, incarnation).expect("a checked brief")
    })
}

/// The same with brains made by `think` of a brief and an incarnation.
pub fn simulate_with(scenario: &Scenario, think: &dyn Fn(&AgentBrief, u64) -> Brain) -> Measures {
    run(scenario, think, |_, _, _| {})
}

/// The same with the usual brains; `watch` sees every truth, and who was alive at it.
pub fn simulate_watched(
    scenario: &Scenario,
    watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]),
) -> Measures {
    run(
        scenario,
        &|brief, incarnation| Brain::new(brief, incarnation).expect("a checked brief"),
        watch,
    )
}

fn run(
    scenario: &Scenario,
    think: &dyn Fn(&AgentBrief, u64) -> Brain,
    mut watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]),
) -> Measures {
    let run_root = "/nowhere".as_ref();
    let plant = briefs::plant(scenario, Pace::Lockstep, run_root);
    let agents: Vec<AgentBrief> = (0..scenario.robots.len())
        .map(|i| briefs::agent(scenario, i, Pace::Lockstep, run_root))
        .collect();
    let ticks = plant.duration_ns / plant.period_ns;
    let tick_of = |t_ns: u64| t_ns.div_ceil(plant.period_ns);

    let mut world = World::new(&plant);
    let mut metrics = Metrics::new(scenario, Pace::Lockstep);
    let mut robots: Vec<Robot> =
        agents.iter().map(|brief| Robot::new(think(brief, 0), 0, 0)).collect();
    let mut last_beacons: Vec<Option<Beacon>> = vec![None; robots.len()];

    for tick in 0..=ticks {
        let truth: Vec<TruthRow> = world.truth().collect();
        let alive: Vec<bool> = robots.iter().map(|robot| robot.brain.is_some()).collect();
        metrics.truth(&world.truth_header(), &truth, &alive);
        watch(&world.truth_header(), &truth, &alive);
        if tick == ticks {
            break;
        }
        let now_ns = tick * plant.period_ns;
        for (number, fault) in scenario.faults.iter().enumerate() {
            let (begins, ends) = (tick_of(fault.at_ns) == tick, fault.until_ns().map(tick_of));
            match fault.kind {
                FaultKind::Kill { robot, restart_after_ns } => {
                    if begins {
                        robots[robot].brain = None;
                        robots[robot].frozen = false;
                        last_beacons[robot] = None;
                        metrics.fault_began(number, now_ns);
                        if restart_after_ns.is_none() {
                            metrics.fault_ended(number, End::ForGood, now_ns);
                        }
                    }
                    if restart_after_ns.is_some_and(|after| tick_of(fault.at_ns + after) == tick) {
                        let incarnation = robots[robot].incarnation + 1;
                        let brain = think(&agents[robot], incarnation);
                        robots[robot] = Robot::new(brain, incarnation, tick);
                        metrics.fault_ended(number, End::Whole, now_ns);
                    }
                }
                FaultKind::Freeze { robot } => {
                    if begins && robots[robot].brain.is_some() {
                        robots[robot].frozen = true;
                        last_beacons[robot] = None;
                        metrics.fault_began(number, now_ns);
                    }
                    if ends == Some(tick) && robots[robot].frozen {
                        robots[robot].frozen = false;
                        robots[robot].first_tick = tick;
                        metrics.fault_ended(number, End::Whole, now_ns);
                    }
                }
                // The others act by the briefs, or not on a simulated time.
                _ => {}
            }
        }
        world.take_due();
        let mut beacons = vec![None; robots.len()];
        for (i, robot) in robots.iter_mut().enumerate() {
            let Some(brain) = robot.brain.as_mut().filter(|_| !robot.frozen) else { continue };
            let odometry = world.odometry(i);
            if tick > robot.first_tick {
                for (place, neighbor) in agents[i].neighbors.iter().enumerate() {
                    // A beacon of the tick before, from a robot that still takes part.
                    if let Some(beacon) = last_beacons[neighbor.index - 1] {
                        let _ = brain.hear(place, &beacon, odometry.stamp_ns);
                    }
                }
            }
            let answer = brain.answer(&odometry, odometry.stamp_ns);
            // An answer that takes a period or more is dead before it is sent.
            let Some(answer) = answer.filter(|answer| answer.delay_ns < plant.period_ns) else {
                continue;
            };
            world.take(i, &answer.command).expect("an answer in time");
            beacons[i] = Some(answer.beacon);
        }
        world.advance((tick + 1) * plant.period_ns);
        world.next_tick();
        last_beacons = beacons;
    }
    metrics.finish()
}

struct Robot {
    brain: Option<Brain>,
    frozen: bool,
    incarnation: u64,
    /// The first tick since it was started, or went on after a freeze.
    first_tick: u64,
}

impl Robot {
    fn new(brain: Brain, incarnation: u64, first_tick: u64) -> Robot {
        Robot { brain: Some(brain), frozen: false, incarnation, first_tick }
    }
}
