//! Subcommands of `phalanx`, for its own binary and for programs that add control laws, avoidance methods
//! or roles. Also holds the command-line definition, for documentation, and runs within one process, for
//! training.

pub mod command_line;
pub mod in_process;
pub mod pool;
pub mod roles;
pub mod verbs;
