//! Rules of the control cycle.

use std::convert::Infallible;

use formation::Vec2;
use protocol::brief::Pace;
use protocol::fault::{SlowFault, Span};
use protocol::law_message::{Broadcast, MessageFormat};
use protocol::message::{Beacon, LatencyRow, ReceptionState};

use super::*;
use crate::controller::Parts;
use crate::laws::{Law, SignalValues, Situation};
use crate::roles;
use crate::testing::{NS_PER_MS, START_NS, beacon, brief, odometry};

/// Index of a robot that sends its reports at multiples of 100 ms of the machine's clock.
const FIRST_PHASE_INDEX: usize = 0;

/// Creates the robot of the brief with these changes.
fn control_cycle_with(change: impl FnOnce(&mut AgentBrief)) -> ControlCycle {
    let mut brief = brief();
    change(&mut brief);
    let controller = Controller::new(&brief, 3).unwrap();
    ControlCycle::new(controller, START_NS)
}

fn set_lockstep(brief: &mut AgentBrief) {
    brief.pace = Pace::Lockstep;
}

/// Makes a robot need `delay_ns` for each answer.
fn set_answer_delay(brief: &mut AgentBrief, delay_ns: u64) {
    brief.slow =
        vec![SlowFault { span: Span { from_ns: 0, until_ns: Span::UNBOUNDED_END_NS }, delay_ns }];
}

impl ControlCycle {
    /// Runs its cycle `at_ms` milliseconds after the start, with the sample of `sample_ms` and beacons from r5
    /// with the stamps `beacons_ms`. The first is received at the start of the cycle, each further one 1 ms
    /// later.
    fn run_cycle_at(&mut self, at_ms: u64, sample_ms: Option<u64>, beacons_ms: &[u64]) -> Outbox {
        self.run_cycle_of_participant(0, at_ms, sample_ms, beacons_ms).0
    }

    /// Runs the cycle of a participant since `participant_since_tick`. Also returns the number of beacons received.
    fn run_cycle_of_participant(
        &mut self,
        participant_since_tick: u64,
        at_ms: u64,
        sample_ms: Option<u64>,
        beacons_ms: &[u64],
    ) -> (Outbox, usize) {
        let (received_ns, mut count) = (START_NS + at_ms * NS_PER_MS, 0);
        let sample = sample_ms.map(odometry);
        let beacons = (0..).zip(beacons_ms).map(|(i, &t_ms)| {
            count += 1;
            let beacon = Beacon { sent_ns: received_ns - NS_PER_MS, ..beacon(t_ms) };
            Ok::<_, Infallible>(ReceivedBeacon {
                sender_index: 0,
                broadcast: Broadcast::from(beacon),
                received_ns: received_ns + i * NS_PER_MS,
            })
        });
        let inbox = Inbox {
            received_ns,
            odometry: sample.as_ref(),
            participant_since_tick,
            beacons,
            link_faults: &[],
            goal: None,
        };
        let Ok(outbox) = self.run(inbox);
        (outbox, count)
    }

    /// Returns the measurements of this stage: sender and duration, ms.
    fn measurements_ms(&self, stage: Stage) -> Vec<(u32, u64)> {
        let rows = self.measurements.batch().1.iter().filter(|row| row.stage == stage as u32);
        rows.map(|LatencyRow { from, value_ns, .. }| (*from, value_ns / NS_PER_MS)).collect()
    }

    fn wake_up_at_ms(&mut self, due_ms: u64, thawed_ms: u64) -> WakeUpClass {
        let wake = WakeUp { due_ns: START_NS + due_ms * NS_PER_MS, lateness_ns: 2 * NS_PER_MS };
        self.record_wake_up(&wake, START_NS + thawed_ms * NS_PER_MS)
    }

    fn record_sent_ms(&mut self, sent_ms: u64) {
        self.record_sent(START_NS + sent_ms * NS_PER_MS);
    }
}

