//! Campaigns (parameter studies): many runs of one scenario.
//!
//! | file | question it answers |
//! |---|---|
//! | `keys` | which keys does a campaign file have? |
//! | `file` | what is in a campaign file, and where are its errors? |
//! | `axes` | which values does an axis have? |
//! | `starts` | which start poses does a seed draw? |
//! | `cells` | which runs are there, and what is the identity of each? |

pub mod axes;
pub mod cells;
pub mod file;
pub mod keys;
pub mod starts;
