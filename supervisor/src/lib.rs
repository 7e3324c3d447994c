//! The supervisor: it starts an experiment's processes, breaks what the scenario says, and watches.
//! It never passes control data on, and no agent needs it to keep moving.
//!
//! | file | question it answers |
//! |---|---|
//! | `run/` | what happens, in order, from the first process to the last? |
//! | `descriptors` | how many files may it open? |
//! | `room` | is there memory for what its processes share? |
//! | `timeline` | what does the supervisor do to processes, and when? |
//! | `spawn` | which executable is started, in which role, and why could it not be? |
//! | `addresses` | how do robots share what a core learns of their code? |
//! | `limits` | why does the kernel refuse another process? |
//! | `child` | how is a process watched and ended? |
//! | `keeper` | which process keeps all those together that a program of the scenario starts? |
//! | `tree` | how are all processes below one signalled at once? |
//! | `orphans` | what did a dead child of this process leave to it? |
//! | `left_behind` | whom did programs of a run start and leave behind? |
//! | `logs` | what is dropped of logs that grow without end? |
//! | `cores` | on which cores are the processes of a lockstep run? |
//! | `dead_nodes` | what did a dead process of this run leave in iceoryx2? |
//! | `view/` | how is the live view served to browsers? |
//! | `live` | what does the live view show of it? |
//!
//! Without the feature `processes` there are `timeline`, and of `run/` `journal`, `lives` and `reports`: plain values.

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
pub mod left_behind;
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
mod orphans;
#[cfg(feature = "processes")]
pub mod room;
#[cfg(feature = "processes")]
pub mod run;
#[cfg(not(feature = "processes"))]
pub mod run {
    //! What of a run is decided and told without a process.

    pub mod journal;
    pub mod lives;
    pub mod reports;
}
#[cfg(feature = "processes")]
pub mod spawn;
pub mod timeline;
#[cfg(feature = "processes")]
mod tree;
#[cfg(feature = "processes")]
pub mod view;
