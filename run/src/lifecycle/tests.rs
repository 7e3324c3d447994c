//! Property tests: random event sequences against a model of the processes that does not use the state machine.

use proptest::prelude::*;

use super::*;
use experiment::scenario::RestartCondition;

const ROBOT_COUNT: usize = 3;
/// Receiver of each link.
const LINK_RECEIVERS: [usize; 4] = [0, 1, 2, 0];
const POLICY: RestartPolicy = RestartPolicy {
    condition: RestartCondition::OnFailure,
    delay_ns: 10,
    delay_ns_max: 35,
    restarts_max: 3,
    window_ns: 200,
};

/// Next step of the model. Robots and links are numbers.
#[derive(Debug, Clone, Copy)]
enum Action {
    Kill { robot: usize, restart_after_ns: Option<u64> },
    Freeze { robot: usize, has_planned_thaw: bool },
    Thaw { robot: usize },
    Restart { robot: usize },
    CutLink { edge: usize },
    RepairLink { edge: usize },
    // Its process dies without a plan, unless it is stopped and would have to exit by itself.
    Die { robot: usize, success: bool },
    // The supervisor detects a death.
    Reap { robot: usize },
    CleanUp { robot: usize },
    ReportStatus { robot: usize, takes_part: bool },
    // Time passes, and due processes are started.
    Wait { ns: u64 },
}

fn any_actions() -> impl Strategy<Value = Vec<Action>> {
    let robot = || 0..ROBOT_COUNT;
    let edge = || 0..LINK_RECEIVERS.len();
    let action = prop_oneof![
        2 => (robot(), proptest::option::of(0..60u64))
            .prop_map(|(robot, restart_after_ns)| Action::Kill { robot, restart_after_ns }),
        2 => (robot(), any::<bool>()).prop_map(|(robot, has_planned_thaw)| Action::Freeze { robot, has_planned_thaw }),
        2 => robot().prop_map(|robot| Action::Thaw { robot }),
        1 => robot().prop_map(|robot| Action::Restart { robot }),
        1 => edge().prop_map(|edge| Action::CutLink { edge }),
        1 => edge().prop_map(|edge| Action::RepairLink { edge }),
        2 => (robot(), proptest::bool::weighted(0.1))
            .prop_map(|(robot, success)| Action::Die { robot, success }),
        4 => robot().prop_map(|robot| Action::Reap { robot }),
        4 => robot().prop_map(|robot| Action::CleanUp { robot }),
        5 => (robot(), proptest::bool::weighted(0.8))
            .prop_map(|(robot, takes_part)| Action::ReportStatus { robot, takes_part }),
        4 => (0..40u64).prop_map(|ns| Action::Wait { ns }),
    ];
    proptest::collection::vec(action, 0..150)
}

/// One process, as in the kernel.
#[derive(Debug, Clone, Copy, Default)]
struct Process {
    /// Whether the process has reported and takes part.
    has_reported: bool,
    is_stopped: bool,
    /// Number of SIGKILLs sent by the supervisor.
    kill_count: u32,
    /// For a process that is dead and not reaped, whether its exit code was 0; `None` for any other process.
    exit_success: Option<bool>,
}

/// Independent model of a robot, which only counts events.
#[derive(Debug, Clone, Default)]
struct RobotModel {
    process: Option<Process>,
    start_count: u64,
    is_barrier_member: bool,
    pending_cleanups: usize,
    /// Time at which a replacement is due, ns.
    restart_due_ns: Option<u64>,
    /// Times of unplanned deaths that led to a replacement, ns.
    unplanned_death_times_ns: Vec<u64>,
}

#[derive(Debug)]
struct LifecycleHarness {
    lifecycles: Lifecycles,
    restart_before_cleanup: bool,
    now_ns: u64,
    robots: Vec<RobotModel>,
    /// Start time of each fault, ns, and how it ended.
    faults: BTreeMap<usize, (u64, Vec<FaultEnd>)>,
    last_fault: usize,
    robots_sent_links: Vec<usize>,
}

