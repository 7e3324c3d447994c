//! `phalanx hunt`: searches for a run that misses an expectation, and shrinks it to the simplest such run.
//!
//! Runs are computed within this process, or by processes if the scenario has programs of its own. The runs tried
//! depend on the scenario, the seed and the results of earlier runs only; a journal lets an interrupted hunt continue
//! to the same result.

mod behavior;
mod caller;
mod error;
mod page;
mod processes;
mod runs;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use experiment::campaign::cells;
use experiment::hunt::plan::RunPlan;
use experiment::hunt::search::{Evaluation, Search, Trial};
use experiment::hunt::shrink::{draw_nearby_point, plans_with_fewer_faults, simpler_plans};
use experiment::hunt::space::SearchSpace;
use experiment::scenario::hunt::VARY_VALUES;
use experiment::scenario::{Scenario, VariedPart};
use formation::random::SplitMix64;
use outcome::campaign::folder::{CampaignFolder, LockError};
use outcome::campaign::hunt_journal::{Journal, JournalEntry, JournalError};
use outcome::results::manifest::BuildInfo;
use outcome::results::page::format_command_line;
use outcome::results::summary::to_json;
use protocol::catalog::Catalog;
use protocol::number::format_short;
use protocol::process::{StopFlag, exit};
use serde_json::json;

use self::caller::ExternalMargin;
use self::error::{HuntError, RunEvaluationError};
use self::processes::HuntProcessExecutor;
use self::runs::{RunContext, RunEvaluation, expectations_to_falsify};
use super::execute::read_programs;
use super::reject_inside_run_roots;
use super::scenario::ScenarioArgs;
use super::screen::{
    ProgressLines, print, print_failure, print_info, runs_progress_bar, show_finished_runs,
};
use crate::pool::concurrent_run_count;
use outcome::metrics::expect::FAILED_ROBOTS_NAME;
use run::in_process::measured;
use supervisor::spawn::Launcher;

/// Parent directory of hunts without `--out`.
const HUNTS_DIR: &str = "runs/hunts";
/// Number of runs tried if neither --runs nor --minutes is given.
const DEFAULT_RUN_COUNT: usize = 1000;
/// Number of runs after which a hunt is given up if none of them was valid.
const INVALID_RUNS_MAX: usize = 64;
/// Number of faults above which shrinking starts a new search for a run with at most this number.
const FEW_FAULTS_MAX: usize = 3;
/// Number of runs by processes after which their rate is printed.
const RATE_REPORT_RUN_COUNT: usize = 4;

/// Bounds on the runs for shrinking.
struct ShrinkBounds {
    /// Maximum number of runs that are simpler than the one found.
    runs_max: usize,
    /// Number of candidates of a batch.
    batch_runs: usize,
    /// Maximum number of batches in which a plan with one fault less is searched for, and the number of batches
    /// without a smaller margin after which the search ends.
    one_less_batches_max: usize,
    one_less_failures_max: usize,
    /// Maximum number of runs of a new search for a run with few faults.
    few_faults_runs_max: usize,
}

const IN_PROCESS_SHRINK_BOUNDS: ShrinkBounds = ShrinkBounds {
    runs_max: 3000,
    batch_runs: 16,
    one_less_batches_max: 64,
    one_less_failures_max: 16,
    few_faults_runs_max: 10_000,
};
/// Bounds on runs by processes, each of which takes about a second.
const PROCESS_SHRINK_BOUNDS: ShrinkBounds = ShrinkBounds {
    runs_max: 200,
    batch_runs: 4,
    one_less_batches_max: 4,
    one_less_failures_max: 2,
    few_faults_runs_max: 0,
};

