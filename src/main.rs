//! `phalanx`: one binary for every role. What it does is in the crates; here the roles are told
//! apart, the verbs are one file each, and the supervisor learns what the agents know.

use std::io::Write as _;
use std::process::ExitCode;

use phalanx::command_line::CommandLine;
use phalanx::roles;
use protocol::process::{Stderr, exit};

fn main() -> ExitCode {
    if let Err(error) = supervisor::child::obey_parent() {
        let _ = writeln!(Stderr, "error: cannot start as a child: {error}");
        return ExitCode::from(exit::INFRASTRUCTURE);
    }
    ExitCode::from(roles::main(CommandLine::read().role))
}
