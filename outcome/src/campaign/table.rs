//! `runs.csv` and `timing.csv`: one row per run.
//!
//! `runs.csv` holds what the experiment determines: in lockstep the file is the same byte for byte, however the runs
//! were executed. `timing.csv` holds what depends on the machine.

use crate::columns::shortest_text;
use crate::metrics::expect::{self, METRICS};
use crate::metrics::summary::{StageLatency, Summary};

use crate::campaign::folder::{Folder, State, failed_attempts};
use experiment::campaign::cells::Cell;
use experiment::campaign::file::Campaign;
use protocol::process::exit;

/// One run and its status.
#[derive(Debug, Clone, PartialEq)]
pub struct Row<'c> {
    /// The run's grid point, seed and configuration.
    pub cell: &'c Cell,
    /// Status of the run.
    pub state: State,
    /// Number of failed attempts.
    pub failures: usize,
}

/// Returns the rows of the runs, in order. Missing and damaged runs have no row.
pub fn campaign_rows<'c>(cells: &'c [Cell], folder: &Folder, states: Vec<State>) -> Vec<Row<'c>> {
    let mut rows = Vec::new();
    for (cell, state) in cells.iter().zip(states) {
        if !state.is_to_be_run() {
            let failures = failed_attempts(&folder.run(&cell.id)).len();
            rows.push(Row { cell, state, failures });
        }
    }
    rows
}

impl Row<'_> {
    /// Returns the summary of the run, if it has a result.
    pub fn summary(&self) -> Option<&Summary> {
        match &self.state {
            State::Done(summary) => Some(summary),
            State::GivenUp(_) | State::Missing | State::Damaged(_) => None,
        }
    }

    /// Returns the verdict on the run as a keyword: `held`, `missed`, `unseen`, `undeclared`, or `infrastructure`
    /// for a run that was given up.
    pub fn outcome(&self) -> &'static str {
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
    pub text: &'static str,
    value: RunField,
}

