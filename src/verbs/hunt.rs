//! `phalanx hunt`: searches for a run that misses an expectation, and shrinks it to the simplest such run.
//!
//! Runs are computed within this process. The runs tried depend on the scenario, the seed and the results
//! of earlier runs only; a journal lets an interrupted hunt continue to the same result.

mod behavior;
mod caller;
mod page;
mod runs;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use experiment::campaign::cells;
use experiment::hunt::plan::Plan;
use experiment::hunt::search::{Evaluation, Search};
use experiment::hunt::shrink::{draw_nearby_point, fewer_faults, simpler_plans};
use experiment::hunt::space::Space;
use experiment::scenario::hunt::VARIED;
use experiment::scenario::{Scenario, Varied};
use formation::random::SplitMix64;
use outcome::campaign::folder::{Folder, FolderError, LockError};
use outcome::campaign::hunt_journal::{Journal, JournalEntry, JournalError};
use outcome::results::manifest::Build;
use outcome::results::page::command_line;
use outcome::results::summary::to_json;
use protocol::catalog::Catalog;
use protocol::number::format_short;
use protocol::process::{Stop, exit};
use serde_json::json;

use self::caller::Caller;
use self::runs::{JudgeError, JudgedRun, Runs, expectations_to_falsify};
use super::reject_inside_run_roots;
use super::scenario::ScenarioArgs;
use super::screen::{ProgressLines, print, print_failure, print_info, runs_done, runs_progress};
use run::in_process::measured;

/// Parent directory of hunts without `--out`.
const HUNTS: &str = "runs/hunts";
/// Number of runs tried if neither --runs nor --minutes is given.
const RUNS: usize = 1000;
/// Number of runs after which a hunt is given up if none of them was valid.
const UNSOUND_MAX: usize = 64;
/// Maximum number of runs for shrinking, and the number of candidates run concurrently.
const SHRINK_RUNS: usize = 3000;
const SHRINK_AT_ONCE: usize = 16;
/// Maximum number of batches in which a plan with one fault less is searched for, and the number of batches
/// without a smaller margin after which the search ends.
const ONE_LESS_BATCHES: usize = 64;
const ONE_LESS_PATIENCE: usize = 16;
/// Number of faults above which shrinking starts a new search for a run with at most this number, and the
/// maximum number of runs of that search.
const FEW_FAULTS: usize = 3;
const FEW_FAULTS_RUNS: usize = 10_000;

/// Arguments of `phalanx hunt`.
#[derive(Debug, Args)]
pub struct HuntArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Maximum number of runs to try [default: 1000, or as many as fit in --minutes].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    runs: Option<u64>,
    /// Maximum duration of the search, in minutes.
    #[arg(long, value_name = "M", value_parser = minutes)]
    minutes: Option<Duration>,
    /// Parameters to vary: starts, faults, delays, noise, gains [default: `vary` of the scenario's `[hunt]`].
    #[arg(long, value_name = "WHAT", value_delimiter = ',', value_parser = parse_varied)]
    vary: Vec<Varied>,
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

fn minutes(text: &str) -> Result<Duration, String> {
    let minutes: f64 = text.parse().map_err(|_| "no number".to_owned())?;
    let sound = Some(minutes).filter(|minutes| *minutes > 0.0);
    let duration = sound.and_then(|minutes| Duration::try_from_secs_f64(60.0 * minutes).ok());
    duration.ok_or_else(|| "must be a number of minutes above 0".into())
}

fn parse_varied(word: &str) -> Result<Varied, String> {
    let found = VARIED.iter().find(|(known, _)| *known == word);
    let known: Vec<&str> = VARIED.iter().map(|(known, _)| *known).collect();
    found.map(|(_, varied)| *varied).ok_or_else(|| format!("must be one of {}", known.join(", ")))
}

