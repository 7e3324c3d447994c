//! Waiting and sending around the plant's simulation step ([`crate::simulation_step`]): one loop for each time mode.
//!
//! In lockstep the plant leads the barrier, and waits for robots and supervisor as long as the supervisor is
//! working, because the supervisor detects hung processes. In real time it waits only for the clock.

mod ports;

use std::path::Path;
use std::time::{Duration, Instant};

use protocol::barrier::{Barrier, LEAD_TICKS_MAX};
use protocol::brief::{self, Pace, PlantBrief};
use protocol::clock::{self, Timer};
use protocol::lateness::LatenessDiagnosis;
use protocol::process::{self, Alarm, Failure, StopFlag, TimeSlice};
use protocol::run_root;
use protocol::watchdog::SupervisorWatch;

use crate::motion::{CheckedMotion, Motion, UnicycleMotion};
use crate::simulation_step::{ReceivedCommand, SimulationStepper};
use ports::Ports;

/// Maximum time until all robots are ready in real time. The supervisor has a shorter limit (`ready_after_s`) and
/// names the robots that are not ready.
const READY_WAIT_MAX: Duration = Duration::from_secs(3600);
/// Polling interval of the readiness.
const READY_POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Minimum time between readiness and t = 0 in real time, in which robots connect to each other. At least two
/// periods.
const CONNECTION_TIME_MIN: Duration = Duration::from_millis(20);
/// Maximum time that the last ground truth of a real-time run waits for the supervisor's end signal.
const END_SIGNAL_WAIT_MAX: Duration = Duration::from_secs(10);
/// Number of robots reported in ground-truth samples per wake-up of the supervisor, and bounds on the interval
/// between wake-ups, in ticks. With rare wake-ups the supervisor works for long while robots on its core wait.
/// With frequent ones the wake-ups cost more.
const ROBOT_ROWS_PER_SUPERVISOR_WAKE_UP: u64 = 96;
const SUPERVISOR_WAKE_UP_TICKS_RANGE: [u64; 2] = [4, 16];

/// Runs the plant of this brief to its end. `motion` creates the motion of the robots from the brief:
/// [`UnicycleMotion`], or a program's own physics.
pub fn run<M: Motion, E>(
    brief_path: &Path,
    motion: impl FnOnce(&PlantBrief) -> Result<M, E>,
) -> Result<(), Failure>
where
    E: Into<Failure>,
{
    let brief: PlantBrief = brief::read(brief_path)?;
    let stop = StopFlag::for_termination_signals()
        .map_err(|error| format!("cannot handle signals: {error}"))?;
    run_root::join_as_process(&brief.run_root, "plant")?;
    let motion = motion(&brief).map_err(Into::into)?;
    let motion = CheckedMotion::new(&brief, motion);
    clock::tighten_timer_slack();
    if brief.pace == Pace::Realtime {
        process::request_time_slice(TimeSlice::Medium);
    }
    let mut stepper = SimulationStepper::new(&brief, motion);
    let ports = Ports::open(&brief, stepper.measurements_mut())?;
    let mut plant = Plant { stepper, brief, ports, stop };
    let result = match plant.brief.pace {
        Pace::Lockstep => plant.run_in_lockstep(),
        Pace::Realtime => plant.run_in_real_time(),
    };
    plant.ports.latency.send(plant.stepper.measurements_mut(), clock::now_ns());
    result
}

struct Plant<M> {
    brief: PlantBrief,
    stepper: SimulationStepper<M>,
    ports: Ports,
    stop: StopFlag,
}

impl<M: Motion> Plant<M> {
    /// Waits until all robots are ready. Returns `false` if `keep_waiting` ends first.
    fn wait_until_ready(&self, mut keep_waiting: impl FnMut() -> bool) -> bool {
        while self.ports.robots_not_ready().next().is_some() {
            if !keep_waiting() {
                return false;
            }
            std::thread::sleep(READY_POLL_INTERVAL);
        }
        tracing::info!(robots = self.brief.robots.len(), "all ready, t = 0");
        true
    }

    fn run_in_lockstep(&mut self) -> Result<(), Failure> {
        let mut barrier = Barrier::open(&run_root::barrier_path(&self.brief.run_root))?;
        barrier.set_alarm(Alarm::start()?);
        let mut supervisor = SupervisorWatch::new(&barrier);
        if self.wait_until_ready(supervisor.waiting_condition(&barrier, &self.stop)) {
            self.run_ticks(&barrier, &mut supervisor)?;
        }
        supervisor.loss_reason().map_or(Ok(()), |reason| Err(reason.into()))
    }

