//! `phalanx sweep`: runs the missing runs of a campaign and writes its tables.

mod numbers;

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crate::pool::processes::ProcessExecutor;
use crate::pool::{self, CampaignResult, RunExecutor};
use clap::Args;
use experiment::campaign::cells::{self, CampaignRun, CampaignRunError};
use experiment::campaign::file::{self, Campaign};
use experiment::scenario::file::load_text;
use outcome::campaign::figures::draw_figures;
use outcome::campaign::folder::{CampaignFolder, FolderError, LockError, RunState, read_state};
use outcome::campaign::page::{self, Origin};
use outcome::campaign::points::{compute_pairings, compute_points};
use outcome::campaign::table;
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::process::{StopFlag, exit};

use self::numbers::RunNumbers;
use super::Failure;
use super::cell_in_process::InProcessExecutor;
use super::reject_inside_run_roots;
use super::screen::{
    ProgressLines, print, print_diagnostic, print_failure, print_info, print_invalid_file,
    print_misuse, runs_progress_bar, show_finished_runs,
};
use outcome::results::manifest::BuildInfo;
use outcome::results::page::format_command_line;
use supervisor::spawn::Launcher;

/// Parent directory of campaigns without `--out`.
const CAMPAIGNS_DIR: &str = "runs/campaigns";

/// Arguments of `phalanx sweep`.
#[derive(Debug, Args)]
pub struct SweepArgs {
    /// Campaign file.
    #[arg(value_name = "CAMPAIGN")]
    path: PathBuf,
    /// Directory of the runs and tables; runs that already have a result are skipped [default: runs/campaigns/NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of concurrent runs in lockstep [default: number of cores].
    #[arg(long, value_name = "RUNS", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Compute lockstep runs in this process instead of one process per robot: faster, with the same
    /// tables. Runs that need processes still get them.
    #[arg(long, conflicts_with = "collect")]
    in_process: bool,
    /// Retry runs that were given up after infrastructure failures.
    #[arg(long)]
    retry: bool,
    /// Run nothing; print one command line for each missing run, for GNU parallel, HyperQueue or a Slurm array.
    #[arg(long, conflicts_with = "collect")]
    emit_commands: bool,
    /// Number of runs per emitted command line (with --emit-commands).
    #[arg(long, value_name = "RUNS", requires = "emit_commands")]
    chunk: Option<NonZeroUsize>,
    /// Run only the missing runs with these numbers, as in 1-50,73, and write no tables. The command lines
    /// of --emit-commands --chunk use it; several such processes may run at once.
    #[arg(long, value_name = "NUMBERS", conflicts_with_all = ["collect", "emit_commands"])]
    only: Option<RunNumbers>,
    /// Run nothing; write the tables of the results that exist.
    #[arg(long)]
    collect: bool,
}

pub(super) fn sweep(
    args: &SweepArgs,
    catalog: &Catalog,
    launcher: &Launcher,
    build: &BuildInfo,
) -> Result<u8, u8> {
    let campaign = file::read(&args.path, catalog).map_err(|error| print_invalid_file(&error))?;
    if args.in_process && campaign.pace == Pace::Realtime {
        return Err(print_misuse(
            &"--in-process requires pace = \"lockstep\": a run in real time needs processes, so remove the \
              option",
        ));
    }
    if args.in_process && args.emit_commands && args.chunk.is_none() {
        let error = "--emit-commands prints runs by processes: with --in-process, add --chunk RUNS";
        return Err(print_misuse(&error));
    }
    let (name, run_count) = (&campaign.name, campaign.run_count());
    if let Some(numbers) = args.only.as_ref().filter(|numbers| numbers.largest_number() > run_count)
    {
        return Err(print_misuse(&format_args!(
            "--only {numbers} is out of range: {name} has {run_count} runs"
        )));
    }
    let executable = cells::executable_sha256()
        .map_err(|error| print_failure(&format_args!("cannot read the executable: {error}")))?;
    let is_selected = |number| args.only.as_ref().is_none_or(|numbers| numbers.contains(number));
    let cells =
        cells::campaign_runs(&campaign, catalog, &executable, is_selected).map_err(|error| {
            if let CampaignRunError::Scenario { diagnostic, run } = &error {
                print_diagnostic(diagnostic);
                print_info(run);
            } else {
                print_failure(&error);
            }
            exit::BAD_SCENARIO
        })?;
    let out = args.out.clone().unwrap_or_else(|| Path::new(CAMPAIGNS_DIR).join(&campaign.name));
    reject_inside_run_roots(&out, "--out")?;
    let origin = Origin { build, executable: &executable };
    let result = run_sweep(args, &campaign, &cells, &out, launcher, catalog, &origin);
    result.map_err(|error| match error.downcast_ref() {
        Some(LockError::HeldByProcess(..)) => print_misuse(&error),
        _ => print_failure(&error),
    })
}