/// Error that ends a hunt. Runs already tried stay in the journal.
#[derive(Debug, thiserror::Error)]
enum HuntError {
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error(transparent)]
    Locked(#[from] LockError),
    #[error(transparent)]
    Journal(#[from] JournalError),
    #[error("cannot write the journal: {0}")]
    Written(std::io::Error),
    #[error("cannot handle signals: {0}")]
    Signals(std::io::Error),
    #[error("cannot read the executable: {0}")]
    Executable(std::io::Error),
    #[error("none of the first {0} runs is valid: {1}")]
    NothingSound(usize, String),
    #[error("cannot write the page of what was found: {0}")]
    Page(String),
    #[error("a run panicked: {0}")]
    Panicked(String),
    #[error("{0}")]
    NoMargin(String),
    #[error("interrupted: run the same command to continue")]
    Interrupted,
}

impl From<JudgeError> for HuntError {
    fn from(why: JudgeError) -> HuntError {
        match why {
            JudgeError::Unsound(why) => HuntError::NothingSound(1, why),
            JudgeError::Panicked(why) => HuntError::Panicked(why),
            JudgeError::NoMargin(why) => HuntError::NoMargin(why),
            JudgeError::Stopped => HuntError::Interrupted,
        }
    }
}

pub(super) fn hunt(args: &HuntArgs, catalog: &Catalog, build: &Build) -> u8 {
    let Ok((scenario, text)) = args.scenario.read(catalog) else { return exit::BAD_SCENARIO };
    let refused = |why: &dyn std::fmt::Display| {
        print_failure(why);
        exit::USAGE
    };
    if let Some(why) = measured::needs_processes(&scenario) {
        return refused(&format_args!(
            "a hunt runs within one process, but {why} need processes of their own"
        ));
    }
    let (names, set) = match expectations_to_falsify(&scenario, &args.expect, args.margin.is_some())
    {
        Ok(expected) => expected,
        Err(why) => return refused(&why),
    };
    let Some((scenario, text)) = runs::scenario_with_keys(&scenario, text, set, catalog) else {
        return exit::BAD_SCENARIO;
    };
    let vary = if args.vary.is_empty() { &scenario.hunt.vary } else { &args.vary };
    let space = match Space::new(&scenario, vary) {
        Ok(space) => space,
        Err(why) => return refused(&why),
    };
    let default = || Path::new(HUNTS).join(format!("{}-{}", scenario.name, scenario.seed));
    let out = args.out.clone().unwrap_or_else(default);
    if let Err(code) = reject_inside_run_roots(&out, "--out") {
        return code;
    }
    if let Some(hunts) = args.emit_commands {
        return print(&commands(hunts, scenario.seed, &out));
    }
    let ended = Stop::stop_on_signals().map_err(HuntError::Signals).and_then(|stop| {
        let jobs = args.jobs.map(usize::from);
        let stop = &stop;
        let caller = args.margin.clone().map(|name| Caller::new(name, out.clone()));
        let (text, space, names, caller) = (&*text, &space, &*names, caller.as_ref());
        let runs = Runs { text, space, names, caller, catalog, build, jobs, stop };
        run_hunt(args, &scenario, vary, &runs, &out)
    });
    ended.unwrap_or_else(|error| match error {
        HuntError::Locked(LockError::Held { .. }) | HuntError::Journal(JournalError::Other(_)) => {
            refused(&error)
        }
        HuntError::Interrupted => {
            print_info(&error.to_string());
            exit::INTERRUPTED
        }
        _ => print_failure(&error),
    })
}

/// Returns one command line for each of `hunts` consecutive seeds from `seed`, each with its own output directory.
fn commands(hunts: u16, seed: u64, out: &Path) -> String {
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
        command_line(words.iter().chain(&own)) + "\n"
    };
    (0..u64::from(hunts)).map(|more| line(seed + more)).collect()
}

