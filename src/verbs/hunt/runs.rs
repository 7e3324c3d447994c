//! Runs of a hunt: each is turned into a scenario, computed within this process, and evaluated.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use experiment::hunt::plan::Plan;
use experiment::hunt::space::Space;
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::most_similar_word;
use experiment::scenario::read::{Overrides, read_text};
use outcome::metrics::Measures;
use outcome::metrics::expect::{self, Expectation};
use outcome::metrics::margin::{self, WITH_MARGIN};
use outcome::results::manifest::Build;
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::number::format_short;
use protocol::process::{Stop, exit};

use super::behavior::Behavior;
use super::caller::Caller;
use crate::pool::map_on_all_cores;
use crate::verbs::cell_in_process::panic_message;
use crate::verbs::screen::show;
use run::in_process::measured::{self, controller};

/// Context in which the runs of a hunt are computed.
pub(super) struct Runs<'a> {
    /// Effective text of the scenario that all runs vary.
    pub(super) text: &'a str,
    pub(super) space: &'a Space,
    /// Names of the expectations to falsify.
    pub(super) names: &'a [String],
    /// Additional margin computed by the calling program.
    pub(super) caller: Option<&'a Caller>,
    pub(super) catalog: &'a Catalog,
    /// Build information for the page of the run found.
    pub(super) build: &'a Build,
    pub(super) jobs: Option<usize>,
    pub(super) stop: &'a Stop,
}

/// Result of a run.
pub(super) struct JudgedRun {
    /// Margin of each expectation to falsify; below 0 if missed.
    pub(super) margins: Vec<f64>,
    /// Behavior of the run, as a set of numbers.
    pub(super) traits: Vec<u16>,
    text: String,
    /// Name of each expectation, with a sentence about it.
    assignments: Vec<(String, String)>,
    measures: Measures,
}

/// Reason why a run has no result.
pub(super) enum JudgeError {
    /// The scenario was rejected.
    Unsound(String),
    Panicked(String),
    /// The calling program gave no margin.
    NoMargin(String),
    /// A signal ended the run.
    Stopped,
}

impl Runs<'_> {
    pub(super) fn judge_all(&self, plans: &[Plan]) -> Vec<Result<JudgedRun, JudgeError>> {
        map_on_all_cores(plans, self.jobs, |plan| self.judge(plan))
    }

    pub(super) fn judge(&self, plan: &Plan) -> Result<JudgedRun, JudgeError> {
        // The state of a run that panics is dropped.
        catch_unwind(AssertUnwindSafe(|| self.run(plan))).unwrap_or_else(|panic| {
            let message = panic_message(&*panic);
            let overrides = plan.overrides(self.space.scenario());
            Err(JudgeError::Panicked(format!(
                "{message}, with {:?} {:?}",
                overrides.set, overrides.faults
            )))
        })
    }

    fn run(&self, plan: &Plan) -> Result<JudgedRun, JudgeError> {
        let overrides = plan.overrides(self.space.scenario());
        let read = read_text(Path::new("a run of the hunt"), self.text, &overrides, self.catalog);
        let (scenario, text, _) = read.map_err(|why| JudgeError::Unsound(why.message))?;
        let front_points_m: Vec<f64> =
            scenario.robots.iter().map(|robot| robot.front_point_m).collect();
        let mut behavior = Behavior::new(&front_points_m, scenario.avoidance.distance_min_m);
        let measures = measured::measure(&scenario, &controller, |_, rows, alive| {
            behavior.truth(rows, alive);
            !self.stop.is_requested()
        });
        let measures = measures.ok_or(JudgeError::Stopped)?;
        let all = expect::evaluate(&scenario, &measures, Pace::Lockstep, 0, exit::OK);
        let named =
            |name: &String| all.iter().find(|expectation| expectation.name == *name).cloned();
        let expectations: Vec<Expectation> = self.names.iter().filter_map(named).collect();
        let mut margins: Vec<f64> = expectations.iter().map(margin::margin).collect();
        let described = |expectation: &Expectation| {
            (expectation.name.clone(), margin::describe(expectation, &measures))
        };
        let mut words: Vec<(String, String)> = expectations.iter().map(described).collect();
        if let Some(caller) = self.caller {
            let margin =
                caller.margin(&scenario, &text, self.build).map_err(JudgeError::NoMargin)?;
            words.push((caller.name.clone(), caller.describe(margin)));
            margins.push(margin);
        }
        let traits = behavior.traits();
        Ok(JudgedRun { margins, traits, text, assignments: words, measures })
    }
}

