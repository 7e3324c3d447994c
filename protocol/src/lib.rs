//! Messages, services, process configuration and other definitions that all processes of a run share.
//!
//! | file | content |
//! |---|---|
//! | `message` | message types and their memory layout |
//! | `brief` | the brief: the configuration of one process |
//! | `ros2` | brief of the ROS 2 process, and the encoding of ROS 2 messages |
//! | `fault` | faults and their times |
//! | `goal` | reasons for refusing a goal from outside of the run |
//! | `dropped` | reasons for which a bridge drops samples |
//! | `link` | delivery of messages over a faulty link |
//! | `law_message` | messages that control laws send with their beacons |
//! | `signals` | numbers that control laws record about themselves |
//! | `law` `avoidance` | descriptions of control laws and avoidance methods |
//! | `catalog` | list of the available laws and methods |
//! | `stage` | measured latencies and causes of lateness |
//! | `latency` | recording of measured latencies |
//! | `age` | age of information over an edge |
//! | `regular_file` | bounded reads of files that another program may have written |
//! | `number` | number formatting in messages |
//! | `wire_enum` | enums with a number on the wire and a keyword in files |
//! | `terminal_escape` | escaping of text for a terminal |
//! | `exit` | exit codes |
//! | `machine/` | iceoryx2 and the operating system; its modules are those of this crate |
//! | `wake` | timer phases and wake-up latency |
//!
//! Without the feature `ipc` the crate has no iceoryx2 and no system calls: `machine/` is absent.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[macro_use]
mod wire_enum;

pub mod age;
pub mod avoidance;
pub mod brief;
pub mod catalog;
pub mod dropped;
pub mod exit;
pub mod fault;
pub mod goal;
pub mod latency;
pub mod law;
pub mod law_message;
pub mod link;
#[cfg(feature = "ipc")]
mod machine;
pub mod message;
pub mod number;
pub mod regular_file;
pub mod ros2;
pub mod signals;
pub mod stage;
pub mod terminal_escape;
pub mod wake;

#[cfg(feature = "ipc")]
pub use machine::*;
