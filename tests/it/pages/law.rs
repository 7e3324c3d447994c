//! Code of the page `docs/add-a-law.md`, compiled verbatim.

use std::path::Path;
use std::sync::Arc;

use agent::controller::Controller;
use agent::laws::{Gains, Law, LawRow, Situation};
use agent::roles::FORMATION_ROLE;
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use formation::Vec2;
use protocol::brief::AgentBrief;

use super::{Build, assert_row, blocks, expect_valid};
use crate::oracle;
use crate::processes::{in_place_of, run_embedded};

mod formation_linear;

pub const LAWS: &[LawRow] = &[formation_linear::LAW, formation_unit::LAW /* and the others */];

mod own;

/// A built-in law, in its original file.
mod formation_unit {
    use agent::laws::{LAWS, LawRow};

    pub(super) const LAW: LawRow = LawRow { ..LAWS[0] };
}

const PAGE: &str = include_str!("../../../docs/add-a-law.md");

fn build() -> Build {
    Build { laws: Arc::new([formation_linear::LAW]), ..Build::default() }
}

/// Reads the triangle with the page's law and these keys set.
fn triangle(set: &[&str]) -> Result<Scenario, Diagnostic> {
    let set = [&["robot_defaults.law=formation-linear"], set].concat();
    build().read("scenarios/triangle.toml", &set, &[])
}

const GAINS: &[&str] = &["robot_defaults.k_per_s=1.0", "robot_defaults.limit_m_s=0.1"];

#[test]
fn page_shows_the_tested_law() {
    let [file, row, own] = blocks(PAGE)[..] else {
        panic!("the page has other blocks than this test")
    };
    assert_eq!(file, include_str!("law/formation_linear.rs"));
    assert_row(row, include_str!("law.rs"), include_str!("../../../agent/src/laws/mod.rs"));
    assert_eq!(own, include_str!("law/own.rs"));
    assert_eq!(LAWS.len(), 2);
}

#[test]
fn page_law_forms_the_triangle_and_keeps_the_distance() {
    let measured = build().simulate(&expect_valid(triangle(GAINS)));
    assert!(measured.final_error_m_max.unwrap() < 1e-3, "{:?}", measured.final_error_m_max);
    assert!(measured.min_distance_m.unwrap() >= 0.2, "{:?}", measured.min_distance_m);
    assert!(measured.converged_at_s.is_some_and(|s| s < 15.0), "{:?}", measured.converged_at_s);
}

#[test]
fn page_law_is_linear_up_to_its_limit() {
    let gains = [("k_per_s".to_owned(), 2.0), ("limit_m_s".to_owned(), 0.1)].into();
    let mut law = formation_linear::LAW.make(&gains).unwrap();
    let mut gamma = |x, y| {
        let desired_velocity = Vec2::new(5.0, 5.0);
        law.gamma(&Situation {
            error: Vec2::new(x, y),
            desired_velocity,
            ..Situation::WITHOUT_NEIGHBORS
        })
    };
    assert!((gamma(0.01, -0.02) - Vec2::new(-0.02, 0.04)).norm() < 1e-15);
    assert!((gamma(3.0, 4.0) - Vec2::new(-0.06, -0.08)).norm() < 1e-15);
}

#[test]
fn missing_or_wrong_gain_of_the_page_law_is_diagnosed() {
    let missing = triangle(&GAINS[..1]).unwrap_err().message;
    assert_eq!(missing, "robot r1 has no `limit_m_s`");
    let wrong = triangle(&[GAINS[0], "robot_defaults.limit_m_s=-1"]).unwrap_err().message;
    assert!(wrong.contains("`limit_m_s` is -1"), "{wrong}");
}

/// Runs the process of a robot whose law is in no table. It is ignored as a test; another test starts it.
#[test]
#[ignore = "a robot's process: another test starts it"]
fn unlisted_law_robot_process() {
    let (Ok(brief), Ok(incarnation)) = (std::env::var("BRIEF"), std::env::var("INCARNATION"))
    else {
        return;
    };
    supervisor::child::prepare_process().unwrap();
    let code = own::agent(Path::new(&brief), incarnation.parse().unwrap());
    std::process::exit(code.into());
}

#[test]
fn custom_program_processes_run_an_unlisted_law() {
    let variables = "BRIEF=\"$2\" INCARNATION=\"$4\"";
    let agent = in_place_of("agent", variables, "pages::law::unlisted_law_robot_process");
    let run = run_embedded(&agent, &["--set", "expect={}"]);
    assert_eq!(run.code, 0);
    let make_controller = |brief: &AgentBrief, incarnation| {
        Controller::with_parts(brief, incarnation, own::parts(brief).unwrap())
    };
    let predicted =
        oracle::simulate_with(&oracle::scenario("triangle", &[]), Box::new(make_controller));
    assert_eq!(run.summary["trajectory_hash"].as_str(), predicted.trajectory_hash.as_deref());
    let error_m = run.summary["final_error_m_max"].as_f64().unwrap();
    assert!(error_m < 1e-2, "the robots converge: {error_m}");
}