#[test]
fn first_sample_has_no_beacons_and_leaves_them_queued() {
    let mut robot_1 = control_cycle_with(|_| ());
    assert_eq!(robot_1.run_cycle_of_participant(0, 0, None, &[0]).1, 0, "it has not started");
    assert_eq!(robot_1.run_cycle_of_participant(0, 1, Some(0), &[0]).1, 0);
    assert_eq!(
        robot_1.run_cycle_of_participant(0, 11, None, &[0]).1,
        1,
        "without a sample it hears as well"
    );
    robot_1.run_cycle_at(20, Some(20), &[10]);
    assert_eq!(robot_1.status().1.next().unwrap().contact, ReceptionState::Fresh as u64);

    let mut robot_2 = control_cycle_with(set_lockstep);
    let beacon_counts = [(0, 0), (0, 1), (2, 2), (2, 3)].map(|(since, tick)| {
        robot_2.run_cycle_of_participant(since, tick, Some(tick), &[tick.saturating_sub(1)]).1
    });
    assert_eq!(beacon_counts, [0, 1, 0, 1], "nor does it when it goes on after a freeze");
}

#[test]
fn odometry_older_than_command_timeout_is_not_answered() {
    let mut robot_1 = control_cycle_with(|_| ());
    assert!(
        robot_1.run_cycle_at(25, Some(0), &[]).answer.is_none()
            && !robot_1.controller.has_started()
    );
    let answers = [(24, 0), (30, 10)].map(|(at_ms, sample_ms)| {
        let command =
            robot_1.run_cycle_at(at_ms, Some(sample_ms), &[]).answer.expect("in time").command;
        (command.sequence, command.incarnation)
    });
    assert_eq!(answers, [(1, 3), (2, 3)]);
    // Receiving the beacons takes 5 ms.
    assert!(robot_1.run_cycle_at(40, Some(20), &[1, 2, 3, 4, 5, 6]).answer.is_none());
    assert_eq!(
        robot_1.law_output(),
        LawOutput::Velocity(formation::Vec2::zeros()),
        "the law is not asked"
    );
    assert!(robot_1.run_cycle_at(50, Some(50), &[]).answer.is_some());
    assert!(robot_1.run_cycle_at(60, None, &[]).answer.is_none(), "one answer to each");
    assert_eq!(robot_1.status().0.odometry_old, 2);
    // In lockstep the reference time is the stamp of the sample.
    assert!(control_cycle_with(set_lockstep).run_cycle_at(1000, Some(0), &[]).answer.is_some());
}

#[test]
fn answer_delayed_by_a_period_expires_only_in_lockstep() {
    for (pace, delay_ns, answers) in [
        (Pace::Lockstep, 10 * NS_PER_MS - 1, true),
        (Pace::Lockstep, 10 * NS_PER_MS, false),
        (Pace::Realtime, 10 * NS_PER_MS, true),
    ] {
        let mut robot = control_cycle_with(|brief| {
            brief.pace = pace;
            set_answer_delay(brief, delay_ns);
        });
        let answer = robot.run_cycle_at(0, Some(0), &[]).answer;
        assert_eq!(answer.map(|answer| answer.delay_ns), answers.then_some(delay_ns), "{pace:?}");
    }
}

#[test]
fn wake_up_after_freeze_or_slowness_is_held() {
    let mut robot_1 = control_cycle_with(|brief| set_answer_delay(brief, 5 * NS_PER_MS));
    assert_eq!(robot_1.wake_up_at_ms(0, 9), WakeUpClass::Starting);
    robot_1.run_cycle_at(0, Some(0), &[]);
    robot_1.record_sent_ms(5);
    assert_eq!(robot_1.wake_up_at_ms(4, 0), WakeUpClass::DelayedByFault, "it was slow until 5 ms");
    assert_eq!(robot_1.wake_up_at_ms(5, 0), WakeUpClass::Counted { missed_deadline: false });
    assert_eq!(
        robot_1.wake_up_at_ms(9, 10),
        WakeUpClass::DelayedByFault,
        "it was frozen until 10 ms"
    );
    assert_eq!(robot_1.wake_up_at_ms(10, 10), WakeUpClass::Counted { missed_deadline: false });
    robot_1.run_cycle_at(10, Some(10), &[]);
    let counts = [Stage::PlannedDelay, Stage::Wake].map(|stage| robot_1.measurements_ms(stage));
    assert_eq!(counts, [[(0, 2); 2], [(0, 2); 2]]);
    let mut quick = control_cycle_with(|_| ());
    quick.wake_up_at_ms(0, 0);
    quick.run_cycle_at(0, Some(0), &[]);
    quick.record_sent_ms(5);
    assert_eq!(
        quick.wake_up_at_ms(4, 0),
        WakeUpClass::Counted { missed_deadline: false },
        "not on purpose"
    );
}

