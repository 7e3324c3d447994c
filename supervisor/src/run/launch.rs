//! Start of a run: from the run root to the first process of every robot.

use std::path::Path;
use std::time::Instant;

use formation::random::SplitMix64;
use protocol::brief::{AgentBrief, BridgeBrief, Brief, Pace};
use protocol::incarnations::Incarnations;
use protocol::process::StopFlag;
use protocol::ros2::Ros2Brief;
use protocol::run_root::{self, RunRoot};
use protocol::service::{self, Node};

use super::error::RunError;
use super::helper_process::{HelperKind, HelperProcess};
use super::hosts::coordinator::{HostServices, Hosts};
use super::hosts::remote::RemoteRobot;
use super::intake::MessageReceivers;
use super::interactive_actions::InteractiveActions;
use super::processes::{Processes, RobotProcess};
use super::services::{RunServices, has_control_timer};
use super::time_mode::TimeMode;
use super::{FailureDetectors, Helpers, Run, SharedResources, TerminationState};
use crate::dead_nodes::Cleaner;
use crate::descriptors::{self, ViewUse};
use crate::limits;
use crate::logs::Logs;
use crate::orphan_processes::{self, OrphanReaper};
use crate::shm_capacity::{self, Allocator, RequiredSpace};
use crate::spawn::{Launcher, ProcessRole};
use crate::view::View;
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::results::latency::LatencyCollector;
use run::journal::Journal;
use run::state_machine::RunStateMachine;

/// Live view and other hosts of a run, if it has any.
#[derive(Debug, Default)]
pub struct RunConnections<'a> {
    /// Live view.
    pub view: Option<&'a mut View>,
    /// Whether clients of a live view may inject faults.
    pub accepts_requests: bool,
    /// Configuration of this host's bridge on several hosts, without its run root. The run waits for the
    /// other hosts.
    pub bridge_brief: Option<BridgeBrief>,
    /// Configuration of the ROS 2 bridge, without its run root.
    pub ros2: Option<Ros2Brief>,
}

impl<'a> Run<'a> {
    /// Creates the run root and all services, writes the briefs and starts every process.
    pub fn launch(
        scenario: &'a Scenario,
        pace: Pace,
        launcher: &Launcher,
        connections: RunConnections<'a>,
        mut journal: Journal<'a>,
        stop: StopFlag,
    ) -> Result<Run<'a>, RunError> {
        let launcher = match pace {
            Pace::Lockstep => launcher.clone().with_same_addresses(),
            Pace::Realtime => launcher.clone(),
        };
        let logs = journal.run_dir.logs_path();
        let mut orphan_reaper = OrphanReaper::watch(&logs);
        let view = match (&connections.view, connections.accepts_requests) {
            (None, _) => ViewUse::Off,
            (Some(_), false) => ViewUse::Watch,
            (Some(_), true) => ViewUse::Control,
        };
        if view != ViewUse::Off {
            journal.collect_added_events();
        }
        limits::check(scenario.robots.len(), pace == Pace::Lockstep)?;
        let run_root =
            make_run_root(scenario.robots.len(), RequiredSpace::for_run(scenario), view)?;
        let node = service::create_node("supervisor")?;
        let launcher = launcher.with_run_root(run_root.path());
        if scenario.process_programs().next().is_some() {
            orphan_reaper.start_reaper_process(&launcher, run_root.path())?;
        }
        let time_mode = TimeMode::new(scenario, pace, &run_root, &launcher)?;
        // Each takes descriptors and memory, so they are created only if they may be used.
        let links_by_hand = connections.accepts_requests && time_mode.can_cut_links();
        let RunConnections { view, bridge_brief: fleet, ros2, .. } = connections;
        let (has_fleet, ros2_brief) = (fleet.is_some(), ros2.as_ref());
        let services =
            RunServices::create(&node, scenario, pace, links_by_hand, has_fleet, ros2_brief)?;
        let receivers = MessageReceivers::new(&services, LatencyCollector::new(scenario, pace))?;
        let sender_count = |i| scenario.graph.incoming_edges(i).count();
        let link_faults = services.faults.iter().enumerate();
        let faults_by_hand = link_faults
            .map(|(i, faults)| faults.publisher(sender_count(i)))
            .collect::<Result<_, _>>()?;
        let cleaner = Cleaner::start(&run_root, &node)?;
        let incarnations = Incarnations::create(run_root.path(), scenario.robots.len());
        let incarnations = incarnations.map_err(RunError::Incarnations)?;
        shm_capacity::allocate_reserved_memory(run_root.path(), None)?;

