//! Runs of a hunt: each is turned into a scenario, computed within this process or by processes, and evaluated.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use experiment::hunt::plan::RunPlan;
use experiment::hunt::space::SearchSpace;
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::most_similar_word;
use experiment::scenario::read::{Overrides, read_for_run, read_text, scenario_folder};
use outcome::metrics::RunMetrics;
use outcome::metrics::expect::{self, Expectation};
use outcome::metrics::margin::{self, EXPECTATIONS_WITH_MARGIN, has_margin};
use outcome::metrics::summary::Summary;
use outcome::results::checksums;
use outcome::results::manifest::BuildInfo;
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::number::format_short;
use protocol::process::{StopFlag, exit};

use super::behavior::BehaviorRecorder;
use super::caller::ExternalMargin;
use super::error::{HuntError, RunEvaluationError};
use super::page;
use super::processes::{HuntProcessExecutor, recorded_behavior};
use crate::pool::map_on_all_cores;
use crate::verbs::cell_in_process::{format_error, panic_message};
use crate::verbs::screen::print_diagnostic;
use run::in_process::measured::{self, create_controller};
use supervisor::spawn::Launcher;

/// Context in which the runs of a hunt are computed.
pub(super) struct RunContext<'a> {
    /// Effective text of the scenario that all runs vary.
    pub(super) text: &'a str,
    pub(super) space: &'a SearchSpace,
    /// Names of the expectations to falsify.
    pub(super) expectation_names: &'a [String],
    /// Additional margin computed by the calling program.
    pub(super) external_margin: Option<&'a ExternalMargin>,
    /// Execution by processes; `None` within this process.
    pub(super) processes: Option<&'a HuntProcessExecutor<'a>>,
    pub(super) catalog: &'a Catalog,
    /// Build information for the page of the run found.
    pub(super) build: &'a BuildInfo,
    pub(super) launcher: &'a Launcher,
    pub(super) jobs: Option<usize>,
    pub(super) stop: &'a StopFlag,
}

/// Result of a run.
pub(super) struct RunEvaluation {
    /// Margin of each expectation to falsify; below 0 if missed.
    pub(super) margins: Vec<f64>,
    /// Behavior of the run, as a set of numbers.
    pub(super) observed_events: Vec<u16>,
    text: String,
    /// Name of each expectation, with a sentence about it.
    expectation_descriptions: Vec<(String, String)>,
    metrics: RunMetrics,
}

/// Result of a run, before the margins of its expectations are known.
struct CandidateResult {
    metrics: RunMetrics,
    expectations: Vec<Expectation>,
    observed_events: Vec<u16>,
    /// Margin that the calling program computed.
    external_margin: Option<f64>,
}

impl RunContext<'_> {
    pub(super) fn run_and_evaluate_all(
        &self,
        plans: &[RunPlan],
    ) -> Vec<Result<RunEvaluation, RunEvaluationError>> {
        map_on_all_cores(plans, self.jobs, self.processes.is_some(), |plan| {
            self.run_and_evaluate(plan)
        })
    }

    pub(super) fn run_and_evaluate(
        &self,
        plan: &RunPlan,
    ) -> Result<RunEvaluation, RunEvaluationError> {
        // The state of a run that panics is dropped.
        catch_unwind(AssertUnwindSafe(|| self.run(plan))).unwrap_or_else(|panic| {
            let message = panic_message(&*panic);
            let overrides = plan.overrides(self.space.scenario());
            Err(RunEvaluationError::Panicked(format!(
                "{message}, with {:?} {:?}",
                overrides.assignments, overrides.faults
            )))
        })
    }

    fn run(&self, plan: &RunPlan) -> Result<RunEvaluation, RunEvaluationError> {
        let overrides = plan.overrides(self.space.scenario());
        let read = read_text(Path::new("a run of the hunt"), self.text, &overrides, self.catalog);
        let (scenario, text, _) =
            read.map_err(|why| RunEvaluationError::InvalidScenario(why.message))?;
        let evaluated = match self.processes {
            Some(processes) => processes.run(&scenario, &text, |run, summary| {
                self.evaluate_recorded_run(&scenario, run, summary)
            })?,
            None => self.run_in_process(&scenario, &text)?,
        };
        let CandidateResult {
            metrics: measures,
            expectations,
            observed_events: traits,
            external_margin: own_margin,
        } = evaluated;
        let mut margins = Vec::new();
        let mut words: Vec<(String, String)> = Vec::new();
        for name in self.expectation_names {
            let found = expectations.iter().find(|expectation| expectation.name == *name);
            // A run without failed robots does not have that expectation.
            margins.push(found.map_or(f64::INFINITY, margin::margin));
            let described = found.map(|found| margin::describe(found, &measures));
            words.push((name.clone(), described.unwrap_or_default()));
        }
        if let (Some(caller), Some(margin)) = (self.external_margin, own_margin) {
            words.push((caller.name.clone(), caller.describe(margin)));
            margins.push(margin);
        }
        Ok(RunEvaluation {
            margins,
            observed_events: traits,
            text,
            expectation_descriptions: words,
            metrics: measures,
        })
    }

    fn run_in_process(
        &self,
        scenario: &Scenario,
        text: &str,
    ) -> Result<CandidateResult, RunEvaluationError> {
        let front_points_m: Vec<f64> =
            scenario.robots.iter().map(|robot| robot.front_point_m).collect();
        let mut behavior =
            BehaviorRecorder::new(&front_points_m, scenario.avoidance.distance_min_m);
        let measures = measured::measure_run(scenario, &create_controller, |_, rows, alive| {
            behavior.add_truth(rows, alive);
            !self.stop.is_requested()
        });
        let measures = measures.ok_or(RunEvaluationError::Stopped)?;
        let expectations = expect::evaluate(scenario, &measures, Pace::Lockstep, 0, exit::OK);
        let margin = |caller: &ExternalMargin| {
            caller.record_and_request(|run_dir| {
                page::record_run(
                    scenario,
                    text,
                    run_dir,
                    run_dir,
                    self.build,
                    self.launcher,
                    self.stop,
                )
            })
        };
        let own_margin =
            self.external_margin.map(margin).transpose().map_err(RunEvaluationError::NoMargin)?;
        Ok(CandidateResult {
            metrics: measures,
            expectations,
            observed_events: behavior.into_observed_events(),
            external_margin: own_margin,
        })
    }

    /// Evaluates a run that has been recorded in this directory.
    fn evaluate_recorded_run(
        &self,
        scenario: &Scenario,
        run_dir: &Path,
        summary: Summary,
    ) -> Result<CandidateResult, RunEvaluationError> {
        let traits = recorded_behavior(scenario, run_dir)
            .map_err(|error| RunEvaluationError::Failed(error.to_string()))?;
        let margin = |caller: &ExternalMargin| caller.request(run_dir);
        let own_margin =
            self.external_margin.map(margin).transpose().map_err(RunEvaluationError::NoMargin)?;
        let expectations = summary.expectations.clone();
        Ok(CandidateResult {
            metrics: summary,
            expectations,
            observed_events: traits,
            external_margin: own_margin,
        })
    }

    /// Writes the run of the scenario file `path`, which has this result, and its page to the folder `to`. `words` is a
    /// sentence about the run. Runs by processes are repeated for this: fails if the repetition differs.
    pub(super) fn write_page(
        &self,
        found: &RunEvaluation,
        path: &Path,
        words: &str,
        to: &Path,
    ) -> Result<(), HuntError> {
        let Some(processes) = self.processes else {
            let read = read_for_run(path, &Overrides::default(), self.catalog);
            let (scenario, text, _) = read.map_err(|why| HuntError::Page(why.message))?;
            return page::record_run(
                &scenario,
                &text,
                path,
                to,
                self.build,
                self.launcher,
                self.stop,
            )
            .and_then(|()| checksums::write_checksums(to, to).map_err(format_error))
            .and_then(|()| page::draw_run_page(&scenario, words, to))
            .map_err(HuntError::Page);
        };
        processes.copy_programs(scenario_folder(path)).map_err(HuntError::Programs)?;
        let read = read_for_run(path, &Overrides::default(), self.catalog);
        let (scenario, ..) = read.map_err(|diagnostic| HuntError::Page(diagnostic.message))?;
        let again = processes.run_file(&scenario, path, to)?;
        let again = again.trajectory_hash.unwrap_or_default();
        if again != found.hash() {
            return Err(HuntError::Programs(format!(
                "{} had the trajectory hash {}, and {again} when it was repeated: a program of the scenario depends on more \
                 than its inputs, such as a clock or a random number generator without the seed of the robot",
                path.display(),
                found.hash()
            )));
        }
        page::draw_run_page(&scenario, words, to).map_err(HuntError::Page)
    }
}