#[test]
fn late_answer_misses_a_deadline_per_period() {
    let mut robot_1 = control_cycle_with(|_| ());
    robot_1.run_cycle_at(0, Some(0), &[]);
    let mut misses = Vec::new();
    for (due_ms, sent_ms, missed) in
        [(0, 9, false), (10, 20, false), (20, 47, true), (50, 61, true)]
    {
        assert_eq!(
            robot_1.wake_up_at_ms(due_ms, 0),
            WakeUpClass::Counted { missed_deadline: missed },
            "{due_ms} ms"
        );
        robot_1.run_cycle_at(due_ms + 3, Some(due_ms), &[]);
        robot_1.record_sent_ms(sent_ms);
        misses.push(robot_1.status().0.deadline_misses);
    }
    assert_eq!(misses, [0, 1, 3, 4]);
    let missed = [60, 70].map(|due_ms| robot_1.wake_up_at_ms(due_ms, 0));
    assert_eq!(
        missed,
        [true, false].map(|missed| WakeUpClass::Counted { missed_deadline: missed }),
        "it is reported once"
    );
    let mut robot_2 = control_cycle_with(set_lockstep);
    robot_2.run_cycle_at(0, Some(0), &[]);
    robot_2.record_sent_ms(99);
    assert_eq!(robot_2.status().0.deadline_misses, 0, "in lockstep there is no deadline");
}

#[test]
fn late_wake_ups_are_recorded_with_the_next_sample() {
    let mut robot_1 = control_cycle_with(|_| ());
    robot_1.run_cycle_at(0, Some(0), &[]);
    let wake = WakeUp { due_ns: START_NS, lateness_ns: 7 * NS_PER_MS };
    for count in 1..=STORED_WAKE_UPS_MAX {
        robot_1.run_cycle_at(1, None, &[]);
        assert_eq!(robot_1.measurements_ms(Stage::Wake).len(), 0, "{count}");
        robot_1.record_wake_up(&wake, 0);
    }
    robot_1.run_cycle_at(1, None, &[]);
    assert_eq!(
        robot_1.measurements_ms(Stage::Wake).len(),
        STORED_WAKE_UPS_MAX,
        "a plant in trouble"
    );
    robot_1.record_lateness(&wake, LatenessCause::Core);
    robot_1.run_cycle_at(10, Some(10), &[]);
    assert_eq!(robot_1.measurements_ms(Stage::LateCore), [(0, 7)]);
}

#[test]
fn late_cycle_with_all_beacons_has_the_most_measurements() {
    let mut robot = control_cycle_with(|brief| {
        brief.pace = Pace::Realtime;
        brief.neighbors.truncate(1);
    });
    let mut run_late_cycle = |at_ms| {
        robot.wake_up_at_ms(at_ms, 0);
        let wake = WakeUp { due_ns: START_NS + at_ms * NS_PER_MS, lateness_ns: NS_PER_MS };
        robot.record_lateness(&wake, LatenessCause::Core);
        robot.run_cycle_at(at_ms, Some(at_ms), &[at_ms - 2]);
        robot.record_sent(START_NS + at_ms * NS_PER_MS);
        robot.measurements.batch().1.len()
    };
    run_late_cycle(10);
    let second = run_late_cycle(20);
    assert_eq!(run_late_cycle(30) - second, robot_rows_per_tick(1));
}

