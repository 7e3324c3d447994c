//! `runs.csv` and `timing.csv`: one row per run.
//!
//! `runs.csv` holds what the experiment determines: in lockstep the file is the same byte for byte, however the runs
//! were executed. `timing.csv` holds what depends on the machine.

use crate::columns::format_number;
use crate::metrics::expect::{self, METRIC_NAME_PREFIX};
use crate::metrics::summary::{StageLatency, Summary};

use crate::campaign::folder::{CampaignFolder, RunState, read_failed_attempts};
use experiment::campaign::cells::CampaignRun;
use experiment::campaign::file::Campaign;
use protocol::process::exit;

/// One run and its status.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRow<'c> {
    /// The run's grid point, seed and configuration.
    pub campaign_run: &'c CampaignRun,
    /// Status of the run.
    pub state: RunState,
    /// Number of failed attempts.
    pub failure_count: usize,
}

/// Returns the rows of the runs, in order. Missing and damaged runs have no row.
pub fn campaign_rows<'c>(
    cells: &'c [CampaignRun],
    folder: &CampaignFolder,
    states: Vec<RunState>,
) -> Vec<RunRow<'c>> {
    let mut rows = Vec::new();
    for (cell, state) in cells.iter().zip(states) {
        if !state.needs_run() {
            let failures = read_failed_attempts(&folder.run_path(&cell.id)).len();
            rows.push(RunRow { campaign_run: cell, state, failure_count: failures });
        }
    }
    rows
}

impl RunRow<'_> {
    /// Returns the summary of the run, if it has a result.
    pub fn summary(&self) -> Option<&Summary> {
        match &self.state {
            RunState::Done(summary) => Some(summary),
            RunState::GivenUp(_) | RunState::Missing | RunState::Damaged(_) => None,
        }
    }

    /// Returns the verdict on the run as a keyword: `held`, `missed`, `unseen`, `undeclared`, or `infrastructure`
    /// for a run that was given up.
    pub fn verdict_keyword(&self) -> &'static str {
        let Some(summary) = self.summary() else { return "infrastructure" };
        expect::worst_verdict(&summary.expectations)
            .map_or("undeclared", |verdict| verdict.as_str())
    }
}

/// Column of `runs.csv` or `timing.csv`.
pub struct RunColumn {
    /// Name in the header.
    pub name: &'static str,
    /// Text for the reference page.
    pub description: &'static str,
    field_value: RunField,
}