fn run_sweep(
    args: &SweepArgs,
    campaign: &Campaign,
    cells: &[CampaignRun],
    out: &Path,
    launcher: &Launcher,
    catalog: &Catalog,
    origin: &Origin<'_>,
) -> Result<u8, Failure> {
    let stop = super::stop_flag_on_signals()?;
    let folder = CampaignFolder::open(out)?;
    if args.retry {
        folder.clear_failures(cells);
    }
    // Reading results, printing commands and running selected numbers may happen concurrently, so they need no lock.
    let executes_runs = !args.emit_commands && !args.collect;
    let _lock = (executes_runs && args.only.is_none()).then(|| folder.lock()).transpose()?;
    let mut states = folder.read_states(cells, campaign.file_retention)?;
    report_existing_runs(args, campaign, cells, &folder, &states);
    let missing = missing_runs(cells, &states);
    if args.emit_commands {
        return Ok(print(&command_lines(args, campaign, &missing, &folder)?));
    }
    if args.only.is_none() {
        let text = load_text(&campaign.path, "").unwrap_or_default();
        folder.replace_file("campaign.toml", &text)?;
    }
    let mut was_interrupted = false;
    if executes_runs && !missing.is_empty() {
        let processes = ProcessExecutor { campaign, folder: &folder, launcher, stop: &stop };
        let result = match args.in_process {
            false => execute_missing_runs(args, campaign, &missing, &folder, &processes, &stop)?,
            true => {
                let executor = InProcessExecutor {
                    campaign,
                    folder: &folder,
                    catalog,
                    build: origin.build,
                    stop: &stop,
                    process_executor: processes,
                    process_fallback: Mutex::new((0, "")),
                };
                let result =
                    execute_missing_runs(args, campaign, &missing, &folder, &executor, &stop)?;
                if let (count @ 1.., reason) =
                    *executor.process_fallback.lock().expect("no other thread holds the lock")
                {
                    print_info(&format!(
                        "{count} of them by processes, because the scenario has {reason}"
                    ));
                }
                result
            }
        };
        was_interrupted = result.was_interrupted;
        for (cell, state) in cells.iter().zip(&mut states).filter(|(_, state)| state.needs_run()) {
            *state = read_state(&folder.run_path(&cell.id), campaign.file_retention)?;
        }
    }
    if let (Some(only), false) = (&args.only, was_interrupted) {
        return Ok(print_run_counts(campaign, only, &states));
    }
    let damaged = states.iter().filter(|state| matches!(state, RunState::Damaged(_))).count();
    let rows = table::campaign_rows(cells, &folder, states);
    if was_interrupted {
        let (done_count, total) = (rows.len(), cells.len());
        print_info(&format!(
            "interrupted: {done_count} of {total} runs are done; run the same command to continue"
        ));
        return Ok(exit::INTERRUPTED);
    }
    write_results(campaign, &rows, &folder, origin)?;
    let missing_count = cells.len() - rows.len() - damaged;
    let mut text = format!("{}: {} of {} runs", campaign.name, rows.len(), cells.len());
    text += &format_totals(&rows, missing_count, damaged);
    let exit_code = print(&format!("{text}\nwritten to {}\n", out.display()));
    Ok(match (damaged, missing_count + rows.iter().filter(|row| row.summary().is_none()).count()) {
        (0, 0) => exit_code,
        (0, _) => exit::INFRASTRUCTURE_FAILURE,
        _ => exit::EXPECTATION_MISSED,
    })
}

/// Returns one command line for each missing run, or for each chunk of missing runs.
fn command_lines(
    args: &SweepArgs,
    campaign: &Campaign,
    missing: &[&CampaignRun],
    folder: &CampaignFolder,
) -> Result<String, Failure> {
    let locate_error =
        |error| format!("cannot locate the executable and the campaign file: {error}");
    let executable = std::env::current_exe().map_err(locate_error)?;
    let path_text = |path: &Path| path.to_string_lossy().into_owned();
    let line = |arguments: Vec<String>| {
        format_command_line([path_text(&executable)].into_iter().chain(arguments)) + "\n"
    };
    let Some(chunk) = args.chunk else {
        let arguments =
            missing.iter().map(|cell| cell.arguments(campaign, &folder.run_path(&cell.id)));
        return Ok(arguments.map(line).collect());
    };
    // The command may be run from any working directory.
    let path = campaign.path.canonicalize().map_err(locate_error)?;
    let chunks = missing.chunks(chunk.get()).map(|chunk| {
        let numbers: RunNumbers = chunk.iter().map(|cell| cell.number).collect();
        let mut arguments =
            vec!["sweep".into(), path_text(&path), "--out".into(), path_text(folder.path())];
        arguments.extend(["--only".into(), numbers.to_string()]);
        arguments.extend(["--jobs", "1"].map(str::to_owned));
        arguments.extend(args.in_process.then(|| "--in-process".into()));
        line(arguments)
    });
    Ok(chunks.collect())
}

