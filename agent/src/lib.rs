//! Agent of one robot: a pure control cycle with a controller, and the loop that provides samples and time.
//!
//! An agent knows only its brief: its own services and the beacons of its in-neighbors. It never receives the graph
//! and never needs the supervisor to keep moving.
//!
//! | file | question it answers |
//! |---|---|
//! | `roles/` | what is the desired position of the robot? |
//! | `laws/` | at which velocity does it move there? |
//! | `neighborhood` | what is known of the in-neighbors, and what follows from a communication timeout? |
//! | `avoidance/` | how does the robot keep its distance? |
//! | `gains` | are the gains of a law or a method complete and valid? |
//! | `controller` | which answer follows from one sample? |
//! | `control_cycle` | what has arrived since the last control cycle, and what has to be sent? |
//! | `control_loop` | when does a control cycle run? Waiting and sending, in both time modes, through its `ports` |
//! | `program` | how is a control law in another language called? |
//!
//! Without the feature `ipc`, the modules `control_loop` and `program` are absent: the robot then runs
//! without a process of its own.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod avoidance;
pub mod control_cycle;
#[cfg(feature = "ipc")]
pub mod control_loop;
pub mod controller;
mod gains;
pub mod laws;
pub mod neighborhood;
#[cfg(feature = "ipc")]
pub mod program;
pub mod roles;
#[cfg(test)]
mod testing;

use protocol::catalog::Catalog;
pub use protocol::wake::golden_phase;

/// Reason why a brief does not describe a valid robot, as text.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UnfitBrief(pub String);

/// Returns all control laws and avoidance methods of this crate.
pub fn catalog() -> Catalog {
    catalog_with_laws(&[])
}

/// Returns the control laws and avoidance methods of this crate, and `added` laws of a program that embeds it.
pub fn catalog_with_laws(added: &[laws::LawRow]) -> Catalog {
    Catalog {
        laws: laws::LAWS.iter().chain(added).map(laws::LawRow::description).collect(),
        methods: avoidance::METHODS.iter().map(|row| row.description).collect(),
    }
}
