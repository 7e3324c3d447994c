//! Supervisor: starts the processes of an experiment, executes the planned process faults, and watches. It
//! never forwards control data, and no agent needs it to keep moving. What follows from an event is decided in the
//! crate `run`.
//!
//! | file | contents |
//! |---|---|
//! | `run/` | the course of a run, from the first process to the last |
//! | `requirements` | processes, files and memory that a run needs |
//! | `descriptors` | number of open files that a run needs |
//! | `shm_capacity` | free space for the memory that its processes share |
//! | `spawn` | start of the executable in a role |
//! | `addresses` | fixed address-space layout of robots in lockstep |
//! | `limits` | limits for which the kernel refuses another process |
//! | `child` | watching and ending one process |
//! | `keeper` | process that holds together all processes of a program of the scenario |
//! | `tree` | signals to all processes below one |
//! | `metric_programs` | programs that compute metrics of a run that has ended |
//! | `orphans` | processes that a dead child of this process left |
//! | `orphan_processes` | processes that programs of a run left |
//! | `logs` | bound on the size of logs |
//! | `cores` | assignment of the processes of a lockstep run to cores |
//! | `dead_nodes` | removal of iceoryx2 resources of a dead process |
//! | `view/` | live view for browsers |
//! | `live` | conversion of run data for the live view |

mod addresses;
pub mod child;
pub mod control_timer;
pub mod cores;
pub mod dead_nodes;
pub mod descriptors;
pub mod keeper;
pub mod limits;
pub mod live;
mod logs;
pub mod metric_programs;
pub mod orphan_processes;
mod orphans;
pub mod requirements;
pub mod run;
pub mod shm_capacity;
pub mod spawn;
mod tree;
pub mod view;
