//! Property tests: random event sequences against a model of the processes that does not use the state machine.

use proptest::prelude::*;

use super::*;
use experiment::scenario::RestartWhen;

const ROBOTS: usize = 3;
/// Receiver of each link.
const HEARERS: [usize; 4] = [0, 1, 2, 0];
const POLICY: RestartPolicy = RestartPolicy {
    condition: RestartWhen::OnFailure,
    delay_ns: 10,
    delay_ns_max: 35,
    restarts_max: 3,
    window_ns: 200,
};

/// Next step of the model. Robots and links are numbers.
#[derive(Debug, Clone, Copy)]
enum Act {
    Kill { robot: usize, restart_after_ns: Option<u64> },
    Freeze { robot: usize, ends: bool },
    Thaw { robot: usize },
    Restart { robot: usize },
    Cut { edge: usize },
    Mend { edge: usize },
    // Its process dies without a plan, unless it is stopped and would have to exit by itself.
    Dies { robot: usize, success: bool },
    // The supervisor detects a death.
    Reaped { robot: usize },
    Cleaned { robot: usize },
    Reported { robot: usize, takes_part: bool },
    // Time passes, and due processes are started.
    Wait { ns: u64 },
}

fn any_actions() -> impl Strategy<Value = Vec<Act>> {
    let robot = || 0..ROBOTS;
    let edge = || 0..HEARERS.len();
    let act = prop_oneof![
        2 => (robot(), proptest::option::of(0..60u64))
            .prop_map(|(robot, restart_after_ns)| Act::Kill { robot, restart_after_ns }),
        2 => (robot(), any::<bool>()).prop_map(|(robot, ends)| Act::Freeze { robot, ends }),
        2 => robot().prop_map(|robot| Act::Thaw { robot }),
        1 => robot().prop_map(|robot| Act::Restart { robot }),
        1 => edge().prop_map(|edge| Act::Cut { edge }),
        1 => edge().prop_map(|edge| Act::Mend { edge }),
        2 => (robot(), proptest::bool::weighted(0.1))
            .prop_map(|(robot, success)| Act::Dies { robot, success }),
        4 => robot().prop_map(|robot| Act::Reaped { robot }),
        4 => robot().prop_map(|robot| Act::Cleaned { robot }),
        5 => (robot(), proptest::bool::weighted(0.8))
            .prop_map(|(robot, takes_part)| Act::Reported { robot, takes_part }),
        4 => (0..40u64).prop_map(|ns| Act::Wait { ns }),
    ];
    proptest::collection::vec(act, 0..150)
}

/// One process, as in the kernel.
#[derive(Debug, Clone, Copy, Default)]
struct Process {
    /// Whether the process has reported and takes part.
    reported: bool,
    stopped: bool,
    /// Number of SIGKILLs sent by the supervisor.
    kills: u32,
    /// For a process that is dead and not reaped, whether its exit code was 0; `None` for any other process.
    dead: Option<bool>,
}

/// Independent model of a robot, which only counts events.
#[derive(Debug, Clone, Default)]
struct RobotModel {
    process: Option<Process>,
    starts: u64,
    member: bool,
    pending_cleanups: usize,
    /// Time at which a replacement is due, ns.
    due_ns: Option<u64>,
    /// Times of unplanned deaths that led to a replacement, ns.
    unplanned_ns: Vec<u64>,
}

#[derive(Debug)]
struct World {
    lifecycles: Lifecycles,
    restart_before_cleanup: bool,
    now_ns: u64,
    robots: Vec<RobotModel>,
    /// Start time of each fault, ns, and how it ended.
    faults: BTreeMap<usize, (u64, Vec<End>)>,
    fault: usize,
    told: Vec<usize>,
}

impl World {
    fn new(restart_before_cleanup: bool) -> World {
        let policies = std::iter::repeat_n(POLICY, ROBOTS);
        let started =
            || RobotModel { process: Some(Process::default()), starts: 1, ..RobotModel::default() };
        World {
            lifecycles: Lifecycles::new(policies, HEARERS.into_iter(), restart_before_cleanup),
            restart_before_cleanup,
            now_ns: 0,
            robots: (0..ROBOTS).map(|_| started()).collect(),
            faults: BTreeMap::new(),
            fault: 0,
            told: Vec::new(),
        }
    }

    fn next_fault(&mut self) -> usize {
        self.fault += 1;
        self.fault
    }

