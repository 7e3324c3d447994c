//! `docs/tutorial/law.md`: the law that `phalanx new` writes, built in and compared.

use std::sync::Arc;

use agent::laws::{Gains, Law, LawRow, Situation};
use agent::roles::FORMATION_ROLE;
use outcome::report::digits::format_four_digits;

use super::{Build, assert_row, blocks, expect_valid};

#[path = "../../../src/verbs/new/law.rs"]
mod my_law;

pub const LAWS: &[LawRow] = &[my_law::LAW, formation_unit::LAW /* and the others */];

/// A built-in law, in its original file.
mod formation_unit {
    use agent::laws::{LAWS, LawRow};

    pub(super) const LAW: LawRow = LawRow { ..LAWS[0] };
}

const PAGE: &str = include_str!("../../../docs/tutorial/law.md");
const SCENARIO: &str = include_str!("../../../docs/tutorial/scenario.md");

#[test]
fn page_shows_the_generated_and_tested_law() {
    let [file, row] = blocks(PAGE)[..] else { panic!("the page has other blocks than this test") };
    assert_eq!(file, include_str!("../../../src/verbs/new/law.rs"));
    assert_row(row, include_str!("tutorial.rs"), include_str!("../../../agent/src/laws/mod.rs"));
    assert_eq!(LAWS.len(), 2);
}

#[test]
fn both_laws_behave_as_documented() {
    // The scenario of the preceding page.
    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("vee.toml");
    let (_, text) = SCENARIO.split_once("```toml\n").unwrap();
    std::fs::write(&path, text.split("```").next().unwrap()).unwrap();
    let build = Build { laws: Arc::new([my_law::LAW]), ..Build::default() };
    let commands = PAGE.lines().filter(|line| line.starts_with("phalanx run "));
    let errors: Vec<String> = commands
        .map(|command| {
            let command = command.replace('\'', "");
            let assignments = command.split("--set ").skip(1);
            let set: Vec<&str> =
                assignments.filter_map(|assignment| assignment.split_whitespace().next()).collect();
            let scenario = expect_valid(build.read(path.to_str().unwrap(), &set, &[]));
            let measured = build.simulate(&scenario);
            assert!(measured.min_distance_m.unwrap() >= 0.3, "{command}");
            format_four_digits(measured.final_error_m_max.unwrap())
        })
        .collect();
    let [tanh, mine] = &errors[..] else { panic!("two runs") };
    for (law, error) in [("formation-tanh", tanh), ("my-law", mine)] {
        let row = format!("| `{law}` | {error} |");
        assert!(PAGE.contains(&row), "the page has other rows than {row}, of {errors:?}");
    }
}