impl RunEvaluation {
    /// Returns the index of the expectation with the smallest margin.
    pub(super) fn smallest_margin_index(&self) -> usize {
        let places = 0..self.margins.len();
        places.min_by(|&a, &b| self.margins[a].total_cmp(&self.margins[b])).expect("one is hunted")
    }

    pub(super) fn margin(&self) -> f64 {
        self.margins[self.smallest_margin_index()]
    }

    pub(super) fn hash(&self) -> &str {
        self.metrics.trajectory_hash.as_deref().unwrap_or_default()
    }

    /// Returns the name of the expectation with the smallest margin, and a sentence about it.
    pub(super) fn describe(&self) -> (&str, String) {
        let (name, words) = &self.expectation_descriptions[self.smallest_margin_index()];
        (name, words.clone())
    }

    /// Returns the scenario text with a comment about the run.
    pub(super) fn scenario_with_comment(&self, words: &str) -> String {
        let RunEvaluation { text, .. } = self;
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
    let none = RunMetrics::default();
    let own = expect::evaluate(scenario, &none, Pace::Realtime, 0, exit::OK);
    let own: Vec<String> = own.into_iter().map(|expectation| expectation.name).collect();
    let by_pair = scenario.has_different_sizes();
    let d = if by_pair { "min_distance_over_d" } else { "min_distance_m" }.to_owned();
    let mut hunted = names.to_vec();
    if hunted.is_empty() && asks {
        return Ok((hunted, Vec::new()));
    }
    if hunted.is_empty() {
        hunted = own.iter().filter(|name| has_margin(name)).cloned().collect();
    }
    if hunted.is_empty() {
        hunted.push(d.clone());
    }
    let mut set = Vec::new();
    for name in &hunted {
        if ["exit", "deadline_misses_max"].contains(&name.as_str()) {
            return Err(format!(
                "--expect {name}: this expectation has no margin; must be one of {}",
                EXPECTATIONS_WITH_MARGIN.join(", ")
            ));
        }
        if !has_margin(name) {
            let close = most_similar_word(name, EXPECTATIONS_WITH_MARGIN)
                .map(|close| format!("did you mean {close}?"));
            let all = || format!("must be one of {}", EXPECTATIONS_WITH_MARGIN.join(", "));
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
        let bound = if by_pair { 1.0 } else { scenario.avoidance.distance_min_m };
        set.push(format!("expect.{d}={bound:?}"));
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
    let overrides = Overrides { assignments: set, ..Overrides::default() };
    match read_text(Path::new(&scenario.name), &text, &overrides, catalog) {
        Ok((scenario, text, _)) => Some((scenario, text)),
        Err(diagnostic) => {
            print_diagnostic(&diagnostic);
            None
        }
    }
}
