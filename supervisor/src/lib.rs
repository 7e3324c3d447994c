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
//! | `left_behind` | whom did programs of a run start and leave behind? |
//! | `logs` | what is dropped of logs that grow without end? |
//! | `cores` | on which cores are the processes of a lockstep run? |
//! | `dead_nodes` | what did a dead process of this run leave in iceoryx2? |
//! | `view/` | how is the live view served to browsers? |
//! | `live` | what does the live view show of it? |

mod addresses;
pub mod child;
pub mod control_timer;
pub mod cores;
pub mod dead_nodes;
pub mod descriptors;
pub mod left_behind;
pub mod limits;
pub mod live;
mod logs;
#[cfg(test)]
#[path = "../../protocol/src/machine_files.rs"]
mod machine_files;
pub mod room;
pub mod run;
pub mod spawn;
pub mod timeline;
pub mod view;
