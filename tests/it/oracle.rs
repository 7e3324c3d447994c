//! The oracle: the same brains and the same world, composed in one process. What it foretells, a
//! lockstep run of real processes must fulfil bit by bit.

use agent::brain::Brain;
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read};
use outcome::metrics::{Measures, Metrics, Rewiring};
use phalanx::in_process::{Effect, InProcess};
use protocol::brief::{AgentBrief, Pace};
use protocol::message::{Contact, TruthHeader, TruthRow};

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
    let mut metrics = Metrics::new(scenario, Pace::Lockstep);
    let run = InProcess::new(scenario.clone(), think);
    let mut run = run.unwrap_or_else(|error| panic!("{error}"));
    loop {
        let header = run.world().truth_header();
        let truth: Vec<TruthRow> = run.world().truth().collect();
        let alive = run.alive().to_vec();
        metrics.truth(&header, &truth, &alive);
        watch(&header, &truth, &alive);
        if run.is_over() || metrics.ends_early() {
            return metrics.finish();
        }
        run.sense(|effect| match *effect {
            Effect::Began(fault) => metrics.fault_began(fault, header.t_ns),
            Effect::Ended { fault, end, at_ns } => metrics.fault_ended(fault, end, at_ns),
            _ => {}
        });
        let mut rewirings = Vec::new();
        run.step(|robot, turn| {
            let wish = turn.wish();
            if turn.brief().deputy.is_some() {
                let yes = turn.status().0.frame == Contact::Lost as u64;
                rewirings.push(Rewiring::Leads { robot, yes });
            }
            if !turn.brief().spares.is_empty() {
                let (_, senders) = turn.status();
                rewirings.extend(senders.map(|sender| Rewiring::GoesBy {
                    robot,
                    other: sender.robot as usize - 1,
                    yes: sender.goes_by == 1,
                }));
            }
            wish
        });
        rewirings.into_iter().for_each(|rewiring| metrics.rewired(rewiring));
    }
}