/// Function that returns the field of a run.
#[derive(Clone, Copy)]
enum RunField {
    /// Field that every run has.
    Any(fn(&Row<'_>) -> String),
    /// Field that follows from a summary and the minimum distance d, m; empty for a run that was given up.
    Summary(fn(&Summary, f64) -> String),
}

impl RunColumn {
    fn field(&self, row: &Row<'_>) -> String {
        match (self.value, row.summary()) {
            (RunField::Any(field), _) => field(row),
            (RunField::Summary(field), Some(summary)) => field(summary, row.cell.distance_min_m),
            (RunField::Summary(_), None) => String::new(),
        }
    }
}

/// First columns of `runs.csv`, which every run has.
const FIRST_COLUMNS: [RunColumn; 3] = [
    RunColumn {
        name: "seed",
        text: "Seed of the random number generator.",
        value: RunField::Any(|row| row.cell.seed.to_string()),
    },
    RunColumn {
        name: "outcome",
        text: "`held`, `missed` or `unseen`: the worst verdict among the expectations; `undeclared`: there are no \
               expectations; `infrastructure`: the infrastructure of the run failed three times.",
        value: RunField::Any(|row| row.outcome().to_owned()),
    },
    RunColumn {
        name: "exit",
        text: "Exit code of the run.",
        value: RunField::Any(|row| {
            row.summary().map_or(exit::INFRASTRUCTURE, |summary| summary.exit).to_string()
        }),
    },
];

/// Last column of `runs.csv`, and first of `timing.csv`.
const RUN: RunColumn = RunColumn {
    name: "run",
    text: "Identifier of the run, and name of its directory below `runs/`.",
    value: RunField::Any(|row| row.cell.id.clone()),
};

/// Returns the columns of `runs.csv` after the columns of the axes.
pub fn run_columns() -> impl Iterator<Item = RunColumn> {
    let of_summary = Summary::COLUMNS.iter().map(|column| RunColumn {
        name: column.name,
        text: column.text,
        value: RunField::Summary(column.value),
    });
    FIRST_COLUMNS.into_iter().chain(of_summary).chain([RUN])
}

/// Returns the content of `runs.csv`.
pub fn runs(campaign: &Campaign, rows: &[Row<'_>]) -> String {
    let columns: Vec<RunColumn> = run_columns().collect();
    let axes = campaign.axes.iter().map(|axis| axis.key.as_str());
    let metrics = metric_names(rows);
    let heads = columns.iter().map(|column| column.name.to_owned());
    let heads = axes.map(str::to_owned).chain(heads);
    let heads: Vec<String> =
        heads.chain(metrics.iter().map(|name| format!("{METRICS}{name}"))).collect();
    to_csv(
        &heads.iter().map(String::as_str).collect::<Vec<_>>(),
        rows.iter().map(|row| {
            let settings = campaign.settings_at(row.cell.point);
            let axes = settings.iter().map(|setting| setting.shown.clone());
            let fields = axes.chain(columns.iter().map(|column| column.field(row)));
            fields.chain(metrics.iter().map(|name| metric(row, name))).collect()
        }),
    )
}

/// Returns the names of the metrics of the experiments' own, in the order in which the runs have them. Each is a last
/// column of `runs.csv`.
fn metric_names<'r>(rows: &'r [Row<'_>]) -> Vec<&'r str> {
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in rows.iter().filter_map(Row::summary).flat_map(|summary| &summary.metrics) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    names
}

/// Returns the field of a metric of the experiment's own; empty if it has no value.
fn metric(row: &Row<'_>, name: &str) -> String {
    let metrics = row.summary().map_or(&[][..], |summary| &summary.metrics);
    let value = metrics.iter().find(|(known, _)| known == name).and_then(|(_, value)| *value);
    value.map_or(String::new(), shortest_text)
}

/// Columns of `timing.csv`.
pub const TIMING: [RunColumn; 10] = [
    RUN,
    RunColumn {
        name: "failed_attempts",
        text: "Number of attempts in which the infrastructure failed.",
        value: RunField::Any(|row| row.failures.to_string()),
    },
    RunColumn {
        name: "startup_s",
        text: "Wall time from the start of the first process to t = 0, s; empty with `--in-process`.",
        value: RunField::Summary(|summary, _| {
            summary.wall.startup_s.map_or(String::new(), shortest_text)
        }),
    },
    RunColumn {
        name: "wall_s",
        text: "Wall time from t = 0 to the end, s.",
        value: RunField::Summary(|summary, _| shortest_text(summary.wall.wall_s)),
    },
    RunColumn {
        name: "ticks_per_s",
        text: "Plant ticks per second of wall time.",
        value: RunField::Summary(|summary, _| shortest_text(summary.wall.ticks_per_s)),
    },
    RunColumn {
        name: "real_time_factor",
        text: "Run time divided by wall time.",
        value: RunField::Summary(|summary, _| shortest_text(summary.wall.real_time_factor)),
    },
    RunColumn {
        name: "processor_s",
        text: "Processor time of all processes of the run, s; with `--in-process`, of the thread that computed it.",
        value: RunField::Summary(|summary, _| {
            let usage = summary.wall.processes.iter().map(|process| process.usage);
            let processor_s: f64 = usage.map(|usage| usage.user_s + usage.system_s).sum();
            format!("{processor_s:.6}")
        }),
    },
    RunColumn {
        name: "deadline_misses",
        text: "Number of commands sent after the agent's next wake-up was due, in real time.",
        value: RunField::Summary(|summary, _| summary.deadline_misses.to_string()),
    },
    RunColumn {
        name: "compute_p99_us",
        text: "Time from an odometry sample to the command, p99 of the slowest robot, us; with `--in-process`, \
               without the time for reading from other processes.",
        value: RunField::Summary(|summary, _| {
            let slowest_ns = compute_times(summary).map(|line| line.p99_ns).max();
            slowest_ns.map_or(String::new(), |ns| shortest_text(ns as f64 / 1e3))
        }),
    },
    RunColumn {
        name: "compute_mean_us",
        text: "Mean of this time over all robots and samples, us.",
        value: RunField::Summary(|summary, _| {
            let count: u64 = compute_times(summary).map(|line| line.count).sum();
            let total_ns: f64 =
                compute_times(summary).map(|line| line.mean_ns * line.count as f64).sum();
            let mean_ns = (count > 0).then(|| total_ns / count as f64);
            mean_ns.map_or(String::new(), |ns| format!("{:.3}", ns / 1e3))
        }),
    },
];

fn compute_times(summary: &Summary) -> impl Iterator<Item = &StageLatency> {
    summary.wall.latency.iter().filter(|line| line.stage == "compute")
}

/// Returns the content of `timing.csv`.
pub fn timing(rows: &[Row<'_>]) -> String {
    let heads = TIMING.map(|column| column.name);
    to_csv(&heads, rows.iter().map(|row| TIMING.map(|column| column.field(row)).into()))
}

fn to_csv(heads: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(heads).expect("memory takes everything");
    for row in rows {
        writer.write_record(&row).expect("as many fields as heads");
    }
    String::from_utf8(writer.into_inner().expect("memory takes everything")).expect("text only")
}
