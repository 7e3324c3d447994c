//! Results of runs: metrics, recordings, result files, reports, and campaign statistics.
//!
//! | folder | question it answers |
//! |---|---|
//! | `metrics/` | how is a run measured and evaluated? |
//! | `recording/` | how is a run recorded as MCAP for other tools? |
//! | `report/` | what do the screen and the report page show? |
//! | `results/` | which files does a run directory hold, and how are they written and read? |
//! | `campaign/` | what do many runs, or those of a hunt, show, and with which confidence? |
//! | `columns` | how are the columns of a table declared? |
//! | `quantities` | how are the quantities of a summary declared? |
//!
//! Without the feature `files` the crate has `metrics/`, the plane picture, and the tables and summary in memory.
//!
//! Must not: start, signal or wait for a process, depend on iceoryx2, or decide anything about a run.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[cfg(feature = "files")]
pub mod campaign;
pub mod columns;
pub mod metrics;
pub mod quantities;
#[cfg(feature = "files")]
pub mod recording;
pub mod report;
pub mod results;
