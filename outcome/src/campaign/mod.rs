//! Results of a campaign: folder of runs, tables, statistics, figures and page.
//!
//! | file | question it answers |
//! |---|---|
//! | `folder` | which runs are complete, given up or missing? |
//! | `table` | what is in `runs.csv` and `timing.csv`? |
//! | `statistics` | how are rates, medians and intervals computed? |
//! | `points` | what are the results of each grid point, and of pairs of points? |
//! | `hunt_journal` | which runs has a hunt evaluated? |
//! | `figures` `page` | how are the results shown? |

pub mod figures;
pub mod folder;
pub mod hunt_journal;
pub mod page;
pub mod points;
pub mod statistics;
pub mod table;
