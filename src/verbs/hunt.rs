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
    let sound = Some(minutes).filter(|minutes| *minutes > 0.0);
    let duration = sound.and_then(|minutes| Duration::try_from_secs_f64(60.0 * minutes).ok());
    duration.ok_or_else(|| "must be a number of minutes above 0".into())
}

fn parse_varied(word: &str) -> Result<VariedPart, String> {
    let found = VARY_VALUES.iter().find(|(known, _)| *known == word);
    let known: Vec<&str> = VARY_VALUES.iter().map(|(known, _)| *known).collect();
    found.map(|(_, varied)| *varied).ok_or_else(|| format!("must be one of {}", known.join(", ")))
}

pub(super) fn hunt(
    args: &HuntArgs,
    catalog: &Catalog,
    launcher: &Launcher,
    build: &BuildInfo,
) -> u8 {
    let Ok((scenario, text)) = args.scenario.read(catalog) else { return exit::BAD_SCENARIO };
    let refused = |why: &dyn std::fmt::Display| {
        print_failure(why);
        exit::USAGE_ERROR
    };
    let of_metrics = scenario.has_metric_programs().then_some("metrics that programs compute");
    let by_processes = measured::reason_for_processes(&scenario).or(of_metrics);
    let (mut names, set) =
        match expectations_to_falsify(&scenario, &args.expect, args.margin.is_some()) {
            Ok(expected) => expected,
            Err(why) => return refused(&why),
        };
    if by_processes.is_some() {
        names.push(FAILED_ROBOTS_NAME.to_owned());
    }
    let Some((scenario, text)) = runs::scenario_with_keys(&scenario, text, set, catalog) else {
        return exit::BAD_SCENARIO;
    };
    let vary = if args.vary.is_empty() { &scenario.hunt_bounds.varied_parts } else { &args.vary };
    let space = match SearchSpace::new(&scenario, vary) {
        Ok(space) => space,
        Err(why) => return refused(&why),
    };
    let default = || Path::new(HUNTS_DIR).join(format!("{}-{}", scenario.name, scenario.seed));
    let out = args.out.clone().unwrap_or_else(default);
    if let Err(code) = reject_inside_run_roots(&out, "--out") {
        return code;
    }
    if let Some(hunts) = args.emit_commands {
        return print(&command_lines(hunts, scenario.seed, &out));
    }
    let Ok(programs) = read_programs(&scenario, &args.scenario.path) else {
        return exit::BAD_SCENARIO;
    };
    let ended = StopFlag::for_run_ending_signals().map_err(HuntError::Signals).and_then(|stop| {
        let jobs = args.jobs.map(usize::from);
        let stop = &stop;
        let caller = args.margin.clone().map(|name| ExternalMargin::new(name, out.clone()));
        let processes = by_processes.map(|why| {
            print_info(&format!(
                "each run has a process for each robot ({why}): the number of runs per \
                 minute is measured on the first {RATE_REPORT_RUN_COUNT}"
            ));
            HuntProcessExecutor::new(launcher, &out, programs, stop)
        });
        let (text, space, names, caller) = (&*text, &space, &*names, caller.as_ref());
        let processes = processes.as_ref();
        let runs = RunContext {
            text,
            space,
            expectation_names: names,
            external_margin: caller,
            processes,
            catalog,
            build,
            launcher,
            jobs,
            stop,
        };
        let ended = run_hunt(args, &scenario, vary, &runs, &out);
        if let (Some(processes), Ok(_) | Err(HuntError::Interrupted)) = (processes, &ended) {
            processes.remove_runs_folder();
        }
        ended
    });
    ended.unwrap_or_else(|error| match error {
        HuntError::Locked(LockError::HeldByProcess { .. })
        | HuntError::Journal(JournalError::OtherHunt(_)) => refused(&error),
        HuntError::Interrupted => {
            print_info(&error.to_string());
            exit::INTERRUPTED
        }
        _ => print_failure(&error),
    })
}