        let mut inputs =
            StartInputs { scenario, pace, launcher, run_root: run_root.path(), journal };
        let mut robots = inputs.write_robot_briefs(fleet.as_ref(), ros2.as_ref(), links_by_hand)?;
        let hosts = fleet
            .map(|fleet| inputs.start_hosts(&node, fleet, &mut robots, &cleaner, &stop))
            .transpose()?;
        let ros2 = ros2.map(|brief| inputs.start_ros2(brief)).transpose()?;
        let launch_time = Instant::now();
        let mut processes = inputs.start_plant(robots, incarnations)?;
        for robot in start_order(scenario.seed, scenario.robots.len()) {
            processes.start_robot(robot, 0)?;
        }
        let state_machine =
            RunStateMachine::new(scenario, time_mode.restarts_before_cleanup(), inputs.journal);
        Ok(Run {
            scenario,
            termination_state: TerminationState {
                stop_flag: stop,
                launch_time,
                interrupted: false,
                has_failed: false,
            },
            detectors: FailureDetectors::start(scenario),
            state_machine,
            processes,
            receivers,
            interactive_actions: InteractiveActions::new(view, faults_by_hand),
            helpers: Helpers { cleaner, hosts, ros2 },
            time_mode,
            shared_resources: SharedResources {
                _services: services,
                _node: node,
                run_root,
                allocator: Allocator::default(),
                logs: Logs::new(&logs),
                orphan_reaper,
            },
        })
    }
}

/// Creates the run root of a run, or of a host's part of one. Fails if there is too little space.
pub(super) fn make_run_root(
    robots: usize,
    required_space: RequiredSpace,
    view: ViewUse,
) -> Result<RunRoot, RunError> {
    descriptors::raise_descriptor_limit(descriptors::RequiredDescriptors::for_run(robots, view))?;
    let base = run_root::base_directory();
    for dead_root in run_root::lock_dead_roots(&base) {
        for process_text in orphan_processes::kill_processes_of_run(&dead_root.path, None) {
            tracing::warn!("in a dead run, {process_text}");
        }
        let path = dead_root.path.clone();
        match dead_root.remove() {
            Ok(()) => tracing::info!(path = %path.display(), "removed what a dead run left"),
            Err(error) => {
                tracing::warn!(%error, path = %path.display(), "a dead run's root stays behind");
            }
        }
    }
    shm_capacity::check(&base, required_space)?;
    shm_capacity::install_sigbus_handler(&base);
    let run_root = RunRoot::create(&base)?;
    run_root::join(run_root.path())?;
    Ok(run_root)
}

/// Data from which the processes are started.
struct StartInputs<'a, 'r> {
    scenario: &'a Scenario,
    pace: Pace,
    launcher: Launcher,
    run_root: &'r Path,
    journal: Journal<'a>,
}

