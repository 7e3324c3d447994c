//! Robots that deaths and cuts break: the prediction of theory compared with the simulation of the oracle.
//!
//! `random` does the same in random formations.

mod random;

use std::fmt::Write as _;

use experiment::prediction::{BrokenPrediction, FailurePredictor};
use experiment::scenario::Scenario;
use formation::front_point::front_point;
use outcome::metrics::RunMetrics;

use crate::harness::map_in_parallel;
use crate::oracle::{simulate, simulate_watched};
use crate::repair::with_repair;
use crate::single_faults::{self, SingleFaultCase};

/// Maximum distance of a robot from its slot in the planned formation over the last tenth of the run, m. A robot
/// that is farther away is broken.
const BOUND_M: f64 = 0.02;
/// Step between the cases of `swarm64` that are simulated.
const SWARM_EVERY: usize = 16;
/// Time of the fault in `swarm64`, when the formation has settled, s.
const SWARM_AT_S: f64 = 45.0;

/// Prediction and simulation of one case.
struct PredictedAndSimulated {
    /// Scenario and fault.
    what: String,
    names: Vec<String>,
    predicted: Vec<BrokenPrediction>,
    /// Distance of each robot from its slot at the end, m. `None` for dead robots.
    error_m: Vec<Option<f64>>,
    violations: u64,
}

impl PredictedAndSimulated {
    fn new(
        what: String,
        scenario: &Scenario,
        predicted: Vec<BrokenPrediction>,
        measures: &RunMetrics,
    ) -> PredictedAndSimulated {
        PredictedAndSimulated {
            what,
            names: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            predicted,
            error_m: measures.final_ideal_error_m.iter().map(|(_, error_m)| *error_m).collect(),
            violations: measures.violations,
        }
    }

    fn is_predicted(&self, robot: usize) -> bool {
        self.predicted.iter().any(|one| one.robot == robot)
    }

    fn is_seen(&self, robot: usize) -> bool {
        self.error_m[robot].is_some_and(|error_m| error_m > BOUND_M)
    }

    /// Returns whether exactly the predicted robots are broken.
    fn prediction_holds(&self) -> bool {
        (0..self.names.len()).all(|robot| self.is_predicted(robot) == self.is_seen(robot))
    }

    /// Formats the robots that are broken or were predicted to be.
    fn describe(&self) -> String {
        let mut text =
            format!("{}{}\n", if self.prediction_holds() { "" } else { "DIFFERENT " }, self.what);
        let name = |robot: usize| self.names[robot].as_str();
        for robot in 0..self.names.len() {
            let one = self.predicted.iter().find(|one| one.robot == robot);
            if one.is_none() && !self.is_seen(robot) {
                continue;
            }
            let why = one.map_or("nothing foretold".to_owned(), |one| one.describe(name));
            let predicted_m = one.and_then(|one| one.slot_distance_m);
            let predicted_distance =
                predicted_m.map_or(String::new(), |error_m| format!(" (about {error_m:.3} m)"));
            let error_m = self.error_m[robot].unwrap_or(f64::NAN);
            let _ = writeln!(
                text,
                "    {} off by {error_m:.3} m: {why}{predicted_distance}",
                name(robot)
            );
        }
        text
    }
}

/// Predicts the robots that the permanent death of a robot or cut of an edge breaks.
fn predict(
    scenario: &Scenario,
    broken: single_faults::FailingComponent,
    at_s: f64,
) -> Vec<BrokenPrediction> {
    let (dead, cut) = match broken {
        single_faults::FailingComponent::Robot(robot) => (vec![robot], Vec::new()),
        single_faults::FailingComponent::Edge(edge) => (Vec::new(), vec![edge]),
    };
    FailurePredictor::new(scenario).with_broken_threshold(BOUND_M).broken_robots(
        &dead,
        &cut,
        Some(at_s),
    )
}

fn outcome(case: &SingleFaultCase, is_temporary: bool) -> PredictedAndSimulated {
    let mut scenario = case.scenario(is_temporary);
    if is_temporary {
        // With small gains the return takes long.
        scenario.duration_ns += scenario.duration_ns / 4;
    }
    let measures = simulate(&scenario);
    let predicted = match is_temporary {
        // All robots return.
        true => Vec::new(),
        false => predict(&scenario, case.broken, case.at_s),
    };
    PredictedAndSimulated::new(
        format!("{}: {}", case.scenario, case.what),
        &scenario,
        predicted,
        &measures,
    )
}