/// Arguments of `phalanx hunt`.
#[derive(Debug, Args)]
pub struct HuntArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Maximum number of runs to try [default: 1000, or as many as fit in --minutes].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    runs: Option<u64>,
    /// Maximum duration of the search, in minutes.
    #[arg(long, value_name = "M", value_parser = parse_minutes)]
    minutes: Option<Duration>,
    /// Parameters to vary: starts, faults, delays, noise, gains [default: `vary` of the scenario's `[hunt]`].
    #[arg(long, value_name = "WHAT", value_delimiter = ',', value_parser = parse_varied)]
    vary: Vec<VariedPart>,
    /// Expectations to falsify, by their keys in `[expect]` [default: all except exit and
    /// deadline_misses_max; min_distance_m if there are none].
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    expect: Vec<String>,
    /// Add an expectation of this name that the calling program evaluates. After each run, phalanx writes the
    /// line "? RUN_DIR" to standard output, and reads the margin of the run from standard input: a number
    /// that decreases as the run comes closer to missing the expectation, and is below 0 if it misses it.
    #[arg(long, value_name = "NAME")]
    margin: Option<String>,
    /// Directory of the journal and the runs found; an interrupted hunt continues from it [default:
    /// runs/hunts/NAME-SEED].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of concurrent runs [default: number of cores].
    #[arg(long, value_name = "RUNS", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Draw every run at random and learn nothing from results, as a baseline.
    #[arg(long)]
    uniform: bool,
    /// Run nothing; print the command lines of HUNTS hunts with different seeds, for GNU parallel,
    /// HyperQueue or a Slurm array.
    #[arg(long, value_name = "HUNTS", value_parser = clap::value_parser!(u16).range(1..))]
    emit_commands: Option<u16>,
}

fn parse_minutes(text: &str) -> Result<Duration, String> {
    let minutes: f64 = text.parse().map_err(|_| "no number".to_owned())?;
    let valid = Some(minutes).filter(|minutes| *minutes > 0.0);
    let duration = valid.and_then(|minutes| Duration::try_from_secs_f64(60.0 * minutes).ok());
    duration.ok_or_else(|| "must be a number of minutes above 0".into())
}

fn parse_varied(text: &str) -> Result<VariedPart, String> {
    let entry = VARY_VALUES.iter().find(|(keyword, _)| *keyword == text);
    let keywords: Vec<&str> = VARY_VALUES.iter().map(|(keyword, _)| *keyword).collect();
    entry
        .map(|(_, varied)| *varied)
        .ok_or_else(|| format!("must be one of {}", keywords.join(", ")))
}

pub(super) fn hunt(
    args: &HuntArgs,
    catalog: &Catalog,
    launcher: &Launcher,
    build: &BuildInfo,
) -> u8 {
    let Ok((scenario, text)) = args.scenario.read(catalog) else { return exit::BAD_SCENARIO };
    let usage_error = |error: &dyn std::fmt::Display| {
        print_failure(error);
        exit::USAGE_ERROR
    };
    let metrics_reason = scenario.has_metric_programs().then_some("metrics that programs compute");
    let process_reason = measured::reason_for_processes(&scenario).or(metrics_reason);
    let (mut expectation_names, assignments) =
        match expectations_to_falsify(&scenario, &args.expect, args.margin.is_some()) {
            Ok(expected) => expected,
            Err(error) => return usage_error(&error),
        };
    if process_reason.is_some() {
        expectation_names.push(FAILED_ROBOTS_NAME.to_owned());
    }
    let Some((scenario, text)) = runs::scenario_with_keys(&scenario, text, assignments, catalog)
    else {
        return exit::BAD_SCENARIO;
    };
    let vary = if args.vary.is_empty() { &scenario.hunt_bounds.varied_parts } else { &args.vary };
    let space = match SearchSpace::new(&scenario, vary) {
        Ok(space) => space,
        Err(error) => return usage_error(&error),
    };
    let default_out = || Path::new(HUNTS_DIR).join(format!("{}-{}", scenario.name, scenario.seed));
    let out = args.out.clone().unwrap_or_else(default_out);
    if let Err(code) = reject_inside_run_roots(&out, "--out") {
        return code;
    }
    if let Some(hunts) = args.emit_commands {
        return print(&command_lines(hunts, scenario.seed, &out));
    }
    let Ok(programs) = read_programs(&scenario, &args.scenario.path) else {
        return exit::BAD_SCENARIO;
    };
    let result = StopFlag::for_run_ending_signals().map_err(HuntError::Signals).and_then(|stop| {
        let jobs = args.jobs.map(usize::from);
        let stop = &stop;
        let caller = args.margin.clone().map(|name| ExternalMargin::new(name, out.clone()));
        let processes = process_reason.map(|reason| {
            print_info(&format!(
                "each run has a process for each robot ({reason}): the number of runs per \
                 minute is measured on the first {RATE_REPORT_RUN_COUNT}"
            ));
            HuntProcessExecutor::new(launcher, &out, programs, stop)
        });
        let (text, space, expectation_names, caller) =
            (&*text, &space, &*expectation_names, caller.as_ref());
        let processes = processes.as_ref();
        let runs = RunContext {
            text,
            space,
            expectation_names,
            external_margin: caller,
            processes,
            catalog,
            build,
            launcher,
            jobs,
            stop,
        };
        let result = run_hunt(args, &scenario, vary, &runs, &out);
        if let (Some(processes), Ok(_) | Err(HuntError::Interrupted)) = (processes, &result) {
            processes.remove_runs_folder();
        }
        result
    });
    result.unwrap_or_else(|error| match error {
        HuntError::Locked(LockError::HeldByProcess { .. })
        | HuntError::Journal(JournalError::OtherHunt(_)) => usage_error(&error),
        HuntError::Interrupted => {
            print_info(&error.to_string());
            exit::INTERRUPTED
        }
        _ => print_failure(&error),
    })
}

