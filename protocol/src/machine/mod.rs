//! iceoryx2 and the operating system. The crate has these modules at its root, with the feature `ipc`.
//!
//! | file | content |
//! |---|---|
//! | `service` | names, connection limits and queue lengths of the iceoryx2 services |
//! | `ipc` | the variant of iceoryx2 that a run uses |
//! | `run_root` | the directory of the shared files of one run: creation, locking, removal |
//! | `clock` | monotonic clock and periodic timer |
//! | `barrier` | lockstep barrier |
//! | `incarnations` | lowest incarnation of each robot whose commands the plant accepts |
//! | `cgroup` | CPU bandwidth limits of this process |
//! | `lateness` | diagnosis of late wake-ups from kernel counters |
//! | `scratch` | scratch folder outside of a run root |
//! | `watchdog` | detection of hung processes |
//! | `process` | name, log, signals, priority and exit codes of a process |
//! | `resources` | open files and address space that a new port or connection needs |
//! | `latency_port` | transfer of measured latencies to the supervisor |

pub mod barrier;
pub mod cgroup;
pub mod clock;
pub mod incarnations;
mod ipc;
pub mod latency_port;
pub mod lateness;
#[cfg(test)]
mod machine_files;
pub mod process;
pub mod resources;
pub mod run_root;
pub mod scratch;
pub mod service;
pub mod watchdog;