impl StartInputs<'_, '_> {
    /// Writes the brief of each robot of this host.
    fn write_robot_briefs(
        &mut self,
        fleet: Option<&BridgeBrief>,
        ros2: Option<&Ros2Brief>,
        links_by_hand: bool,
    ) -> Result<Vec<RobotProcess>, RunError> {
        let run_dir = &mut *self.journal.run_dir;
        let briefs = briefs::AgentBriefs::new(self.scenario);
        let mut robots = Vec::new();
        for (i, robot) in self.scenario.robots.iter().enumerate() {
            let host = fleet.map(|fleet| fleet.robots[i].host);
            if let Some(host) = host.filter(|&host| fleet.is_some_and(|fleet| fleet.here != host)) {
                robots.push(RobotProcess::new_remote(RemoteRobot::new(i, host)));
                continue;
            }
            let brief = briefs.brief(i, self.pace, self.run_root);
            let goals_from_outside = ros2.is_some_and(|ros2| ros2.accepts_goals(&robot.name));
            let brief = AgentBrief { links_by_hand, goals_from_outside, ..brief };
            let brief = run_dir.write_brief(&robot.name, &brief)?;
            let program = self.scenario.program(i).map(|program| run_dir.program_command(program));
            robots.push(RobotProcess::new(
                brief,
                program.transpose()?,
                run_dir.log_path(&robot.name),
            ));
        }
        Ok(robots)
    }

    /// Starts the bridge, and waits for the other hosts.
    fn start_hosts(
        &mut self,
        node: &Node,
        fleet: BridgeBrief,
        robots: &mut [RobotProcess],
        cleaner: &Cleaner,
        stop: &StopFlag,
    ) -> Result<Hosts, RunError> {
        let services = HostServices::create(node, &fleet)?;
        let fleet = BridgeBrief { run_root: self.run_root.into(), ..fleet };
        let bridge = self.start_helper(HelperKind::Bridge, "bridge", &fleet)?;
        let mut hosts = Hosts::new(fleet, bridge, services)?;
        let mut remotes: Vec<_> = robots.iter_mut().map(RobotProcess::remote_robot).collect();
        hosts.wait_for_hosts(&mut remotes, cleaner, stop)?;
        Ok(hosts)
    }

    fn start_ros2(&mut self, brief: Ros2Brief) -> Result<HelperProcess, RunError> {
        let brief = Ros2Brief { run_root: self.run_root.into(), ..brief };
        self.start_helper(HelperKind::Ros2, "ros2", &brief)
    }

    fn start_helper(
        &mut self,
        kind: HelperKind,
        name: &str,
        brief: &impl Brief,
    ) -> Result<HelperProcess, RunError> {
        let run_dir = &mut *self.journal.run_dir;
        let brief = run_dir.write_brief(name, brief)?;
        Ok(HelperProcess::start(kind, &self.launcher, brief, run_dir.log_path(name))?)
    }

    /// Starts the plant, and the control process if there is one.
    fn start_plant(
        &mut self,
        robots: Vec<RobotProcess>,
        incarnations: Incarnations,
    ) -> Result<Processes, RunError> {
        let StartInputs { scenario, pace, launcher, run_root, journal } = self;
        let run_dir = &mut *journal.run_dir;
        let brief =
            run_dir.write_brief("plant", &briefs::plant_brief(scenario, *pace, run_root))?;
        let program = scenario
            .plant_program
            .as_ref()
            .map(|program| run_dir.program_command(program))
            .transpose()?;
        let plant = ProcessRole::Plant { brief: &brief, program: program.as_ref() };
        let plant = launcher.spawn(plant, &run_dir.log_path("plant"))?;
        let control_timer =
            has_control_timer(scenario, *pace).then_some(ProcessRole::ControlTimer {
                run_root,
                period_ns: scenario.period_ns,
                robots: scenario.robots.len(),
            });
        let control_timer = control_timer
            .map(|role| launcher.spawn(role, &run_dir.log_path("machine")))
            .transpose()?;
        Ok(Processes::new(plant, control_timer, robots, incarnations, launcher.clone()))
    }
}

/// Returns the order in which the first processes are started: a Fisher-Yates shuffle by the seed, so that
/// no result depends on a particular order.
fn start_order(seed: u64, robots: usize) -> Vec<usize> {
    let mut rng = SplitMix64::new(seed);
    let mut order: Vec<usize> = (0..robots).collect();
    for last in (1..robots).rev() {
        order.swap(last, rng.draw_between(0, last as u64) as usize);
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
