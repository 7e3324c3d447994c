//! What a run leaves: its directory, written while it goes on, and read again for its page.
//!
//! Must not: start, signal or wait for a process, or decide anything about a run.
//!
//! | file | question it answers |
//! |---|---|
//! | `run_dir` | which files are there, and what stands in them? |
//! | `tables` | what stands in its tables? |
//! | `in_memory` | and where there are no files? |
//! | `host_dir` | what does every host of a run write? |
//! | `checksums` | is a run whole, and as it was written? |
//! | `chained` | which lines of a file that is read again are as they were written? |
//! | `own_file` | how is a file opened that is written on? |
//! | `reserved` | how does a small file survive a full disk? |
//! | `programs` | what do robots run that is not built in? |
//! | `manifest` | what was run, where and how? |
//! | `outcome` | what does a run leave besides its metrics? |
//! | `summary` | what came out? |
//! | `goals` | where were robots sent from outside? |
//! | `latency` | how late, how long, how old was everything? |
//! | `usage` | what did a process take from the machine? |
//! | `scene` | what does a picture of it show all the time? |
//! | `compare` | are two runs the same, and if not, where do they part? |
//! | `date` | which day and time of day was it? |
//! | `page` | what does a run directory look like in pictures? |

#[cfg(feature = "files")]
pub mod chained;
#[cfg(feature = "files")]
pub mod checksums;
#[cfg(feature = "files")]
pub mod compare;
#[cfg(feature = "files")]
pub mod date;
pub mod goals;
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
