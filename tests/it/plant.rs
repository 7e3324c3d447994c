//! External plants: a program that moves the robots in place of the built-in unicycle model.

use std::convert::Infallible;
use std::path::Path;

use formation::pose::Twist;
use plant::motion::{BodyState, Motion, UnicycleMotion};
use plant::world_loop;
use protocol::brief::PlantBrief;

use crate::oracle;
use crate::processes::{EmbeddedRun, in_place_of, run_embedded};

/// External bodies that reach most of a commanded twist after `lag_s`.
struct Lagging {
    exact: UnicycleMotion,
    lag_s: f64,
    actual: Vec<Twist>,
    t_s: f64,
    behavior: String,
}

impl Lagging {
    fn new(brief: &PlantBrief, behavior: String) -> Lagging {
        let lag_s = if behavior == "lag" { 0.05 } else { 0.0 };
        let actual = vec![Twist::ZERO; brief.robots.len()];
        Lagging { exact: UnicycleMotion::new(brief), lag_s, actual, t_s: 0.0, behavior }
    }
}

impl Motion for Lagging {
    type Error = Infallible;

    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [BodyState],
    ) -> Result<(), Infallible> {
        self.t_s += dt_s;
        let fraction = if self.lag_s == 0.0 { 1.0 } else { 1.0 - (-dt_s / self.lag_s).exp() };
        for (actual, target) in self.actual.iter_mut().zip(targets) {
            let blend = |from: f64, to: f64| {
                if fraction == 1.0 { to } else { from + fraction * (to - from) }
            };
            actual.v_m_s = blend(actual.v_m_s, target.v_m_s);
            actual.w_rad_s = blend(actual.w_rad_s, target.w_rad_s);
        }
        self.exact.step(&self.actual, dt_s, states)?;
        if self.t_s > 1.0 {
            match self.behavior.as_str() {
                "nan" => states[1].pose.y_m = f64::NAN,
                "exit" => std::process::exit(3),
                "hang" => loop {
                    std::thread::yield_now();
                },
                _ => {}
            }
        }
        Ok(())
    }
}

/// Runs the plant's process. It is ignored as a test; [`triangle`] starts it.
#[test]
#[ignore = "the plant's process: another test starts it"]
fn external_plant_process() {
    let (Ok(brief), Ok(behavior)) = (std::env::var("BRIEF"), std::env::var("DOES")) else { return };
    supervisor::child::prepare_process().unwrap();
    let motion = |brief: &PlantBrief| match behavior.as_str() {
        "refuse" => Err("the physics engine has no licence"),
        _ => Ok(Lagging::new(brief, behavior.clone())),
    };
    std::process::exit(world_loop::main_with_motion(Path::new(&brief), false, motion).into());
}

/// Returns the result of the triangle on such a plant.
fn triangle(behavior: &str, more: &[&str]) -> EmbeddedRun {
    let variables = format!("BRIEF=\"$2\" DOES={behavior}");
    let plant = in_place_of("plant", &variables, "plant::external_plant_process");
    run_embedded(&plant, &[&["--set", "expect={}"], more].concat())
}

/// Returns the oracle's trajectory hash of the triangle on the built-in plant.
fn hash_on_exact_plant() -> Option<String> {
    oracle::simulate(&oracle::scenario("triangle", &[])).trajectory_hash
}

#[test]
fn external_unicycles_equal_built_in_ones_bit_for_bit() {
    let run = triangle("exact", &[]);
    assert_eq!(run.code, 0, "{}", run.file("logs/plant.jsonl"));
    assert_eq!(run.summary["trajectory_hash"].as_str(), hash_on_exact_plant().as_deref());
}

#[test]
fn robots_with_actuator_lag_arrive_with_measured_distance() {
    let run = triangle("lag", &["--fault", "kill r2 @5 restart 1"]);
    let summary = &run.summary;
    assert_eq!(run.code, 0, "{}", run.file("logs/plant.jsonl"));
    let number = |name: &str| summary[name].as_f64().unwrap_or(f64::NAN);
    assert!(number("final_error_m_max") < 0.02, "{summary:#}");
    assert!(number("min_distance_m") > 0.1, "{summary:#}");
    assert!(summary["faults"][0]["recovered_after_s"].is_number(), "{:#}", summary["faults"]);
    assert_ne!(summary["trajectory_hash"].as_str(), hash_on_exact_plant().as_deref());
}

#[test]
fn failing_external_plant_ends_the_run_with_its_reason() {
    for (behavior, more, reason) in [
        ("nan", &[][..], "the plant moved r2 to y_m = NaN; the magnitude must be at most 1e9"),
        ("refuse", &[], "the physics engine has no licence"),
        ("exit", &[], ""),
        ("hang", &["--set", "hung_after_s=0.5"], ""),
    ] {
        let run = triangle(behavior, more);
        let log = run.file("logs/plant.jsonl");
        assert_eq!(run.code, 4, "{behavior}: {log}");
        assert!(log.contains(reason), "{behavior}: {log}");
        let ended_at_s = run.summary["t_s"].as_f64();
        assert!(ended_at_s.is_none_or(|t_s| t_s <= 1.1), "{:#}", run.summary);
    }
}
