//! Runs on several hosts: the tasks of the plant's host and of the other hosts.
//!
//! The plant's host makes all decisions. It sends the wanted state of each process to the host of that
//! process, and receives the actual state. Both are sent repeatedly, so that each message may be lost. The
//! robots do not depend on these messages.
//!
//! | file | contents |
//! |---|---|
//! | `remote` | a robot of another host, as seen by the plant's host |
//! | `coordinator` | the plant's host: gathers, watches and releases the others |
//! | `share` | the supervisor of another host |

pub(crate) mod coordinator;
pub(crate) mod remote;
pub mod share;