/// Simulates these cases and prints the results. Returns the cases whose broken robots differ from the prediction.
fn different(cases: &[SingleFaultCase], is_temporary: bool) -> Vec<PredictedAndSimulated> {
    let outcomes = map_in_parallel(cases, |case| outcome(case, is_temporary));
    for outcome in &outcomes {
        println!("{}", outcome.describe());
        assert_eq!(outcome.violations, 0, "{}: nearer than d", outcome.what);
    }
    let mut scenarios: Vec<(&str, [usize; 2])> = Vec::new();
    for (case, outcome) in cases.iter().zip(&outcomes) {
        let [all, agree] = match scenarios.last_mut() {
            Some((name, counts)) if *name == case.scenario => counts,
            _ => {
                scenarios.push((case.scenario, [0; 2]));
                &mut scenarios.last_mut().expect("it was just pushed").1
            }
        };
        (*all, *agree) = (*all + 1, *agree + usize::from(outcome.prediction_holds()));
    }
    for (name, [all, agree]) in &scenarios {
        println!("{name}: {agree} of {all} as foretold");
    }
    outcomes.into_iter().filter(|outcome| !outcome.prediction_holds()).collect()
}

/// Returns all single deaths and cuts of the shipped scenarios, and some of `swarm64`.
fn all_cases() -> Vec<SingleFaultCase> {
    let swarm = single_faults::cases_of("swarm64").into_iter().step_by(SWARM_EVERY);
    let swarm_after_settling = swarm.map(|case| SingleFaultCase { at_s: SWARM_AT_S, ..case });
    single_faults::cases().into_iter().chain(swarm_after_settling).collect()
}

#[test]
fn robot_with_one_neighbor_is_the_only_one_predicted_broken() {
    let case = single_faults::cases_of("containment").into_iter().find(|c| c.what == "kill r4");
    let outcome = outcome(&case.unwrap(), false);
    let why: Vec<String> = outcome
        .predicted
        .iter()
        .map(|one| format!("{}: {}", outcome.names[one.robot], one.describe(|i| &outcome.names[i])))
        .collect();
    assert!(why.contains(&"r3: desired position occupied by r8 (Remark 1)".to_owned()), "{why:?}");
    assert!(outcome.prediction_holds(), "{}", outcome.describe());
}

#[test]
fn leader_keeps_its_course_past_stranded_robots() {
    let about = ["kill r4", "cut r2->r1", "cut r4->r3", "cut r5->r4"];
    let cases = single_faults::cases_of("pentagon").into_iter();
    let cases: Vec<SingleFaultCase> =
        cases.filter(|case| about.contains(&case.what.as_str())).collect();
    assert_eq!(cases.len(), about.len());
    let error_m = map_in_parallel(&cases, |case| {
        let scenario = case.scenario(false);
        let (r5, ell) = (4, scenario.robots[4].front_point_m);
        let lead = scenario.lead_of(r5).expect("r5 leads");
        let mut error_m = 0f64;
        simulate_watched(&scenario, |header, rows, _| {
            let t_s = header.t_ns as f64 / 1e9;
            if t_s > case.at_s {
                let m = lead.trajectory.target_at(t_s).position;
                error_m = error_m.max((front_point(rows[r5].pose(), ell) - m).norm());
            }
        });
        error_m
    });
    for (case, error_m) in cases.iter().zip(error_m) {
        assert!(error_m < 0.005, "{}: {error_m} m", case.what);
    }
}

/// `cargo test --release --test it -- --ignored predictions::every_single --nocapture`
#[test]
#[ignore = "hundreds of runs: minutes"]
fn every_single_fault_breaks_the_predicted_robots() {
    let cases = all_cases();
    let different = different(&cases, false).len();
    println!("{} of {} as foretold", cases.len() - different, cases.len());
    assert!(20 * different <= cases.len(), "{different} of {} differ", cases.len());
}

/// `cargo test --release --test it -- --ignored predictions::every_single --nocapture`
#[test]
#[ignore = "a hundred runs: minutes"]
fn every_single_fault_breaks_the_predicted_robots_with_repair() {
    let cases: Vec<SingleFaultCase> = all_cases().into_iter().map(with_repair).collect();
    let different = different(&cases, false).len();
    println!("{} of {} as foretold", cases.len() - different, cases.len());
    assert!(20 * different <= cases.len(), "{different} of {} differ", cases.len());
}

/// `cargo test --release --test it -- --ignored predictions::all_robots_recover --nocapture`
#[test]
#[ignore = "hundreds of runs: minutes"]
fn all_robots_recover_after_every_temporary_death_and_cut() {
    let cases = all_cases();
    let different = different(&cases, true).len();
    println!("{} of {} as foretold", cases.len() - different, cases.len());
    assert!(20 * different <= cases.len(), "{different} of {} differ", cases.len());
}
