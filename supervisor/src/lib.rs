//! Supervisor: starts the processes of an experiment, executes the planned process faults, and watches. It
//! never forwards control data, and no agent needs it to keep moving.
//!
//! | file | contents |
//! |---|---|
//! | `run/` | the course of a run, from the first process to the last |
//! | `descriptors` | number of open files that a run needs |
//! | `shm_capacity` | free space for the memory that its processes share |
//! | `timeline` | planned actions on processes |
//! | `spawn` | start of the executable in a role |
//! | `addresses` | fixed address-space layout of robots in lockstep |
//! | `limits` | limits for which the kernel refuses another process |
//! | `child` | watching and ending one process |
//! | `keeper` | process that holds together all processes of a program of the scenario |
//! | `tree` | signals to all processes below one |
//! | `orphans` | processes that a dead child of this process left |
//! | `orphan_processes` | processes that programs of a run left |
//! | `logs` | bound on the size of logs |
//! | `cores` | assignment of the processes of a lockstep run to cores |
//! | `dead_nodes` | removal of iceoryx2 resources of a dead process |
//! | `view/` | live view for browsers |
//! | `live` | conversion of run data for the live view |
//!
//! Without the feature `processes` the crate contains only pure values: `timeline`, and `journal`, `lifecycle`
//! and `reports` of `run/`.

#[cfg(feature = "processes")]
mod addresses;
#[cfg(feature = "processes")]
pub mod child;
#[cfg(feature = "processes")]
pub mod control_timer;
#[cfg(feature = "processes")]
pub mod cores;
#[cfg(feature = "processes")]
pub mod dead_nodes;
#[cfg(feature = "processes")]
pub mod descriptors;
#[cfg(feature = "processes")]
pub mod keeper;
#[cfg(feature = "processes")]
pub mod limits;
#[cfg(feature = "processes")]
pub mod live;
#[cfg(feature = "processes")]
mod logs;
#[cfg(test)]
#[path = "../../protocol/src/machine_files.rs"]
mod machine_files;
#[cfg(feature = "processes")]
pub mod orphan_processes;
#[cfg(feature = "processes")]
mod orphans;
#[cfg(feature = "processes")]
pub mod run;
#[cfg(feature = "processes")]
pub mod shm_capacity;
#[cfg(not(feature = "processes"))]
pub mod run {
    //! Part of a run that needs no processes.

    pub mod journal;
    pub mod lifecycle;
    pub mod reports;
}
#[cfg(feature = "processes")]
pub mod spawn;
pub mod timeline;
#[cfg(feature = "processes")]
mod tree;
#[cfg(feature = "processes")]
pub mod view;