/// Returns one command line for each of `hunts` consecutive seeds from `seed`, each with its own output directory.
fn command_lines(hunts: u16, seed: u64, out: &Path) -> String {
    let mut arguments: Vec<String> =
        std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect();
    if let Ok(executable) = std::env::current_exe() {
        arguments[0] = executable.to_string_lossy().into_owned();
    }
    for option in ["--emit-commands", "--out", "--seed"] {
        while let Some(index) =
            arguments.iter().position(|argument| argument.split('=').next() == Some(option))
        {
            let argument_count = if arguments[index].contains('=') { 1 } else { 2 };
            arguments.drain(index..(index + argument_count).min(arguments.len()));
        }
    }
    let line = |seed: u64| {
        let run_dir = out.join(format!("seed-{seed}")).to_string_lossy().into_owned();
        let options = ["--seed".to_owned(), seed.to_string(), "--out".into(), run_dir];
        format_command_line(arguments.iter().chain(&options)) + "\n"
    };
    (0..u64::from(hunts)).map(|offset| line(seed + offset)).collect()
}

/// Progress of a hunt.
#[derive(Default)]
struct HuntProgress {
    tried_runs: usize,
    invalid_runs: usize,
    /// Smallest margin found, with the number of its run, the strategy that proposed the run, and the run's point.
    smallest_margin: Option<(f64, usize, &'static str, Vec<f64>)>,
}

impl HuntProgress {
    fn has_missed(&self) -> bool {
        self.smallest_margin.as_ref().is_some_and(|(margin, ..)| *margin < 0.0)
    }

