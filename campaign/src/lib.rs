//! Campaigns: many runs of one scenario, what came of them, and with which confidence that can be
//! said.
//!
//! | file | question it answers |
//! |---|---|
//! | `keys` | THE table: which keys does a campaign file have? |
//! | `file` | what does a campaign file say, and where does it go wrong? |
//! | `axes` | which values does a key take? |
//! | `starts` | where does a seed start the robots? |
//! | `cells` | which runs are there, and what is each one's identity? |
//! | `folder` | which of them are done, given up, missing? |
//! | `pool` | how are the missing ones run? |
//! | `table` | what is in `runs.csv` and `timing.csv`? |
//! | `statistics` | what does a sample say, and with which confidence? |
//! | `points` | what came of each point of the grid, and of pairs of them? |
//! | `figures` `page` | how is that shown? |
//!
//! Must not: start a robot. Each run is a `phalanx run` of its own, or whatever whoever calls the pool does
//! for one.

pub mod axes;
pub mod cells;
pub mod figures;
pub mod file;
pub mod folder;
pub mod keys;
pub mod page;
pub mod points;
pub mod pool;
pub mod starts;
pub mod statistics;
pub mod table;
