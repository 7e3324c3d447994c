//! Messages, services, process configuration and other definitions that all processes of a run share.
//!
//! | file | content |
//! |---|---|
//! | `message` | message types and their memory layout |
//! | `service` | names, connection limits and queue lengths of the iceoryx2 services |
//! | `ipc` | the variant of iceoryx2 that a run uses |
//! | `run_root` | the directory of the shared files of one run: creation, locking, removal |
//! | `brief` | the brief: the configuration of one process |
//! | `ros2` | brief of the ROS 2 process, and the encoding of ROS 2 messages |
//! | `fault` | faults and their times |
//! | `goal` | reasons for refusing a goal from outside of the run |
//! | `dropped` | reasons for which a bridge drops samples |
//! | `link` | delivery of messages over a faulty link |
//! | `law_message` | messages that control laws send with their beacons |
//! | `law` `avoidance` | descriptions of control laws and avoidance methods |
//! | `catalog` | list of the available laws and methods |
//! | `clock` | monotonic clock and periodic timer |
//! | `barrier` | lockstep barrier |
//! | `incarnations` | lowest incarnation of each robot whose commands the plant accepts |
//! | `stage` | measured latencies and causes of lateness |
//! | `latency` | transfer of measured latencies to the supervisor |
//! | `cgroup` | CPU bandwidth limits of this process |
//! | `lateness` | diagnosis of late wake-ups from kernel counters |
//! | `age` | age of information over an edge |
//! | `scratch` | scratch folder outside of a run root |
//! | `regular_file` | bounded reads of files that another program may have written |
//! | `number` | number formatting in messages |
//! | `wire_enum` | enums with a number on the wire and a keyword in files |
//! | `watchdog` | detection of hung processes |
//! | `process` | name, log, signals, priority and exit code of a process |
//! | `terminal_escape` | escaping of text for a terminal |
//! | `wake` | timer phases and wake-up latency |
//!
//! Without the feature `ipc` the crate has no iceoryx2 and no system calls. It then contains only `message`,
//! `law_message`, `brief`, `ros2`, `goal`, `fault`, `dropped`, `link`, `law`, `avoidance`, `catalog`, `number`, `regular_file`,
//! `age`, `latency` without its port, `process::exit`, `stage`, `terminal_escape` and `wake`.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[macro_use]
mod wire_enum;

pub mod age;
pub mod avoidance;
#[cfg(feature = "ipc")]
pub mod barrier;
pub mod brief;
pub mod catalog;
#[cfg(feature = "ipc")]
pub mod cgroup;
#[cfg(feature = "ipc")]
pub mod clock;
pub mod dropped;
pub mod fault;
pub mod goal;
#[cfg(feature = "ipc")]
pub mod incarnations;
#[cfg(feature = "ipc")]
mod ipc;
pub mod latency;
#[cfg(feature = "ipc")]
pub mod lateness;
pub mod law;
pub mod law_message;
pub mod link;
#[cfg(all(test, feature = "ipc"))]
mod machine_files;
pub mod message;
pub mod number;
#[cfg(feature = "ipc")]
pub mod process;
#[cfg(not(feature = "ipc"))]
pub mod process {
    //! Exit codes of processes.

    pub mod exit;
}
pub mod regular_file;
#[cfg(feature = "ipc")]
pub mod resources;
pub mod ros2;
#[cfg(feature = "ipc")]
pub mod run_root;
#[cfg(feature = "ipc")]
pub mod scratch;
#[cfg(feature = "ipc")]
pub mod service;
pub mod stage;
pub mod terminal_escape;
pub mod wake;
#[cfg(feature = "ipc")]
pub mod watchdog;