/// Returns one command line for each of `hunts` consecutive seeds from `seed`, each with its own output directory.
fn command_lines(hunts: u16, seed: u64, out: &Path) -> String {
    let mut words: Vec<String> =
        std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    if let Ok(executable) = std::env::current_exe() {
        words[0] = executable.to_string_lossy().into_owned();
    }
    for option in ["--emit-commands", "--out", "--seed"] {
        while let Some(place) = words.iter().position(|word| word.split('=').next() == Some(option))
        {
            let with_value = if words[place].contains('=') { 1 } else { 2 };
            words.drain(place..(place + with_value).min(words.len()));
        }
    }
    let line = |seed: u64| {
        let to = out.join(format!("seed-{seed}")).to_string_lossy().into_owned();
        let own = ["--seed".to_owned(), seed.to_string(), "--out".into(), to];
        format_command_line(words.iter().chain(&own)) + "\n"
    };
    (0..u64::from(hunts)).map(|more| line(seed + more)).collect()
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
    let names: Vec<String> = runs.expectation_names.iter().chain(&args.margin).cloned().collect();
    let programs = runs.processes.map(HuntProcessExecutor::identity).unwrap_or_default();
    let of = format!("{scenario:?} {vary:?} {names:?} {} {executable}{programs}", args.uniform);
    let identity = cells::sha256(of.as_bytes()).map_err(HuntError::Executable)?;
    let mut journal = Journal::open(folder.path(), &identity, &names)?;
    if let Some(damage) = &journal.damage {
        tracing::warn!("{damage}");
    }
    folder.replace_file("scenario.toml", runs.text)?;
    runs.processes.map_or(Ok(()), HuntProcessExecutor::prepare).map_err(HuntError::Programs)?;
    let tally = search_runs(args, scenario.seed, runs, &mut journal)?;
    let (margin, number, by, point) = tally.smallest_margin.as_ref().expect("one was run");
    let plan = runs.space.decode_plan(point);
    let nearest = runs.run_and_evaluate(&plan)?;
    let missed = tally.has_missed();
    let (shrunk, found) = match missed {
        true => shrink(runs, plan.clone(), point.clone(), nearest)?,
        false => (plan.clone(), nearest),
    };
    let (name, words) = found.describe();
    let file = match missed {
        true => format!("found/{}-{name}.toml", scenario.name),
        false => "nearest.toml".to_owned(),
    };
    let path = folder.path().join(&file);
    let replay = ["phalanx", "run", &path.to_string_lossy(), "--pace", "lockstep"];
    let replay = format_command_line(replay.into_iter());
    folder.replace_file(&file, &found.scenario_with_comment(&words))?;
    let drawn = path.with_extension("");
    runs.write_page(&found, &path, &words, &drawn)?;
    let (faults, starts) = (shrunk.faults.len(), shrunk.starts.len());
    let report = json!({
        "scenario": scenario.name, "seed": scenario.seed, "runs": tally.tried_runs, "not_sound": tally.invalid_runs,
        "found": missed, "run": number, "by": by, "expectation": name, "margin": margin,
        "file": file, "margin_of_file": found.margin(), "trajectory_hash": found.hash(), "faults": faults,
        "starts": starts, "what": words,
    });
    folder.replace_file("hunt.json", &to_json(&report))?;
    let mut text = format!("{}: {} runs", scenario.name, tally.tried_runs);
    if tally.invalid_runs > 0 {
        text += &format!(", {} of them invalid and skipped", tally.invalid_runs);
    }
    text += &match missed {
        true => format!(
            "\nfound in run {number}, by {by}: {words} (margin {})\n",
            format_short(found.margin())
        ),
        false => format!(
            "\nno expectation missed; smallest margin in run {number}, by {by}: {words} (margin {})\n",
            format_short(*margin)
        ),
    };
    if missed {
        let (before, starts_before) = (plan.faults.len(), plan.starts.len());
        text += &format!(
            "shrunk from {before} faults and {starts_before} other starts to {faults} and {starts}\n"
        );
    }
    let page = drawn.join("report.html");
    text += &format!("written to {}\npage: {}\n{replay}\n", path.display(), page.display());
    let printed = print(&text);
    Ok(if missed { exit::EXPECTATION_MISSED } else { printed })
}

