//! Stand-in hardware: the world of bodies, its turn, and the loop that gives it time and commands.
//!
//! The plant knows bodies, commands and distances. It never sees edges, roles or laws.
//!
//! | file | question it answers |
//! |---|---|
//! | `world` | where is everybody, what do they sense, which commands count? |
//! | `motion` | what moves the bodies: unicycles, or a program from outside? |
//! | `turn` | what happens in which order, by what has come by now? |
//! | `ports` | through which services does it speak? |
//! | `overrun` | does what moves the bodies keep up with real time? |
//! | `world_loop` | when is a turn? Waiting and sending, in both paces |
//!
//! Without the feature `ipc` there are no `ports` and `world_loop`: a world without a process.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod motion;
pub mod overrun;
#[cfg(feature = "ipc")]
pub mod ports;
#[cfg(test)]
mod testing;
pub mod turn;
pub mod world;
#[cfg(feature = "ipc")]
pub mod world_loop;
