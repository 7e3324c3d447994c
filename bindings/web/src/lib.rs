//! Lockstep runs as a library without processes, files or clock, with text as input and output. In a browser it
//! is WebAssembly; on other targets the program `run-hash`.
//!
//! | file | content |
//! |---|---|
//! | `engine` | requests about a run, and their responses |
//! | `abi` | WebAssembly interface of a page |
//!
//! The run is the same as that of `phalanx run --pace lockstep`: the crate `run` composes the control cycles
//! of `agent/` and the simulation steps of `plant/`. Must not: contain a second agent, plant or metrics.

mod abi;
pub mod engine;
