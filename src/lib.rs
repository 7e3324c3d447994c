//! The verbs of `phalanx`, for its own binary and for programs that bring laws, methods or roles of
//! their own.

pub mod verbs;
