//! A file becomes an experiment: read, found sound or refused, and what theory says about it.
//!
//! Pure: no processes, no clock, no iceoryx2. It reads files and writes none.
//!
//! | file | question it answers |
//! |---|---|
//! | `scenario/` | what is the experiment, and where does its file go wrong? |
//! | `check/` | is it sound, and what can be said about it before it runs? |
//! | `prediction/` | whom does a death or a cut break, and why? |
//! | `schema` | how is the format told to editors and other programs? |
//! | `reference` | how is it told to people? |
//! | `drawing` | what does its graph look like? |
//! | `campaign/` | which runs is a campaign made of? |
//! | `hunt/` | which runs does a hunt try next? |
//! | `briefs` | what is each process told? |
//! | `examples` | a small experiment for tests |

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod briefs;
pub mod campaign;
pub mod check;
pub mod drawing;
pub mod examples;
pub mod hunt;
pub mod prediction;
pub mod reference;
pub mod scenario;
pub mod schema;
