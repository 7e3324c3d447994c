//! What becomes of a run: measured, recorded, judged and told.
//!
//! | folder | question it answers |
//! |---|---|
//! | `metrics/` | what is a run judged by? |
//! | `recording/` | how does it become a recording that other tools open? |
//! | `report/` | what do people look at? |
//! | `results/` | what is in its directory, written and read? |
//! | `campaign/` | what came of many runs, and with which confidence? |
//! | `hunt` | what has a hunt tried? |
//!
//! Without the feature `files` there are `metrics/`, the picture in the plane, and, in memory, the tables and the summary.
//!
//! Must not: start, signal or wait for a process, know iceoryx2, or decide anything about a run.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[cfg(feature = "files")]
pub mod campaign;
#[cfg(feature = "files")]
pub mod hunt;
pub mod metrics;
#[cfg(feature = "files")]
pub mod recording;
pub mod report;
pub mod results;
