//! What came of a campaign's runs, and with which confidence that can be said.
//!
//! | file | question it answers |
//! |---|---|
//! | `folder` | which runs are done, given up, missing? |
//! | `table` | what is in `runs.csv` and `timing.csv`? |
//! | `statistics` | what does a sample say, and with which confidence? |
//! | `points` | what came of each point of the grid, and of pairs of them? |
//! | `figures` `page` | how is that shown? |

pub mod figures;
pub mod folder;
pub mod page;
pub mod points;
pub mod statistics;
pub mod table;
