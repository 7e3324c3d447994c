//! One simulation step of the plant: commands and time in, sensor samples out. It does no I/O and reads only
//! the clock that it is given.
//!
//! The process of the plant waits and sends around it (`world_loop`). In-process runs and the adversarial tests
//! call the same code.
//!
//! Decided here: the order of time and commands in each time mode, the time to advance to, whether the motion
//! keeps up with real time, which commands were lost in transit, and when the run is over.

use protocol::brief::{Pace, PlantBrief};
use protocol::latency::LatencyRecorder;
use protocol::message::{Command, Odometry};
use protocol::stage::{LatenessCause, Stage};
use protocol::wake::WakeUp;

use crate::motion::{Motion, MotionFailure, UnicycleMotion};
use crate::overrun::{OverrunDetector, PlantTooSlow};
use crate::world::World;

/// State of the plant between two simulation steps.
pub struct SimulationStepper<M = UnicycleMotion> {
    world: World<M>,
    pace: Pace,
    period_ns: u64,
    plant_tick_ns: u64,
    duration_ns: u64,
    /// Stamp of t = 0, ns.
    start_ns: u64,
    command_senders: Vec<CommandSender>,
    overrun: OverrunDetector,
    measurements: LatencyRecorder,
}

struct CommandSender {
    name: String,
    /// Time at which the robot's newest odometry was sent, ns.
    odometry_sent_ns: u64,
    /// Incarnation and sequence number of the newest command received from it.
    newest_command_key: (u64, u64),
}

impl CommandSender {
    /// Returns the number of commands lost between the newest command and this one. An incarnation numbers its
    /// commands from 1.
    fn commands_lost_before(&mut self, command: &Command) -> u64 {
        let Command { incarnation, sequence, .. } = *command;
        let newest_sequence =
            if incarnation == self.newest_command_key.0 { self.newest_command_key.1 } else { 0 };
        if incarnation < self.newest_command_key.0 || sequence <= newest_sequence {
            return 0;
        }
        self.newest_command_key = (incarnation, sequence);
        sequence - newest_sequence - 1
    }
}

/// A received command.
#[derive(Debug, Clone, Copy)]
pub struct ReceivedCommand {
    /// Index of the sender in the scenario, from 0.
    pub robot: usize,
    /// The received command.
    pub command: Command,
    /// Time of reception by the machine's clock, ns.
    pub received_ns: u64,
    /// `true` if the command is from a dead incarnation; it is refused.
    pub is_from_dead_incarnation: bool,
}

/// Reason why a simulation step failed.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// The motion failed.
    #[error(transparent)]
    Motion(MotionFailure),
    /// The motion is slower than real time.
    #[error(transparent)]
    PlantTooSlow(#[from] PlantTooSlow),
}

impl<M: Motion> SimulationStepper<M> {
    /// Creates the state at t = 0, with all robots at their start poses, moved by `motion`.
    pub fn new(brief: &PlantBrief, motion: M) -> SimulationStepper<M> {
        let robot = |name: &String| CommandSender {
            name: name.clone(),
            odometry_sent_ns: 0,
            newest_command_key: (0, 0),
        };
        SimulationStepper {
            world: World::with_motion(motion, brief),
            pace: brief.pace,
            period_ns: brief.period_ns,
            plant_tick_ns: brief.plant_tick_ns,
            duration_ns: brief.duration_ns,
            start_ns: 0,
            command_senders: brief.robots.iter().map(|body| robot(&body.name)).collect(),
            overrun: OverrunDetector::default(),
            measurements: LatencyRecorder::for_process(0, 0, 1 + brief.robots.len()),
        }
    }

    /// Sets the stamp of t = 0 (real time only). In lockstep stamps are simulated times.
    pub fn start_at(&mut self, stamp_ns: u64) {
        self.start_ns = stamp_ns;
        self.world.start_at(stamp_ns);
    }

    /// Returns the state of all robots.
    pub fn world(&self) -> &World<M> {
        &self.world
    }

