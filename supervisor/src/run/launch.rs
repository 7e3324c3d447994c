//! How a run begins: from the run root to the first process of every robot.

use std::collections::VecDeque;
use std::time::Instant;

use formation::random::SplitMix64;
use protocol::brief::{AgentBrief, BridgeBrief, Pace};
use protocol::process::Stop;
use protocol::ros2::Ros2Brief;
use protocol::run_root::{self, RunRoot};
use protocol::service;

use super::Run;
use super::conduct::Conduct;
use super::error::RunError;
use super::hosts::coordinator::{HostServices, Hosts};
use super::hosts::remote::Remote;
use super::intake::Intake;
use super::journal::Journal;
use super::kept::{Kept, Which};
use super::lives::Lives;
use super::processes::{Processes, Robot};
use super::services::{Services, has_control_timer};
use crate::dead_nodes::Cleaner;
use crate::descriptors;
use crate::room::{self, Need};
use crate::spawn::{Launcher, Role};
use crate::timeline::Timeline;
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::metrics::Metrics;
use outcome::results::latency::Latency;
use outcome::results::run_dir::RunDir;

impl<'a> Run<'a> {
    /// Makes the run root and all services, writes the briefs and starts every process. `by_hand`:
    /// somebody may break things by hand. `fleet`: where there are several hosts, what this one's bridge is told,
    /// but for the run root; the others are waited for. `ros2`: where ROS 2 listens, what the process is told that
    /// shows it the run, but for the run root.
    #[allow(clippy::too_many_arguments, reason = "what a run is made of")]
    pub fn launch(
        scenario: &'a Scenario,
        pace: Pace,
        launcher: &Launcher,
        by_hand: bool,
        fleet: Option<BridgeBrief>,
        ros2: Option<Ros2Brief>,
        run_dir: &'a mut RunDir,
        metrics: &'a mut Metrics,
        stop: Stop,
    ) -> Result<Run<'a>, RunError> {
        descriptors::make_room(scenario.robots.len())?;
        let base = run_root::base();
        for removed in run_root::sweep(&base) {
            tracing::info!(path = %removed.display(), "removed what a dead run left");
        }
        room::check(&base, Need::of(scenario.robots.len(), scenario.graph.edges().len()))?;
        room::tell_of_sigbus(&base);
        let run_root = RunRoot::create(&base)?;
        run_root::join(run_root.path())?;
        let node = service::node("supervisor")?;
        let conduct = Conduct::new(scenario, pace, &run_root, launcher)?;
        // Each takes descriptors and memory: only where they can be of use.
        let links_by_hand = by_hand && conduct.cuts_links_by_hand();
        let (bridged, ros2_brief) = (fleet.is_some(), ros2.as_ref());
        let services = Services::create(&node, scenario, pace, links_by_hand, bridged, ros2_brief)?;
        let intake = Intake::new(&services, Latency::new(scenario, pace))?;
        let heard = |i| scenario.graph.heard_by(i).count();
        let to_robots = services.faults.iter().enumerate();
        let faults_by_hand =
            to_robots.map(|(i, faults)| faults.publisher(heard(i))).collect::<Result<_, _>>()?;
        let cleaner = Cleaner::start(&run_root, &node)?;
        room::take(run_root.path())?;

        let host_services =
            fleet.as_ref().map(|fleet| HostServices::create(&node, fleet)).transpose()?;
        let mut hosts = None;
        let here =
            |robot: usize| fleet.as_ref().map(|fleet| (fleet.robots[robot].host, fleet.here));
        let mut robots: Vec<Robot> = Vec::new();
        for (i, robot) in scenario.robots.iter().enumerate() {
            if let Some((host, _)) = here(i).filter(|(host, here)| host != here) {
                robots.push(Robot::elsewhere(Remote::new(i, host)));
                continue;
            }
            let brief = briefs::agent(scenario, i, pace, run_root.path());
            let goals_from_outside = ros2.as_ref().is_some_and(|ros2| ros2.sends(&robot.name));
            let brief = AgentBrief { links_by_hand, goals_from_outside, ..brief };
            let told = run_dir.write_brief(&robot.name, &brief)?;
            let program =
                scenario.program(i).map(|program| run_dir.started(program)).transpose()?;
            robots.push(Robot::new(told, program, run_dir.log_path(&robot.name)));
        }
        if let (Some(fleet), Some(services)) = (&fleet, host_services) {
            let fleet = BridgeBrief { run_root: run_root.path().into(), ..fleet.clone() };
            let told = run_dir.write_brief("bridge", &fleet)?;
            let bridge = Kept::start(Which::Bridge, launcher, told, run_dir.log_path("bridge"))?;
            let mut others = Hosts::new(fleet, bridge, services)?;
            let mut remotes: Vec<_> = robots.iter_mut().map(Robot::remote).collect();
            others.gather(&mut remotes, &cleaner, &stop)?;
            hosts = Some(others);
        }

        let ros2 = ros2.map(|brief| {
            let brief = Ros2Brief { run_root: run_root.path().into(), ..brief };
            let told = run_dir.write_brief("ros2", &brief)?;
            Ok::<_, RunError>(Kept::start(Which::Ros2, launcher, told, run_dir.log_path("ros2"))?)
        });
        let ros2 = ros2.transpose()?;
        let plant_brief = briefs::plant(scenario, pace, run_root.path());
        let plant_brief = run_dir.write_brief("plant", &plant_brief)?;
        let launched = Instant::now();
        let program = scenario.plant.as_ref();
        let program = program.map(|program| run_dir.started(program)).transpose()?;
        let plant = Role::Plant { brief: &plant_brief, program: program.as_ref() };
        let plant = launcher.spawn(plant, &run_dir.log_path("plant"))?;
        let control_timer = has_control_timer(scenario, pace).then_some(Role::ControlTimer {
            run_root: run_root.path(),
            period_ns: scenario.period_ns,
            robots: scenario.robots.len(),
        });
        let control_timer = control_timer
            .map(|role| launcher.spawn(role, &run_dir.log_path("machine")))
            .transpose()?;
        let mut processes = Processes::new(plant, control_timer, robots, launcher.clone());
        for robot in start_order(scenario.seed, scenario.robots.len()) {
            processes.start(robot, 0)?;
        }
        let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
        let policies = scenario.robots.iter().map(|robot| robot.restart);
        let hearers = scenario.graph.edges().iter().map(|edge| edge.to);
        Ok(Run {
            scenario,
            stop,
            interrupted: false,
            launched,
            all_seen_alive_ns: 0,
            timeline: Timeline::new(scenario),
            lives: Lives::new(policies, hearers, conduct.starts_beside_remains()),
            asked: VecDeque::new(),
            journal: Journal::new(names, run_dir, metrics),
            processes,
            intake,
            faults_by_hand,
            cleaner,
            conduct,
            hosts,
            ros2,
            failed: false,
            _services: services,
            _node: node,
            run_root,
        })
    }
}

/// The order in which the first processes are started, drawn from the seed: no result may lean
/// on it. (Fisher and Yates)
fn start_order(seed: u64, robots: usize) -> Vec<usize> {
    let mut random = SplitMix64::new(seed);
    let mut order: Vec<usize> = (0..robots).collect();
    for last in (1..robots).rev() {
        order.swap(last, random.between(0, last as u64) as usize);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_seed_starts_every_robot_once() {
        for seed in 0..50 {
            let mut order = start_order(seed, 9);
            order.sort_unstable();
            assert_eq!(order, (0..9).collect::<Vec<_>>());
        }
        assert_ne!(start_order(1, 9), start_order(2, 9));
    }
}
