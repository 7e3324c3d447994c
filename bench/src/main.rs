//! Program `phalanx-bench`: the measurements and all process roles of the measured runs, so that one executable
//! contains everything that is measured.

use std::env;
use std::io::Write as _;
use std::process::ExitCode;

use bench::cli::{self, CommandLine};
use bench::messages::MESSAGE_LAW;
use clap::Parser as _;
use phalanx::roles;
use protocol::process::{Stderr, exit};

fn main() -> ExitCode {
    if let Err(error) = supervisor::child::prepare_process() {
        let _ = writeln!(Stderr, "error: cannot start as a child: {error}");
        return ExitCode::from(exit::INFRASTRUCTURE_FAILURE);
    }
    // Any other first argument belongs to a measured run or one of its processes.
    let is_own = |argument: &str| argument.starts_with('-') || argument == cli::PEER_SUBCOMMAND;
    ExitCode::from(match env::args().nth(1).is_none_or(|argument| is_own(&argument)) {
        true => cli::main(&CommandLine::parse()),
        false => {
            let role = phalanx::command_line::CommandLine::parse().role;
            roles::main_with_laws(role, &[MESSAGE_LAW])
        }
    })
}
