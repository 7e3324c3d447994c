//! README and book: what they show runs and does what they say.
//!
//! `book` follows the pages, and `reference` compares lists with what there is. The others are about
//! `docs/add-*.md`, whose code, word for word, compiles: each module stands in for the `mod.rs` that
//! its page adds a row to; the files that the page shows are in the folder of the same name.

use agent::avoidance::{AvoidanceRow, METHODS};
use agent::controller::{Controller, Parts};
use agent::laws::{LAWS, LawRow};
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::read::{Overrides, read};
use outcome::metrics::Measures;

use crate::harness::ROOT;
use crate::oracle;

mod avoidance;
pub mod book;
mod law;
mod reference;
mod role;
mod tutorial;

/// The blocks of Rust in a page, in order.
fn blocks(page: &str) -> Vec<&str> {
    let starts = page.split("```rust\n").skip(1);
    starts.map(|rest| rest.split("```").next().expect("an end")).collect()
}

/// That a page's block with a row in it stands in `here`, and the list that it adds to in `there`.
#[track_caller]
fn assert_row(block: &str, here: &str, there: &str) {
    assert!(here.contains(block), "not in the test: {block}");
    let (list, _) = block.rsplit_once(" = ").expect("a list");
    let list = list.lines().last().unwrap();
    assert!(there.contains(list), "the list is not there: {list}");
}

/// A build of the program with the rows of a page beside those of the house.
#[derive(Default)]
struct Build {
    laws: Vec<LawRow>,
    methods: Vec<AvoidanceRow>,
}

impl Build {
    /// A scenario by its path below the repository's root, with these keys set and these faults.
    fn read(&self, path: &str, set: &[&str], faults: &[&str]) -> Result<Scenario, Diagnostic> {
        let mut catalog = agent::catalog();
        catalog.laws.extend(self.laws.iter().map(LawRow::description));
        catalog.methods.extend(self.methods.iter().map(|row| row.description));
        let owned = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect();
        let overrides = Overrides { set: owned(set), faults: owned(faults), seed: None };
        let path = std::path::Path::new(ROOT).join(path);
        read(&path, &overrides, &catalog).map(|(scenario, ..)| scenario)
    }

    fn simulate(&self, scenario: &Scenario) -> Measures {
        oracle::simulate_with(scenario, &|brief, incarnation| {
            let law = LAWS.iter().chain(&self.laws).find(|row| row.name == brief.law);
            let mut methods = METHODS.iter().chain(&self.methods);
            let method = methods.find(|row| row.description.name == brief.avoidance.kind);
            let law = law.expect("a law");
            let parts = Parts {
                role: law.role.make(brief).unwrap(),
                law: law.make(&brief.gains).unwrap(),
                avoidance: method.expect("a method").make(brief).unwrap(),
            };
            Controller::with_parts(brief, incarnation, parts)
        })
    }
}

#[track_caller]
fn sound(read: Result<Scenario, Diagnostic>) -> Scenario {
    read.unwrap_or_else(|error| panic!("{}", error.render(false)))
}
