//! The README's example of a law, word for word: it compiles, is a law like the others, and flies.
//!
//! This module stands in for `agent/src/laws/mod.rs`; what the README would have there and in a
//! file beside it is here and in `law_example/`.

use agent::brain::Brain;
use agent::laws::{Gains, Law, LawRow, Situation};
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::read::{Overrides, read};
use formation::Vec2;
use protocol::brief::AgentBrief;
use protocol::law::LawDescription;

use crate::oracle;

mod formation_linear;

pub const LAWS: &[LawRow] = &[formation_linear::ROW, formation_unit::ROW /* and the others */];

/// A law of the house, as its file has it.
mod formation_unit {
    use agent::laws::{LAWS, LawRow};

    pub(super) const ROW: LawRow =
        LawRow { description: LAWS[0].description, build: LAWS[0].build };
}

/// The triangle with the example's law, and what its reader says with these keys set.
fn triangle(set: &[&str]) -> Result<Scenario, Diagnostic> {
    let laws: Vec<LawDescription> = LAWS.iter().map(|row| row.description).collect();
    let set = ["robot_defaults.law=formation-linear"].iter().chain(set);
    let set = set.map(|&assignment| assignment.into()).collect();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/triangle.toml");
    read(path.as_ref(), &Overrides { set, ..Overrides::default() }, &laws)
        .map(|(scenario, ..)| scenario)
}

const GAINS: &[&str] = &["robot_defaults.k_per_s=1.0", "robot_defaults.limit_m_s=0.1"];

/// The row of the law that a scenario asks for by its name.
fn row(name: &str) -> &'static LawRow {
    LAWS.iter().find(|row| row.description.name == name).expect("a law")
}

#[test]
fn the_readme_shows_the_law_that_is_flown_here() {
    let readme = include_str!("../../README.md");
    let mut blocks = readme.split("```rust\n").skip(1).map(|rest| rest.split("```").next());
    assert_eq!(blocks.next().flatten(), Some(include_str!("law_example/formation_linear.rs")));
    let row = blocks.next().flatten().expect("the README shows the row");
    assert!(include_str!("law_example.rs").contains(row), "{row}");
    assert_eq!(blocks.next(), None, "this test knows all of the README's Rust");
    // The file that the README changes has the list that it adds to.
    let (list, _) = row.rsplit_once(" = ").unwrap();
    let list = list.lines().last().unwrap();
    assert!(include_str!("../../agent/src/laws/mod.rs").contains(list), "{list}");
}

#[test]
fn robots_with_the_readmes_law_form_the_triangle_and_keep_their_distance() {
    let scenario = triangle(GAINS).unwrap_or_else(|error| panic!("{}", error.render(false)));
    let flight = oracle::fly_with(&scenario, &|brief, incarnation| {
        let law = row(&brief.law).make(&brief.gains).unwrap();
        // The brain asks the house's list for the role: that of another law of the same role.
        let brief = AgentBrief { law: "formation-unit".into(), ..brief.clone() };
        Brain::with_law(&brief, incarnation, law).unwrap()
    });
    assert_eq!(row("formation-linear").description.role, row("formation-unit").description.role);
    assert!(flight.final_error_m_max.unwrap() < 1e-3, "{:?}", flight.final_error_m_max);
    assert!(flight.min_distance_m.unwrap() >= 0.2, "{:?}", flight.min_distance_m);
    assert!(flight.converged_at_s.is_some_and(|at_s| at_s < 15.0), "{:?}", flight.converged_at_s);
}

#[test]
fn the_readmes_law_is_linear_up_to_its_limit() {
    let gains = [("k_per_s".to_owned(), 2.0), ("limit_m_s".to_owned(), 0.1)].into();
    let law = row("formation-linear").make(&gains).unwrap();
    let gamma = |x, y| {
        law.gamma(&Situation {
            error: Vec2::new(x, y),
            desired_velocity: Vec2::new(5.0, 5.0),
            period_s: 0.005,
            age_periods: 1.0,
        })
    };
    assert!((gamma(0.01, -0.02) - Vec2::new(-0.02, 0.04)).norm() < 1e-15);
    assert!((gamma(3.0, 4.0) - Vec2::new(-0.06, -0.08)).norm() < 1e-15);
}

#[test]
fn a_missing_or_wrong_gain_of_the_readmes_law_gets_its_diagnostic() {
    let missing = triangle(&GAINS[..1]).unwrap_err().message;
    assert_eq!(missing, "robot r1 has no `limit_m_s`");
    let wrong = triangle(&[GAINS[0], "robot_defaults.limit_m_s=-1"]).unwrap_err().message;
    assert!(wrong.contains("`limit_m_s` is -1"), "{wrong}");
}
