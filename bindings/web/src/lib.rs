//! Lockstep runs as a library without processes, files or clock, with text as input and output. In a browser it
//! is WebAssembly; on other targets the program `run-hash`.
//!
//! | file | content |
//! |---|---|
//! | `engine` | requests about a run, and their responses |
//! | `abi` | WebAssembly interface of a page |
//!
//! The run is the same as that of `phalanx run --pace lockstep`: `src/in_process.rs` composes the control cycles
//! of `agent/` and the simulation steps of `plant/`. Must not: contain a second agent, plant or metrics.

mod abi;
pub mod engine;
// In-process runs of the package `phalanx`, which cannot be a dependency because it needs iceoryx2.
#[allow(dead_code, unreachable_pub)]
#[path = "../../../src/in_process.rs"]
mod in_process;