impl LifecycleHarness {
    fn new(restart_before_cleanup: bool) -> LifecycleHarness {
        let policies = std::iter::repeat_n(POLICY, ROBOT_COUNT);
        let started = || RobotModel {
            process: Some(Process::default()),
            start_count: 1,
            ..RobotModel::default()
        };
        LifecycleHarness {
            lifecycles: Lifecycles::new(
                policies,
                LINK_RECEIVERS.into_iter(),
                restart_before_cleanup,
            ),
            restart_before_cleanup,
            now_ns: 0,
            robots: (0..ROBOT_COUNT).map(|_| started()).collect(),
            faults: BTreeMap::new(),
            last_fault: 0,
            robots_sent_links: Vec::new(),
        }
    }

    fn next_fault(&mut self) -> usize {
        self.last_fault += 1;
        self.last_fault
    }

    fn apply_action(&mut self, action: Action) {
        let now_ns = self.now_ns;
        match action {
            Action::Kill { robot, restart_after_ns } => {
                let restart_at_ns = restart_after_ns.map(|after_ns| now_ns + after_ns);
                self.robots[robot].restart_due_ns = restart_at_ns;
                let fault = self.next_fault();
                self.step(LifecycleEvent::Kill {
                    robot,
                    fault,
                    restart_at_ns,
                    initiator: Initiator::Plan,
                });
            }
            Action::Freeze { robot, has_planned_thaw } => {
                let fault = self.next_fault();
                self.step(LifecycleEvent::Freeze {
                    robot,
                    fault,
                    has_planned_thaw,
                    initiator: Initiator::Plan,
                });
            }
            Action::Thaw { robot } => {
                // An interactive thaw ends the present freeze, a planned one possibly an earlier freeze.
                let fault = self.lifecycles.freezing_fault(robot).unwrap_or(self.last_fault);
                self.step(LifecycleEvent::Thaw {
                    robot,
                    fault,
                    initiator: Initiator::LiveViewClient,
                });
            }
            Action::Restart { robot } => {
                if self.robots[robot].process.is_none_or(|process| process.kill_count > 0) {
                    self.robots[robot].restart_due_ns = Some(now_ns);
                }
                self.step(LifecycleEvent::Restart { robot });
            }
            Action::CutLink { edge } => {
                let fault = self.next_fault();
                self.step(LifecycleEvent::CutLink { edge, fault });
            }
            Action::RepairLink { edge } => self.step(LifecycleEvent::RepairLink { edge }),
            Action::Die { robot, success } => {
                if let Some(process) = &mut self.robots[robot].process {
                    // A stopped process dies only of SIGKILL.
                    let success = success && !process.is_stopped;
                    process.exit_success.get_or_insert(success);
                }
            }
            Action::Reap { robot } => self.detect_death(robot),
            Action::CleanUp { robot } => {
                if let Some(remaining) = self.robots[robot].pending_cleanups.checked_sub(1) {
                    self.robots[robot].pending_cleanups = remaining;
                    self.step(LifecycleEvent::CleanedUp { robot });
                }
            }
            Action::ReportStatus { robot, takes_part } => {
                // Messages sent before it was stopped, killed, or died may arrive afterwards.
                if let Some(process) = &mut self.robots[robot].process {
                    process.has_reported |= takes_part && process.kill_count == 0;
                    self.step(LifecycleEvent::StatusReported { robot, takes_part });
                }
            }
            Action::Wait { ns } => {
                self.now_ns += ns;
                self.step(LifecycleEvent::TimePassed);
            }
        }
    }

