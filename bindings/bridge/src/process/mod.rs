//! The process `phalanx bridge`: samples between two hosts pass through the bridges of both.
//!
//! One loop polls the samples of this host every half a millisecond, and receives those of other hosts at once.
//! It never blocks on sending: if a queue is full the sample is dropped, and the next one is newer.
//!
//! | file | content |
//! |---|---|
//! | `bridge` | main loop |
//! | `config` | configuration of zenoh |
//! | `wire` | connections to other hosts |
//! | `inbox` | queue of frames from other hosts |
//! | `ports` | iceoryx2 ports on this host |
//! | `status_forwarder` | forwarding of status and latencies to the supervisor |
//! | `times` | conversion of stamps |
//! | `refusals` | counts of connections and messages that zenoh refuses |

mod bridge;
pub mod config;
pub mod inbox;
mod ports;
pub mod refusals;
mod status_forwarder;
mod times;
pub mod wire;

use std::path::Path;

use protocol::brief::{self, BridgeBrief};
use protocol::process::{self, Failure, StopFlag, TimeSlice};
use protocol::{clock, run_root};

use self::bridge::Bridge;

/// Runs the process: name, log and exit code included.
pub fn main(brief_path: &Path, realtime_priority: bool) -> u8 {
    let log = || {
        process::log_to_stderr_and_listener(refusals::RefusalCounter::layer(), refusals::is_counted)
    };
    process::main_with_log("phalanx-bridge", realtime_priority, log, || run(brief_path))
}

/// Forwards samples as the brief specifies until the process is asked to stop.
fn run(brief_path: &Path) -> Result<(), Failure> {
    let brief: BridgeBrief = brief::read(brief_path)?;
    let stop = StopFlag::for_termination_signals()?;
    run_root::join(&brief.run_root)?;
    clock::tighten_timer_slack();
    process::request_time_slice(TimeSlice::Short);
    let mut bridge = Bridge::open(brief)?;
    tracing::info!(host = bridge.host_name(), "ready");
    while !stop.is_requested() {
        bridge.iterate()?;
    }
    bridge.close();
    Ok(())
}
