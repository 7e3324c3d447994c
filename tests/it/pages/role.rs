//! `docs/add-a-role.md`.

use std::sync::Arc;

use agent::laws::{LAWS, LawRow, NeighborEstimate};
use agent::roles::{Role, RoleInput, RoleRow};

use super::{Build, blocks, expect_valid};
use crate::oracle;

mod contained_fresh;

pub use self::contained_fresh::CONTAINED_FRESH;

const PAGE: &str = include_str!("../../../docs/add-a-role.md");

/// Returns the row of the containment law with the page's role.
fn fresh() -> LawRow {
    let law = LAWS.iter().find(|row| row.name == "containment-tanh").expect("a law");
    LawRow { name: "containment-fresh", role: CONTAINED_FRESH, ..*law }
}

/// Returns the trajectory hash of the first seconds of the third case with these faults and the page's role.
fn hash(faults: &[&str]) -> Option<String> {
    let build = Build { laws: Arc::new([fresh()]), ..Build::default() };
    let set = ["r1", "r2", "r3", "r4"].map(|robot| format!("robot.{robot}.law=containment-fresh"));
    let set: Vec<&str> = SHORT_RUN.into_iter().chain(set.iter().map(String::as_str)).collect();
    build
        .simulate(&expect_valid(build.read("scenarios/containment.toml", &set, faults)))
        .trajectory_hash
}

const SHORT_RUN: [&str; 2] = ["duration_s=4", "expect={}"];

#[test]
fn page_shows_the_tested_role() {
    let [file, row] = blocks(PAGE)[..] else { panic!("the page has other blocks than this test") };
    assert_eq!(file, include_str!("role/contained_fresh.rs"));
    assert!(include_str!("role.rs").contains(row), "{row}");
}

#[test]
fn page_role_moves_like_contained_robots_until_stale() {
    let built_in_hash = |faults: &[&str]| {
        oracle::simulate(&oracle::with_faults("containment", &SHORT_RUN, faults)).trajectory_hash
    };
    assert_eq!(hash(&[]), built_in_hash(&[]));
    let cut = "cut r6->r1 @1 for 2";
    assert_ne!(hash(&[cut]), built_in_hash(&[cut]));
}
