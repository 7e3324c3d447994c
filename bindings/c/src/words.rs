//! Command line with which a robot's program is started.

use std::ffi::OsString;
use std::path::PathBuf;

/// Hint after a usage error, for a program that was started manually.
pub const STARTED_BY: &str = "`phalanx run SCENARIO` starts it, where the scenario names it: \
                              [laws.NAME] program = [\"./my_law\"].";

/// Returns a command line without the program's own arguments, which stand before those that `phalanx run` adds:
/// the brief, `--incarnation N`, and perhaps `--realtime-priority`.
pub fn without_own(words: Vec<OsString>) -> Vec<OsString> {
    let is_last = words.last().is_some_and(|word| word == "--realtime-priority");
    let end = words.len() - usize::from(is_last);
    match end.checked_sub(3) {
        Some(begin) if begin > 0 && words[begin + 1] == "--incarnation" => {
            [&words[..1], &words[begin..]].concat()
        }
        _ => words,
    }
}

/// Arguments that `phalanx run` passes to a program.
#[derive(Debug, clap::Parser)]
pub struct Words {
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
                let words = [&["./law"][..], own, &[brief, "--incarnation", "3"], more].concat();
                let words = without_own(words.into_iter().map(OsString::from).collect());
                let words = Words::try_parse_from(words).unwrap();
                assert_eq!((words.brief.to_str(), words.incarnation), (Some(brief), 3));
                assert_eq!(words.realtime_priority, !more.is_empty());
            }
        }
        let by_hand = ["./law", "r2.toml"].map(OsString::from).to_vec();
        assert_eq!(without_own(by_hand.clone()), by_hand);
        assert_eq!(without_own(Vec::new()), Vec::<OsString>::new());
    }
}