    fn happens(&mut self, act: Act) {
        let now_ns = self.now_ns;
        match act {
            Act::Kill { robot, restart_after_ns } => {
                let restart_at_ns = restart_after_ns.map(|after_ns| now_ns + after_ns);
                self.robots[robot].due_ns = restart_at_ns;
                let fault = self.next_fault();
                self.step(Event::Kill { robot, fault, restart_at_ns, who: Initiator::Plan });
            }
            Act::Freeze { robot, ends } => {
                let fault = self.next_fault();
                self.step(Event::Freeze { robot, fault, ends, who: Initiator::Plan });
            }
            Act::Thaw { robot } => {
                // An interactive thaw ends the present freeze, a planned one possibly an earlier freeze.
                let fault = self.lifecycles.frozen_by(robot).unwrap_or(self.fault);
                self.step(Event::Thaw { robot, fault, who: Initiator::Hand });
            }
            Act::Restart { robot } => {
                if self.robots[robot].process.is_none_or(|process| process.kills > 0) {
                    self.robots[robot].due_ns = Some(now_ns);
                }
                self.step(Event::Restart { robot });
            }
            Act::Cut { edge } => {
                let fault = self.next_fault();
                self.step(Event::Cut { edge, fault });
            }
            Act::Mend { edge } => self.step(Event::Mend { edge }),
            Act::Dies { robot, success } => {
                if let Some(process) = &mut self.robots[robot].process {
                    // A stopped process dies only of SIGKILL.
                    let success = success && !process.stopped;
                    process.dead.get_or_insert(success);
                }
            }
            Act::Reaped { robot } => self.reaped(robot),
            Act::Cleaned { robot } => {
                if let Some(left) = self.robots[robot].pending_cleanups.checked_sub(1) {
                    self.robots[robot].pending_cleanups = left;
                    self.step(Event::Cleaned { robot });
                }
            }
            Act::Reported { robot, takes_part } => {
                // Messages sent before it was stopped, killed, or died may arrive afterwards.
                if let Some(process) = &mut self.robots[robot].process {
                    process.reported |= takes_part && process.kills == 0;
                    self.step(Event::Reported { robot, takes_part });
                }
            }
            Act::Wait { ns } => {
                self.now_ns += ns;
                self.step(Event::Due);
            }
        }
    }

    /// Lets the supervisor detect that a process is dead, if it is.
    fn reaped(&mut self, robot: usize) {
        let now_ns = self.now_ns;
        let seen = &mut self.robots[robot];
        let Some(process @ Process { dead: Some(success), .. }) = seen.process else { return };
        seen.process = None;
        let fault = self.fault + 1;
        if process.kills == 0 && !success {
            // An unplanned death: it returns unless it died too often recently.
            let seen = &mut self.robots[robot];
            let recent = seen.unplanned_ns.iter().filter(|&&at| at + POLICY.window_ns >= now_ns);
            let recent = recent.count() as u32;
            if recent < POLICY.restarts_max {
                let wait_ns = (POLICY.delay_ns << recent).min(POLICY.delay_ns_max);
                seen.due_ns = Some(now_ns + wait_ns);
                seen.unplanned_ns.push(now_ns);
            }
        }
        self.step(Event::Died(Death {
            robot,
            cause: String::new(),
            success,
            gave_up: false,
            starting_up: false,
            alive_ns: now_ns,
            fault,
        }));
        assert!(self.robots[robot].pending_cleanups > 0, "what it left is asked to be removed");
    }

    fn step(&mut self, event: Event) {
        let now_ns = self.now_ns;
        for effect in self.lifecycles.step(now_ns, event) {
            self.takes_effect(effect);
        }
        for robot in &self.robots {
            let waits_for = |process: Process| !process.stopped && process.kills == 0;
            assert!(
                !robot.member || robot.process.is_some_and(waits_for),
                "{robot:?} is waited for"
            );
        }
        let pending = self.robots.iter().any(|robot| match robot.process {
            Some(process) => !process.reported || process.kills > 0,
            None => robot.pending_cleanups > 0 || robot.due_ns.is_some_and(|at_ns| at_ns <= now_ns),
        });
        assert_eq!(self.lifecycles.is_at_rest(now_ns), !pending, "{:?}", self.robots);
        let due = self.robots.iter().filter_map(|robot| robot.due_ns).min();
        assert_eq!(self.lifecycles.next_restart_ns(), due);
    }

