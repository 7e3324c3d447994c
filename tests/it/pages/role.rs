//! `docs/add-a-role.md`.

use agent::avoidance;
use agent::brain::{Brain, Parts};
use agent::laws::{Heard, LAWS, LawRow};
use agent::roles::{Moment, Role, RoleRow};
use experiment::scenario::read::{Overrides, read};

use super::blocks;
use crate::oracle;

mod contained_fresh;

pub use self::contained_fresh::CONTAINED_FRESH;

const PAGE: &str = include_str!("../../../docs/add-a-role.md");

/// The law of the contained, with the page's role.
fn fresh() -> LawRow {
    let law = LAWS.iter().find(|row| row.name == "containment-tanh").expect("a law");
    LawRow { name: "containment-fresh", role: CONTAINED_FRESH, ..*law }
}

/// The trajectory of the third case's first seconds with this fault, by the page's role.
fn hash(fault: Option<&str>) -> Option<String> {
    let mut catalog = agent::catalog();
    catalog.laws.push(fresh().description());
    let set = ["r1", "r2", "r3", "r4"].map(|robot| format!("robot.{robot}.law=containment-fresh"));
    let set = SHORT.iter().map(|&set| set.to_owned()).chain(set).collect();
    let faults = fault.into_iter().map(str::to_owned).collect();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/containment.toml");
    let overrides = Overrides { set, faults, ..Overrides::default() };
    let (scenario, ..) = read(path.as_ref(), &overrides, &catalog)
        .unwrap_or_else(|error| panic!("{}", error.render(false)));
    let measured = oracle::simulate_with(&scenario, &|brief, incarnation| {
        let own = fresh();
        let law = LAWS.iter().find(|row| row.name == brief.law).unwrap_or(&own);
        let parts = Parts {
            role: law.role.make(brief).unwrap(),
            law: law.make(&brief.gains).unwrap(),
            avoidance: avoidance::build(brief).unwrap(),
        };
        Brain::with_parts(brief, incarnation, parts)
    });
    measured.trajectory_hash
}

const SHORT: [&str; 2] = ["duration_s=4", "expect={}"];

#[test]
fn the_page_shows_the_role_that_runs_here() {
    let [file, row] = blocks(PAGE)[..] else { panic!("this test knows all of the page") };
    assert_eq!(file, include_str!("role/contained_fresh.rs"));
    assert!(include_str!("role.rs").contains(row), "{row}");
}

#[test]
fn robots_of_the_pages_role_move_like_the_contained_until_somebody_is_stale() {
    let houses = |faults: &[&str]| {
        oracle::simulate(&oracle::with_faults("containment", &SHORT, faults)).trajectory_hash
    };
    assert_eq!(hash(None), houses(&[]));
    let cut = "cut r6->r1 @1 for 2";
    assert_ne!(hash(Some(cut)), houses(&[cut]));
}
