//! Subcommands of `phalanx`, for its own binary and for programs that add control laws, avoidance methods
//! or roles. Also holds the command-line definition, for documentation.

pub mod command_line;
pub mod pool;
pub mod roles;
pub mod verbs;