    fn takes_effect(&mut self, effect: Effect) {
        let now_ns = self.now_ns;
        let all_pending: usize = self.robots.iter().map(|robot| robot.pending_cleanups).sum();
        let beside = self.restart_before_cleanup;
        match effect {
            Effect::Order(Order::Start { robot, incarnation }) => {
                let robot = &mut self.robots[robot];
                assert!(robot.process.is_none(), "beside a living one");
                assert_eq!(incarnation, robot.starts);
                robot.starts += 1;
                assert!(robot.due_ns.take().is_some_and(|at_ns| at_ns <= now_ns), "too early");
                assert!(robot.pending_cleanups == 0 || beside && all_pending <= 1, "no room");
                robot.process = Some(Process::default());
            }
            Effect::Order(Order::Kill(robot)) => {
                let process = self.robots[robot].process.as_mut().expect("a process to kill");
                process.kills += 1;
                assert_eq!(process.kills, 1, "killed once");
                process.dead.get_or_insert(false);
            }
            Effect::Order(Order::Stop(robot)) => {
                let process = self.robots[robot].process.as_mut().expect("a process to stop");
                assert!(!process.stopped && process.kills == 0);
                process.stopped = true;
            }
            Effect::Order(Order::GoOn(robot)) => {
                let process = self.robots[robot].process.as_mut().expect("a process to resume");
                assert!(process.stopped && process.kills == 0);
                process.stopped = false;
            }
            Effect::Order(Order::Join(robot)) => {
                assert!(!std::mem::replace(&mut self.robots[robot].member, true), "joins twice");
            }
            Effect::Order(Order::Leave(robot)) => {
                assert!(std::mem::take(&mut self.robots[robot].member), "leaves twice");
            }
            Effect::Order(Order::CleanUp(robot)) => self.robots[robot].pending_cleanups += 1,
            Effect::Order(Order::TellLinks(robot)) => self.told.push(robot),
            Effect::Record(Record::Note { .. }) | Effect::Order(Order::WarnOfDeath { .. }) => {}
            Effect::Record(Record::Began(fault)) => {
                assert!(self.faults.insert(fault, (now_ns, Vec::new())).is_none(), "begins twice");
            }
            Effect::Record(Record::DiedUnplanned { fault, at_ns, .. }) => {
                assert_eq!(fault, self.next_fault());
                assert!(self.faults.insert(fault, (at_ns, Vec::new())).is_none(), "begins twice");
            }
            Effect::Record(Record::Ended { fault, end, at_ns }) => {
                let (began_ns, ends) = self.faults.get_mut(&fault).expect("it began");
                assert!(at_ns >= *began_ns);
                ends.push(end);
                let orders = [&[End::ForGood][..], &[End::Whole], &[End::ForGood, End::Whole]];
                assert!(orders.contains(&&ends[..]), "{fault} ended so: {ends:?}");
            }
            Effect::Order(Order::EndRun { .. }) => {
                panic!("only during the start-up, or with an exit code")
            }
            Effect::Order(Order::KillPlant | Order::StartLoad { .. } | Order::EndLoad { .. }) => {
                panic!("the model has neither a plant nor load")
            }
        }
    }

    /// Completes everything that is in progress, without new events.
    fn settles(&mut self) {
        for _ in 0..10 {
            for robot in 0..ROBOTS {
                for act in [
                    Act::Reaped { robot },
                    Act::Cleaned { robot },
                    Act::Cleaned { robot },
                    Act::Reported { robot, takes_part: true },
                ] {
                    self.happens(act);
                }
            }
            self.happens(Act::Wait { ns: POLICY.delay_ns_max.max(60) });
        }
        assert!(self.lifecycles.is_at_rest(self.now_ns), "{:?}", self.lifecycles);
    }
}

proptest! {
    /// Runs random sequences. The model asserts these properties: one process of a robot at a time,
    /// consecutive incarnation numbers, one SIGKILL per process, no thaw of a dead process, no wait for a
    /// dead or frozen robot, alternating joins and leaves, one end per fault, restart delays and ceilings
    /// as configured.
    #[test]
    fn random_events_keep_the_lifecycle_invariants(
        acts in any_actions(),
        restart_before_cleanup: bool,
    ) {
        let mut world = World::new(restart_before_cleanup);
        for act in acts {
            world.happens(act);
        }
        world.settles();
    }
}

