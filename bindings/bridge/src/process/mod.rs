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

use protocol::brief::{self, BridgeBrief, BriefError};
use protocol::clock;
use protocol::process::{self, Stop, Turns, exit};
use protocol::run_root::{self, RunRootError};

use self::bridge::Bridge;
use self::ports::PortError;
use crate::wire::WireError;

/// Why a bridge gave up.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// Its brief is unreadable.
    #[error(transparent)]
    Brief(#[from] BriefError),
    /// The run it belongs to is not there.
    #[error(transparent)]
    RunRoot(#[from] RunRootError),
    /// A port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// No connection.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// Signals cannot be handled.
    #[error("cannot handle signals: {0}")]
    Signals(#[from] std::io::Error),
}

/// What the process does: named, logging, and with an exit code that tells.
pub fn main(brief_path: &Path, realtime_priority: bool) -> u8 {
    process::set_name("phalanx-bridge");
    process::log_to_stderr_and(refusals::Listener::layer(), refusals::is_counted);
    if realtime_priority {
        process::hurry();
    }
    match run(brief_path) {
        Ok(()) => exit::OK,
        Err(error) => {
            tracing::error!("{error}");
            exit::INFRASTRUCTURE
        }
    }
}

/// Carries what the brief says until told to stop.
fn run(brief_path: &Path) -> Result<(), BridgeError> {
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
