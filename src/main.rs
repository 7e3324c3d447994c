//! `phalanx`: one binary for every role. What it does is in the crates; here the roles are told
//! apart, the verbs are one file each, and the supervisor learns what the agents know.

use std::io::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use phalanx::command_line::CommandLine;
use phalanx::roles;
use protocol::process::{Stderr, drain_stderr, exit};

/// Maximum time for which the end of the process waits for a reader of stderr that takes nothing.
const UNREAD_MAX: Duration = Duration::from_secs(1);

fn main() -> ExitCode {
    if let Err(error) = supervisor::child::obey_parent() {
        let _ = writeln!(Stderr, "error: cannot start as a child: {error}");
        return ExitCode::from(exit::INFRASTRUCTURE);
    }
    let code = roles::main(CommandLine::read().role);
    drain_stderr(UNREAD_MAX);
    ExitCode::from(code)
}
