//! Waiting and sending around a robot's control cycle ([`crate::control_cycle`]): one loop for each time mode.
//!
//! The loops need the plant, but no command needs the supervisor. In lockstep, where a tick takes as long as
//! the slowest robot, an agent waits for as long as the supervisor is working, because the supervisor detects
//! hung processes.

mod ports;

use std::path::Path;
use std::time::Duration;

use protocol::barrier::Barrier;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::clock::{self, Timer};
use protocol::lateness::LatenessDiagnosis;
use protocol::message::Odometry;
use protocol::process::{self, Alarm, Failure, StopFlag, ThawListener, TimeSlice};
use protocol::run_root;
use protocol::service::Sample;
use protocol::wake::golden_phase_ns;
use protocol::watchdog::SupervisorWatch;

use crate::control_cycle::{ControlCycle, Inbox, Outbox, ReceivedBeacon, WakeUpClass};
use crate::controller::{Controller, Parts};
use ports::Ports;

/// Polling interval for the stop request while the robot is slow because of a fault.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Runs the robot of this brief until a stop is requested. `parts` creates the components of the controller from
/// the brief: [`Parts::from_brief`], or a program's own law, role or method.
pub fn run<E>(
    brief_path: &Path,
    incarnation: u64,
    parts: impl FnOnce(&AgentBrief) -> Result<Parts, E>,
) -> Result<(), Failure>
where
    E: Into<Failure>,
{
    let brief: AgentBrief = brief::read(brief_path)?;
    let parts = parts(&brief).map_err(Into::into)?;
    let controller = Controller::with_parts(&brief, incarnation, parts);
    run_controller(brief, controller, incarnation)
}

/// Runs a robot with this controller until a stop is requested.
fn run_controller(
    brief: AgentBrief,
    controller: Controller,
    incarnation: u64,
) -> Result<(), Failure> {
    let stop = StopFlag::for_termination_signals()
        .map_err(|error| format!("cannot handle signals: {error}"))?;
    run_root::join_as_process(&brief.run_root, &brief.name)?;
    clock::tighten_timer_slack();
    if brief.pace == Pace::Realtime {
        process::request_time_slice(TimeSlice::Short);
    }
    // Opened before the ports, whose presence permits the plant to start.
    let barrier = match brief.pace {
        Pace::Lockstep => {
            let mut barrier = Barrier::open(&run_root::barrier_path(&brief.run_root))?;
            barrier.set_alarm(Alarm::start()?);
            Some(barrier)
        }
        Pace::Realtime => None,
    };
    let epoch = barrier.as_ref().map_or(0, |barrier| barrier.epoch(brief.index - 1));
    let robot = brief.name.clone();
    let cycle = ControlCycle::new(controller, clock::now_ns());
    let ports = Ports::open(cycle.brief(), cycle.measurements())?;
    tracing::info!(robot, incarnation, law = cycle.brief().law, "ready");
    let mut agent = Agent { cycle, ports, stop };
    let result = match barrier {
        Some(barrier) => agent.run_in_lockstep(&barrier, epoch),
        None => agent.run_in_real_time(),
    };
    agent.send_measurements();
    result
}

struct Agent {
    cycle: ControlCycle,
    ports: Ports,
    stop: StopFlag,
}

