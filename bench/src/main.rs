//! `phalanx-bench`: the benchmarks, and every process role of the measured runs, so that all measured code
//! is in one executable.

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
    // Other arguments are those of a measured run and of its processes.
    let own = |word: &str| word.starts_with('-') || word == cli::PEER;
    ExitCode::from(match env::args().nth(1).is_none_or(|word| own(&word)) {
        true => cli::main(&CommandLine::parse()),
        false => roles::main(phalanx::command_line::CommandLine::parse().role),
    })
}
