//! The control group of a run in real time: one process with the robots' timer and nothing else, so that
//! what the machine does to anybody stands beside what it does to robots.
//!
//! Must not: hear a robot, the plant or the supervisor, or do more between two wake-ups than write down
//! how late the last one was.

use std::path::PathBuf;
use std::time::Duration;

use protocol::clock::{self, Timer};
use protocol::latency::{LatencyPort, Recorder};
use protocol::process::{self, Failure, Stop, Turns};
use protocol::run_root;
use protocol::service;
use protocol::stage::Stage;
use protocol::wake::golden_phase;

/// What the control timer is told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ControlTimer {
    /// The run it belongs to.
    pub run_root: PathBuf,
    /// The robots' period, ns.
    pub period_ns: u64,
    /// How many robots there are: its phase is that of one more.
    pub robots: usize,
    /// Whether it runs before every ordinary process, as robots with this priority do.
    pub realtime_priority: bool,
}

/// What the process `phalanx-machine` does.
pub fn main(timer: &ControlTimer) -> u8 {
    process::main("phalanx-machine", timer.realtime_priority, || run(timer))
}

fn run(control: &ControlTimer) -> Result<(), Failure> {
    let stop = Stop::on_signals().map_err(|error| format!("cannot handle signals: {error}"))?;
    run_root::join(&control.run_root)?;
    clock::tighten_timer_slack();
    process::take_turns(Turns::Short);
    let node = service::node("machine")?;
    let mut measured = Recorder::for_ticks_of(0, 1);
    let latency = LatencyPort::new(&service::machine_latency().open(&node)?, &measured)?;
    let period = Duration::from_nanos(control.period_ns);
    let phase = period.mul_f64(golden_phase(control.robots + 1));
    let mut timer = Timer::new(control.period_ns, phase.as_nanos() as u64);
    while !stop.requested() {
        let Some(wake) = timer.wait() else { continue };
        measured.record(Stage::Machine, 0, wake.lateness_ns);
        latency.send_if_due(&mut measured, wake.due_ns);
    }
    latency.send(&mut measured, clock::now_ns());
    Ok(())
}