    /// Lets the supervisor detect that a process is dead, if it is.
    fn detect_death(&mut self, robot: usize) {
        let now_ns = self.now_ns;
        let model = &mut self.robots[robot];
        let Some(process @ Process { exit_success: Some(exited_successfully), .. }) = model.process
        else {
            return;
        };
        model.process = None;
        let fault = self.last_fault + 1;
        if process.kill_count == 0 && !exited_successfully {
            // An unplanned death: it returns unless it died too often recently.
            let model = &mut self.robots[robot];
            let recent_deaths = model
                .unplanned_death_times_ns
                .iter()
                .filter(|&&at| at + POLICY.window_ns >= now_ns);
            let recent_deaths = recent_deaths.count() as u32;
            if recent_deaths < POLICY.restarts_max {
                let wait_ns = (POLICY.delay_ns << recent_deaths).min(POLICY.delay_ns_max);
                model.restart_due_ns = Some(now_ns + wait_ns);
                model.unplanned_death_times_ns.push(now_ns);
            }
        }
        self.step(LifecycleEvent::ProcessDied(ProcessDeath {
            robot,
            cause: String::new(),
            exited_successfully,
            is_infrastructure_failure: false,
            is_before_motion: false,
            last_seen_alive_ns: now_ns,
            fault,
        }));
        assert!(self.robots[robot].pending_cleanups > 0, "what it left is asked to be removed");
    }

    fn step(&mut self, event: LifecycleEvent) {
        let now_ns = self.now_ns;
        for effect in self.lifecycles.handle_event(now_ns, event) {
            self.apply_effect(effect);
        }
        for robot in &self.robots {
            let can_reply = |process: Process| {
                process.has_reported && !process.is_stopped && process.kill_count == 0
            };
            assert_eq!(
                robot.is_barrier_member,
                robot.process.is_some_and(can_reply),
                "the barrier waits for the robots that answer: {robot:?}"
            );
        }
        let pending = self.robots.iter().any(|robot| match robot.process {
            Some(process) => !process.has_reported || process.kill_count > 0,
            None => robot.restart_due_ns.is_some_and(|at_ns| at_ns <= now_ns),
        });
        assert_eq!(self.lifecycles.is_idle(now_ns), !pending, "{:?}", self.robots);
        let due = self.robots.iter().filter_map(|robot| robot.restart_due_ns).min();
        assert_eq!(self.lifecycles.next_restart_ns(), due);
    }

