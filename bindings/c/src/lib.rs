//! C interface of the agent, with a control law that is a C function.
//!
//! | file | content |
//! |---|---|
//! | `abi` | functions and types that a C program uses; source of `include/phalanx.h` |
//! | `law` | calls of a C function as a law |
//! | `words` | command line |

mod abi;
mod law;
mod words;

pub use abi::*;
