//! C interface of the agent, with a control law that is a C function.
//!
//! | file | content |
//! |---|---|
//! | `abi` | functions and types that a C program uses; source of `include/phalanx.h` |
//! | `law` | calls of a C function as a law |
//! | `outbox` | messages, targets and signals of a law |
//! | `command_line` | command line |

mod abi;
mod command_line;
mod law;
mod outbox;

pub use abi::*;