#[test]
fn news_is_reported_at_once_and_status_every_100_ms() {
    for pace in [Pace::Realtime, Pace::Lockstep] {
        let mut robot = control_cycle_with(|brief| {
            brief.pace = pace;
            brief.neighbors.truncate(1);
            brief.index = FIRST_PHASE_INDEX;
        });
        let mut report =
            |at_ms, beacons: &[u64]| robot.run_cycle_at(at_ms, Some(at_ms), beacons).status_is_due;
        assert!(!report(0, &[]) && !report(99, &[]));
        assert!(report(100, &[98]), "r5 is received for the first time");
        assert!(!report(110, &[]));
        assert!(report(120, &[98]), "the same beacon again is refused");
        assert!(report(125, &[98, 98]), "two refused beacons are reported like one");
        assert!(!report(126, &[]));
        assert!(report(170, &[98]), "one beacon is refused, and r5 was silent");
        assert!(!report(190, &[]));
        assert!(report(201, &[]), "r5 is lost");
        assert!(!report(299, &[]));
        assert_eq!(report(300, &[]), pace == Pace::Realtime);
        assert!(!report(302, &[]));
        assert!(report(401, &[400]), "r5 is received again, and 100 ms have passed");
        assert_eq!(robot.status().0.beacons_refused, 4);
    }
}

#[test]
fn silent_plant_ends_the_agent_after_30_s_of_its_own_time() {
    let silent_until = |robot: &mut ControlCycle, step_ms: u64| {
        let mut at_ms = 1000;
        robot.run_cycle_at(at_ms, Some(at_ms), &[]);
        loop {
            at_ms += step_ms;
            if robot.run_cycle_at(at_ms, None, &[]).is_plant_silent {
                return at_ms - 1000;
            }
        }
    };
    let mut quick = control_cycle_with(|_| ());
    assert_eq!(silent_until(&mut quick, 100), 30_100);
    assert_eq!(silent_until(&mut quick, 100), 30_100, "a sample is a sign");
    // A gap of 10 s counts as 1 s.
    assert_eq!(silent_until(&mut quick, 10_000), 310_000);
    // With a period of 2 s, it counts as two periods.
    let mut slow = control_cycle_with(|brief| brief.period_ns = 2000 * NS_PER_MS);
    assert_eq!(silent_until(&mut slow, 10_000), 80_000);
}

#[test]
fn durations_are_recorded_and_sent_in_time() {
    for pace in [Pace::Realtime, Pace::Lockstep] {
        let is_realtime = pace == Pace::Realtime;
        let mut robot = control_cycle_with(|brief| {
            (brief.pace, brief.index) = (pace, FIRST_PHASE_INDEX);
        });
        robot.run_cycle_at(0, Some(0), &[]);
        robot.run_cycle_at(10, Some(10), &[0]);
        robot.record_sent_ms(13);
        assert_eq!(robot.measurements_ms(Stage::Compute), [(0, 3)]);
        // Age of the beacon of r5 when it was used.
        assert_eq!(robot.measurements_ms(Stage::BeaconAge), [(5, 10)]);
        // Sent 1 ms before it was received.
        let delivered = robot.measurements_ms(Stage::BeaconDelivery);
        assert_eq!(delivered, Vec::from_iter(is_realtime.then_some((5, 1))));
        assert_eq!(robot.measurements_ms(Stage::Odometry).len(), 2);
        assert!(!robot.batch_is_due() || is_realtime);
        let (header, rows) = robot.measurement_batch().batch();
        // The batch contains four age sums for each of two robots.
        assert_eq!((header.incarnation, rows.len()), (3, 2 + 2 + 8 + usize::from(is_realtime)));
        robot.measurement_batch().begin_next_batch(START_NS + 10 * NS_PER_MS);
        robot.run_cycle_at(99, Some(99), &[]);
        assert!(!robot.batch_is_due());
        robot.run_cycle_at(100, Some(100), &[]);
        assert_eq!(robot.batch_is_due(), is_realtime, "every tenth of a second");
        while !robot.measurements.is_half_full() {
            robot.run_cycle_at(120, Some(120), &[]);
            robot.record_sent_ms(120);
        }
        assert!(robot.batch_is_due());
    }
}

