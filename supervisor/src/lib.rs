//! The supervisor: it starts an experiment's processes, breaks what the scenario says, watches,
//! and reports. It never passes control data on, and no agent needs it to keep moving.
//!
//! | file | question it answers |
//! |---|---|
//! | `cli` | what was asked for? |
//! | `run/` | what happens, in order, from the first process to the last? |
//! | `outcome` | what does it leave besides its metrics? |
//! | `descriptors` | how many files may it open? |
//! | `room` | is there memory for what its processes share? |
//! | `doctor` | is this machine fit for it? |
//! | `dead_runs` | what did earlier runs that died leave behind? |
//! | `timeline` | what does the supervisor do to processes, and when? |
//! | `spawn` | which executable is started, in which role, and why could it not be? |
//! | `limits` | why does the kernel refuse another process? |
//! | `child` | how is a process watched and ended? |
//! | `cores` | on which cores are the processes of a lockstep run? |
//! | `dead_nodes` | what did a dead process of this run leave in iceoryx2? |
//! | `usage` | what did a process take from the machine? |
//! | `latency` | how late, how long, how old was everything? |
//! | `live` | what does the live view show of it? |
//! | `run_dir` | where is it written down? |
//! | `reserved` | what is written even if the disk is full? |
//! | `manifest` | what was run, where and how? |
//! | `summary` | what came out? |
//! | `report` | what does a run directory look like in pictures? |

pub mod child;
pub mod cli;
mod cores;
pub mod dead_nodes;
pub mod dead_runs;
pub mod descriptors;
pub mod doctor;
pub mod latency;
mod limits;
pub mod live;
pub mod manifest;
pub mod outcome;
pub mod report;
mod reserved;
pub mod room;
pub mod run;
pub mod run_dir;
pub mod spawn;
pub mod summary;
mod timeline;
pub mod usage;