    /// Adds a run and its evaluation; `None` means that the run is invalid.
    fn add(&mut self, trial: &Trial, evaluation: Option<&Evaluation>) {
        self.tried_runs += 1;
        let Some(Evaluation { cost, .. }) = evaluation else {
            self.invalid_runs += 1;
            return;
        };
        if self.smallest_margin.as_ref().is_none_or(|(smallest, ..)| cost < smallest) {
            let strategy = trial.proposed_by.keyword();
            self.smallest_margin = Some((*cost, self.tried_runs, strategy, trial.point.clone()));
        }
    }
}

fn run_hunt(
    args: &HuntArgs,
    scenario: &Scenario,
    vary: &[VariedPart],
    runs: &RunContext<'_>,
    out: &Path,
) -> Result<u8, HuntError> {
    let folder = CampaignFolder::open_with_subfolders(out, &["found"])?;
    let _lock = folder.lock()?;
    let executable = cells::executable_sha256().map_err(HuntError::Executable)?;
    let expectation_names: Vec<String> =
        runs.expectation_names.iter().chain(&args.margin).cloned().collect();
    let programs = runs.processes.map(HuntProcessExecutor::identity).unwrap_or_default();
    let identity_text = format!(
        "{scenario:?} {vary:?} {expectation_names:?} {} {executable}{programs}",
        args.uniform
    );
    let identity = cells::sha256(identity_text.as_bytes()).map_err(HuntError::Executable)?;
    let mut journal = Journal::open(folder.path(), &identity, &expectation_names)?;
    if let Some(damage) = &journal.damage {
        tracing::warn!("{damage}");
    }
    folder.replace_file("scenario.toml", runs.text)?;
    runs.processes.map_or(Ok(()), HuntProcessExecutor::prepare).map_err(HuntError::Programs)?;
    let progress = search_runs(args, scenario.seed, runs, &mut journal)?;
    let (margin, number, strategy, point) = progress.smallest_margin.as_ref().expect("one was run");
    let plan = runs.space.decode_plan(point);
    let evaluation = runs.run_and_evaluate(&plan)?;
    let is_missed = progress.has_missed();
    let (shrunk_plan, found) = match is_missed {
        true => shrink(runs, plan.clone(), point.clone(), evaluation)?,
        false => (plan.clone(), evaluation),
    };
    let (name, description) = found.describe();
    let file = match is_missed {
        true => format!("found/{}-{name}.toml", scenario.name),
        false => "nearest.toml".to_owned(),
    };
    let path = folder.path().join(&file);
    let replay = ["phalanx", "run", &path.to_string_lossy(), "--pace", "lockstep"];
    let replay = format_command_line(replay.into_iter());
    folder.replace_file(&file, &found.scenario_with_comment(&description))?;
    let page_dir = path.with_extension("");
    runs.write_page(&found, &path, &description, &page_dir)?;
    let (faults, starts) = (shrunk_plan.faults.len(), shrunk_plan.starts.len());
    let report = json!({
        "scenario": scenario.name, "seed": scenario.seed, "runs": progress.tried_runs, "not_sound": progress.invalid_runs,
        "found": is_missed, "run": number, "by": strategy, "expectation": name, "margin": margin,
        "file": file, "margin_of_file": found.margin(), "trajectory_hash": found.hash(), "faults": faults,
        "starts": starts, "what": description,
    });
    folder.replace_file("hunt.json", &to_json(&report))?;
    let mut text = format!("{}: {} runs", scenario.name, progress.tried_runs);
    if progress.invalid_runs > 0 {
        text += &format!(", {} of them invalid and skipped", progress.invalid_runs);
    }
    text += &match is_missed {
        true => format!(
            "\nfound in run {number}, by {strategy}: {description} (margin {})\n",
            format_short(found.margin())
        ),
        false => format!(
            "\nno expectation missed; smallest margin in run {number}, by {strategy}: {description} (margin {})\n",
            format_short(*margin)
        ),
    };
    if is_missed {
        let (faults_before, starts_before) = (plan.faults.len(), plan.starts.len());
        text += &format!(
            "shrunk from {faults_before} faults and {starts_before} other starts to {faults} and {starts}\n"
        );
    }
    let page = page_dir.join("report.html");
    text += &format!("written to {}\npage: {}\n{replay}\n", path.display(), page.display());
    let exit_code = print(&text);
    Ok(if is_missed { exit::EXPECTATION_MISSED } else { exit_code })
}

/// Tries runs until one misses an expectation, or the limit of runs or time is reached.
fn search_runs(
    args: &HuntArgs,
    seed: u64,
    runs: &RunContext<'_>,
    journal: &mut Journal,
) -> Result<HuntProgress, HuntError> {
    let start = Instant::now();
    let default_max = if args.minutes.is_some() { usize::MAX } else { DEFAULT_RUN_COUNT };
    let runs_max = args.runs.map_or(default_max, |runs| runs as usize);
    let (space, used_coordinates) =
        (runs.space, |point: &[f64]| runs.space.used_coordinates(point));
    let mut search = Search::new(
        space.coordinate_layout(),
        &used_coordinates,
        space.unchanged_point(),
        seed,
        args.uniform,
    );
    let (bar, mut lines) = (runs_progress_bar(runs_max), ProgressLines::new(runs_max));
    let mut progress = HuntProgress::default();
    let mut invalid_reason = String::new();
    let mut rate =
        RunRate { start_time: start, run_count: 0, is_printed: runs.processes.is_none() };
    while progress.tried_runs < runs_max && !progress.has_missed() {
        let trials = search.propose_batch();
        let trials = &trials[..trials.len().min(runs_max - progress.tried_runs)];
        let known_entries =
            journal.known_entries.iter().skip(progress.tried_runs).take(trials.len());
        let mut entries: Vec<Option<JournalEntry>> = known_entries.cloned().collect();
        let new_trials = &trials[entries.len()..];
        if !new_trials.is_empty() {
            let has_valid_run = progress.smallest_margin.is_some();
            if has_valid_run && args.minutes.is_some_and(|minutes| start.elapsed() >= minutes) {
                break;
            }
            // Runs by processes take long, so each group of concurrent ones is added to the journal at once.
            let group_size =
                runs.processes.map_or(new_trials.len(), |_| concurrent_run_count(runs.jobs));
            for group in new_trials.chunks(group_size) {
                if runs.processes.is_some() && entries.iter().any(misses_expectation) {
                    break;
                }
                let new_entries = evaluate_new_trials(runs, group, journal, &mut invalid_reason)?;
                rate.add(group.len(), runs_max, args.minutes);
                entries.extend(new_entries);
            }
        }
        // Runs by processes after a miss are not needed.
        let trials = &trials[..entries.len()];
        let cost = |JournalEntry { margins, observed_events }| Evaluation {
            cost: margins.into_iter().fold(f64::INFINITY, f64::min),
            observed_events,
        };
        let evaluations: Vec<Option<Evaluation>> =
            entries.into_iter().map(|entry| entry.map(cost)).collect();
        for (trial, evaluation) in trials.iter().zip(&evaluations) {
            if progress.has_missed() {
                break;
            }
            progress.add(trial, evaluation.as_ref());
        }
        if progress.smallest_margin.is_none()
            && progress.tried_runs >= runs_max.min(INVALID_RUNS_MAX)
        {
            return Err(HuntError::NoValidRun(progress.tried_runs, invalid_reason));
        }
        let margin =
            progress.smallest_margin.as_ref().map_or(f64::INFINITY, |(margin, ..)| *margin);
        show_finished_runs(
            bar,
            &mut lines,
            progress.tried_runs,
            format!(", smallest margin {}", format_short(margin)),
        );
        if !progress.has_missed() {
            search.record_evaluations(&evaluations);
        }
    }
    bar.finish_and_clear();
    Ok(progress)
}

/// Returns whether a run missed an expectation.
fn misses_expectation(entry: &Option<JournalEntry>) -> bool {
    entry.as_ref().is_some_and(|entry| entry.margins.iter().any(|margin| *margin < 0.0))
}

/// Runs new trials and appends them to the journal; by processes, only those up to the first miss. Returns what the
/// journal has of each, and stores why the last invalid one is invalid.
fn evaluate_new_trials(
    runs: &RunContext<'_>,
    trials: &[Trial],
    journal: &mut Journal,
    invalid_reason: &mut String,
) -> Result<Vec<Option<JournalEntry>>, HuntError> {
    let plans: Vec<_> = trials.iter().map(|trial| runs.space.decode_plan(&trial.point)).collect();
    let mut entries = Vec::new();
    for evaluation in runs.run_and_evaluate_all(&plans) {
        entries.push(match evaluation {
            Ok(evaluation) => Some(JournalEntry {
                margins: evaluation.margins,
                observed_events: evaluation.observed_events,
            }),
            Err(RunEvaluationError::InvalidScenario(reason)) => {
                *invalid_reason = reason;
                None
            }
            Err(error) => return Err(error.into()),
        });
    }
    if let (Some(_), Some(missed_index)) =
        (runs.processes, entries.iter().position(misses_expectation))
    {
        // The journal is the same for every number of concurrent runs.
        entries.truncate(missed_index + 1);
    }
    let strategies = trials.iter().map(|trial| trial.proposed_by.keyword());
    journal.append(strategies.zip(&entries)).map_err(HuntError::Write)?;
    Ok(entries)
}

/// Measured number of runs per minute.
struct RunRate {
    start_time: Instant,
    run_count: usize,
    is_printed: bool,
}

impl RunRate {
    /// Adds runs that have ended. Prints the rate once enough of them have, with the time that `runs_max` runs take,
    /// or the number of runs that fit in `minutes`.
    fn add(&mut self, runs: usize, runs_max: usize, minutes: Option<Duration>) {
        self.run_count += runs;
        if self.is_printed || self.run_count < RATE_REPORT_RUN_COUNT {
            return;
        }
        self.is_printed = true;
        let per_minute = 60.0 * self.run_count as f64 / self.start_time.elapsed().as_secs_f64();
        let estimate = match minutes {
            Some(minutes) => {
                let run_count = (per_minute * minutes.as_secs_f64() / 60.0).min(runs_max as f64);
                format!(
                    "about {run_count:.0} runs in {} min",
                    format_short(minutes.as_secs_f64() / 60.0)
                )
            }
            None => format!(
                "{runs_max} runs take up to {:.0} min",
                (runs_max as f64 / per_minute).ceil()
            ),
        };
        print_info(&format!(
            "{per_minute:.0} runs per minute, measured on {}: {estimate}",
            self.run_count
        ));
    }
}

/// Returns the simplest run found that misses the same expectation as `found`, and its result. Removes
/// faults first, if necessary by varying the other numbers of `point`, from which the plan was made.
fn shrink(
    runs: &RunContext<'_>,
    plan: RunPlan,
    mut point: Vec<f64>,
    found: RunEvaluation,
) -> Result<(RunPlan, RunEvaluation), HuntError> {
    let bounds =
        if runs.processes.is_some() { &PROCESS_SHRINK_BOUNDS } else { &IN_PROCESS_SHRINK_BOUNDS };
    let mut shrinker =
        Shrinker { runs, bounds, expectation_index: found.smallest_margin_index(), tried_runs: 0 };
    let mut rng = SplitMix64::new(runs.space.scenario().seed);
    let mut simplest = (plan, found);
    loop {
        simplest = shrinker.shrink_run(simplest, plans_with_fewer_faults)?;
        let mut candidate = shrinker.remove_one_fault(&simplest.0, &point, &mut rng)?;
        if candidate.is_none() && simplest.0.faults.len() > FEW_FAULTS_MAX {
            candidate = shrinker.search_few_faults(&point)?;
        }
        let Some((plan, evaluation, candidate_point)) = candidate else {
            return shrinker.shrink_run(simplest, simpler_plans);
        };
        (simplest, point) = ((plan, evaluation), candidate_point);
    }
}

/// State of shrinking a run that misses an expectation.
struct Shrinker<'r> {
    runs: &'r RunContext<'r>,
    bounds: &'r ShrinkBounds,
    /// Index of the missed expectation.
    expectation_index: usize,
    tried_runs: usize,
}

