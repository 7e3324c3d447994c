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
        let read_result =
            read_text(Path::new("a run of the hunt"), self.text, &overrides, self.catalog);
        let (scenario, text, _) =
            read_result.map_err(|error| RunEvaluationError::InvalidScenario(error.message))?;
        let result = match self.processes {
            Some(processes) => processes.run(&scenario, &text, |run, summary| {
                self.evaluate_recorded_run(&scenario, run, summary)
            })?,
            None => self.run_in_process(&scenario, &text)?,
        };
        let CandidateResult { metrics, expectations, observed_events, external_margin } = result;
        let mut margins = Vec::new();
        let mut descriptions: Vec<(String, String)> = Vec::new();
        for name in self.expectation_names {
            let found = expectations.iter().find(|expectation| expectation.name == *name);
            // A run without failed robots does not have that expectation.
            margins.push(found.map_or(f64::INFINITY, margin::margin));
            let description = found.map(|found| margin::describe(found, &metrics));
            descriptions.push((name.clone(), description.unwrap_or_default()));
        }
        if let (Some(caller), Some(margin)) = (self.external_margin, external_margin) {
            descriptions.push((caller.name.clone(), caller.describe(margin)));
            margins.push(margin);
        }
        Ok(RunEvaluation {
            margins,
            observed_events,
            text,
            expectation_descriptions: descriptions,
            metrics,
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
        let mut watch = |_: &_, rows: &[_], alive: &[bool]| {
            behavior.add_truth(rows, alive);
            !self.stop.is_requested()
        };
        let metrics = measured::measure_run(scenario, Box::new(create_controller), &mut watch);
        let metrics = metrics.ok_or(RunEvaluationError::Stopped)?;
        let expectations = expect::evaluate(scenario, &metrics, Pace::Lockstep, 0, exit::OK);
        let compute_margin = |caller: &ExternalMargin| {
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
        let external_margin = self
            .external_margin
            .map(compute_margin)
            .transpose()
            .map_err(RunEvaluationError::NoMargin)?;
        Ok(CandidateResult {
            metrics,
            expectations,
            observed_events: behavior.into_observed_events(),
            external_margin,
        })
    }

    /// Evaluates a run that has been recorded in this directory.
    fn evaluate_recorded_run(
        &self,
        scenario: &Scenario,
        run_dir: &Path,
        summary: Summary,
    ) -> Result<CandidateResult, RunEvaluationError> {
        let observed_events = recorded_behavior(scenario, run_dir)
            .map_err(|error| RunEvaluationError::Failed(error.to_string()))?;
        let request_margin = |caller: &ExternalMargin| caller.request(run_dir);
        let external_margin = self
            .external_margin
            .map(request_margin)
            .transpose()
            .map_err(RunEvaluationError::NoMargin)?;
        let expectations = summary.expectations.clone();
        Ok(CandidateResult { metrics: summary, expectations, observed_events, external_margin })
    }

    /// Writes the run of the scenario file `path`, which has this result, and its page to the folder `out_dir`.
    /// `description` is a sentence about the run. Runs by processes are repeated for this: fails if the repetition
    /// differs.
    pub(super) fn write_page(
        &self,
        found: &RunEvaluation,
        path: &Path,
        description: &str,
        out_dir: &Path,
    ) -> Result<(), HuntError> {
        let Some(processes) = self.processes else {
            let read_result = read_for_run(path, &Overrides::default(), self.catalog);
            let (scenario, text, _) =
                read_result.map_err(|error| HuntError::Page(error.message))?;
            return page::record_run(
                &scenario,
                &text,
                path,
                out_dir,
                self.build,
                self.launcher,
                self.stop,
            )
            .and_then(|()| checksums::write_checksums(out_dir, out_dir).map_err(format_error))
            .and_then(|()| page::draw_run_page(&scenario, description, out_dir))
            .map_err(HuntError::Page);
        };
        processes.copy_programs(scenario_folder(path)).map_err(HuntError::Programs)?;
        let read_result = read_for_run(path, &Overrides::default(), self.catalog);
        let (scenario, ..) =
            read_result.map_err(|diagnostic| HuntError::Page(diagnostic.message))?;
        let repetition = processes.run_file(&scenario, path, out_dir)?;
        let repetition = repetition.trajectory_hash.unwrap_or_default();
        if repetition != found.hash() {
            return Err(HuntError::Programs(format!(
                "{} had the trajectory hash {}, and {repetition} when it was repeated: a program of the scenario depends on more \
                 than its inputs, such as a clock or a random number generator without the seed of the robot",
                path.display(),
                found.hash()
            )));
        }
        page::draw_run_page(&scenario, description, out_dir).map_err(HuntError::Page)
    }
}

impl RunEvaluation {
    /// Returns the index of the expectation with the smallest margin.
    pub(super) fn smallest_margin_index(&self) -> usize {
        let indices = 0..self.margins.len();
        indices.min_by(|&a, &b| self.margins[a].total_cmp(&self.margins[b])).expect("one is hunted")
    }

    pub(super) fn margin(&self) -> f64 {
        self.margins[self.smallest_margin_index()]
    }

    pub(super) fn hash(&self) -> &str {
        self.metrics.trajectory_hash.as_deref().unwrap_or_default()
    }

    /// Returns the name of the expectation with the smallest margin, and a sentence about it.
    pub(super) fn describe(&self) -> (&str, String) {
        let (name, description) = &self.expectation_descriptions[self.smallest_margin_index()];
        (name, description.clone())
    }

    /// Returns the scenario text with a comment about the run.
    pub(super) fn scenario_with_comment(&self, description: &str) -> String {
        let RunEvaluation { text, .. } = self;
        let (margin, hash) = (format_short(self.margin()), self.hash());
        format!(
            "# From `phalanx hunt`: {description} (margin {margin}).\n# Trajectory hash in lockstep: {hash}\n\n{text}"
        )
    }
}

/// Returns the expectations to falsify, and the keys to set so that the scenario has bounds for them.
/// `has_external_margin` is whether the calling program computes a margin too. Fails if a name is unknown, has no
/// margin, or has no bound in the scenario.
pub(super) fn expectations_to_falsify(
    scenario: &Scenario,
    names: &[String],
    has_external_margin: bool,
) -> Result<(Vec<String>, Vec<String>), String> {
    let no_metrics = RunMetrics::default();
    let scenario_names = expect::evaluate(scenario, &no_metrics, Pace::Realtime, 0, exit::OK);
    let scenario_names: Vec<String> =
        scenario_names.into_iter().map(|expectation| expectation.name).collect();
    let has_different_sizes = scenario.has_different_sizes();
    let distance_name =
        if has_different_sizes { "min_distance_over_d" } else { "min_distance_m" }.to_owned();
    let mut hunted_names = names.to_vec();
    if hunted_names.is_empty() && has_external_margin {
        return Ok((hunted_names, Vec::new()));
    }
    if hunted_names.is_empty() {
        hunted_names = scenario_names.iter().filter(|name| has_margin(name)).cloned().collect();
    }
    if hunted_names.is_empty() {
        hunted_names.push(distance_name.clone());
    }
    let mut assignments = Vec::new();
    for name in &hunted_names {
        if ["exit", "deadline_misses_max"].contains(&name.as_str()) {
            return Err(format!(
                "--expect {name}: this expectation has no margin; must be one of {}",
                EXPECTATIONS_WITH_MARGIN.join(", ")
            ));
        }
        if !has_margin(name) {
            let suggestion = most_similar_word(name, EXPECTATIONS_WITH_MARGIN)
                .map(|suggestion| format!("did you mean {suggestion}?"));
            let list_names = || format!("must be one of {}", EXPECTATIONS_WITH_MARGIN.join(", "));
            return Err(format!(
                "--expect {name}: unknown expectation; {}",
                suggestion.unwrap_or_else(list_names)
            ));
        }
        if scenario_names.contains(name) {
            continue;
        }
        if *name != distance_name {
            return Err(format!(
                "--expect {name}: the scenario has no bound for it; set one in [expect], or with --set expect.{name}=..."
            ));
        }
        let bound = if has_different_sizes { 1.0 } else { scenario.avoidance.distance_min_m };
        assignments.push(format!("expect.{distance_name}={bound:?}"));
    }
    hunted_names.dedup();
    Ok((hunted_names, assignments))
}

/// Returns the scenario and its text with these keys set. On an error, prints the diagnostic and returns `None`.
pub(super) fn scenario_with_keys(
    scenario: &Scenario,
    text: String,
    assignments: Vec<String>,
    catalog: &Catalog,
) -> Option<(Scenario, String)> {
    if assignments.is_empty() {
        return Some((scenario.clone(), text));
    }
    let overrides = Overrides { assignments, ..Overrides::default() };
    match read_text(Path::new(&scenario.name), &text, &overrides, catalog) {
        Ok((scenario, text, _)) => Some((scenario, text)),
        Err(diagnostic) => {
            print_diagnostic(&diagnostic);
            None
        }
    }
}