impl JudgedRun {
    /// Returns the index of the expectation with the smallest margin.
    pub(super) fn smallest_margin(&self) -> usize {
        let places = 0..self.margins.len();
        places.min_by(|&a, &b| self.margins[a].total_cmp(&self.margins[b])).expect("one is hunted")
    }

    pub(super) fn margin(&self) -> f64 {
        self.margins[self.smallest_margin()]
    }

    pub(super) fn hash(&self) -> &str {
        self.measures.trajectory_hash.as_deref().unwrap_or_default()
    }

    /// Returns the name of the expectation with the smallest margin, and a sentence about it.
    pub(super) fn describe(&self) -> (&str, String) {
        let (name, words) = &self.assignments[self.smallest_margin()];
        (name, words.clone())
    }

    /// Returns the scenario text with a comment about the run.
    pub(super) fn scenario_with_comment(&self, words: &str) -> String {
        let JudgedRun { text, .. } = self;
        let (margin, hash) = (format_short(self.margin()), self.hash());
        format!(
            "# From `phalanx hunt`: {words} (margin {margin}).\n# Trajectory hash in lockstep: {hash}\n\n{text}"
        )
    }
}

/// Returns the expectations to falsify, and the keys to set so that the scenario has bounds for them.
/// `asks` is whether the calling program computes a margin too. Fails if a name is unknown, has no margin,
/// or has no bound in the scenario.
pub(super) fn expectations_to_falsify(
    scenario: &Scenario,
    names: &[String],
    asks: bool,
) -> Result<(Vec<String>, Vec<String>), String> {
    let none = Measures::default();
    let own = expect::evaluate(scenario, &none, Pace::Realtime, 0, exit::OK);
    let own: Vec<String> = own.into_iter().map(|expectation| expectation.name).collect();
    let d = "min_distance_m".to_owned();
    let mut hunted = names.to_vec();
    if hunted.is_empty() && asks {
        return Ok((hunted, Vec::new()));
    }
    if hunted.is_empty() {
        hunted = own.iter().filter(|name| WITH_MARGIN.contains(&name.as_str())).cloned().collect();
    }
    if hunted.is_empty() {
        hunted.push(d.clone());
    }
    let mut set = Vec::new();
    for name in &hunted {
        if ["exit", "deadline_misses_max"].contains(&name.as_str()) {
            return Err(format!(
                "--expect {name}: this expectation has no margin; must be one of {}",
                WITH_MARGIN.join(", ")
            ));
        }
        if !WITH_MARGIN.contains(&name.as_str()) {
            let close =
                most_similar_word(name, WITH_MARGIN).map(|close| format!("did you mean {close}?"));
            let all = || format!("must be one of {}", WITH_MARGIN.join(", "));
            return Err(format!(
                "--expect {name}: unknown expectation; {}",
                close.unwrap_or_else(all)
            ));
        }
        if own.contains(name) {
            continue;
        }
        if *name != d {
            return Err(format!(
                "--expect {name}: the scenario has no bound for it; set one in [expect], or with --set expect.{name}=..."
            ));
        }
        set.push(format!("expect.{d}={:?}", scenario.avoidance.distance_min_m));
    }
    hunted.dedup();
    Ok((hunted, set))
}

/// Returns the scenario and its text with these keys set. On an error, prints the diagnostic and returns `None`.
pub(super) fn scenario_with_keys(
    scenario: &Scenario,
    text: String,
    set: Vec<String>,
    catalog: &Catalog,
) -> Option<(Scenario, String)> {
    if set.is_empty() {
        return Some((scenario.clone(), text));
    }
    let overrides = Overrides { set, ..Overrides::default() };
    match read_text(Path::new(&scenario.name), &text, &overrides, catalog) {
        Ok((scenario, text, _)) => Some((scenario, text)),
        Err(diagnostic) => {
            show(&diagnostic);
            None
        }
    }
}