    /// Returns `true` once the duration of the run has passed. Robots do not act on a sample of that time.
    pub fn is_over(&self) -> bool {
        match self.pace {
            Pace::Lockstep => self.world.tick() >= self.duration_ns / self.period_ns,
            Pace::Realtime => self.world.t_ns() >= self.duration_ns,
        }
    }

    /// Records a wake-up (real time only), and the cause if it was late.
    pub fn record_wake_up(&mut self, wake: &WakeUp, cause: Option<LatenessCause>) {
        let stages = [Some(Stage::Wake), cause.map(LatenessCause::stage)].into_iter().flatten();
        stages.for_each(|stage| self.measurements.record(stage, 0, wake.lateness_ns));
    }

    /// Runs one simulation step. In lockstep, where time stops until all robots have answered, commands are
    /// accepted first and then one period passes. In real time, the state first advances to `clock_ns`, and
    /// then commands are accepted.
    pub fn step<E: From<StepError>>(
        &mut self,
        commands: impl IntoIterator<Item = Result<ReceivedCommand, E>>,
        clock_ns: impl Fn() -> u64,
    ) -> Result<(), E> {
        match self.pace {
            Pace::Lockstep => {
                self.accept_commands(commands)?;
                self.advance((self.world.tick() + 1) * self.period_ns)?;
                self.world.increment_tick();
            }
            Pace::Realtime => {
                self.catch_up(clock_ns)?;
                self.world.increment_tick();
                self.accept_commands(commands)?;
            }
        }
        Ok(())
    }

    /// Writes the odometry of `robot`, sent at `sent_ns` by the machine's clock, into `sample`; see [`World::sense`].
    pub fn sense(&mut self, robot: usize, sent_ns: u64, sample: &mut Odometry) {
        self.command_senders[robot].odometry_sent_ns = sent_ns;
        self.world.sense(robot, sample);
        sample.sent_ns = sent_ns;
    }

    /// Returns the measurements not sent yet.
    pub fn measurements_mut(&mut self) -> &mut LatencyRecorder {
        &mut self.measurements
    }

    /// Accepts the delayed commands that are due, and the received ones.
    fn accept_commands<E>(
        &mut self,
        commands: impl IntoIterator<Item = Result<ReceivedCommand, E>>,
    ) -> Result<(), E> {
        self.world.accept_due_commands();
        for received in commands {
            let ReceivedCommand { robot: index, command, received_ns, is_from_dead_incarnation } =
                received?;
            if is_from_dead_incarnation {
                self.world.count_command_of_dead_incarnation();
                continue;
            }
            let sender = &mut self.command_senders[index];
            let from_ns = match self.pace {
                // Stamps are simulated, so the time of sending counts.
                Pace::Lockstep => sender.odometry_sent_ns,
                Pace::Realtime => {
                    self.measurements.count_lost_samples(sender.commands_lost_before(&command));
                    command.stamp_ns
                }
            };
            self.measurements.record(
                Stage::Command,
                index + 1,
                received_ns.saturating_sub(from_ns),
            );
            // A refusal is counted. In real time one command may overtake another.
            if let Err(refusal) = self.world.receive_command(index, &command) {
                tracing::debug!(robot = sender.name, %refusal, "command refused");
            }
        }
        Ok(())
    }

    /// Advances to the current time in plant ticks. Returns an error if that takes longer than real time.
    fn catch_up(&mut self, clock_ns: impl Fn() -> u64) -> Result<(), StepError> {
        let (catch_up_start_ns, from_ns) = (clock_ns(), self.world.t_ns());
        let t_ns = (catch_up_start_ns - self.start_ns).min(self.duration_ns);
        let took_ns = || clock_ns().saturating_sub(catch_up_start_ns);
        while self.world.t_ns() < t_ns {
            self.advance(t_ns.min(self.world.t_ns() + self.plant_tick_ns))?;
            self.overrun.check(self.world.t_ns() - from_ns, took_ns())?;
        }
        self.overrun.record_catch_up(t_ns - from_ns, took_ns());
        Ok(())
    }

