//! Files that a run writes into its directory, and their reading for the report.
//!
//! Must not: start, signal or wait for a process, or decide anything about a run.
//!
//! | file | question it answers |
//! |---|---|
//! | `run_dir` | which files does a run write, and what do they contain? |
//! | `tables` | what do its tables contain? |
//! | `in_memory` | how are the tables kept without files? |
//! | `outcome` | which results does a run have besides its metrics? |
//! | `summary` | how is the summary of a run put together? |
//! | `latency` | how are latencies and ages collected? |
//! | `scene` | what does the picture of a run show? |
//! | `files/` | what needs a file system? Its modules are those of this folder |

#[cfg(feature = "files")]
pub(crate) mod files;
pub mod latency;
pub mod outcome;
#[cfg_attr(not(feature = "files"), path = "in_memory.rs")]
pub mod run_dir;
pub mod scene;
pub mod summary;
pub mod tables;

#[cfg(feature = "files")]
pub use files::*;