    fn apply_effect(&mut self, effect: Effect) {
        let now_ns = self.now_ns;
        let all_pending: usize = self.robots.iter().map(|robot| robot.pending_cleanups).sum();
        let restart_before_cleanup = self.restart_before_cleanup;
        match effect {
            Effect::Order(DriverOrder::Start { robot, incarnation }) => {
                let robot = &mut self.robots[robot];
                assert!(robot.process.is_none(), "beside a living one");
                assert_eq!(incarnation, robot.start_count);
                robot.start_count += 1;
                assert!(
                    robot.restart_due_ns.take().is_some_and(|at_ns| at_ns <= now_ns),
                    "too early"
                );
                assert!(
                    robot.pending_cleanups == 0 || restart_before_cleanup && all_pending <= 1,
                    "no room"
                );
                robot.process = Some(Process::default());
            }
            Effect::Order(DriverOrder::Kill(robot)) => {
                let process = self.robots[robot].process.as_mut().expect("a process to kill");
                process.kill_count += 1;
                assert_eq!(process.kill_count, 1, "killed once");
                process.exit_success.get_or_insert(false);
            }
            Effect::Order(DriverOrder::Stop(robot)) => {
                let process = self.robots[robot].process.as_mut().expect("a process to stop");
                assert!(!process.is_stopped && process.kill_count == 0);
                process.is_stopped = true;
            }
            Effect::Order(DriverOrder::Resume(robot)) => {
                let process = self.robots[robot].process.as_mut().expect("a process to resume");
                assert!(process.is_stopped && process.kill_count == 0);
                process.is_stopped = false;
            }
            Effect::Order(DriverOrder::JoinBarrier(robot)) => {
                assert!(
                    !std::mem::replace(&mut self.robots[robot].is_barrier_member, true),
                    "joins twice"
                );
            }
            Effect::Order(DriverOrder::LeaveBarrier(robot)) => {
                assert!(std::mem::take(&mut self.robots[robot].is_barrier_member), "leaves twice");
            }
            Effect::Order(DriverOrder::CleanUp(robot)) => self.robots[robot].pending_cleanups += 1,
            Effect::Order(DriverOrder::SendCutLinks(robot)) => self.robots_sent_links.push(robot),
            Effect::Record(RunRecord::Note { .. })
            | Effect::Order(DriverOrder::WarnOfDeath { .. }) => {}
            Effect::Record(RunRecord::FaultBegan(fault)) => {
                assert!(self.faults.insert(fault, (now_ns, Vec::new())).is_none(), "begins twice");
            }
            Effect::Record(RunRecord::UnplannedDeath { fault, at_ns, .. }) => {
                assert_eq!(fault, self.next_fault());
                assert!(self.faults.insert(fault, (at_ns, Vec::new())).is_none(), "begins twice");
            }
            Effect::Record(RunRecord::FaultEnded { fault, end, at_ns }) => {
                let (start_ns, recorded_ends) = self.faults.get_mut(&fault).expect("it began");
                assert!(at_ns >= *start_ns);
                recorded_ends.push(end);
                let allowed_ends = [
                    &[FaultEnd::Permanent][..],
                    &[FaultEnd::Repaired],
                    &[FaultEnd::Permanent, FaultEnd::Repaired],
                ];
                assert!(
                    allowed_ends.contains(&&recorded_ends[..]),
                    "{fault} ended so: {recorded_ends:?}"
                );
            }
            Effect::Order(DriverOrder::EndRun { .. }) => {
                panic!("only during the start-up, or with an exit code")
            }
            Effect::Order(
                DriverOrder::KillPlant
                | DriverOrder::StartLoad { .. }
                | DriverOrder::EndLoad { .. },
            ) => {
                panic!("the model has neither a plant nor load")
            }
        }
    }

    /// Completes everything that is in progress, without new events.
    fn run_until_idle(&mut self) {
        for _ in 0..10 {
            for robot in 0..ROBOT_COUNT {
                for action in [
                    Action::Reap { robot },
                    Action::CleanUp { robot },
                    Action::CleanUp { robot },
                    Action::ReportStatus { robot, takes_part: true },
                ] {
                    self.apply_action(action);
                }
            }
            self.apply_action(Action::Wait { ns: POLICY.delay_ns_max.max(60) });
        }
        assert!(self.lifecycles.is_idle(self.now_ns), "{:?}", self.lifecycles);
    }
}

proptest! {
    /// Runs random sequences. The model asserts these properties: one process of a robot at a time,
    /// consecutive incarnation numbers, one SIGKILL per process, no thaw of a dead process, no wait for a
    /// dead or frozen robot, alternating joins and leaves, one end per fault, restart delays and ceilings
    /// as configured.
    #[test]
    fn random_events_keep_the_lifecycle_invariants(
        actions in any_actions(),
        restart_before_cleanup: bool,
    ) {
        let mut harness = LifecycleHarness::new(restart_before_cleanup);
        for action in actions {
            harness.apply_action(action);
        }
        harness.run_until_idle();
    }
}

fn event_kinds(effects: &[Effect]) -> Vec<&str> {
    let kinds = effects.iter().filter_map(|effect| match effect {
        Effect::Record(RunRecord::Note { kind, .. }) => Some(*kind),
        _ => None,
    });
    kinds.collect()
}

/// Returns the unplanned death of a robot's process, reported under this fault.
fn death_by_signal(robot: usize, fault: usize) -> ProcessDeath {
    ProcessDeath {
        robot,
        cause: "signal 9".into(),
        exited_successfully: false,
        is_infrastructure_failure: false,
        is_before_motion: false,
        last_seen_alive_ns: 2,
        fault,
    }
}