/// Tries runs until one misses an expectation, or the limit of runs or time is reached.
fn search_runs(
    args: &HuntArgs,
    seed: u64,
    runs: &RunContext<'_>,
    journal: &mut Journal,
) -> Result<HuntProgress, HuntError> {
    let began = Instant::now();
    let otherwise = if args.minutes.is_some() { usize::MAX } else { DEFAULT_RUN_COUNT };
    let most = args.runs.map_or(otherwise, |runs| runs as usize);
    let (space, matters) = (runs.space, |point: &[f64]| runs.space.used_coordinates(point));
    let mut search = Search::new(
        space.coordinate_layout(),
        &matters,
        space.unchanged_point(),
        seed,
        args.uniform,
    );
    let (bar, mut lines) = (runs_progress_bar(most), ProgressLines::new(most));
    let mut tally = HuntProgress::default();
    let mut why_unsound = String::new();
    let mut rate =
        RunRate { start_time: began, run_count: 0, is_printed: runs.processes.is_none() };
    while tally.tried_runs < most && !tally.has_missed() {
        let trials = search.propose_batch();
        let trials = &trials[..trials.len().min(most - tally.tried_runs)];
        let known = journal.known_entries.iter().skip(tally.tried_runs).take(trials.len());
        let mut came: Vec<Option<JournalEntry>> = known.cloned().collect();
        let fresh = &trials[came.len()..];
        if !fresh.is_empty() {
            let any = tally.smallest_margin.is_some();
            if any && args.minutes.is_some_and(|minutes| began.elapsed() >= minutes) {
                break;
            }
            // Runs by processes take long, so each group of concurrent ones is added to the journal at once.
            let group = runs.processes.map_or(fresh.len(), |_| concurrent_run_count(runs.jobs));
            for fresh in fresh.chunks(group) {
                if runs.processes.is_some() && came.iter().any(misses_expectation) {
                    break;
                }
                let news = evaluate_new_trials(runs, fresh, journal, &mut why_unsound)?;
                rate.add(fresh.len(), most, args.minutes);
                came.extend(news);
            }
        }
        // Runs by processes after a miss are not needed.
        let trials = &trials[..came.len()];
        let cost = |JournalEntry { margins, observed_events: traits }| Evaluation {
            cost: margins.into_iter().fold(f64::INFINITY, f64::min),
            observed_events: traits,
        };
        let told: Vec<Option<Evaluation>> = came.into_iter().map(|tried| tried.map(cost)).collect();
        for (trial, came) in trials.iter().zip(&told) {
            if tally.has_missed() {
                break;
            }
            tally.tried_runs += 1;
            match came {
                None => tally.invalid_runs += 1,
                Some(Evaluation { cost, .. })
                    if tally.smallest_margin.as_ref().is_none_or(|(least, ..)| cost < least) =>
                {
                    tally.smallest_margin = Some((
                        *cost,
                        tally.tried_runs,
                        trial.proposed_by.keyword(),
                        trial.point.clone(),
                    ));
                }
                Some(_) => {}
            }
        }
        if tally.smallest_margin.is_none() && tally.tried_runs >= most.min(INVALID_RUNS_MAX) {
            return Err(HuntError::NoValidRun(tally.tried_runs, why_unsound));
        }
        let margin = tally.smallest_margin.as_ref().map_or(f64::INFINITY, |(margin, ..)| *margin);
        show_finished_runs(
            bar,
            &mut lines,
            tally.tried_runs,
            format!(", smallest margin {}", format_short(margin)),
        );
        if !tally.has_missed() {
            search.record_evaluations(&told);
        }
    }
    bar.finish_and_clear();
    Ok(tally)
}

/// Returns whether a run missed an expectation.
fn misses_expectation(tried: &Option<JournalEntry>) -> bool {
    tried.as_ref().is_some_and(|tried| tried.margins.iter().any(|margin| *margin < 0.0))
}

/// Runs new trials and appends them to the journal; by processes, only those up to the first miss. Returns what the
/// journal has of each, and stores why the last invalid one is invalid.
fn evaluate_new_trials(
    runs: &RunContext<'_>,
    trials: &[Trial],
    journal: &mut Journal,
    why_unsound: &mut String,
) -> Result<Vec<Option<JournalEntry>>, HuntError> {
    let plans: Vec<_> = trials.iter().map(|trial| runs.space.decode_plan(&trial.point)).collect();
    let mut news = Vec::new();
    for judged in runs.run_and_evaluate_all(&plans) {
        news.push(match judged {
            Ok(judged) => Some(JournalEntry {
                margins: judged.margins,
                observed_events: judged.observed_events,
            }),
            Err(RunEvaluationError::InvalidScenario(why)) => {
                *why_unsound = why;
                None
            }
            Err(why) => return Err(why.into()),
        });
    }
    if let (Some(_), Some(missed)) = (runs.processes, news.iter().position(misses_expectation)) {
        // The journal is the same for every number of concurrent runs.
        news.truncate(missed + 1);
    }
    let by = trials.iter().map(|trial| trial.proposed_by.keyword());
    journal.append(by.zip(&news)).map_err(HuntError::Write)?;
    Ok(news)
}

/// Measured number of runs per minute.
struct RunRate {
    start_time: Instant,
    run_count: usize,
    is_printed: bool,
}