/// Function that returns the field of a run.
#[derive(Clone, Copy)]
enum RunField {
    /// Field that every run has.
    FromRow(fn(&RunRow<'_>) -> String),
    /// Field that follows from a summary and the minimum distance d, m; empty for a run that was given up.
    FromSummary(fn(&Summary, f64) -> String),
}

impl RunColumn {
    fn field(&self, row: &RunRow<'_>) -> String {
        match (self.field_value, row.summary()) {
            (RunField::FromRow(field), _) => field(row),
            (RunField::FromSummary(field), Some(summary)) => {
                field(summary, row.campaign_run.distance_min_m)
            }
            (RunField::FromSummary(_), None) => String::new(),
        }
    }
}

/// First columns of `runs.csv`, which every run has.
const FIRST_COLUMNS: [RunColumn; 3] = [
    RunColumn {
        name: "seed",
        description: "Seed of the random number generator.",
        field_value: RunField::FromRow(|row| row.campaign_run.seed.to_string()),
    },
    RunColumn {
        name: "outcome",
        description: "`held`, `missed` or `unseen`: the worst verdict among the expectations; `undeclared`: there are no \
               expectations; `infrastructure`: the infrastructure of the run failed three times.",
        field_value: RunField::FromRow(|row| row.verdict_keyword().to_owned()),
    },
    RunColumn {
        name: "exit",
        description: "Exit code of the run.",
        field_value: RunField::FromRow(|row| {
            row.summary().map_or(exit::INFRASTRUCTURE_FAILURE, |summary| summary.exit).to_string()
        }),
    },
];

/// Last column of `runs.csv`, and first of `timing.csv`.
const RUN_ID_COLUMN: RunColumn = RunColumn {
    name: "run",
    description: "Identifier of the run, and name of its directory below `runs/`.",
    field_value: RunField::FromRow(|row| row.campaign_run.id.clone()),
};

/// Returns the columns of `runs.csv` after the columns of the axes.
pub fn run_columns() -> impl Iterator<Item = RunColumn> {
    let of_summary = Summary::COLUMNS.iter().map(|column| RunColumn {
        name: column.name,
        description: column.text,
        field_value: RunField::FromSummary(column.value),
    });
    FIRST_COLUMNS.into_iter().chain(of_summary).chain([RUN_ID_COLUMN])
}

/// Returns the content of `runs.csv`.
pub fn runs_csv(campaign: &Campaign, rows: &[RunRow<'_>]) -> String {
    let columns: Vec<RunColumn> = run_columns().collect();
    let axes = campaign.axes.iter().map(|axis| axis.key.as_str());
    let metrics = metric_names(rows);
    let heads = columns.iter().map(|column| column.name.to_owned());
    let heads = axes.map(str::to_owned).chain(heads);
    let heads: Vec<String> =
        heads.chain(metrics.iter().map(|name| format!("{METRIC_NAME_PREFIX}{name}"))).collect();
    to_csv(
        &heads.iter().map(String::as_str).collect::<Vec<_>>(),
        rows.iter().map(|row| {
            let settings = campaign.settings_at(row.campaign_run.point_index);
            let axes = settings.iter().map(|setting| setting.display_text.clone());
            let fields = axes.chain(columns.iter().map(|column| column.field(row)));
            fields.chain(metrics.iter().map(|name| format_metric(row, name))).collect()
        }),
    )
}

/// Returns the names of the metrics of the experiments' own, in the order in which the runs have them. Each is a last
/// column of `runs.csv`.
fn metric_names<'r>(rows: &'r [RunRow<'_>]) -> Vec<&'r str> {
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in rows.iter().filter_map(RunRow::summary).flat_map(|summary| &summary.metrics) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    names
}

/// Returns the field of a metric of the experiment's own; empty if it has no value.
fn format_metric(row: &RunRow<'_>, name: &str) -> String {
    let metrics = row.summary().map_or(&[][..], |summary| &summary.metrics);
    let value = metrics.iter().find(|(known, _)| known == name).and_then(|(_, value)| *value);
    value.map_or(String::new(), format_number)
}

/// Columns of `timing.csv`.
pub const TIMING_COLUMNS: [RunColumn; 10] = [
    RUN_ID_COLUMN,
    RunColumn {
        name: "failed_attempts",
        description: "Number of attempts in which the infrastructure failed.",
        field_value: RunField::FromRow(|row| row.failure_count.to_string()),
    },
    RunColumn {
        name: "startup_s",
        description: "Wall time from the start of the first process to t = 0, s; empty with `--in-process`.",
        field_value: RunField::FromSummary(|summary, _| {
            summary.wall.startup_s.map_or(String::new(), format_number)
        }),
    },
    RunColumn {
        name: "wall_s",
        description: "Wall time from t = 0 to the end, s.",
        field_value: RunField::FromSummary(|summary, _| format_number(summary.wall.wall_s)),
    },
    RunColumn {
        name: "ticks_per_s",
        description: "Plant ticks per second of wall time.",
        field_value: RunField::FromSummary(|summary, _| format_number(summary.wall.ticks_per_s)),
    },
    RunColumn {
        name: "real_time_factor",
        description: "Run time divided by wall time.",
        field_value: RunField::FromSummary(|summary, _| {
            format_number(summary.wall.real_time_factor)
        }),
    },
    RunColumn {
        name: "processor_s",
        description: "Processor time of all processes of the run, s; with `--in-process`, of the thread that computed it.",
        field_value: RunField::FromSummary(|summary, _| {
            let processes = summary.wall.processes.iter();
            let processor_s: f64 = processes.map(|process| process.usage.processor_time_s()).sum();
            format!("{processor_s:.6}")
        }),
    },
    RunColumn {
        name: "deadline_misses",
        description: "Number of commands sent after the agent's next wake-up was due, in real time.",
        field_value: RunField::FromSummary(|summary, _| summary.deadline_misses.to_string()),
    },
    RunColumn {
        name: "compute_p99_us",
        description: "Time from an odometry sample to the command, p99 of the slowest robot, us; with `--in-process`, \
               without the time for reading from other processes.",
        field_value: RunField::FromSummary(|summary, _| {
            let slowest_ns = computation_latencies(summary).map(|line| line.p99_ns).max();
            slowest_ns.map_or(String::new(), |ns| format_number(ns as f64 / 1e3))
        }),
    },
    RunColumn {
        name: "compute_mean_us",
        description: "Mean of this time over all robots and samples, us.",
        field_value: RunField::FromSummary(|summary, _| {
            let count: u64 = computation_latencies(summary).map(|line| line.count).sum();
            let total_ns: f64 =
                computation_latencies(summary).map(|line| line.mean_ns * line.count as f64).sum();
            let mean_ns = (count > 0).then(|| total_ns / count as f64);
            mean_ns.map_or(String::new(), |ns| format!("{:.3}", ns / 1e3))
        }),
    },
];

fn computation_latencies(summary: &Summary) -> impl Iterator<Item = &StageLatency> {
    summary.wall.latency.iter().filter(|line| line.stage == "compute")
}

/// Returns the content of `timing.csv`.
pub fn timing_csv(rows: &[RunRow<'_>]) -> String {
    let heads = TIMING_COLUMNS.map(|column| column.name);
    to_csv(&heads, rows.iter().map(|row| TIMING_COLUMNS.map(|column| column.field(row)).into()))
}

fn to_csv(heads: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(heads).expect("memory takes everything");
    for row in rows {
        writer.write_record(&row).expect("as many fields as heads");
    }
    String::from_utf8(writer.into_inner().expect("memory takes everything")).expect("text only")
}