fn kinds(effects: &[Effect]) -> Vec<&str> {
    let kinds = effects.iter().filter_map(|effect| match effect {
        Effect::Record(Record::Note { kind, .. }) => Some(*kind),
        _ => None,
    });
    kinds.collect()
}

#[test]
fn kill_of_a_frozen_robot_ends_its_freeze_and_drops_its_thaw() {
    let mut world = World::new(false);
    world.happens(Act::Reported { robot: 1, takes_part: true });
    let lifecycles = &mut world.lifecycles;
    lifecycles.step(1, Event::Freeze { robot: 1, fault: 7, ends: true, who: Initiator::Plan });
    let kill = Event::Kill { robot: 1, fault: 8, restart_at_ns: None, who: Initiator::Plan };
    assert!(lifecycles.step(2, kill).contains(&Effect::Order(Order::Kill(1))));
    let death = Death {
        robot: 1,
        cause: "signal 9".into(),
        success: false,
        gave_up: false,
        starting_up: false,
        alive_ns: 2,
        fault: 9,
    };
    let effects = lifecycles.step(3, Event::Died(death));
    assert_eq!(kinds(&effects), ["died"]);
    assert!(effects.contains(&Effect::Record(Record::Ended {
        fault: 7,
        end: End::Whole,
        at_ns: 3
    })));
    let effects = lifecycles.step(4, Event::Thaw { robot: 1, fault: 7, who: Initiator::Plan });
    assert_eq!((effects.len(), kinds(&effects)), (1, vec!["thaw"]));
}

#[test]
fn external_stop_is_a_freeze_without_a_signal() {
    let mut world = World::new(true);
    world.happens(Act::Reported { robot: 1, takes_part: true });
    let (robot, fault, who) = (1, 7, Initiator::Outside);
    let stopped = Event::Freeze { robot, fault, ends: false, who };
    let effects = world.lifecycles.step(1, stopped);
    assert_eq!(
        (kinds(&effects), world.lifecycles.process_state(1)),
        (vec!["freeze"], ProcessState::Frozen)
    );
    let effects_of_end = world.lifecycles.step(2, Event::Thaw { robot, fault, who });
    assert!(effects_of_end.contains(&Effect::Record(Record::Ended {
        fault,
        end: End::Whole,
        at_ns: 2
    })));
    assert_eq!(world.lifecycles.process_state(1), ProcessState::Moving);
    let ours = [Effect::Order(Order::Stop(1)), Effect::Order(Order::GoOn(1))];
    assert!(!effects.iter().chain(&effects_of_end).any(|effect| ours.contains(effect)));
}

#[test]
fn replacement_receives_link_cuts_from_before_its_start() {
    let mut world = World::new(true);
    world.happens(Act::Reported { robot: 0, takes_part: true });
    world.happens(Act::Cut { edge: 3 });
    assert_eq!(world.told, [0]);
    world.happens(Act::Dies { robot: 0, success: false });
    world.happens(Act::Reaped { robot: 0 });
    world.happens(Act::Wait { ns: POLICY.delay_ns });
    world.happens(Act::Reported { robot: 0, takes_part: false });
    assert_eq!(world.told, [0, 0]);
    assert_eq!(
        world.lifecycles.process_state(0),
        ProcessState::Starting,
        "it has not answered yet"
    );
    world.happens(Act::Reported { robot: 0, takes_part: true });
    world.happens(Act::Mend { edge: 3 });
    assert!(!world.lifecycles.is_cut(3));
}

#[test]
fn unreplaced_death_during_start_up_ends_the_run() {
    let never = RestartPolicy { condition: RestartWhen::Never, ..POLICY };
    for (gave_up, starting_up) in [(true, false), (false, true)] {
        let mut lifecycles = Lifecycles::new([never].into_iter(), std::iter::empty(), false);
        let how = "exit code 4".to_owned();
        let death = Death {
            robot: 0,
            cause: how,
            success: false,
            gave_up,
            starting_up,
            alive_ns: 0,
            fault: 0,
        };
        let effects = lifecycles.step(0, Event::Died(death));
        assert!(
            matches!(effects.last(), Some(Effect::Order(Order::EndRun { robot: 0, .. }))),
            "{effects:?}"
        );
    }
}