#[test]
fn kill_of_a_frozen_robot_ends_its_freeze_and_drops_its_thaw() {
    let mut harness = LifecycleHarness::new(false);
    harness.apply_action(Action::ReportStatus { robot: 1, takes_part: true });
    let lifecycles = &mut harness.lifecycles;
    lifecycles.handle_event(
        1,
        LifecycleEvent::Freeze {
            robot: 1,
            fault: 7,
            has_planned_thaw: true,
            initiator: Initiator::Plan,
        },
    );
    let kill = LifecycleEvent::Kill {
        robot: 1,
        fault: 8,
        restart_at_ns: None,
        initiator: Initiator::Plan,
    };
    assert!(lifecycles.handle_event(2, kill).contains(&Effect::Order(DriverOrder::Kill(1))));
    let effects = lifecycles.handle_event(3, LifecycleEvent::ProcessDied(death_by_signal(1, 9)));
    assert_eq!(event_kinds(&effects), ["died"]);
    assert!(effects.contains(&Effect::Record(RunRecord::FaultEnded {
        fault: 7,
        end: FaultEnd::Repaired,
        at_ns: 3
    })));
    let effects = lifecycles
        .handle_event(4, LifecycleEvent::Thaw { robot: 1, fault: 7, initiator: Initiator::Plan });
    assert_eq!((effects.len(), event_kinds(&effects)), (1, vec!["thaw"]));
}

#[test]
fn external_stop_is_a_freeze_without_a_signal() {
    let mut harness = LifecycleHarness::new(true);
    harness.apply_action(Action::ReportStatus { robot: 1, takes_part: true });
    let (robot, fault, initiator) = (1, 7, Initiator::OtherProcess);
    let freeze = LifecycleEvent::Freeze { robot, fault, has_planned_thaw: false, initiator };
    let effects = harness.lifecycles.handle_event(1, freeze);
    assert_eq!(
        (event_kinds(&effects), harness.lifecycles.process_state(1)),
        (vec!["freeze"], ProcessState::Frozen)
    );
    let thaw_effects =
        harness.lifecycles.handle_event(2, LifecycleEvent::Thaw { robot, fault, initiator });
    assert!(thaw_effects.contains(&Effect::Record(RunRecord::FaultEnded {
        fault,
        end: FaultEnd::Repaired,
        at_ns: 2
    })));
    assert_eq!(harness.lifecycles.process_state(1), ProcessState::Moving);
    let supervisor_signals =
        [Effect::Order(DriverOrder::Stop(1)), Effect::Order(DriverOrder::Resume(1))];
    assert!(!effects.iter().chain(&thaw_effects).any(|effect| supervisor_signals.contains(effect)));
}

/// Returns the recorded ends of faults.
fn fault_ends(effects: &[Effect]) -> Vec<(usize, FaultEnd)> {
    let ends = effects.iter().filter_map(|effect| match effect {
        Effect::Record(RunRecord::FaultEnded { fault, end, .. }) => Some((*fault, *end)),
        _ => None,
    });
    ends.collect()
}

#[test]
fn freeze_without_a_planned_thaw_is_permanent() {
    for (has_planned_thaw, ends) in [(true, vec![]), (false, vec![(7, FaultEnd::Permanent)])] {
        let mut harness = LifecycleHarness::new(true);
        harness.apply_action(Action::ReportStatus { robot: 1, takes_part: true });
        let (robot, fault, initiator) = (1, 7, Initiator::Plan);
        let freeze = LifecycleEvent::Freeze { robot, fault, has_planned_thaw, initiator };
        assert_eq!(fault_ends(&harness.lifecycles.handle_event(1, freeze)), ends);
    }
}

