//! Phalanx's lockstep runs as a library without processes, files or clock: text in, text out. In a browser it is
//! WebAssembly; on other targets the program `run-hash`.
//!
//! | file | question it answers |
//! |---|---|
//! | `engine` | what may be asked of a run, and what is the answer? |
//! | `abi` | how does a page ask? |
//!
//! The run is the same as that of `phalanx run --pace lockstep`: the turns are those of `agent/` and `plant/`, composed
//! by `src/in_process.rs`. Must not: have a second agent, plant or measure.

mod abi;
pub mod engine;
// The composition of the turns, which is the program's; its own package needs iceoryx2.
#[allow(dead_code, unreachable_pub)]
#[path = "../../../src/in_process.rs"]
mod in_process;