    /// Runs ticks until the end. Ends early on a stop request, or if the supervisor is gone.
    fn run_ticks(
        &mut self,
        barrier: &Barrier,
        supervisor: &mut SupervisorWatch,
    ) -> Result<(), Failure> {
        let [min_ticks, max_ticks] = SUPERVISOR_WAKE_UP_TICKS_RANGE;
        let attention_interval = (ROBOT_ROWS_PER_SUPERVISOR_WAKE_UP
            / self.brief.robots.len() as u64)
            .clamp(min_ticks, max_ticks);
        while !self.stepper.is_over() {
            let tick = self.stepper.world().tick();
            self.ports.send_truth(self.stepper.world())?;
            if tick.is_multiple_of(attention_interval) {
                barrier.request_attention();
            }
            let mut keep_waiting = supervisor.waiting_condition(barrier, &self.stop);
            let continues = !self.stop.is_requested()
                && (!barrier.is_pause_due(tick) || barrier.pause(tick, &mut keep_waiting))
                && barrier.wait_for_lead_limit(tick, LEAD_TICKS_MAX, &mut keep_waiting);
            drop(keep_waiting);
            if !continues || self.stop.is_requested() {
                return Ok(());
            }
            barrier.begin_tick(tick);
            for group in 0..barrier.groups() {
                barrier.group_members(group).try_for_each(|robot| self.send_odometry(robot))?;
                barrier.release_group(group);
            }
            if barrier
                .wait_for_arrivals(tick, supervisor.waiting_condition(barrier, &self.stop))
                .is_err()
            {
                return Ok(());
            }
            let Plant { stepper, ports, stop, brief } = &mut *self;
            let command = |robot| {
                receive_command_of_robot(ports, barrier, stop, robot, tick, brief).transpose()
            };
            stepper.step(barrier.members().filter_map(command), clock::now_ns)?;
            ports.latency.send_if_due(stepper.measurements_mut(), clock::now_ns());
        }
        self.ports.send_truth(self.stepper.world())?;
        barrier.request_attention();
        wait_for_end_signal(supervisor.waiting_condition(barrier, &self.stop));
        Ok(())
    }

    fn run_in_real_time(&mut self) -> Result<(), Failure> {
        let start = Instant::now();
        if !self.wait_until_ready(|| !self.stop.is_requested() && start.elapsed() < READY_WAIT_MAX)
        {
            if self.stop.is_requested() {
                return Ok(());
            }
            let names =
                self.ports.robots_not_ready().map(|robot| self.brief.robots[robot].name.as_str());
            let names = names.collect::<Vec<_>>().join(", ");
            return Err(format!("not ready after {} s: {names}", READY_WAIT_MAX.as_secs()).into());
        }
        // Otherwise all connections would be made in the first period, and every robot would be late.
        self.ports.connect()?;
        std::thread::sleep(CONNECTION_TIME_MIN.max(2 * Duration::from_nanos(self.brief.period_ns)));
        let tick_ns = self.brief.plant_tick_ns;
        let start_ns = clock::now_ns();
        let mut timer = Timer::new(tick_ns, start_ns % tick_ns);
        self.stepper.start_at(start_ns);
        self.publish()?;
        let mut diagnosis = LatenessDiagnosis::new(tick_ns);
        while !self.stop.is_requested() && !self.stepper.is_over() {
            let Some(wake) = timer.wait() else { continue };
            self.stepper.record_wake_up(&wake, diagnosis.cause_if_late(&wake, false));
            self.stepper.step(self.ports.receive_commands(), clock::now_ns)?;
            self.publish()?;
            let now_ns = clock::now_ns();
            self.ports.latency.send_if_due(self.stepper.measurements_mut(), now_ns);
            diagnosis.record_computation_end(now_ns);
        }
        let start = Instant::now();
        wait_for_end_signal(|| !self.stop.is_requested() && start.elapsed() < END_SIGNAL_WAIT_MAX);
        Ok(())
    }

    /// Sends odometry to all robots, unless the run is over, and the ground truth to the supervisor.
    fn publish(&mut self) -> Result<(), Failure> {
        if !self.stepper.is_over() {
            (0..self.brief.robots.len()).try_for_each(|robot| self.send_odometry(robot))?;
        }
        self.ports.send_truth(self.stepper.world())
    }

    fn send_odometry(&mut self, robot: usize) -> Result<(), Failure> {
        let Plant { stepper, ports, .. } = self;
        ports.send_odometry(robot, |sample| stepper.sense(robot, clock::now_ns(), sample))
    }
}

/// Returns the command of `robot`, a participant in this tick, or `None` if it was mute.
fn receive_command_of_robot(
    ports: &Ports,
    barrier: &Barrier,
    stop: &StopFlag,
    robot: usize,
    tick: u64,
    brief: &PlantBrief,
) -> Result<Option<ReceivedCommand>, Failure> {
    loop {
        match ports.receive_command(robot)? {
            Some(received) if received.command.tick < tick => {}
            Some(received) => return Ok(Some(received)),
            // The robot was killed in this very tick, not by a plan.
            None if stop.is_requested() => return Ok(None),
            None if barrier.first_member_tick(robot).is_none() => return Ok(None),
            None if barrier.has_sent_nothing(robot, tick) => return Ok(None),
            None => {
                let robot = &brief.robots[robot].name;
                let reason = format!("{robot} arrived at tick {tick} without a command");
                return Err(format!("lockstep is broken: {reason}").into());
            }
        }
    }
}

/// Keeps the last ground truth available until the supervisor has received it and requests the stop.
fn wait_for_end_signal(mut keep_waiting: impl FnMut() -> bool) {
    while keep_waiting() {
        std::thread::sleep(READY_POLL_INTERVAL);
    }
}

/// Runs the process `phalanx-plant` with its name, log and exit code.
pub fn main(brief_path: &Path, realtime_priority: bool) -> u8 {
    main_with_motion(brief_path, realtime_priority, |brief| {
        Ok::<_, Failure>(UnicycleMotion::new(brief))
    })
}

/// Runs the process like [`main`], for a program that moves the robots itself. See [`run`].
pub fn main_with_motion<M: Motion, E: Into<Failure>>(
    brief_path: &Path,
    realtime_priority: bool,
    motion: impl FnOnce(&PlantBrief) -> Result<M, E>,
) -> u8 {
    process::main("phalanx-plant", realtime_priority, || run(brief_path, motion))
}