impl Agent {
    fn run_in_lockstep(&mut self, barrier: &Barrier, mut epoch: u32) -> Result<(), Failure> {
        let slot = self.cycle.brief().index - 1;
        let mut supervisor = SupervisorWatch::new(barrier);
        let mut outbox = Outbox::default();
        self.send_status(&[])?;
        barrier.count_report();
        while !self.stop.is_requested() {
            let keep_waiting = supervisor.waiting_condition(barrier, &self.stop);
            let Some((new_epoch, tick)) = barrier.wait_for_tick(slot, epoch, keep_waiting) else {
                break;
            };
            epoch = new_epoch;
            supervisor.record_progress();
            // After a freeze the first tick seen is one that passed without this robot.
            let since = barrier.first_member_tick(slot).filter(|&since| since <= tick);
            let Some(participant_since_tick) = since else { continue };
            let odometry = receive_odometry_of_tick(&self.ports, tick)?;
            let ports = &self.ports;
            let beacon =
                |sender_index| receive_beacon_of_previous_tick(ports, barrier, sender_index, tick);
            self.cycle.sense(Inbox {
                received_ns: clock::now_ns(),
                odometry: Some(&odometry),
                participant_since_tick,
                beacons: (0..ports.sender_count()).filter_map(beacon),
                link_faults: &[],
                goal: None,
            })?;
            drop(odometry);
            self.cycle.answer(&mut outbox);
            if let Some(answer) = &mut outbox.answer {
                let sent_ns = clock::now_ns();
                self.ports.send_answer(answer, sent_ns)?;
                self.cycle.record_sent(sent_ns);
            }
            // Before the barrier: beacons that a newly opened spare sends at the next tick are then in the
            // queue.
            self.ports.update_spare_ports(self.cycle.controller().neighborhood())?;
            // Before the barrier, and triggered by events only: a robot that is killed after this tick has sent
            // the same reports in every run.
            if outbox.status_is_due {
                self.send_status(&outbox.recorded_message)?;
                barrier.count_report();
            }
            if self.cycle.batch_is_due() {
                self.send_measurements();
            }
            // Not with the status, which would be one more message at each tick.
            if self.cycle.brief().counts_sent {
                barrier.store_sent_counts(slot, &self.cycle.sent_counts());
            }
            match &outbox.answer {
                Some(answer) if answer.is_withheld => barrier.arrive_without_beacon(slot, tick),
                Some(_) => barrier.arrive(slot, tick),
                None => barrier.arrive_without_messages(slot, tick),
            }
        }
        supervisor.loss_reason().map_or(Ok(()), |reason| Err(reason.into()))
    }

    fn run_in_real_time(&mut self) -> Result<(), Failure> {
        let &AgentBrief { period_ns, index, .. } = self.cycle.brief();
        let mut timer = Timer::new(period_ns, golden_phase_ns(index, period_ns));
        let thaw_listener = ThawListener::start()?;
        let mut diagnosis = LatenessDiagnosis::new(period_ns);
        let mut outbox = Outbox::default();
        self.send_status(&[])?;
        while !self.stop.is_requested() {
            let Some(wake) = timer.wait() else {
                diagnosis.record_computation_end(clock::now_ns());
                continue;
            };
            match self.cycle.record_wake_up(&wake, thaw_listener.last_thaw_ns()) {
                WakeUpClass::Starting => self.ports.connect()?,
                WakeUpClass::DelayedByFault => diagnosis.skip_wake_up(&wake),
                WakeUpClass::Counted { missed_deadline } => {
                    if let Some(cause) = diagnosis.cause_if_late(&wake, missed_deadline) {
                        self.cycle.record_lateness(&wake, cause);
                    }
                }
            }
            diagnosis.record_computation_end(self.run_cycle_in_real_time(&mut outbox)?);
        }
        Ok(())
    }

    /// Runs one control cycle. Returns the time at which it ended, ns. The clock is read again only after steps
    /// that may take long.
    fn run_cycle_in_real_time(&mut self, outbox: &mut Outbox) -> Result<u64, Failure> {
        // In real time a queue holds only the newest sample.
        let odometry = self.ports.receive_odometry()?;
        let link_faults = self.ports.receive_link_faults()?;
        let received_ns = clock::now_ns();
        self.cycle.sense(Inbox {
            received_ns,
            odometry: odometry.as_deref(),
            participant_since_tick: 0,
            beacons: self.ports.receive_newest_beacons(),
            link_faults: link_faults.as_ref().map_or(&[], |sample| sample.payload()),
            goal: self.ports.receive_goal()?,
        })?;
        drop(odometry);
        self.cycle.answer(outbox);
        let mut end_ns = received_ns;
        if let Some(answer) = &mut outbox.answer {
            self.sleep_until_stop(answer.delay_ns);
            end_ns = clock::now_ns();
            self.ports.send_answer(answer, end_ns)?;
            self.cycle.record_sent(end_ns);
        }
        self.ports.update_spare_ports(self.cycle.controller().neighborhood())?;
        if outbox.is_plant_silent {
            let silence_max_s = self.cycle.silence_max_ns() / 1_000_000_000;
            return Err(format!("no sign of the plant for {silence_max_s} s").into());
        }
        let batch_is_due = self.cycle.batch_is_due();
        if outbox.status_is_due {
            self.send_status(&outbox.recorded_message)?;
        }
        if batch_is_due {
            self.send_measurements();
        }
        let reported = outbox.status_is_due || batch_is_due;
        Ok(if reported { clock::now_ns() } else { end_ns })
    }