#[test]
fn death_of_a_replacement_belongs_to_the_fault_that_it_repairs() {
    let policy = RestartPolicy { restarts_max: 1, window_ns: 5_000_000_000, ..POLICY };
    let mut lifecycles = Lifecycles::new([policy].into_iter(), std::iter::empty(), true);
    let status = LifecycleEvent::StatusReported { robot: 0, takes_part: true };
    lifecycles.handle_event(0, status);

    let effects = lifecycles.handle_event(3, LifecycleEvent::ProcessDied(death_by_signal(0, 7)));
    let starts_fault = |effects: &[Effect]| {
        let is_start =
            |effect: &Effect| matches!(effect, Effect::Record(RunRecord::UnplannedDeath { .. }));
        effects.iter().any(is_start)
    };
    let warns_of_replacement = |effects: &[Effect]| match effects.last() {
        Some(Effect::Order(DriverOrder::WarnOfDeath { is_replacement, .. })) => *is_replacement,
        other => panic!("no warning, but {other:?}"),
    };
    assert!(starts_fault(&effects) && !warns_of_replacement(&effects));
    assert_eq!(fault_ends(&effects), [], "a replacement is due");
    let failure = |lifecycles: &Lifecycles| lifecycles.failed_robots().next().expect("a loss").1;
    let text = failure(&lifecycles);
    assert!(text.ends_with("had not been started at the end"), "{text}");

    lifecycles.handle_event(3 + policy.delay_ns, LifecycleEvent::TimePassed);
    let text = failure(&lifecycles);
    assert!(text.ends_with("was not ready at the end"), "{text}");

    let death = LifecycleEvent::ProcessDied(death_by_signal(0, 8));
    let mut effects = lifecycles.handle_event(20, death);
    assert_eq!(fault_ends(&effects), [(7, FaultEnd::Permanent)], "no further restart");
    effects.pop();
    assert!(!starts_fault(&effects) && warns_of_replacement(&effects));
    let text = failure(&lifecycles);
    assert!(text.contains("after 1 restarts within 5 s"), "{text}");
}

#[test]
fn replacement_receives_link_cuts_from_before_its_start() {
    let mut harness = LifecycleHarness::new(true);
    harness.apply_action(Action::ReportStatus { robot: 0, takes_part: true });
    harness.apply_action(Action::CutLink { edge: 3 });
    assert_eq!(harness.robots_sent_links, [0]);
    harness.apply_action(Action::Die { robot: 0, success: false });
    harness.apply_action(Action::Reap { robot: 0 });
    harness.apply_action(Action::Wait { ns: POLICY.delay_ns });
    harness.apply_action(Action::ReportStatus { robot: 0, takes_part: false });
    assert_eq!(harness.robots_sent_links, [0, 0]);
    assert_eq!(
        harness.lifecycles.process_state(0),
        ProcessState::Starting,
        "it has not answered yet"
    );
    harness.apply_action(Action::ReportStatus { robot: 0, takes_part: true });
    harness.apply_action(Action::RepairLink { edge: 3 });
    assert!(!harness.lifecycles.is_link_cut(3));
}

#[test]
fn unreplaced_death_during_start_up_ends_the_run() {
    let policy = RestartPolicy { condition: RestartCondition::Never, ..POLICY };
    for (is_infrastructure_failure, is_before_motion) in [(true, false), (false, true)] {
        let mut lifecycles = Lifecycles::new([policy].into_iter(), std::iter::empty(), false);
        let cause = "exit code 4".to_owned();
        let death = ProcessDeath {
            robot: 0,
            cause,
            exited_successfully: false,
            is_infrastructure_failure,
            is_before_motion,
            last_seen_alive_ns: 0,
            fault: 0,
        };
        let effects = lifecycles.handle_event(0, LifecycleEvent::ProcessDied(death));
        assert!(
            matches!(effects.last(), Some(Effect::Order(DriverOrder::EndRun { robot: 0, .. }))),
            "{effects:?}"
        );
    }
}

