//! Micro benches: what one call of the pure parts costs. `cargo bench -p bench` times them by divan,
//! and `bench/instructions` counts their instructions, which no other load changes.
//!
//! The same bodies for both: see `cases`. Nothing is asserted here.

mod cases;

use std::io::{self, Write as _};
use std::process::ExitCode;

use divan::Bencher;

#[divan::bench(args = cases::all().into_iter().map(|case| case.name))]
fn call(bencher: Bencher<'_, '_>, name: &str) {
    let body = cases::start(name).expect("a case by its own name");
    bencher.bench_local(body);
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    match words[..] {
        ["cases"] => {
            for case in cases::all() {
                // A reader that went away wants no more.
                let _ = writeln!(io::stdout(), "{}", case.name);
            }
        }
        ["count", name, calls] => {
            let (Some(mut body), Ok(calls)) = (cases::start(name), calls.parse::<u64>()) else {
                let found = format!("got case {name:?}, calls {calls:?}");
                let _ = writeln!(io::stderr(), "error: expected `count CASE CALLS`, {found}");
                return ExitCode::from(2);
            };
            (0..calls).for_each(|_| body());
        }
        _ => divan::main(),
    }
    ExitCode::SUCCESS
}