    /// Sleeps for `ns`, or until the end of the run.
    fn sleep_until_stop(&self, ns: u64) {
        let end_ns = clock::now_ns().saturating_add(ns);
        while !self.stop.is_requested() {
            let left_ns = end_ns.saturating_sub(clock::now_ns());
            if left_ns == 0 {
                return;
            }
            std::thread::sleep(Duration::from_nanos(left_ns).min(STOP_POLL_INTERVAL));
        }
    }

    /// Sends the status to the supervisor, with the recorded message of the control law; empty if there is none.
    fn send_status(&self, message: &[u8]) -> Result<(), Failure> {
        let (header, neighbors) = self.cycle.status();
        self.ports.send_status(header, neighbors, message)
    }

    fn send_measurements(&mut self) {
        self.ports.latency.send(self.cycle.measurement_batch(), clock::now_ns());
    }
}

/// Returns the odometry of exactly this tick. Older samples are from before the robot took part, and are
/// dropped.
fn receive_odometry_of_tick(ports: &Ports, tick: u64) -> Result<Sample<Odometry>, Failure> {
    while let Some(odometry) = ports.receive_odometry()? {
        if odometry.tick == tick {
            return Ok(odometry);
        }
    }
    Err(missing_sample_failure(tick, "odometry"))
}

/// Returns the beacon that the sender `sender_index` sent at the previous tick, or `None` if it is not
/// expected, did not take part, or sent none. A beacon of the current tick stays in the queue.
fn receive_beacon_of_previous_tick(
    ports: &Ports,
    barrier: &Barrier,
    sender_index: usize,
    tick: u64,
) -> Option<Result<ReceivedBeacon, Failure>> {
    let previous_tick = tick - 1;
    let (name, slot) = ports.sender_name_and_slot(sender_index);
    let takes_part = || barrier.first_member_tick(slot).is_some_and(|since| since <= previous_tick);
    if !ports.has_beacon_of_tick(sender_index, previous_tick)
        || !takes_part()
        || barrier.has_no_beacon(slot, previous_tick)
    {
        return None;
    }
    loop {
        let sample = match ports.receive_beacon(sender_index) {
            Ok(sample) => sample,
            Err(failure) => return Some(Err(failure)),
        };
        match sample {
            Some(sample) if sample.user_header().tick < previous_tick => {}
            // Lockstep does not use the time of reception.
            Some(sample) if sample.user_header().tick == previous_tick => {
                return Some(Ok(ports::copy_beacon(sender_index, &sample, 0)));
            }
            // The sender was killed in this very tick, not by a plan.
            None if !takes_part() => return None,
            _ => {
                let what = format!("beacon of {name} from tick {previous_tick}");
                return Some(Err(missing_sample_failure(tick, &what)));
            }
        }
    }
}

/// Returns the error for a sample that lockstep guarantees but that is missing.
fn missing_sample_failure(tick: u64, what: &str) -> Failure {
    format!("lockstep is broken: at tick {tick} there is no {what}").into()
}

/// Runs the process `phalanx-agent` with its name, log and exit code.
pub fn main(brief_path: &Path, incarnation: u64, realtime_priority: bool) -> u8 {
    main_with_parts(brief_path, incarnation, realtime_priority, Parts::from_brief)
}

/// Runs the process like [`main`], for a program with a law, a role or an avoidance method of its own. See
/// [`run`].
pub fn main_with_parts<E: Into<Failure>>(
    brief_path: &Path,
    incarnation: u64,
    realtime_priority: bool,
    parts: impl FnOnce(&AgentBrief) -> Result<Parts, E>,
) -> u8 {
    process::main("phalanx-agent", realtime_priority, || run(brief_path, incarnation, parts))
}
