//! One robot's agent: a pure turn with a brain, and the loop that gives it samples and time.
//!
//! An agent knows its brief and nothing else: its own services, and the beacons of those it hears.
//! It never sees the graph and never needs the supervisor to keep moving.
//!
//! | file | question it answers |
//! |---|---|
//! | `roles/` | where is the robot to be? |
//! | `laws/` | how does it get there? |
//! | `neighborhood` | what is known of those it hears, and what does silence mean? |
//! | `avoidance/` | how does it keep its distance? |
//! | `gains` | are these the gains that a law or a method asks for? |
//! | `brain` | what does one sample lead to? |
//! | `turn` | what has come by now, and what is to be sent? |
//! | `ports` | through which services does it speak? |
//! | `control_loop` | when is a turn? Waiting and sending, in both paces |
//! | `program` | and with a law in another language? |
//!
//! Without the feature `ipc` there are no `ports`, `control_loop` and `program`: a robot without a process.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod avoidance;
pub mod brain;
#[cfg(feature = "ipc")]
pub mod control_loop;
mod gains;
pub mod laws;
pub mod neighborhood;
#[cfg(feature = "ipc")]
pub mod ports;
#[cfg(feature = "ipc")]
pub mod program;
pub mod roles;
#[cfg(test)]
mod testing;
pub mod turn;

use protocol::catalog::Catalog;
pub use protocol::wake::golden_phase;

/// Why a brief makes no robot, in words.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UnfitBrief(pub String);

/// Every law and every avoidance method of this crate.
pub fn catalog() -> Catalog {
    Catalog {
        laws: laws::LAWS.iter().map(laws::LawRow::description).collect(),
        methods: avoidance::METHODS.iter().map(|row| row.description).collect(),
    }
}
