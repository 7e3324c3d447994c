//! `phalanx-bench`: the measurements, and every role of the runs that are measured, so that what is
//! measured is in one executable.

use std::env;
use std::io::Write as _;
use std::process::ExitCode;

use bench::cli::{self, CommandLine};
use clap::Parser as _;
use phalanx::roles;
use protocol::process::{Stderr, exit};

fn main() -> ExitCode {
    if let Err(error) = supervisor::child::obey_parent() {
        let _ = writeln!(Stderr, "error: cannot start as a child: {error}");
        return ExitCode::from(exit::INFRASTRUCTURE);
    }
    // Other words are those of a run that is measured, and of its processes.
    let own = |word: &str| word.starts_with('-') || word == cli::PEER;
    ExitCode::from(match env::args().nth(1).is_none_or(|word| own(&word)) {
        true => cli::main(&CommandLine::parse()),
        false => roles::main(phalanx::command_line::CommandLine::parse().role),
    })
}
