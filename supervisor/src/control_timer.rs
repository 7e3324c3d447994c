//! Control process of a real-time run: it only waits on the robots' timer, as a baseline that separates the
//! wake-up latency of the machine from that of the robots.
//!
//! Must not receive from a robot, the plant or the supervisor, and must not do more between two wake-ups
//! than record the latency of the last one.

use std::path::PathBuf;
use std::time::Duration;

use protocol::clock::{self, Timer};
use protocol::latency::LatencyRecorder;
use protocol::latency_port::LatencyPort;
use protocol::process::{self, Failure, StopFlag, TimeSlice};
use protocol::run_root;
use protocol::service;
use protocol::stage::Stage;
use protocol::wake::golden_phase;

/// Arguments of the control process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ControlTimerArguments {
    /// Run root of the run that the process belongs to.
    pub run_root: PathBuf,
    /// Period of the robots, ns.
    pub period_ns: u64,
    /// Number of robots. The phase of the timer is that of one robot more.
    pub robots: usize,
    /// Whether the process runs with real-time priority, as robots do with `--realtime-priority`.
    pub realtime_priority: bool,
}

/// Runs the process `phalanx-machine` until it is stopped, and returns the exit code.
pub fn main(arguments: &ControlTimerArguments) -> u8 {
    process::main("phalanx-machine", arguments.realtime_priority, || run(arguments))
}

fn run(arguments: &ControlTimerArguments) -> Result<(), Failure> {
    let stop = StopFlag::for_termination_signals()
        .map_err(|error| format!("cannot handle signals: {error}"))?;
    run_root::join(&arguments.run_root)?;
    clock::tighten_timer_slack();
    process::request_time_slice(TimeSlice::Short);
    let node = service::create_node("machine")?;
    let mut recorder = LatencyRecorder::for_process(arguments.robots + 1, 0, 1);
    let latency = LatencyPort::new(&service::machine_latency_topic().open(&node)?, &recorder)?;
    let period = Duration::from_nanos(arguments.period_ns);
    let phase = period.mul_f64(golden_phase(arguments.robots + 1));
    let mut timer = Timer::new(arguments.period_ns, phase.as_nanos() as u64);
    while !stop.is_requested() {
        let Some(wake) = timer.wait() else { continue };
        recorder.record(Stage::Machine, 0, wake.lateness_ns);
        latency.send_if_due(&mut recorder, wake.due_ns);
    }
    latency.send(&mut recorder, clock::now_ns());
    Ok(())
}
