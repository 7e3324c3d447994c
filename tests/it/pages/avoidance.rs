//! `docs/add-an-avoidance-method.md`.

use agent::avoidance::{Avoidance, AvoidanceRow, Sample};
use agent::brain::{Brain, Parts};
use agent::laws;
use experiment::briefs;
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::read::{Overrides, read};
use outcome::metrics::Measures;
use protocol::brief::Pace;

use super::{assert_row, blocks};
use crate::oracle;

mod brake;

pub const METHODS: &[AvoidanceRow] = &[guard::ROW, brake::ROW /* and the others */];

/// A method of the house, as its file has it.
mod guard {
    use agent::avoidance::{AvoidanceRow, METHODS};

    pub(super) const ROW: AvoidanceRow = AvoidanceRow { ..METHODS[0] };
}

const PAGE: &str = include_str!("../../../docs/add-an-avoidance-method.md");

/// Start d of the triangle with these keys set, read by a build with the page's method.
fn triangle(set: &[&str]) -> Result<Scenario, Diagnostic> {
    let mut catalog = agent::catalog();
    catalog.methods.push(brake::ROW.description);
    let set = set.iter().map(|&assignment| assignment.into()).collect();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/triangle-d.toml");
    read(path.as_ref(), &Overrides { set, ..Overrides::default() }, &catalog)
        .map(|(scenario, ..)| scenario)
}

fn run(scenario: &Scenario) -> Measures {
    oracle::simulate_with(scenario, &|brief, incarnation| {
        let method = METHODS.iter().find(|row| row.description.name == brief.avoidance.kind);
        let law = laws::row(&brief.law).unwrap();
        let parts = Parts {
            role: law.role.make(brief).unwrap(),
            law: law.make(&brief.gains).unwrap(),
            avoidance: method.expect("a method").make(brief).unwrap(),
        };
        Brain::with_parts(brief, incarnation, parts)
    })
}

const BRAKE: [&str; 3] = ["avoidance.kind=brake", "avoidance.horizon_s=0.5", "expect={}"];

#[test]
fn the_page_shows_the_method_that_runs_here() {
    let [file, row] = blocks(PAGE)[..] else { panic!("this test knows all of the page") };
    assert_eq!(file, include_str!("avoidance/brake.rs"));
    let there = include_str!("../../../agent/src/avoidance/mod.rs");
    assert_row(row, include_str!("avoidance.rs"), there);
}

#[test]
fn a_row_suffices_for_keys_limits_and_sensed_velocities() {
    let missing = triangle(&["avoidance.kind=brake"]).unwrap_err();
    assert_eq!(missing.message, "[avoidance] has no `horizon_s`");
    assert_eq!(missing.expected, "expected `horizon_s`: how far it looks ahead, in seconds");
    let near = triangle(&[&BRAKE[..], &["avoidance.sensing_radius_m=0.3"]].concat()).unwrap_err();
    assert!(near.message.contains("the brake would see too late"), "{}", near.message);

    let scenario = triangle(&BRAKE).unwrap_or_else(|error| panic!("{}", error.render(false)));
    let plant = briefs::plant(&scenario, Pace::Lockstep, "/nowhere".as_ref());
    assert!(plant.velocities_sensed && plant.speed_max_m_s == Some(0.3), "{plant:?}");
    assert!((plant.sensing_radius_m - 0.5).abs() < 1e-12, "{}", plant.sensing_radius_m);
    let plain = triangle(&[]).map(|guarded| briefs::plant(&guarded, Pace::Lockstep, "/".as_ref()));
    assert!(!plain.unwrap().velocities_sensed, "nobody else pays for them");
}

#[test]
fn robots_with_the_pages_method_stop_before_each_other() {
    let braked = run(&triangle(&BRAKE).unwrap()).min_distance_m.unwrap();
    let unheeding = oracle::simulate(&oracle::scenario("triangle-d", &["avoidance.kind=none"]));
    assert!(unheeding.min_distance_m.unwrap() < 0.1);
    assert!(braked > 0.19, "{braked}");
    let guarded = run(&triangle(&[]).unwrap()).trajectory_hash;
    assert_eq!(guarded, oracle::simulate(&oracle::scenario("triangle-d", &[])).trajectory_hash);
}
