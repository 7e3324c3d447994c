//! Entry point of `phalanx`, one binary for every process role. The work is done in the crates; this
//! package dispatches to roles and subcommands, and passes the agent's catalog to the supervisor.

use std::io::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use phalanx::command_line::CommandLine;
use phalanx::roles;
use protocol::process::{Stderr, drain_stderr, exit};

/// Maximum time to wait at exit for a reader of stderr that does not read.
const STDERR_DRAIN_TIMEOUT: Duration = Duration::from_secs(1);

fn main() -> ExitCode {
    if let Err(error) = supervisor::child::prepare_process() {
        let _ = writeln!(Stderr, "error: cannot start as a child: {error}");
        return ExitCode::from(exit::INFRASTRUCTURE_FAILURE);
    }
    let code = roles::main(CommandLine::read().role);
    drain_stderr(STDERR_DRAIN_TIMEOUT);
    ExitCode::from(code)
}
