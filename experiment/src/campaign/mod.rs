//! A campaign: many runs of one scenario, as its file says.
//!
//! | file | question it answers |
//! |---|---|
//! | `keys` | THE table: which keys does a campaign file have? |
//! | `file` | what does a campaign file say, and where does it go wrong? |
//! | `axes` | which values does a key take? |
//! | `starts` | where does a seed start the robots? |
//! | `cells` | which runs are there, and what is each one's identity? |

pub mod axes;
pub mod cells;
pub mod file;
pub mod keys;
pub mod starts;
