//! `phalanx-manual DIR`: writes the manual pages and shell completions of `phalanx`, generated from its
//! command line. Requires the feature `manual`: `cargo run --features manual --bin phalanx-manual -- DIR`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::CommandFactory as _;
use clap_complete::Shell;
use phalanx::command_line::CommandLine;

fn main() -> ExitCode {
    let mut args = std::env::args_os().skip(1);
    let (Some(directory), None) = (args.next(), args.next()) else {
        print_error("usage: phalanx-manual DIR");
        return ExitCode::from(2);
    };
    match write_manual(directory.into()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            print_error(&error.to_string());
            ExitCode::FAILURE
        }
    }
}

fn write_manual(directory: PathBuf) -> std::io::Result<()> {
    let (man, completions) = (directory.join("man1"), directory.join("completions"));
    std::fs::create_dir_all(&man)?;
    std::fs::create_dir_all(&completions)?;
    clap_mangen::generate_to(CommandLine::command(), &man)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        clap_complete::generate_to(shell, &mut CommandLine::command(), "phalanx", &completions)?;
    }
    Ok(())
}

#[allow(clippy::print_stderr, reason = "a program of its own")]
fn print_error(error: &str) {
    eprintln!("error: {error}");
}
