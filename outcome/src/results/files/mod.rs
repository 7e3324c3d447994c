//! Results in files, and their reading. `results` has these modules with the feature `files`.
//!
//! | file | question it answers |
//! |---|---|
//! | `host_dir` | what does every host of a run write? |
//! | `checksums` | is a run complete and unchanged? |
//! | `chained` | which lines of a file are unchanged? |
//! | `own_file` | how is an existing file opened for writing? |
//! | `reserved` | how is a small file written when the disk is full? |
//! | `programs` | which external programs do robots run? |
//! | `manifest` | what was run, where and how? |
//! | `usage` | which resources did a process use? |
//! | `compare` | are two runs equal, and where do they differ first? |
//! | `date` | how are dates computed and formatted? |
//! | `page` | how does a run directory become figures and a page? |

pub mod chained;
pub mod checksums;
pub mod compare;
pub mod date;
pub mod host_dir;
pub mod manifest;
pub mod own_file;
pub mod page;
pub mod programs;
pub(crate) mod reserved;
pub mod usage;
