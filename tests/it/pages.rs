//! Tests of README and book: their commands run and have the documented results.
//!
//! `book` follows the pages, and `reference` compares lists with the program. The others compile the code of
//! `docs/add-*.md` verbatim: each module replaces the `mod.rs` to which its page adds a row; the files that the page
//! shows are in the folder of the same name.

use std::sync::Arc;

use agent::avoidance::{AvoidanceRow, METHODS};
use agent::controller::{Controller, Parts};
use agent::laws::{LAWS, LawRow};
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::read::{Overrides, read};
use outcome::metrics::RunMetrics;
use protocol::brief::AgentBrief;

use crate::harness::ROOT;
use crate::oracle;

mod avoidance;
pub mod book;
mod law;
mod reference;
mod role;
mod tutorial;

/// Returns the Rust blocks of a page, in order.
fn blocks(page: &str) -> Vec<&str> {
    let starts = page.split("```rust\n").skip(1);
    starts.map(|rest| rest.split("```").next().expect("an end")).collect()
}

/// Asserts that a page's block with a table row occurs in `test_source`, and that the extended list occurs in
/// `agent_source`.
#[track_caller]
fn assert_row(block: &str, test_source: &str, agent_source: &str) {
    assert!(test_source.contains(block), "the test does not contain the block: {block}");
    let (list, _) = block.rsplit_once(" = ").expect("a list");
    let list = list.lines().last().unwrap();
    assert!(agent_source.contains(list), "the source has no such list: {list}");
}

/// A build of the program with the rows of a page in addition to the built-in rows.
#[derive(Clone, Default)]
struct Build {
    laws: Arc<[LawRow]>,
    methods: Arc<[AvoidanceRow]>,
}

impl Build {
    /// Reads a scenario by its path relative to the repository root, with these keys and faults.
    fn read(&self, path: &str, set: &[&str], faults: &[&str]) -> Result<Scenario, Diagnostic> {
        let mut catalog = agent::catalog();
        catalog.laws.extend(self.laws.iter().map(LawRow::description));
        catalog.methods.extend(self.methods.iter().map(|row| row.description));
        let owned =
            |arguments: &[&str]| arguments.iter().map(|&argument| argument.to_owned()).collect();
        let overrides = Overrides { assignments: owned(set), faults: owned(faults), seed: None };
        let path = std::path::Path::new(ROOT).join(path);
        read(&path, &overrides, &catalog).map(|(scenario, ..)| scenario)
    }

    fn simulate(&self, scenario: &Scenario) -> RunMetrics {
        let build = self.clone();
        let make_controller = move |brief: &AgentBrief, incarnation| {
            let law = LAWS.iter().chain(&*build.laws).find(|row| row.name == brief.law);
            let mut methods = METHODS.iter().chain(&*build.methods);
            let method = methods.find(|row| row.description.name == brief.avoidance.kind);
            let law = law.expect("a law");
            let parts = Parts {
                role: law.role.make(brief).unwrap(),
                law: law.make(&brief.gains).unwrap(),
                avoidance: method.expect("a method").make(brief).unwrap(),
            };
            Controller::with_parts(brief, incarnation, parts)
        };
        oracle::simulate_with(scenario, Box::new(make_controller))
    }
}

#[track_caller]
fn expect_valid(read: Result<Scenario, Diagnostic>) -> Scenario {
    read.unwrap_or_else(|error| panic!("{}", error.render(false)))
}
