//! Experiments: parsing and validation of scenario files, and their theoretical analysis.
//!
//! Pure: no processes, no clock, no iceoryx2. The crate reads files and writes none.
//!
//! | file | question it answers |
//! |---|---|
//! | `scenario/` | what is the experiment, and where does its file have errors? |
//! | `check/` | is it valid, and what is known about it before it runs? |
//! | `prediction/` | which robots does a failure of a robot or link break, and why? |
//! | `schema` | which JSON Schema describes the format? |
//! | `reference` | which reference page describes the format? |
//! | `drawing` | how is its graph drawn? |
//! | `campaign/` | which runs does a campaign consist of? |
//! | `hunt/` | which runs does a hunt try next? |
//! | `briefs` | what is the configuration of each process? |
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
