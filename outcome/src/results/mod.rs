//! Files that a run writes into its directory, and their reading for the report.
//!
//! Must not: start, signal or wait for a process, or decide anything about a run.
//!
//! | file | question it answers |
//! |---|---|
//! | `run_dir` | which files does a run write, and what do they contain? |
//! | `tables` | what do its tables contain? |
//! | `in_memory` | how are the tables kept without files? |
//! | `host_dir` | what does every host of a run write? |
//! | `checksums` | is a run complete and unchanged? |
//! | `chained` | which lines of a file are unchanged? |
//! | `own_file` | how is an existing file opened for writing? |
//! | `reserved` | how is a small file written when the disk is full? |
//! | `programs` | which external programs do robots run? |
//! | `manifest` | what was run, where and how? |
//! | `outcome` | which results does a run have besides its metrics? |
//! | `summary` | how is the summary of a run put together? |
//! | `latency` | how are latencies and ages collected? |
//! | `usage` | which resources did a process use? |
//! | `scene` | what does the picture of a run show? |
//! | `compare` | are two runs equal, and where do they differ first? |
//! | `date` | how are dates computed and formatted? |
//! | `page` | how does a run directory become figures and a page? |

#[cfg(feature = "files")]
pub mod chained;
#[cfg(feature = "files")]
pub mod checksums;
#[cfg(feature = "files")]
pub mod compare;
#[cfg(feature = "files")]
pub mod date;
#[cfg(feature = "files")]
pub mod host_dir;
pub mod latency;
#[cfg(feature = "files")]
pub mod manifest;
pub mod outcome;
#[cfg(feature = "files")]
pub mod own_file;
#[cfg(feature = "files")]
pub mod page;
#[cfg(feature = "files")]
pub mod programs;
#[cfg(feature = "files")]
mod reserved;
#[cfg_attr(not(feature = "files"), path = "in_memory.rs")]
pub mod run_dir;
pub mod scene;
pub mod summary;
pub mod tables;
#[cfg(feature = "files")]
pub mod usage;
