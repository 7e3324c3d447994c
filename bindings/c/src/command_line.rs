//! Command line with which a robot's program is started.

use std::ffi::OsString;
use std::path::PathBuf;

/// Hint after a usage error, for a program that was started manually.
pub const MANUAL_START_HINT: &str = "`phalanx run SCENARIO` starts it if the scenario names it: \
                              [laws.NAME] program = [\"./my_law\"].";

/// Returns a command line without the program's own arguments, which stand before those that `phalanx run` adds:
/// the brief, `--incarnation N`, and perhaps `--realtime-priority`.
pub fn strip_own_arguments(arguments: Vec<OsString>) -> Vec<OsString> {
    let is_last = arguments.last().is_some_and(|argument| argument == "--realtime-priority");
    let end = arguments.len() - usize::from(is_last);
    match end.checked_sub(3) {
        Some(begin) if begin > 0 && arguments[begin + 1] == "--incarnation" => {
            [&arguments[..1], &arguments[begin..]].concat()
        }
        _ => arguments,
    }
}

/// Arguments that `phalanx run` passes to a program.
#[derive(Debug, clap::Parser)]
pub struct Arguments {
    /// Path of the robot's brief.
    pub brief: PathBuf,
    /// Number of earlier starts of the robot's process.
    #[arg(long, default_value_t = 0)]
    pub incarnation: u64,
    /// Run with SCHED_FIFO priority.
    #[arg(long)]
    pub realtime_priority: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser as _;

    #[test]
    fn own_arguments_of_a_program_are_ignored() {
        let brief = "/runs/x/briefs/r2.toml";
        for more in [&[][..], &["--realtime-priority"]] {
            for own in [&[][..], &["--model", "big.pt"], &["--incarnation", "7", "a"]] {
                let arguments =
                    [&["./law"][..], own, &[brief, "--incarnation", "3"], more].concat();
                let arguments =
                    strip_own_arguments(arguments.into_iter().map(OsString::from).collect());
                let arguments = Arguments::try_parse_from(arguments).unwrap();
                assert_eq!((arguments.brief.to_str(), arguments.incarnation), (Some(brief), 3));
                assert_eq!(arguments.realtime_priority, !more.is_empty());
            }
        }
        let by_hand = ["./law", "r2.toml"].map(OsString::from).to_vec();
        assert_eq!(strip_own_arguments(by_hand.clone()), by_hand);
        assert_eq!(strip_own_arguments(Vec::new()), Vec::<OsString>::new());
    }
}
