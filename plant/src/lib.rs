//! Simulated hardware (the plant): bodies, the simulation step, and the loop that provides time and commands.
//!
//! The plant knows bodies, commands and distances. It never receives edges, roles or control laws.
//!
//! | file | question it answers |
//! |---|---|
//! | `world` | where are the robots, what do they sense, and which commands are accepted? |
//! | `motion` | what moves the bodies: unicycles, or an external program? |
//! | `simulation_step` | in which order are time and commands processed in one simulation step? |
//! | `overrun` | does the motion keep up with real time? |
//! | `world_loop` | when is a simulation step due? Waiting and sending, in both time modes, through its `ports` |
//!
//! Without the feature `ipc`, the module `world_loop` is absent: the plant then runs without a
//! process of its own.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod motion;
pub mod overrun;
pub mod simulation_step;
#[cfg(test)]
mod testing;
pub mod world;
#[cfg(feature = "ipc")]
pub mod world_loop;