impl RunRate {
    /// Adds runs that have ended. Prints the rate once enough of them have, with the time that `most` runs take, or the
    /// number of runs that fit in `minutes`.
    fn add(&mut self, runs: usize, most: usize, minutes: Option<Duration>) {
        self.run_count += runs;
        if self.is_printed || self.run_count < RATE_REPORT_RUN_COUNT {
            return;
        }
        self.is_printed = true;
        let per_minute = 60.0 * self.run_count as f64 / self.start_time.elapsed().as_secs_f64();
        let all = match minutes {
            Some(minutes) => {
                let fit = (per_minute * minutes.as_secs_f64() / 60.0).min(most as f64);
                format!("about {fit:.0} runs in {} min", format_short(minutes.as_secs_f64() / 60.0))
            }
            None => format!("{most} runs take up to {:.0} min", (most as f64 / per_minute).ceil()),
        };
        print_info(&format!(
            "{per_minute:.0} runs per minute, measured on {}: {all}",
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
    let mut shrinking =
        Shrinker { runs, bounds, expectation_index: found.smallest_margin_index(), tried_runs: 0 };
    let mut random = SplitMix64::new(runs.space.scenario().seed);
    let mut least = (plan, found);
    loop {
        least = shrinking.shrink_run(least, plans_with_fewer_faults)?;
        let mut fewer = shrinking.remove_one_fault(&least.0, &point, &mut random)?;
        if fewer.is_none() && least.0.faults.len() > FEW_FAULTS_MAX {
            fewer = shrinking.search_few_faults(&point)?;
        }
        let Some((plan, judged, at)) = fewer else {
            return shrinking.shrink_run(least, simpler_plans);
        };
        (least, point) = ((plan, judged), at);
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
        let all = self.runs.run_and_evaluate_all(plans);
        let mut sound = Vec::new();
        for (place, judged) in all.into_iter().enumerate() {
            match judged {
                Ok(judged) => sound.push((place, judged)),
                Err(why @ (RunEvaluationError::Stopped | RunEvaluationError::NoMargin(_))) => {
                    return Err(why.into());
                }
                Err(_) => {}
            }
        }
        Ok(sound)
    }

    /// Replaces the run by the first simpler run that misses the expectation too, until there is none.
    fn shrink_run(
        &mut self,
        mut least: (RunPlan, RunEvaluation),
        simpler: fn(&RunPlan, &SearchSpace) -> Vec<RunPlan>,
    ) -> Result<(RunPlan, RunEvaluation), HuntError> {
        'simpler: while self.tried_runs < self.bounds.runs_max {
            for plans in simpler(&least.0, self.runs.space).chunks(self.bounds.batch_runs) {
                self.tried_runs += plans.len();
                let judged = self.evaluate_plans(plans)?;
                let missed = judged
                    .into_iter()
                    .find(|(_, judged)| judged.margins[self.expectation_index] < 0.0);
                if let Some((place, judged)) = missed {
                    least = (plans[place].clone(), judged);
                    continue 'simpler;
                }
            }
            break;
        }
        Ok(least)
    }

    /// Searches for a run with one fault less that misses the expectation for other values of the remaining
    /// numbers. Returns its plan, result and point.
    fn remove_one_fault(
        &self,
        plan: &RunPlan,
        point: &[f64],
        random: &mut SplitMix64,
    ) -> Result<Option<(RunPlan, RunEvaluation, Vec<f64>)>, HuntError> {
        let gone = if plan.faults.len() < 2 { 0 } else { plan.faults.len() };
        let space = self.runs.space;
        let ways = (0..gone).rev().flat_map(|gone| [(gone, false), (gone, true)]);
        for (gone, strongest) in ways {
            let mut kept = plan.faults.clone();
            kept.remove(gone);
            let plan = |point: &Vec<f64>| {
                let plan = space.decode_plan(point).with_only_faults(&kept);
                if strongest { space.maximize_faults(&plan) } else { plan }
            };
            let (mut nearest, mut at, mut nearer) = (f64::INFINITY, point.to_vec(), 0);
            for batch in 0..self.bounds.one_less_batches_max {
                if batch - nearer > self.bounds.one_less_failures_max {
                    break;
                }
                let points: Vec<_> = (0..self.bounds.batch_runs)
                    .map(|_| draw_nearby_point(&at, space, random))
                    .collect();
                let plans: Vec<_> = points.iter().map(plan).collect();
                for (place, judged) in self.evaluate_plans(&plans)? {
                    let margin = judged.margins[self.expectation_index];
                    if margin < 0.0 {
                        return Ok(Some((plans[place].clone(), judged, points[place].clone())));
                    }
                    if margin < nearest {
                        (nearest, at, nearer) = (margin, points[place].clone(), batch);
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
        let matters = |point: &[f64]| space.used_coordinates(point);
        let mut search =
            Search::new(space.coordinate_layout(), &matters, point.to_vec(), seed, false);
        let mut tried = 0;
        while tried < self.bounds.few_faults_runs_max {
            let trials = search.propose_batch().to_vec();
            tried += trials.len();
            let mut plans: Vec<_> =
                trials.iter().map(|trial| space.decode_plan(&trial.point)).collect();
            plans.iter_mut().for_each(|plan| plan.faults.truncate(FEW_FAULTS_MAX));
            let mut came = vec![None; plans.len()];
            for (place, judged) in self.evaluate_plans(&plans)? {
                let cost = judged.margins[self.expectation_index];
                if cost < 0.0 {
                    let (plan, point) = (plans[place].clone(), trials[place].point.clone());
                    return Ok(Some((plan, judged, point)));
                }
                came[place] = Some(Evaluation { cost, observed_events: judged.observed_events });
            }
            search.record_evaluations(&came);
        }
        Ok(None)
    }
}