/// Prints how many of the selected runs have a result, and returns the exit code.
fn print_run_counts(campaign: &Campaign, numbers: &RunNumbers, states: &[RunState]) -> u8 {
    let done_count = states.iter().filter(|state| matches!(state, RunState::Done(_))).count();
    let (name, total) = (&campaign.name, states.len());
    let exit_code =
        print(&format!("{name}: {done_count} of {total} runs ({numbers}) have a result\n"));
    if done_count == total { exit_code } else { exit::INFRASTRUCTURE_FAILURE }
}

/// Returns the number of runs with each outcome, as text.
fn format_totals(rows: &[table::RunRow<'_>], missing: usize, damaged: usize) -> String {
    let mut text = String::new();
    for (count, label) in [(missing, "missing"), (damaged, "damaged")] {
        if count > 0 {
            text += &format!(", {count} are {label}");
        }
    }
    for outcome in ["held", "missed", "unseen", "undeclared"] {
        let count = rows.iter().filter(|row| row.verdict_keyword() == outcome).count();
        if count > 0 {
            text += &format!(", {outcome} {count}");
        }
    }
    let failed = rows.iter().filter(|row| row.summary().is_none()).count();
    if failed > 0 {
        text += &format!(", {failed} given up after infrastructure failures");
    }
    text
}

/// Returns the cells whose runs are missing or damaged, each once.
fn missing_runs<'c>(cells: &'c [CampaignRun], states: &[RunState]) -> Vec<&'c CampaignRun> {
    let mut seen = BTreeSet::new();
    let runs = cells.iter().zip(states).filter(|(_, state)| state.needs_run());
    runs.map(|(cell, _)| cell).filter(|cell| seen.insert(&cell.id)).collect()
}

/// Reports damaged runs, and the number of runs that need not be repeated.
fn report_existing_runs(
    args: &SweepArgs,
    campaign: &Campaign,
    cells: &[CampaignRun],
    folder: &CampaignFolder,
    states: &[RunState],
) {
    for (cell, state) in cells.iter().zip(states) {
        let RunState::Damaged(reason) = state else { continue };
        let (run, description) = (folder.run_path(&cell.id), cell.describe(campaign));
        let damage_text = format!("{} is damaged: {reason} ({description})", run.display());
        match args.collect {
            true => {
                print_failure(&format_args!(
                    "{damage_text}; run again without --collect to repeat it"
                ));
            }
            false => print_info(&format!(
                "{damage_text}; repeating it, and keeping the damaged one as {}.damaged",
                cell.id
            )),
        }
    }
    let existing_count = states.iter().filter(|state| !state.needs_run()).count();
    if existing_count > 0 && !args.collect && !args.emit_commands {
        print_info(&format!("{existing_count} of {} runs already have a result", cells.len()));
    }
}

/// Writes the tables, the report and its figures.
fn write_results(
    campaign: &Campaign,
    rows: &[table::RunRow<'_>],
    folder: &CampaignFolder,
    origin: &Origin<'_>,
) -> Result<(), FolderError> {
    folder.replace_file("runs.csv", &table::runs_csv(campaign, rows))?;
    folder.replace_file("timing.csv", &table::timing_csv(rows))?;
    let points = compute_points(campaign, rows);
    let pairs = compute_pairings(campaign, rows);
    let figures = draw_figures(campaign, &points);
    folder
        .replace_file("campaign.json", &page::campaign_json(campaign, &points, &pairs, origin))?;
    for figure in &figures {
        folder.replace_file(&format!("figures/{}.svg", figure.name), &figure.to_svg())?;
    }
    folder.replace_file("report.html", &page::campaign_html(campaign, &points, &pairs, &figures))
}

fn execute_missing_runs(
    args: &SweepArgs,
    campaign: &Campaign,
    missing: &[&CampaignRun],
    folder: &CampaignFolder,
    executor: &dyn RunExecutor,
    stop: &StopFlag,
) -> Result<CampaignResult, Failure> {
    folder.remove_stale_files();
    if campaign.pace == Pace::Realtime {
        print_info(
            "one run at a time: in real time, concurrent runs would compete for the processor",
        );
    }
    let bar = runs_progress_bar(missing.len());
    let jobs = args.jobs.map(usize::from);
    let mut lines = ProgressLines::new(missing.len());
    let result = pool::execute_runs(campaign, missing, folder, executor, stop, jobs, |progress| {
        let failure_text = match progress.failed_attempts {
            0 => String::new(),
            failures => format!(", {failures} failed attempts"),
        };
        show_finished_runs(bar, &mut lines, progress.finished_runs, failure_text);
    });
    bar.finish_and_clear();
    // Processes of an earlier campaign may have exited only now.
    folder.remove_stale_files();
    let result = result?;
    folder.sync()?;
    print_info(&format!(
        "{} runs in {:.1} s, {} at a time; they used {:.0} % of {} cores",
        missing.len(),
        result.wall_time_s,
        result.jobs,
        100.0 * result.processor_time_s / (result.wall_time_s * result.cores as f64),
        result.cores,
    ));
    Ok(result)
}
