//! The process `phalanx bridge`: what crosses between hosts goes through the bridges of both.
//!
//! One loop takes what this host has for others every half a millisecond, and what arrives from others
//! at once. It waits for nobody: whatever finds no place on its way is dropped, and the next sample is newer.
//!
//! | file | question it answers |
//! |---|---|
//! | `bridge` | what does it do at each turn of its loop? |
//! | `config` | what is zenoh told? |
//! | `wire` | how do samples get to other hosts? |
//! | `inbox` | what arrived? |
//! | `ports` | which ports has it in this host's share of the run? |
//! | `telling` | how does what robots tell the supervisor get to it? |
//! | `times` | what becomes of the stamps of a sample? |
//! | `refusals` | what did zenoh refuse before it was a frame? |

mod bridge;
pub mod config;
pub mod inbox;
mod ports;
pub mod refusals;
mod telling;
mod times;
pub mod wire;

use std::path::Path;

use protocol::brief::{self, BridgeBrief};
use protocol::process::{self, Failure, Stop, Turns};
use protocol::{clock, run_root};

use self::bridge::Bridge;

/// What the process does: named, logging, and with an exit code that tells.
pub fn main(brief_path: &Path, realtime_priority: bool) -> u8 {
    let log = || process::log_to_stderr_and(refusals::Listener::layer(), refusals::is_counted);
    process::main_that_logs("phalanx-bridge", realtime_priority, log, || run(brief_path))
}

/// Carries what the brief says until told to stop.
fn run(brief_path: &Path) -> Result<(), Failure> {
    let brief: BridgeBrief = brief::read(brief_path)?;
    let stop = Stop::on_signals()?;
    run_root::join(&brief.run_root)?;
    clock::tighten_timer_slack();
    process::take_turns(Turns::Short);
    let mut bridge = Bridge::open(brief)?;
    tracing::info!(host = bridge.host(), "ready");
    while !stop.requested() {
        bridge.turn()?;
    }
    bridge.close();
    Ok(())
}
