//! Shutdown of a run: terminates every child and kills it if it does not exit, summarizes the results, and
//! removes the shared files.

use std::process::ExitStatus;
use std::time::{Duration, Instant};

use super::error::RunError;
use super::hosts::coordinator::Hosts;
use super::processes::terminate_all;
use super::{Run, SharedResources};
use outcome::metrics::expect::FailedRobot;
use outcome::metrics::summary::ProcessUsage;
use outcome::results::outcome::RunOutcome;
use outcome::results::usage;

impl Run<'_> {
    /// Ends every process and removes the shared files. Returns the outcome, and the first error of the
    /// shutdown. `end_time` is when the run ended.
    pub(super) fn shut_down(mut self, end_time: Instant) -> (RunOutcome, Result<(), RunError>) {
        let drain_result = self.drain_messages();
        terminate_all(self.processes.children_mut().collect());
        let release_result = self.release_hosts();
        let failed_robots = self.failed_robots();
        let alive = self.robots_alive_at_end();
        (0..alive.len())
            .filter(|&robot| alive[robot])
            .for_each(|robot| self.record_sent_counts(robot));
        self.state_machine.journal.metrics.mark_alive_at_end(&alive);
        // Processes send their last latencies when they exit.
        let latency_result = self.receivers.read_latencies();
        let load_result = self.processes.load.check_load_processes().map_err(RunError::from);
        let mut usages = self.usages();
        let goal_count_result = self.receivers.read_goal_counts();
        usages.extend(self.helpers.hosts.as_mut().map(|hosts| hosts.bridge.terminate()));
        usages.extend(self.helpers.ros2.as_mut().map(|ros2| ros2.terminate()));
        self.pass_events_to_view();
        let Run {
            termination_state,
            state_machine,
            processes,
            receivers,
            interactive_actions,
            helpers,
            time_mode,
            shared_resources,
            ..
        } = self;
        let SharedResources { _services, _node, run_root, mut logs, orphan_reaper, .. } =
            shared_resources;
        drop(processes);
        drop(orphan_reaper);
        logs.shorten_all();
        let wall_time = receivers
            .first_truth_arrival
            .map_or(Duration::ZERO, |first_arrival| end_time - first_arrival);
        let outcome = RunOutcome {
            was_interrupted: termination_state.interrupted,
            startup_time: receivers
                .first_truth_arrival
                .map(|first_arrival| first_arrival - termination_state.launch_time),
            wall_time,
            manual_interventions: interactive_actions.executed_action_count,
            failed_robots,
            hosts: helpers.hosts.as_ref().map_or(Vec::new(), Hosts::summaries),
            usages,
            ..receivers.into_outcome(state_machine.outcome())
        };
        drop((interactive_actions, helpers, time_mode, _services, _node));
        if let Err(error) = run_root.remove() {
            tracing::warn!(%error, "could not remove the run root");
        }
        (
            outcome,
            drain_result
                .and(release_result)
                .and(latency_result)
                .and(goal_count_result)
                .and(load_result),
        )
    }

    /// Returns the robots that are lost without a plan, after all messages were read.
    fn failed_robots(&self) -> Vec<FailedRobot> {
        let dead = self.state_machine.lifecycles().failed_robots();
        let dead = dead.map(|(robot, cause)| FailedRobot { robot, cause });
        let stopped = self
            .detectors
            .external_stops
            .stopped_robots()
            .filter(|_| self.time_mode.continues_despite_stopped_process());
        let mut failed: Vec<_> = dead.chain(stopped).chain(self.time_mode.hung_robots()).collect();
        failed.extend(self.unreachable_robots());
        failed.sort_by_key(|failed| failed.robot);
        failed
    }

    /// Returns for each robot whether it was alive at the end. A robot of another host that did not report the states
    /// of its robots does not count as alive: a failed run does not wait for such a host.
    fn robots_alive_at_end(&self) -> Vec<bool> {
        let mut alive = self.state_machine.lifecycles().alive_robots().to_vec();
        if let Some(hosts) = &self.helpers.hosts {
            let silent_hosts = hosts.hosts_without_confirmed_end().into_iter();
            silent_hosts
                .flat_map(|host| hosts.robots_of_host(host))
                .for_each(|robot| alive[robot] = false);
        }
        alive
    }

    /// Returns the robots whose host is out of reach, unless a planned partition explains it.
    fn unreachable_robots(&self) -> impl Iterator<Item = FailedRobot> {
        let now_ns = self.receivers.now_ns();
        let is_planned = move |robot: usize| {
            let host = self.processes.remote_host(robot).zip(self.helpers.hosts.as_ref());
            host.is_some_and(|(host, hosts)| hosts.is_partitioned(host, now_ns))
        };
        let robots = self
            .state_machine
            .lifecycles()
            .unreachable_robots()
            .filter(move |&(robot, _)| !is_planned(robot));
        robots.map(|(robot, reason)| FailedRobot {
            robot,
            cause: format!("was out of reach at the end: {reason}"),
        })
    }

    /// Reads and records all messages that have been sent.
    fn drain_messages(&mut self) -> Result<(), RunError> {
        let read_result = self.read_statuses();
        self.state_machine.journal.write_events_before(u64::MAX)?;
        read_result
    }

    /// Lets other hosts end their processes, and reads the last messages of their robots.
    fn release_hosts(&mut self) -> Result<(), RunError> {
        let Some(mut hosts) = self.helpers.hosts.take() else { return Ok(()) };
        let mut read_result = Ok(());
        let mut remotes: Vec<_> =
            self.processes.remote_robots().into_iter().map(|r| r.cloned()).collect();
        let mut remotes: Vec<_> = remotes.iter_mut().map(Option::as_mut).collect();
        let announce_result =
            hosts.announce_end(&mut remotes, self.termination_state.has_failed, || {
                let result = self.read_statuses().and_then(|()| self.receivers.read_latencies());
                if read_result.is_ok() {
                    read_result = result;
                }
            });
        let ended_early = (remotes.iter_mut().enumerate()).filter_map(|(robot, remote)| {
            let remote = remote.as_mut().filter(|remote| remote.ended_early())?;
            Some((robot, remote.reap()?))
        });
        let ended_early: Vec<_> = ended_early.collect();
        self.helpers.hosts = Some(hosts);
        let final_state_result = if self.termination_state.has_failed {
            Ok(())
        } else {
            self.read_final_host_states(ended_early)
        };
        self.state_machine.journal.write_events_before(u64::MAX)?;
        announce_result.and(read_result).and(final_state_result)
    }

    /// Reads the states of other hosts' robots at the end of the run. `ended_early` has those found to have
    /// died by then. Robots of a host that does not reply count as lost, because they may have died.
    fn read_final_host_states(
        &mut self,
        ended_early: Vec<(usize, ExitStatus)>,
    ) -> Result<(), RunError> {
        for (robot, status) in ended_early {
            self.process_death(robot, status)?;
        }
        let Some(hosts) = &self.helpers.hosts else { return Ok(()) };
        for host in hosts.hosts_without_confirmed_end() {
            let Some(hosts) = &self.helpers.hosts else { return Ok(()) };
            let mut robots = hosts.robots_of_host(host).into_iter();
            if robots.any(|robot| !self.state_machine.lifecycles().is_unreachable(robot)) {
                let name = hosts.host_name(host);
                let reason =
                    format!("host {name} did not report the states of its robots at the end");
                self.record_host_loss(host, self.receivers.now_ns(), &reason)?;
            }
        }
        Ok(())
    }

    /// Returns the resource usage and number of starts of all processes, after all have exited.
    fn usages(&mut self) -> Vec<ProcessUsage> {
        let process_usage =
            |name: &str, starts, usage| ProcessUsage { name: name.into(), starts, usage };
        let plant = self.processes.plant.usage().unwrap_or_default();
        let robots = self.processes.usages().map(|(robot, usage)| {
            process_usage(
                self.state_machine.journal.robot_name(robot),
                self.state_machine.lifecycles().incarnation(robot) + 1,
                usage,
            )
        });
        let timer =
            self.processes.control_timer_usage().map(|usage| process_usage("machine", 1, usage));
        let awake = self.time_mode.release_cores().map(|usage| process_usage("awake", 1, usage));
        let first = [
            process_usage("supervisor", 1, usage::read_this_process()),
            process_usage("plant", 1, plant),
        ];
        first.into_iter().chain(robots).chain(timer).chain(awake).collect()
    }
}
