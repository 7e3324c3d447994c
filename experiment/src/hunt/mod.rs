//! A search for the run that misses an expectation. Pure: it says which runs to try next, and is told how near each
//! came to a miss.
//!
//! | file | question it answers |
//! |---|---|
//! | `plan` | who starts where, what breaks, and with which gains, in one run? |
//! | `space` | which run does a point of the unit cube stand for? |
//! | `search` | which points are tried next? |
//! | `cma` | where does CMA-ES look, given what it found? |
//! | `shrink` | which simpler runs are tried in place of one? |

mod cma;
pub mod plan;
pub mod search;
pub mod shrink;
pub mod space;
