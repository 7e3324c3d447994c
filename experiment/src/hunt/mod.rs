//! Falsification (hunt): search for a run that misses an expectation. Pure: the caller runs the proposed runs and
//! reports the margin of each.
//!
//! | file | question it answers |
//! |---|---|
//! | `plan` | which starts, faults and gains does one run have? |
//! | `space` | which run does a point of the unit cube decode to? |
//! | `search` | which points are tried next? |
//! | `cma` | which points does CMA-ES propose? |
//! | `shrink` | which simpler variants of a run are tried? |

mod cma;
pub mod plan;
pub mod search;
pub mod shrink;
pub mod space;
