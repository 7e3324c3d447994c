//! Code of the page `docs/add-an-avoidance-method.md`, compiled verbatim.

use std::sync::Arc;

use agent::avoidance::{Avoidance, AvoidanceRow, Sample};
use experiment::briefs;
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use protocol::brief::Pace;

use super::{Build, assert_row, blocks, expect_valid};
use crate::oracle;

mod brake;

pub const METHODS: &[AvoidanceRow] = &[guard::METHOD, brake::METHOD /* and the others */];

/// A built-in method, in its original file.
mod guard {
    use agent::avoidance::{AvoidanceRow, METHODS};

    pub(super) const METHOD: AvoidanceRow = AvoidanceRow { ..METHODS[0] };
}

const PAGE: &str = include_str!("../../../docs/add-an-avoidance-method.md");

fn build() -> Build {
    Build { methods: Arc::new([brake::METHOD]), ..Build::default() }
}

/// Reads the triangle with start distance d and these keys set, by a build with the page's method.
fn triangle(set: &[&str]) -> Result<Scenario, Diagnostic> {
    build().read("scenarios/triangle-d.toml", set, &[])
}

const BRAKE: [&str; 3] = ["avoidance.kind=brake", "avoidance.horizon_s=0.5", "expect={}"];

#[test]
fn page_shows_the_tested_method() {
    let [file, row] = blocks(PAGE)[..] else { panic!("the page has other blocks than this test") };
    assert_eq!(file, include_str!("avoidance/brake.rs"));
    let agent_source = include_str!("../../../agent/src/avoidance/mod.rs");
    assert_row(row, include_str!("avoidance.rs"), agent_source);
    assert_eq!(METHODS.len(), 2);
}

#[test]
fn one_row_adds_keys_limits_and_sensed_velocities() {
    let missing = triangle(&["avoidance.kind=brake"]).unwrap_err();
    assert_eq!(missing.message, "[avoidance] has no `horizon_s`");
    assert_eq!(missing.expected, "expected `horizon_s`: tau, look-ahead time, in seconds");
    let too_near =
        triangle(&[&BRAKE[..], &["avoidance.sensing_radius_m=0.3"]].concat()).unwrap_err();
    assert!(
        too_near.message.contains("the brake would sense other robots too late"),
        "{}",
        too_near.message
    );

    let plant = |set| {
        briefs::plant_brief(&expect_valid(triangle(set)), Pace::Lockstep, "/nowhere".as_ref())
    };
    let with_brake = plant(&BRAKE);
    assert!(
        with_brake.velocities_sensed && with_brake.speed_max_m_s == Some(0.3),
        "{with_brake:?}"
    );
    assert!((with_brake.sensing_radius_m - 0.5).abs() < 1e-12, "{}", with_brake.sensing_radius_m);
    assert!(!plant(&[]).velocities_sensed, "other methods do not sense velocities");
}

#[test]
fn robots_with_the_page_method_stop_before_each_other() {
    let with_brake = build().simulate(&expect_valid(triangle(&BRAKE))).min_distance_m.unwrap();
    let without_avoidance =
        oracle::simulate(&oracle::scenario("triangle-d", &["avoidance.kind=none"]));
    assert!(without_avoidance.min_distance_m.unwrap() < 0.1);
    assert!(with_brake > 0.19, "{with_brake}");
}
