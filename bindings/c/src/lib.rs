//! The C ABI of the agent: of every robot's agent, with a law that is a C function.
//!
//! | file | question it answers |
//! |---|---|
//! | `abi` | what does a C program see and call? `include/phalanx.h` is made of it |
//! | `law` | how is a C function asked? |
//! | `words` | which robot does the command line name? |

mod abi;
mod law;
mod words;

pub use abi::*;
