//! The command line that a robot's program is started with.

use std::ffi::{CStr, OsStr};
use std::os::unix::ffi::OsStrExt as _;
use std::path::PathBuf;

/// What `phalanx run` says to a program: `PROGRAM BRIEF --incarnation N`, and `--realtime-priority`.
#[derive(Debug, PartialEq)]
pub struct Words {
    /// The robot's brief.
    pub brief: PathBuf,
    /// How often this robot's process was started before.
    pub incarnation: u64,
    /// Whether it is to run before every ordinary process.
    pub realtime_priority: bool,
}

impl Words {
    /// Those given, the program's own name first; or how to use it.
    pub fn of<'a>(given: impl IntoIterator<Item = &'a CStr>) -> Result<Words, String> {
        let mut given = given.into_iter();
        let name = given.next().map_or("PROGRAM".into(), CStr::to_string_lossy);
        let usage = |why: &str| {
            format!(
                "error: {why}\nusage: {name} BRIEF [--incarnation N] [--realtime-priority]\n\
                 `phalanx run SCENARIO` starts it, where the scenario names it: \
                 [laws.NAME] program = [\"./my_law\"].\n"
            )
        };
        let (mut brief, mut incarnation, mut realtime_priority) = (None, 0, false);
        while let Some(word) = given.next() {
            match word.to_bytes() {
                b"--realtime-priority" => realtime_priority = true,
                b"--incarnation" => {
                    let number = given.next().map(CStr::to_string_lossy).unwrap_or_default();
                    let wrong = || usage(&format!("--incarnation {number:?} is no number"));
                    incarnation = number.parse().map_err(|_| wrong())?;
                }
                path if brief.is_none() && !path.starts_with(b"-") => {
                    brief = Some(PathBuf::from(OsStr::from_bytes(path)));
                }
                other => {
                    let other = String::from_utf8_lossy(other);
                    return Err(usage(&format!("unexpected argument {other:?}")));
                }
            }
        }
        let brief = brief.ok_or_else(|| usage("no brief of a robot is given"))?;
        Ok(Words { brief, incarnation, realtime_priority })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(given: &[&CStr]) -> Result<Words, String> {
        Words::of([&[c"./law"], given].concat())
    }

    #[test]
    fn the_words_of_a_supervisor_name_brief_incarnation_and_priority() {
        let brief = PathBuf::from("/run/briefs/r3.toml");
        let all = [c"/run/briefs/r3.toml", c"--incarnation", c"2", c"--realtime-priority"];
        let found = Words { brief: brief.clone(), incarnation: 2, realtime_priority: true };
        assert_eq!(words(&all), Ok(found));
        let found = Words { brief, incarnation: 0, realtime_priority: false };
        assert_eq!(words(&all[..1]), Ok(found));
    }

    #[test]
    fn other_words_are_answered_with_how_to_use_it() {
        for (given, why) in [
            (&[][..], "no brief of a robot is given"),
            (&[c"--help"], "unexpected argument \"--help\""),
            (&[c"a", c"b"], "unexpected argument \"b\""),
            (&[c"a", c"--incarnation"], "--incarnation \"\" is no number"),
        ] {
            let said = words(given).unwrap_err();
            assert!(said.starts_with(&format!("error: {why}\nusage: ./law BRIEF")), "{said}");
        }
    }
}
