//! Runs scenarios in lockstep within this process. Prints a line for each, with its name, its trajectory hash,
//! and the hashes of its tables. With `--text` it prints the effective scenarios instead.

use std::path::Path;
use std::process::ExitCode;

use phalanx_web::engine::Engine;

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let text = arguments
        .iter()
        .position(|argument| argument == "--text")
        .map(|position| arguments.remove(position))
        .is_some();
    if arguments.is_empty() {
        eprintln!("usage: run-hash [--text] SCENARIO...");
        return ExitCode::from(2);
    }
    for path in arguments.iter().map(Path::new) {
        let mut engine = match Engine::from_file(path) {
            Ok(engine) => engine,
            Err(why) => {
                eprint!("{why}");
                return ExitCode::from(3);
            }
        };
        if text {
            print!("{}", engine.text());
            continue;
        }
        engine.advance(u64::MAX);
        let results = engine.left().expect("it was left nowhere yet");
        println!("{} {}", path.file_stem().unwrap_or_default().display(), results.digest());
    }
    ExitCode::SUCCESS
}