#[test]
fn link_faults_and_goals_reach_the_controller() {
    let mut robot = control_cycle_with(|brief| {
        brief.law = "goal-unit".into();
        brief.goal_m = Some([9.0, 0.0]);
    });
    robot.run_cycle_at(0, Some(0), &[]);
    let mut run_with = |cut, goal, at_ms| {
        let beacon = |sender_index| ReceivedBeacon {
            sender_index,
            broadcast: Broadcast::from(beacon(at_ms)),
            received_ns: 0,
        };
        let inbox = Inbox {
            received_ns: START_NS + at_ms * NS_PER_MS,
            odometry: Some(&odometry(at_ms)),
            participant_since_tick: 0,
            beacons: [0, 1].map(|sender_index| Ok::<_, Infallible>(beacon(sender_index))),
            // r7 is not an in-neighbor.
            link_faults: &[5, 7].map(|robot| LinkFaultByHand { robot, cut }),
            goal,
        };
        let Ok(_) = robot.run(inbox);
        let (header, neighbors) = robot.status();
        let is_fresh = neighbors.map(|neighbor| neighbor.contact == ReceptionState::Fresh as u64);
        (is_fresh.collect::<Vec<_>>(), header.goal().is_some())
    };
    let goal = Goal { stamp_ns: 7, x_m: -5.0, y_m: 2.0 };
    assert_eq!(run_with(1, None, 10), (vec![false, true], false));
    assert_eq!(run_with(0, Some(goal), 20), (vec![true, true], true));
}

#[test]
fn error_of_a_queue_ends_the_cycle() {
    let mut robot = control_cycle_with(|_| ());
    robot.run_cycle_at(0, Some(0), &[]);
    let sample = odometry(10);
    let inbox = Inbox {
        received_ns: START_NS,
        odometry: Some(&sample),
        participant_since_tick: 0,
        beacons: [Err::<ReceivedBeacon, _>("no beacon")],
        link_faults: &[],
        goal: None,
    };
    assert_eq!(robot.run(inbox).unwrap_err(), "no beacon");
}

/// A law that records its number of calls at each third sample.
struct SignalRecordingLaw(u64);

impl Law for SignalRecordingLaw {
    fn gamma(&mut self, _: &Situation<'_>) -> Vec2 {
        self.0 += 1;
        Vec2::zeros()
    }

    fn signals(&mut self) -> SignalValues {
        let mut values = SignalValues::NONE;
        if self.0 % 3 == 1 {
            values.set(0, self.0 as f64);
        }
        values
    }
}

#[test]
fn recorded_signals_are_reported_with_their_sample_only() {
    for declared in [true, false] {
        let goal = AgentBrief {
            law: "goal-unit".into(),
            goal_m: Some([9.0, 0.0]),
            signals: if declared { vec!["calls".into()] } else { Vec::new() },
            pace: Pace::Lockstep,
            ..brief()
        };
        let parts = Parts::with_law(&goal, Box::new(SignalRecordingLaw(0))).unwrap();
        let controller = Controller::with_parts(&goal, 0, parts);
        let mut robot = ControlCycle::new(controller, START_NS);
        for (call, tick) in [0, 10, 20, 30, 40].into_iter().enumerate() {
            let outbox = robot.run_cycle_at(tick, Some(tick), &[]);
            let found: Vec<(usize, f64)> = robot.status().0.signals().iter().collect();
            let records = declared && call % 3 == 0;
            assert_eq!(found, if records { vec![(0, call as f64 + 1.0)] } else { vec![] });
            assert_eq!(outbox.status_is_due, records, "{call}");
        }
    }
}

/// A law that sends a message at each even, and withholds its beacon at each odd sample.
struct AlternatingMessageLaw(u8);

impl Law for AlternatingMessageLaw {
    fn gamma(&mut self, _: &Situation<'_>) -> Vec2 {
        self.0 += 1;
        Vec2::zeros()
    }

    fn send_decision(&mut self) -> SendDecision {
        if self.0 % 2 == 1 {
            SendDecision::Message([self.0][..].into())
        } else {
            SendDecision::Withheld
        }
    }
}