impl Shrinker<'_> {
    /// Runs the plans and returns the results of the valid ones, with the index of each plan.
    fn evaluate_plans(&self, plans: &[RunPlan]) -> Result<Vec<(usize, RunEvaluation)>, HuntError> {
        let results = self.runs.run_and_evaluate_all(plans);
        let mut valid = Vec::new();
        for (index, result) in results.into_iter().enumerate() {
            match result {
                Ok(evaluation) => valid.push((index, evaluation)),
                Err(error @ (RunEvaluationError::Stopped | RunEvaluationError::NoMargin(_))) => {
                    return Err(error.into());
                }
                Err(_) => {}
            }
        }
        Ok(valid)
    }

    /// Replaces the run by the first simpler run that misses the expectation too, until there is none.
    fn shrink_run(
        &mut self,
        mut simplest: (RunPlan, RunEvaluation),
        simpler: fn(&RunPlan, &SearchSpace) -> Vec<RunPlan>,
    ) -> Result<(RunPlan, RunEvaluation), HuntError> {
        'simpler: while self.tried_runs < self.bounds.runs_max {
            for plans in simpler(&simplest.0, self.runs.space).chunks(self.bounds.batch_runs) {
                self.tried_runs += plans.len();
                let evaluations = self.evaluate_plans(plans)?;
                let found = evaluations
                    .into_iter()
                    .find(|(_, evaluation)| evaluation.margins[self.expectation_index] < 0.0);
                if let Some((index, evaluation)) = found {
                    simplest = (plans[index].clone(), evaluation);
                    continue 'simpler;
                }
            }
            break;
        }
        Ok(simplest)
    }

    /// Searches for a run with one fault less that misses the expectation for other values of the remaining
    /// numbers. Returns its plan, result and point.
    fn remove_one_fault(
        &self,
        plan: &RunPlan,
        point: &[f64],
        rng: &mut SplitMix64,
    ) -> Result<Option<(RunPlan, RunEvaluation, Vec<f64>)>, HuntError> {
        let fault_count = if plan.faults.len() < 2 { 0 } else { plan.faults.len() };
        let space = self.runs.space;
        let attempts = (0..fault_count).rev().flat_map(|index| [(index, false), (index, true)]);
        for (removed_index, strongest) in attempts {
            let mut remaining_faults = plan.faults.clone();
            remaining_faults.remove(removed_index);
            let plan = |point: &Vec<f64>| {
                let plan = space.decode_plan(point).with_only_faults(&remaining_faults);
                if strongest { space.maximize_faults(&plan) } else { plan }
            };
            let (mut smallest_margin, mut best_point, mut best_batch) =
                (f64::INFINITY, point.to_vec(), 0);
            for batch in 0..self.bounds.one_less_batches_max {
                if batch - best_batch > self.bounds.one_less_failures_max {
                    break;
                }
                let points: Vec<_> = (0..self.bounds.batch_runs)
                    .map(|_| draw_nearby_point(&best_point, space, rng))
                    .collect();
                let plans: Vec<_> = points.iter().map(plan).collect();
                for (index, evaluation) in self.evaluate_plans(&plans)? {
                    let margin = evaluation.margins[self.expectation_index];
                    if margin < 0.0 {
                        return Ok(Some((plans[index].clone(), evaluation, points[index].clone())));
                    }
                    if margin < smallest_margin {
                        (smallest_margin, best_point, best_batch) =
                            (margin, points[index].clone(), batch);
                    }
                }
            }
        }
        Ok(None)
    }

    /// Starts a new search for a run with at most [`FEW_FAULTS_MAX`] faults that misses the expectation.
    /// Returns its plan, result and point.
    fn search_few_faults(
        &self,
        point: &[f64],
    ) -> Result<Option<(RunPlan, RunEvaluation, Vec<f64>)>, HuntError> {
        let (space, seed) = (self.runs.space, self.runs.space.scenario().seed);
        let used_coordinates = |point: &[f64]| space.used_coordinates(point);
        let mut search =
            Search::new(space.coordinate_layout(), &used_coordinates, point.to_vec(), seed, false);
        let mut tried_runs = 0;
        while tried_runs < self.bounds.few_faults_runs_max {
            let trials = search.propose_batch().to_vec();
            tried_runs += trials.len();
            let mut plans: Vec<_> =
                trials.iter().map(|trial| space.decode_plan(&trial.point)).collect();
            plans.iter_mut().for_each(|plan| plan.faults.truncate(FEW_FAULTS_MAX));
            let mut evaluations = vec![None; plans.len()];
            for (index, evaluation) in self.evaluate_plans(&plans)? {
                let cost = evaluation.margins[self.expectation_index];
                if cost < 0.0 {
                    let (plan, point) = (plans[index].clone(), trials[index].point.clone());
                    return Ok(Some((plan, evaluation, point)));
                }
                evaluations[index] =
                    Some(Evaluation { cost, observed_events: evaluation.observed_events });
            }
            search.record_evaluations(&evaluations);
        }
        Ok(None)
    }
}
