//! The verbs of `phalanx`, for its own binary and for programs that bring laws, methods or roles of
//! their own; its own command line, for its documentation; and a run within one process, for training.

pub mod command_line;
pub mod in_process;
pub mod pool;
pub mod roles;
pub mod verbs;