#[test]
fn sent_and_withheld_beacons_are_counted_without_a_status() {
    let goal = AgentBrief {
        law: "goal-unit".into(),
        goal_m: Some([9.0, 0.0]),
        message: Some(MessageFormat::with_bytes(1)),
        withholds: true,
        counts_sent: true,
        pace: Pace::Lockstep,
        ..brief()
    };
    let parts = Parts::with_law(&goal, Box::new(AlternatingMessageLaw(0))).unwrap();
    let controller = Controller::with_parts(&goal, 0, parts);
    let mut robot = ControlCycle::new(controller, START_NS);
    let mut hash = 0;
    for (tick, beacons, messages) in [(0, 1, 1), (10, 1, 1), (20, 2, 2), (30, 2, 2)] {
        let outbox = robot.run_cycle_at(tick, Some(tick), &[]);
        let (header, _) = robot.status();
        assert!(!outbox.status_is_due || tick == 0);
        assert_eq!((header.beacons_sent, header.messages_sent), (beacons, messages));
        assert_eq!(outbox.answer.unwrap().is_withheld, tick % 20 != 0, "{tick}");
        assert_eq!(header.message_hash != hash, tick % 20 == 0, "{tick}");
        hash = header.message_hash;
    }
}

/// A law that records a signal, sends a message, or both, at each sample.
struct RecordedLaw {
    records_signal: bool,
    sends_message: bool,
}

impl Law for RecordedLaw {
    fn gamma(&mut self, _: &Situation<'_>) -> Vec2 {
        Vec2::zeros()
    }

    fn signals(&mut self) -> SignalValues {
        let mut values = SignalValues::NONE;
        if self.records_signal {
            values.set(0, 1.0);
        }
        values
    }

    fn send_decision(&mut self) -> SendDecision {
        match self.sends_message {
            true => SendDecision::Message([7][..].into()),
            false => SendDecision::Beacon,
        }
    }
}

#[test]
fn status_is_due_for_each_reason_and_for_several() {
    for (records_signal, sends_message) in [(true, false), (false, true), (true, true)] {
        let goal = AgentBrief {
            law: "goal-unit".into(),
            goal_m: Some([9.0, 0.0]),
            signals: vec!["one".into()],
            message: Some(MessageFormat::with_bytes(1)),
            records_messages: true,
            pace: Pace::Realtime,
            ..brief()
        };
        let law = RecordedLaw { records_signal, sends_message };
        let parts = Parts::with_law(&goal, Box::new(law)).unwrap();
        let controller = Controller::with_parts(&goal, 0, parts);
        let mut robot = ControlCycle::new(controller, START_NS);
        // At 110 ms it is due by the time as well.
        for at_ms in [10, 110, 120] {
            let outbox = robot.run_cycle_at(at_ms, Some(at_ms), &[]);
            assert!(outbox.status_is_due, "{records_signal} {sends_message} {at_ms}");
            assert_eq!(outbox.recorded_message, if sends_message { &[7][..] } else { &[] });
        }
    }
}

#[test]
fn caller_replaces_send_decision_and_target_of_the_law() {
    let free = AgentBrief { withholds: true, pace: Pace::Lockstep, ..brief() };
    let parts = Parts {
        role: roles::find_row("free").unwrap().make(&free).unwrap(),
        ..Parts::with_law(
            &free,
            Box::new(RecordedLaw { records_signal: false, sends_message: false }),
        )
        .unwrap()
    };
    let controller = Controller::with_parts(&free, 0, parts);
    let mut robot = ControlCycle::new(controller, START_NS);
    let mut run_cycle = |tick: u64, decision: SendDecision, target: Option<Target>| {
        let sample = odometry(tick);
        let inbox = Inbox {
            received_ns: START_NS,
            odometry: Some(&sample),
            participant_since_tick: 0,
            beacons: std::iter::empty::<Result<ReceivedBeacon, Infallible>>(),
            link_faults: &[],
            goal: None,
        };
        let Ok(()) = robot.sense(inbox);
        let output = robot.law_output();
        robot.set_send_decision(decision);
        robot.set_own_target(target);
        let mut outbox = Outbox::default();
        robot.act(output, &mut outbox);
        (!outbox.answer.unwrap().is_withheld, robot.status().0.target_known)
    };
    let target = Some(Target::at_rest(Vec2::new(1.0, 2.0)));
    assert_eq!(run_cycle(0, SendDecision::Withheld, target), (false, 1));
    assert_eq!(run_cycle(10, SendDecision::Beacon, None), (true, 0));
}
