//! One run, without its processes: its plan, the states of its robots, its records, and a run within one process.
//!
//! | file | contents |
//! |---|---|
//! | `state_machine` | the pure part of a run as one value: events in, orders and records out |
//! | `timeline` | planned actions on processes, as events |
//! | `lifecycle` | state machine of each robot's process: from an event to its effects |
//! | `reports` | newest status of a robot, and changes in it |
//! | `journal` | recording of events, in order |
//! | `in_process` | driver without processes: a lockstep run within one process, and `in_process/measured`: the same, measured and recorded |
//!
//! Must not: start, signal or wait for a process, read a clock, depend on iceoryx2. `supervisor/` is the
//! driver with processes.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod in_process;
pub mod journal;
pub mod lifecycle;
pub mod reports;
pub mod state_machine;
pub mod timeline;