    fn advance(&mut self, t_ns: u64) -> Result<(), StepError> {
        self.world.try_advance(t_ns).map_err(|error| StepError::Motion(error.into()))
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use protocol::fault::{LinkFault, LinkFaultKind, Span};
    use protocol::message::LatencyRow;

    use super::*;
    use crate::testing::{NS_PER_MS, brief, command};

    fn stepper_with_pace(pace: Pace) -> SimulationStepper {
        let brief = PlantBrief { pace, duration_ns: 30 * NS_PER_MS, ..brief(&[0.0, 2.0]) };
        SimulationStepper::new(&brief, UnicycleMotion::new(&brief))
    }

    /// Runs a step at `now_ms` by the machine's clock, with commands of robot 0 received then: stamp, ms,
    /// sequence number and speed.
    fn run_step(stepper: &mut SimulationStepper, now_ms: u64, commands: &[(u64, u64, f64)]) {
        let commands = commands.iter().map(|&(stamp_ms, sequence, v_m_s)| {
            let command = command(stamp_ms * NS_PER_MS, sequence, v_m_s, 0.0);
            Ok::<_, StepError>(ReceivedCommand {
                robot: 0,
                command,
                received_ns: now_ms * NS_PER_MS,
                is_from_dead_incarnation: false,
            })
        });
        stepper.step(commands, || now_ms * NS_PER_MS).unwrap();
    }

    fn robot_x_m(stepper: &SimulationStepper) -> f64 {
        stepper.world.truth().next().unwrap().x_m
    }

    fn measurements_ms(stepper: &SimulationStepper, stage: Stage) -> Vec<(u32, u64)> {
        let rows = stepper.measurements.batch().1.iter().filter(|row| row.stage == stage as u32);
        rows.map(|LatencyRow { from, value_ns, .. }| (*from, value_ns / NS_PER_MS)).collect()
    }

    #[test]
    fn lockstep_period_passes_under_its_commands() {
        let mut stepper = stepper_with_pace(Pace::Lockstep);
        let mut sample = Odometry::default();
        stepper.sense(0, 1000 * NS_PER_MS, &mut sample);
        assert_eq!((sample.tick, sample.sent_ns), (0, 1000 * NS_PER_MS));
        run_step(&mut stepper, 1007, &[(0, 1, 0.4)]);
        assert!((robot_x_m(&stepper) - 0.004).abs() < 1e-15, "{}", robot_x_m(&stepper));
        assert_eq!((stepper.world.tick(), stepper.world.t_ns()), (1, 10 * NS_PER_MS));
        // The latency counts from the sending, because stamps are simulated. A skipped number is not a loss.
        run_step(&mut stepper, 1011, &[(10, 9, 0.0)]);
        assert_eq!(measurements_ms(&stepper, Stage::Command), [(1, 7), (1, 11)]);
        assert_eq!(stepper.measurements.batch().0.samples_lost, 0);
        assert!(!stepper.is_over());
        run_step(&mut stepper, 1020, &[]);
        assert!(stepper.is_over());
    }

    #[test]
    fn command_of_a_dead_incarnation_is_counted_and_moves_nothing() {
        let mut stepper = stepper_with_pace(Pace::Lockstep);
        for count in 1..=2 {
            let command = ReceivedCommand {
                robot: 0,
                command: command(0, count, 0.4, 0.0),
                received_ns: 0,
                is_from_dead_incarnation: true,
            };
            stepper.step([Ok::<_, StepError>(command)], || 0).unwrap();
            assert_eq!(
                (stepper.world.truth_header().commands_old, robot_x_m(&stepper)),
                (count, 0.0)
            );
        }
    }

    #[test]
    fn delayed_command_is_accepted_once_it_is_due() {
        let mut brief = PlantBrief { pace: Pace::Lockstep, ..brief(&[0.0]) };
        let kind = LinkFaultKind::Delay { delay_ns: 10 * NS_PER_MS, jitter_ns: 0 };
        let span = Span { from_ns: 0, until_ns: 5 * NS_PER_MS };
        brief.robots[0].command_faults = vec![LinkFault { span, kind, seed: 1 }];
        let mut stepper = SimulationStepper::new(&brief, UnicycleMotion::new(&brief));
        run_step(&mut stepper, 0, &[(0, 1, 0.4)]);
        assert_eq!(robot_x_m(&stepper), 0.0);
        run_step(&mut stepper, 10, &[]);
        assert!((robot_x_m(&stepper) - 0.004).abs() < 1e-15, "{}", robot_x_m(&stepper));
    }

    #[test]
    fn real_time_advances_before_commands_are_accepted() {
        let mut stepper = stepper_with_pace(Pace::Realtime);
        stepper.start_at(100 * NS_PER_MS);
        run_step(&mut stepper, 107, &[(100, 1, 0.4), (105, 4, 0.4)]);
        assert_eq!(
            (robot_x_m(&stepper), stepper.world.tick(), stepper.world.t_ns()),
            (0.0, 1, 7 * NS_PER_MS)
        );
        run_step(&mut stepper, 110, &[]);
        assert!((robot_x_m(&stepper) - 0.0012).abs() < 1e-15, "{}", robot_x_m(&stepper));
        assert_eq!(measurements_ms(&stepper, Stage::Command), [(1, 7), (1, 2)]);
        assert_eq!(stepper.measurements.batch().0.samples_lost, 2);
        assert!(!stepper.is_over());
        run_step(&mut stepper, 171, &[]);
        assert!(stepper.is_over());
        assert_eq!(stepper.world.t_ns(), 30 * NS_PER_MS, "no longer than planned");
    }

    #[test]
    fn overwritten_command_is_lost_but_not_across_restarts() {
        let mut robot =
            CommandSender { name: "a".into(), odometry_sent_ns: 0, newest_command_key: (0, 0) };
        let lost = [(0, 1), (0, 2), (0, 5), (0, 4), (1, 1), (0, 6), (1, 3), (2, 2)].map(
            |(incarnation, sequence)| {
                robot.commands_lost_before(&Command {
                    incarnation,
                    ..command(0, sequence, 0.0, 0.0)
                })
            },
        );
        assert_eq!(lost, [0, 0, 2, 0, 0, 0, 1, 1]);
    }

    #[test]
    fn wake_up_is_recorded_with_the_cause_of_its_lateness() {
        let mut stepper = stepper_with_pace(Pace::Realtime);
        let wake = WakeUp { due_ns: 0, lateness_ns: 3 * NS_PER_MS };
        stepper.record_wake_up(&wake, None);
        stepper.record_wake_up(&wake, Some(LatenessCause::Host));
        let counts =
            [Stage::Wake, Stage::LateHost].map(|stage| measurements_ms(&stepper, stage).len());
        assert_eq!(counts, [2, 1]);
    }

    #[test]
    fn motion_has_to_keep_up_with_real_time() {
        // From the start, and after 100 s in time.
        for start_s in [0, 100] {
            let now_ns = Cell::new(start_s * 1000 * NS_PER_MS);
            let brief = PlantBrief { duration_ns: u64::MAX, ..brief(&[0.0]) };
            let mut stepper = SimulationStepper::new(&brief, UnicycleMotion::new(&brief));
            let no_commands = || std::iter::empty::<Result<_, StepError>>();
            stepper.step(no_commands(), || now_ns.get()).unwrap();
            // Each read of the clock takes 50 times as long as a plant tick.
            let clock = || now_ns.replace(now_ns.get() + 50 * NS_PER_MS);
            now_ns.set(now_ns.get() + 10 * NS_PER_MS);
            assert!(stepper.step(no_commands(), clock).is_ok(), "once may be by chance");
            let result = stepper.step(no_commands(), clock);
            assert!(matches!(result, Err(StepError::PlantTooSlow(_))), "{start_s}");
        }
    }
}