/// Progress of a hunt.
#[derive(Default)]
struct Tally {
    tried: usize,
    unsound: usize,
    /// Smallest margin found, with the number of its run, the strategy that proposed the run, and the run's point.
    nearest: Option<(f64, usize, &'static str, Vec<f64>)>,
}

impl Tally {
    fn missed(&self) -> bool {
        self.nearest.as_ref().is_some_and(|(margin, ..)| *margin < 0.0)
    }
}

fn run_hunt(
    args: &HuntArgs,
    scenario: &Scenario,
    vary: &[Varied],
    runs: &Runs<'_>,
    out: &Path,
) -> Result<u8, HuntError> {
    let folder = Folder::open_with_subfolders(out, &["found"])?;
    let _lock = folder.lock()?;
    let executable = cells::executable().map_err(HuntError::Executable)?;
    let names: Vec<String> = runs.names.iter().chain(&args.margin).cloned().collect();
    let of = format!("{scenario:?} {vary:?} {names:?} {} {executable}", args.uniform);
    let identity = cells::sha256(of.as_bytes()).map_err(HuntError::Executable)?;
    let mut journal = Journal::open(folder.path(), &identity, &names)?;
    if let Some(damage) = &journal.damage {
        tracing::warn!("{damage}");
    }
    folder.write("scenario.toml", runs.text)?;
    let tally = search_runs(args, scenario.seed, runs, &mut journal)?;
    let (margin, number, by, point) = tally.nearest.as_ref().expect("one was run");
    let plan = runs.space.plan(point);
    let nearest = runs.judge(&plan)?;
    let missed = tally.missed();
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
    let replay = command_line(replay.into_iter());
    folder.write(&file, &found.scenario_with_comment(&words))?;
    let drawn = path.with_extension("");
    page::write(&path, &words, &drawn, runs.catalog, runs.build).map_err(HuntError::Page)?;
    let (faults, starts) = (shrunk.faults.len(), shrunk.starts.len());
    let report = json!({
        "scenario": scenario.name, "seed": scenario.seed, "runs": tally.tried, "not_sound": tally.unsound,
        "found": missed, "run": number, "by": by, "expectation": name, "margin": margin,
        "file": file, "margin_of_file": found.margin(), "trajectory_hash": found.hash(), "faults": faults,
        "starts": starts, "what": words,
    });
    folder.write("hunt.json", &to_json(&report))?;
    let mut text = format!("{}: {} runs", scenario.name, tally.tried);
    if tally.unsound > 0 {
        text += &format!(", {} of them invalid and skipped", tally.unsound);
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
    runs: &Runs<'_>,
    journal: &mut Journal,
) -> Result<Tally, HuntError> {
    let began = Instant::now();
    let otherwise = if args.minutes.is_some() { usize::MAX } else { RUNS };
    let most = args.runs.map_or(otherwise, |runs| runs as usize);
    let (space, matters) = (runs.space, |point: &[f64]| runs.space.used_coordinates(point));
    let mut search = Search::new(
        space.coordinate_shape(),
        &matters,
        space.unchanged_point(),
        seed,
        args.uniform,
    );
    let (bar, mut lines) = (runs_progress(most), ProgressLines::new(most));
    let mut tally = Tally::default();
    let mut why_unsound = String::new();
    while tally.tried < most && !tally.missed() {
        let trials = search.propose_batch();
        let trials = &trials[..trials.len().min(most - tally.tried)];
        let known = journal.known_entries.iter().skip(tally.tried).take(trials.len());
        let mut came: Vec<Option<JournalEntry>> = known.cloned().collect();
        let fresh = &trials[came.len()..];
        if !fresh.is_empty() {
            let any = tally.nearest.is_some();
            if any && args.minutes.is_some_and(|minutes| began.elapsed() >= minutes) {
                break;
            }
            let plans: Vec<_> = fresh.iter().map(|trial| runs.space.plan(&trial.point)).collect();
            let mut news: Vec<Option<JournalEntry>> = Vec::new();
            for judged in runs.judge_all(&plans) {
                news.push(match judged {
                    Ok(judged) => {
                        Some(JournalEntry { margins: judged.margins, traits: judged.traits })
                    }
                    Err(JudgeError::Unsound(why)) => {
                        why_unsound = why;
                        None
                    }
                    Err(why) => return Err(why.into()),
                });
            }
            let by = fresh.iter().map(|trial| trial.proposed_by.keyword());
            journal.append(by.zip(&news)).map_err(HuntError::Written)?;
            came.extend(news);
        }
        let cost = |JournalEntry { margins, traits }| Evaluation {
            cost: margins.into_iter().fold(f64::INFINITY, f64::min),
            traits,
        };
        let told: Vec<Option<Evaluation>> = came.into_iter().map(|tried| tried.map(cost)).collect();
        for (trial, came) in trials.iter().zip(&told) {
            if tally.missed() {
                break;
            }
            tally.tried += 1;
            match came {
                None => tally.unsound += 1,
                Some(Evaluation { cost, .. })
                    if tally.nearest.as_ref().is_none_or(|(least, ..)| cost < least) =>
                {
                    tally.nearest = Some((
                        *cost,
                        tally.tried,
                        trial.proposed_by.keyword(),
                        trial.point.clone(),
                    ));
                }
                Some(_) => {}
            }
        }
        if tally.nearest.is_none() && tally.tried >= most.min(UNSOUND_MAX) {
            return Err(HuntError::NothingSound(tally.tried, why_unsound));
        }
        let margin = tally.nearest.as_ref().map_or(f64::INFINITY, |(margin, ..)| *margin);
        runs_done(
            bar,
            &mut lines,
            tally.tried,
            format!(", smallest margin {}", format_short(margin)),
        );
        search.record_evaluations(&told);
    }
    bar.finish_and_clear();
    Ok(tally)
}

/// Returns the simplest run found that misses the same expectation as `found`, and its result. Removes
/// faults first, if necessary by varying the other numbers of `point`, from which the plan was made.
fn shrink(
    runs: &Runs<'_>,
    plan: Plan,
    mut point: Vec<f64>,
    found: JudgedRun,
) -> Result<(Plan, JudgedRun), HuntError> {
    let mut shrinking = Shrinking { runs, expectation: found.smallest_margin(), tried: 0 };
    let mut random = SplitMix64::new(runs.space.scenario().seed);
    let mut least = (plan, found);
    loop {
        least = shrinking.shrink_run(least, fewer_faults)?;
        let mut fewer = shrinking.remove_one_fault(&least.0, &point, &mut random)?;
        if fewer.is_none() && least.0.faults.len() > FEW_FAULTS {
            fewer = shrinking.search_few_faults(&point)?;
        }
        let Some((plan, judged, at)) = fewer else {
            return shrinking.shrink_run(least, simpler_plans);
        };
        (least, point) = ((plan, judged), at);
    }
}

/// State of shrinking a run that misses an expectation.
struct Shrinking<'r> {
    runs: &'r Runs<'r>,
    /// Index of the missed expectation.
    expectation: usize,
    tried: usize,
}

impl Shrinking<'_> {
    /// Runs the plans and returns the results of the valid ones, with the index of each plan.
    fn judge(&self, plans: &[Plan]) -> Result<Vec<(usize, JudgedRun)>, HuntError> {
        let all = self.runs.judge_all(plans);
        let mut sound = Vec::new();
        for (place, judged) in all.into_iter().enumerate() {
            match judged {
                Ok(judged) => sound.push((place, judged)),
                Err(why @ (JudgeError::Stopped | JudgeError::NoMargin(_))) => {
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
        mut least: (Plan, JudgedRun),
        simpler: fn(&Plan, &Space) -> Vec<Plan>,
    ) -> Result<(Plan, JudgedRun), HuntError> {
        'simpler: while self.tried < SHRINK_RUNS {
            for plans in simpler(&least.0, self.runs.space).chunks(SHRINK_AT_ONCE) {
                self.tried += plans.len();
                let judged = self.judge(plans)?;
                let missed =
                    judged.into_iter().find(|(_, judged)| judged.margins[self.expectation] < 0.0);
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
        plan: &Plan,
        point: &[f64],
        random: &mut SplitMix64,
    ) -> Result<Option<(Plan, JudgedRun, Vec<f64>)>, HuntError> {
        let gone = if plan.faults.len() < 2 { 0 } else { plan.faults.len() };
        let space = self.runs.space;
        let ways = (0..gone).rev().flat_map(|gone| [(gone, false), (gone, true)]);
        for (gone, strongest) in ways {
            let mut kept = plan.faults.clone();
            kept.remove(gone);
            let plan = |point: &Vec<f64>| {
                let plan = space.plan(point).with_only(&kept);
                if strongest { space.maximize_faults(&plan) } else { plan }
            };
            let (mut nearest, mut at, mut nearer) = (f64::INFINITY, point.to_vec(), 0);
            for batch in 0..ONE_LESS_BATCHES {
                if batch - nearer > ONE_LESS_PATIENCE {
                    break;
                }
                let points: Vec<_> =
                    (0..SHRINK_AT_ONCE).map(|_| draw_nearby_point(&at, space, random)).collect();
                let plans: Vec<_> = points.iter().map(plan).collect();
                for (place, judged) in self.judge(&plans)? {
                    let margin = judged.margins[self.expectation];
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

    /// Starts a new search for a run with at most [`FEW_FAULTS`] faults that misses the expectation.
    /// Returns its plan, result and point.
    fn search_few_faults(
        &self,
        point: &[f64],
    ) -> Result<Option<(Plan, JudgedRun, Vec<f64>)>, HuntError> {
        let (space, seed) = (self.runs.space, self.runs.space.scenario().seed);
        let matters = |point: &[f64]| space.used_coordinates(point);
        let mut search =
            Search::new(space.coordinate_shape(), &matters, point.to_vec(), seed, false);
        let mut tried = 0;
        while tried < FEW_FAULTS_RUNS {
            let trials = search.propose_batch().to_vec();
            tried += trials.len();
            let mut plans: Vec<_> = trials.iter().map(|trial| space.plan(&trial.point)).collect();
            plans.iter_mut().for_each(|plan| plan.faults.truncate(FEW_FAULTS));
            let mut came = vec![None; plans.len()];
            for (place, judged) in self.judge(&plans)? {
                let cost = judged.margins[self.expectation];
                if cost < 0.0 {
                    let (plan, point) = (plans[place].clone(), trials[place].point.clone());
                    return Ok(Some((plan, judged, point)));
                }
                came[place] = Some(Evaluation { cost, traits: judged.traits });
            }
            search.record_evaluations(&came);
        }
        Ok(None)
    }
}