#[test]
fn queries_follow_a_robot_through_its_lifecycle() {
    let mut lifecycles = Lifecycles::new([POLICY; 2].into_iter(), 0..2, true);
    assert!(lifecycles.is_any_process_starting());
    for robot in 0..2 {
        lifecycles.handle_event(0, LifecycleEvent::StatusReported { robot, takes_part: true });
    }
    assert!(!lifecycles.is_any_process_starting());
    let initiator = Initiator::Plan;
    let freeze = LifecycleEvent::Freeze { robot: 1, fault: 7, has_planned_thaw: true, initiator };
    lifecycles.handle_event(1, freeze);
    assert_eq!([0, 1].map(|robot| lifecycles.freezing_fault(robot)), [None, Some(7)]);
    lifecycles.handle_event(2, LifecycleEvent::Thaw { robot: 1, fault: 7, initiator });
    assert_eq!(lifecycles.freezing_fault(1), None);
    lifecycles.handle_event(2, LifecycleEvent::CutLink { edge: 1, fault: 8 });
    assert_eq!([0, 1].map(|edge| lifecycles.is_link_cut(edge)), [false, true]);

    assert_eq!(lifecycles.alive_robots(), [true, true]);
    lifecycles.handle_event(3, LifecycleEvent::ProcessDied(death_by_signal(1, 9)));
    assert_eq!(lifecycles.alive_robots(), [true, false]);
    assert_eq!([0, 1].map(|robot| lifecycles.will_be_replaced(robot)), [false, true]);
    lifecycles.handle_event(3 + POLICY.delay_ns, LifecycleEvent::TimePassed);
    assert_eq!([0, 1].map(|robot| lifecycles.incarnation(robot)), [0, 1]);
    assert!(lifecycles.is_any_process_starting() && !lifecycles.will_be_replaced(1));
    let failed: Vec<(usize, String)> = lifecycles.failed_robots().collect();
    assert!(matches!(&failed[..], [(1, cause)] if cause.contains("signal 9")), "{failed:?}");
    let status = LifecycleEvent::StatusReported { robot: 1, takes_part: true };
    lifecycles.handle_event(20, status);
    assert_eq!(
        (lifecycles.alive_robots(), lifecycles.failed_robots().count()),
        (&[true, true][..], 0)
    );

    let reason = "no report".to_owned();
    let event = LifecycleEvent::HostUnreachable { robot: 0, fault: 10, reason: reason.clone() };
    lifecycles.handle_event(30, event);
    assert_eq!([0, 1].map(|robot| lifecycles.is_unreachable(robot)), [true, false]);
    assert_eq!(lifecycles.unreachable_robots().collect::<Vec<_>>(), [(0, "no report")]);
    assert_eq!(lifecycles.alive_robots(), [false, true]);
    let effects = lifecycles.handle_event(31, LifecycleEvent::HostReachable { robot: 0, reason });
    assert!(!lifecycles.is_unreachable(0));
    assert_eq!(lifecycles.alive_robots(), [true, true]);
    assert_eq!(fault_ends(&effects), [(10, FaultEnd::Repaired)]);
}

#[test]
fn robot_without_a_leader_is_shown_as_orphaned_while_moving() {
    use ProcessState::{Dead, Exiting, Frozen, Moving, Starting};
    let states = [Starting, Moving, Frozen, Exiting, Dead];
    let displayed = |orphaned: bool| states.map(|state| state.display_state(orphaned));
    let connected = [
        RobotState::Starting,
        RobotState::Moving,
        RobotState::Frozen,
        RobotState::Dead,
        RobotState::Dead,
    ];
    assert_eq!(displayed(false), connected);
    let mut orphaned = connected;
    orphaned[1] = RobotState::Orphaned;
    assert_eq!(displayed(true), orphaned);
}
