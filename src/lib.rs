//! The verbs of `phalanx`, for its own binary and for programs that bring laws, methods or roles of
//! their own; and its own command line, for its documentation.

pub mod command_line;
pub mod roles;
pub mod verbs;
